"""Outputs other than displacements: velocities, accelerations, absolute motion, contact forces (docs/theory.md, section 13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fourier.amplitudes import to_complex, to_real
from ..fourier.harmonics import Harmonics


@dataclass(frozen=True, eq=False)
class Observed:
    """The map to outputs y from their rows o u, the contact forces p and the acceleration a of the base.

        y_n = (i n omega)^k (o u)_n + (i n omega)^(k - 2) a_n + c p_n.

    docs/theory.md, eq. (13.5).  Replicated.
    """

    order: np.ndarray  # (n_outputs,) k: order of the time derivative
    of_p: np.ndarray  # (n_outputs, 3 n_pairs) c
    of_base: np.ndarray  # (n_outputs, n_loads) acceleration of the base along the output under each load [m/s2]

    def motion(self, u: np.ndarray, p: np.ndarray, f: np.ndarray, harmonics: Harmonics, omega: float) -> np.ndarray:
        """Return the coefficients of the outputs, (n_outputs, N_H), in their units.  Local.

        Parameters
        ----------
        u, p, f : coefficients of o u (n_outputs, N_H) [m], contact forces (3 n_pairs, N_H) [N] and loads (n_loads, N_H)
        """
        i_omega = 1j * omega * harmonics.numbers
        base = self.of_base @ to_complex(f)
        y = i_omega ** self.order[:, None] * to_complex(u) + base * _powers(i_omega, self.order - 2)
        return to_real(y, u.shape[-1]) + self.of_p @ p

    def factors(self, n_omega: float) -> np.ndarray:
        """Return |(i n omega)^k|, (n_outputs,) [1/s^k].  Local."""
        return n_omega ** self.order.astype(float)

    def of_forces(self, A: np.ndarray, n_omega: float) -> np.ndarray:
        """Return minus the derivative of the outputs by p, complex (n_outputs, 3 n_pairs), from A of o u [m/N].  Local."""
        return (1j * n_omega) ** self.order[:, None] * A - self.of_p


def _powers(i_omega: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Return i_omega^order, (n_outputs, n_harmonics), for orders up to 0; 0 at the mean, where a constant has no integral."""
    moving = i_omega != 0.0
    safe = np.where(moving, i_omega, 1.0)
    return np.where(moving | (order[:, None] == 0), safe ** order[:, None], 0.0)
