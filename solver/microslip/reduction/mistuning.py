"""A disc with blades of different stiffness and mass: component mode mistuning (docs/theory.md, section 17).

A change of the blades' stiffness and mass couples the tuned modes of all nodal diameters by small matrices; the eigenproblem is
solved again in the computed modes.  The contribution of the truncated modes remains that of identical blades.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ..linear.dense import diagonal_owned, gram, multiply
from ..messages.errors import CaseError
from ..modes.eigen import Modes, first_of
from ..parallel.agree import on_root
from ..parallel.ownership import summed
from ..receptance.circulant import ColumnsOfOtherModes, Waves
from ..receptance.modes import ProjectedModes
from ..receptance.static_response import StaticResponse
from .stuck import Factored, OnDemand, StuckStructure

if TYPE_CHECKING:
    from mpi4py import MPI
    from petsc4py import PETSc

Stuck = TypeVar("Stuck", bound=StuckStructure)
_SHAPED = 8  # modes with static shapes
_INDEPENDENT = 1e-10  # modal mass of a static shape without its part in the modes, relative to the whole shape


def with_static_shapes(stuck: Stuck, blades: tuple[PETSc.Mat, PETSc.Mat]) -> Stuck:
    """Return a structure of one nodal diameter with additional Ritz vectors: static shapes without their part in the modes.

    Collective: solves, three for each of the first modes and one for each load and output.  The shapes are the static responses
    to loads, to output rows, and, in each of the first modes, to the forces of the stuck joint, K_b phi and M_b phi of the blade.
    """
    system, comm, rows = stuck.system, stuck.comm, stuck.rows
    first = slice(min(_SHAPED, stuck.n_modes))
    of_joint = stuck.pair_forces(stuck.pairs.law.stiffness.reshape(-1, 1) * stuck.projected.R_phi[:, first])
    given = sp.hstack([system.loads, system.outputs.conj().T], format="csr")[rows].toarray()
    shapes = _on_nodes(stuck.using(first.stop), blades[0])
    T = _nodal(stuck)
    of_blades = [
        T.conj().T.tocsr()[rows] @ np.concatenate(comm.allgather(multiply(A, shapes.real) + 1j * multiply(A, shapes.imag)))
        for A in blades
    ]
    forces = np.hstack([given, of_joint, *(each if stuck.is_complex else each.real for each in of_blades)])
    motions, phi_owned, n = stuck.solve(forces), stuck.modes.phi_owned, forces.shape[1]
    of_M = stuck.product(stuck.M, np.hstack([motions, phi_owned]))
    of_motions, of_phi = of_M[:, :n], of_M[:, n:]
    sizes = np.sqrt(summed(comm, np.einsum("ij,ij->j", motions.conj(), of_motions)).real)
    scale, of_modes = 1.0 / np.where(sizes > 0.0, sizes, 1.0), stuck.participation(forces)
    q = of_modes / stuck.omega_n[:, None] ** 2
    motions = (motions - phi_owned @ q) * scale
    K, M = (gram(comm, motions, each) for each in (stuck.product(stuck.K_L, motions), (of_motions - of_phi @ q) * scale))
    squares, X = comm.bcast(_ritz(K, M))
    if len(squares) == 0:
        return stuck
    info = {**stuck.modes.info, "complete": False, "proved": stuck.modes.n_proved}
    phi_owned = np.asfortranarray(np.hstack([phi_owned, motions @ X]))
    return stuck.with_modes(Modes(np.append(stuck.omega_n, np.sqrt(squares)), phi_owned, info))


def with_first_modes(stuck: Stuck, n_modes: int) -> Stuck:
    """Return the structure with its first modes only, as views of their arrays.  Local."""

    def factored() -> Factored:
        all_modes = stuck.factored()
        return replace(all_modes, modes=first_of(all_modes.modes, n_modes))

    n_proved, projected = min(stuck.n_proved, n_modes), stuck.projected.first(n_modes)
    return replace(stuck, projected=projected, n_modes=n_modes, n_proved=n_proved, factored=OnDemand(factored, is_stored=False))


@dataclass(frozen=True, eq=False)
class BladeForms:
    """The stiffness and the mass of the blade of a sector in all modes of a disc of identical sectors: of eq. (17.5)."""

    K: np.ndarray  # (M, M) V^T K_b V, with real and imaginary parts of all modes in V
    M: np.ndarray  # (M, M) V^T M_b V
    n_modes: np.ndarray  # of each nodal diameter, without its static shapes


FORMS = "blade forms"  # key of the forms among the results of nodal diameter 0


def _ritz(K: np.ndarray, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return squared frequencies (r,) and M-normalised Ritz vectors (m, r) in the span of m vectors of rank r.  Local."""
    sizes, U = np.linalg.eigh(0.5 * (M + M.conj().T))
    U = U[:, sizes > _INDEPENDENT] / np.sqrt(sizes[sizes > _INDEPENDENT])
    of_U = U.conj().T @ K @ U
    squares, Q = np.linalg.eigh(0.5 * (of_U + of_U.conj().T))
    return squares, U @ Q


def blade_forms(
    tuned: Sequence[StuckStructure], waves: Waves, blades: tuple[PETSc.Mat, PETSc.Mat], n_modes: Sequence[int]
) -> BladeForms:
    """Return the forms of the blade of a sector in the modes of a tuned disc with static shapes.

    Collective: gathers of the modes, and products.  ``blades`` are K_b and M_b on the rows of the nodes; ``n_modes`` are those
    of each diameter without its static shapes.
    """
    copies = [1 if waves.is_real(d) else 2 for d in waves.diameters]
    ends = np.cumsum([0, *(m * each.n_modes for m, each in zip(copies, tuned))])
    of_blade = np.logical_or(*(diagonal_owned(matrix) > 0.0 for matrix in blades))
    V: np.ndarray = np.empty((np.count_nonzero(of_blade), ends[-1]), order="F")
    for each, m, start in zip(tuned, copies, ends):
        owned = _on_nodes(each, blades[0])[of_blade]
        V[:, start : start + each.n_modes] = owned.real
        if m == 2:
            V[:, start + each.n_modes : start + 2 * each.n_modes] = owned.imag
    K, M = (_form(tuned[0].comm, matrix, V, of_blade, ends) for matrix in blades)
    return BladeForms(K, M, np.array(n_modes))


def _form(comm: MPI.Comm, matrix: PETSc.Mat, V: np.ndarray, of_blade: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return V^T A V, (M, M), of a symmetric A and this rank's rows ``of_blade`` of V; the others of A are empty.

    Collective: a product for each block of columns, between ``ends``.
    """
    form = np.empty((V.shape[1], V.shape[1]))
    for start, end in pairwise(ends):
        block = np.zeros((len(of_blade), end - start), order="F")
        block[of_blade] = V[:, start:end]
        form[:end, start:end] = gram(comm, V[:, :end], multiply(matrix, block)[of_blade])
        form[start:end, :start] = form[:start, start:end].T
    return form


def _nodal(stuck: StuckStructure) -> sp.csr_matrix:
    """Return the rows of the nodes of the constraint matrix T, (n_nodal, n_dof)."""
    constraints = stuck.system.constraints
    return constraints.T[: constraints.n_nodal]


def _on_nodes(stuck: StuckStructure, matrix: PETSc.Mat) -> np.ndarray:
    """Return the modes on this rank's rows of a matrix on the rows of the nodes, (n_nodal_owned, n_modes).  Collective."""
    phi = np.concatenate(stuck.comm.allgather(stuck.modes.phi_owned))
    owned: np.ndarray = _nodal(stuck)[slice(*matrix.getOwnershipRange())] @ phi
    return owned


def changed_modes(
    tuned: Sequence[StuckStructure], waves: Waves, forms: BladeForms, factors: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (M,), ascending, and modes (M, M) of a disc with changed blades, in its tuned modes: eq. (17.5).

    Collective: one broadcast.  ``factors`` are the factors (N,) of the stiffness and of the mass of the blades.

    Raises
    ------
    CaseError : a stiffness or a mass that is not positive; on every rank
    """
    omega_n = waves.of_real_modes([each.omega_n for each in tuned])
    return on_root(tuned[0].comm, _solved, omega_n, waves, [each.n_modes for each in tuned], forms, factors)


def _solved(
    omega_n: np.ndarray, waves: Waves, n_modes: Sequence[int], forms: BladeForms, factors: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    K, M = np.diag(omega_n**2), np.eye(len(omega_n))
    for s in range(waves.n_sectors):
        L = _in_sector(waves, n_modes, s)
        K += (factors[0][s] - 1.0) * (L.T @ forms.K @ L)
        M += (factors[1][s] - 1.0) * (L.T @ forms.M @ L)
    try:
        squares, X = scipy.linalg.eigh(0.5 * (K + K.T), 0.5 * (M + M.T))
    except np.linalg.LinAlgError:
        squares, X = np.zeros(1), np.zeros(0)
    if not squares[0] > 0.0:
        raise CaseError("[cyclic]: the blades of some sectors have so little stiffness or mass that a mode of the disc has none")
    return np.sqrt(squares), X


def _in_sector(waves: Waves, n_modes: Sequence[int], s: int) -> sp.csr_matrix:
    """Return L of eq. (17.5): the real modes in sector s in terms of V, (M, M), two entries in a row.  Local."""
    N, blocks = waves.n_sectors, []
    for d, m in zip(waves.diameters, n_modes):
        cos, sin = np.cos(2.0 * np.pi * d * s / N), np.sin(2.0 * np.pi * d * s / N)
        turn = np.array([[cos]]) / np.sqrt(N) if waves.is_real(d) else np.sqrt(2.0 / N) * np.array([[cos, sin], [-sin, cos]])
        blocks.append(sp.kron(turn, sp.identity(m)))
    return sp.block_diag(blocks, format="csr")


def with_modes_changed(
    static: StaticResponse, modes: ProjectedModes, dF: np.ndarray, G_static: ColumnsOfOtherModes
) -> StaticResponse:
    """Return a static response with the contribution of some modes changed, eq. (17.6).  Local.

    ``dF`` (M, M) is the change of their flexibility, real and symmetric; ``G_static`` are the changed static columns.
    """

    def exchanged(left: str, right: str) -> np.ndarray:
        product: np.ndarray = np.linalg.multi_dot([_rows(modes, left), dF, _rows(modes, right).T])
        return product

    return replace(
        static,
        G_static=G_static,
        du_static=static.du_static + exchanged("R_phi", "b"),
        out_static=static.out_static + exchanged("o", "b"),
        out_R=static.out_R + exchanged("o", "R_phi"),
        load_static=static.load_static + exchanged("b", "b"),
        outputs_static=static.outputs_static + np.einsum("om,ml,ol->o", modes.o, dF, modes.o, optimize=True),
    )


def _rows(modes: ProjectedModes, name: str) -> np.ndarray:
    """Return the projection of modes on pairs, outputs or loads, (n, M).  Local."""
    rows = getattr(modes, name)
    return rows.T if name == "b" else rows
