"""Modes of complex matrices in real form: the search has one vector of each plane, and multiple eigenvalues are complete."""

import numpy as np
import pytest
import scipy.sparse as sp
from lattices import distributed
from mpi4py import MPI
from petsc4py import PETSc

from microslip.assembly.real_form import real_matrix
from microslip.linear.dense import multiply
from microslip.linear.factor import Factor
from microslip.linear.joint_springs import Linearised
from microslip.modes import shift_invert
from microslip.modes.eigen import _with_following, lowest_modes
from microslip.modes.rayleigh import smoothed

comm = MPI.COMM_WORLD
PHASE = 0.7


class ComplexMatrices:
    """A system of two complex matrices."""

    comm, dof, parts, part_names, is_complex = comm, None, None, (), True

    @property
    def maps(self):
        """Return the system itself."""
        return self


def structure(K, M):
    """Return complex matrices in real form, with a factor; the two rows of a DOF belong to one rank."""
    ranges = 2 * np.linspace(0, K.shape[0], comm.size + 1).astype(int)
    K_L, M = distributed(comm, real_matrix(K), ranges), distributed(comm, real_matrix(M), ranges)
    K_L.setOption(PETSc.Mat.Option.SPD, True)
    return Linearised(ComplexMatrices(), K_L, M, Factor(K_L))


def ring(n):
    """Return K of a ring of n unit masses that is closed with a phase, and its frequencies, which all differ."""
    K = sp.diags([2.0 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1], dtype=complex).tolil()
    K[n - 1, 0], K[0, n - 1] = -np.exp(1j * PHASE), -np.exp(-1j * PHASE)
    waves = (2.0 * np.pi * np.arange(n) + PHASE) / n
    return K.tocsr(), np.sort(2.0 * np.abs(np.sin(0.5 * waves)))


@pytest.mark.ranks(1, 2)
def test_the_search_space_has_one_vector_of_each_plane(monkeypatch):
    K, omega = ring(400)
    linearised, solves, products, converged = structure(K, sp.identity(400)), [], [], shift_invert._converged
    solve = linearised.factor.solver.solve
    monkeypatch.setattr(linearised.factor.solver, "solve", lambda B: solves.append(B.shape[1]) or solve(B))

    def of_basis(eps, linearised):
        theta, phi_owned, info = converged(eps, linearised)
        other = 1j * phi_owned.T.copy().view(complex)
        M_other = multiply(linearised.M, other.view(float).T)
        products.append(np.abs(comm.allreduce(phi_owned.T @ M_other)).max())
        return theta, phi_owned, info

    monkeypatch.setattr(shift_invert, "_converged", of_basis)
    modes = lowest_modes(linearised, 20)
    np.testing.assert_allclose(modes.omega_n, omega[:20], rtol=1e-10)
    assert modes.info["basis"] == 20 + 8 and sum(solves) < 80 and set(solves) == {1}
    assert len(products) == 1 and products[0] < 1e-6
    linearised.destroy()


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize(("accuracy", "n_searches"), [(1e-3, 1), (0.0, 2)])
def test_the_proof_needs_an_estimate_of_the_next_mode(monkeypatch, accuracy, n_searches):
    """Without one of that accuracy, a further search computes that mode."""
    K, omega = ring(400)
    linearised, searches, converged = structure(K, sp.identity(400)), [], shift_invert._converged
    monkeypatch.setattr(shift_invert, "_FOR_PROOF", accuracy)
    monkeypatch.setattr(shift_invert, "_converged", lambda *of: searches.append(of) or converged(*of))
    modes = lowest_modes(linearised, 6)
    np.testing.assert_allclose(modes.omega_n, omega[:6], rtol=1e-10)
    sigma = float(modes.info["proof"].split()[-2])
    assert modes.n_proved == 6 and omega[5] < 2.0 * np.pi * sigma < omega[6]
    assert len(searches) == n_searches
    linearised.destroy()


def test_an_estimate_below_a_mode_is_not_that_of_the_next_one():
    eigenvalues, info = np.array([1.0, 4.0]), {"method": "SLEPc"}
    for theta, expected in ((0.125, [1.0, 4.0, 8.0]), (0.5, [1.0, 4.0])):
        found, others = _with_following(eigenvalues, info | {"following": (theta,)})
        np.testing.assert_array_equal(found, expected)
        assert others == info
    np.testing.assert_array_equal(_with_following(eigenvalues, info)[0], eigenvalues)


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize("n_rings", [2, 3])
def test_multiple_eigenvalues_are_complete(n_rings):
    """A Krylov space of equal rings has one mode of each eigenvalue; the count shows the others, which further searches compute."""
    K, omega = ring(300)
    linearised = structure(sp.kron(sp.identity(n_rings), K).tocsr(), sp.identity(300 * n_rings))
    modes = lowest_modes(linearised, 5)
    np.testing.assert_allclose(modes.omega_n, np.repeat(omega[:5], n_rings)[:5], rtol=1e-9)
    assert "proof" in modes.info
    linearised.destroy()


@pytest.mark.ranks(1, 2)
def test_a_search_for_more_modes_than_masses_ends_with_all_modes():
    """Of 400 DOFs eight have mass: a search for twelve modes returns eight."""
    K, _ = ring(400)
    mass = np.zeros(400)
    mass[::50] = 1.0
    linearised = structure(K, sp.diags(mass).tocsr())
    modes = lowest_modes(linearised, 12, allows_fewer=True)
    inertial = np.linalg.inv(K.toarray())[::50, ::50]
    np.testing.assert_allclose(modes.omega_n, np.sort(1.0 / np.sqrt(np.linalg.eigvalsh(inertial))), rtol=1e-9)
    linearised.destroy()


@pytest.mark.ranks(1, 2)
def test_products_of_ritz_vectors_need_no_solve():
    """The Krylov relation gives K_L^-1 M times Ritz vectors, also with both vectors of a plane."""
    K, _ = ring(100)
    rng, linearised, steps = np.random.default_rng(3), structure(K, sp.identity(100)), 30
    A, V = np.linalg.inv(K.toarray()), np.linalg.qr(rng.normal(size=(100, 1)) + 1j * rng.normal(size=(100, 1)))[0]
    for _ in range(steps):
        V = np.linalg.qr(np.hstack([V, A @ V[:, -1:]]))[0]
    theta, Q = np.linalg.eigh(V[:, :steps].conj().T @ A @ V[:, :steps])
    theta, phi = theta[:-4:-1], V[:, :steps] @ Q[:, :-4:-1]
    first, last = (row // 2 for row in linearised.M.getOwnershipRange())
    twice = np.hstack([phi, 1j * phi[:, :1]])[first:last]
    eigenvalues, smooth_owned, forces = smoothed(linearised, np.append(theta, theta[0]), twice, V[first:last, -1:])
    smooth = np.concatenate(comm.allgather(smooth_owned))
    exact = np.linalg.qr(A @ phi)[0]
    squares, X = np.linalg.eigh(exact.conj().T @ K @ exact)
    np.testing.assert_allclose(eigenvalues, squares, rtol=1e-11)
    np.testing.assert_allclose(np.abs((exact @ X).conj().T @ smooth), np.eye(3), atol=1e-11)
    for product_owned, expected in zip(forces, (K @ smooth, smooth), strict=True):
        np.testing.assert_allclose(product_owned, expected[first:last], atol=1e-11)
    linearised.destroy()
