"""Rough surfaces: normal stiffness grows with the pressure, and slip begins at the asperities with the smallest load.

docs/theory.md, section 3, "Rough surfaces".  The normal force is a power of the approach, or its limit, the exponential of
Greenwood and Williamson (1966).  By the theorem of Ciavarella (1998) and Jaeger, the tangential force is the sum over asperities
with elastic-Coulomb friction and the tangential stiffness of Mindlin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..fourier.coefficients import analysis_matrix, synthesis_matrix
from ..fourier.harmonics import Harmonics
from .bundle import Bundle, BundleLaw, initial_positions
from .elastic_coulomb import ElasticCoulomb
from .law import OPEN, SLIP, STICK, ContactCycle
from .preloaded import Preloaded

SLIDERS = 24  # default number of asperities in contact at rest
MOST_FORCE = 1e9  # N / N0 up to which further asperities come into contact
DENSE_FORCE = 16.0  # N / N0 up to which the asperities are as densely spaced as near rest
CARRIES = 1e-9  # normal force relative to that at the stated preload: below it after the statics, a pair is open at rest
_MOST = 200.0  # bound of log(N / N0): iterates beyond it are meaningless, and squares of N would overflow
EXPORTED = """\
on a circle, or in each direction separately where separate is 1;
f_nl,z = N0 - N, N = N0 max(0, 1 - k_n du_z / (m N0))^m, m being law_exponent; inf: N = N0 exp(-k_n du_z / N0);
open at rest (N0 <= 0): f_nl,z = -N, N = P max(0, (N0 - k_n du_z) / (m P))^m with P = law_reference"""
MINDLIN = 2.0 * (1.0 - 0.3) / (2.0 - 0.3)  # tangential divided by normal stiffness at Poisson's ratio 0.3


@dataclass(frozen=True)
class Rough(Preloaded, BundleLaw):
    """The law of ``n`` pairs of rough surfaces, arrays (n,), about their rest; ValueError if it is not defined there.

    k_t and k_n, above 0, are the stiffnesses at rest; of a pair with a power law that is open at rest, N0 <= 0, those at the
    normal force ``reference``.
    """

    exponent: np.ndarray  # of the approach, above 1 [-]; infinite: the exponential
    separate: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=bool))  # (n,) bool: each direction has its own limit
    n_sliders: int = SLIDERS
    sampled: bool = False  # the asperities are evaluated at the samples only
    w0: np.ndarray | None = None  # (n, n_asperities, 2) initial slider positions [m]; None: 0
    reference: np.ndarray = field(default_factory=lambda: np.full(1, np.nan))  # (n,) N, of pairs that are open at rest
    bundle: Bundle = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("mu", "N0", "k_t", "k_n", "exponent"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))
        object.__setattr__(self, "separate", np.array(np.broadcast_to(self.separate, self.N0.shape), dtype=bool))
        object.__setattr__(self, "reference", np.array(np.broadcast_to(self.reference, self.N0.shape), dtype=np.float64))
        object.__setattr__(self, "open_at_rest", np.array(np.broadcast_to(self.open_at_rest, self.N0.shape), dtype=bool))
        if np.any(self.open_at_rest & ~self.is_open):
            raise ValueError(f"pair {np.argmax(self.open_at_rest & ~self.is_open)} is open at rest, and has a preload")
        carried = np.where(self.is_open & ~(np.isfinite(self.exponent) & (self.reference > 0.0)), self.N0, self.pressed)
        for name, least, values in (("N0", 0.0, carried), ("k_n", 0.0, self.k_n), ("exponent", 1.0, self.exponent)):
            if np.any(values <= least):
                raise ValueError(f"{name} of pair {np.nanargmin(values)} is {np.nanmin(values):g}; above {least:g} is needed")
        object.__setattr__(self, "bundle", self._asperities())

    @property
    def n_pairs(self) -> int:
        """The number of pairs."""
        return len(self.N0)

    @cached_property
    def is_open(self) -> np.ndarray:
        """Which pairs carry no force at rest, (n,) bool."""
        return self.N0 <= 0.0

    @cached_property
    def pressed(self) -> np.ndarray:
        """The normal force to which k_t and k_n belong, (n,) [N]: N0, or the reference of an open pair."""
        return np.where(self.is_open, self.reference, self.N0)

    @cached_property
    def lift(self) -> np.ndarray:
        """Distance of rest from the state with force ``pressed``, (n,) [m]: approach at the reference plus gap; 0 if closed."""
        with np.errstate(invalid="ignore"):
            return np.where(self.is_open, (self.exponent * self.pressed - self.N0) / self.k_n, 0.0)

    @cached_property
    def springs(self) -> np.ndarray:
        """The springs of a pair in contact, (n, 3) [N/m]: the stiffness at rest, or at the reference."""
        return np.stack([self.k_t, self.k_t, self.k_n], axis=1)

    def take(self, indices: np.ndarray | slice) -> Rough:
        """Return the law of some pairs: an index array, a mask or a slice.  Local."""
        names = ("mu", "N0", "k_t", "k_n", "exponent", "separate", "w0", "reference", "open_at_rest")
        return replace(self, **{name: getattr(self, name)[indices] for name in names if getattr(self, name) is not None})

    def followed(self, path: bool) -> Rough:
        """Return the law whose asperities follow the path between samples, or are evaluated at the samples only.  Local."""
        return replace(self, sampled=not path)

    @cached_property
    def refined(self) -> Rough:
        """The law with twice as many asperities; each has at rest the stretch of a present asperity with the same gap."""
        finer = replace(self, n_sliders=2 * self.n_sliders, w0=None)
        if self.w0 is None or not self.w0.any():
            return finer
        return finer._stretched(_carried_over(self.bundle, finer.bundle, -self.w0, np.zeros(self.n_pairs)))

    # -- normal force ------------------------------------------------------------------------------------------

    def normal_force(self, du_z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the normal force [N] and the normal stiffness [N/m] at relative displacements (..., n).

        Local.  docs/theory.md, eq. (3.11).  With a power law the surfaces separate at zero approach, with the exponential never.
        """
        x, m = -self.k_n * (du_z + self.lift) / self.pressed, self.exponent
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            log = np.where(np.isinf(m), x, m * np.log1p(np.maximum(x / m, -1.0)))
            log = np.minimum(log, _MOST)
            N = self.pressed * np.exp(log)
            stiffness = self.k_n * np.exp(np.where(np.isinf(m), log, log * (1.0 - 1.0 / m)))
        return N, stiffness

    def _asperities(self) -> Bundle:
        """Return the elements of eq. (3.12), between tangents of the normal force."""
        n, nu = self.n_sliders, tangents_at(self.n_sliders)
        m = self.exponent[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(np.isinf(m), nu, nu ** (1.0 - 1.0 / m))  # divided by k_n
            x = np.where(np.isinf(m), np.log(nu), m * (nu ** (1.0 / m) - 1.0))  # approach divided by N0 / k_n
            at_0 = nu - np.where(nu > 0.0, slope * x, 0.0)  # the force of a tangent at rest, divided by N0
        stiffness, force = np.diff(slope, axis=1), np.diff(at_0, axis=1)
        force[:, :n] = np.maximum(force[:, :n], 0.0)  # roundoff may make the last one negative
        size = stiffness.shape[1]
        each = {name: np.repeat(getattr(self, name), size) for name in ("mu", "pressed", "k_t", "k_n", "lift")}
        elements = ElasticCoulomb(
            each["mu"],
            each["pressed"] * force.ravel() - each["k_n"] * stiffness.ravel() * each["lift"],
            each["k_t"] * stiffness.ravel(),
            each["k_n"] * stiffness.ravel(),
            np.repeat(self.separate, size),
            np.zeros(2) if self.w0 is None else self.w0.reshape(-1, 2),
            sampled=self.sampled,
        )
        return Bundle(elements, size)

    # -- forces ------------------------------------------------------------------------------------------------

    def cycle(self, U: np.ndarray, n_samples: int, tangents: bool = True, harmonics: Harmonics | None = None) -> ContactCycle:
        """Return the harmonics of p under the periodic motion ``U`` (n, 3, N_H) [m], with their exact derivative.

        Local.  docs/theory.md, eq. (3.10) and eq. (3.11).  A pair that moves along z is active, since this law is nonlinear
        everywhere; a pair that is open at rest is active if it touches.
        """
        n, _, N_H = U.shape
        if self.n_pairs != n:
            raise ValueError(f"harmonics of {n} pairs with the law of {self.n_pairs}")
        if np.any(self.is_open & ~self.open_at_rest):
            raise ValueError("a cycle needs pairs without pressure at rest to be open at rest, without springs")
        tangential = self.bundle.cycle(U, n_samples, tangents, harmonics)
        harmonics = harmonics or Harmonics.full(N_H)
        E, F = synthesis_matrix(harmonics, n_samples), analysis_matrix(harmonics, n_samples)
        du_z = U[:, 2] @ E.T
        N, k = (values.T for values in self.normal_force(du_z.T))
        p, state, K_J = tangential.p, tangential.state, self.stiffness
        presses = np.where(self.open_at_rest, (N > 0.0).any(axis=1), U[:, 2].any(axis=1))
        p[presses, 2] = ((np.maximum(self.N0, 0.0)[:, None] - N - K_J[:, 2:] * du_z) @ F.T)[presses]
        state[(N <= 0.0).any(axis=1)] = OPEN
        active = np.union1d(tangential.active, np.flatnonzero(presses))
        P = None
        if tangential.P is not None:
            P = np.zeros((len(active), 3 * N_H, 3 * N_H))
            P[np.searchsorted(active, tangential.active)] = tangential.P
            change = np.where(presses[:, None], k - K_J[:, 2:], 0.0)[active]
            P[:, 2 * N_H :, 2 * N_H :] = np.matmul(F * change[:, None, :], E)
        return ContactCycle(p, state, active, P, tangential.drifts)

    def step(self, du: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p and internal variables after a step to ``du`` (..., n, 3), d p / d du (..., n, 3, 3), and the states.

        Local.  docs/theory.md, eq. (3.10) and eq. (3.11).  Both ``before`` and the result are (..., n, 3 + n_memory).
        """
        force, derivative, slips, memory = self.bundle.step(du, before[..., 3:])
        N, k = self.normal_force(du[..., 2])
        K_J = self.stiffness
        p_z = np.maximum(self.N0, 0.0) - N - K_J[:, 2] * du[..., 2]
        L = np.zeros((*du.shape, 3))
        L[..., :2, :], L[..., 2, 2] = derivative, k - K_J[:, 2]
        springs = np.where(self.is_open[:, None], K_J[:, :2], 0.0)  # p of asperities with gaps is their whole force
        force = force - springs * du[..., :2]
        L[..., (0, 1), (0, 1)] -= springs
        state = np.where(N <= 0.0, OPEN, np.where(slips, SLIP, STICK)).astype(np.uint8)
        return np.concatenate([force, p_z[..., None], memory], axis=-1), L, state

    def memoryless_rate(self, du: np.ndarray) -> np.ndarray:
        """Return d p / d du of the history-independent part of p, (..., n, 3) [N/m]: normal force, springs of open asperities.

        Local.  ``du`` is (..., n, 3).
        """
        rate, K_J = np.empty(du.shape), self.stiffness
        rate[..., :2] = (self.bundle.springs_of_gaps - np.where(self.is_open, K_J[:, 0], 0.0))[:, None]
        rate[..., 2] = self.normal_force(du[..., 2])[1] - K_J[:, 2]
        return rate

    # -- its parameters ----------------------------------------------------------------------------------------

    described = "a rough surface"

    def rate_at_preload(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics | None = None) -> np.ndarray:
        """Return d p / d parameter, by k_n at a constant N0.

        Local.  The sum over the asperities (3.12), with constant fractions of k_t and k_n, and the normal force (3.11).
        """
        self._check(name)
        elements, size = self.bundle.elements, self.bundle.size
        per_pair = elements.k_n / np.repeat(self.k_n, size)
        if name == "N0":
            per_pair = np.where(np.repeat(self.is_open, size), per_pair, elements.N0 / np.repeat(self.pressed, size))
        per_pair = np.ones_like(per_pair) if name == "mu" else per_pair
        rate = self.bundle.parameter_rate(name, per_pair, U, n_samples, harmonics)
        if name in ("N0", "k_n"):
            harmonics = harmonics or Harmonics.full(U.shape[2])
            du_z = U[:, 2] @ synthesis_matrix(harmonics, n_samples).T
            rate[:, 2] = self._normal_rate(name, du_z) @ analysis_matrix(harmonics, n_samples).T
        return rate

    def _normal_rate(self, name: str, du_z: np.ndarray) -> np.ndarray:
        """Return the derivative of p_z by N0 or k_n at relative displacements (n, n_samples)."""
        N, k = (values.T for values in self.normal_force(du_z.T))
        is_open, k_n = self.is_open[:, None], self.k_n[:, None]
        if name == "N0":
            return np.where(is_open, -k / k_n, 1.0 - (N + k * du_z) / self.pressed[:, None])
        return du_z * (k / k_n - np.where(is_open, 0.0, 1.0))

    # -- its limits --------------------------------------------------------------------------------------------

    def slip_safety(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the factor by which motions may grow while p is 0, (..., n): 0 where a closed pair moves along z.  Local."""
        safety = self.bundle.slip_safety(amplitudes, self.n_sliders - 1)
        z = amplitudes[..., 2]
        to_touch = np.divide(-self.N0, self.k_n * z, out=np.full(z.shape, np.inf), where=z > 0.0)
        return np.where(self.open_at_rest, to_touch, np.where(z > 0.0, 0.0, safety))

    def utilisation(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the utilisation of friction limit, preload or gap at the stiffness at rest, (..., n).  Local."""
        x, y, z = np.moveaxis(amplitudes, -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.maximum(self.mu * self.N0 - self.bundle.held_at_rest, 0.0)
            shear = np.where(self.open_at_rest, 0.0, self.k_t * np.hypot(x, y) / left)
            shares = np.stack([shear, self.k_n * z / np.abs(self.N0)])
        return np.nan_to_num(shares, nan=0.0, posinf=np.inf).max(axis=0)

    def slipping_share(self, amplitudes: np.ndarray, of_limit: float = 1.0) -> np.ndarray:
        """Return an upper bound of |p| / stuck force at the stiffness at rest, (..., n, 3).  Local.

        A stiffening contact is compared at equal force, since at equal motion its force would be unrealistically large.
        """
        z, m = amplitudes[..., 2], self.exponent
        x = self.k_n * z / self.pressed  # force at the stiffness at rest, divided by the preload
        parted, _ = self.normal_force(z)
        with np.errstate(divide="ignore", invalid="ignore"):
            approach = np.where(np.isinf(m), np.log1p(x), m * np.expm1(np.log1p(x) / m))
            stiffer = (1.0 + x) ** (1.0 - 1.0 / m)
            normal = np.nan_to_num(np.maximum(1.0 - approach / x, 1.0 - (1.0 - parted / self.pressed) / x), nan=0.0)
            tangential = np.maximum(self.bundle.slipping_share(amplitudes, of_limit), 1.0 - 1.0 / stiffer)
        share = np.stack([tangential, tangential, normal], axis=-1)
        return np.where(self.open_at_rest[:, None], 1.0, share)

    def keeps_half_wave_symmetry(self, moves: np.ndarray) -> np.ndarray:
        """Return which pairs keep half-wave symmetry if the components ``moves`` (n, 3) move, (n,); see :class:`Law`.  Local."""
        return ~moves[:, 2] & (self.bundle.held_at_rest == 0.0)

    # -- another rest ------------------------------------------------------------------------------------------

    def about(self, du: np.ndarray, memory: np.ndarray) -> Rough:
        """Return the law about the final state of a march: ``du`` (n, 3) and the internal variables (n, n_memory).  Local.

        docs/theory.md, eq. (12.10): pressure and stiffness are those of (3.11) at this state; the exponent does not change.  The
        asperities are recomputed; each has the stretch of a previous asperity with the same gap, within its friction limit.
        Pairs with a power law and almost no force become open at rest, with a gap.

        Raises
        ------
        ValueError : a pair with the exponential law carries almost no force, so the law has no state of rest there
        """
        N, k_n = self.normal_force(du[:, 2])
        parts = ~(N > CARRIES * self.pressed)
        if np.any(parts & np.isinf(self.exponent)):
            raise ValueError(f"{np.count_nonzero(parts)} of {self.n_pairs} pairs carry no force")
        gap = np.maximum(du[:, 2] + self.lift - np.where(parts, self.exponent, 0.0) * self.pressed / self.k_n, 0.0)
        law = replace(
            self,
            N0=np.where(parts, -self.k_n * gap, N),
            k_t=np.where(parts, self.k_t, self.k_t * k_n / self.k_n),
            k_n=np.where(parts, self.k_n, k_n),
            w0=None,
            reference=np.where(parts, self.pressed, np.nan),
            open_at_rest=parts,
        )
        return law._stretched(_carried_over(self.bundle, law.bundle, self.bundle.stretch(du, memory), du[:, 2]))

    def _stretched(self, stretch: np.ndarray) -> Rough:
        """Return the law with the stretch (n, size, 2) [m] of the asperities at rest, each within its friction limit.  Local."""
        elements, separate = self.bundle.elements, self.separate[:, None, None]
        force, limit = (values.reshape(self.n_pairs, -1, 1) for values in (elements.k_t, elements.mu * elements.N0))
        force = force * stretch
        size = np.where(separate, np.abs(force), np.linalg.norm(force, axis=2, keepdims=True))
        limit = np.maximum(limit, 0.0)
        return replace(self, w0=-stretch * np.divide(limit, size, out=np.ones_like(size), where=size > limit))


def _carried_over(old: Bundle, new: Bundle, stretch: np.ndarray, du_z: np.ndarray) -> np.ndarray:
    """Return the stretch of new asperities, (n, size, 2), interpolated from the old ones at the same gap.

    Gaps of the new asperities are relative to a rest at ``du_z`` (n,).
    """
    touch = [asperities.of_elements(asperities.elements.N0 / asperities.elements.k_n) for asperities in (old, new)]
    carried = np.empty((len(du_z), new.size, 2))
    for i, (of_old, of_new) in enumerate(zip(touch[0], touch[1] + du_z[:, None])):
        order = np.argsort(of_old)
        for direction in range(2):
            carried[i, :, direction] = np.interp(of_new, of_old[order], stretch[i, order, direction])
    return carried


def tangents_at(n: int) -> np.ndarray:
    """Return N / N0 at the tangents of eq. (3.12): n + 1 values from 0 to 1, and 4 n above.  Local.

    They are dense near rest, since the asperities with the smallest load slip first; the n-th is at rest.  The last 2 n are
    spaced logarithmically with growing ratio, so that errors stay small relative to any force; an asperity without contact
    costs no time.
    """
    below, above = np.arange(n + 1) / n, np.arange(1, 2 * n + 1) / (2 * n)
    near = np.concatenate([below * (2.0 - below), 1.0 + (np.sqrt(DENSE_FORCE) - 1.0) * above**2]) ** 2
    first = 4.0 * (1.0 - 1.0 / np.sqrt(DENSE_FORCE))  # d log / d above at the start, continuous with the dense part
    return np.concatenate([near, DENSE_FORCE * np.exp(first * above + (np.log(MOST_FORCE / DENSE_FORCE) - first) * above**2)])


# -- of the columns of pairs ---------------------------------------------------------------------------------------


def of_columns(columns: Mapping[str, np.ndarray]) -> Rough:
    """Return the law of pairs with these columns, (n,) each.  Local."""
    mu, N0, k_t, k_n, m, separate = (columns[name] for name in ("mu", "N0", "k_t", "k_n", "exponent", "separate"))
    n_sliders = int(columns["sliders"][0])
    none = np.zeros_like(mu)
    reference, open_at_rest = columns.get("reference", none + np.nan), columns.get("open_at_rest", none.astype(bool))
    w0 = initial_positions(columns, 5 * n_sliders)
    return Rough(mu, N0, k_t, k_n, m, separate, n_sliders=n_sliders, w0=w0, reference=reference, open_at_rest=open_at_rest)


def about_rest(columns: Mapping[str, np.ndarray], du: np.ndarray, memory: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns that change about the final state of a march.  Local.

    Raises
    ------
    ValueError : as in :meth:`Rough.about`
    """
    law = of_columns(columns).about(du, memory)
    changed = ("N0", "k_t", "k_n", "w0", "open_at_rest", *["reference"] * ("reference" in columns))
    return {name: getattr(law, name) for name in changed}


def initial_guess(columns: Mapping[str, np.ndarray], before: np.ndarray, du: np.ndarray) -> np.ndarray:
    """Return ``du`` (n, 3) in which pairs that come into contact after ``before`` carry the same force as their springs would.

    Local.  An initial guess for Newton's method, which converges poorly near first contact of a power law, both with the tangent
    and with the reference stiffness.
    """
    law, moved = of_columns(columns), du.copy()
    overlap_before, overlap = (-motion[:, 2] + np.where(law.is_open, law.N0 / law.k_n, 0.0) for motion in (before, du))
    touches = law.is_open & (overlap_before <= 0.0) & (overlap > 0.0)
    share = law.k_n[touches] * overlap[touches] / law.pressed[touches]
    m = law.exponent[touches]
    moved[touches, 2] += overlap[touches] - m * law.pressed[touches] / law.k_n[touches] * share ** (1.0 / m)
    moved[touches, :2] *= share[:, None] ** (1.0 / m - 1.0)[:, None]
    return moved


def on_area(keys: Mapping[str, Any], area: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of pairs from a joint's keys per area and their areas, (n,).  Local.

    docs/theory.md, eq. (3.11): at the pressure p at rest the normal stiffness per area is p / h for the exponential, and
    m p / d for a power law, with the approach d at pressure p.  Without pressure at rest, p is ``roughness_pressure``.
    """
    preload, height, m, known = (keys[name] for name in ("preload", "roughness_height", "exponent", "roughness_pressure"))
    pressure = preload if m is None else np.where(preload > 0.0, preload, known)
    approach = height if m is None else height / m * (pressure / known) ** (1.0 / m)
    k_n = pressure / approach * area
    ratio = MINDLIN if keys["tangential_ratio"] is None else keys["tangential_ratio"]
    columns = {"mu": keys["friction"], "N0": preload * area, "k_t": ratio * k_n, "k_n": k_n}
    if m is not None:
        columns["reference"] = known * area
    return {name: np.array(np.broadcast_to(values, area.shape), dtype=float) for name, values in columns.items()}


def law_columns(keys: Mapping[str, Any]) -> dict[str, float]:
    """Return the columns beyond those of elastic-Coulomb friction, the same for all pairs of a joint.  Local."""
    return {"exponent": keys["exponent"] or np.inf, "sliders": keys["sliders"] or SLIDERS}
