"""Coupling between retained and truncated modes by structural damping (docs/theory.md, section 13).

The springs of the joint have no structural damping, so that eta phi^H K phi couples all modes: the force d x of the retained
modes, d = eta R^H K_J R phi, acts on the truncated modes with a lag of a quarter of a cycle, and these act back on the retained
modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fourier.amplitudes import to_complex
from .damping import DynamicFlexibility
from .reduced_model import HarmonicGroup


@dataclass(frozen=True)
class StructuralCoupling:
    """The static response Z d of the truncated modes, one column per retained mode, projected on pairs, outputs, loads and d.

    docs/theory.md, eq. (13.8).
    """

    of_pairs: np.ndarray  # (3 n_pairs, m)
    of_outputs: np.ndarray  # (n_outputs, m)
    of_loads: np.ndarray  # (n_loads, m)
    modal: np.ndarray  # (m, m) d^H Z d

    def times(self, factor: float) -> StructuralCoupling:
        """Return the response to d times a factor.  Local."""
        return StructuralCoupling(
            factor * self.of_pairs, factor * self.of_outputs, factor * self.of_loads, factor**2 * self.modal
        )

    def changes(self, group: HarmonicGroup, c: DynamicFlexibility, f: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the magnitude of the changes of cos 1 and then sin 1 of the output rows, (2 n_outputs,) [m].  Local.

        At constant forces of the pairs: u_left = Z (f - R^H p) + i Z d x.  ``f`` (n_loads, N_H) and ``p`` (3 n_pairs, N_H) are
        coefficients of the group.
        """
        i, modes = group.harmonics.chosen.index(1), group.receptance.modes
        x = group.receptance.modal_motion(f, p, c)[:, i]
        f_1, p_1 = to_complex(f)[:, i], to_complex(p)[:, i]
        force = 1j * (self.of_loads.conj().T @ f_1 - self.of_pairs.conj().T @ p_1) - self.modal @ x
        more = c.whole(force[:, None], i)[:, 0]
        y = 1j * (self.of_outputs @ x) + modes.o @ more
        return np.abs(np.concatenate([y.real, y.imag]))
