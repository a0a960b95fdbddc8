"""Matrices of one nodal diameter as products with the matrix of a sector, K(d) = P(d)^H K P(d) (docs/theory.md, section 14).

The sector's matrix has the rows of both faces; P(d) = P_0 + exp(i d alpha) P_1 makes the high face follow the low one.  Nothing
of the size of the sector is made for a nodal diameter.
"""

import atexit
import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc

from ..parallel.petsc import free, without_operands
from ..system.signals import is_stopping
from .products import times
from .real_form import complex_columns, real_columns, real_matrix, real_rows


@dataclass(frozen=True, eq=False)
class Unfolding:
    """P_0 and P_1 of eq. (14.6): the rows of a sector with both faces, (n_v,), from those without the high one, (n_w,).

    On each rank the rows of the sector are those of w, and then its rows of the high face.
    """

    P: tuple[sp.csr_matrix, sp.csr_matrix]  # (n_v, n_w) both, the same on every rank
    w_ranges: np.ndarray  # (size + 1,) rows of the ranks without the high face
    v_ranges: np.ndarray  # (size + 1,) and with it
    _matrices: dict[str, PETSc.Mat] = field(default_factory=dict, repr=False)

    def at(self, phase: complex) -> sp.csr_matrix:
        """Return P(d), complex where the phase is.  Local."""
        return (self.P[0] + phase * self.P[1]).tocsr()

    def rows_of_w(self, columns: np.ndarray) -> np.ndarray:
        """Return the rows of the sector of some rows of w.  Local."""
        rank = np.searchsorted(self.w_ranges, columns, side="right") - 1
        return columns + (self.v_ranges - self.w_ranges)[rank]

    @cached_property
    def followed(self) -> np.ndarray:
        """The rows of w that the high face follows, rising."""
        return np.unique(self.P[1].indices)

    def follow(self, comm: MPI.Comm, V_owned: np.ndarray) -> np.ndarray:
        """Return this rank's rows of the high face of P_1 W, real, from the sector's rows of P_0 W.  Collective."""
        return times(self._of_high(comm), V_owned)

    def lead(self, comm: MPI.Comm, H_owned: np.ndarray) -> np.ndarray:
        """Return this rank's :attr:`followed` rows of P_1^T applied to rows of the high face, real.  Collective."""
        self._of_high(comm)
        return times(self._matrices["lead"], H_owned)

    def _of_high(self, comm: MPI.Comm) -> PETSc.Mat:
        """Return the high rows of P_1, for rows of the sector; made once, with the transpose.  Collective where it is new."""
        if not self._matrices:
            w, v = self.w_ranges, self.v_ranges
            r = comm.rank
            high = np.concatenate([np.arange(v[k] + w[k + 1] - w[k], v[k + 1]) for k in range(comm.size)]).astype(int)
            n_before = (v - w).astype(int)
            rows = self.P[1][high].tocoo()
            of_sector = sp.csr_matrix((rows.data, (rows.row, self.rows_of_w(rows.col))), (len(high), int(v[-1])))
            followed = self.followed[slice(*np.searchsorted(self.followed, w[r : r + 2]))]
            high_owned = slice(n_before[r], n_before[r + 1])
            self._matrices["follow"] = _distributed(of_sector[high_owned], int(v[r + 1] - v[r]), comm)
            self._matrices["lead"] = _distributed(rows.tocsc().T[followed], int(n_before[r + 1] - n_before[r]), comm)
        return self._matrices["follow"]

    def destroy(self) -> None:
        """Free PETSc's matrices.  Collective."""
        for matrix in self._matrices.values():
            matrix.destroy()
        self._matrices.clear()


_LIVING: list[weakref.ref[PETSc.Mat]] = []  # all of this type


@atexit.register
def _free_at_exit() -> None:
    """Free matrices of this type that were not closed: PETSc would free them after Python's end, and crash in their context."""
    if _LIVING and not is_stopping():
        free(*(matrix for matrix in (there() for there in _LIVING) if matrix is not None))
        PETSc.garbage_cleanup()


def python_matrix(sizes: tuple, context: object, comm: PETSc.Comm) -> PETSc.Mat:
    """Return a matrix of PETSc's type "python", whose products are those of its ``context``.  Collective."""
    matrix = PETSc.Mat().createPython(sizes, context, comm=comm)
    matrix.setUp()
    _LIVING.append(weakref.ref(matrix))
    return matrix


class WaveMatrix:
    """P(d)^H A P(d) + B, eq. (14.6): the context of a PETSc matrix of type "python", with a complex phase in real form.

    Parameters
    ----------
    A : (n_v, n_v) symmetric, of the sector
    added : (n_w, n_w) Hermitian B, the same on every rank: springs of pairs; None: none
    """

    def __init__(self, A: PETSc.Mat, unfolding: Unfolding, phase: complex, added: sp.csr_matrix | None = None):
        self.A, self.unfolding, self.phase, self.is_complex = A, unfolding, phase, np.iscomplexobj(phase)
        self.comm = A.comm.tompi4py()
        first, last = unfolding.w_ranges[self.comm.rank : self.comm.rank + 2]
        self._n_owned = int(last - first)
        followed = unfolding.followed
        self._followed = followed[slice(*np.searchsorted(followed, (first, last)))] - first
        self._added = None if added is None or not added.nnz else added
        if self._added is not None:
            self._seen = np.unique(self._added.indices)
            self._added_owned = self._added[first:last][:, self._seen]
            self._seen_owned = (self._seen >= first) & (self._seen < last)
            self._places = self._seen[self._seen_owned] - first

    @classmethod
    def matrix(cls, A: PETSc.Mat, unfolding: Unfolding, phase: complex, added: sp.csr_matrix | None = None) -> PETSc.Mat:
        """Return it as a PETSc matrix, (2 n_w, 2 n_w) with a complex phase, (n_w, n_w) with a real one.  Collective."""
        context = cls(A, unfolding, phase, added)
        copies = 1 + context.is_complex
        sizes = (copies * context._n_owned, copies * int(unfolding.w_ranges[-1]))
        return python_matrix((sizes, sizes), context, A.comm)

    def unfolded(self, X_owned: np.ndarray) -> np.ndarray:
        """Return this rank's rows of P(d) X, (n_v_owned, 2 m): the real and then the imaginary parts.  Collective.

        With a real phase X and the result are real, (n_v_owned, m).
        """
        m, n, n_v = X_owned.shape[1], self._n_owned, int(np.diff(self.unfolding.v_ranges)[self.comm.rank])
        V_owned: np.ndarray = np.empty((n_v, m * (1 + self.is_complex)), order="F")
        V_owned[:n, :m], V_owned[n:] = X_owned.real, 0.0
        if not self.is_complex:
            V_owned[n:] = self.phase * self.unfolding.follow(self.comm, V_owned)
            return V_owned
        V_owned[:n, m:] = X_owned.imag
        of_high = self.phase * _complex(self.unfolding.follow(self.comm, V_owned))
        V_owned[n:, :m], V_owned[n:, m:] = of_high.real, of_high.imag
        return V_owned

    def folded(self, Y_owned: np.ndarray) -> np.ndarray:
        """Return this rank's rows of P(d)^H Y, (n_w_owned, m) as X, for Y as :meth:`unfolded` returns it.  Collective."""
        n = self._n_owned
        if not self.is_complex:
            product = Y_owned[:n].copy(order="F")
            product[self._followed] += self.unfolding.lead(self.comm, self.phase * Y_owned[n:])
            return product
        product, of_high = _complex(Y_owned[:n]), np.conj(self.phase) * _complex(Y_owned[n:])
        product[self._followed] += _complex(self.unfolding.lead(self.comm, np.hstack([of_high.real, of_high.imag])))
        return product

    def multiply(self, X_owned: np.ndarray, times_A: Callable[[np.ndarray], np.ndarray] | None = None) -> np.ndarray:
        """Return this rank's rows of the product with columns (n_w_owned, m), complex as the phase.  Collective.

        ``times_A`` returns this rank's rows of products with A, by default :func:`times`.
        """
        V_owned = self.unfolded(X_owned)
        product = self.folded(times(self.A, V_owned) if times_A is None else times_A(V_owned))
        return product if self._added is None else product + self._added_owned @ self._of_all(X_owned)

    def _of_all(self, X_owned: np.ndarray) -> np.ndarray:
        """Return the rows of X in which B has entries, of all ranks.  Collective: a sum."""
        rows: np.ndarray = np.zeros((len(self._seen), X_owned.shape[1]), dtype=X_owned.dtype)
        rows[self._seen_owned] = X_owned[self._places]
        return self.comm.allreduce(rows)

    def of_added(self, X_owned: np.ndarray) -> tuple[sp.csr_matrix, np.ndarray] | None:
        """Return B and X (n, m) on the rows in which B has entries, real or in real form, the same on every rank; None: no B.

        Collective: a sum.
        """
        if self._added is None:
            return None
        B, X = self._added[self._seen][:, self._seen], self._of_all(X_owned)
        return (real_matrix(B), real_columns(X)) if self.is_complex else (B, X)

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Multiply a vector, of a complex phase in real form; called by PETSc.  Collective."""
        column = x.getArray()[:, None]
        product = real_columns(self.multiply(complex_columns(column))) if self.is_complex else self.multiply(column)
        y.setArray(product[:, 0])

    multTranspose = mult

    def getDiagonal(self, matrix: PETSc.Mat, diagonal: PETSc.Vec) -> None:  # noqa: N802  PETSc's name
        """Write the diagonal, at the faces without the coupling of the two faces of one sector.  Collective."""
        of_sector = self.A.getDiagonal()
        values = of_sector.getArray()
        here = values[: self._n_owned, None].copy()
        here[self._followed] += times(self._of_squares(), values[self._n_owned :, None])
        of_sector.destroy()
        if self._added is not None:
            first = self.unfolding.w_ranges[self.comm.rank]
            here[:, 0] += self._added.diagonal().real[first : first + self._n_owned]
        diagonal.setArray(np.repeat(here[:, 0], 1 + self.is_complex))

    def _of_squares(self) -> PETSc.Mat:
        """Return the squares of the entries of P_1^T.  Collective."""
        squared = self.unfolding._matrices.get("squared")
        if squared is None:
            self.unfolding._of_high(self.comm)
            lead = self.unfolding._matrices["lead"]
            starts, columns, values = lead.getValuesCSR()
            squared = PETSc.Mat().createAIJ(lead.getSizes(), csr=(starts, columns, values**2), comm=lead.comm)
            self.unfolding._matrices["squared"] = squared
        return squared

    def explicit(self) -> PETSc.Mat:
        """Return the matrix with all of its entries, for small structures and for messages.  Collective."""
        if not self.is_complex:
            matrix = projected(self.A, self.unfolding, float(self.phase.real))
            if self._added is not None:
                owned = self._added[slice(*matrix.getOwnershipRange())]
                owned.sort_indices()
                added = _distributed(owned, self._n_owned, self.comm)
                matrix.axpy(1.0, added, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
                added.destroy()
            return matrix
        P = self.unfolding.at(self.phase)
        r = self.comm.rank
        owned = P[self.unfolding.v_ranges[r] : self.unfolding.v_ranges[r + 1]]
        real, imaginary = (_distributed(part.tocsr(), self._n_owned, self.comm) for part in (owned.real, owned.imag))
        return _projected_in_real_form(self.A, real, imaginary, self._added, self.comm)


def _projected_in_real_form(A: PETSc.Mat, P: PETSc.Mat, Q: PETSc.Mat, added: sp.csr_matrix | None, comm: MPI.Comm) -> PETSc.Mat:
    """Return T^H A T + B in real form, T = P + i Q: P^T A P + Q^T A Q + i (P^T A Q - Q^T A P).  Collective; destroys P and Q."""
    AP, AQ = A.matMult(P), A.matMult(Q)
    real, more, imaginary = P.transposeMatMult(AP), Q.transposeMatMult(AQ), P.transposeMatMult(AQ)
    real.axpy(1.0, more, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    other = imaginary.transpose(PETSc.Mat())
    imaginary.axpy(-1.0, other, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    owned = real_rows(*(_owned_rows(part) for part in (real, imaginary)))
    if added is not None:
        first, last = real.getOwnershipRange()
        owned = (owned + real_matrix(added[first:last])).tocsr()
        owned.sort_indices()
    for operand in (P, Q, AP, AQ, real, more, imaginary, other):
        operand.destroy()
    csr = (owned.indptr.astype(PETSc.IntType), owned.indices.astype(PETSc.IntType), owned.data)
    explicit = PETSc.Mat().createAIJ(((owned.shape[0], None), (owned.shape[0], None)), csr=csr, comm=comm)
    explicit.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return explicit


def projected(A: PETSc.Mat, unfolding: Unfolding, phase: float) -> PETSc.Mat:
    """Return P(d)^T A P(d) of a real phase, (n_w, n_w).  Collective."""
    comm = A.comm.tompi4py()
    r, (w, v) = comm.rank, (unfolding.w_ranges, unfolding.v_ranges)
    P = _distributed(unfolding.at(phase)[v[r] : v[r + 1]], int(w[r + 1] - w[r]), comm)
    right = A.matMult(P)
    product = P.transposeMatMult(right)
    for operand in (P, right):
        operand.destroy()
    product = without_operands(product)
    for option in (PETSc.Mat.Option.SYMMETRIC, PETSc.Mat.Option.SYMMETRY_ETERNAL):
        product.setOption(option, True)
    return product


def _owned_rows(matrix: PETSc.Mat) -> sp.csr_matrix:
    """Return this rank's rows of a matrix, (n_owned, n), columns rising.  Local."""
    starts, columns, values = matrix.getValuesCSR()
    rows = sp.csr_matrix((values, columns, starts), (len(starts) - 1, matrix.getSize()[1]))
    rows.eliminate_zeros()
    rows.sort_indices()
    return rows


def _distributed(owned: sp.csr_matrix, n_columns_owned: int, comm: MPI.Comm) -> PETSc.Mat:
    """Return the matrix of which these are this rank's rows.  Collective."""
    csr = (owned.indptr.astype(PETSc.IntType), owned.indices.astype(PETSc.IntType), owned.data.astype(float))
    return PETSc.Mat().createAIJ(((owned.shape[0], None), (n_columns_owned, None)), csr=csr, comm=comm)


def _complex(X: np.ndarray) -> np.ndarray:
    """Return complex columns from the real parts of all and then the imaginary ones.  Local."""
    m = X.shape[1] // 2
    Z: np.ndarray = np.empty((len(X), m), dtype=complex, order="F")
    Z.real, Z.imag = X[:, :m], X[:, m:]
    return Z
