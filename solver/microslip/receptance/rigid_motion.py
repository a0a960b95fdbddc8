"""Rigid-body motion of a structure without supports, for loads and outputs (docs/theory.md, section 4).

Contact forces are internal and do not move the structure as a whole, R phi_r = 0.  Loads do: with modal masses of 1,

    q_n = (-(n omega)^2 + i n omega phi_r^T C phi_r)^-1 phi_r^T f_n,       u_n = phi_r q_n + elastic motion,        (4.9)

and q_0 = 0: constant loads in balance do not determine the mean position.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..fourier.amplitudes import to_complex, to_real
from ..fourier.harmonics import Harmonics
from ..messages.errors import CaseError
from .damping import StatedDamping

BALANCED = 1e-6  # of the forces' sum: a smaller resultant is rounding


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """Rigid-body modes phi_r, phi_r^T M phi_r = 1, under loads, eq. (4.9).  Replicated; all methods are local."""

    b: np.ndarray  # (n, n_loads) phi_r^T f
    o: np.ndarray  # (n_outputs, n) output rows times phi_r
    C: np.ndarray  # (n, n) phi_r^T C phi_r [1/s]

    def with_damping(self, sigma: float, factor: float = 1.0, stated: StatedDamping | None = None) -> RigidMotion:
        """Return the same modes with the stated damping, or C, times a factor, plus sigma M [1/s]."""
        unit = np.eye(len(self.C))
        of_factor = self.C if stated is None else stated.modal(np.zeros(len(self.C))) * unit
        return replace(self, C=self.C + (factor - 1.0) * of_factor + sigma * unit)

    def coordinates(self, f: np.ndarray, n_omega: np.ndarray) -> np.ndarray:
        """Return q, real coefficients (n, N_H), under loads f (n_loads, N_H), whose harmonics have the frequencies n omega."""
        forces, q = to_complex(self.b @ f), np.zeros((len(self.b), len(n_omega)), dtype=complex)
        for i in np.flatnonzero(n_omega):
            q[:, i] = np.linalg.solve(1j * n_omega[i] * self.C - n_omega[i] ** 2 * np.eye(len(q)), forces[:, i])
        return to_real(q, f.shape[1])

    def loss(self, f: np.ndarray, n: np.ndarray, omega: float) -> float:
        """Return the loss of this motion in dampers, with harmonics n of omega [J per cycle]."""
        q = to_complex(self.coordinates(f, n * omega))
        return float(np.pi * omega * np.sum(n**2 * (q.conj() * (self.C @ q)).real))

    def refuse_mean(self, f: np.ndarray, harmonics: Harmonics) -> None:
        """Raise CaseError for constant loads f (n_loads, N_H) that would accelerate the structure; the same on every rank."""
        mean = f[:, harmonics.mean]
        if (np.abs(self.b @ mean) > BALANCED * (np.abs(self.b) @ np.abs(mean))).any():
            raise CaseError(
                "[[loads]] with harmonic = 0: constant loads on a structure without supports are not in balance, and would move "
                "it away; add [[supports]], or loads whose forces and moments add up to zero"
            )
