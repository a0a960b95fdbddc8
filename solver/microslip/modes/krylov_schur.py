"""The lowest modes by an eigensolver of SLEPc, shift-invert at 0 with the kept factor: where the user's options name one.

Without a word of them the search is that of block_lanczos.py, which solves for many vectors at once and goes on where it was.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc
from slepc4py import SLEPc

from ..messages.errors import ConvergenceError
from ..system.watchdog import moved

if TYPE_CHECKING:
    from ..linear.joint_springs import Linearised

PREFIX = "modes_"
_TRIES = 3  # each in a space twice as large as the last
TOLERANCE = 1e-8  # residual of a mode, relative; the error of its eigenvalue is the square of it


class SlepcSearch:
    """The same search by SLEPc; each time anew."""

    def __init__(self, linearised: Linearised):
        self.linearised = linearised

    def lowest(self, n_wanted: int) -> tuple[np.ndarray, np.ndarray, dict]:
        """Return at least ``n_wanted`` (theta, phi): :func:`slepc_modes`.  Collective."""
        return slepc_modes(self.linearised, n_wanted)

    def renew(self) -> None:
        """Nothing: the search begins anew each time."""


def is_asked_for() -> bool:
    """Return whether the user's options say something of SLEPc's eigensolver.  Local."""
    return any(name.startswith(("eps_", "st_")) for name in PETSc.Options(PREFIX).getAll())


def slepc_modes(linearised: Linearised, n_wanted: int) -> tuple[np.ndarray, np.ndarray, dict]:
    """Return at least ``n_wanted`` (theta, phi) of K_L^-1 M, theta = 1 / omega_n^2 falling, phi^T M phi = I.

    Collective.  SLEPc solves with the kept factor; options with the prefix ``modes_`` choose another of its solvers.

    Raises
    ------
    ConvergenceError : fewer modes converged, in larger spaces too; on every rank
    """
    eps = SLEPc.EPS().create(linearised.K_L.comm)
    eps.setOptionsPrefix(PREFIX)
    eps.setOperators(linearised.K_L, linearised.M)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(0.0)
    eps.setDimensions(n_wanted, min(linearised.M.getSize()[0], max(2 * n_wanted, n_wanted + 20)))
    eps.setTolerances(TOLERANCE, 200)
    st = eps.getST()
    st.setType(SLEPc.ST.Type.SINVERT)
    st.setShift(0.0)
    ksp = _solves_with(linearised.factor)
    st.setKSP(ksp)
    eps.setFromOptions()
    try:
        said = _solve_with_room(eps, n_wanted, linearised.M.getSize()[0])
        theta, phi_owned, info = _converged(eps, linearised)
        return theta, phi_owned, info | {"said": said}
    finally:
        ksp.destroy()
        eps.destroy()


class _KeptFactor:
    """Preconditioner that is the kept factor, which SLEPc would free if it were given the factor's own KSP."""

    def __init__(self, factor):
        self.factor = factor

    def apply(self, pc, b: PETSc.Vec, x: PETSc.Vec) -> None:
        moved()
        x.setArray(self.factor.solver.solve(b.getArray()[:, None])[:, 0])


def _solves_with(factor) -> PETSc.KSP:
    """Return a KSP that solves with the kept factor and does not own it."""
    ksp = PETSc.KSP().create(factor.A.comm)
    ksp.setOptionsPrefix(f"{PREFIX}st_")
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(_KeptFactor(factor))
    return ksp


def _solve_with_room(eps: SLEPc.EPS, n_wanted: int, n_dof: int) -> tuple[str, ...]:
    """Solve, again in a space twice as large where too few modes converged; return what was said of it.  Collective.

    Raises
    ------
    ConvergenceError : fewer modes converged in the largest space, too; on every rank
    """
    said: list[str] = []
    for _ in range(_TRIES):
        eps.solve()  # what a signal ends in here cannot be freed any more
        basis = eps.getDimensions()[1]
        if _has_modes(eps, n_wanted):
            return tuple(said)
        said.append(f"modes: {eps.getConverged()} of {n_wanted} converged in a space of {basis}")
        eps.setDimensions(n_wanted, min(2 * basis, n_dof))
    raise ConvergenceError(
        f"{'; '.join(said)}: the last after {eps.getIterationNumber()} iterations (reason {eps.getConvergedReason()}); ask for "
        f"fewer [solver] modes, or try -{PREFIX}eps_max_it {2 * eps.getTolerances()[1]}"
    )


def _has_modes(eps: SLEPc.EPS, n_wanted: int) -> bool:
    """Return whether ``n_wanted`` modes converged, or all there are: the Krylov space broke down.

    Local; counts agree on all ranks.
    """
    return eps.getConverged() >= n_wanted or eps.getConvergedReason() == SLEPc.EPS.ConvergedReason.DIVERGED_BREAKDOWN


def _converged(eps: SLEPc.EPS, linearised: Linearised) -> tuple[np.ndarray, np.ndarray, dict]:
    n_found = eps.getConverged()
    phi_owned = np.zeros((linearised.M.getLocalSize()[0], n_found), order="F")
    vector = linearised.M.createVecRight()
    eigenvalues = np.zeros(n_found)
    for k in range(n_found):
        eigenvalues[k] = complex(eps.getEigenpair(k, vector)).real
        phi_owned[:, k] = vector.getArray()
    vector.destroy()
    info = {
        "method": f"SLEPc {eps.getType()}",
        "basis": eps.getDimensions()[1],
        "restarts": eps.getIterationNumber(),
        "complete": eps.getConvergedReason() == SLEPc.EPS.ConvergedReason.DIVERGED_BREAKDOWN,
    }
    order = np.argsort(eigenvalues)
    return 1.0 / eigenvalues[order], np.asfortranarray(phi_owned[:, order]), info
