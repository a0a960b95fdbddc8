"""Why a stiffness matrix is singular: which part of the structure moves freely, and how.

Motions are measured by z^T A z / z^T D z with D = diag(A): no units, 0 for a motion without any strain, some 1e-5 for the
softest motion of a fine mesh that is held, 1e-12 if only springs a million times softer than the structure hold it.
"""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from petsc4py import PETSc

from ..parallel.errors import CaseError
from .dense import diagonal_owned, gram, multiply, summed
from .mumps import factorise, solve_block

FREE = 1e-14                    # z^T A z / z^T D z of a motion that counts as free; rounding leaves up to 1e-15
_SHIFT = 1e-9                   # of D, added to A to make it invertible
_N_SOUGHT = 12                  # two bodies without any support
_ROUNDS = 4
_HELD = 1e-3                    # squared share of a free motion below which a part does not take part in it
_ALL = 0.99                     # squared share of a translation in the free motions from which it is one of them


def is_singular(A: PETSc.Mat, ksp: PETSc.KSP) -> bool:
    """Return whether the factor's softest motion strains nothing.  Collective: two solves of inverse iteration."""
    comm = A.comm.tompi4py()
    diagonal = diagonal_owned(A)
    z = _random(comm, len(diagonal), 1)
    for _ in range(2):
        z = solve_block(ksp, diagonal[:, None] * z)
        z /= np.sqrt(gram(comm, z, diagonal[:, None] * z)[0, 0])
    return not gram(comm, z, multiply(A, z))[0, 0] > FREE           # not a number: singular too


def explain_singular(A: PETSc.Mat, system, what: str) -> NoReturn:
    """Raise CaseError with the free motions of A, by part.  Collective: a factorisation of A + shift."""
    comm = A.comm.tompi4py()
    diagonal = diagonal_owned(A)
    bad = int(summed(comm, np.array([np.count_nonzero(~(diagonal > 0.0))]))[0])
    if bad:
        row = _lowest_row(comm, A, ~(diagonal > 0.0))
        raise CaseError(f"{what} is not positive definite: {bad} of {A.getSize()[0]} degrees of freedom have no positive "
                        f"stiffness of their own, the first is {_name_of_row(row, system)}")
    strains, Z_owned = _softest_motions(A, diagonal, what)
    if strains[0] < -FREE:
        raise CaseError(f"{what} is not positive definite: a motion with z^T {what} z = {strains[0]:.1e} z^T diag z exists, "
                        f"largest at {_name_of_row(_largest_row(comm, A, Z_owned[:, 0]), system)}; "
                        "a stiffness matrix must not release energy")
    n_free = int(np.count_nonzero(strains <= FREE))
    if n_free == 0:
        raise CaseError(f"{what} is singular to working precision: its softest motion has z^T {what} z = {strains[0]:.1e} "
                        f"z^T diag z, most at {_name_of_row(_largest_row(comm, A, Z_owned[:, 0]), system)}; "
                        "support it, or make its joint stiffer")
    free = _by_part(comm, A, diagonal, Z_owned[:, :n_free], system)
    hold = "Hold it in the stiffness matrix" if getattr(system, "dof", None) is None else "Add [[supports]]"
    many = "at least " if n_free == strains.size else ""
    raise CaseError(f"{what} is singular: {many}{_count(n_free)} without any strain: {'; '.join(free)}. {hold}, or add "
                    "a joint with stiffness in these directions")


def _softest_motions(A: PETSc.Mat, diagonal: np.ndarray, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Return (strains, Z_owned): subspace iteration for the lowest z^T A z / z^T D z, rising; Z^T D Z = I.  Collective."""
    comm, n_dof = A.comm.tompi4py(), A.getSize()[0]
    shifted = A.duplicate(copy=True)
    D = A.createVecLeft()
    D.setArray((1.0 + _SHIFT) * diagonal)
    shifted.setDiagonal(D)
    D.destroy()
    Z_owned = _random(comm, len(diagonal), min(_N_SOUGHT, n_dof))
    ksp, _ = factorise(shifted, "static_", what)
    for _ in range(_ROUNDS):
        Z_owned = _orthonormal(comm, diagonal, solve_block(ksp, diagonal[:, None] * Z_owned))
        strains, rotation = np.linalg.eigh(gram(comm, Z_owned, multiply(A, Z_owned)))
        Z_owned = Z_owned @ rotation
    ksp.destroy()
    shifted.destroy()
    return strains, Z_owned


def _orthonormal(comm, diagonal: np.ndarray, Z_owned: np.ndarray) -> np.ndarray:
    """Return a basis of the columns with Z^T D Z = I.  Collective: three sums."""
    for _ in range(3):
        G = gram(comm, Z_owned, diagonal[:, None] * Z_owned)
        size = np.sqrt(np.diag(G))
        values, vectors = np.linalg.eigh(G / np.outer(size, size))
        Z_owned = (Z_owned / size) @ (vectors / np.sqrt(np.maximum(values, 1e-14)))
    return Z_owned


def _by_part(comm, A: PETSc.Mat, diagonal: np.ndarray, Z_owned: np.ndarray, system) -> list[str]:
    """Return a phrase for each part that the free motions Z (Z^T D Z = I) move.  Collective."""
    parts = getattr(system, "parts", None)
    parts = np.zeros(len(diagonal), dtype=int) if parts is None else parts
    names = getattr(system, "part_names", ()) or ("the structure",)
    phrases = []
    for part, name in enumerate(names):
        weight = diagonal * (parts == part)
        n_motions = int(np.count_nonzero(np.linalg.eigvalsh(gram(comm, Z_owned, weight[:, None] * Z_owned)) > _HELD))
        if n_motions:
            phrases.append(f"{name} moves freely ({_count(n_motions)}{_how(comm, A, weight, Z_owned, system)})")
    return phrases or [f"most at {_name_of_row(_largest_row(comm, A, Z_owned[:, 0]), system)}"]


def _how(comm, A: PETSc.Mat, weight: np.ndarray, Z_owned: np.ndarray, system) -> str:
    """Return which translations of a part lie in the span of Z, in words.  Collective.

    ``weight`` (n_owned,) is D on the part and 0 elsewhere.  Without a mesh, the row that moves most is all there is.
    """
    if getattr(system, "dof", None) is None:
        moved = weight * np.max(np.abs(Z_owned), axis=1, initial=0.0)
        return f", most at {_name_of_row(_largest_row(comm, A, moved), system)}"
    row_start, row_end = A.getOwnershipRange()
    T_owned = np.zeros((len(weight), 3))                        # translations of the part along x, y, z
    for axis in range(3):
        rows = system.dof[:, axis]
        T_owned[rows[(rows >= row_start) & (rows < row_end)] - row_start, axis] = 1.0
    size = np.sqrt(np.diag(gram(comm, T_owned, weight[:, None] * T_owned)))
    size[size == 0.0] = np.inf                                  # the supports fix the whole part along this axis
    C = gram(comm, Z_owned, weight[:, None] * T_owned) / size
    G = C.T @ C                                                 # 1 for a direction that is free
    shares, axes = np.linalg.eigh(G)
    free_axes = axes[:, shares > _ALL].T + 0.0
    aligned = ["xyz"[axis] for axis in range(3) if G[axis, axis] > _ALL]
    if len(free_axes) == 0:
        return ", by rotation"
    if len(aligned) == len(free_axes):
        return f", translation along {' and '.join(aligned)} among them"
    directions = " and ".join("(" + ", ".join(f"{c:.2f}" for c in axis) + ")" for axis in free_axes)
    return f", translation along {directions} among them"


def _count(n: int) -> str:
    return "one motion" if n == 1 else f"{n} motions"


def _random(comm, n_owned: int, m: int) -> np.ndarray:
    """Return (n_owned, m) random numbers, other ones on each rank, the same in each run.  Local."""
    return np.asfortranarray(np.random.default_rng([comm.rank, m]).standard_normal((n_owned, m)))


def _largest_row(comm, A: PETSc.Mat, z_owned: np.ndarray) -> int:
    """Return the global row with the largest |z|, the lowest of equals.  Collective."""
    row_start = A.getOwnershipRange()[0]
    best = (0.0, 0) if len(z_owned) == 0 else (-float(np.max(np.abs(z_owned))), row_start + int(np.argmax(np.abs(z_owned))))
    return min(comm.allgather(best))[1]


def _lowest_row(comm, A: PETSc.Mat, marked: np.ndarray) -> int:
    """Return the lowest global row that is marked on any rank.  Collective."""
    rows = A.getOwnershipRange()[0] + np.flatnonzero(marked)
    return min(comm.allgather(int(rows[0]) if len(rows) else A.getSize()[0]))


def _name_of_row(row: int, system) -> str:
    """Return what to call a row in a message.  Local."""
    dof = getattr(system, "dof", None)
    if dof is None:
        return f"DOF {row}"
    node, axis = np.argwhere(dof == row)[0]
    return f"node index {node}, direction {'xyz'[axis]}"
