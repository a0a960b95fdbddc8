"""Generalised-alpha time integration of the modal equations, for many points at once (docs/theory.md, section 10).

J. Chung, G. M. Hulbert: A time integration algorithm for structural dynamics with improved numerical dissipation: the
generalized-alpha method, Journal of Applied Mechanics 60 (1993) 371.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from ..receptance.damping import Damping, StepFlexibility

RHO = 0.9  # spectral radius at infinite frequency: unresolved modes decay by 10 % per step


@dataclass(frozen=True)
class Motion:
    """Modal coordinates of B points and their derivatives, (B, m) each: m, m/s, m/s2 times the square root of kg."""

    eta: np.ndarray
    v: np.ndarray
    a: np.ndarray

    def take(self, points: np.ndarray | slice | list[int]) -> Motion:
        """Return the motion at some points."""
        return Motion(self.eta[points], self.v[points], self.a[points])


class GeneralisedAlpha:
    """eta'' + C eta' + Omega^2 eta = q(t) in steps ``h`` (B,) [s]; the contact force at the end of a step is added separately.

    docs/theory.md, eq. (10.2).

    Parameters
    ----------
    omega_n, damping : (m,) and phi^T C phi, the same for every point
    h : (B,) s
    rho : spectral radius at infinite frequency, 0 to 1; no numerical damping at 1
    """

    def __init__(self, omega_n: np.ndarray, damping: Damping, h: np.ndarray, rho: float = RHO):
        self.alpha_m, self.alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        self.gamma = 0.5 - self.alpha_m + self.alpha_f
        self.beta = 0.25 * (1.0 - self.alpha_m + self.alpha_f) ** 2
        self.omega_n, self.squares, self.damping, self.rho = omega_n, omega_n**2, damping, rho
        self.h = h[:, None]
        keep, now = 1.0 - self.alpha_m, 1.0 - self.alpha_f
        self.A = damping.step_matrix(omega_n, keep, now, self.gamma * h, self.beta * h**2)

    def take(self, points: np.ndarray | slice) -> GeneralisedAlpha:
        """Return the scheme of some of the points.  Local."""
        return GeneralisedAlpha(self.omega_n, self.damping, self.h[points, 0], self.rho)

    def free(self, z: Motion, q_before: np.ndarray, q: np.ndarray) -> Motion:
        """Return the motion after a step under modal forces ``q_before`` at its start, ``q`` at its end, (B, m).  Local."""
        h, now = self.h, 1.0 - self.alpha_f
        eta = z.eta + h * z.v + h**2 * (0.5 - self.beta) * z.a
        v = z.v + h * (1.0 - self.gamma) * z.a
        history = self.damping.apply_to_rows(now * v + self.alpha_f * z.v) + self.squares * (now * eta + self.alpha_f * z.eta)
        a = self.A.solve(now * q + self.alpha_f * q_before - self.alpha_m * z.a - history)
        return Motion(eta + self.beta * h**2 * a, v + self.gamma * h * a, a)

    def kicked(self, z: Motion, q: np.ndarray) -> Motion:
        """Return the motion with an additional modal force ``q`` (B, m) at the end of the step.  Local."""
        a = (1.0 - self.alpha_f) * self.A.solve(q)
        return Motion(z.eta + self.beta * self.h**2 * a, z.v + self.gamma * self.h * a, z.a + a)

    def flexibility(self) -> StepFlexibility:
        """Return d eta / d q at the end of a step.  Local."""
        return self.A.flexibility((1.0 - self.alpha_f) * self.beta * self.h[:, 0] ** 2)

    # -- a period of free motion, in the scaled coordinates Omega eta, eta', eta'' / Omega -----------------------------

    def pack(self, z: Motion) -> np.ndarray:
        """Return the scaled coordinates, (B, m, 3) m/s.  Local."""
        return np.stack([self.omega_n * z.eta, z.v, z.a / self.omega_n], axis=-1)

    def unpack(self, x: np.ndarray) -> Motion:
        """Return the motion from scaled coordinates, the inverse of :meth:`pack`.  Local."""
        return Motion(x[..., 0] / self.omega_n, x[..., 1].copy(), x[..., 2] * self.omega_n)

    def solve_period(self, x: np.ndarray, n_steps: int) -> np.ndarray:
        """Return y with y - Phi^n_steps y = x for scaled coordinates (B, m, 3), Phi being a step without force.  Local."""
        n = 3 * self.damping.n_coupled  # with modal damping one 3 x 3 block per mode, else one block of all modes
        blocks = (len(x), 3 * len(self.omega_n) // n, n)
        units = [np.broadcast_to(unit, blocks).reshape(x.shape) for unit in np.eye(n)]
        Phi = np.stack([self._scaled_step(unit).reshape(blocks) for unit in units], axis=-1)
        period = np.eye(n) - np.linalg.matrix_power(Phi, n_steps)
        return np.linalg.solve(period, x.reshape(*blocks, 1)).reshape(x.shape)

    def _scaled_step(self, x: np.ndarray) -> np.ndarray:
        z = self.unpack(x)
        zero = np.zeros_like(z.eta)
        return self.pack(self.free(z, zero, zero))


def fitted_angle(n_steps: int, rho: float = RHO) -> float:
    """Return omega h such that an undamped oscillator of frequency omega takes exactly ``n_steps`` steps per period.  Local.

    docs/theory.md, eq. (10.3).  Generalised-alpha, like the trapezoidal rule, has a relative period elongation of
    (omega h)^2 / 12 at rho = 1.  At a resonance with damping ratio zeta its effect is multiplied by 1 / zeta.  A step of omega h
    instead of 2 pi / n_steps removes it.
    """
    exact = 2.0 * np.pi / n_steps
    return float(brentq(lambda angle: step_angle(angle, rho) - exact, 0.5 * exact, 1.5 * exact, xtol=1e-15, rtol=1e-14))


def step_angle(angle: float, rho: float = RHO) -> float:
    """Return the phase advance of an undamped oscillator in a step of omega h = ``angle`` [rad].  Local."""
    factors = step_factors(angle, rho)
    return float(np.angle(factors[np.argmax(factors.imag)]))  # the third, spurious one is real


def step_factors(angle: float, rho: float = RHO) -> np.ndarray:
    """Return the eigenvalues of a step of an undamped oscillator with omega h = ``angle``, (3,).  Local."""
    scheme = GeneralisedAlpha(np.ones(1), Damping(np.zeros(1)), np.array([angle]), rho)
    columns = [scheme._scaled_step(np.eye(3)[i].reshape(1, 1, 3)).ravel() for i in range(3)]
    return np.linalg.eigvals(np.stack(columns, axis=-1))
