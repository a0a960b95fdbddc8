"""The factor of K_L: residuals, springs, retries, and the name of a part that moves freely."""

import lattices
import numpy as np
import pytest
import scipy.sparse as sp
from lattices import distributed, split_rows
from mpi4py import MPI
from petsc4py import PETSc

from microslip.linear import mumps
from microslip.linear.factor import Factor
from microslip.linear.joint_springs import joint_stiffness, linearise
from microslip.messages.errors import CaseError, ConvergenceError, ResourceError

comm = MPI.COMM_WORLD
SHAPE = (6, 3, 2)


def spd(A, empty_rank=None):
    matrix = distributed(comm, A, split_rows(A.shape[0], comm.size, empty_rank))
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    return matrix


def owned(matrix, full):
    return full[slice(*matrix.getOwnershipRange())]


def random_columns(n_dof, m):
    return np.random.default_rng(m).standard_normal((n_dof, m))


@pytest.fixture(params=[None, 0, 1], ids=["all", "rank 0 empty", "rank 1 empty"])
def joined(request):
    system, pairs = lattices.lattice(comm, SHAPE, empty_rank=request.param)
    linearised = linearise(system, pairs)
    yield linearised, pairs
    linearised.destroy()


def test_stuck_springs_restore_the_uncut_lattice(joined):
    linearised, _ = joined
    expected = owned(linearised.K_L, lattices.lattice_stiffness(SHAPE)).toarray()
    indptr, columns, values = linearised.K_L.getValuesCSR() if comm.size == 1 else local_rows(linearised.K_L)
    computed = sp.csr_matrix((values, columns, indptr), expected.shape).toarray()
    np.testing.assert_allclose(computed, expected, atol=1e-9 * abs(lattices.STIFFNESS).max())


def local_rows(A):
    rows = [A.getRow(row) for row in range(*A.getOwnershipRange())]
    indptr = np.concatenate([[0], np.cumsum([len(columns) for columns, _ in rows])]).astype(int)
    empty = [np.zeros(0)]
    return indptr, np.concatenate([c for c, _ in rows] + empty).astype(int), np.concatenate([v for _, v in rows] + empty)


@pytest.mark.parametrize("m", [0, 1, 3, 40])
def test_solutions_of_dense_and_sparse_forces_are_exact(joined, m):
    linearised, _ = joined
    K_L = lattices.lattice_stiffness(SHAPE)
    B = random_columns(K_L.shape[0], m)
    X_owned = linearised.factor.solve(owned(linearised.K_L, B))
    X_sparse_owned = linearised.factor.solve(sp.csc_matrix(B))
    X = np.linalg.solve(K_L.toarray(), B)
    for computed in (X_owned, X_sparse_owned):
        np.testing.assert_allclose(computed, owned(linearised.K_L, X), rtol=0, atol=1e-12 * np.abs(X).max(initial=1e-30))
    assert linearised.factor.info["solves"] == 2 * m


def test_joint_stiffness_is_ordered_by_pair_and_direction():
    _, pairs = lattices.lattice(comm, SHAPE, k_t=2.0, k_n=5.0)
    assert joint_stiffness(pairs)[:6].tolist() == [2.0, 2.0, 5.0, 2.0, 2.0, 5.0]


@pytest.mark.parametrize("stiffness", [1e20, 1e300])
def test_springs_whose_rounding_exceeds_the_structure_are_refused(stiffness):
    with pytest.raises(CaseError, match="joint 'cut': tangential_stiffness: pair 0 has a spring of .* lost in rounding"):
        linearise(*lattices.lattice(comm, SHAPE, k_t=stiffness))


def test_negative_and_infinite_input_is_refused():
    system, pairs = lattices.lattice(comm, SHAPE, k_t=-1.0)
    with pytest.raises(CaseError, match="'cut'.*-1.0 N/m of pair 0"):
        linearise(system, pairs)
    system, pairs = lattices.lattice(comm, SHAPE)
    if comm.rank == comm.size - 1:
        system.K.setValue(system.n_dof - 1, system.n_dof - 1, np.nan)
    system.K.assemble()
    with pytest.raises(CaseError, match="stiffness matrix .* not finite"):
        linearise(system, pairs)


@pytest.mark.parametrize(
    "springs, motions",
    [
        ({"k_t": 0.0}, r"moves freely in 2 ways \(translation along y and z\)"),
        ({"k_n": 0.0}, r"moves freely in one way \(translation along x\)"),
        ({"k_t": 0.0, "k_n": 0.0}, r"moves freely in 3 ways \(translation along x, y and z\)"),
    ],
)
@pytest.mark.parametrize("empty_rank", [None, 0])
def test_a_body_without_support_by_its_joint_is_named(springs, motions, empty_rank):
    system, pairs = lattices.lattice(comm, SHAPE, walls=False, empty_rank=empty_rank, **springs)
    with pytest.raises(CaseError, match=motions) as error:
        linearise(system, pairs)
    assert "body 'right'" in str(error.value) and "body 'left'" not in str(error.value)


def test_connected_bodies_are_named_together():
    """Two joined halves without walls have three common motions."""
    system, _ = lattices.lattice(comm, SHAPE)
    K, n_end = lattices.lattice_stiffness(SHAPE).tolil(), 3 * SHAPE[1] * SHAPE[2]
    for row in [*range(n_end), *range(K.shape[0] - n_end, K.shape[0])]:
        K[row, row] -= lattices.STIFFNESS[row % 3]
    with pytest.raises(
        CaseError, match=r"body 'left' and body 'right' together move freely in 3 ways \(translation along x, y and z\)"
    ):
        Factor(spd(K.tocsr()), system)


def test_a_singular_structure_names_the_scene_file():
    system, pairs = lattices.lattice(comm, SHAPE, walls=False, k_t=0.0)
    with pytest.raises(
        CaseError, match=r"^fan.toml: K_L, the stiffness with all pairs stuck, is singular: body 'right' moves freely"
    ):
        linearise(system, pairs, "fan.toml")


def test_free_motions_are_named_with_and_without_a_mesh():
    points, K = lattices.truss()
    with pytest.raises(CaseError, match="the structure moves freely in 6 ways.*most at DOF"):
        Factor(spd(K))
    system = named(points)
    with pytest.raises(CaseError, match=r"6 ways \(translation along x, y and z, 3 rotations\)"):
        Factor(spd(K), system)
    hinge = sp.diags(1.0e7 * (np.arange(points.size) < 3))
    with pytest.raises(CaseError, match=r"3 ways \(3 rotations\)"):
        Factor(spd(K + hinge), system)


def named(points):
    class System:
        dof, parts, part_names = np.arange(points.size).reshape(-1, 3), None, ()

    return System


def test_indefinite_matrices_and_rows_without_stiffness_are_refused():
    _, K = lattices.truss()
    with pytest.raises(CaseError, match="not positive definite.*release energy"):
        Factor(spd(K - 1.0e4 * sp.identity(K.shape[0])))
    K = lattices.chain(9, True).tolil()
    K[4, :] = 0.0
    K[:, 4] = 0.0
    with pytest.raises(CaseError, match="1 of 9 degrees of freedom .* DOF 4"):
        Factor(spd(K.tocsr()))


def test_soft_springs_under_a_stiff_structure_are_not_singular():
    """The solution of a truss on springs of 1e-6 of the stiffness of its bars is a rigid motion."""
    points, K = lattices.truss()
    soft = 10.0
    factor = Factor(spd(K + soft * sp.identity(K.shape[0])), named(points))
    push = np.tile([1.0, 0.0, 0.0], len(points))[:, None]
    np.testing.assert_allclose(factor.solve(owned(factor.A, push)), owned(factor.A, push / soft), rtol=1e-8, atol=1e-10)
    factor.destroy()


def test_a_wrong_solution_is_detected():
    factor = Factor(spd(lattices.chain(60, True)))
    B_owned = owned(factor.A, random_columns(60, 20))
    X_owned = factor.solve(B_owned)
    wrong = X_owned.copy()
    wrong[:, 13] *= 1.01
    error, rounding = factor.relative_residual(B_owned, wrong)
    assert 0.003 < error < 0.03 and error > rounding
    factor.A.scale(1.1)  # the factor no longer belongs to the matrix
    factor.A.shift(2.0)
    with pytest.raises(ConvergenceError, match="residual"):
        factor.solve(B_owned)
    factor.destroy()


def test_too_little_workspace_is_increased(monkeypatch):
    K = lattices.lattice_stiffness((14, 9, 8))
    codes = []
    report = mumps.report
    monkeypatch.setattr(mumps, "report", lambda factor: codes.append(report(factor)["code"]) or report(factor))
    monkeypatch.setattr(mumps, "RELAXATION", (-70, 100))
    options = PETSc.Options()
    options["static_mat_mumps_icntl_14"] = -70
    factor = Factor(spd(K))
    assert codes[0] in (-8, -9) and codes[-1] == 0
    factor.destroy()
    monkeypatch.setattr(mumps, "RELAXATION", (-70,))
    with pytest.raises(ResourceError, match="not enough memory"):
        Factor(spd(K))
    options.delValue("static_mat_mumps_icntl_14")


def test_options_override_defaults():
    options = PETSc.Options()
    options["static_mat_mumps_icntl_7"] = 0
    factor = Factor(spd(lattices.chain(60, True)))
    assert factor.info["ordering"] == "AMD"
    factor.destroy()
    options.delValue("static_mat_mumps_icntl_7")
    options["static_pc_type"] = "jacobi"
    with pytest.raises(CaseError, match="-static_pc_type jacobi"):
        Factor(spd(lattices.chain(60, True)))
    options.delValue("static_pc_type")


def test_repeated_solves_do_not_leak_memory():
    K = lattices.lattice_stiffness((6, 5, 5))
    factor = Factor(spd(K))
    B = sp.random(K.shape[0], 12, 0.01, format="csc", random_state=0)
    B_owned = owned(factor.A, B.toarray())

    def repeat(n):
        for _ in range(n):
            factor.solve(B_owned)
            factor.solve(B)
        return resident_memory()

    initial = repeat(20)
    assert repeat(100) - initial < 3e6  # 200 solves; a leak of a block of solutions each time would be 9 MB
    factor.destroy()


def resident_memory():
    with open("/proc/self/statm") as status:
        return int(status.read().split()[1]) * 4096
