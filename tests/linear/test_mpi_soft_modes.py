"""Static solutions of a softly supported structure, corrected with its soft modes, give an accurate dynamic response."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from lattices import distributed, split_rows, truss
from mpi4py import MPI
from petsc4py import PETSc

from microslip.linear.factor import Factor
from microslip.linear.soft_modes import SoftModes

comm = MPI.COMM_WORLD
ELASTIC = 2236.0  # rad/s, the lowest elastic mode


@pytest.mark.parametrize("empty_rank", [None, 0])
@pytest.mark.parametrize("ratio, limit", [(1e-2, 1e-7), (1e-4, 1e-6), (1e-6, 1e-3)])
def test_soft_modes_make_the_dynamic_response_of_a_softly_supported_truss_accurate(empty_rank, ratio, limit):
    """K_L^-1 f is nearly a rigid motion, which rounding and errors of omega_k change."""
    _, free = truss()
    n = free.shape[0]
    K = (free + (ratio * ELASTIC) ** 2 * sp.identity(n)).tocsr()
    ranges = split_rows(n, comm.size, empty_rank)
    owned = slice(ranges[comm.rank], ranges[comm.rank + 1])
    A, M = distributed(comm, K, ranges), distributed(comm, sp.identity(n).tocsr(), ranges)
    A.setOption(PETSc.Mat.Option.SPD, True)
    factor = Factor(A)
    values, phi = comm.bcast(scipy.linalg.eigh(free.toarray()))
    omega_n = np.sqrt(np.maximum(values, 0.0) + (ratio * ELASTIC) ** 2)
    omega_n[:6] *= 1.0 + 1e-4  # error of an eigensolver
    forces = np.random.default_rng(2).standard_normal((n, 3))
    omega = 0.9 * omega_n[6]
    exact = np.linalg.solve(K.toarray() - omega**2 * np.eye(n), forces)
    dynamic = phi @ ((1.0 / (omega_n**2 - omega**2) - 1.0 / omega_n**2)[:, None] * (phi.T @ forces))

    def error() -> float:
        wrong = factor.solve(forces[owned]) + dynamic[owned] - exact[owned]
        return max(comm.allgather(abs(wrong).max(initial=0.0))) / abs(exact).max()

    assert error() > 20 * limit
    factor.soft_modes = SoftModes.of(comm, M, omega_n, phi[owned], omega)
    assert len(factor.soft_modes.omega_2) == 6 and error() < limit
    assert factor.inverse_entries(np.arange(3), np.arange(3)) is None
    assert SoftModes.of(comm, M, omega_n, phi[owned], ratio * ELASTIC) is None
    factor.destroy()
    A.destroy()
    M.destroy()
