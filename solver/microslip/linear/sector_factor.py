"""The factor of a sector between its faces, which all nodal diameters of a disc share (docs/theory.md, section 14).

The rows between the faces are eliminated once.  The Schur complement S on both faces is real; that of a nodal diameter is
P(d)^H S P(d), a complex Hermitian matrix of the size of one face.  The rows of a joint are eliminated last, from S, so that
static columns of its pairs are products of small matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from petsc4py import PETSc
from scipy.linalg import blas, lapack

from ..assembly.sectors import Sectors
from ..guards.memory import refuse_beyond
from ..messages.errors import CaseError, ConvergenceError
from ..parallel.agree import on_root
from ..parallel.petsc import free
from ..system.memory import give_back
from . import bridge, mumps
from .dense import add_springs
from .lockstep import at_once
from .ordering import Elimination, Order

if TYPE_CHECKING:
    from ..assembly.system import System

_PREFIX, _OF_INERTIA = "static_", "modes_inertia_"  # of the PETSc options
_BLOCK = 64  # columns that LAPACK eliminates together, five times as fast as one by one
_MOST = 52  # right-hand sides of several nodal diameters in one pass over the factor
_FEW = 8  # right-hand sides that wait for those of other nodal diameters; of more, a pass for each is as fast
_LARGE = "the two faces of [cyclic] with {} degrees of freedom"
_FEWER = "mesh the faces of the sector more coarsely, or lay them where the sector is thinner"


@dataclass(frozen=True, eq=False)
class Boundary:
    """The rows of a sector that are not eliminated; ``joint`` come first, then ``faces``, both rising, of the sector's rows."""

    faces: np.ndarray  # (n_f,) both faces, and the pairs between sectors
    joint: np.ndarray  # (n_j,) of pairs within the sector, where they are few
    leading: np.ndarray  # (n_wf,) rows of w that the faces depend on
    P: tuple[sp.csr_matrix, sp.csr_matrix]  # (n_f, n_wf) of :class:`.wave_matrix.Unfolding`

    @classmethod
    def of(cls, sectors: Sectors, K_J: np.ndarray) -> Boundary:
        """Return the boundary of a sector, for springs ``K_J`` (3 n_pairs,) of its pairs.  Local; the same on every rank."""
        unfolding, R, R_next = sectors.unfolding, (sectors.sector.R @ sectors.T).tocsr(), (sectors.R_next @ sectors.T).tocsr()
        P_0, P_1 = unfolding.P
        between = np.diff(R_next.indptr) > 0
        of_pairs = np.union1d(R[between].indices, R_next.indices)
        followed = unfolding.rows_of_w(np.unique(P_1.indices))
        high = np.flatnonzero(np.diff(P_1.indptr))
        is_of_high = np.zeros(P_0.shape[0], dtype=bool)
        is_of_high[np.flatnonzero(np.diff(P_0.indptr) == 0)] = True  # fixed at the other face, too
        faces = np.unique(np.concatenate([of_pairs, followed, high, np.flatnonzero(is_of_high)])).astype(int)
        joint = np.setdiff1d(R[~between].indices, faces)
        joint = joint if len(joint) <= P_0.shape[0] ** (2.0 / 3.0) else joint[:0]
        leading = np.unique(np.concatenate([P_0[faces].indices, P_1[faces].indices]))
        return cls(faces, joint, leading, (P_0[faces][:, leading].tocsr(), P_1[faces][:, leading].tocsr()))

    @property
    def rows(self) -> np.ndarray:
        """All of them, (n_j + n_f,)."""
        return np.concatenate([self.joint, self.faces])

    def at(self, phase: complex) -> sp.csr_matrix:
        """Return P(d) of the faces, (n_f, n_wf).  Local."""
        return (self.P[0] + phase * self.P[1]).tocsr()


@dataclass(frozen=True, eq=False)
class _Folded:
    """P(d)^H S P(d) of a symmetric S on the faces: same + cos(d alpha) even + i sin(d alpha) odd, (n_wf, n_wf) column-major."""

    same: np.ndarray  # P_0^T S P_0 + P_1^T S P_1
    even: np.ndarray  # B + B^T, B = P_0^T S P_1
    odd: np.ndarray  # B - B^T

    @classmethod
    def of(cls, S: np.ndarray, boundary: Boundary) -> _Folded:
        """Return it of S (n_f, n_f), both triangles.  Local."""
        P_0, P_1 = boundary.P
        of_low, of_high = (P.T @ S.T for P in (P_0, P_1))  # by rows, as sparse products read it
        same, other = (P_0.T @ of_low.T + P_1.T @ of_high.T).T, (P_1.T @ of_low.T).T
        return cls(*(np.asfortranarray(each) for each in (same, other + other.T, other - other.T)))

    def at(self, phase: complex, between: np.ndarray | None) -> np.ndarray:
        """Return it at a nodal diameter with the springs to the next sector, eq. (14.8), (n_wf, n_wf), column-major.  Local."""
        S: np.ndarray = np.empty(self.same.shape, dtype=type(phase), order="F")
        np.multiply(self.even, np.real(phase), out=S.real)
        S.real += self.same
        if np.iscomplexobj(phase):
            np.multiply(self.odd, np.imag(phase), out=S.imag)
        if between is not None:
            S += between
        return S


class SectorFactor:
    """K_L of a sector with both faces free: its factor between the boundary, and the Schur complement on that, eq. (14.7).

    Methods are collective unless they state otherwise.

    Attributes
    ----------
    info : MUMPS' report
    """

    def __init__(self, sectors: Sectors, K_J: np.ndarray):
        """Factor.  Collective.

        Raises
        ------
        CaseError : MUMPS cannot be called
        ResourceError : not enough memory; on every rank
        """
        self.sectors, self.K_J, system = sectors, K_J, sectors.sector
        self.comm = system.comm
        if not bridge.is_there(self.comm):
            raise CaseError("[cyclic]: without the bridge to MUMPS discs are not computed; install microslip with MUMPS' headers")
        self.boundary = Boundary.of(sectors, K_J)
        n_f, n_j = len(self.boundary.faces), len(self.boundary.joint)
        self._order: Order | None = None  # in which all of its matrices are eliminated
        room = 8.0 * (3.0 * (n_f + n_j) ** 2) * (self.comm.rank == 0)
        refuse_beyond(self.comm, room, _LARGE.format(n_f), _FEWER)
        S, self.info, self.interior = self.without_interior(self.boundary.rows)
        self.is_definite = self.info["code"] == 0 and self.info["negative"] == 0 and self._eliminate_joint(S, n_j)
        self._counts: dict[float, _Inertia] = {}

    def without_interior(
        self, boundary: np.ndarray, sigma: float | None = None
    ) -> tuple[np.ndarray, dict[str, Any], mumps.MumpsFactor | None]:
        """Eliminate all rows but those of the boundary from K_L, or from K_L - sigma M; return S, a report, the factor.

        Collective.  S, on rank 0, has both triangles, and is the caller's.  Of K_L - sigma M only the signs of the pivots are
        stored.  There is no factor where nothing is eliminated.
        """
        start, shift = perf_counter(), None if sigma is None else (sigma, self.sectors.sector.M)
        prefix, what = (_PREFIX, "K_L of the sector") if shift is None else (_OF_INERTIA, "K_L - sigma M of the sector")
        K_L = self._K_L()
        try:
            if len(boundary) == K_L.getSize()[0]:
                return *_without_interior(K_L, boundary, shift), None
            analysed = mumps.analysed(K_L, prefix, what, elimination=Elimination(order=self._order), shift=shift, schur=boundary)
        finally:
            free(K_L)  # while it is factored, MUMPS' copy is enough
        self._order = analysed.order
        factor, info = mumps.factored(analysed, what, start)
        S, units = factor.take_schur(), factor.units
        if units is not None and len(S):
            S /= units[:, None]
            S /= units
        for j in range(len(S)):
            S[j + 1 :, j] = S[j, j + 1 :]
        return S, info, factor

    def _K_L(self) -> PETSc.Mat:
        """Return K_L of the sector with both faces, (n_v, n_v), with the springs of the pairs within it.  Collective.

        It is in memory until MUMPS has it: products are those of K and of springs.
        """
        R, is_within = (self.sectors.sector.R @ self.sectors.T).tocsr(), np.diff(self.sectors.R_next.indptr) == 0
        return add_springs(self.sectors.sector.K, springs_of(R, self.K_J * is_within))

    def _eliminate_joint(self, S: np.ndarray, n_j: int) -> bool:
        """Eliminate the rows of the joint from S, which is overwritten; return whether they are definite.  Collective."""

        def eliminated() -> tuple[np.ndarray, np.ndarray, _Folded] | None:
            try:
                L = scipy.linalg.cholesky(S[:n_j, :n_j]).T if n_j else np.zeros((0, 0))
            except np.linalg.LinAlgError:
                return None
            X, of_faces = _substituted(L, S[:n_j, n_j:]), S[n_j:, n_j:]
            of_faces -= X.T @ X
            return L, X, _Folded.of(of_faces, self.boundary)

        self.dense = on_root(self.comm, eliminated, share=False)
        return bool(self.comm.bcast(self.dense is not None))

    def count_below(self, sigma: float, system: System) -> int:
        """Return how many eigenvalues of a nodal diameter lie below ``sigma``: one factorisation for each new sigma.  Collective.

        Raises
        ------
        ConvergenceError : sigma is an eigenvalue to working precision; on every rank
        """
        if sigma not in self._counts:
            self._counts[sigma] = _Inertia(self, sigma)
        return self._counts[sigma].count(system)

    def forget(self) -> None:
        """Free the matrices of proofs and of static columns; they are computed again when needed.  Local."""
        self._counts.clear()
        vars(self).pop("_of_joint", None)

    @property
    def shifts(self) -> tuple[float, ...]:
        """The shifts that there is a factor for."""
        return tuple(self._counts)

    def springs_on_faces(self, system: System) -> np.ndarray | None:
        """Return the springs to the next sector at a nodal diameter, on the rows that the faces depend on, (n_wf, n_wf).  Local.

        None: there are none.
        """
        between = springs_of(system.R, self.K_J * (np.diff(self.sectors.R_next.indptr) > 0))
        leading = self.boundary.leading
        return between[leading][:, leading].toarray() if between.nnz else None

    def solved(self, requests: Sequence[tuple[DiameterFactor, np.ndarray | sp.csc_matrix]]) -> list[np.ndarray]:
        """Return solutions at nodal diameters for forces on the sector's rows, both real and then imaginary parts.

        Collective: one pass over the factor for every ``_MOST`` columns.  Forces are this rank's rows (n_v_owned, q), or sparse
        (n_v, q) and the same on every rank; solutions are this rank's rows without those of the high face, (n_w_owned, q).
        """
        solutions: list[np.ndarray] = []
        while len(solutions) < len(requests):
            rest = requests[len(solutions) :]
            ends = np.cumsum([F.shape[1] for _, F in rest])
            n = max(int(np.searchsorted(ends, _MOST, side="right")), 1)
            F = rest[0][1] if n == 1 else np.hstack([F for _, F in rest[:n]])
            solutions += np.split(self._solved(F, [diameter for diameter, _ in rest[:n]], ends[: n - 1]), ends[: n - 1], axis=1)
        return solutions

    def _solved(self, F: np.ndarray | sp.csc_matrix, diameters: Sequence[DiameterFactor], ends: np.ndarray) -> np.ndarray:
        """Return the solutions of one pass, whose columns belong to ``diameters``, split before ``ends``.  Collective."""
        unfolding, comm, rows = self.sectors.unfolding, self.comm, self.boundary.rows
        w_owned = int(np.diff(unfolding.w_ranges)[comm.rank])
        if self.interior is not None:
            reduced = self.interior.reduced(F)
            x = self.on_boundary(reduced, diameters, ends) if comm.rank == 0 else reduced
            return self.interior.expanded(x)[:w_owned]
        gathered = comm.gather(F) if not sp.issparse(F) else [F.toarray()]
        x = np.empty((0, F.shape[1]))
        if comm.rank == 0 and gathered is not None:
            of_all = np.concatenate(gathered)
            x = np.zeros_like(of_all)
            x[rows] = self.on_boundary(of_all[rows], diameters, ends)
        return comm.bcast(x)[unfolding.v_ranges[comm.rank] :][:w_owned]

    def on_boundary(self, F: np.ndarray, diameters: Sequence[DiameterFactor], ends: np.ndarray) -> np.ndarray:
        """Return S(d)^-1 F on joint and faces, (n_j + n_f, q), of columns as in :meth:`_solved`, eq. (14.9).

        Local, rank 0.  The matrices of the joint are real, and are applied to the columns of all diameters.
        """
        assert self.dense is not None, "of a definite matrix"
        L_j, X, _ = self.dense
        of_joint = _substituted(L_j, F[: len(L_j)])
        forces = np.split(F[len(L_j) :] - X.T @ of_joint, ends, axis=1)
        of_faces = np.hstack([diameter.on_faces(each) for diameter, each in zip(diameters, forces)])
        return np.concatenate([_substituted(L_j, of_joint - X @ of_faces, trans=1), of_faces])

    @cached_property
    def _of_joint(self) -> tuple[np.ndarray, np.ndarray]:
        """The inverse of S on the joint with fixed faces, (n_j, n_j), and the joint's motion with the faces, (n_j, n_f)."""
        assert self.dense is not None, "of a definite matrix"
        L_j, X, _ = self.dense
        inverse_L = _substituted(L_j, np.eye(len(L_j)))
        return inverse_L.T @ inverse_L, -(inverse_L.T @ X)

    def with_fixed_faces(self, left: sp.csr_matrix, right: sp.csc_matrix) -> np.ndarray:
        """Return left @ S^-1 @ right with fixed faces, (m_l, m_r), for maps of the boundary.  Local, rank 0."""
        n_j = len(self.boundary.joint)
        return (right[:n_j].T @ (left[:, :n_j] @ self._of_joint[0]).T).T

    def carried_by_faces(self, forces: sp.csc_matrix) -> np.ndarray:
        """Return forces (n_j + n_f, m) on the boundary condensed to the faces, (n_f, m).  Local, rank 0."""
        n_j = len(self.boundary.joint)
        return (forces[:n_j].T @ self._of_joint[1]).T + forces[n_j:].toarray()

    def destroy(self) -> None:
        """Free the factor.  Collective."""
        if self.interior is not None:
            self.interior.destroy()


def springs_of(R: sp.csr_matrix, K_J: np.ndarray) -> sp.csr_matrix:
    """Return R^H K_J R, (n, n) Hermitian [N/m].  Local."""
    return (R.conj().T @ sp.diags(K_J) @ R).tocsr()


def _without_interior(
    A: PETSc.Mat, boundary: np.ndarray, shift: tuple[float, PETSc.Mat] | None
) -> tuple[np.ndarray, dict[str, Any]]:
    """Return A, or A - sigma M, of a sector that consists of its faces, and a report.  Collective."""

    def dense(matrix: PETSc.Mat) -> np.ndarray:
        starts, columns, values = matrix.getValuesCSR()
        rows = matrix.comm.tompi4py().gather(sp.csr_matrix((values, columns, starts), (len(starts) - 1, matrix.getSize()[1])))
        return np.zeros((0, 0)) if rows is None else sp.vstack(rows).toarray()[np.ix_(boundary, boundary)]

    S = dense(A) if shift is None else dense(A) - shift[0] * dense(shift[1])
    none = {
        "code": 0,
        "negative": 0,
        "null": 0,
        "entries": 0,
        "ordering": "none",
        "memory_MB": 0,
        "memory_max_MB": 0,
        "flops": 0.0,
    }
    return np.asfortranarray(S), none | {"package": "mumps", "seconds": 0.0, "out_of_core": False, "messages": ()}


class _Inertia:
    """Negative pivots of K_L - sigma M of a sector between its faces, and the Schur complement, for all nodal diameters."""

    def __init__(self, of_sector: SectorFactor, sigma: float):
        """Eliminate.  Collective: one factorisation."""
        self.of_sector, self.sigma = of_sector, sigma
        give_back()  # memory of the searches: the peak would be here
        S, info, pivots = of_sector.without_interior(of_sector.boundary.faces, sigma)
        if pivots is not None:
            pivots.destroy()
        if info["code"] in mumps.SINGULAR or info["null"] > 0:
            raise ConvergenceError(
                f"modes: K_L - sigma M of the sector is singular at sigma = {sigma:.6e} rad2/s2, so that its negative pivots "
                "prove nothing; state one [solver] mode more or less"
            )
        self.n_between = info["negative"]
        self.folded = on_root(of_sector.comm, _Folded.of, S, of_sector.boundary, share=False)

    def count(self, system: System) -> int:
        """Return the number of eigenvalues below sigma at a nodal diameter.  Collective."""
        of_sector, phase = self.of_sector, system.phase
        between = of_sector.springs_on_faces(system)

        def negative() -> int:
            S = self.folded.at(phase, between)
            scale = np.exp2(-np.round(0.5 * np.log2(np.maximum(np.abs(S.diagonal()), np.finfo(float).tiny))))
            S *= scale[:, None]
            S *= scale
            return negative_eigenvalues(S)

        return self.n_between + on_root(of_sector.comm, negative)


def _substituted(L: np.ndarray, B: np.ndarray, trans: int = 0) -> np.ndarray:
    """Return L^-1 B of a lower triangle, or L^-T B; LAPACK refuses those without rows.  Local."""
    return scipy.linalg.solve_triangular(L, B, lower=True, trans=trans, check_finite=False) if len(L) else B


def negative_eigenvalues(S: np.ndarray) -> int:
    """Return how many eigenvalues of a symmetric or Hermitian matrix are negative: the signs of its pivots by LAPACK.

    Local; S, column-major, is overwritten.
    """
    if len(S) == 0:
        return 0
    factor = lapack.zhetrf if np.iscomplexobj(S) else lapack.dsytrf
    pivots, blocks, _ = factor(S, lower=1, lwork=_BLOCK * len(S), overwrite_a=1)
    is_single = blocks > 0
    return int(np.count_nonzero(pivots.diagonal().real[is_single] < 0.0) + np.count_nonzero(~is_single) // 2)


def packed_cholesky(S: np.ndarray) -> np.ndarray | None:
    """Return the Cholesky factor of a symmetric or Hermitian matrix (n, n), one triangle, (n (n + 1) / 2,); None: there is none.

    Local.  LAPACK's rectangular full packed format: half the memory, and as fast as the square.
    """
    is_complex = np.iscomplexobj(S)
    if len(S) == 0:
        return np.zeros(0, dtype=S.dtype)
    packed, _ = (lapack.ztrttf if is_complex else lapack.dtrttf)(S, uplo="L")
    L, info = (lapack.zpftrf if is_complex else lapack.dpftrf)(len(S), packed, uplo="L", overwrite_a=1)
    return L if info == 0 else None


def packed_solve(L: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return S^-1 B, (n, m), with the factor L of S by :func:`packed_cholesky`.  Local."""
    if B.size == 0:
        return B
    X, _ = (lapack.zpftrs if np.iscomplexobj(L) else lapack.dpftrs)(len(B), L, np.asfortranarray(B, dtype=L.dtype), uplo="L")
    return X


def packed_gram(L: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return B^H S^-1 B, (m, m), as :func:`packed_solve` with half the products.  Local."""
    if B.size == 0:
        return np.zeros(2 * B.shape[1:], dtype=B.dtype)
    is_complex = np.iscomplexobj(L)
    Y = (lapack.ztfsm if is_complex else lapack.dtfsm)(1.0, L, np.asfortranarray(B, dtype=L.dtype), uplo="L")
    G = blas.zherk(1.0, Y, trans=2) if is_complex else blas.dsyrk(1.0, Y, trans=1)
    return G + np.triu(G, 1).conj().T


@dataclass(eq=False)
class DiameterFactor:
    """The factor of K_L(d), a :class:`.direct.DirectSolver`: that of the sector, and of the small Schur complement.

    Rows are those of K_L(d), in real form where the phase is complex.
    """

    of_sector: SectorFactor
    system: System  # of the nodal diameter, with its own maps
    L: np.ndarray | None = None  # of P(d)^H S P(d), packed, on rank 0, while solves need it
    order: Order | None = None

    @classmethod
    def of(cls, of_sector: SectorFactor, system: System) -> tuple[DiameterFactor, dict[str, Any]]:
        """Return the factor and its report; "code" is one of MUMPS' where there is none.  Collective."""
        factor = cls(of_sector, system)
        is_definite = of_sector.is_definite and on_root(of_sector.comm, factor._is_factored)
        info = dict(of_sector.info) | {"face": len(of_sector.boundary.leading)}
        return factor, info | ({"negative": 0} if is_definite else {"code": mumps.SINGULAR[-1]})

    def _is_factored(self) -> bool:
        """Factor P(d)^H S P(d), eq. (14.8), where that is not done; return whether it is definite.  Local, rank 0."""
        if self.L is None:
            assert self.of_sector.dense is not None, "of a definite matrix"
            S = self.of_sector.dense[2].at(self.system.phase, self.of_sector.springs_on_faces(self.system))
            self.L = packed_cholesky(S)
        return self.L is not None

    def _packed(self) -> np.ndarray:
        """Return the factor on the faces.  Local, rank 0."""
        self._is_factored()
        assert self.L is not None, "of a definite matrix"
        return self.L

    def forget(self) -> None:
        """Free the factor on the faces; it is computed again when needed.  Local."""
        self.L = None

    @property
    def _is_complex(self) -> bool:
        return self.system.is_complex

    def solve(self, B: np.ndarray | sp.csc_matrix) -> np.ndarray:
        """Return this rank's rows of A^-1 B, (n_owned, m), column-major, unchecked.

        Collective, for dense B with others in lockstep.  B is this rank's rows, or sparse (n_dof, m) and the same on every rank.
        """
        unfolding, comm = self.of_sector.sectors.unfolding, self.of_sector.comm
        if sp.issparse(B):
            B = B.tocsr()
            parts = (sp.hstack([B[0::2], B[1::2]]) if self._is_complex else B).tocoo()
            rows = unfolding.rows_of_w(parts.row)
            F = sp.csc_matrix((parts.data, (rows, parts.col)), (int(unfolding.v_ranges[-1]), parts.shape[1]))
            return self._in_real_form(self.of_sector.solved([(self, F)])[0])
        (n_rows, m), copies = B.shape, 1 + self._is_complex
        F = np.zeros((int(np.diff(unfolding.v_ranges)[comm.rank]), copies * m), order="F")
        for k in range(copies):
            F[: n_rows // copies, k * m : (k + 1) * m] = B[k::copies]
        request, solved = (self, F), self.of_sector.solved
        return self._in_real_form(at_once(solved, request) if F.shape[1] <= _FEW else solved([request])[0])

    def _in_real_form(self, X_owned: np.ndarray) -> np.ndarray:
        """Return complex columns, real and then imaginary parts, in real form.  Local."""
        if not self._is_complex:
            return X_owned
        m = X_owned.shape[1] // 2
        real: np.ndarray = np.empty((2 * len(X_owned), m), order="F")
        real[0::2], real[1::2] = X_owned[:, :m], X_owned[:, m:]
        return real

    def on_faces(self, F: np.ndarray) -> np.ndarray:
        """Return P_f S(d)^-1 P_f^H F, eq. (14.9), (n_f, q), real and then imaginary parts where complex.  Local, rank 0."""
        P, m = self._P, F.shape[1] // 2
        r = P.conj().T @ (F[:, :m] + 1j * F[:, m:] if self._is_complex else F)
        of_faces = P @ packed_solve(self._packed(), r)
        return np.hstack([of_faces.real, of_faces.imag]) if self._is_complex else of_faces

    @cached_property
    def _P(self) -> sp.csr_matrix:
        """P(d) of the faces.  Local."""
        return self.of_sector.boundary.at(self.system.phase)

    def inverse_entries(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray | None:
        """Return entries of A^-1 on rank 0, (0, 0) elsewhere; None where they belong to eliminated rows.  Collective."""
        unit = sp.identity((2 if self._is_complex else 1) * int(self.of_sector.sectors.unfolding.w_ranges[-1]), format="csr")
        return self.flexibility(unit[rows], unit[columns].T.tocsc())

    def flexibility(self, left: sp.csr_matrix, right: sp.csc_matrix) -> np.ndarray | None:
        """Return left @ A^-1 @ right, (m_l, m_r) on rank 0, (0, 0) elsewhere; None where the maps have eliminated rows.

        Collective; unchecked.  The maps are the same on every rank.
        """
        if not self._is_complex:
            return self._between(left, right)
        rows, forces = left[:, 0::2] - 1j * left[:, 1::2], right[0::2] + 1j * right[1::2]  # left x = Re(rows w)
        if rows.shape[0] % 2 or (rows[1::2] + 1j * rows[0::2]).nnz:
            G = self._between(rows, forces)
            return None if G is None else G.real
        G = self._between(rows[0::2], forces)  # of a complex map in real form
        return None if G is None else np.stack([G.real, G.imag], axis=1).reshape(2 * len(G), G.shape[1])

    def _between(self, left: sp.csr_matrix, right: sp.csc_matrix) -> np.ndarray | None:
        """Return left @ K_L(d)^-1 @ right as :meth:`flexibility`, complex where K_L(d) is, eq. (14.9).  Collective."""
        of_left, of_right = self._on_boundary(left.conj().T.tocsc()), self._on_boundary(right)
        if of_left is None or of_right is None:
            return None

        def product() -> np.ndarray:
            of_sector, P_H = self.of_sector, self._P.conj().T
            forces = P_H @ of_sector.carried_by_faces(of_right)
            G = of_sector.with_fixed_faces(of_left.conj().T.tocsr(), of_right)
            if of_left.shape == of_right.shape and not (of_left - of_right).nnz:
                return G + packed_gram(self._packed(), forces)
            motion = packed_solve(self._packed(), forces)
            return G + (P_H @ of_sector.carried_by_faces(of_left)).conj().T @ motion

        G = on_root(self.of_sector.comm, product, share=False)
        return np.zeros((0, 0)) if G is None else G

    def _on_boundary(self, forces: sp.csc_matrix) -> sp.csc_matrix | None:
        """Return forces (n_w, m) on the boundary, (n_j + n_f, m); None where some act on other rows.  Local."""
        rows, parts = self.of_sector.boundary.rows, forces.tocoo()
        order, loaded = np.argsort(rows), self.of_sector.sectors.unfolding.rows_of_w(parts.row)
        if not np.isin(loaded, rows).all():
            return None
        places = order[np.searchsorted(rows, loaded, sorter=order)]
        return sp.csc_matrix((parts.data, (places, parts.col)), (len(rows), parts.shape[1]))

    def count_below(self, sigma: float) -> int:
        """Return how many eigenvalues of the nodal diameter lie below ``sigma``.  Collective."""
        return self.of_sector.count_below(sigma, self.system)

    def destroy(self) -> None:
        """Free the data of this nodal diameter only.  Collective."""
        self.L = None
