"""Diagnosis of a singular stiffness matrix: which part of the structure moves freely, and how.

Motions are measured by z^T A z / z^T D z with D = diag(A): no units, 0 for a motion without any strain, some 1e-5 for the
softest motion of a fine mesh that is held, 1e-12 if only springs a million times softer than the structure hold it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

import numpy as np
from petsc4py import PETSc

from ..messages.errors import CaseError
from ..messages.words import listed
from ..parallel.ownership import summed
from .dense import diagonal_owned, gram, multiply, wave_matrix
from .direct import DirectSolver, factorise

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..assembly.system import System

FREE = 1e-14  # z^T A z / z^T D z of a motion that counts as free; rounding leaves up to 1e-15
_SHIFT = 1e-9  # of D, added to A to make it invertible
_N_TRIED = 3, 2  # random motions, real and complex, as one may contain almost nothing of the free motion
_N_SOUGHT = 12  # two bodies without any support
_ROUNDS = 4
_HELD = 1e-3  # squared share of a free motion below which a part does not take part in it
_ALL = 0.99  # squared share of a translation in the free motions from which it is one of them
_OF_REST = (
    "; the stress at rest is part of it ([statics] stress_stiffening, the default), and that rest is not stable: a body buckles, "
    "tilts under forces that keep their direction, or rocks on too few closed pairs; check the loads of [statics], or state "
    "stress_stiffening = false"
)


def is_singular(A: PETSc.Mat, diagonal: np.ndarray, solver: DirectSolver) -> bool:
    """Return whether the factor's softest motion is without strain, ``diagonal`` (n_owned,) that of A.

    Collective: one pass over the factor.

    A step of inverse iteration: a free motion, softer than all others by 1e9 and more, is nearly all of its result.
    """
    comm, wave = A.comm.tompi4py(), wave_matrix(A)
    n_tried = _N_TRIED[wave is not None and wave.is_complex]
    Z_owned = solver.solve(diagonal[:, None] * _random(comm, len(diagonal), n_tried))
    strains = np.diag(gram(comm, Z_owned, multiply(A, Z_owned))) / np.diag(gram(comm, Z_owned, diagonal[:, None] * Z_owned))
    return not np.min(strains) > FREE  # not a number: singular too


def free_as_a_whole(A: PETSc.Mat, system: System | None, what: str) -> np.ndarray:
    """Return the free motions of A, (n_owned, n), where no part of the structure is held at all.

    Collective: a factorisation of A + shift.

    Raises
    ------
    CaseError : A is not positive semi-definite, or some parts move freely while others are supported; on every rank
    """
    comm = A.comm.tompi4py()
    diagonal, Z_owned = _free_motions(A, system, what)
    parts = getattr(system, "parts", None)
    n_parts, is_all = len(getattr(system, "part_names", ()) or ("",)), Z_owned.shape[1] < _N_SOUGHT
    for part in range(n_parts):
        of_part = diagonal if parts is None else diagonal * (parts == part)
        is_all = is_all and bool(np.linalg.norm(gram(comm, Z_owned, of_part[:, None] * Z_owned), 2) > _HELD)
    if not comm.bcast(is_all):
        _refuse(A, diagonal, Z_owned, system, what)
    return Z_owned


def explain_singular(A: PETSc.Mat, system: System | None, what: str) -> NoReturn:
    """Raise CaseError with the free motions of A, by part.  Collective: a factorisation of A + shift."""
    _refuse(A, *_free_motions(A, system, what), system, what)


def _free_motions(A: PETSc.Mat, system: System | None, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Return diag(A) and the motions Z without strain, (n_owned, n), n > 0, Z^T D Z = 1.

    Collective.

    Raises
    ------
    CaseError : A is not positive semi-definite, or no motion is quite free; on every rank
    """
    comm = A.comm.tompi4py()
    diagonal = diagonal_owned(A)
    bad = int(summed(comm, np.array([np.count_nonzero(~(diagonal > 0.0))]))[0])
    if bad:
        row = _lowest_row(comm, A, ~(diagonal > 0.0))
        raise CaseError(
            f"{what} is not positive definite: {bad} of {A.getSize()[0]} degrees of freedom have no positive "
            f"stiffness of their own, the first is {_name_of_row(row, system)}{_at_rest(system)}"
        )
    strains, Z_owned = _softest_motions(A, diagonal, what)
    if strains[0] < -FREE:
        raise CaseError(
            f"{what} is not positive definite: a motion with z^T {what} z = {strains[0]:.1e} z^T diag z exists, "
            f"largest at {_name_of_row(_largest_row(comm, A, Z_owned[:, 0]), system)}; "
            f"a stiffness matrix must not release energy{_at_rest(system)}"
        )
    n_free = int(np.count_nonzero(strains <= FREE))
    if n_free == 0:
        raise CaseError(
            f"{what} is singular to working precision: its softest motion has z^T {what} z = {strains[0]:.1e} "
            f"z^T diag z, most at {_name_of_row(_largest_row(comm, A, Z_owned[:, 0]), system)}; "
            f"support it, or make its joint stiffer{_at_rest(system)}"
        )
    return diagonal, Z_owned[:, :n_free]


def _refuse(A: PETSc.Mat, diagonal: np.ndarray, Z_owned: np.ndarray, system: System | None, what: str) -> NoReturn:
    """Raise CaseError with the free motions Z of A, by part.  Collective."""
    free, n_free = _by_part(A.comm.tompi4py(), A, diagonal, Z_owned, system), Z_owned.shape[1]
    hold = "in the stiffness matrix" if getattr(system, "dof", None) is None else "by [[supports]]"
    many = f"; at least {n_free} free motions in all" if n_free == min(_N_SOUGHT, A.getSize()[0]) else ""
    raise CaseError(
        f"{what}, the stiffness with all pairs stuck, is singular: {'; '.join(free)}{many}. Hold these directions: "
        f"{hold}, or by [[joints]] to what is held (a joint holds only along directions in which it has stiffness)"
        f"{_at_rest(system)}"
    )


def _at_rest(system: System | None) -> str:
    """Return the remark that the stress at rest is part of a stiffness, where it is.  Local."""
    return _OF_REST if getattr(system, "rest_owned", None) is not None else ""


def _softest_motions(A: PETSc.Mat, diagonal: np.ndarray, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Return (strains, Z_owned): subspace iteration for the lowest z^T A z / z^T D z, rising; Z^T D Z = I.  Collective."""
    comm, n_dof = A.comm.tompi4py(), A.getSize()[0]
    shifted = A.duplicate(copy=True)
    D = A.createVecLeft()
    D.setArray((1.0 + _SHIFT) * diagonal)
    shifted.setDiagonal(D)
    D.destroy()
    Z_owned = _random(comm, len(diagonal), min(_N_SOUGHT, n_dof))
    solver, _ = factorise(shifted, "static_", what)
    for _ in range(_ROUNDS):
        Z_owned = _orthonormal(comm, diagonal, solver.solve(diagonal[:, None] * Z_owned))
        strains, rotation = np.linalg.eigh(gram(comm, Z_owned, multiply(A, Z_owned)))
        Z_owned = Z_owned @ rotation
    solver.destroy()
    shifted.destroy()
    return strains, Z_owned


def _orthonormal(comm: MPI.Comm, diagonal: np.ndarray, Z_owned: np.ndarray) -> np.ndarray:
    """Return a basis of the columns with Z^T D Z = I.  Collective: three sums."""
    for _ in range(3):
        G = gram(comm, Z_owned, diagonal[:, None] * Z_owned)
        size = np.sqrt(np.diag(G))
        values, vectors = np.linalg.eigh(G / np.outer(size, size))
        Z_owned = (Z_owned / size) @ (vectors / np.sqrt(np.maximum(values, 1e-14)))
    return Z_owned


def _by_part(comm: MPI.Comm, A: PETSc.Mat, diagonal: np.ndarray, Z_owned: np.ndarray, system: System | None) -> list[str]:
    """Return a phrase for each group of parts that move together in the free motions Z (Z^T D Z = I).  Collective."""
    parts = getattr(system, "parts", None)
    parts = np.zeros(len(diagonal), dtype=int) if parts is None else parts
    names = getattr(system, "part_names", ()) or ("the structure",)
    shares = [gram(comm, Z_owned, (diagonal * (parts == part))[:, None] * Z_owned) for part in range(len(names))]
    phrases = []
    for group in _moving_together(shares):
        weight = diagonal * np.isin(parts, group)
        n_motions = int(np.count_nonzero(np.linalg.eigvalsh(sum(shares[part] for part in group)) > _HELD))
        who = listed([names[part] for part in group]) + (" together" if len(group) > 1 else "")
        verb = "moves" if len(group) == 1 else "move"
        phrases.append(f"{who} {verb} freely in {_ways(n_motions)} ({_how(comm, A, weight, Z_owned, n_motions, system)})")
    return phrases or [f"something moves freely, most at {_name_of_row(_largest_row(comm, A, Z_owned[:, 0]), system)}"]


def _moving_together(shares: list[np.ndarray]) -> list[list[int]]:
    """Return the groups of parts that take part in the same free motions.  Local.

    The shares B_i = Z^T D_i Z of the parts add up to the identity; parts that move on their own have B_i B_j = 0.
    """
    groups: list[list[int]] = []
    for part, B in enumerate(shares):
        if np.linalg.norm(B, 2) <= _HELD:
            continue
        joined = [group for group in groups if any(np.linalg.norm(B @ shares[other], 2) > _HELD for other in group)]
        groups = [group for group in groups if group not in joined] + [sorted(sum(joined, [part]))]
    return sorted(groups)


def _how(comm: MPI.Comm, A: PETSc.Mat, weight: np.ndarray, Z_owned: np.ndarray, n_motions: int, system: System | None) -> str:
    """Return the free motions of a group of parts in words: which translations lie in the span of Z, and how many rotations.

    Collective.  ``weight`` (n_owned,) is D on the group and 0 elsewhere.  Without a mesh, only the row that moves most is
    named.
    """
    dof = getattr(system, "dof", None)
    if dof is None:
        moved = weight * np.max(np.abs(Z_owned), axis=1, initial=0.0)
        return f"most at {_name_of_row(_largest_row(comm, A, moved), system)}"
    constraints = getattr(system, "constraints", None)
    row_start, row_end = A.getOwnershipRange()
    T_owned = np.zeros((len(weight), 3))  # translations of the part along x, y, z
    for axis in range(3):
        rows = dof[:, axis]
        if constraints is not None:  # with those of the points, not their rotations
            rows = np.concatenate([rows, constraints.free[len(dof) :: 2, axis]])
        T_owned[rows[(rows >= row_start) & (rows < row_end)] - row_start, axis] = 1.0
    size = np.sqrt(np.diag(gram(comm, T_owned, weight[:, None] * T_owned)))
    size[size == 0.0] = np.inf  # the supports fix the whole part along this axis
    C = gram(comm, Z_owned, weight[:, None] * T_owned) / size
    G = C.T @ C  # 1 for a direction that is free
    shares, axes = np.linalg.eigh(G)
    free_axes = axes[:, shares > _ALL].T + 0.0
    aligned = ["xyz"[axis] for axis in range(3) if G[axis, axis] > _ALL]
    words = []
    if len(aligned) == len(free_axes) > 0:
        words.append(f"translation along {listed(aligned)}")
    elif len(free_axes):
        words.append("translation along " + listed(["(" + ", ".join(f"{c:.2f}" for c in axis) + ")" for axis in free_axes]))
    if n_motions > len(free_axes):
        n = n_motions - len(free_axes)
        words.append("a rotation" if n == 1 else f"{n} rotations")
    return ", ".join(words)


def _ways(n: int) -> str:
    return "one way" if n == 1 else f"{n} ways"


def _random(comm: MPI.Comm, n_owned: int, m: int) -> np.ndarray:
    """Return (n_owned, m) random numbers, different on each rank, the same in each run.  Local."""
    return np.asfortranarray(np.random.default_rng([comm.rank, m]).standard_normal((n_owned, m)))


def _largest_row(comm: MPI.Comm, A: PETSc.Mat, z_owned: np.ndarray) -> int:
    """Return the global row with the largest |z|, the lowest of equals.  Collective."""
    row_start = A.getOwnershipRange()[0]
    best = (0.0, 0) if len(z_owned) == 0 else (-float(np.max(np.abs(z_owned))), row_start + int(np.argmax(np.abs(z_owned))))
    return min(comm.allgather(best))[1]


def _lowest_row(comm: MPI.Comm, A: PETSc.Mat, marked: np.ndarray) -> int:
    """Return the lowest global row that is marked on any rank.  Collective."""
    rows = A.getOwnershipRange()[0] + np.flatnonzero(marked)
    return min(comm.allgather(int(rows[0]) if len(rows) else A.getSize()[0]))


def _name_of_row(row: int, system: System | None) -> str:
    """Return the name of a row in messages.  Local."""
    dof = getattr(system, "dof", None)
    if dof is None:
        return f"DOF {row}"
    constraints = getattr(system, "constraints", None)
    if constraints is not None:
        return constraints.name_of_row(row)
    node, axis = np.argwhere(dof == row)[0]
    return f"node index {node}, direction {'xyz'[axis]}"
