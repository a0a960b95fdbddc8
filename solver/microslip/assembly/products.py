"""Products of a sparse matrix with many columns: the entries are read once, and the rows of X that they multiply are contiguous.

`python jobs/bench/kernels.py` compares them with PETSc's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from ..parallel.to_owners import ToOwners
from ._rows import add_products, parts

_TOGETHER = 8  # columns of a vector of numbers; fewer are multiplied by PETSc
_MOST = 24  # columns that are copied into rows at once
_NAME = "columns of other ranks"  # of the attribute of a matrix


def times(A: PETSc.Mat, X_owned: np.ndarray) -> np.ndarray:
    """Return this rank's rows of A X, real (n_owned, m), column-major.  Collective."""
    m = X_owned.shape[1]
    if len(X_owned) != A.getLocalSize()[1]:
        raise ValueError(f"{len(X_owned)} rows for the {A.getLocalSize()[1]} columns of a matrix on this rank")
    product: np.ndarray = np.zeros((A.getLocalSize()[0], m), order="F")
    if m < _TOGETHER or A.getType() not in ("seqaij", "mpiaij"):
        by_petsc(A, np.asfortranarray(X_owned, dtype=float), product)
        return product
    for first in range(0, m, _MOST):
        columns = X_owned[:, first : first + _MOST]
        X = np.zeros((len(columns), -(-columns.shape[1] // _TOGETHER) * _TOGETHER))
        X[:, : columns.shape[1]] = columns
        some = product[:, first : first + _MOST]
        if A.getType() == "seqaij":
            add_products(A, X, some)
        else:
            others = _Others.of(A)
            add_products(A, X, some, others.own)
            add_products(A, others.rows.fetch(X), some, others.beyond)
    return product


def by_petsc(A: PETSc.Mat, X_owned: np.ndarray, product: np.ndarray) -> None:
    """Write A X into ``product``, both column-major.  Collective."""
    n_owned, m = X_owned.shape
    X = PETSc.Mat().createDense(((n_owned, None), (None, m)), array=X_owned, comm=A.comm)
    X.assemble()
    AX = PETSc.Mat().createDense(((len(product), None), (None, m)), array=product, comm=A.comm)
    AX.assemble()
    A.matMult(X, AX)
    AX.destroy()
    X.destroy()


@dataclass(frozen=True, eq=False)
class _Others:
    """Data of other ranks for a product; an attribute of the matrix, valid as long as that does not change."""

    state: int  # of the matrix, which PETSc counts up with every change
    own: int  # address of the part with the columns of this rank
    beyond: int  # and of that with those of other ranks
    rows: ToOwners  # of X, of the other ranks

    @classmethod
    def of(cls, A: PETSc.Mat) -> _Others:
        """Return that of a matrix, made where it is missing or no longer valid.  Collective."""
        others = A.getAttr(_NAME)
        if others is None or others.state != A.stateGet():
            own, beyond, columns = parts(A)
            others = cls(A.stateGet(), own, beyond, ToOwners(A.comm.tompi4py(), A.getOwnershipRangesColumn(), columns))
            A.setAttr(_NAME, others)
        return others
