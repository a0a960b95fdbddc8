"""Static solutions and modes of a structure without supports against dense inertia relief."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from lattices import distributed, split_rows, truss
from mpi4py import MPI
from petsc4py import PETSc

from microslip.linear.factor import Factor
from microslip.linear.joint_springs import Linearised
from microslip.messages.errors import CaseError
from microslip.modes.eigen import lowest_modes

comm = MPI.COMM_WORLD


class Free:
    """A truss without supports, its six rigid-body motions and the dense pseudo-inverse of its stiffness."""

    def __init__(self, shape=(3, 2, 2), stress=0.0, empty_rank=None, knows_motions=True):
        points, K = truss(*shape)
        n, rng = K.shape[0], np.random.default_rng(4)
        mass = np.repeat(rng.uniform(0.5, 2.0, n // 3), 3)
        self.n, self.K, self.mass = n, K.toarray(), mass
        arms = points - points.mean(axis=0)
        translations = [np.tile(axis, (len(points), 1)) for axis in np.eye(3)]
        self.motions = np.array([field.ravel() for field in (*translations, *(np.cross(axis, arms) for axis in np.eye(3)))]).T
        if stress:  # as with constant contact forces: K r is not zero for rotations
            change = rng.standard_normal((n, n))
            self.K = self.K + stress * np.abs(np.diag(self.K)).mean() / n * (change + change.T)
        gram = self.motions.T @ (mass[:, None] * self.motions)
        phi = scipy.linalg.solve_triangular(np.linalg.cholesky(gram), self.motions.T, lower=True).T
        self.P = np.eye(n) - phi @ (phi.T * mass)
        ranges = split_rows(n, comm.size, empty_rank)
        self.owned = slice(ranges[comm.rank], ranges[comm.rank + 1])
        self.A, self.M = distributed(comm, sp.csr_matrix(self.K), ranges), distributed(comm, sp.diags(mass).tocsr(), ranges)
        self.A.setOption(PETSc.Mat.Option.SPD, True)
        rigid_owned = np.asfortranarray(self.motions[self.owned]) if knows_motions else None
        self.system = SimpleNamespace(comm=comm, rigid_owned=rigid_owned, dof=None, loads=None, is_complex=False)
        self.system.maps = self.system
        self.factor = Factor(self.A, self.system, M=self.M)

    @property
    def inverse(self) -> np.ndarray:
        """K_L^+ of eq. (4.8), dense."""
        K = self.P.T @ self.K @ self.P
        Q = scipy.linalg.qr(self.mass[:, None] * self.motions)[0][:, 6:]  # basis of motions with phi_r^T M x = 0
        return Q @ np.linalg.solve(Q.T @ K @ Q, Q.T) @ self.P.T

    def destroy(self) -> None:
        self.factor.destroy()
        self.A.destroy()
        self.M.destroy()


@pytest.mark.parametrize("empty_rank", [None, 0])
@pytest.mark.parametrize("stress, knows_motions", [(0.0, True), (0.0, False), (1e-7, True)])
def test_solutions_equal_inertia_relief(empty_rank, stress, knows_motions):
    free = Free(stress=stress, empty_rank=empty_rank, knows_motions=knows_motions)
    forces = np.random.default_rng(1).standard_normal((free.n, 5))
    forces[:, 1] = free.motions[:, 4] * free.mass  # a rigid acceleration has no elastic motion
    forces[:, 2] = free.P.T @ forces[:, 2]
    assert free.factor.n_rigid == 6
    exact = free.inverse @ forces
    size = np.abs(exact).max()
    for solved in (free.factor.solve(forces[free.owned]), free.factor.solve(sp.csc_matrix(forces))):
        assert max(comm.allgather(np.abs(solved - exact[free.owned]).max(initial=0.0))) < 1e-10 * size
    assert np.abs(exact[:, 1]).max() < 1e-10 * size
    free.destroy()


def test_entries_of_the_inverse_equal_inertia_relief():
    free = Free(stress=1e-7)
    rows, columns = np.array([0, 3, 7, 20]), np.array([1, 3, 16])
    entries = free.factor.inverse_entries(rows, columns)
    if entries is not None and comm.rank == 0:
        np.testing.assert_allclose(
            entries, free.inverse[np.ix_(rows, columns)], rtol=1e-9, atol=1e-10 * np.abs(free.inverse).max()
        )
    free.destroy()


@pytest.mark.parametrize("shape, n_modes", [((3, 2, 2), 5), ((12, 4, 4), 8)])
@pytest.mark.parametrize("stress", [0.0, 1e-9])
def test_only_elastic_modes_are_computed(shape, n_modes, stress):
    """LAPACK and SLEPc compute them; the proof of completeness accounts for six lower eigenvalues."""
    free = Free(shape, stress=stress)
    linearised = Linearised(free.system, free.A, free.M, free.factor)
    modes = lowest_modes(linearised, n_modes)
    values, phi = scipy.linalg.eigh(free.P.T @ free.K @ free.P, np.diag(free.mass))
    np.testing.assert_allclose(modes.omega_n, np.sqrt(values[6 : 6 + n_modes]), rtol=1e-8)
    rigid_part = comm.allreduce((free.mass[free.owned, None] * free.motions[free.owned]).T @ modes.phi_owned)
    assert np.abs(rigid_part).max() < 1e-9 * np.sqrt(free.mass.sum())
    free.destroy()


def test_supported_motions_are_no_rigid_modes():
    points, K = truss()
    K = K.tolil()
    K[0, 0] += 1e6  # a spring to ground along x leaves five free motions
    ranges = split_rows(K.shape[0], comm.size)
    A, M = distributed(comm, K.tocsr(), ranges), distributed(comm, sp.identity(K.shape[0]).tocsr(), ranges)
    A.setOption(PETSc.Mat.Option.SPD, True)
    system = SimpleNamespace(comm=comm, rigid_owned=None, dof=None)
    factor = Factor(A, system, M=M)
    assert factor.n_rigid == 5
    factor.destroy()
    with pytest.raises(CaseError, match="moves freely in 5 ways"):
        Factor(A, SimpleNamespace(comm=comm, rigid_owned=np.zeros((A.getLocalSize()[0], 0)), dof=None), M=M)
    A.destroy()
    M.destroy()
