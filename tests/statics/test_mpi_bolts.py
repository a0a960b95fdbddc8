"""Bolts with pretension against closed forms: a bar with a cut, a bolt and its members; on one rank and on several."""

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import box, joint, made_of, mesh_of, settings

from microslip.assembly.assemble import assemble
from microslip.assembly.prestress import constant_forces, stiffness_at_rest
from microslip.assembly.pretension import pretension
from microslip.linear.joint_springs import linearise
from microslip.mesh.cut import cut_through
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.messages.errors import CaseError, MeshError
from microslip.parallel.agree import on_root
from microslip.statics.bolts import cuts_of
from microslip.statics.equilibrium import Flexibility, equilibrium
from microslip.tables.constant_loads import Bolt, Force, Statics, Temperature
from microslip.tables.structure import Body, Material, Tie

YOUNG, DENSITY, EXPANSION = 2.0e11, 8000.0, 1e-5
LENGTH, WIDTH = 0.1, 0.02  # m, of the bar along x
AREA = WIDTH**2
STIFFNESS = YOUNG * AREA / LENGTH


def steel(young=YOUNG):
    return Material(young=young, poisson=0.0, expansion=EXPANSION, density=DENSITY)


def bar(kind, bulge=0.0, n=(4, 2, 2)):
    """Return a bar, fixed at both ends, with a cut in the middle that may bulge."""
    points, elements = box(kind, n, (LENGTH, WIDTH, WIDTH))
    x, y = points[:, 0] / LENGTH, points[:, 1] / WIDTH
    is_cut = x == 0.5
    points[:, 0] += bulge * WIDTH * 4.0 * y * (1.0 - y) * np.minimum(x, 1.0 - x) * 2.0
    ends = np.isin(x, (0.0, 1.0))
    return mesh_of(("bar", kind, points, elements), groups={"cut": lambda _: is_cut, "ends": lambda _: ends})


def of_bar(**statics):
    given = settings({"bar": "bar"}, supports=[("ends", "xyz")])
    return made_of(given, steel()).with_keys(statics=Statics(**statics))


def at_rest(comm, mesh, given):
    """Return structure, bolts and rest; ``mesh`` is used on rank 0.  Collective."""
    pairs = on_root(comm, pair_contacts, mesh, given.joints)
    shares = distribute(mesh, given, comm)
    system = assemble(shares, mesh, pairs, given)
    bolts = pretension(shares, mesh, given, system)
    linearised = linearise(system, pairs)
    try:
        forces = constant_forces(shares, mesh, given, system)
        rest = equilibrium(Flexibility(linearised), pairs, forces, given.statics.steps, cuts_of(linearised, bolts))
    finally:
        linearised.destroy()
    return shares, system, pairs, bolts, rest


def bolt(name="bolt", group="cut", **given):
    return Bolt.of_file(name=name, group=group, **given)


@pytest.mark.slow
@pytest.mark.parametrize("given", [{"shortening": 1e-5}, {"force": STIFFNESS * 1e-5}], ids=["by length", "by force"])
@pytest.mark.parametrize("bulge", [0.0, 0.15], ids=["plane", "bulging"])
@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "hex20", "wedge15"])
def test_a_bolted_bar_between_walls_has_the_force_of_a_spring(comm, kind, bulge, given):
    """F = (E A / L) delta with stated force or shortening; the strain of the bar is uniform."""
    mesh = on_root(comm, bar, kind, bulge, share=False)
    _, system, _, _, rest = at_rest(comm, mesh, of_bar(bolts=(bolt(**given),)))
    bolts = rest.bolts
    assert bolts.area == pytest.approx(AREA, rel=1e-9)
    assert bolts.force == pytest.approx(STIFFNESS * 1e-5, rel=1e-8)
    assert bolts.tightened == pytest.approx(STIFFNESS * 1e-5, rel=1e-8)
    assert bolts.shortening == pytest.approx(1e-5, rel=1e-8)
    u = np.concatenate(comm.allgather(rest.u_owned))

    def error():
        x = bar(kind).points[:, 0]
        place = mesh.points[:, 0] / LENGTH
        expected = 1e-5 * (place - (x > 0.5 * LENGTH))
        free = system.dof[:, 0] >= 0
        return np.abs(u[system.dof[free, 0]] - expected[free]).max()

    assert on_root(comm, error) < 1e-5 * 1e-8


def tied_halves():
    """Return the bar of two tied halves, the right one with a finer mesh, with a cut in the left one."""
    half = (LENGTH / 2.0, WIDTH, WIDTH)
    left, right = box("hex8", (4, 2, 2), half), box("hex8", (2, 4, 4), half, (LENGTH / 2.0, 0.0, 0.0))
    is_left = np.arange(len(left[0]) + len(right[0])) < len(left[0])
    groups = {
        "cut": lambda x: np.isclose(x[:, 0], LENGTH / 4.0) & is_left,
        "ends": lambda x: np.isclose(x[:, 0], 0.0) | np.isclose(x[:, 0], LENGTH),
        "left_end": lambda x: np.isclose(x[:, 0], LENGTH / 2.0) & is_left,
        "right_start": lambda x: np.isclose(x[:, 0], LENGTH / 2.0) & ~is_left,
    }
    return mesh_of(("left", "hex8", *left), ("right", "hex8", *right), groups=groups)


def test_a_bolted_bar_of_tied_halves_has_the_force_of_a_spring(comm):
    mesh = on_root(comm, tied_halves, share=False)
    given = settings({"left": "left", "right": "right"}, supports=[("ends", "xyz")])
    tie = Tie(name="glue", surfaces=("right_start", "left_end"))
    given = made_of(given, steel()).with_keys(ties=(tie,), statics=Statics(bolts=(bolt(shortening=1e-5),)))
    *_, rest = at_rest(comm, mesh, given)
    assert rest.bolts.force == pytest.approx(STIFFNESS * 1e-5, rel=1e-8)


@pytest.mark.parametrize("kind", ["tet10", "hex20"])
def test_the_stress_of_the_bolt_stiffens_the_bar_by_its_force(comm, kind):
    """w^T K_sigma w = F int w'^2 dx for w = x (L - x) across the bar, with the stress of elements above the cut."""
    mesh = on_root(comm, bar, kind, share=False)
    given = of_bar(bolts=(bolt(force=5000.0),))
    shares, system, _, bolts, rest = at_rest(comm, mesh, given)

    def motions(block, i, rows):
        return bolts.overlap.motions_of(block, i, rows, rest.bolts.shortening)

    stiffened = stiffness_at_rest(shares, given, system, rest.u_owned, motions).K
    stiffened.axpy(-1.0, system.K)
    w, K_w = stiffened.createVecs()

    def shape():
        values = np.zeros(system.n_dof)
        free = system.dof[:, 1] >= 0
        x = mesh.points[free, 0]
        values[system.dof[free, 1]] = x * (LENGTH - x)
        return values

    w.setArray(on_root(comm, shape)[slice(*w.getOwnershipRange())])
    stiffened.mult(w, K_w)
    assert w.dot(K_w) == pytest.approx(5000.0 * LENGTH**3 / 3.0, rel=1e-8)
    stiffened.destroy()


def test_heating_reduces_the_force_of_a_tightened_bolt(comm):
    """After tightening the shortening is constant; heating between the walls reduces the force by E A alpha theta."""
    mesh = on_root(comm, bar, "hex8", share=False)
    *_, rest = at_rest(
        comm, mesh, of_bar(bolts=(bolt(force=6000.0),), temperatures=(Temperature(group="bar", temperature=20.0),))
    )
    assert rest.bolts.tightened == pytest.approx(6000.0, rel=1e-8)
    assert rest.bolts.force == pytest.approx(6000.0 - YOUNG * AREA * EXPANSION * 20.0, rel=1e-8)


def test_the_force_of_a_rotating_bolt_is_that_of_theory(comm):
    """A bar between two walls rotates about one: N(x) = rho A Omega^2 (L^2 / 6 - x^2 / 2) adds to the force of the bolt."""
    mesh = on_root(comm, bar, "hex20", share=False)
    *_, rest = at_rest(comm, mesh, of_bar(bolts=(bolt(force=100.0),), rotation_speed=1000.0))
    change = DENSITY * AREA * 1000.0**2 * LENGTH**2 * (1.0 / 6.0 - 1.0 / 8.0)
    assert rest.bolts.force - rest.bolts.tightened == pytest.approx(change, rel=1e-8)


# -- a bolt and its members ---------------------------------------------------------------------------------

HEAD, CONTACT, GRIP = 0.02, 5e13, 0.1  # m; N/m3; m, along z
K_BOLT = YOUNG * AREA / GRIP
K_MEMBER = 2.0 * AREA / (GRIP / YOUNG + 1.0 / CONTACT)
CLAMP = 5000.0


def clamped():
    """Return a shank between two columns under a head of 1e6 times their stiffness; shank and head have common nodes."""
    column, elements = box("hex8", (2, 2, 4), (WIDTH, WIDTH, GRIP))
    head, of_head = box("hex8", (6, 2, 1), (3.0 * WIDTH, WIDTH, HEAD), (-WIDTH, 0.0, GRIP))
    distance = np.linalg.norm(column[:, None] - head[None], axis=2)
    is_common = distance.min(axis=1) < 1e-9
    number = np.where(is_common, len(column) + np.argmin(distance, axis=1), np.arange(len(column)))
    points, used = (
        np.concatenate([column, head]),
        np.unique(np.concatenate([number[elements].ravel(), of_head.ravel() + len(column)])),
    )
    new = np.cumsum(np.isin(np.arange(len(points)), used)) - 1
    mesh = mesh_of(
        ("shank", "hex8", points[used], new[number[elements]]),
        *((name, "hex8", column + (shift, 0.0, 0.0), elements) for name, shift in (("left", -WIDTH), ("right", WIDTH))),
    )
    of_head = new[of_head + len(column)]
    blocks = (replace(mesh.elements[0], group="head", nodes=of_head, numbers=1000 + np.arange(len(of_head))), *mesh.elements)
    z = mesh.points[:, 2]
    nodes = {block.group: np.unique(block.nodes) for block in blocks}
    low = np.isclose(z, GRIP)
    groups = nodes | {
        "cut": np.intersect1d(np.flatnonzero(np.isclose(z, 0.5 * GRIP)), nodes["shank"]),
        "base": np.flatnonzero(z == 0.0),
        "seats": np.intersect1d(np.flatnonzero(low), np.union1d(nodes["left"], nodes["right"])),
        "under_head": np.intersect1d(np.flatnonzero(low), nodes["head"]),
    }
    groups["under_left"] = np.intersect1d(np.flatnonzero(low & (mesh.points[:, 0] < 1e-9)), nodes["head"])
    groups["under_right"] = np.intersect1d(np.flatnonzero(low & (mesh.points[:, 0] > WIDTH - 1e-9)), nodes["head"])
    groups["seat_left"] = np.intersect1d(groups["seats"], nodes["left"])
    groups["seat_right"] = np.intersect1d(groups["seats"], nodes["right"])
    return replace(mesh, elements=blocks, node_groups=groups)


def of_clamped(pull=0.0, push=0.0, **given):
    """Return the settings: all bodies move along z; shank and head also move along x if a force acts on the head along x."""
    names = ("shank", "head", "left", "right")
    supports = [("base", "xyz"), *((name, "y" if push and name in names[:2] else "xy") for name in names)]
    joints = [joint(side, (f"seat_{side}", f"under_{side}"), preload=0.0, normal_stiffness=CONTACT) for side in ("left", "right")]
    loads = tuple(
        Force(group=group, force=force)
        for group, force in (("under_head", (push, 0.0, 0.0)), ("head", (0.0, 0.0, pull)))
        if any(force)
    )
    materials = {name: steel(YOUNG * (1e6 if name == "head" else 1.0)) for name in names}
    bodies = {name: Body(group=name, material=name) for name in names}
    case = settings({name: name for name in names}, supports=supports, joints=joints)
    statics = Statics(bolts=(bolt(**(given or {"force": CLAMP})),), forces=loads, steps=4)
    return case.with_keys(materials=materials, bodies=bodies, statics=statics)


@pytest.fixture(scope="module")
def clamped_mesh(comm):
    return on_root(comm, clamped, share=False)


def test_the_shortening_of_a_bolt_is_the_sum_of_elongation_and_compression(comm, clamped_mesh):
    *_, pairs, _, rest = at_rest(comm, clamped_mesh, of_clamped())
    assert rest.bolts.shortening == pytest.approx(CLAMP / K_BOLT + CLAMP / K_MEMBER, rel=1e-5)
    assert rest.N.sum() == pytest.approx(CLAMP, rel=1e-8)
    assert rest.bolts.force == pytest.approx(CLAMP, rel=1e-8) and rest.bolts.tightened == pytest.approx(CLAMP, rel=1e-8)
    *_, by_length = at_rest(comm, clamped_mesh, of_clamped(shortening=float(rest.bolts.shortening[0])))
    assert by_length.bolts.force == pytest.approx(CLAMP, rel=1e-8)


@pytest.mark.parametrize("ratio", [0.5, 0.999, 1.001, 2.0])
def test_a_closed_joint_shares_a_load_by_stiffness(comm, clamped_mesh, ratio):
    """The bolt bears k_b / (k_b + k_m) of it; beyond P = F (1 + k_b / k_m) the joint is open, and the bolt bears all."""
    opens = CLAMP * (1.0 + K_BOLT / K_MEMBER)
    pull = ratio * opens
    *_, rest = at_rest(comm, clamped_mesh, of_clamped(pull=pull))
    closed = pull < opens
    expected = CLAMP + pull * K_BOLT / (K_BOLT + K_MEMBER) if closed else pull
    assert rest.bolts.tightened == pytest.approx(CLAMP, rel=1e-8)
    assert rest.bolts.force == pytest.approx(expected, rel=1e-4)
    assert (rest.N > 0.0).all() if closed else not rest.N.any()


def test_friction_under_the_head_bears_a_force_up_to_its_limit(comm, clamped_mesh):
    """Under half of mu F on the head all pairs stick; beyond mu F all slide, and bending of the shank bears the rest."""
    *_, sticks = at_rest(comm, clamped_mesh, of_clamped(push=0.5 * 0.3 * CLAMP))
    assert (np.abs(sticks.force[:, :2]).sum(axis=1) < 0.3 * sticks.N * (1.0 - 1e-6)).all()
    assert np.abs(sticks.force[:, :2].sum(axis=0)).max() == pytest.approx(0.5 * 0.3 * CLAMP, rel=0.01)
    *_, slides = at_rest(comm, clamped_mesh, of_clamped(push=1.1 * 0.3 * CLAMP))
    assert np.hypot(*slides.force[:, :2].T) == pytest.approx(0.3 * slides.N, rel=1e-8)
    assert slides.bolts.force == pytest.approx(slides.N.sum(), rel=1e-4)  # the shank is hardly inclined


# -- cuts ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "hex20", "wedge6", "wedge15"])
def test_elements_above_a_cut_have_nodes_on_it_and_are_on_its_positive_side(comm, kind):
    def check():
        mesh = bar(kind, bulge=0.1)
        cut = cut_through(mesh, bolt())
        (block,) = mesh.elements
        assert cut.normal == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)
        touches = np.isin(block.nodes, mesh.node_groups["cut"]).any(axis=1)
        n_corners = {"t": 4, "h": 8, "w": 6}[kind[0]]
        straight = bar(kind).points[block.nodes[:, :n_corners], 0].mean(axis=1)
        assert set(cut.numbers[kind, "bar"]) == set(block.numbers[touches & (straight > 0.5 * LENGTH)])

    on_root(comm, check)


def bar_with_groups(kind="hex8", **more):
    points, elements = box(kind, (4, 2, 2), (LENGTH, WIDTH, WIDTH))
    ends = {"ends": lambda x: np.isin(x[:, 0], (0.0, LENGTH))}
    return mesh_of(("bar", kind, points, elements), groups=ends | more)


def middle(x):
    return x[:, 0] == 0.5 * LENGTH


NO_CUTS = {
    "outer": (lambda x: x[:, 0] == LENGTH, "it holds no face between two elements"),
    "half": (
        lambda x: middle(x) & (x[:, 1] <= 0.5 * WIDTH),
        "the cut does not go through: .* at node .* all faces from side to side",
    ),
    "two": (lambda x: np.isin(x[:, 0], (0.25 * LENGTH, 0.75 * LENGTH)), "the faces form 2 separate cuts"),
    "corner": (
        lambda x: (middle(x) & (x[:, 1] >= 0.5 * WIDTH)) | ((x[:, 1] == 0.5 * WIDTH) & (x[:, 0] <= 0.5 * LENGTH)),
        "a face turns 4|5",
    ),
}


@pytest.mark.parametrize("name", NO_CUTS)
def test_a_group_that_is_no_cut_is_refused(comm, name):
    group, message = NO_CUTS[name]

    def refuse():
        with pytest.raises(MeshError, match=rf"box.msh: bolt 'bolt': group 'cut': .*{message}"):
            cut_through(bar_with_groups(cut=group), bolt())

    on_root(comm, refuse)


def test_a_support_of_a_cut_is_refused(comm):
    mesh = on_root(comm, lambda: bar_with_groups(cut=middle), share=False)
    supported = of_bar(bolts=(bolt(force=1.0),)).with_keys(
        supports=settings({}, supports=[("ends", "xyz"), ("cut", "x")]).supports
    )
    with pytest.raises(MeshError, match="cannot open, for a support holds it along the shank"):
        at_rest(comm, mesh, supported)


def test_adjacent_cuts_are_refused(comm):
    mesh = on_root(comm, lambda: bar_with_groups(cut=middle, other=lambda x: x[:, 0] == 0.75 * LENGTH), share=False)
    with pytest.raises(MeshError, match="bolts 'bolt' and 'second': their cuts lie side by side at node"):
        at_rest(comm, mesh, of_bar(bolts=(bolt(force=1.0), bolt("second", "other", force=1.0))))


def test_a_bolt_without_members_is_refused(comm):
    mesh = on_root(comm, lambda: bar_with_groups(cut=middle, start=lambda x: x[:, 0] == 0.0), share=False)
    free = of_bar(bolts=(bolt(force=1.0),)).with_keys(supports=settings({}, supports=[("start", "xyz")]).supports)
    with pytest.raises(CaseError, match=r"\[\[statics.bolts\]\] 'bolt': there is nothing to clamp"):
        at_rest(comm, mesh, free)
