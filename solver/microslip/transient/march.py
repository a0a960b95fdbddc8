"""Time marching of many points through a period, with the contact problem of each step (docs/theory.md, section 10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..messages.errors import ConvergenceError
from ..messages.words import counted
from .scheme import RHO, GeneralisedAlpha, Motion, fitted_angle
from .transient_model import TransientModel

_NEWTON = 60  # iterations of a step
_TOLERANCE = 1e-10  # of a step's contact forces, relative to the largest force of the joint's springs in the period
_NO_INERTIA = 1e-9  # 1 - share of the joint's springs in the flexibility of a step: below it only they resist the motion
_MOST_ROWS = 3000  # of pairs up to which these shares are computed
_BLOCK = 512  # rows of the flexibility copied at a time
_HALVINGS = 4  # of a Newton step that increases the error


@dataclass(frozen=True)
class Cycle:
    """Record of a period; samples at the ends of the steps."""

    eta: np.ndarray  # (n_steps, B, m)
    v: np.ndarray  # (n_steps, B, m)
    p: np.ndarray  # (n_steps, B, 3 n_pairs) N
    state: np.ndarray  # (B, n_pairs) uint8: maximum over the period, STICK < SLIP < OPEN


class March:
    """Marches B points of a model, each with its frequency and level, through periods of ``n_steps`` steps."""

    def __init__(self, model: TransientModel, omega: np.ndarray, level: np.ndarray, n_steps: int, rho: float = RHO):
        self.model, self.omega, self.level, self.n_steps = model, omega, level, n_steps
        self.scheme = GeneralisedAlpha(model.modes.omega_n, model.modes.damping, fitted_angle(n_steps, rho) / omega, rho)
        self.f = model.loads(n_steps)

    def take(self, points: np.ndarray | slice) -> March:
        """Return the march of some of the points.  Local."""
        return March(self.model, self.omega[points], self.level[points], self.n_steps, self.scheme.rho)

    def period(self, z: Motion, contact: np.ndarray, ramp: np.ndarray | None = None) -> tuple[Motion, np.ndarray, Cycle]:
        """Return motion and contact after a period, and its record.  Local.

        ``contact`` is p with the internal variables of the law, (B, n_pairs (3 + n_memory)); ``ramp`` (n_steps,) multiplies the
        loads at the ends of the steps.

        Raises
        ------
        ConvergenceError : Newton's method does not converge in the contact problem of a step
        """
        model, B = self.model, len(self.level)
        step = StepContact(model, self.scheme)
        shape, m = (self.n_steps, B), len(model.modes.omega_n)
        cycle = Cycle(
            np.empty((*shape, m)),
            np.empty((*shape, m)),
            np.empty((*shape, 3 * model.n_pairs)),
            np.zeros((B, model.n_pairs), dtype=np.uint8),
        )
        factor = np.ones(self.n_steps) if ramp is None else ramp
        before = 1.0 if ramp is None else 2.0 * ramp[0] - ramp[1]  # the factor at the start of the period
        q_load = before * self.level[:, None] * (model.modes.b @ self.f[-1])
        guess = p = model.forces(contact)
        for k in range(self.n_steps):
            f = factor[k] * self.f[k]
            q_before, q_load = q_load - p @ model.modes.R_phi, self.level[:, None] * (model.modes.b @ f)
            free = self.scheme.free(z, q_before, q_load)
            p_before = p
            du_free = free.eta @ model.modes.R_phi.T + self.level[:, None] * (model.s @ f)
            contact, state = step.solve(du_free, contact, guess)
            p = model.forces(contact)
            z = self.scheme.kicked(free, -(p @ model.modes.R_phi))
            guess = 2.0 * p - p_before
            cycle.eta[k], cycle.v[k], cycle.p[k] = z.eta, z.v, p
            np.maximum(cycle.state, state, out=cycle.state)
        return z, contact, cycle


class StepContact:
    """The contact problem at the end of a step, p = law(p_before, du_free - G_h p), eq. (10.4), of B points.

    G_h = G + R_phi (d eta / d q) R_phi^T is the flexibility within a step.  Newton's method with the exact derivative of the
    return map: p of sticking pairs is known, so that the linear system of a point has only the moving components.
    """

    def __init__(self, model: TransientModel, scheme: GeneralisedAlpha):
        self.model, self.flexibility = model, scheme.flexibility()
        self.springs, self.scale = model.law.springs.ravel(), np.zeros(len(scheme.h))

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return G_h p, (B, 3 n_pairs) [m].  Local."""
        rows = np.flatnonzero(p.any(axis=0))
        if len(rows) == 0:
            return np.zeros_like(p)
        few = p[:, rows]
        R_phi, G = self.model.modes.R_phi, self.model.G
        G_p = few[:, :_BLOCK] @ G[rows[:_BLOCK]]
        for start in range(_BLOCK, len(rows), _BLOCK):
            G_p += few[:, start : start + _BLOCK] @ G[rows[start : start + _BLOCK]]
        return G_p + self.flexibility.apply(few @ R_phi[rows]) @ R_phi.T

    def solve(self, du_free: np.ndarray, before: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return p with internal variables (B, n_pairs (3 + n_memory)) and states (B, n_pairs) at the end of the step.  Local."""
        self.scale = np.maximum(self.scale, np.abs(self.springs * du_free).max(axis=1, initial=0.0))
        p, after, new, L, state = self._law(du_free, before, guess)
        error = self._error(p, new)
        for _ in range(_NEWTON):
            wrong = np.flatnonzero(~(error <= _TOLERANCE * self.scale))
            if len(wrong) == 0:
                return after, state
            step = self._newton(p, new, L, wrong)
            for _ in range(_HALVINGS + 1):
                trial, after_trial, new_trial, L_trial, state_trial = self._law(du_free, before, p + step)
                error_trial = self._error(trial, new_trial)
                worse = ~(error_trial <= error) & (error > _TOLERANCE * self.scale)
                if not worse.any():
                    break
                step[worse] *= 0.5
            p, after, new, L, state, error = trial, after_trial, new_trial, L_trial, state_trial, error_trial
        raise ConvergenceError(
            f"contact forces of a time step not found within {_NEWTON} Newton iterations: error {error.max():.2e} N; "
            f"{self._advice(int(np.nanargmax(error)))}"
        )

    def _advice(self, b: int) -> str:
        """Return advice: more modes, if released pairs of the b-th point allow motions without resistance, eq. (10.5)."""
        root, n_modes = np.sqrt(self.model.law.stiffness.ravel()), self.model.modes.R_phi.shape[1]
        rows = np.flatnonzero(root)
        if len(rows) > _MOST_ROWS:
            return "take more [solver] modes, or more steps a period"
        R_phi = self.model.modes.R_phi[rows]
        G_h = self.model.G[np.ix_(rows, rows)] + self.flexibility.between(R_phi, b, R_phi)
        shares = np.linalg.eigvalsh(root[rows, None] * (G_h + G_h.T) / 2.0 * root[rows])
        n_free = int(np.count_nonzero(shares > 1.0 - _NO_INERTIA))
        if n_free == 0:
            return "take more steps a period"
        return (
            f"with all pairs released {n_free} {'motion has' if n_free == 1 else 'motions have'} neither inertia nor stiffness "
            f"in the reduced model, whose {counted(n_modes, 'mode')} leave them out: take more [solver] modes, "
            f"{n_modes + n_free} at least"
        )

    def _law(self, du_free: np.ndarray, before: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return p, the forces of the law under it with and without internal variables, their derivative, and the states."""
        n_pairs, width = self.model.n_pairs, 3 + self.model.law.n_memory  # values of a pair
        du = (du_free - self.apply(p)).reshape(len(p), n_pairs, 3)
        after, L, state = self.model.law.step(du, before.reshape(len(p), n_pairs, width))
        after = after.reshape(before.shape)
        return p, after, self.model.forces(after), L, state

    def _error(self, p: np.ndarray, new: np.ndarray) -> np.ndarray:
        return np.abs(new - p).max(axis=1, initial=0.0)

    def _newton(self, p: np.ndarray, new: np.ndarray, L: np.ndarray, wrong: np.ndarray) -> np.ndarray:
        """Return the Newton step dp, (1 + L G_h) dp = new - p, of the ``wrong`` points; zero for the others."""
        step, model, R_phi = np.zeros_like(p), self.model, self.model.modes.R_phi
        step[wrong] = (new - p)[wrong]
        moving = L.any(axis=-1)  # (B, n, 3): rows of L that are not zero
        known = np.where(moving.reshape(p.shape), 0.0, step)
        sticking = self.apply(known).reshape(len(p), -1, 3) if known.any() else None
        for b in wrong:
            pair, direction = np.nonzero(moving[b])
            if len(pair) == 0:
                continue
            rows = 3 * pair + direction
            right = step[b, rows]
            L_rows = L[b, pair, direction]  # (k, 3)
            if sticking is not None:
                right = right - (L_rows * sticking[b, pair]).sum(axis=1)
            J = np.empty((len(rows), len(rows)))
            for start in range(0, len(rows), _BLOCK):
                part = slice(start, start + _BLOCK)
                of_pair = 3 * pair[part, None] + np.arange(3)  # du of the pair of each row
                dynamic = self.flexibility.between(R_phi[of_pair.ravel()], b, R_phi[rows])
                G_h = model.G[of_pair[:, :, None], rows] + dynamic.reshape(len(of_pair), 3, -1)
                np.einsum("ki,kij->kj", L_rows[part], G_h, out=J[part])
            J.ravel()[:: len(rows) + 1] += 1.0  # the diagonal
            step[b, rows] = np.linalg.solve(J, right)
        return step
