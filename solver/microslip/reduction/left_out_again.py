"""The samples of the modes left out where another number of modes is kept: Z without some modes more, or with some again.

With Z_m = K_L^-1 - sum over k <= m of phi_k phi_k^T / omega_k^2 and M-orthonormal modes, Z_m M Z_m lacks the same modes with
phi_k phi_k^T / omega_k^4 (docs/theory.md, section 11), so that another number needs no static solution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..linear.dense import diagonal_owned, gram
from ..linear.random_signs import random_signs
from ..parallel.ownership import summed
from ..receptance.modes import DampedModes
from ..receptance.receptance import Receptance
from ..receptance.truncated_modes import KEY, LAST, SAMPLES, TruncatedModes, of_samples
from .modal_structure import damping_beyond
from .settings import ModalDamping

if TYPE_CHECKING:
    from ..modes.eigen import Modes
    from .stuck import StuckStructure


@dataclass(frozen=True)
class OnRandom:
    """What modes have of the random vectors of the samples, before those are scaled; replicated."""

    energies: np.ndarray  # (n,) of each mode in the diagonal of M
    amplitudes: np.ndarray  # (n, SAMPLES) phi^T s

    def scale(self, n_modes: int) -> float:
        """Return the factor of the random vectors where so many modes are kept."""
        return 1.0 / np.sqrt(self.energies[:n_modes][-LAST:].mean() * SAMPLES)


def on_random(stuck: StuckStructure, modes: Modes) -> OnRandom:
    """Return what modes have of the random vectors.  Collective: two sums."""
    comm, mass = stuck.comm, np.maximum(diagonal_owned(stuck.M), 0.0)
    first, last = stuck.K_L.getOwnershipRange()
    random = np.sqrt(mass)[:, None] * random_signs(first, last - first, SAMPLES, KEY)
    return OnRandom(summed(comm, mass @ modes.phi_owned**2), gram(comm, modes.phi_owned, random))


def left_out_again(
    left_out: TruncatedModes,
    n_kept: int,
    receptance: Receptance,
    everything: DampedModes,
    seen: OnRandom,
    damping: ModalDamping | None,
) -> TruncatedModes:
    """Return the samples beside the modes of ``receptance`` from those beside ``n_kept`` modes.  Local.

    ``everything`` are all modes known.  What couples the modes kept to the others is known for ``n_kept`` alone.
    """
    n = len(receptance.modes.omega_n)
    assert n == n_kept or left_out.coupling is None, "a coupling is known for the modes kept alone"
    between, sign = slice(min(n, n_kept), max(n, n_kept)), 1.0 if n < n_kept else -1.0
    squares = everything.omega_n[between] ** 2
    o, b = everything.o[:, between], everything.b[between]
    rows = np.concatenate([left_out.of_pairs, left_out.of_outputs, left_out.of_loads]) / seen.scale(n_kept)
    of_modes = np.concatenate([everything.R_phi[:, between], o, b.T])
    rows = (rows + sign * (of_modes / squares) @ seen.amplitudes[between]) * seen.scale(n)
    direct = left_out.direct + sign * (o / squares**2) @ b
    own = left_out.own + sign * (b**2 / squares[:, None] ** 2).sum(axis=0)
    beyond = damping_beyond(damping, receptance.modes)
    if damping is None or not damping.is_alone:  # as the damping matrix was seen with the modes kept
        beyond = replace(beyond, alpha=max(beyond.alpha, left_out.damping.alpha))
    return of_samples(receptance, rows, direct, own, beyond, left_out.coupling)
