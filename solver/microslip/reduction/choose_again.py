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
from ..receptance.damping import Damping
from ..receptance.family import ModalFamily
from ..receptance.reduced_structure import ReducedStructure
from .choose_modes import as_stated, batches, picked
from .modal_structure import diagonal_if_possible, modal_damping
from .settings import ModalDamping, ReductionSettings
from .truncation import KnownNorms, bound, norms_beyond


@dataclass(frozen=True)
class KnownStructure:
    """A stuck structure without its matrices."""

    reduced: ReducedStructure  # of all modes that were found
    outputs_static: np.ndarray  # (n_outputs,) o K_L^-1 o^T of each
    n_dof: int
    n_proved: int  # modes that are known to be the lowest


class NotKnown(LookupError):
    """Something that only a factor can tell."""


def choose_again(known: KnownStructure, law: Law, settings: ReductionSettings) -> tuple[int, str] | None:
    """Return how many of the modes found are needed, and a line that says why; None if that or these modes are not known.

    Collective on the structure's communicator.  The number is that of :func:`~microslip.reduction.choose_modes.choose_modes`.

    Raises
    ------
    CaseError : the accuracy asked for needs more modes than are computed
    """
    n_known = len(known.reduced.one_family.omega_n)
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
    return known.reduced.one_family.omega_n[:n_modes]


def _fewest(known: KnownStructure, law: Law, settings: ReductionSettings) -> tuple[int, str] | None:
    """Return the same where an accuracy decides, from the batches in which the modes were found."""
    n_known, mode = len(known.reduced.one_family.omega_n), settings.band.mode or 0
    for n_batch, is_last in batches(known.n_dof, mode):
        n_found = min(n_batch, n_known)
        if n_found < n_batch and n_known < known.n_dof:
            return None
        if mode < n_found or is_last:
            reduced = with_first(known.reduced, n_found, settings.damping)
            try:
                norms = Known(reduced.one_family, reduced.load_static, known.outputs_static, reduced)
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
    family, first = reduced.one_family, slice(n_modes)
    omega_n = family.omega_n[first]
    if damping is not None and damping.is_alone:
        C = modal_damping(damping, omega_n)
    else:
        C = _first(family.damping.C, n_modes)
    S = None if family.damping.S is None else _first(family.damping.S, n_modes)
    shared = ModalFamily(omega_n, Damping(C, S), family.R_phi[:, first], family.b[first], family.o[:, first])
    return replace(reduced, families=(shared,))


def _first(modal: np.ndarray, n: int) -> np.ndarray:
    """Return a damping (m,) or (m, m) for the first n modes, as a structure with these alone has it."""
    return modal[:n] if modal.ndim == 1 else diagonal_if_possible(modal[:n, :n])


@dataclass(frozen=True)
class Known(KnownNorms):
    """Residual norms for keeping 1 to n of n modes of a known structure."""

    reduced: ReducedStructure

    def of_pairs(self, p: np.ndarray) -> np.ndarray:
        model = self.reduced
        parts = np.concatenate([p.real, p.imag], axis=1)
        moving = np.flatnonzero(parts.reshape(model.n_pairs, -1).any(axis=1))
        if not model.G_static.known[moving].all():
            raise NotKnown("static columns")
        rows = rows_of(moving)
        Gp_owned = parts[rows].T @ model.G_static.transposed(moving)  # its columns are this rank's rows of G
        static = model.comm.allreduce(np.einsum("pi,ip->p", Gp_owned, parts[model.owned_rows]))
        return norms_beyond(static, self.family.R_phi.T @ parts, self.family.omega_n)

    def of_drag(self, z: np.ndarray, n_omega: float, settings: ReductionSettings) -> np.ndarray:
        raise NotKnown("drag of a full damping matrix")
