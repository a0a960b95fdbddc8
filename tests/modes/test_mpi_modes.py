"""Modes against lattices with known frequencies and matrices of Ansys; multiplicity, completeness, signs."""

from pathlib import Path

import lattices
import numpy as np
import pytest
import scipy.sparse as sp
from lattices import distributed, split_rows
from mpi4py import MPI
from petsc4py import PETSc

from microslip.linear import factor as factors
from microslip.linear.dense import gram, multiply
from microslip.linear.factor import Factor
from microslip.linear.joint_springs import Linearised, linearise
from microslip.messages.errors import CaseError, ConvergenceError
from microslip.modes import eigen, inertia
from microslip.modes.eigen import lowest_modes
from microslip.modes.inertia import count_below, find_gap
from microslip.modes.rayleigh import sharpened
from microslip.modes.shift_invert import ModeSearch

comm = MPI.COMM_WORLD
SMALL, LARGE = (6, 3, 2), (12, 7, 6)  # 108 DOFs: LAPACK; 1512: SLEPc


class MatricesOnly:
    """A system of two matrices."""

    def __init__(self, dof=None):
        self.comm, self.dof, self.parts, self.part_names = comm, dof, None, ()
        self.maps, self.is_complex = self, False


def structure(K, M, empty_rank=None, dof=None):
    ranges = split_rows(K.shape[0], comm.size, empty_rank)
    K_L, M = distributed(comm, K, ranges), distributed(comm, M, ranges)
    K_L.setOption(PETSc.Mat.Option.SPD, True)
    return Linearised(MatricesOnly(dof), K_L, M, Factor(K_L))


def chains(n_chains, n=20):
    """Return K of equal separate chains, and the frequencies of a chain of unit masses."""
    return sp.kron(sp.identity(n_chains), lattices.chain(n, True)).tocsr(), 2 * np.sin(np.arange(1, n + 1) * np.pi / (2 * n + 2))


def assert_modes(linearised, modes):
    """Check residual and orthonormality with matrix products."""
    M_phi = multiply(linearised.M, modes.phi_owned)
    residual = multiply(linearised.K_L, modes.phi_owned) - M_phi * modes.omega_n**2
    size = gram(comm, M_phi, M_phi).diagonal() * modes.omega_n**4
    assert np.all(gram(comm, residual, residual).diagonal() < 1e-12 * size)
    np.testing.assert_allclose(gram(comm, modes.phi_owned, M_phi), np.eye(len(modes.omega_n)), atol=1e-10)
    assert np.all(np.diff(modes.omega_n) >= 0.0)


@pytest.mark.parametrize("shape, n_modes", [(SMALL, 1), (SMALL, 20), (SMALL, 108), (LARGE, 1), (LARGE, 30)])
@pytest.mark.parametrize("empty_rank", [None, 1])
def test_frequencies_of_a_lattice_are_exact(shape, n_modes, empty_rank):
    system, pairs = lattices.lattice(comm, shape, empty_rank=empty_rank)
    linearised = linearise(system, pairs)
    modes = lowest_modes(linearised, n_modes)
    np.testing.assert_allclose(modes.omega_n, lattices.lattice_frequencies(shape)[:n_modes], rtol=1e-11)
    assert_modes(linearised, modes)
    linearised.destroy()


def test_frequencies_of_matrices_of_ansys_equal_those_of_ansys():
    """The clamped beam of hex20 has double bending modes (tests/data/README.md)."""
    with np.load(Path(__file__).parents[1] / "data" / "ansys_hex_beam.npz") as data:
        K, M = (sp.csr_matrix((data[f"{name}_data"], data[f"{name}_indices"], data[f"{name}_indptr"])) for name in "KM")
    K, M = K + sp.triu(K, 1).T, sp.kron(M + sp.triu(M, 1).T, sp.identity(3)).tocsr()
    linearised = structure(K, M)
    modes = lowest_modes(linearised, 6)
    ansys = [1283.20036921, 1283.20036921, 5781.97486169, 6919.39887714, 6919.39887714, 10172.61497694]
    np.testing.assert_allclose(modes.omega_n / (2 * np.pi), ansys, rtol=1e-11)
    assert_modes(linearised, modes)
    linearised.destroy()


@pytest.mark.parametrize("n_modes, multiplicity", [(35, 30), (20, 30), (3, 12)])
def test_all_modes_of_a_multiple_eigenvalue_are_computed(n_modes, multiplicity):
    """The last requested mode may be within the multiple eigenvalue."""
    K, omega = chains(multiplicity, n=450 // multiplicity)
    linearised = structure(K, sp.identity(K.shape[0]))
    modes = lowest_modes(linearised, n_modes)
    np.testing.assert_allclose(modes.omega_n, np.sort(np.repeat(omega, multiplicity))[:n_modes], rtol=1e-11)
    assert_modes(linearised, modes)
    linearised.destroy()


def test_a_multiple_mode_spans_the_exact_subspace():
    K, _ = chains(3, n=150)
    linearised = structure(K, sp.identity(450))
    modes = lowest_modes(linearised, 3)
    shape = np.sqrt(2.0 / 151) * np.sin(np.arange(1, 151) * np.pi / 151)
    exact = sp.kron(sp.identity(3), shape[:, None]).toarray()[slice(*linearised.M.getOwnershipRange())]
    cosines = np.linalg.svd(gram(comm, exact, modes.phi_owned), compute_uv=False)
    np.testing.assert_allclose(cosines, 1.0, atol=1e-10)
    linearised.destroy()


@pytest.mark.parametrize("n_dof", [300, 600])
def test_modes_of_a_mostly_massless_chain_are_those_of_the_condensed_chain(n_dof):
    """A chain with twelve masses has twelve modes."""
    mass = np.zeros(n_dof)
    mass[5 :: n_dof // 12] = 2.0
    K, loaded = lattices.chain(n_dof, True), np.flatnonzero(mass)
    flexibility = np.linalg.inv(K.toarray())[np.ix_(loaded, loaded)]
    omega = np.sort((2.0 * np.linalg.eigvalsh(flexibility)) ** -0.5)
    linearised = structure(K, sp.diags(mass))
    for n_modes in (5, len(loaded)):
        np.testing.assert_allclose(lowest_modes(linearised, n_modes).omega_n, omega[:n_modes], rtol=1e-9)
    with pytest.raises(CaseError, match=f"modes = 20, but the structure has only {len(loaded)}"):
        lowest_modes(linearised, 20)
    linearised.destroy()


def test_low_modes_are_accurate_with_very_stiff_springs():
    """Two unit masses, each on a unit spring, joined by a spring of 1e12: omega = 1 and sqrt(1 + 2e12)."""
    joined = np.array([[1.0, -1.0], [-1.0, 1.0]])
    linearised = structure(sp.csr_matrix(np.eye(2) + 1.0e12 * joined), sp.identity(2))
    np.testing.assert_allclose(lowest_modes(linearised, 2).omega_n, [1.0, np.sqrt(1.0 + 2.0e12)], rtol=1e-4)
    linearised.destroy()
    linearised = structure(sp.csr_matrix(np.eye(2) + 1.0e6 * joined), sp.identity(2))
    np.testing.assert_allclose(lowest_modes(linearised, 2).omega_n, [1.0, np.sqrt(1.0 + 2.0e6)], rtol=1e-10)
    linearised.destroy()


@pytest.mark.study
def test_low_frequencies_of_a_fine_mesh_are_corrected_by_the_rayleigh_quotient():
    """The first eigenvalues of a long chain are 1e8 smaller than the largest; the quotient corrects an error of 1e-6."""
    n = 12_000
    linearised = structure(lattices.chain(n, True), sp.identity(n))
    angle = np.arange(1, 3) * np.pi / (n + 1)
    exact = 4.0 * np.sin(0.5 * angle) ** 2
    phi = np.sqrt(2.0 / (n + 1)) * np.sin(np.outer(np.arange(1, n + 1), angle))
    phi_owned = phi[slice(*linearised.M.getOwnershipRange())]
    np.testing.assert_allclose(sharpened(linearised, exact * (1.0 + 1e-6), phi_owned), exact, rtol=1e-13)
    np.testing.assert_allclose(lowest_modes(linearised, 2, verify=False).omega_n, np.sqrt(exact), rtol=1e-13)
    linearised.destroy()


def test_more_modes_than_dofs_are_refused():
    linearised = structure(lattices.chain(7, True), sp.identity(7))
    with pytest.raises(CaseError, match="modes = 8, but the structure has 7 degrees of freedom"):
        lowest_modes(linearised, 8)
    linearised.destroy()


@pytest.mark.parametrize("n_below", [0, 1, 7, 100, 599])
def test_inertia_counts_the_modes_below_a_shift(n_below):
    linearised = structure(lattices.chain(600, True), sp.identity(600))
    eigenvalues = np.append(
        4 * np.sin(np.arange(601) * np.pi / 1202) ** 2, 5.0
    )  # including 0, for a shift below the first eigenvalue
    sigma = 0.5 * (eigenvalues[n_below] + eigenvalues[n_below + 1])
    assert count_below(linearised.K_L, linearised.M, sigma) == n_below
    linearised.destroy()


def test_the_shift_of_the_proof_is_in_a_gap():
    """The gap is above the requested modes, or just below the multiple eigenvalue at their end."""
    assert find_gap(np.array([1.0, 2.0, 3.0]), 1) == (1, 1.5)
    assert find_gap(np.array([1.0, 2.0, 2.0, 3.0]), 2) == (3, 2.5)
    for eigenvalues, n_below in (([1.0, 2.0, 2.0], 1), ([1.0, 2.0], 1), ([2.0, 2.0], 0)):
        computed, sigma = find_gap(np.array(eigenvalues), 2)
        assert computed == n_below and 1.99999 < sigma < 2.0


@pytest.mark.slow
@pytest.mark.ranks(1, 2)
def test_a_missing_mode_below_a_multiple_eigenvalue_is_detected(monkeypatch):
    """The first search skips a mode below many equal ones."""
    solve, calls = ModeSearch.lowest, []

    def incomplete(*args):
        theta, phi_owned, _, info = solve(*args)
        calls.append(len(theta))
        first = len(calls) == 1
        return theta[first:], phi_owned[:, first:], None, info

    monkeypatch.setattr(ModeSearch, "lowest", incomplete)
    monkeypatch.setattr(eigen, "_DENSE", 50)
    stiffness = np.where(np.arange(150) == 60, 0.999, np.where(np.arange(150) < 120, 1.0, 2.0))
    linearised = structure(sp.diags(stiffness).tocsr(), sp.identity(150))
    np.testing.assert_allclose(lowest_modes(linearised, 5).omega_n ** 2, [0.999, 1.0, 1.0, 1.0, 1.0], rtol=1e-10)
    assert len(calls) > 1
    linearised.destroy()


@pytest.mark.parametrize("always", [False, True])
def test_a_missing_mode_is_detected(monkeypatch, always):
    """The solver skips the third mode, once or always; the count detects it, and the search is repeated or fails."""
    solve, calls = ModeSearch.lowest, []

    def incomplete(*args):
        theta, phi_owned, _, info = solve(*args)
        calls.append(len(theta))
        if always or len(calls) == 1:
            theta, phi_owned = np.delete(theta, 2), np.delete(phi_owned, 2, axis=1)
        return theta, phi_owned, None, info

    monkeypatch.setattr(ModeSearch, "lowest", incomplete)
    linearised = structure(lattices.chain(450, True), sp.identity(450))
    if always:
        monkeypatch.setattr(ModeSearch, "renew", lambda self, n_missing: None)  # it would extend the space to all modes
        with pytest.raises(ConvergenceError, match="modes found below .*, where .* lie"):
            lowest_modes(linearised, 6)
    else:
        exact = 2 * np.sin(np.arange(1, 7) * np.pi / 902)
        np.testing.assert_allclose(lowest_modes(linearised, 6).omega_n, exact, rtol=1e-10)
        assert len(calls) == 2
    linearised.destroy()


def test_modes_with_errors_of_rounding_are_corrected(monkeypatch):
    system, pairs = lattices.lattice(comm, LARGE)
    linearised, solve = linearise(system, pairs), ModeSearch.lowest

    def with_noise(*args):
        theta, phi, _, info = solve(*args)
        noise = multiply(linearised.K_L, np.random.default_rng(comm.rank).standard_normal(phi.shape))
        return theta, phi + 2e-5 * np.abs(phi).max() * noise / np.abs(noise).max(), None, info

    monkeypatch.setattr(ModeSearch, "lowest", with_noise)
    modes = lowest_modes(linearised, 12)
    assert modes.info["residual"] < 1e-6
    np.testing.assert_allclose(modes.omega_n, lattices.lattice_frequencies(LARGE)[:12], rtol=1e-10)
    linearised.destroy()


def test_wrong_modes_are_refused(monkeypatch):
    solve = ModeSearch.lowest

    def inaccurate(*args):
        theta, phi_owned, _, info = solve(*args)
        return theta, phi_owned + 1e-3 * np.roll(phi_owned, 1, axis=1), None, info

    monkeypatch.setattr(ModeSearch, "lowest", inaccurate)
    linearised = structure(lattices.chain(450, True), sp.identity(450))
    with pytest.raises(ConvergenceError, match="mode 1 at .* Hz"):
        lowest_modes(linearised, 6)
    linearised.destroy()


def test_signs_do_not_depend_on_the_partition():
    """Modes of a symmetric chain have two largest components; the first one in the numbering of the user is positive."""
    n, reverse = 455, np.arange(455)[::-1]  # all maxima of modes 1 to 4 are at masses
    for dof in (None, np.stack([reverse, np.full(n, -1), np.full(n, -1)], axis=1)):
        linearised = structure(lattices.chain(n, True), sp.identity(n), empty_rank=0, dof=dof)
        modes = lowest_modes(linearised, 4)
        phi = np.concatenate(comm.allgather(modes.phi_owned))
        phi = phi if dof is None else phi[reverse]  # in the numbering of the user
        exact = np.sqrt(2.0 / (n + 1)) * np.sin(np.outer(np.arange(1, n + 1), np.arange(1, 5)) * np.pi / (n + 1))
        np.testing.assert_allclose(phi, exact, atol=1e-8)
        linearised.destroy()


def test_modes_use_the_only_factor_of_K_L(monkeypatch):
    """Modes factor only K_L - sigma M for the proof, and do not change the factor of K_L."""
    linearised = structure(lattices.chain(600, True), sp.identity(600))
    shifts, factorise = [], inertia.factorise
    monkeypatch.setattr(inertia, "factorise", lambda *of, **how: shifts.append(how["shift"]) or factorise(*of, **how))
    monkeypatch.setattr(factors, "factorise", None)
    b_owned = np.ones((linearised.M.getLocalSize()[0], 1))
    x_owned = linearised.factor.solve(b_owned)
    for n_proofs in (1, 2):
        lowest_modes(linearised, 5, verify=False)
        assert len(shifts) == n_proofs - 1
        lowest_modes(linearised, 5, verify=True)
        assert len(shifts) == n_proofs
    np.testing.assert_array_equal(linearised.factor.solve(b_owned), x_owned)
    linearised.destroy()
