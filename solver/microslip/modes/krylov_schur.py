"""The lowest modes by SLEPc: Krylov-Schur, shift-invert at 0 with the kept factor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc
from slepc4py import SLEPc

from ..parallel.errors import ConvergenceError
from ..parallel.watchdog import moved

if TYPE_CHECKING:
    from ..linear.joint_springs import Linearised

PREFIX = "modes_"
TOLERANCE = 1e-8  # residual of a mode, relative; the error of its eigenvalue is the square of it


def slepc_modes(linearised: Linearised, n_wanted: int) -> tuple[np.ndarray, np.ndarray, dict]:
    """Return at least ``n_wanted`` (theta, phi) of K_L^-1 M, theta = 1 / omega_n^2 falling, phi^T M phi = I.

    Collective.  SLEPc solves with the kept factor; options with the prefix ``modes_`` choose another of its solvers.

    Raises
    ------
    ConvergenceError : fewer modes converged; on every rank
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
    eps.solve()  # what a signal ends in here cannot be freed any more
    try:
        _check_modes(eps, n_wanted)
        return _converged(eps, linearised)
    finally:
        ksp.destroy()
        eps.destroy()


class _KeptFactor:
    """Preconditioner that is the kept factor, which SLEPc would free if it were given the factor's own KSP."""

    def __init__(self, factor):
        self.factor = factor

    def apply(self, pc, b: PETSc.Vec, x: PETSc.Vec) -> None:
        moved()
        self.factor.ksp.getPC().getFactorMatrix().solve(b, x)


def _solves_with(factor) -> PETSc.KSP:
    """Return a KSP that solves with the kept factor and does not own it."""
    ksp = PETSc.KSP().create(factor.A.comm)
    ksp.setOptionsPrefix(f"{PREFIX}st_")
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(_KeptFactor(factor))
    return ksp


def _check_modes(eps: SLEPc.EPS, n_wanted: int) -> None:
    """Raise ConvergenceError unless ``n_wanted`` modes converged, or all there are: the Krylov space broke down.

    Local; counts agree on all ranks.
    """
    n_found = eps.getConverged()
    if n_found < n_wanted and eps.getConvergedReason() != SLEPc.EPS.ConvergedReason.DIVERGED_BREAKDOWN:
        raise ConvergenceError(
            f"{n_found} of {n_wanted} modes after {eps.getIterationNumber()} iterations (reason {eps.getConvergedReason()}); "
            f"try -{PREFIX}eps_ncv {4 * n_wanted}"
        )


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
