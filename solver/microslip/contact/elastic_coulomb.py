"""Two coupled Jenkins elements and a one-sided normal spring: elastic-Coulomb friction (docs/theory.md, section 3).

Each Jenkins element is a spring ``k_t`` in series with a slider at position ``w``, T = k_t (du_t - w).  Motion and slider
position are relative to the initial position ``w0``, so that p_t = -k_t (w - w0) is exactly zero, without roundoff, until the
slider first moves.  The march to the steady cycle (elastic_coulomb.c) and the time step (return_map.c) are compiled.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ..fourier.coefficients import analysis_matrix, synthesis_matrix
from ..fourier.harmonics import Harmonics
from ._elastic_coulomb import Pairs, Sampling, leaves, march
from ._return_map import SpringPairs, steps
from .law import ContactCycle
from .parameters import with_mean
from .preloaded import Preloaded
from .sliders import Sliders

_ONE_SIDED = 1e-6  # relative to a force or a motion: step of the difference by a friction coefficient or stiffness of 0


@dataclass(frozen=True)
class ElasticCoulomb(Preloaded):
    """The law of ``n`` pairs, contiguous arrays (n,); ValueError if a value is negative or an array has a wrong shape.

    ``dataclasses.replace(law, N0=..., w0=...)`` is the same joint about another state of rest.
    """

    separate: np.ndarray  # bool: each tangential direction has its own friction limit
    w0: np.ndarray = field(default_factory=lambda: np.zeros(2))  # (n, 2), or (2,) for all: initial slider positions [m], (3.5)
    sampled: bool = False  # the return map (3.3) at the samples only, instead of the path between them (3.6)
    k_ty: np.ndarray | None = None  # (n,) tangential stiffness along y, where limits are separate [N/m]; None: k_t
    mu_y: np.ndarray | None = None  # (n,) friction coefficient along y, where limits are separate [-]; None: mu
    _last: dict[str, Any] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )  # cycle of the last parameter rates

    def __post_init__(self) -> None:
        n = np.size(self.k_t)
        for name in ("mu", "N0", "k_t", "k_n", "separate"):
            kind = bool if name == "separate" else np.float64
            values = np.ascontiguousarray(getattr(self, name), dtype=kind)
            if values.shape != (n,):
                raise ValueError(f"{name} has shape {values.shape}, needs ({n},) like k_t")
            if name in ("mu", "k_t", "k_n") and np.any(values < 0.0):
                raise ValueError(f"{name} of pair {np.nanargmin(values)} is negative: {np.nanmin(values)}")
            object.__setattr__(self, name, values)
        object.__setattr__(self, "w0", np.ascontiguousarray(np.broadcast_to(self.w0, (n, 2)), dtype=np.float64))
        object.__setattr__(self, "open_at_rest", np.ascontiguousarray(np.broadcast_to(self.open_at_rest, (n,)), dtype=bool))
        if np.any(self.open_at_rest & (self.N0 > 0.0)):
            raise ValueError(f"pair {np.argmax(self.open_at_rest & (self.N0 > 0.0))} is open at rest, and has a preload")
        self._check_directions()

    def _check_directions(self) -> None:
        """Check the parameters along y, and drop those equal to x; a circular limit does not allow a difference."""
        for name, of_x in (("k_ty", self.k_t), ("mu_y", self.mu)):
            if getattr(self, name) is None:
                continue
            values = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if values.shape != of_x.shape:
                raise ValueError(f"{name} has shape {values.shape}, needs {of_x.shape} like k_t")
            differs = values != of_x
            bad = differs & ~(self.separate & (values > 0.0) & (of_x > 0.0))
            if bad.any():
                raise ValueError(f"{name} of pair {np.argmax(bad)} differs from x, which needs separate limits and both above 0")
            object.__setattr__(self, name, values if differs.any() else None)

    @property
    def n_memory(self) -> int:
        """Number of internal variables per pair that a time step stores in addition to p: none, as p gives the slider positions.

        Two if pairs are open at rest: p of such a pair is its whole force, from which the slider position does not follow.
        """
        return 2 if self.open_at_rest.any() else 0

    @property
    def n_pairs(self) -> int:
        """The number of pairs."""
        return len(self.k_t)

    @property
    def order(self) -> int:
        """The order in 1 / N_t at which the harmonics of a cycle converge: 1 for the return map, 2 for the path in between."""
        return 1 if self.sampled else 2

    @property
    def elements_order(self) -> int:
        """0: a pair is one element."""
        return 0

    @property
    def refined(self) -> ElasticCoulomb:
        """The law itself."""
        return self

    @cached_property
    def springs(self) -> np.ndarray:
        """The springs of a pair in contact, (n, 3) [N/m], also of pairs that are open at rest."""
        return np.column_stack([self._k_xy, self.k_n])

    @cached_property
    def _k_xy(self) -> np.ndarray:
        """Tangential stiffness along x and y, (n, 2) [N/m]."""
        return np.stack([self.k_t, self.k_t if self.k_ty is None else self.k_ty], axis=1)

    @cached_property
    def _mu_xy(self) -> np.ndarray:
        """Friction coefficients along x and y, (n, 2)."""
        return np.stack([self.mu, self.mu if self.mu_y is None else self.mu_y], axis=1)

    @cached_property
    def _shorter(self) -> np.ndarray:
        """k_y / k_x, (n,): a motion in y has the force of a motion in x multiplied by this ratio."""
        return np.divide(self._k_xy[:, 1], self.k_t, out=np.ones(self.n_pairs), where=self._k_xy[:, 1] != self.k_t)

    def take(self, indices: np.ndarray | slice) -> ElasticCoulomb:
        """Return the law of some pairs: an index array, a mask or a slice.  Local."""
        names = ("mu", "N0", "k_t", "k_n", "separate", "w0", "open_at_rest", "k_ty", "mu_y")
        return replace(self, **{name: getattr(self, name)[indices] for name in names if getattr(self, name) is not None})

    def followed(self, path: bool) -> ElasticCoulomb:
        """Return the law that follows the path between samples, (3.6), or the return map at samples only, (3.3).  Local."""
        return replace(self, sampled=not path)

    # -- a cycle -----------------------------------------------------------------------------------------------

    def cycle(self, U: np.ndarray, n_samples: int, tangents: bool = True, harmonics: Harmonics | None = None) -> ContactCycle:
        """Return the harmonics of the contact forces beyond the stuck springs under the periodic motion ``U``.

        Local.  Marches the law through periods of ``n_samples``, from T = k_t (du_t - w0) at the first sample, to the steady
        cycle: docs/theory.md, eq. (3.5), eq. (3.7) and eq. (6.1).

        Parameters
        ----------
        U : (n, 3, N_H) coefficients of ``du`` in each pair's frame [m]; n may be 0
        n_samples : N_t >= 2 H + 1, H the highest harmonic
        tangents : if False, P is None
        harmonics : the harmonics of ``U`` and p; 0 to H by default

        Notes
        -----
        P is the exact derivative of p.  It jumps where the end of slip moves to another sample, and with the return map also
        where a sample changes from stick to slip or from closed to open; there P is a one-sided derivative.  A pair is active if
        it slips in any period, if it opens, or if it starts with a gap.  A pair that slides only before the steady cycle is
        active with state STICK and a constant p.  A pair with NaN in ``U`` or in a parameter is active, with p and P NaN.
        """
        n, _, N_H = U.shape
        if self.n_pairs != n:
            raise ValueError(f"harmonics of {n} pairs with the law of {self.n_pairs}")
        if self.k_ty is not None or self.mu_y is not None:
            return self._cycle_by_direction(U, n_samples, tangents, harmonics)
        sampling = _sampling(harmonics or Harmonics.full(N_H), n_samples, self.sampled)
        if sampling.n_coefficients != N_H:
            raise ValueError(f"{N_H} coefficients for the harmonics {harmonics}, which have {sampling.n_coefficients}")
        p, (state, drifts) = np.zeros((n, 3, N_H)), np.zeros((2, n), dtype=np.uint8)
        active = np.empty(0, dtype=np.intp)
        if n > 0:
            U, separate = np.ascontiguousarray(U, dtype=np.float64), self.separate.view(np.uint8)
            pairs = Pairs(U, self.mu, self.N0, self.k_t, self.k_n, separate, self.w0)
            leaves(sampling, pairs, state)
            active = state.nonzero()[0]
        P = np.empty((len(active), 3 * N_H, 3 * N_H)) if tangents else None
        if len(active) > 0:
            march(sampling, pairs, active, p, state, drifts, P)
        cycle = ContactCycle(p, state, active, P, drifts.astype(bool))
        return self._without_springs(cycle, U, sampling) if self.open_at_rest.any() else cycle

    def _cycle_by_direction(self, U: np.ndarray, n_samples: int, tangents: bool, harmonics: Harmonics | None) -> ContactCycle:
        """Return the cycle of pairs with a different stiffness or friction coefficient along y: docs/theory.md, eq. (3.9).

        Forces in y are multiplied by mu_x / mu_y, motions in y by mu_x / mu_y and k_y / k_x: y then has the parameters of x.
        """
        mu_y, ones = self._mu_xy[:, 1], np.ones(self.n_pairs)
        force = np.divide(self.mu, mu_y, out=ones.copy(), where=mu_y != self.mu)
        motion = force * self._shorter
        scaled = U * np.stack([ones, motion, ones], axis=1)[:, :, None]
        w0 = self.w0 * np.stack([ones, motion], axis=1)
        cycle = replace(self, w0=w0, k_ty=None, mu_y=None).cycle(scaled, n_samples, tangents, harmonics)
        cycle.p[:, 1] /= force[:, None]
        if cycle.P is not None:
            y = slice(U.shape[2], 2 * U.shape[2])
            cycle.P[:, y] /= force[cycle.active, None, None]
            cycle.P[:, :, y] *= motion[cycle.active, None, None]
        return cycle

    def _without_springs(self, cycle: ContactCycle, U: np.ndarray, sampling: Sampling) -> ContactCycle:
        """Return the cycle in which p of pairs that are open at rest is their whole force, eq. (3.8); 0 if they never touch."""
        touches = ~self.open_at_rest
        touches[self.open_at_rest] = (
            sampling.least(U[self.open_at_rest, 2]) * self.k_n[self.open_at_rest] < self.N0[self.open_at_rest]
        )
        active = cycle.active[touches[cycle.active]]
        p, P = np.where(touches[:, None, None], cycle.p, 0.0), cycle.P
        now = self.open_at_rest & touches
        p[now] += self.springs[now, :, None] * U[now]
        if P is not None:
            P = P[touches[cycle.active]]
            n = P.shape[-1]
            springs = np.where(self.open_at_rest[:, None], self.springs, 0.0)[active]
            P[:, np.arange(n), np.arange(n)] += np.repeat(springs, n // 3, axis=1)
        return replace(cycle, p=p, active=active, P=P)

    # -- its parameters ----------------------------------------------------------------------------------------

    described = "elastic-Coulomb friction"

    def _changed(self, name: str, pairs: np.ndarray, values: np.ndarray) -> dict[str, Any]:
        """Return the changed columns; those along y change in proportion."""
        changed, of_y = super()._changed(name, pairs, values), {"mu": "mu_y", "k_t": "k_ty"}.get(name)
        if of_y and getattr(self, of_y) is not None:
            before = getattr(self, name)
            ratio = np.divide(getattr(self, of_y), before, out=np.ones_like(before), where=before > 0.0)
            changed[of_y] = changed[name] * ratio
        return changed

    def rate_at_preload(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics | None = None) -> np.ndarray:
        """Return d p / d parameter, by k_n at a constant N0.

        Local.  From the derivative of the cycle by the motion; a one-sided difference where the varied mu or k_t is 0.  At
        N0 = 0 the derivative by N0 is the one-sided derivative for N0 < 0.
        """
        self._check(name)
        U, harmonics, columns = with_mean(U, harmonics)
        rate = self._rate_with_springs(name, U, n_samples, harmonics)
        if self.open_at_rest.any():
            least = _sampling(harmonics, n_samples, self.sampled).least(np.ascontiguousarray(U[:, 2]))
            touches = least * self.k_n < self.N0
            rate[self.open_at_rest & ~touches] = 0.0
            now = self.open_at_rest & touches
            if name == "k_t":
                rate[now, :2] += np.stack([np.ones(self.n_pairs), self._shorter], axis=1)[now, :, None] * U[now, :2]
            if name == "k_n":
                rate[now, 2] += U[now, 2]
        return rate[:, :, columns]

    def _rate_with_springs(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics) -> np.ndarray:
        """Return the derivative of p by a parameter as if all pairs had their springs, for harmonics with a mean."""
        loose, still = self.k_n == 0.0, U.copy()  # where N = N0 is constant, a spring without motion gives d p / d N
        still[loose, 2] = 0.0
        bare = replace(self, k_n=np.where(loose, 1.0, self.k_n), open_at_rest=np.zeros(1, dtype=bool))
        key = still.tobytes(), n_samples, harmonics
        if self._last.get("key") != key:  # the rates by several parameters share one cycle
            self._last.update(key=key, cycle=bare.cycle(still, n_samples, True, harmonics))
        cycle = self._last["cycle"]
        active, N_H, rate = cycle.active, U.shape[2], np.zeros_like(U)
        assert cycle.P is not None, "requested"
        P = cycle.P.reshape(-1, 3, N_H, 3, N_H)
        if name in ("mu", "k_t"):
            column = getattr(self, name)
            motion = U[:, :2].copy()
            motion[:, :, 0] -= self.w0
            by_motion = np.einsum("iahbk,ibk->iah", P[:, :2, :, :2], motion[active])
            change = by_motion if name == "k_t" else cycle.p[active, :2] - by_motion
            rate[active, :2] = change / np.where(column > 0.0, column, 1.0)[active, None, None]
            without = np.flatnonzero(column == 0.0)
            if len(without):
                rate[without] = bare.take(without)._one_sided(name, still[without], motion[without], n_samples, harmonics)
        elif name == "N0":
            rate[active] = -P[..., 2, 0] / bare.k_n[active, None, None]
            rate[active, 2, 0] -= self.N0[active] <= 0.0
        else:
            rate[active] = np.einsum("iahk,ik->iah", P[..., 2, :], U[active, 2]) / bare.k_n[active, None, None]
        return rate

    def _one_sided(self, name: str, U: np.ndarray, motion: np.ndarray, n_samples: int, harmonics: Harmonics) -> np.ndarray:
        """Return the derivative of p by a mu or k_t of 0, with a step small relative to the effect of the other parameter."""
        far, pressed = np.abs(motion).sum(axis=(1, 2)), np.abs(self.N0) + self.k_n * np.abs(U[:, 2]).sum(axis=1)
        of, per = (self.k_t * far, pressed) if name == "mu" else (self.mu * pressed, far)
        step = np.divide(_ONE_SIDED * of, per, out=np.ones_like(of), where=(of > 0.0) & (per > 0.0))
        changed = self.with_parameters(name, np.arange(self.n_pairs), step)
        p, p_changed = (law.cycle(U, n_samples, False, harmonics).p for law in (self, changed))
        return (p_changed - p) / step[:, None, None]

    # -- a time step -------------------------------------------------------------------------------------------

    def step(self, du: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p and internal variables after a step to ``du``, the derivative of p, and the states.

        Local.  docs/theory.md, eq. (3.1), eq. (3.2), eq. (3.3), eq. (3.4) and eq. (3.8).  The slider positions are
        w = w0 - p_t / k_t, so that p is the only state variable, and p of a pair that sticks is bitwise unchanged.  For a pair
        that is open at rest, p_t without the springs is stored in addition to p.

        Parameters
        ----------
        du : (..., n, 3) relative displacement at the end of the step [m]
        before : (..., n, 3 + n_memory) p and internal variables at the start of the step [N]

        Returns
        -------
        after : (..., n, 3 + n_memory) [N], as ``before``
        L : (..., n, 3, 3) d p / d du [N/m]; zero where a pair sticks, or is open at rest and not in contact
        state : (..., n) uint8, STICK, SLIP or OPEN during the step
        """
        if not self.open_at_rest.any():
            return self._sprung_step(du, before)
        open_at_rest, springs = self.open_at_rest[:, None], np.where(self.open_at_rest[:, None], self.springs, 0.0)
        p, L, state = self._sprung_step(du, np.where(open_at_rest, before[..., 3:], before[..., :2]))
        memory = np.where(open_at_rest, p[..., :2], 0.0)
        L[..., np.arange(3), np.arange(3)] += springs
        return np.concatenate([p + springs * du, memory], axis=-1), L, state

    def _sprung_step(self, du: np.ndarray, p_before: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p (..., n, 3) after a step as if all pairs had their springs, its derivative and the states.

        Only the tangential components of ``p_before`` (..., n, 2 or more) are used.
        """
        n, shape = self.n_pairs, du.shape[:-1]
        p, L, state = np.empty(du.shape), np.empty((*shape, 3, 3)), np.empty(shape, dtype=np.uint8)
        if n > 0:
            given = (np.ascontiguousarray(x, dtype=np.float64).reshape(-1, n, x.shape[-1]) for x in (du, p_before))
            steps(self._for_steps, *given, p.reshape(-1, n, 3), L.reshape(-1, n, 3, 3), state.reshape(-1, n))
        return p, L, state

    @cached_property
    def _for_steps(self) -> SpringPairs:
        return SpringPairs(self._mu_xy, self._k_xy, self.w0, self.N0, self.k_n, self.separate.view(np.uint8))

    @property
    def sliders(self) -> tuple[Sliders, ...]:
        """The sliders, one per pair."""
        return (Sliders(self._for_steps, self._k_xy, np.arange(self.n_pairs)),)

    def memoryless_rate(self, du: np.ndarray) -> np.ndarray:
        """Return d p / d du of the history-independent part of p, (..., n, 3) [N/m]: normal force, springs of (3.8).

        Local.  ``du`` is (..., n, 3).
        """
        rate = np.zeros(du.shape)
        rate[..., 2] = np.where(self.N0 - self.k_n * du[..., 2] <= 0.0, -self.k_n, 0.0)
        return rate + np.where(self.open_at_rest[:, None], self.springs, 0.0)

    # -- its limits --------------------------------------------------------------------------------------------

    @cached_property
    def held_at_rest(self) -> np.ndarray:
        """|T0|, the friction force at rest, (n,) [N]: docs/theory.md, eq. (3.5)."""
        return self.k_t * np.hypot(self.w0[:, 0], self._shorter * self.w0[:, 1])

    @cached_property
    def _least_mu(self) -> np.ndarray:
        return self._mu_xy.min(axis=1)

    def slip_safety(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the factor by which motions may grow while each pair certainly sticks and stays closed, (..., n).  Local.

        A sufficient condition: with all harmonics at their peak together, in the direction of T0, the pair is within the friction
        limit, |T0| + k_t |du_t| <= mu (N0 - k_n du_z).  0 for a pair without preload, with a gap, or at its friction limit at
        rest.  For a pair that is open at rest, the factor up to which it stays open.
        """
        x, y, z = np.moveaxis(amplitudes, -1, 0)
        limit = np.broadcast_to(np.where(self.open_at_rest, -self.N0, self._friction_left(np.maximum(self.N0, 0.0))), x.shape)
        demand = np.where(
            self.open_at_rest, self.k_n * z, self.k_t * np.hypot(x, self._shorter * y) + self._least_mu * self.k_n * z
        )
        return np.divide(limit, demand, out=np.where(limit > 0.0, np.inf, 0.0), where=demand > 0.0)

    def utilisation(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the utilisation of the friction limit, or of the preload, by the motions, (..., n).  Local.

        Infinite for a moving pair at its friction limit at rest, and for one with springs across a gap; the closed fraction of
        the gap for a pair that is open at rest.
        """
        x, y, z = np.moveaxis(amplitudes, -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            pressed = np.maximum(self.N0, 0.0)
            shear = self.k_t * np.hypot(x, self._shorter * y) / self._friction_left(pressed)
            shares = np.where(self.open_at_rest, 0.0, shear), self.k_n * z / np.where(self.open_at_rest, -self.N0, pressed)
        return np.nan_to_num(np.stack(shares), nan=0.0, posinf=np.inf).max(axis=0)

    def slipping_share(self, amplitudes: np.ndarray, of_limit: float = 1.0) -> np.ndarray:
        """Return S of docs/theory.md, eq. (4.5), the upper bound of |p| / stuck force, (..., n, 3).  Local.

        A Jenkins element with a stuck force of n times its limit slips by 1 - 1/n of its motion.  Limits are multiplied by
        ``of_limit``.
        """
        x, y, z = np.moveaxis(amplitudes, -1, 0)
        shear, press = self.k_t * np.hypot(x, self._shorter * y), self.k_n * z
        limit = self._friction_left(np.maximum(self.N0 - press, 0.0))
        tangential, normal = _excess(shear, of_limit * limit), _excess(press, of_limit * self.N0)
        return np.stack([tangential, tangential, normal], axis=-1)

    def _friction_left(self, N: np.ndarray) -> np.ndarray:
        """Return mu N - |T0|, at least 0: the friction force available in every direction."""
        return np.maximum(self._least_mu * N - self.held_at_rest, 0.0)

    def keeps_half_wave_symmetry(self, moves: np.ndarray) -> np.ndarray:
        """Return which pairs keep half-wave symmetry, u(t + T/2) = -u(t), if the components ``moves`` (n, 3) move, (n,).  Local.

        These are the pairs with constant normal force and w0 = 0.  The positions at which no sample moves the slider form a
        convex set, symmetric about 0 as the motion.  If the set is not empty it contains 0, the slider stays at 0, and p
        vanishes.  If it is empty the slider slips in every cycle, its initial position has no effect, and the unique cycle has
        the symmetry.  Free sliding (mu N = 0) and k_t = 0 are linear.  The return map at the samples has the same sets.
        """
        return ~moves[:, 2] & (self.held_at_rest == 0.0)


def _excess(force: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Return 1 - limit / force, at least 0 and at most 1."""
    return np.clip(1.0 - np.divide(limit, force, out=np.ones_like(force), where=force > 0.0), 0.0, 1.0)


@lru_cache(maxsize=16)
def _sampling(harmonics: Harmonics, N_t: int, sampled: bool) -> Sampling:
    """Return the kernel's tables of docs/theory.md, eq. (6.1), rows padded with zeros to a multiple of four."""
    N_H = harmonics.n_coefficients
    stride = 4 * -(-N_H // 4)
    E, F, S = np.zeros((N_t, stride)), np.zeros((N_t, stride)), np.zeros((N_t + 1, stride))
    E[:, :N_H] = synthesis_matrix(harmonics, N_t)
    F[:, :N_H] = analysis_matrix(harmonics, N_t).T
    S[1:] = np.cumsum(F, axis=0)
    S[N_t] = 0.0  # exact value of the sum, without roundoff
    S[N_t, harmonics.mean] = 1.0
    return Sampling(E, np.ascontiguousarray(synthesis_matrix(harmonics, N_t).T), F, S, sampled)
