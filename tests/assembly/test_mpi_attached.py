"""Point masses, springs and equations of a model file: exact matrices, merged and rotated meshes; on any number of ranks."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from box_meshes import box, mesh_of, settings
from mpi4py import MPI

from microslip.assembly.assemble import assemble
from microslip.assembly.prestress import constant_forces, stiffness_at_rest
from microslip.formats.model import Equations
from microslip.mesh.data import Outside
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.reference_points import of_distributing
from microslip.messages.errors import MeshError
from microslip.tables.constant_loads import Statics
from microslip.tables.structure import Mass, Model, Point, Spring
from microslip.tables.vibration import Load

comm = MPI.COMM_WORLD
SUPPORTED = [("base", "xyz")]


def block(turn=None, **more):
    """Return a box of steel, rotated about the origin."""
    turn = np.eye(3) if turn is None else turn
    points, nodes = box("hex20", (1, 1, 2))
    groups = {"base": lambda x: np.abs(x @ turn[:, 2]) < 1e-9, "top": lambda x: np.abs(x @ turn[:, 2] - 1.0) < 1e-9}
    groups |= {"corner": lambda x: np.linalg.norm(x @ turn - [1.0, 1.0, 1.0], axis=1) < 1e-9}
    groups |= {"other": lambda x: np.linalg.norm(x @ turn - [0.0, 0.0, 1.0], axis=1) < 1e-9}
    return replace(mesh_of(("block", "hex20", points @ turn.T, nodes), groups=groups), **more)


def with_equations(given):
    return given.with_keys(model=given.model.with_keys(take=("equations",)))


def case_of(supports=SUPPORTED, **more):
    return with_equations(settings({"block": "block"}, supports, **more))


def system_of(mesh, case):
    on_root = mesh if comm.rank == 0 else None
    shares = distribute(on_root, case, comm)
    return assemble(shares, on_root, pair_contacts(mesh, case.joints), case), shares


def gathered(system, matrix):
    indptr, columns, values = matrix.getValuesCSR()
    rows = sp.csr_matrix((values, columns, indptr), (len(indptr) - 1, system.n_dof))
    return sp.vstack(system.comm.allgather(rows)).toarray()


def dense(mesh, case):
    """Return K, M and the rows of the nodes."""
    system, _ = system_of(mesh, case)
    return gathered(system, system.K), gathered(system, system.M), system.dof


KNOB = Point(name="knob", position=(0.3, 0.2, 1.4), group="top")


@pytest.mark.parametrize("connection", ["rigid", "distributing"])
def test_masses_and_springs_at_a_point_equal_keys_of_the_point(connection):
    """They equal the mass and the springs to ground that the table of the point states."""
    mesh, knob = block(), KNOB.with_keys(connection=connection)
    springs = tuple(Spring(points=("knob",), direction=tuple(axis), stiffness=k) for axis, k in zip(np.eye(3), (1e6, 2e6, 3e6)))
    by_tables = case_of(points=(knob,), masses=(Mass(point="knob", mass=5.0),), springs=springs)
    by_keys = case_of(points=(knob.with_keys(mass=5.0, stiffness=(1e6, 2e6, 3e6)),))
    for matrix, expected in zip(dense(mesh, by_tables)[:2], dense(mesh, by_keys)[:2], strict=True):
        np.testing.assert_allclose(matrix, expected, atol=1e-12 * np.abs(expected).max())


def test_a_spring_between_two_points_acts_along_their_line():
    mesh = block()
    middle = np.flatnonzero(np.abs(mesh.points[:, 2] - 0.5) < 1e-9)
    mesh = replace(mesh, node_groups={**mesh.node_groups, "middle": middle})
    points = (KNOB, Point(name="other", position=(0.3, 0.2, 0.4), group="middle"))
    springs = (Spring(points=("knob", "other"), stiffness=4e6),)
    K0, K = (dense(mesh, case_of(points=points, springs=given))[0] for given in ((), springs))
    values, vectors = np.linalg.eigh(K - K0)
    assert np.abs(values[:-1]).max() < 1e-9 * values[-1] and values[-1] == pytest.approx(
        2.0 * 4e6
    )  # the vector has 1 and -1 along z
    assert np.count_nonzero(np.abs(vectors[:, -1]) > 1e-6) == 2


def equations(*rows):
    """Return equations of (node, axis, coefficient) terms."""
    terms = [(i, *term) for i, row in enumerate(rows) for term in row]
    number, node, axis, value = (np.array(column) for column in zip(*terms, strict=True))
    return Equations(number, node, axis, value.astype(float), tuple(f"equation {i}" for i in range(len(rows))))


def test_dampers_add_exactly_their_entries():
    mesh = block()
    dampers = (Spring(groups=("top",), direction=(0.0, 0.0, 2.0), damping=3.0), Spring(groups=("corner", "other"), damping=7.0))
    system, _ = system_of(mesh, case_of(springs=dampers))
    springs = tuple(damper.with_keys(stiffness=damper.damping, damping=0.0) for damper in dampers)
    K0, (K, _, _) = (
        gathered(system, system.K),
        dense(mesh, case_of(springs=tuple(s.with_keys(stiffness=1e9 * s.stiffness) for s in springs))),
    )
    np.testing.assert_allclose(1e9 * gathered(system, system.C), K - K0, atol=1e-12 * K0.max())
    assert system_of(mesh, case_of(springs=springs))[0].C is None


def test_masses_and_springs_add_exactly_their_entries():
    mesh = block()
    K0, M0, dof0 = dense(mesh, case_of())
    masses = (Mass(group="corner", mass=5.0),)
    springs = (
        Spring(groups=("top",), direction=(0.0, 0.0, 2.0), stiffness=3e6),
        Spring(groups=("corner", "other"), stiffness=7e6),
    )
    K, M, dof = dense(mesh, case_of(masses=masses, springs=springs))
    np.testing.assert_array_equal(dof, dof0)
    corner, other = mesh.node_groups["corner"][0], mesh.node_groups["other"][0]
    expected = np.zeros(len(K0))
    expected[dof[corner]] = 5.0
    np.testing.assert_allclose(M - M0, np.diag(expected), atol=1e-12 * M0.max())
    z = np.zeros((len(K0), len(mesh.node_groups["top"])))
    z[dof[mesh.node_groups["top"], 2], np.arange(z.shape[1])] = 1.0
    line = np.zeros(len(K0))
    line[dof[corner, :2]], line[dof[other, :2]] = np.sqrt(0.5), -np.sqrt(0.5)
    np.testing.assert_allclose(K - K0, 3e6 * z @ z.T + 7e6 * np.outer(line, line), atol=1e-12 * K0.max())


def test_equations_merge_coincident_nodes():
    """Two stacked boxes with equal motion of coincident nodes have the frequencies of a single mesh."""
    lower, upper = box("hex20", (1, 1, 1)), box("hex20", (1, 1, 1), origin=(0.0, 0.0, 1.0))
    groups = {"base": lambda x: x[:, 2] < 1e-9}
    mesh = mesh_of(("low", "hex20", *lower), ("high", "hex20", *upper), groups=groups)
    n = len(lower[0])
    coincident = [(i, n + int(np.argmin(np.linalg.norm(upper[0] - x, axis=1)))) for i, x in enumerate(lower[0]) if x[2] == 1.0]
    rows = [[(high, axis, 2.0), (low, axis, -2.0)] for low, high in coincident for axis in range(3)]
    redundant = [*rows, [(coincident[0][1], 0, 1.0), (coincident[0][0], 0, -1.0)]]  # the first equation is repeated
    case = with_equations(settings({"low": "low", "high": "high"}, SUPPORTED))
    K, M, dof = dense(replace(mesh, equations=equations(*redundant)), case)
    merged = mesh_of(("one", "hex20", *box("hex20", (1, 1, 2), (1.0, 1.0, 2.0))), groups=groups)
    K1, M1, _ = dense(merged, settings({"one": "one"}, SUPPORTED))
    assert K.shape == K1.shape and (dof[[high for _, high in coincident]] == -1).all()
    computed, expected = (scipy.linalg.eigh(a, b, eigvals_only=True) for a, b in ((K, M), (K1, M1)))
    np.testing.assert_allclose(computed, expected, rtol=1e-9)


def test_supports_in_rotated_axes_are_equations():
    """A rotated box whose base slides in its plane has the frequencies of the box in global axes."""
    axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    turn = scipy.linalg.expm(0.7 * cross)
    mesh = block(turn)
    rows = [[(node, k, turn[k, 2]) for k in range(3)] for node in mesh.node_groups["base"]]
    K, M, _ = dense(replace(mesh, equations=equations(*rows)), case_of(()))
    K1, M1, _ = dense(block(), case_of([("base", "z")]))
    assert K.shape == K1.shape
    computed, expected = (scipy.linalg.eigh(a, b, eigvals_only=True) for a, b in ((K, M), (K1, M1)))
    np.testing.assert_allclose(computed, expected, rtol=1e-8, atol=1e-8 * expected.max())


def test_a_distributing_point_on_nodes_with_equations_is_exact():
    """The frequencies are those in the null space of all constraints, in which the point has six unknowns."""
    mesh, knob = block(), KNOB.with_keys(connection="distributing", mass=5.0, inertia=(0.1, 0.2, 0.3, 0.0, 0.0, 0.0))
    top, n = mesh.node_groups["top"], 3 * len(mesh.points)
    middle = int(np.flatnonzero(np.abs(mesh.points[:, 2] - 0.5) < 1e-9)[0])
    rows = [
        [(top[0], 0, 1.0), (top[1], 0, -1.0)],
        [(middle, 1, 3.0), (top[2], 1, -1.0), (top[0], 1, 1.0)],
        [(-1, 1, 1.0), (top[4], 1, -2.0)],
    ]
    joined = replace(equations(*rows), points=("knob",))
    K, M, _ = dense(replace(mesh, equations=joined), case_of(points=(knob,)))
    K0, M0, dof = dense(mesh, settings({"block": "block"}, ()))
    K1, M1 = scipy.linalg.block_diag(K0, np.zeros((6, 6))), scipy.linalg.block_diag(M0, np.diag([5.0] * 3 + [0.1, 0.2, 0.3]))
    mean = of_distributing(mesh, knob, len(mesh.points), len(mesh.points) + 2).weights.toarray()[:, :n]
    C = np.zeros((9 + 3 * len(mesh.node_groups["base"]), n + 6))
    for i, row in enumerate(rows):
        for node, axis, value in row:
            C[i, (3 * node if node >= 0 else n) + axis] = value
    C[3:9, :n], C[3:9, n:] = -mean, np.eye(6)
    C[np.arange(9, len(C)), (3 * mesh.node_groups["base"][:, None] + np.arange(3)).ravel()] = 1.0
    order = np.r_[dof[: len(mesh.points)].ravel(), len(K0) + np.arange(6)]  # rows of K1 of nodes and point
    Z = scipy.linalg.null_space(C)
    computed, expected = (
        scipy.linalg.eigh(a, b, eigvals_only=True)
        for a, b in ((K, M), (Z.T @ K1[np.ix_(order, order)] @ Z, Z.T @ M1[np.ix_(order, order)] @ Z))
    )
    np.testing.assert_allclose(computed, expected, rtol=1e-8)


AXIS = np.array([1.0, 2.0, 2.0]) / 3.0
IN_PLANE = [[(node, k, AXIS[k]) for k in range(3)] for node in (0, 3, 7)]


@pytest.mark.parametrize(
    "rows, supports, springs, n_free",
    [
        ([[(0, 0, 1.0)], [(0, 1, 1.0)]], (), (), 4),
        ([[(node, 0, 1.0) for node in range(8)]], (), (), 5),
        ([[(0, 0, 1.0), (3, 0, -1.0)]], (), (), 5),
        (IN_PLANE, (), (), 3),
        (IN_PLANE, [("corner", "xyz")], (), 1),
        (IN_PLANE, (), [(("top",), (0.0, 1.0, 0.0))], 1),
        ([], (), [(("top",), (0.0, 0.0, 1.0))], 3),
        ([], (), [(("corner", "other"), None)], 6),
        ([], SUPPORTED, (), 0),
    ],
)
def test_rigid_motions_compatible_with_equations_and_springs_are_the_null_space_of_K(rows, supports, springs, n_free):
    """Equations, supports and springs may prevent the other rigid motions."""
    mesh = replace(block(), equations=equations(*rows)) if rows else block()
    springs = tuple(Spring(groups=groups, direction=direction, stiffness=1e9) for groups, direction in springs)
    system, _ = system_of(mesh, case_of(supports, springs=springs))
    K, motions = gathered(system, system.K), np.vstack(comm.allgather(system.rigid_owned))
    values = np.linalg.eigvalsh(K)
    assert motions.shape[1] == n_free == np.count_nonzero(values < 1e-11 * values[-1])
    assert np.count_nonzero(np.linalg.svd(motions, compute_uv=False) > 1e-9) == n_free
    assert np.abs(K @ motions).max(initial=0.0) < 1e-10 * values[-1]


def test_a_node_outside_the_elements_may_lead_a_face_with_a_mass_and_a_spring():
    """All nodes of the top move along z with a node of no element; its mass and its spring act on their common motion."""
    mesh = block()
    top, n = mesh.node_groups["top"], len(mesh.points)
    outside = Outside(np.array([[0.5, 0.5, 3.0]]), np.array([9999]), {"reference": np.array([0])})
    rows = [[(node, 2, 1.0), (n, 2, -1.0)] for node in top]
    groups = {**mesh.node_groups, "reference": np.zeros(0, dtype=int)}
    mesh = replace(mesh, outside=outside, equations=equations(*rows), node_groups=groups)
    masses = (Mass(group="reference", mass=4.0),)
    springs = (Spring(groups=("reference",), direction=(0.0, 0.0, 1.0), stiffness=2e9),)
    case = case_of([*SUPPORTED, ("reference", "xy")])
    K0, M0, dof = dense(mesh, case)
    K, M, _ = dense(mesh, case.with_keys(masses=masses, springs=springs))
    leading = dof[top, 2][dof[top, 2] >= 0]
    assert len(leading) == 1
    unit = np.zeros((len(K), len(K)))
    unit[leading[0], leading[0]] = 1.0
    np.testing.assert_allclose(M - M0, 4.0 * unit, atol=1e-12 * M0.max())
    np.testing.assert_allclose(K - K0, 2e9 * unit, atol=1e-12 * K0.max())
    with pytest.raises(MeshError, match=r"\[\[masses\]\]: node 9999 .* belongs to no element of a body and is free to move"):
        dense(mesh, case_of().with_keys(masses=masses))


def test_masses_have_centrifugal_and_inertial_forces():
    """Centrifugal force, spin softening and force of a base acceleration of a mass are those of a particle."""
    mesh = block()
    statics = Statics(rotation_speed=100.0)
    model = Model.of_file(mesh="box.msh", take=(), axis=(0.0, 0.0, 1.0), axis_point=(-1.0, 0.0, 0.0))
    accelerated = (Load(base_acceleration=(1.0, 2.0, 3.0)),)
    masses = (Mass(group="corner", mass=5.0),)
    plain = case_of(model=model, statics=statics, loads=accelerated, masses=(Mass(group="corner", mass=0.0),))
    values = []
    for case in (plain, plain.with_keys(masses=masses)):
        system, shares = system_of(mesh, case)
        on_root = mesh if comm.rank == 0 else None
        f = np.concatenate(comm.allgather(constant_forces(shares, on_root, case, system)))
        K = stiffness_at_rest(shares, case, system, np.zeros(system.K.getLocalSize()[0])).K
        values.append((f, gathered(system, K), system.loads.toarray()[:, 0], system.dof))
    (f0, K0, load0, dof), (f, K, load, _) = values
    rows = dof[mesh.node_groups["corner"][0]]
    expected = np.zeros(len(f))
    expected[rows] = 5.0 * 1e4 * np.array([2.0, 1.0, 0.0])
    np.testing.assert_allclose(f - f0, expected, atol=1e-9 * abs(f0).max())
    change = np.zeros_like(K)
    change[rows[:2], rows[:2]] = -5.0 * 1e4
    np.testing.assert_allclose(K - K0, change, atol=1e-12 * K0.max())
    weight = np.zeros(len(f))
    weight[rows] = -5.0 * np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(load - load0, weight, atol=1e-12 * abs(load0).max())


def test_springs_between_groups_of_several_nodes_are_refused():
    with pytest.raises(MeshError, match=r"\[\[springs\]\] 1 groups: 'top' holds 8 nodes; a spring has one at each end"):
        dense(block(), case_of(springs=(Spring(groups=("top", "corner"), stiffness=1.0),)))


def test_springs_to_ground_support_a_body_and_dampers_do_not():
    mesh = block()
    to_ground = tuple(Spring(groups=("base",), direction=tuple(axis), stiffness=1e9) for axis in np.eye(3))
    K, _, _ = dense(mesh, case_of((), springs=to_ground))
    assert np.linalg.eigvalsh(K)[0] > 0.0
    dampers = tuple(spring.with_keys(stiffness=0.0, damping=1e3) for spring in to_ground)
    for springs in ((Spring(groups=("corner", "other"), stiffness=1e9),), dampers):
        K, _, _ = dense(mesh, case_of((), springs=springs))
        assert np.count_nonzero(np.linalg.eigvalsh(K) < 1e-9 * np.linalg.norm(K, 2)) == 6


# -- equations between points, against a single mesh --------------------------------------------------------------------


HALVES = {
    "base": lambda x: x[:, 2] < 1e-9,
    "lower": lambda x: (np.abs(x[:, 2] - 1.0) < 1e-9) & (np.arange(len(x)) < len(x) // 2),
    "upper": lambda x: (np.abs(x[:, 2] - 1.0) < 1e-9) & (np.arange(len(x)) >= len(x) // 2),
}
FIRST = Point(name="first", position=(0.2, 0.7, 1.1), group="lower")
SECOND = Point(name="second", position=(0.9, 0.4, 1.3), group="upper")


def rigidly(leader, follower, names):
    """Return equations of a point that follows another as a rigid body: u = u_l + theta_l x r, theta = theta_l."""
    x, y, z = np.subtract(follower.position, leader.position)
    rows = [[(0, 0, 1.0), (1, 0, -1.0), (1, 4, -z), (1, 5, y)], [(0, 1, 1.0), (1, 1, -1.0), (1, 5, -x), (1, 3, z)]]
    rows += [[(0, 2, 1.0), (1, 2, -1.0), (1, 3, -y), (1, 4, x)], *([(0, i, 1.0), (1, i, -1.0)] for i in (3, 4, 5))]
    number = np.repeat(np.arange(6), [len(row) for row in rows])
    which, axes, values = map(np.array, zip(*(term for row in rows for term in row)))
    where = tuple(f"row {i}" for i in range(6))
    return Equations(number, -1 - which, axes, values, where, points=names)


@pytest.mark.parametrize("names", [("second", "first"), ("first", "second")])
def test_points_tied_by_equations_are_one_rigid_body(names):
    """Two halves with coupled points have the frequencies of a single mesh with a rigid middle plane."""
    points = {"first": FIRST, "second": SECOND}
    follower, leader = (points[name] for name in names)
    low, high = box("hex8", (1, 1, 1)), box("hex8", (1, 1, 1), origin=(0.0, 0.0, 1.0))
    halves = mesh_of(("low", "hex8", *low), ("high", "hex8", *high), groups=HALVES)
    halves = replace(halves, equations=rigidly(leader, follower, names))
    given = settings({"low": "low", "high": "high"}, [("base", "xyz")], points=(FIRST, SECOND))
    K, M, _ = dense(halves, with_equations(given))
    single = mesh_of(
        ("all", "hex8", *box("hex8", (1, 1, 2), (1.0, 1.0, 2.0))),
        groups={**HALVES, "lower": lambda x: np.abs(x[:, 2] - 1.0) < 1e-9},
    )
    single_case = settings({"all": "all"}, [("base", "xyz")], points=(FIRST,))
    K_1, M_1, _ = dense(single, single_case)
    computed, exact = (scipy.linalg.eigh(a, b, eigvals_only=True) for a, b in ((K, M), (K_1, M_1)))
    np.testing.assert_allclose(computed, exact, rtol=1e-8)


def joined(*parts):
    """Return the union of sets of equations between points, numbered consecutively."""
    names = tuple(dict.fromkeys(name for part in parts for name in part.points))
    at = [-1 - np.array([names.index(name) for name in part.points])[-1 - part.nodes] for part in parts]
    number = np.concatenate([part.equation + 6 * i for i, part in enumerate(parts)])
    axes, values = (np.concatenate([getattr(part, key) for part in parts]) for key in ("axes", "coefficients"))
    return Equations(number, np.concatenate(at), axes, values, tuple(f"row {i}" for i in range(6 * len(parts))), points=names)


@pytest.mark.parametrize("corner", [False, True])
def test_a_point_that_leads_only_points_is_one_rigid_body_with_them(corner):
    """Two points that follow a third one, with a mass and without nodes, equal the third one with all nodes as followers.

    With ``corner``, the second point has a single node, and its rotations are those of the third.
    """
    hub = Point(name="hub", position=(0.3, -0.2, 1.4), group="lower", mass=2000.0, inertia=(100.0, 200.0, 300.0))
    second = SECOND.with_keys(group="corner") if corner else SECOND
    groups = HALVES | {"corner": lambda x: np.linalg.norm(x - [1.0, 1.0, 2.0], axis=1) < 1e-9}
    groups["both"] = lambda x: groups["lower"](x) | groups[second.group](x)
    low, high = box("hex8", (1, 1, 1)), box("hex8", (1, 1, 1), origin=(0.0, 0.0, 1.0))
    halves = mesh_of(("low", "hex8", *low), ("high", "hex8", *high), groups=groups)
    rows = joined(*(rigidly(hub, point, (point.name, "hub")) for point in (FIRST, second)))
    given = settings({"low": "low", "high": "high"}, [("base", "xyz")])
    chain = given.with_keys(points=(hub.with_keys(connection="equations"), FIRST, second))
    K, M, _ = dense(replace(halves, equations=rows), with_equations(chain))
    K_1, M_1, _ = dense(halves, given.with_keys(points=(hub.with_keys(group="both"),)))
    computed, exact = (scipy.linalg.eigh(a, b, eigvals_only=True) for a, b in ((K, M), (K_1, M_1)))
    np.testing.assert_allclose(computed, exact, rtol=1e-8, atol=1e-8 * exact[-1])


def test_a_point_connected_by_no_equation_is_refused():
    with pytest.raises(MeshError, match="no equation of the model file names it"):
        dense(block(), case_of(points=(KNOB.with_keys(connection="equations"),)))


def test_equations_of_points_missing_in_the_scene_are_refused():
    mesh = replace(block(), equations=rigidly(FIRST, SECOND, ("second", "first")))
    with pytest.raises(MeshError, match="an equation of the file is between points, and the scene has no point 'second'"):
        dense(mesh, with_equations(case_of(points=(KNOB,))))
