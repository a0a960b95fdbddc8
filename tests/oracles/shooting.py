"""Steady states of small systems by time integration: the state after a period equals the state before.

Independent of the program: full matrices, no harmonics, a contact law in friction forces and angles (shooting.c, compiled when it
is first needed).  With K_L the stiffness of all pairs stuck, the motion is u = u_lin(t) + y, where u_lin is the exact response of
the stuck structure, and

    M y'' + C y' + K_L y = -R^T p,      p = f_nl - K_J R u,

is integrated exactly for a p that is linear within a step, shifted by the area of its corners within the step.  Stuck motion is
exact, therefore; slip is of second order in the step.  The state at the beginning of a period is x = (y, y', p_t): sliders are at
w = -p_t / k_t.  A periodic state is computed by Newton's method, so that neither slow decay nor drifting sliders need time, and
the motion may be unstable; sliders that do not move in the period stay where they are.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from .compiled import arguments, compiled
from .scenes import damping_matrix, force_coefficients, stuck_stiffness

PERTURBED = 1e-7  # differences for the derivative, relative to the size of each part of the state
COARSE = 256  # steps for the derivative …
NEAR_FOLD = 0.05  # … if its smallest singular value exceeds this: near a fold coarse steps change it
MOST_ROUNDS, HALVINGS = 30, 5  # largest numbers of Newton iterations and of halvings of a step
SLOW = 0.2  # ratio of successive residuals beyond which the derivative is computed again
PLAIN = 20  # periods of time integration where Newton's method does not converge
MOST_RULES = 20  # largest number of times that sliders are moved to the position of the rule
SETTLING = 2000  # largest number of periods of the law under a given motion
DISTURBED, DECAYED, GROWN = 1e-5, 1e-4, 1e3  # a small disturbance relative to the state; its factors that end a march
WATCHED = 400  # largest number of periods of a disturbed march
TOLERANCE = 1e-10  # relative to the state


@lru_cache(maxsize=1)
def _compiled():
    """Return the library of shooting.c."""
    library = compiled("shooting")
    library.sliders.restype = ctypes.c_double
    return library


@dataclass(frozen=True)
class Steady:
    """The steady state of a point by time integration."""

    amplitude: complex  # m, cos 1 - i sin 1 of the output
    mean: float  # m
    x: np.ndarray  # (2 n + 2 m,) state at the beginning of the period
    distance: float  # from the steady state, by Newton's step, relative to the size of the state
    drifts: float  # drift of a slider per period relative to its path
    fold: float  # smallest singular value of the derivative of (end - begin): 0 at a fold, where small errors have large effects
    moved: np.ndarray  # (m,) bool: sliders that move in the period


class Point:
    """A system under a load of a level and a frequency: the map of a period and its steady state."""

    def __init__(self, system: dict, level: float, omega: float):
        self.system, self.omega, self.n, self.m = system, omega, len(system["M"]), len(system["mu"])
        self.M, self.K, self.C = np.asarray(system["M"], dtype=float), stuck_stiffness(system), damping_matrix(system)
        self.R, self.out = np.ascontiguousarray(system["R"]), np.ascontiguousarray(system["output"])
        u_lin = self.respond(force_coefficients(system, level, 2))
        self.U, self.out_lin = np.ascontiguousarray(self.R @ u_lin), self.out @ u_lin
        names = ("mu", "N0", "k_t", "k_n")
        self.law = [np.ascontiguousarray(system[name]) for name in names] + [system["separate"].astype(np.uint8)]
        size = max(np.abs(self.U).sum(axis=1).max(), np.abs(self.out_lin).sum())
        one, k_t = np.ones(self.n), np.repeat(np.where(system["k_t"] > 0.0, system["k_t"], 1.0), 2)
        self.scale = size * np.concatenate([one, omega * one, k_t])
        self.steps: dict[int, list[np.ndarray]] = {}

    def respond(self, f):
        """Return the motion (n, 2 H + 1) of the stuck structure under forces (n, 2 H + 1)."""
        u, u[:, 0] = np.zeros_like(f), np.linalg.solve(self.K, f[:, 0])
        for n in range(1, f.shape[1] // 2 + 1):
            Z = self.K - (n * self.omega) ** 2 * self.M + 1j * n * self.omega * self.C
            x = np.linalg.solve(Z, f[:, 2 * n - 1] - 1j * f[:, 2 * n])
            u[:, 2 * n - 1], u[:, 2 * n] = x.real, -x.imag
        return u

    # -- a period ------------------------------------------------------------------------------------------------------

    def matrices(self, N: int) -> list[np.ndarray]:
        """Return Phi, first, last, whole of a step: z+ = Phi z + first p + last p+ + whole area; cached."""
        if N not in self.steps:
            n, rows, M_inv = self.n, 3 * self.m, np.linalg.inv(self.M)
            big = np.zeros((2 * n + 2 * rows, 2 * n + 2 * rows))  # (y, y', p, slope of p)
            big[:n, n : 2 * n] = np.eye(n)
            big[n : 2 * n, :n], big[n : 2 * n, n : 2 * n] = -M_inv @ self.K, -M_inv @ self.C
            big[n : 2 * n, 2 * n : 2 * n + rows] = -M_inv @ self.R.T
            big[2 * n : 2 * n + rows, 2 * n + rows :] = np.eye(rows)
            h = 2.0 * np.pi / self.omega / N
            E = expm(h * big)[: 2 * n]
            whole, slope = E[:, 2 * n : 2 * n + rows], E[:, 2 * n + rows :] / h
            self.steps[N] = [np.ascontiguousarray(A) for A in (E[:, : 2 * n], whole - slope, slope, whole)]
        return self.steps[N]

    def period(self, x, N: int):
        """Return states (c, n_x) after a period, the moved sliders (c, 2 m), output (c, N) and du (c, N, 3 m) over the period."""
        x = np.array(x, dtype=float, ndmin=2)
        theta = 2.0 * np.pi * np.arange(N) / N
        basis = np.stack([np.ones(N), np.cos(theta), np.sin(theta), np.cos(2.0 * theta), np.sin(2.0 * theta)], axis=1)
        moved, output = np.zeros((len(x), 2 * self.m), dtype=np.uint8), np.zeros((len(x), N))
        motion = np.zeros((len(x), N, 3 * self.m))
        arrays = [*self.matrices(N), self.R, self.U, self.out_lin, self.out, basis, *self.law, x, moved, output, motion]
        failed = _compiled().period(*arguments(self.n, self.m, N, len(x), *arrays))
        if failed:
            raise RuntimeError(f"{self.system['name']}: {failed} steps of {N} a period have no solution; take more")
        return x, moved.astype(bool), output, motion

    def miss(self, x, N: int):
        """Return (end - begin) / scales, (n_x,); 0 for sliders at rest."""
        end, moved, *_ = self.period(x, N)
        moves = np.concatenate([np.ones(2 * self.n, dtype=bool), moved[0]])
        return np.where(moves, (end[0] - x) / self.scale, 0.0)

    def derivative(self, x, N: int, perturbed: float = PERTURBED):
        """Return d (end - begin) / dx, both scaled, by differences; -1 for sliders at rest in all of them."""
        n_x = len(x)
        end, moved, *_ = self.period(x + np.vstack([np.zeros(n_x), perturbed * np.diag(self.scale)]), N)
        D = ((end[1:] - end[0]) / self.scale).T / perturbed - np.eye(n_x)
        rests = np.concatenate([np.zeros(2 * self.n, dtype=bool), ~moved.any(axis=0)])
        D[rests], D[:, rests] = 0.0, 0.0
        D[rests, rests] = -1.0
        return D

    def largest_multiplier(self, x, N: int, perturbed: float = PERTURBED) -> float:
        """Return the largest modulus of the eigenvalues of the derivative of the period map, by differences of that size."""
        return float(np.abs(np.linalg.eigvals(self.derivative(x, N, perturbed) + np.eye(len(x)))).max())

    def forgets(self, x, N: int, rng) -> bool:
        """Return whether two small random disturbances of a steady state decay, by the change per period.

        A moved slider at rest is no change: the motion comes to another member of the same continuum.
        A motion at ``GROWN`` times its disturbance has left for another steady state.  ``N`` is that of the state.
        """
        states = x + DISTURBED * self.scale * rng.standard_normal((2, len(x)))
        changes = np.zeros((WATCHED, 2))
        for k in range(WATCHED):
            end = self.period(states, N)[0]
            changes[k], states = np.abs((end - states) / self.scale).max(axis=1), end
            if (np.abs((end - x) / self.scale).max(axis=1) >= GROWN * DISTURBED).any():
                return False
            if (changes[k] <= DECAYED * changes[0]).all():
                return True
        quarter = WATCHED // 4
        return bool((changes[-quarter:].max(axis=0) < changes[-2 * quarter : -quarter].max(axis=0)).all())

    # -- the steady state ----------------------------------------------------------------------------------------------

    def steady(self, x, N: int) -> Steady:
        """Return the steady state near a state, with N steps per period."""
        F, D, is_own = self.miss(x, N), self.derivative(x, min(N, COARSE)), N <= COARSE
        if not is_own and np.linalg.svd(D)[1][-1] < NEAR_FOLD:
            D, is_own = self.derivative(x, N), True
        for _ in range(MOST_ROUNDS):
            dx = -np.linalg.lstsq(D, F, rcond=1e-13)[0]
            if max(np.abs(F).max(), np.abs(dx).max()) <= TOLERANCE:
                break
            x_new, F_new = self.towards(x, dx, np.abs(F).max(), N)
            if x_new is not None:
                is_slow = np.abs(F_new).max() > SLOW * np.abs(F).max()
                x, F = x_new, F_new
                if is_slow:
                    D, is_own = self.derivative(x, N), True
            elif not is_own:
                D, is_own = self.derivative(x, N), True
            else:
                for _ in range(PLAIN):
                    x = self.period(x, N)[0][0]
                F, D = self.miss(x, N), self.derivative(x, N)
        return self.summary(x, F, D, N)

    def by_rule(self, x, N: int) -> tuple[Steady, float]:
        """Return the steady state with resting sliders at the position by eq. (3.5) of docs/theory.md, and their distance before.

        During integration to a steady state a slider may be pushed and then rest at a position that depends on the path.
        """
        steady, first = self.steady(x, N), None
        for _ in range(MOST_RULES):
            _, moved, _, motion = self.period(steady.x, N)
            x, p_t = steady.x.copy(), steady.x[2 * self.n :]
            rest = (~moved[0] & (p_t != 0.0)).reshape(-1, 2).any(axis=1)  # sliders that never moved satisfy the rule
            at = 2 * self.n + np.flatnonzero(~moved[0] & np.repeat(rest, 2))
            x[at] = self.sliders(motion[0], rest)[~moved[0].reshape(-1, 2)[rest].ravel()]
            away = float(np.abs((x - steady.x) / self.scale).max())
            first = away if first is None else first
            if away <= 1e3 * TOLERANCE:
                break
            steady = self.steady(x, N)
        return steady, first

    def towards(self, x, dx, size, N: int):
        """Return a state along a step with a smaller residual, and this residual; None if there is none."""
        for k in range(HALVINGS):
            x_new = x + 0.5**k * dx * self.scale
            F = self.miss(x_new, N)
            if np.abs(F).max() <= max((1.0 - 0.3 * 0.5**k) * size, 0.1 * TOLERANCE):
                return x_new, F
        return None, None

    def summary(self, x, F, D, N: int) -> Steady:
        _, moved, output, _ = self.period(x, N)
        theta, sliders = 2.0 * np.pi * np.arange(N) / N, 2 * self.n + np.flatnonzero(moved[0])
        rates = np.linalg.eigvals(D[np.ix_(sliders, sliders)] + np.eye(len(sliders)))
        return Steady(
            amplitude=complex(2.0 / N * output[0] @ np.exp(-1j * theta)),
            mean=float(output.mean()),
            x=x,
            distance=float(np.abs(np.linalg.lstsq(D, F, rcond=1e-13)[0]).max()),
            drifts=float(np.abs(rates).max(initial=0.0)),
            fold=float(np.linalg.svd(D)[1][-1]),
            moved=moved[0].reshape(-1, 2).any(axis=1),
        )

    # -- initial states ------------------------------------------------------------------------------------------------

    def state_of(self, p, N: int = 256):
        """Return the state at t = 0 of the motion under contact forces p (m, 3, N_H).

        Sliders have the position of the law for that motion from w = 0 at t = 0, in its steady cycle: docs/theory.md, eq. (3.5).
        """
        H = p.shape[-1] // 2
        y = self.respond(-self.R.T @ p.reshape(-1, 2 * H + 1))
        theta = 2.0 * np.pi / N * np.outer(np.arange(1, max(H, 2) + 1), np.arange(N))
        basis = np.empty((2 * max(H, 2) + 1, N))
        basis[0], basis[1::2], basis[2::2] = 1.0, np.cos(theta), np.sin(theta)
        du = np.ascontiguousarray((self.R @ y @ basis[: 2 * H + 1] + self.U @ basis[:5]).T)
        n = np.arange(1, H + 1)
        return np.concatenate([y[:, 0] + y[:, 1::2].sum(axis=1), self.omega * y[:, 2::2] @ n, self.sliders(du)])

    def sliders(self, du, pairs=slice(None)):
        """Return p_t (2 m,) of all or some pairs at the start of a period of motion du (N, 3 m), from w = 0, in the steady cycle."""
        law = [values[pairs] for values in self.law]
        du = np.ascontiguousarray(du.reshape(len(du), self.m, 3)[:, pairs])
        p_t = np.zeros(2 * du.shape[1])
        _compiled().sliders(*arguments(du.shape[1], len(du), SETTLING, *law, du, p_t))
        return p_t
