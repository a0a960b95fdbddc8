"""The lowest modes by SLEPc: an eigensolver of K_L^-1 M, shift-invert at 0, with solves by the factor of K_L.

docs/theory.md, section 4.  Krylov-Schur needs the fewest solves.  With a factor on disk, a pass over it costs more than the
vectors, and subspace iteration solves for all its vectors in one pass.  Subspace iteration is also used if the proof by inertia
shows missing modes: it converges to all copies of a multiple eigenvalue together, whereas a Krylov space contains one of them.

Of complex matrices in real form each mode spans a plane, v and i v.  A Krylov space contains v alone, up to rounding errors that
grow as modes converge; they are removed (:class:`_Partners`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc
from slepc4py import SLEPc

from ..assembly.real_form import complex_columns, real_columns
from ..assembly.wave_matrix import WaveMatrix, python_matrix, times
from ..linear.dense import column_norms, diagonal_owned, gram, multiply, wave_matrix
from ..linear.lockstep import at_once
from ..linear.random_signs import random_signs
from ..messages.errors import ConvergenceError
from ..messages.words import counted
from ..parallel.ownership import summed
from ..parallel.petsc import free
from ..system.watchdog import moved, patient
from .hermitian import complex_modes
from .rayleigh import Forces, iterated_once, smoothed

if TYPE_CHECKING:
    from ..linear.factor import Factor
    from ..linear.joint_springs import Linearised

PREFIX = "modes_"  # of the PETSc options
_TRIES = 3  # each in a space twice as large as the last
_TOLERANCE = 5e-7  # |K_L^-1 M phi - theta phi| / theta before the block of solves that ends a search
_FOR_PROOF = 1e-3  # the same of the first value that is not wanted, which bounds the shift of the proof from above
_NO_MASS = 1e-15  # of the largest theta: below it a motion has no mass
_MOST_ITERATIONS = 200
_MORE = (12, 1.0)  # vectors of a Krylov space beyond the wanted modes: at least, and per mode
_MORE_IN_PLANES = (5, 0.4)  # of complex matrices, whose vectors in real form are twice as long
_MORE_IN_BLOCKS = (12, 1.5, 96)  # for subspace iteration, with a maximum: a pass converges by a ratio of theta
_SAME = 1e-12  # relative distance of a vector from a multiple of another one whose product is reused
_BLOCKS = 3  # blocks of the size of the subspace that SLEPc allocates
_KEEP = 0.85  # fraction of the Krylov space retained at a restart: convergence is tested often, and little is discarded
_KEY = 40  # of the random start vectors


def basis_size(n_wanted: int, n_dof: int) -> int:
    """Return the largest number of vectors in a search for ``n_wanted`` modes.  Local."""
    return _BLOCKS * _subspace_size("subspace", n_wanted, n_dof)


def basis_of_planes(n_wanted: int, n_dof: int) -> int:
    """Return the number of vectors in real form in a search for ``n_wanted`` modes of complex (n_dof, n_dof) matrices.  Local.

    It is that of a search with one vector of each plane.
    """
    return 1 + _subspace_size("planes", n_wanted, n_dof)


def _subspace_size(kind: str, n_wanted: int, n_dof: int) -> int:
    """Return the dimension of the search space of an eigensolver for ``n_wanted`` modes.  Local."""
    if kind == "subspace":
        least, a_mode, most = _MORE_IN_BLOCKS
        return min(n_dof, n_wanted + int(np.clip(a_mode * n_wanted, least, most)))
    least, per_mode = _MORE_IN_PLANES if kind == "planes" else _MORE
    return min(n_dof, n_wanted + max(least, int(per_mode * n_wanted)))


class ModeSearch:
    """An incremental search for the lowest modes.

    Modes of earlier calls are a deflation space of Krylov-Schur, and a part of the initial space of subspace iteration.
    All methods are collective on the matrices' communicator.
    """

    def __init__(self, linearised: Linearised):
        self.linearised = linearised
        self._theta = np.zeros(0)  # descending
        self._is_complex = linearised.maps.is_complex  # all in real form, but for the modes
        kind, n_owned = (complex, 2) if self._is_complex else (float, 1)
        self._phi_owned = np.zeros((linearised.M.getLocalSize()[0] // n_owned, 0), kind, order="F")
        self._least = 0  # lower bound of the number of modes to compute
        has_rows = np.diff(linearised.M.getOwnershipRanges()).min() > 0
        self._in_blocks = "subspace" if has_rows else "krylovschur"  # SLEPc 3.18 cannot normalise a block without rows
        self._kind = self._in_blocks if linearised.factor.info.get("out_of_core") else "krylovschur"
        self._info: dict = {"basis": 0, "restarts": 0, "complete": False, "messages": ()}
        self._is_exhausted = False  # whether a basis of one vector of each plane met no further motion with mass
        self._n_solves = 0  # solves of SLEPc, each with a different start vector

    def lowest(self, n_wanted: int) -> tuple[np.ndarray, np.ndarray, Forces | None, dict]:
        """Return at least ``n_wanted`` (theta, phi) of K_L^-1 M, theta = 1 / omega_n^2 descending, phi^T M phi = I nearly.

        With them (K_L phi, M phi), for which phi^T M phi = I to roundoff, or None where they are not known.  If fewer motions
        have mass, all of them, with "complete" in the dictionary of information on the search.  "following" in there: an
        estimate of theta of the next mode of complex matrices, (1,); (): there is none.

        Raises
        ------
        ConvergenceError : fewer modes converged, also in larger spaces; on every rank
        """
        n_wanted, forces = max(n_wanted, self._least), None
        while n_wanted > len(self._theta) and not self._info["complete"]:
            theta, phi_owned, forces, info = self._more(n_wanted)
            self._theta, self._phi_owned = theta, np.asfortranarray(phi_owned)
            self._info = info | {"messages": (*self._info["messages"], *info["messages"])}
        return self._theta, self._phi_owned, forces, self._info

    def renew(self, n_missing: int) -> None:
        """Compute ``n_missing`` additional modes at the next call, including copies of multiple eigenvalues."""
        self._least = len(self._theta) + n_missing
        self._kind = self._in_blocks

    def _more(self, n_wanted: int) -> tuple[np.ndarray, np.ndarray, Forces | None, dict]:
        """Return at least ``n_wanted`` (theta, phi), more than stored so far, their forces, and information on the search."""
        linearised = self.linearised
        kind = PETSc.Options(PREFIX).getString("eps_type", self._kind)
        without_partners = self._is_complex and kind == "krylovschur" and not self._is_exhausted
        n_known = 0 if kind == "subspace" else self._phi_owned.shape[1]
        theta, phi_owned, next_owned, info = self._searched(kind, without_partners, n_known, n_wanted - n_known)
        if without_partners and (
            info["complete"] or theta.min() <= _NO_MASS * theta.max()
        ):  # whether no motion is left is decided with both vectors of each plane
            self._is_exhausted = True
            return self._more(n_wanted)
        if next_owned is not None:
            of_planes = complex_columns(phi_owned), complex_columns(next_owned)
            eigenvalues, phi_owned, forces = smoothed(linearised, theta, *of_planes)
            if not n_known:
                return 1.0 / eigenvalues, phi_owned, forces, info
            eigenvalues = np.append(1.0 / self._theta[:n_known], eigenvalues)
            order = np.argsort(eigenvalues)
            return 1.0 / eigenvalues[order], np.hstack([self._phi_owned, phi_owned])[:, order], None, info
        if self._is_complex:
            _, phi_owned = complex_modes(linearised.K_L, linearised.M, theta, phi_owned)
        if n_known:
            phi_owned = np.hstack([self._phi_owned, phi_owned])
        eigenvalues, phi_owned, forces = iterated_once(linearised, phi_owned, linearised.factor.solver.solve)
        return 1.0 / eigenvalues, phi_owned, forces, info

    def _searched(
        self, kind: str, without_partners: bool, n_known: int, n_sought: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, dict]:
        """Return (theta, phi) of ``n_sought`` modes beyond ``n_known``, all in real form, by SLEPc, and information on it.

        With one vector of each plane (``without_partners``) also the next vector of the basis, (n_owned, 1), else None.
        """
        linearised, before_owned, n_dof = self.linearised, self._phi_owned, self.linearised.M.getSize()[0]
        n_most = (n_dof // 2 if self._is_complex else n_dof) - n_known
        if self._is_complex:
            before_owned = real_columns(np.hstack([before_owned, 1j * before_owned]))
        if self._is_complex and not without_partners:
            n_sought, n_most = 2 * n_sought, 2 * n_most
        eps, M = SLEPc.EPS().create(linearised.K_L.comm), _with_fewer_products(linearised.M)
        partners = _Partners(eps.getBV(), M) if without_partners else None
        solves = _SolvesByFactor(linearised.factor, partners)
        ksp = _solver(linearised.K_L.comm, solves)
        start, *before = [_vector(linearised.M, column) for column in (self._start(), *before_owned.T)]
        eps.setOptionsPrefix(PREFIX)
        eps.setOperators(linearised.K_L, M)
        eps.setType(kind)
        eps.setDimensions(n_sought, _subspace_size("planes" if without_partners else kind, n_sought, n_most))
        if kind == "krylovschur":
            eps.setKrylovSchurRestart(_KEEP)
            eps.setKrylovSchurLocking(not without_partners)  # without, the residuals of all modes are multiples of one vector
        eps.setInitialSpace([start] if n_known else [*before, start])
        if n_known:
            eps.setDeflationSpace(before)
        _set_shift_invert(eps, ksp)
        if partners is not None:
            eps.setMonitor(partners.restarted)
        try:
            messages = _solve_with_room(eps, n_sought, n_most, partners)
            theta, phi_owned, info = _converged(eps, linearised)
            info = info | {"messages": messages}
            if partners is None:
                return theta, phi_owned, None, info
            return theta, phi_owned, partners.next_vector(), info | {"following": partners.following()}
        finally:
            if partners is not None:
                partners.destroy()
            free(start, *before, ksp, eps)
            if M is not linearised.M:
                free(M)
            solves.factor = solves.partners = None  # petsc4py may not free the object that refers to them

    def _start(self) -> np.ndarray:
        """Return a start vector, (n_owned,): random signs, plus loads divided by masses, which K_L^-1 M maps to static motions.

        Both have the same M-norm.  Collective; the same on any number of ranks.
        """
        M, system = self.linearised.M, self.linearised.system
        mass, (first, end) = diagonal_owned(M)[:, None], M.getOwnershipRange()
        parts = random_signs(first, end - first, 1, _KEY + self._n_solves)
        self._n_solves += 1
        loads = getattr(system, "loads", None)
        if loads is not None and loads.shape[1]:
            forces = np.asarray(loads.tocsr()[first:end].sum(axis=1)).reshape(-1, 1)
            parts = np.hstack([parts, np.divide(forces, mass, out=np.zeros_like(forces), where=mass > 0.0)])
        size = np.sqrt(np.maximum(gram(system.comm, parts, multiply(M, parts)).diagonal(), 0.0))
        return parts @ np.divide(1.0, size, out=np.ones_like(size), where=size > 0.0)


def _vector(A: PETSc.Mat, owned: np.ndarray) -> PETSc.Vec:
    """Return a vector with these owned rows.  Collective."""
    vector = A.createVecRight()
    vector.setArray(owned)
    return vector


class _Partners:
    """The vectors i v of a Krylov basis with the vectors v of complex matrices in real form.

    They are orthogonal to the whole basis but for rounding errors, which grow as much as those of a Lanczos method without
    reorthogonalisation.  Removed from every new vector, they stay far below the tolerance, and the basis has one vector of each
    plane.  All methods are collective.
    """

    def __init__(self, basis: SLEPc.BV, M: PETSc.Mat):
        self._basis = basis  # columns that are not in use are 0
        context = M.getPythonContext() if M.getType() == "python" else None
        self._products = context if isinstance(context, _Products) else None
        self._n_used = 0
        self._following: tuple[float, ...] = ()

    def begin(self) -> None:
        """Set all columns after the start vector to 0, before a search whose vectors are allocated."""
        self._forget(1)

    def removed_from(self, x: PETSc.Vec) -> None:
        """Make x orthogonal to i V in M, V the basis: x + i V (V^T M i x)."""
        i_x = x.duplicate()
        i_x.setArray(_times_i(x.getArray()))
        with self._columns(self._n_used):
            self._basis.multVec(1.0, 0.0, i_x, self._basis.dotVec(i_x))
        self._n_used = min(self._n_used + 1, self._basis.getSizes()[1])  # x becomes the next column
        i_x.setArray(_times_i(i_x.getArray()))
        x.axpy(1.0, i_x)
        i_x.destroy()
        if self._products is not None:
            self._products.take_for(x.getArray())

    def restarted(self, eps: SLEPc.EPS, iteration: int, n_converged: int, values: list, errors: list) -> None:
        """Set the columns to 0 that a restart has dropped: those after the copy of the last one.  SLEPc's monitor.

        After a breakdown there is no copy, and a new start vector after the converged ones.
        """
        following = zip(values[n_converged : n_converged + 1], errors[n_converged:])
        self._following = tuple(theta.real for theta, error in following if 0.0 < error < _FOR_PROOF)
        last = self._basis.getColumn(len(values))
        copy = last.copy()
        self._basis.restoreColumn(len(values), last)
        with self._columns(self._basis.getSizes()[1]):
            same = np.flatnonzero(np.abs(self._basis.dotVec(copy)) > 0.5)
        copy.destroy()
        self._forget((same[0] if len(same) else n_converged) + 1)

    def following(self) -> tuple[float, ...]:
        """Return theta of the first Ritz value that has not converged, if it is accurate enough for the proof.  Local."""
        return self._following

    def next_vector(self) -> np.ndarray:
        """Return the next vector of the basis, (n_owned, 1): the last column.  Local."""
        last = self._basis.getSizes()[1] - 1
        column = self._basis.getColumn(last)
        next_owned = column.getArray().copy()[:, None]
        self._basis.restoreColumn(last, column)
        return next_owned

    @contextmanager
    def _columns(self, n: int) -> Iterator[None]:
        """Let products be those of the first n columns, and not of a part that SLEPc works on."""
        active = self._basis.getActiveColumns()
        self._basis.setActiveColumns(0, n)
        yield
        self._basis.setActiveColumns(*active)

    def _forget(self, first: int) -> None:
        """Set the columns from ``first`` on to 0."""
        self._n_used = first
        for column in range(first, self._basis.getSizes()[1]):
            self._basis.scaleColumn(column, 0.0)

    def destroy(self) -> None:
        """Let go of the basis, which would outlive its solver: the solver refers to :meth:`restarted`."""
        self._basis.destroy()


def _times_i(x: np.ndarray) -> np.ndarray:
    """Return i x in real form.  Local."""
    return (1j * x.view(complex)).view(float)


def _with_fewer_products(M: PETSc.Mat) -> PETSc.Mat:
    """Return M of a nodal diameter with the products of :class:`_Products`, any other as it is.  Collective."""
    wave = wave_matrix(M)
    return M if wave is None else python_matrix(M.getSizes(), _Products(wave), M.comm)


class _Products:
    """The context of a PETSc matrix: M of one nodal diameter, whose products are those of a search.

    Two of the four products of a step are, but for rounding, with a multiple of the vector before: SLEPc's with a solution, after
    that with i times it (:class:`_Partners`), and that with a vector of the basis once it is normalised.
    """

    def __init__(self, wave: WaveMatrix):
        self._wave, self._times = wave, _ProductsAtOnce(wave.A)
        self._x_owned: np.ndarray | None = None  # vector with which others are compared, M x = s y, (n_owned, 1)
        self._y_owned, self._size = np.empty((0, 1)), 1.0  # latest product that was computed, and |x|^2
        self._s: complex = 1.0  # of x
        self._latest: complex = 1.0  # s of the latest request

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Multiply a vector, of a complex phase in real form; called by PETSc.  Collective."""
        column = x.getArray()[:, None]
        product = real_columns(self._product(complex_columns(column))) if self._wave.is_complex else self._product(column)
        y.setArray(product[:, 0])

    multTranspose = mult

    def _product(self, x_owned: np.ndarray) -> np.ndarray:
        """Return M x, (n_owned, 1): for a multiple of the vector before, complex where x is, that of its product.  Collective."""
        comm = self._wave.comm
        if self._x_owned is not None:
            s = summed(comm, np.vdot(self._x_owned, x_owned)).item() / self._size
            if column_norms(comm, x_owned - s * self._x_owned)[0] <= _SAME * abs(s) * np.sqrt(self._size):
                self._latest = s * self._s
                return self._latest * self._y_owned
        self._y_owned = self._wave.multiply(x_owned, lambda V_owned: at_once(self._times, V_owned, is_cheap=True))
        self._latest = 1.0
        self._compare_with(x_owned.copy())
        return self._y_owned

    def take_for(self, x: np.ndarray) -> None:
        """Take the latest product, with i x, for that with x in real form made orthogonal to i V, too.  Collective.

        What was removed, i V h, has no part in V^T M x nor, to first order, in x^T M x, for which SLEPc requests the product.
        """
        self._latest *= -1j
        self._compare_with(complex_columns(x[:, None]).copy())

    def _compare_with(self, x_owned: np.ndarray) -> None:
        """Store the vector (n_owned, 1) of the latest product.  Collective."""
        self._x_owned, self._s = x_owned, self._latest
        self._size = max(column_norms(self._wave.comm, x_owned)[0] ** 2, np.finfo(float).tiny)


@dataclass(frozen=True)
class _ProductsAtOnce:
    """Products with the matrix of a sector, of several nodal diameters at once."""

    A: PETSc.Mat

    def __call__(self, blocks_owned: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return this rank's rows of A V for every block V.  Collective."""
        ends = np.cumsum([block.shape[1] for block in blocks_owned[:-1]], dtype=int)
        return np.split(times(self.A, np.hstack(blocks_owned)), ends, axis=1)


class _SolvesByFactor:
    """Preconditioner that solves with the factor of K_L; SLEPc would free the KSP of the factor itself."""

    def __init__(self, factor: Factor, partners: _Partners | None = None):
        self.factor: Factor | None = factor
        self.partners = partners

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve for one right-hand side.  Collective."""
        x.setArray(self._solve(b.getArray()[:, None])[:, 0])
        if self.partners is not None:
            self.partners.removed_from(x)

    def matApply(self, pc: PETSc.PC, B: PETSc.Mat, X: PETSc.Mat) -> None:
        """Solve for a block of right-hand sides in one pass over the factor.  Collective."""
        X.getDenseArray()[:] = self._solve(B.getDenseArray())
        X.assemble()

    def _solve(self, B_owned: np.ndarray) -> np.ndarray:
        """Return this rank's rows of K_L^-1 B.  Collective."""
        assert self.factor is not None, "until the search ends"
        moved()
        return self.factor.solver.solve(B_owned)


def _solver(comm: PETSc.Comm, solves: _SolvesByFactor) -> PETSc.KSP:
    """Return a KSP that solves with the existing factor without owning it.  Collective."""
    ksp = PETSc.KSP().create(comm)
    ksp.setOptionsPrefix(f"{PREFIX}st_")
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(solves)
    pc.destroy()
    return ksp


def _set_shift_invert(eps: SLEPc.EPS, ksp: PETSc.KSP) -> None:
    """Let an eigensolver find the eigenvalues next to 0 by solves of a KSP; read its PETSc options.  Collective."""
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(0.0)
    eps.setPurify(False)  # saves a solve per mode
    eps.setTolerances(_TOLERANCE, _MOST_ITERATIONS)
    st = eps.getST()
    st.setType(SLEPc.ST.Type.SINVERT)
    st.setShift(0.0)
    st.setKSP(ksp)
    eps.setFromOptions()


def _solve_with_room(eps: SLEPc.EPS, n_wanted: int, n_most: int, partners: _Partners | None = None) -> tuple[str, ...]:
    """Solve, and repeat in a space twice as large if too few modes converged; return messages on it.  Collective.

    Raises
    ------
    ConvergenceError : fewer modes converged even in the largest space; on every rank
    """
    messages: list[str] = []
    for _ in range(_TRIES):
        with patient():
            try:
                if partners is not None:
                    eps.setUp()
                    partners.begin()
                eps.solve()
            except BaseException:
                eps.incRef()  # never freed: SLEPc cannot free a solver that was interrupted
                raise
        basis = eps.getDimensions()[1]
        if _has_modes(eps, n_wanted):
            return tuple(messages)
        messages.append(f"modes: {eps.getConverged()} of {n_wanted} converged in a space of {basis}")
        eps.setDimensions(n_wanted, min(2 * basis, n_most))
    raise ConvergenceError(
        f"{'; '.join(messages)}: the last after {counted(eps.getIterationNumber(), 'iteration')} (reason "
        f"{eps.getConvergedReason()}); ask "
        f"for fewer [solver] modes, or try -{PREFIX}eps_max_it {2 * eps.getTolerances()[1]}"
    )


def _has_modes(eps: SLEPc.EPS, n_wanted: int) -> bool:
    """Return whether ``n_wanted`` modes converged, or all existing modes, as the Krylov space broke down.

    Local; counts agree on all ranks.
    """
    return eps.getConverged() >= n_wanted or eps.getConvergedReason() == SLEPc.EPS.ConvergedReason.DIVERGED_BREAKDOWN


def _converged(eps: SLEPc.EPS, linearised: Linearised) -> tuple[np.ndarray, np.ndarray, dict]:
    """Return the converged (theta, phi), (n,) and (n_owned, n), and a report of the search.  Collective."""
    n_modes = eps.getConverged()
    phi_owned = np.zeros((linearised.M.getLocalSize()[0], n_modes), order="F")
    vector = linearised.M.createVecRight()
    theta = np.array([1.0 / eps.getEigenvalue(k).real for k in range(n_modes)])
    for k in range(n_modes):
        eps.getEigenvector(k, vector)
        phi_owned[:, k] = vector.getArray()
    vector.destroy()
    info = {
        "method": f"SLEPc {'.'.join(map(str, SLEPc.Sys.getVersion()))} {eps.getType()}",
        "basis": eps.getDimensions()[1],
        "restarts": eps.getIterationNumber(),
        "complete": eps.getConvergedReason() == SLEPc.EPS.ConvergedReason.DIVERGED_BREAKDOWN,
    }
    return theta, phi_owned, info
