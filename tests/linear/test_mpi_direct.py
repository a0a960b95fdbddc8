"""The direct solver: the order of elimination, the bridge to MUMPS, and other packages by options."""

import lattices
import numpy as np
import pytest
import scipy.sparse as sp
from lattices import distributed, split_rows
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse.linalg import spsolve

from microslip.assembly._rows import groups, upper_triangle
from microslip.linear import _mumps, direct
from microslip.linear.factor import Factor
from microslip.linear.ordering import elimination_order
from microslip.messages.errors import CaseError
from microslip.modes.inertia import count_below

comm = MPI.COMM_WORLD
SHAPE = (12, 6, 5)
K = lattices.lattice_stiffness(SHAPE)
N = K.shape[0]
JOINT = np.flatnonzero(np.arange(N) // 3 % 30 == 7)


def matrix(A=K, empty=None):
    A = distributed(comm, A, split_rows(A.shape[0], comm.size, empty))
    A.setOption(PETSc.Mat.Option.SPD, True)
    return A


def fill(A, positions):
    """Return the number of entries of the Cholesky factor of a pattern in an order, by symbolic elimination."""
    order = np.argsort(positions)
    place = np.empty(len(order), dtype=int)
    place[order] = np.arange(len(order))
    below = [{j for j in place[A.indices[A.indptr[i] : A.indptr[i + 1]]] if j > k} for k, i in enumerate(order)]
    for rows in below:
        if rows:
            parent = min(rows)
            below[parent] |= rows - {parent}
    return len(order) + sum(len(rows) for rows in below)


@pytest.mark.parametrize("empty", [None, 0, 1])
@pytest.mark.parametrize("last", [np.empty(0, dtype=int), JOINT], ids=["nothing", "joint"])
def test_an_order_is_a_permutation_with_the_joint_last(last, empty):
    solid = sp.kron(lattices.lattice_stiffness(SHAPE)[::3, ::3], np.ones((3, 3)), format="csr")
    order = elimination_order(matrix(solid, empty), last)
    positions = order.places
    if comm.rank > 0:
        assert len(positions) == len(order.starts) == 0
        return
    assert order.starts[0] == 1 and order.starts[-1] == N + 1 and len(order.starts) >= N // 3 + 1
    is_first = np.isin(np.arange(2, N + 1), order.starts)
    assert np.array_equal(np.diff(positions)[~is_first], np.ones(np.count_nonzero(~is_first)))  # groups are contiguous
    assert np.array_equal(np.sort(positions), np.arange(1, N + 1))
    assert set(positions[last]) == set(range(N - len(last) + 1, N + 1))
    nodes = np.sort(positions.reshape(-1, 3), axis=1)
    assert np.array_equal(nodes - nodes[:, :1], np.tile([0, 1, 2], (N // 3, 1)))  # rows with the same pattern are consecutive


@pytest.mark.ranks(1)
def test_the_order_reduces_the_fill():
    for last, ratio in ((np.empty(0, dtype=int), 0.75), (JOINT, 0.9)):
        assert fill(K, elimination_order(matrix(), last).places) < ratio * fill(K, np.arange(1, N + 1))


@pytest.mark.ranks(1)
def test_a_joint_larger_than_a_front_is_ordered_like_other_rows():
    many = np.arange(N // 2)
    of_many = elimination_order(matrix(), many)
    assert np.array_equal(of_many.places, elimination_order(matrix(), np.empty(0, dtype=int)).places)


@pytest.mark.parametrize("A", [sp.identity(1), sp.identity(7), lattices.chain(2, True)], ids=["one", "diagonal", "two"])
def test_tiny_matrices_are_factored(A):
    A = sp.csr_matrix(A, dtype=float)
    A_distributed = matrix(A)
    factor = Factor(A_distributed, last=np.array([0]))
    b = np.arange(1.0, A.shape[0] + 1.0)[:, None]
    owned = slice(*A_distributed.getOwnershipRange())
    np.testing.assert_allclose(factor.solve(b[owned]), spsolve(A.tocsc(), b).reshape(-1, 1)[owned], rtol=1e-12)
    factor.destroy()


@pytest.mark.ranks(1)
def test_consecutive_rows_with_the_same_pattern_are_one_group():
    A = sp.csr_matrix(np.array([[1, 1, 0, 0], [1, 1, 0, 0], [0, 0, 1, 1], [0, 1, 0, 1]], dtype=float))
    first, counts, columns = groups(matrix(A))
    assert (first.tolist(), counts.tolist(), columns.tolist()) == ([0, 2, 3], [2, 2, 2], [0, 1, 2, 3, 1, 3])


@pytest.mark.parametrize("scale", [np.empty(0), 2.0 ** (np.arange(N) % 9)], ids=["unscaled", "scaled"])
@pytest.mark.parametrize("sigma", [None, 0.3])
@pytest.mark.parametrize("empty", [None, 0, 1])
def test_the_upper_triangle_of_owned_rows_is_exact(empty, sigma, scale):
    """Each position occurs once; M has entries where A has none, and vice versa."""
    mass = sp.csr_matrix(sp.diags([0.01, 0.25, 0.01], [-1, 0, 1], shape=(N, N)))
    A = matrix(empty=empty)
    i, j, a = upper_triangle(A, None if sigma is None else matrix(mass, empty), sigma or 0.0, scale)
    S = sp.diags(scale) if len(scale) else sp.identity(N)
    first, end = A.getOwnershipRange()
    expected = np.zeros((N, N))
    expected[first:end] = np.triu((S @ (K - (sigma or 0.0) * mass) @ S).toarray())[first:end]
    assert i.dtype == j.dtype == np.int32
    assert np.array_equal(sp.coo_matrix((a, (i - 1, j - 1)), (N, N)).toarray(), expected)
    assert len(set(zip(i.tolist(), j.tolist()))) == len(a)


@pytest.mark.parametrize("empty", [None, 0, 1])
def test_signs_of_pivots_count_the_modes_below_a_shift(empty):
    """With and without the order of the factor; M has entries where K has none, and vice versa."""
    mass = sp.csr_matrix(sp.diags([0.01, 0.25, 0.01], [-1, 0, 1], shape=(N, N)))
    A, M = matrix(empty=empty), matrix(mass, empty=empty)
    L = np.linalg.inv(np.linalg.cholesky(mass.toarray()))
    squares = np.linalg.eigvalsh(L @ K.toarray() @ L.T)
    factor = Factor(A, last=JOINT)
    for n_below in (1, 40, N - 1):
        sigma = 0.5 * (squares[n_below - 1] + squares[n_below])
        if squares[n_below] - squares[n_below - 1] < 1e-6 * squares[n_below]:
            continue
        assert count_below(A, M, sigma, factor.solver.order) == count_below(A, M, sigma) == n_below
    factor.destroy()


def test_the_count_does_not_depend_on_units_of_rows():
    """Rows scaled by 1e-6 to 1e6 have the same signs of pivots, and no pivot counts as zero."""
    units = sp.diags(10.0 ** np.random.default_rng(0).integers(-6, 7, N))
    squares = np.linalg.eigvalsh(K.toarray())
    sigma = 0.5 * (squares[9] + squares[10])
    assert squares[10] - squares[9] > 1e-6 * squares[10]
    A, M = matrix(sp.csr_matrix(units @ K @ units)), matrix(sp.csr_matrix(units @ units))
    assert count_below(A, M, sigma) == 10


def test_a_factor_reports_its_order():
    A = matrix()
    factor = Factor(A, last=JOINT)
    assert factor.info["ordering"] == "METIS" and factor.info["package"] == "mumps"
    factor.destroy()


def test_another_package_gives_the_same_solutions(monkeypatch):
    """Cholesky of PETSc on one rank; LU of MUMPS by the interface of PETSc on several."""
    options = PETSc.Options()
    given = {"static_pc_factor_mat_solver_type": "petsc"} if comm.size == 1 else {"static_pc_type": "lu"}
    if comm.size > 1:
        given["static_pc_factor_mat_solver_type"] = "mumps"
    for name, value in given.items():
        options[name] = value
    A = matrix()
    factor = Factor(A, last=JOINT)
    assert factor.info["package"] == ("petsc" if comm.size == 1 else "mumps") and factor.solver.order is None
    B = np.random.default_rng(1).standard_normal((N, 2))
    owned = slice(*A.getOwnershipRange())
    X = spsolve(K.tocsc(), B)
    np.testing.assert_allclose(factor.solve(B[owned]), X[owned], atol=1e-10 * abs(X).max())
    np.testing.assert_allclose(factor.solve(sp.csc_matrix(B)), X[owned], atol=1e-10 * abs(X).max())
    assert factor.inverse_entries(JOINT, JOINT) is None
    assert direct.foreseen(A, 3, 100) is None
    factor.destroy()
    for name in given:
        options.delValue(name)


def test_another_version_of_mumps_is_refused(monkeypatch):
    monkeypatch.setattr(_mumps, "BUILT_FOR", "4.10.0")
    with pytest.raises(CaseError, match=r"built for MUMPS 4\.10\.0, and PETSc has .*install it again"):
        Factor(matrix())
