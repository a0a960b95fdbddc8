"""The choice of the modes made again for other friction, levels or range, from what is known of a structure: without its factor.

The residual norms of docs/theory.md, section 4, are static solutions minus what the modes found have of them.  Of loads and
outputs the static solutions are known, and of R^T p they are p^T G_static p, with the columns of the pairs that p acts on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..contact.law import Law
from ..modes.limits import FEW
from ..parallel.ownership import rows_of
from ..receptance.modes import DampedModes
from ..receptance.per_group import PerGroup
from ..receptance.receptance import Receptance
from ..receptance.reduced_structure import ReducedStructure
from .choose_modes import as_stated, batches, picked
from .settings import ModalDamping, ReductionSettings
from .truncation import KnownNorms, bound, norms_beyond


@dataclass(frozen=True)
class KnownStructure:
    """A stuck structure without its matrices."""

    reduced: ReducedStructure  # of all modes that were found
    n_dof: int
    n_proved: int  # modes that are known to be the lowest

    @property
    def modes(self) -> DampedModes:
        return self.reduced.receptance_of(1).modes


class NotKnown(LookupError):
    """Something that only a factor can tell."""


def choose_again(known: KnownStructure, law: Law, settings: ReductionSettings) -> tuple[int, str] | None:
    """Return how many of the modes found are needed, and a line that says why; None if that or these modes are not known.

    Collective on the structure's communicator.  The number is that of :func:`~microslip.reduction.choose_modes.choose_modes`.

    Raises
    ------
    CaseError : the accuracy asked for needs more modes than are computed
    """
    n_known = len(known.modes.omega_n)
    if settings.modes is not None:
        found: tuple[int, str] | None = settings.modes, as_stated(_omega_n(known, settings.modes), settings, known.n_dof)
    elif known.n_dof <= FEW:
        found = n_known, f"modes: all {n_known} there are"
    else:
        found = _fewest(known, law, settings)
    if found is None or found[0] > n_known or (settings.verify_modes and found[0] > known.n_proved):
        return None
    return found


def _omega_n(known: KnownStructure, n_modes: int) -> np.ndarray:
    return known.modes.omega_n[:n_modes]


def _fewest(known: KnownStructure, law: Law, settings: ReductionSettings) -> tuple[int, str] | None:
    """Return the same where an accuracy decides, from the batches in which the modes were found."""
    n_known, mode = len(known.modes.omega_n), settings.band.mode or 0
    for n_batch, is_last in batches(known.n_dof, mode):
        n_found = min(n_batch, n_known)
        if n_found < n_batch and n_known < known.n_dof:
            return None
        if mode < n_found or is_last:
            reduced = with_first(known.reduced, n_found, settings.damping)
            try:
                norms = Known(reduced.receptance_of(1), reduced)
                found = bound(reduced, law, norms, settings)
            except NotKnown:
                return None
            omega_n, is_all = _omega_n(known, n_found), n_found == known.n_dof
            n_modes, why = reduced.comm.bcast(picked(found, omega_n, is_all, is_last, settings))
            if n_modes:
                return n_modes, why
    return None


def with_first(reduced: ReducedStructure, n_modes: int, damping: ModalDamping | None) -> ReducedStructure:
    """Return the same with the first of its modes alone, and their damping; its own where the structure has a matrix.

    Local.
    """
    receptance, first = reduced.receptance_of(1), slice(n_modes)
    modes = receptance.modes
    omega_n = modes.omega_n[first]
    of_first = modes.damping.of_first(n_modes)
    if damping is not None and damping.is_alone:
        of_first = replace(of_first, C=damping.modal(omega_n))
    fewer = DampedModes(omega_n, of_first, modes.R_phi[:, first], modes.b[first], modes.o[:, first])
    return replace(reduced, receptances=PerGroup.single(Receptance(fewer, receptance.static)))


@dataclass(frozen=True)
class Known(KnownNorms):
    """Residual norms for keeping 1 to n of n modes of a known structure."""

    reduced: ReducedStructure

    def of_pairs(self, p: np.ndarray) -> np.ndarray:
        model = self.reduced
        parts = np.concatenate([p.real, p.imag], axis=1)
        moving = np.flatnonzero(parts.reshape(model.n_pairs, -1).any(axis=1))
        G_static = self.receptance.static.G_static
        if not G_static.known[moving].all():
            raise NotKnown("static columns")
        rows = rows_of(moving)
        Gp_owned = parts[rows].T @ G_static.transposed(moving)  # its columns are this rank's rows of G
        static = model.comm.allreduce(np.einsum("pi,ip->p", Gp_owned, parts[model.owned_rows]))
        return norms_beyond(static, self.receptance.modes.R_phi.T @ parts, self.receptance.modes.omega_n)

    def of_drag(self, z: np.ndarray, n_omega: float, settings: ReductionSettings) -> np.ndarray:
        raise NotKnown("drag of a full damping matrix")
