"""Ties and points: exact fields, rigid motions, matching meshes, resultants, masses on springs; on any number of ranks."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from box_meshes import KINDS, STEEL, box, joint, made_of, mesh_of, settings
from lattices import distributed
from mpi4py import MPI

from microslip.assembly import assemble as assemble_module
from microslip.assembly.assemble import assemble
from microslip.assembly.constraints import _projected
from microslip.assembly.prestress import stiffness_at_rest
from microslip.linear.dense import diagonal_owned, multiply
from microslip.mesh.links import find_links
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.reference_points import of_distributing
from microslip.messages.errors import CaseError, MeshError
from microslip.tables.constant_loads import Statics
from microslip.tables.structure import Point, Support, Tie

comm = MPI.COMM_WORLD
YOUNG, DENSITY = 2.1e11, 7800.0
GLUE = Tie(name="glue", surfaces=("high_bottom", "low_top"))


def stack(low="hex20", high="hex20", n_low=(2, 2, 1), n_high=(2, 2, 1), gap=0.0):
    """Return two unit boxes stacked along z, without common nodes."""
    lower, upper = box(low, n_low), box(high, n_high, origin=(0.0, 0.0, 1.0 + gap))

    def at(z, is_high=None):
        def claim(x):
            is_at_z = np.abs(x[:, 2] - z - gap * (np.arange(len(x)) >= len(lower[0]))) < 1e-9
            return is_at_z if is_high is None else is_at_z & ((np.arange(len(x)) >= len(lower[0])) == is_high)

        return claim

    groups = {"base": at(0.0), "interface": at(1.0), "low_top": at(1.0, False), "high_bottom": at(1.0, True), "top": at(2.0)}
    return mesh_of(("low", low, *lower), ("high", high, *upper), groups=groups)


def tied(mesh, *ties, supports=(), points=(), joints=(), poisson=0.3, **more):
    """Return the settings of a mesh whose groups of elements are its bodies."""
    case = settings({block.group: block.group for block in mesh.elements}, supports, joints, **more)
    material = STEEL.with_keys(poisson=poisson)
    return made_of(case, material).with_keys(ties=ties, points=points)


def system_of(mesh, case, comm=comm):
    """Return the system as in run.py.  Collective."""
    on_root = mesh if comm.rank == 0 else None
    return assemble(distribute(on_root, case, comm), on_root, pair_contacts(mesh, case.joints), case)


def gathered(system, name):
    """Return K or M on every rank, dense."""
    indptr, columns, values = getattr(system, name).getValuesCSR()
    rows = sp.csr_matrix((values, columns, indptr), (len(indptr) - 1, system.n_dof))
    return sp.vstack(system.comm.allgather(rows)).toarray()


def frequencies(system, n):
    computed = scipy.linalg.eigh(gathered(system, "K"), gathered(system, "M"), eigvals_only=True)[:n]
    return np.sign(computed) * np.sqrt(np.abs(computed)) / (2.0 * np.pi)


def flexibility(system):
    """Return outputs K^-1 loads."""
    return system.outputs @ np.linalg.solve(gathered(system, "K"), system.loads.toarray())


def rigid_motions(points):
    """Return the six rigid motions of points, (6, n, 3)."""
    turns = [np.cross(axis, points) for axis in np.eye(3)]
    return np.concatenate([np.tile(np.eye(3)[:, None], (1, len(points), 1)), turns])


def on_rows(system, field):
    """Return a field (n_nodes, 3) in the rows of the nodes; rows of points remain zero."""
    w = np.zeros(system.n_dof)
    w[system.dof[system.dof >= 0]] = field[system.dof >= 0]
    return w


@pytest.fixture
def unsupported(monkeypatch):
    """Allow structures without supports."""
    monkeypatch.setattr(assemble_module, "check_fixed", lambda *_: True)


MESHES = [
    ("hex20", "hex20", (2, 2, 1), (3, 3, 1)),
    ("hex8", "tet10", (2, 3, 2), (3, 2, 1)),
    ("wedge15", "tet4", (2, 2, 1), (3, 3, 2)),
]


@pytest.mark.parametrize("low, high, n_low, n_high", MESHES)
def test_linear_fields_satisfy_the_ties(low, high, n_low, n_high):
    mesh = stack(low, high, n_low, n_high)
    system = system_of(mesh, tied(mesh, GLUE, supports=[("base", "xyz")]))
    assert system.n_dof == np.count_nonzero(system.dof >= 0)
    shear = mesh.points[:, 2:] * np.array([0.3, -0.2, 0.7])  # zero on the base
    assert system.at_nodes(on_rows(system, shear)) == pytest.approx(shear, abs=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_ties_of_matching_meshes_equal_common_nodes(kind, unsupported):
    """The tied structure has the frequencies of the mesh with common nodes, to rounding."""
    mesh = stack(kind, kind)
    merged = mesh_of(("one", kind, *box(kind, (2, 2, 2), size=(1.0, 1.0, 2.0))))
    computed, expected = (frequencies(system_of(m, tied(m, *ties)), 20) for m, ties in ((mesh, [GLUE]), (merged, [])))
    assert computed[6:] == pytest.approx(expected[6:], rel=1e-10)


def curved(n_low, n_high, kind="hex8"):
    """Return two concentric ring sectors about y that touch at radius 2 with different meshes."""
    mesh = stack(kind, kind, n_low, n_high)
    angle, radius = 1.2 * mesh.points[:, 0], 1.0 + mesh.points[:, 2]
    mesh.points[:] = np.stack([-radius * np.cos(angle), mesh.points[:, 1], radius * np.sin(angle)], axis=1)
    return mesh


@pytest.mark.parametrize(
    "mesh", [stack("hex20", "tet10", (2, 2, 1), (3, 2, 1)), curved((3, 2, 1), (5, 3, 1))], ids=["flat", "curved"]
)
def test_only_rigid_motions_are_free(mesh, unsupported):
    system = system_of(mesh, tied(mesh, GLUE.with_keys(tolerance=0.1)))
    K = gathered(system, "K")
    motions = np.array([on_rows(system, motion) for motion in rigid_motions(mesh.points)])
    for w, motion in zip(motions, rigid_motions(mesh.points), strict=True):
        assert system.at_nodes(w) == pytest.approx(motion, abs=1e-12)
    assert np.abs(K @ motions.T).max() <= 1e-12 * np.abs(K).max()
    stretch = np.linalg.eigvalsh(K) / np.abs(K).max()
    assert np.abs(stretch[:6]).max() < 1e-12 and stretch[6] > 1e-5


def test_only_nested_meshes_transmit_uniform_traction_exactly():
    """Nested meshes of linear elements pass the patch test; other meshes do not (docs/validation.md)."""
    for n_high, exact in (((4, 4, 1), True), ((3, 3, 1), False)):
        mesh = stack("hex8", "hex8", (2, 2, 1), n_high)
        case = tied(mesh, GLUE, supports=[("base", "z"), ("corner", "xy"), ("edge", "y")], poisson=0.0)
        mesh.node_groups["corner"] = np.flatnonzero((mesh.points == 0.0).all(axis=1))
        mesh.node_groups["edge"] = np.flatnonzero((mesh.points == [1.0, 0.0, 0.0]).all(axis=1))
        system = system_of(mesh, case)
        stretch = mesh.points * [0.0, 0.0, 1e-3]
        residual = gathered(system, "K") @ on_rows(system, stretch)
        inner = system.dof[mesh.node_groups["low_top"], 2]
        size = 1e-3 * YOUNG / 4.0  # force on an inner node of the lower side
        error = np.abs(residual[inner]).max() / size
        assert error < 1e-10 if exact else 0.01 < error < 0.3


@pytest.mark.ranks(1, 2)
def test_frequencies_with_nonmatching_meshes_converge(unsupported):
    merged = mesh_of(("one", "hex20", *box("hex20", (3, 3, 6), size=(1.0, 1.0, 2.0))))
    expected = frequencies(system_of(merged, tied(merged)), 9)[6:]
    errors = []
    for n_low, n_high in (((1, 1, 1), (2, 2, 1)), ((2, 2, 2), (3, 3, 2))):
        mesh = stack("hex20", "hex20", n_low, n_high)
        errors.append(np.abs(frequencies(system_of(mesh, tied(mesh, GLUE)), 9)[6:] / expected - 1.0).max())
    assert errors[1] < 0.005 and errors[1] < 0.1 * errors[0]


@pytest.mark.parametrize("second", ["hex8", "hex20"])
def test_only_nodes_near_the_other_surface_are_tied(second):
    """Distant nodes of a surface do not change its tie, as in Abaqus with its position tolerance."""
    mesh = stack("hex8", second)
    side = np.flatnonzero((mesh.points[:, 0] == 1.0) & (mesh.points[:, 2] >= 1.0))
    side = np.setdiff1d(side, mesh.node_groups["low_top"])
    mesh.node_groups["corner"] = np.union1d(mesh.node_groups["high_bottom"], side)
    beyond = len(np.setdiff1d(side, mesh.node_groups["high_bottom"]))
    n = len(mesh.node_groups["corner"])
    cases = [
        tied(mesh, Tie(name="t", surfaces=(group, "low_top")), supports=[("base", "xyz")]) for group in ("high_bottom", "corner")
    ]
    near, extended = (find_links(mesh, case) for case in cases)
    assert f"tie 't': {n - beyond} of {n} nodes of 'corner' follow" in extended.notes[0]
    assert (
        f"; {beyond} lie farther than 0.025 m from them and stay free" in extended.notes[0] and "WARNING" not in extended.notes[0]
    )
    np.testing.assert_array_equal(near.dependent, extended.dependent)
    assert abs(near.weights - extended.weights).max() < 1e-14
    K = gathered(system_of(mesh, cases[0]), "K")
    np.testing.assert_allclose(gathered(system_of(mesh, cases[1]), "K"), K, rtol=0.0, atol=1e-14 * np.abs(K).max())


def test_common_nodes_of_both_surfaces_are_not_tied():
    mesh = stack("hex8", "hex8")
    mesh.node_groups["all"] = np.union1d(mesh.node_groups["low_top"], mesh.node_groups["high_bottom"])
    (note,) = find_links(mesh, tied(mesh, Tie(name="t", surfaces=("all", "low_top")), supports=[("base", "xyz")])).notes
    assert "9 of 18 nodes of 'all' follow" in note and note.endswith("; 9 are nodes of both surfaces")


def test_a_mostly_distant_tie_is_a_warning_and_its_free_faces_may_have_a_joint():
    mesh = stack("hex8", "hex8")
    high = np.arange(len(mesh.points)) >= 18
    mesh.node_groups["skin"] = np.flatnonzero(high)
    case = tied(mesh, Tie(surfaces=("skin", "low_top")), supports=[("base", "xyz")], joints=[joint(surfaces=("top", "low_top"))])
    with pytest.raises(MeshError, match="4 faces of 'low_top' of joint 'joint' are faces of 'low_top' of tie 'skin to low_top'"):
        find_links(mesh, case)
    links = find_links(mesh, case.with_keys(joints=[joint(surfaces=("top", "base"))]))  # faces of the tie, but not tied
    assert links.notes[0].startswith("WARNING: tie 'skin to low_top': 9 of 18 nodes") or "9 of 18" in links.notes[0]


def test_a_chain_of_ties_is_resolved():
    """Of three boxes the middle one follows the lower one and leads the upper one."""
    boxes = [box("hex8", (k, k, 1), origin=(0.0, 0.0, z)) for k, z in ((2, 0.0), (3, 1.0), (4, 2.0))]
    starts = np.cumsum([0] + [len(points) for points, _ in boxes])

    def of(i, z):
        return lambda x: (x[:, 2] == z) & (np.arange(len(x)) >= starts[i]) & (np.arange(len(x)) < starts[i + 1])

    groups = {
        "base": of(0, 0.0),
        "low_top": of(0, 1.0),
        "mid_bottom": of(1, 1.0),
        "mid_top": of(1, 2.0),
        "high_bottom": of(2, 2.0),
    }
    side = {"side": lambda x: (x[:, 0] == 1.0) & (np.arange(len(x)) >= starts[1]) & (np.arange(len(x)) < starts[2])}
    mesh = mesh_of(*((name, "hex8", *part) for name, part in zip(("low", "mid", "high"), boxes)), groups={**groups, **side})
    shear = mesh.points[:, 2:] * np.array([0.3, -0.2, 0.7])
    ties = [Tie(name="a", surfaces=("mid_bottom", "low_top")), Tie(name="b", surfaces=("high_bottom", "mid_top"))]
    system = system_of(mesh, tied(mesh, *ties, supports=[("base", "xyz")]))
    assert system.at_nodes(on_rows(system, shear)) == pytest.approx(shear, abs=1e-14)
    point = Point(name="p", position=(1.0, 0.5, 1.5), group="side")
    with pytest.raises(MeshError, match="follow two things, tie 'a' and point 'p'"):
        system_of(mesh, tied(mesh, *ties, supports=[("base", "xyz")], points=(point,)))
    ties, point = [Tie(name="a", surfaces=("low_top", "mid_bottom"))], point.with_keys(stiffness=(1.0, 1.0, 1.0))
    system = system_of(mesh, tied(mesh, *ties, supports=[("high", "xyz")], points=(point,)))
    # the lower box follows the side of the middle one, which follows the point
    motion = rigid_motions(mesh.points - point.position)[4]
    w = np.zeros(system.n_dof)
    w[system.constraints.free[-1, 1]] = 1.0
    moved = system.at_nodes(w)
    side = mesh.node_groups["side"]
    assert moved[side] == pytest.approx(motion[side], abs=1e-15)
    edge = np.intersect1d(mesh.node_groups["low_top"], np.flatnonzero(mesh.points[:, 0] == 1.0))
    assert moved[edge] == pytest.approx(motion[edge], abs=1e-12)


# -- points ------------------------------------------------------------------------------------------------------------


def column(n=(2, 2, 4), length=4.0, kind="hex20"):
    """Return a column of unit section along z."""
    groups = {"base": lambda x: x[:, 2] == 0.0, "end": lambda x: np.abs(x[:, 2] - length) < 1e-9}
    return mesh_of(("bar", kind, *box(kind, n, size=(1.0, 1.0, length))), groups=groups)


@pytest.mark.parametrize("freed", ["z", "rz"])
def test_a_mass_on_a_bar_has_the_frequency_of_theory(freed):
    """With Poisson's ratio 0 the static shape is linear: a third of the mass of the bar adds to a much larger mass at its end."""
    mesh, length = column(n=(4, 4, 4)), 4.0
    mass, inertia = 1e4 * DENSITY * length, (1.0, 1.0, 1e4 * DENSITY * length)
    point = Point(name="p", position=(0.5, 0.5, length), group="end", mass=mass, inertia=(*inertia, 0.0, 0.0, 0.0))
    others = tuple(direction for direction in ("x", "y", "z", "rx", "ry", "rz") if direction != freed)
    case = tied(mesh, supports=[("base", "xyz")], points=(point,), poisson=0.0)
    case = case.with_keys(supports=(*case.supports, Support(point="p", fix=others)))
    omega2 = (2.0 * np.pi * frequencies(system_of(mesh, case), 1)[0]) ** 2
    if freed == "z":
        assert omega2 == pytest.approx(YOUNG / length / (mass + DENSITY * length / 3.0), rel=1e-7)
    else:  # Saint-Venant's torsion of a square; restrained warping at the ends stiffens it
        assert omega2 == pytest.approx(0.1406 * (YOUNG / 2.0) / length / mass, rel=0.1)
        assert omega2 > 0.1406 * (YOUNG / 2.0) / length / mass


def test_a_block_on_springs_has_six_exact_frequencies(unsupported):
    """The block is much stiffer than its springs and moves as a rigid body."""
    mesh = column(n=(1, 1, 1), length=1.0)
    k, kr = (1e5, 2e5, 3e5), (4e5, 5e5, 6e5)
    point = Point(
        name="p",
        position=(0.5, 0.5, 0.5),
        group="end",
        mass=100.0,
        stiffness=k,
        rotational_stiffness=kr,
        inertia=(10.0, 20.0, 30.0, 0, 0, 0),
    )
    computed = (2.0 * np.pi * frequencies(system_of(mesh, tied(mesh, points=(point,))), 6)) ** 2
    mass, J = DENSITY + 100.0, DENSITY / 6.0 + np.array([10.0, 20.0, 30.0])
    assert computed == pytest.approx(np.sort(np.concatenate([np.array(k) / mass, np.array(kr) / J])), rel=1e-4)


@pytest.mark.parametrize("connection", ["rigid", "distributing"])
def test_forces_and_moments_on_a_point_do_the_exact_work(connection):
    """The work of a force and of a moment on the point in rigid motions is exact."""
    mesh = column()
    point = Point(name="p", position=(1.5, -0.5, 6.0), group="end", connection=connection)
    F, moment = (1.0, 2.0, 3.0), (-2.0, 0.5, 4.0)
    loads = [{"point": "p", "direction": F}, {"point": "p", "moment": moment}]
    supported, free_ = (
        tied(mesh, supports=supports, points=(point,), loads=loads) for supports in ([("base", "xyz")], [("base", "x")])
    )
    system = system_of(mesh, supported)
    arms = mesh.points - np.array(point.position)
    for column_, force, turn in zip(system.loads.toarray().T, (F, (0, 0, 0)), ((0, 0, 0), moment)):
        work = []
        for motion, of_point in zip(rigid_motions(arms), np.eye(6)):
            w = on_rows(system, motion)
            if connection == "rigid":
                rows = system.constraints.free[-2:].ravel()
                w[rows] = of_point
            work.append(column_ @ w)
        assert work == pytest.approx([*force, *turn], abs=1e-12)


def test_a_distributing_point_adds_no_stiffness_and_follows_rigid_motions():
    mesh = column()
    point = Point(name="p", position=(1.5, -0.5, 6.0), group="end", connection="distributing")
    outputs = [{"name": f"u{i}", "point": "p", "direction": tuple(np.eye(3)[i])} for i in range(3)]
    outputs += [{"name": f"r{i}", "point": "p", "rotation": tuple(np.eye(3)[i])} for i in range(3)]
    plain = system_of(mesh, tied(mesh, supports=[("base", "xyz")]))
    system = system_of(mesh, tied(mesh, supports=[("base", "xyz")], points=(point,), outputs=outputs))
    np.testing.assert_array_equal(system.dof, plain.dof)
    for name in ("K", "M"):
        np.testing.assert_allclose(
            gathered(system, name), gathered(plain, name), rtol=0, atol=1e-12 * abs(gathered(plain, name)).max()
        )
    for motion, expected in zip(rigid_motions(mesh.points - np.array(point.position)), np.eye(6)):
        assert system.outputs @ on_rows(system, motion) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("weights", ["area", "equal"])
def test_a_distributing_point_has_weights_by_area_or_equal_weights(weights):
    """The weights of the nodes of a quadratic face add up to 1, and are equal if requested."""
    mesh = stack()
    point = Point(name="p", position=(0.5, 0.5, 2.0), group="top", connection="distributing", weights=weights)
    nodes = mesh.node_groups["top"]
    follower = of_distributing(mesh, point, len(mesh.points), len(mesh.points) + 2)
    weights_z = np.array([follower.weights[2, 3 * node + 2] for node in nodes])
    assert weights_z.sum() == pytest.approx(1.0) and (np.ptp(weights_z) < 1e-12) == (weights == "equal")


def test_a_distributing_point_is_the_weighted_least_squares_motion_of_its_nodes():
    """Stated weights, in the order of node numbers, as of a Nastran RBE3; the motion of the nodes is arbitrary."""
    mesh, random = stack(), np.random.default_rng(3)
    mesh = replace(mesh, numbers=random.permutation(len(mesh.points)) + 1)
    nodes = mesh.node_groups["top"]
    w = random.uniform(0.1, 3.0, len(nodes))
    stated = tuple(map(float, w[np.argsort(mesh.numbers[nodes])]))
    position = np.array([0.7, -0.2, 3.0])
    point = Point(name="p", position=tuple(position), group="top", connection="distributing", weights=stated)
    follower = of_distributing(mesh, point, len(mesh.points), len(mesh.points) + 2)
    u = random.normal(size=(len(mesh.points) + 2, 3))
    rigid = np.concatenate([np.concatenate([np.eye(3), -cross(r)], axis=1) for r in mesh.points[nodes] - position])
    root = np.repeat(np.sqrt(w), 3)
    exact = np.linalg.lstsq(root[:, None] * rigid, root * u[nodes].ravel(), rcond=None)[0]
    np.testing.assert_allclose(follower.weights @ u.ravel(), exact, atol=1e-12)
    with pytest.raises(MeshError, match=r"point 'p': weights holds 2 numbers for \d+ nodes of 'top'"):
        of_distributing(mesh, point.with_keys(weights=(1.0, 2.0)), len(mesh.points), len(mesh.points) + 2)


def cross(r):
    """Return the matrix [r] with [r] v = r x v."""
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


def test_springs_and_a_mass_on_a_distributing_point_act_on_its_nodes():
    """Springs at the point support the block: a load there has their flexibility, and the mass adds to the total mass."""
    mesh = column(n=(1, 1, 1), length=1.0)
    point = Point(
        name="p",
        position=(0.5, 0.5, 1.0),
        group="end",
        connection="distributing",
        mass=50.0,
        stiffness=(1e5,) * 3,
        rotational_stiffness=(1e6,) * 3,
    )
    load, output = {"point": "p", "direction": (0.0, 0.0, 2.0)}, {"name": "u", "point": "p", "direction": (0.0, 0.0, 1.0)}
    system = system_of(mesh, tied(mesh, points=(point,), loads=[load], outputs=[output]))
    assert flexibility(system)[0, 0] == pytest.approx(2.0 / 1e5, rel=1e-9)
    w = on_rows(system, rigid_motions(mesh.points)[0])
    assert w @ gathered(system, "M") @ w == pytest.approx(DENSITY + 50.0, rel=1e-12)


def test_a_point_may_be_supported_in_some_directions():
    """A rigid end that translates without rotation has the stiffness 12 E I / l^3 of a slender beam, reduced by shear."""
    mesh = column(n=(1, 1, 10), length=20.0)
    point = Point(name="p", position=(0.5, 0.5, 20.0), group="end")
    load, output = {"point": "p", "direction": (1.0, 0.0, 0.0)}, {"name": "u", "point": "p", "direction": (1.0, 0.0, 0.0)}
    case = tied(mesh, supports=[("base", "xyz")], points=(point,), loads=[load], outputs=[output], poisson=0.0)
    free_end = flexibility(system_of(mesh, case))[0, 0]
    case = case.with_keys(supports=(*case.supports, Support(point="p", fix=("ry", "rx"))))
    guided = flexibility(system_of(mesh, case))[0, 0]
    shear = 1.2 * 20.0 / (YOUNG / 2.0)
    assert free_end == pytest.approx(20.0**3 * 12.0 / (3.0 * YOUNG) + shear, rel=2e-3)
    assert guided == pytest.approx(20.0**3 / YOUNG + shear, rel=5e-3)  # both ends restrain contraction
    supported = case.with_keys(supports=(*case.supports, Support(point="p", fix=("x",))))
    with pytest.raises(CaseError, match=r"\[\[loads\]\] 1 acts only on degrees of freedom that a support fixes"):
        system_of(mesh, supported)
    sideways = {"point": "p", "direction": (0.0, 1.0, 0.0)}
    fixed_output = tied(mesh, supports=[("base", "xyz")], points=(point,), loads=[sideways], outputs=[output], poisson=0.0)
    fixed_output = fixed_output.with_keys(supports=(*fixed_output.supports, Support(point="p", fix=("x",))))
    assert (
        "WARNING: output 'u' is on degrees of freedom that a support fixes; it does not move"
        in system_of(mesh, fixed_output).notes
    )


# -- ranks, contact, rotation -----------------------------------------------------------------------------------------------------


def test_flexibility_and_frequencies_agree_on_any_number_of_ranks():
    mesh = stack("hex8", "tet10", (2, 2, 2), (3, 2, 1))
    mesh.node_groups["high_side"] = np.flatnonzero((mesh.points[:, 0] == 1.0) & (mesh.points[:, 2] > 1.0))
    points = (
        Point(name="p", position=(0.5, 0.5, 2.5), group="top", mass=3.0, inertia=(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)),
        Point(
            name="q", position=(1.5, 0.5, 1.5), group="high_side", connection="distributing", mass=10.0, stiffness=(1e9, 0.0, 0.0)
        ),
    )
    loads = [
        {"point": "p", "direction": (1.0, 2.0, 3.0)},
        {"point": "q", "moment": (1.0, 0.0, 0.0)},
        {"group": "high_bottom", "direction": (0, 0, 1.0)},
    ]
    outputs = [
        {"name": "a", "point": "q", "rotation": (0, 0, 1.0)},
        {"name": "b", "position": (0.5, 0.5, 1.0), "direction": (1.0, 0, 0)},
    ]
    case = tied(mesh, GLUE, supports=[("base", "xyz")], points=points, loads=loads, outputs=outputs)
    several, serial = system_of(mesh, case), system_of(mesh, case, MPI.COMM_SELF)
    assert several.n_dof == serial.n_dof
    assert np.diff(several.K.getOwnershipRange())[0] == len(several.parts)
    assert flexibility(several) == pytest.approx(flexibility(serial), rel=1e-9)
    assert frequencies(several, 10) == pytest.approx(frequencies(serial, 10), rel=1e-9)
    w = np.random.default_rng(1).normal(size=serial.n_dof)  # in the order of the nodes
    order = [system.constraints.free[system.constraints.free >= 0] for system in (several, serial)]
    fields = []
    for system, rows in zip((several, serial), order):
        field = np.empty(system.n_dof)
        field[rows] = w
        fields.append(system.at_nodes(field))
    assert fields[0] == pytest.approx(fields[1], abs=1e-13)


def test_pairs_on_tied_nodes_follow_the_tie():
    """R T is the relative motion of pairs at the edge of a joint whose nodes follow a tie."""
    base, wall, block = box("hex8"), box("hex8", (1, 3, 3), origin=(1.0, 0.0, 1.0)), box("hex8", origin=(0.0, 0.0, 1.0))
    n = np.cumsum([0, len(base[0]), len(wall[0]), len(block[0])])

    def of(i, axis, value):
        return lambda x: (x[:, axis] == value) & (np.arange(len(x)) >= n[i]) & (np.arange(len(x)) < n[i + 1])

    groups = {
        "base": of(0, 2, 0.0),
        "lower_top": of(0, 2, 1.0),
        "upper_bottom": of(2, 2, 1.0),
        "block_side": of(2, 0, 1.0),
        "wall_side": of(1, 0, 1.0),
        "wall_end": of(1, 0, 2.0),
    }
    mesh = mesh_of(("low", "hex8", *base), ("wall", "hex8", *wall), ("block", "hex8", *block), groups=groups)
    tie = Tie(name="side", surfaces=("block_side", "wall_side"))
    case = tied(mesh, tie, supports=[("base", "xyz"), ("wall_end", "xyz")], joints=[joint()])
    system, pairs = system_of(mesh, case), pair_contacts(mesh, case.joints)
    w = np.random.default_rng(2).normal(size=system.n_dof)
    u = system.at_nodes(w)
    du = np.einsum("pij,pj->pi", pairs.frame, u[pairs.node1] - u[pairs.node2])
    assert (system.R @ w).reshape(-1, 3) == pytest.approx(du, abs=1e-12)


def test_rotation_softens_the_structure_across_the_axis():
    """Without stress the stiffness changes by - Omega^2 times the mass, with that of the point."""
    mesh = stack("hex8", "hex8", (2, 2, 1), (3, 3, 1))
    point = Point(name="p", position=(0.5, 0.5, 2.5), group="top", mass=1000.0)
    case = tied(mesh, GLUE, supports=[("base", "z")], points=(point,)).with_keys(statics=Statics(rotation_speed=20.0))
    system = system_of(mesh, case)
    first, last = system.K.getOwnershipRange()
    dmesh = distribute(mesh if comm.rank == 0 else None, case, comm)
    turning = replace(system, K=stiffness_at_rest(dmesh, case, system, np.zeros(last - first)).K)
    change = gathered(turning, "K") - gathered(system, "K")
    motions = np.array([on_rows(system, motion) for motion in rigid_motions(mesh.points)[:3]])
    motions[:, system.constraints.free[-2]] = np.eye(3)
    motions[2, system.dof[:, 2][system.dof[:, 2] >= 0]] = 0.0
    motions[2, system.constraints.free[-2, 2]] = 1.0
    mass = 2.0 * DENSITY + 1000.0
    assert motions @ change @ motions.T == pytest.approx(-(20.0**2) * mass * np.diag([1.0, 1.0, 0.0]), abs=1e-3)


# -- refused input ---------------------------------------------------------------------------------------------------


def refused(mesh, case, error, match):
    with pytest.raises(error, match=match):
        system_of(mesh, case)


def test_a_tie_without_nodes_near_the_facets_is_refused():
    mesh = stack("hex8", "hex8")
    mesh.points[mesh.node_groups["high_bottom"], 2] += 0.2
    message = r"tie 'glue': 9 of 9 nodes of 'high_bottom' lie farther than 0.025 m .* the nearest is node \d+ at .* m, 0.2 m"
    refused(mesh, tied(mesh, GLUE, supports=[("base", "xyz")]), MeshError, message)
    system_of(mesh, tied(mesh, GLUE.with_keys(tolerance=0.3), supports=[("base", "xyz")]))


def test_faults_of_several_ties_and_points_are_one_message():
    mesh = stack("hex8", "hex8")
    mesh.node_groups["node"] = mesh.node_groups["top"][:1]
    distant = [Tie(name=name, surfaces=("top", "low_top")) for name in "ab"]
    case = tied(mesh, *distant, supports=[("base", "xyz")], points=(Point(name="p", position=(0.0, 0.0, 3.0), group="node"),))
    refused(
        mesh, case, MeshError, r"(?s)3 faults:\n  1\. .*tie 'a': 9 of 9.*\n  2\. .*tie 'b': 9 of 9.*\n  3\. .*point 'p': the 1"
    )


def test_cyclic_ties_are_refused_and_repeated_ties_noted():
    mesh = stack("hex8", "hex8")
    back = Tie(name="back", surfaces=GLUE.surfaces[::-1])
    refused(
        mesh,
        tied(mesh, GLUE, back, supports=[("base", "xyz")]),
        MeshError,
        "tie 'glue' and tie 'back' follow each other in a ring",
    )
    repeated = Tie(name="again", surfaces=GLUE.surfaces)
    links = find_links(mesh, tied(mesh, GLUE, repeated, supports=[("base", "xyz")]))
    assert "tie 'again': 0 of 9 nodes of 'high_bottom' follow" in links.notes[1] and "; 9 follow another tie" in links.notes[1]
    assert len(links.dependent) == 27


def test_a_joint_on_tied_faces_is_refused():
    mesh = stack("hex8", "hex8")
    case = tied(mesh, GLUE, supports=[("base", "xyz")], joints=[joint(surfaces=("low_top", "high_bottom"))])
    refused(
        mesh,
        case,
        MeshError,
        "4 faces of 'low_top' of joint 'joint' are faces of 'low_top' of tie 'glue': tied faces cannot slip",
    )


def test_supports_on_following_nodes_are_refused_unless_the_leading_nodes_are_supported():
    mesh = stack("hex8", "hex8")
    mesh.node_groups["side"] = np.flatnonzero(mesh.points[:, 0] == 0.0)
    mesh.node_groups["high_side"] = np.flatnonzero(
        (mesh.points[:, 0] == 0.0) & np.isin(np.arange(len(mesh.points)), mesh.elements[1].nodes)
    )
    both = system_of(mesh, tied(mesh, GLUE, supports=[("base", "yz"), ("side", "x")]))  # the leading nodes are also supported
    assert both.at_nodes(np.ones(both.n_dof))[mesh.node_groups["side"], 0] == pytest.approx(0.0, abs=0.0)
    case = tied(mesh, GLUE, supports=[("base", "xyz"), ("high_side", "x")])
    refused(mesh, case, MeshError, r"3 degrees of freedom have a support and follow .* along x; support what leads")


def test_a_distributing_point_cannot_be_supported():
    mesh = column()
    case = tied(
        mesh,
        supports=[("base", "xyz")],
        points=(Point(name="p", position=(0.5, 0.5, 4.0), group="end", connection="distributing"),),
    )
    case = case.with_keys(supports=(*case.supports, Support(point="p", fix=("x",))))
    refused(mesh, case, MeshError, "point 'p' follows its nodes and cannot be held")


def test_tied_bodies_have_common_rigid_motions():
    mesh = stack("hex8", "hex8", (2, 2, 1), (3, 3, 1))
    point = Point(name="p", position=(0.5, 0.5, 2.5), group="top", mass=1.0)
    case = tied(mesh, GLUE, supports=[("base", "z")], points=(point,))
    system = system_of(mesh, case)
    assert system.rigid_owned.shape[1] == 3
    force = np.abs(multiply(system.K, system.rigid_owned)).max(initial=0.0)
    assert force <= 1e-12 * system.K.norm()
    assert any("2 translations and 1 turning motion" in note for note in system.notes)


def test_a_coarser_following_surface_is_noted():
    mesh = stack("hex8", "hex8", (3, 3, 1), (2, 2, 1))
    base = [("base", "xyz")]
    (note,) = system_of(mesh, tied(mesh, GLUE, supports=base)).constraints.notes
    assert note.startswith("tie 'glue': 9 nodes of 'high_bottom' follow the facets of 'low_top', up to ") and "swapped" in note
    (note,) = system_of(mesh, tied(mesh, Tie(name="a", surfaces=GLUE.surfaces[::-1]), supports=base)).constraints.notes
    assert "swapped" not in note


def test_points_on_collinear_nodes_are_refused():
    mesh = column()
    mesh.node_groups["line"] = np.flatnonzero((mesh.points[:, 0] == 0.0) & (mesh.points[:, 2] == 4.0))
    for connection in ("rigid", "distributing"):
        point = Point(name="p", position=(0.0, 0.0, 5.0), group="line", connection=connection)
        refused(
            mesh,
            tied(mesh, supports=[("base", "xyz")], points=(point,)),
            MeshError,
            "point 'p': the 5 nodes of 'line' lie on a line",
        )


def test_springs_of_points_and_ties_support_bodies():
    mesh = stack("hex8", "hex8")
    free_ = tied(mesh, supports=[("base", "xyz")])
    refused(mesh, free_, MeshError, "nothing holds body 'high'")
    system_of(mesh, tied(mesh, GLUE, supports=[("base", "xyz")]))
    point = Point(name="p", position=(0.5, 0.5, 2.0), group="top")
    refused(mesh, tied(mesh, points=(point,)), MeshError, "nothing holds body 'low'; body 'high'")
    free = system_of(mesh, tied(mesh, GLUE, points=(point,)))
    force = np.abs(multiply(free.K, free.rigid_owned)).max(initial=0.0)
    assert free.rigid_owned.shape[1] == 6 and force <= 1e-11 * max(comm.allgather(diagonal_owned(free.K).max(initial=0.0)))
    system_of(mesh, tied(mesh, GLUE, points=(point.with_keys(stiffness=(1.0, 1.0, 1.0)),)))


ON_TOP = ("low_top", "high_bottom")
LOW, HIGH = (Point(name=name, position=(0.5, 0.5, 1.0), group=name) for name in ON_TOP)
BASED = ("base", "xyz")


def jointed(supports, *points, n_high=(2, 2, 1), gap=0.0, **keys):
    """Return the notes of two stacked boxes with a joint and these supports of groups and points.  Collective."""
    of_groups, of_points = [s for s in supports if not isinstance(s, Support)], [s for s in supports if isinstance(s, Support)]
    mesh = stack("hex8", "hex8", n_high=n_high, gap=gap)
    case = tied(mesh, supports=of_groups, points=points, joints=[joint(surfaces=ON_TOP, **keys)])
    return system_of(mesh, case.with_keys(supports=(*case.supports, *of_points))).notes


def fixed(*names):
    return [Support(point=name, fix=("x", "y", "z", "rx", "ry", "rz")) for name in names]


@pytest.mark.parametrize(
    "supports, points",
    [
        ([BASED, *fixed("low_top", "high_bottom")], (LOW, HIGH)),
        ([BASED, ("low_top", "xyz"), *fixed("high_bottom")], (HIGH,)),
        ([BASED], (Point(name="both", position=(0.3, 0.2, 1.7), group="interface"),)),
    ],
)
def test_a_joint_whose_sides_cannot_move_relative_to_each_other_is_refused(supports, points):
    """Rows of R T vanish with both sides on fixed points, one of them on a support, or both on a free point; also with a gap."""
    with_gap = {"gap": 0.01, "pairing": "mortar", "tolerance": 0.02}
    for more in ({}, {"n_high": (3, 2, 1), "pairing": "mortar"}, with_gap):
        with pytest.raises(CaseError, match=r"joint 'joint': the two sides of all its \d+ pairs cannot move relative to each"):
            jointed(supports, *points, **more)


@pytest.mark.parametrize(
    "supports, points, words",
    [
        ([BASED, ("low_top", "z"), ("high_bottom", "z")], (), "9 of its 9 pairs cannot open: .* normal relative motion"),
        ([BASED, ("low_top", "xy"), ("high_bottom", "xy")], (), "9 of its 9 pairs cannot slip: .* tangential relative motion"),
        ([BASED, *fixed("low_top")], (LOW,), None),
        ([BASED], (LOW, HIGH), None),
        ([BASED, ("high_bottom", "z")], (), None),
    ],
)
def test_pairs_that_cannot_open_or_slip_are_reported(supports, points, words):
    notes = comm.bcast(jointed(supports, *points))
    assert len(re.findall(words, " ".join(notes))) == 1 if words else not any("cannot" in note for note in notes)


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize("entry", [1.0, 0.5])  # a selection of rows, and none
def test_reduced_matrices_equal_dense_products(entry):
    A, selected = np.random.default_rng(1).standard_normal((12, 12)), np.array([7, 2, 11, 3, 9, 0, 4, 10, 5])
    T = sp.csr_matrix((np.append(entry, np.ones(8)), (selected, np.arange(9))), (12, 9))
    ranges, row_ranges = (np.linspace(0, n, comm.size + 1).astype(int) for n in (12, 9))
    constraints = SimpleNamespace(T=T, n_nodal=12, nodal_ranges=ranges, row_ranges=row_ranges)
    projected = _projected(distributed(comm, sp.csr_matrix(A + A.T), ranges), constraints, comm)
    assert projected.getOwnershipRanges().tolist() == row_ranges.tolist()
    owned = slice(*row_ranges[comm.rank : comm.rank + 2])
    np.testing.assert_allclose(multiply(projected, np.eye(9)[owned]), (T.T @ (A + A.T) @ T)[owned], atol=1e-14)
    projected.destroy()
