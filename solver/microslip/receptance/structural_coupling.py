"""What structural damping does between the modes kept and those left out (docs/theory.md, section 13).

The springs of the joint have no structural damping, so that eta phi^T K phi couples all modes: the modes left out feel
d x = eta R^T K_J R phi x of the modes kept, a quarter of a cycle late, and the modes kept feel them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fourier.amplitudes import to_complex
from .motions import modal_motion
from .reduced_model import ReducedModel


@dataclass(frozen=True)
class StructuralCoupling:
    """The statics Z of the modes left out under d, one column a mode kept, as pairs, outputs, loads and d see it; replicated.

    docs/theory.md, eq. (13.8).
    """

    of_pairs: np.ndarray  # (3 n_pairs, m)
    of_outputs: np.ndarray  # (n_outputs, m)
    of_loads: np.ndarray  # (n_loads, m)
    own: np.ndarray  # (m, m) d^T Z d

    def changes(self, model: ReducedModel, level: float, omega: float, p: np.ndarray) -> np.ndarray:
        """Return what it changes in cos 1 and then sin 1 of the rows of the outputs, in size, (2 n_outputs,) [m].  Local.

        With the pairs' forces held: u_left = Z (f - R^T p) + i Z d x.
        """
        k, i = model.index_of(1)
        family, j = model.shares[k].family, model.harmonics.chosen.index(1)
        x = modal_motion(model, level, omega, p)[k][:, i]
        f_1, p_1 = to_complex(level * model.f)[:, j], to_complex(p)[:, j]
        force = 1j * (self.of_loads.T @ f_1 - self.of_pairs.T @ p_1) - self.own @ x
        more = model.flexibilities(omega)[k].whole(force[:, None], i)[:, 0]
        y = 1j * (self.of_outputs @ x) + family.o @ more
        return np.abs(np.concatenate([y.real, y.imag]))
