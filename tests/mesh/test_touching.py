"""Search for touching faces of bodies and of parts, on meshes of every kind."""

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import KINDS, box, joint, mesh_of, settings

from microslip.mesh.cut import cut_through
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.skin import faces_of_group, skin_of_mesh
from microslip.mesh.surface import surface_of
from microslip.mesh.touching import find_touching, with_touching_surfaces
from microslip.messages.errors import MeshError
from microslip.tables.constant_loads import Bolt
from microslip.tables.structure import Surface

LOWER, UPPER = (1.0, 1.0, 0.5), (0.6, 1.0, 0.5)


def two_boxes(kind="hex8", other=None, at=(0.7, 0.0, 0.5), n=(5, 5, 1), size=UPPER):
    """Return a box on another one, of which it covers 0.3 x 1."""
    lower = ("lower", kind, *box(kind, (10, 5, 1), LOWER))
    return mesh_of(lower, ("upper", other or kind, *box(other or kind, n, size, at)))


def with_surfaces(mesh, *surfaces, bodies=("lower", "upper")):
    given = settings({name: name for name in bodies}, surfaces=surfaces)
    return with_touching_surfaces(mesh, given)


UP = Surface(name="up", bodies=("upper", "lower"))
LOW = Surface(name="low", bodies=("lower", "upper"))


@pytest.mark.parametrize("kind", KINDS)
def test_the_skin_is_the_surface_of_the_bodies(kind):
    mesh = mesh_of(("a", kind, *box(kind, (2, 3, 1), (1.0, 2.0, 3.0))), ("b", kind, *box(kind, (1, 1, 1), (1, 1, 1), (5, 0, 0))))
    skin = skin_of_mesh(mesh)
    assert [skin.area[skin.body == i].sum() for i in (0, 1)] == pytest.approx([22.0, 6.0], rel=1e-13)
    out = skin.centre - np.array([[0.5, 1.0, 1.5], [5.5, 0.5, 0.5]])[skin.body]
    assert (np.einsum("fi,fi->f", skin.normal, out) > 0.1).all() and len(np.unique(skin.part)) == 2


@pytest.mark.slow
@pytest.mark.parametrize("kind, other", [(kind, kind) for kind in KINDS] + [("hex20", "tet4"), ("tet10", "hex8")])
def test_only_touching_faces_are_selected(kind, other):
    mesh = with_surfaces(two_boxes(kind, other), UP, LOW)
    for name, low, high in (("up", 0.7, 1.06), ("low", 0.7, 1.0)):  # the edge at 1.0 is within a cell of the upper box
        points = mesh.points[mesh.node_groups[name]]
        assert points.min(axis=0) == pytest.approx([low, 0.0, 0.5]) and points.max(axis=0) == pytest.approx([high, 1.0, 0.5])
    assert sum(surface_of(mesh, "low").areas) == pytest.approx(0.3, rel=1e-12)
    pairs = pair_contacts(mesh, [joint(surfaces=("up", "low"), pairing="points")])
    assert pairs.area.sum() == pytest.approx(0.3, rel=1e-9)  # only the common part of partly covered faces


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("at, normal", [(0.5, (0.0, 0.0, 2.0)), (0.61, (0.1, 0.0, 1.0))])
def test_faces_through_a_body_follow_a_plane_and_separate_it(kind, at, normal):
    """With any elements the cut has the vector area of the cross-section, 0.3 x 0.2."""
    bars = [(f"bar {i}", kind, *box(kind, (3, 2, 7), (0.3, 0.2, 1.4), (i, 0.0, 0.0))) for i in (0, 1)]
    mesh = mesh_of(*bars)
    for block in mesh.elements:
        object.__setattr__(block, "group", "bars")  # one body of two shanks: the point of the plane selects one
    mesh = with_surfaces(
        mesh, Surface(name="cut", bodies=("bars", "bars"), through=(1.1, 0.1, at), normal=normal), bodies=("bars",)
    )
    cut = cut_through(mesh, Bolt(group="cut", force=1.0))
    unit = np.array(normal) / np.linalg.norm(normal)
    assert mesh.points[cut.nodes][:, 0].min() >= 1.0 and cut.normal == pytest.approx(unit)
    assert cut.area == pytest.approx(0.06 * unit[2], rel=1e-12)
    above = {number for numbers in cut.numbers.values() for number in numbers.tolist()}
    for block in mesh.elements:
        rows = np.isin(block.numbers, list(above))
        centres = mesh.points[block.nodes[rows]].mean(axis=1)
        assert ((centres - (1.1, 0.1, at)) @ unit > -1e-12).all()
    assert "faces inside 'bars', through (1.1, 0.1," in mesh.notes[-1]


@pytest.mark.parametrize(
    "keys, message",
    [
        (
            {"through": (0.5, 0.5, 9.0), "normal": (0.0, 0.0, 1.0)},
            r"no face inside 'lower' follows the plane .*: all elements lie on one",
        ),
        ({"through": (0.5, 0.5, 0.2)}, "normal is missing"),
        (
            {"through": (0.5, 0.5, 0.2), "normal": (0.0, 0.0, 1.0), "tolerance": 1.0},
            "through belongs to one body, named twice, and a",
        ),
        ({"through": (0.5, 0.5, 0.2), "normal": (0.0, 0.0, 1.0), "bodies": ("lower", "upper")}, "through belongs to one body"),
    ],
)
def test_planes_that_cut_nothing_are_refused(keys, message):
    with pytest.raises((MeshError, ValueError), match=message):
        with_surfaces(two_boxes(), Surface(**{"name": "cut", "bodies": ("lower", "lower"), **keys}))


def test_a_small_face_on_a_large_one_selects_it_and_distant_faces_are_refused():
    mesh = two_boxes(at=(0.33, 0.41, 0.5), n=(2, 2, 1), size=(0.02, 0.02, 0.1))
    low = with_surfaces(mesh, LOW).node_groups["low"]
    assert len(low) == 4 and (np.ptp(mesh.points[low], axis=0) == pytest.approx([0.1, 0.2, 0.0]))
    with pytest.raises(MeshError, match=r"no face of 'upper' lies on 'lower' .* the nearest nodes are 0.5 m apart, at node"):
        with_surfaces(two_boxes(at=(1.5, 0.0, 0.5)), UP)


def test_the_tolerance_limits_the_gap_of_touching_faces():
    mesh = two_boxes(at=(0.7, 0.0, 0.503))
    touching = find_touching(skin_of_mesh(mesh))
    assert touching.gap == pytest.approx(0.003, rel=1e-9)
    with pytest.raises(MeshError, match="within 0.002 m"):
        with_surfaces(mesh, UP.with_keys(tolerance=0.002))
    far = two_boxes(at=(0.7, 0.0, 0.53))
    with pytest.raises(MeshError, match="within 0.1 of the size of the faces"):
        with_surfaces(far, UP)
    assert len(with_surfaces(far, UP.with_keys(tolerance=0.04)).node_groups["up"])


def test_a_peg_touches_a_hole_with_another_mesh():
    def ring(n, inner, outer):
        points, nodes = box("hex8", (1, n, 3), (outer - inner, 2.0 * np.pi * (1 - 1e-9), 1.0), (inner, 0.0, 0.0))
        r, angle, z = points.T
        return np.column_stack([r * np.cos(angle), r * np.sin(angle), z]), nodes

    mesh = with_surfaces(
        mesh_of(("peg", "hex8", *ring(24, 0.5, 1.0)), ("hole", "hex8", *ring(31, 1.0, 2.0))),
        Surface(name="out", bodies=("peg", "hole")),
        bodies=("peg", "hole"),
    )
    faces = faces_of_group(mesh, skin_of_mesh(mesh), "out")
    assert len(faces) == 72 and np.linalg.norm(mesh.points[mesh.node_groups["out"]][:, :2], axis=1) == pytest.approx(1.0)


def test_touching_parts_of_one_body_are_selected_by_their_normals():
    two_bodies = two_boxes()
    one_body = replace(two_bodies, elements=tuple(replace(block, group="both") for block in two_bodies.elements), node_groups={})
    up = Surface(name="up", bodies=("both", "both"), normal=(0.1, 0.0, -1.0))
    mesh = with_surfaces(one_body, up, up.with_keys(name="low", normal=(0.0, 0.0, 2.0)), bodies=("both",))
    expected = with_surfaces(two_bodies, UP, LOW)
    for name in ("up", "low"):
        assert np.array_equal(mesh.node_groups[name], expected.node_groups[name])
    with pytest.raises(MeshError, match=r"no face of 'both' with normals within 45 degrees of \(1, 0, 0\) lies on 'both'"):
        with_surfaces(one_body, up.with_keys(normal=(1.0, 0.0, 0.0)), bodies=("both",))


def test_merged_bodies_and_repeated_names_are_refused():
    points, nodes = box("hex8", (2, 1, 1))
    blocks = mesh_of(("a", "hex8", points, nodes[:1]))
    merged = replace(blocks, elements=(blocks.elements[0], replace(blocks.elements[0], group="b", nodes=nodes[1:])))
    with pytest.raises(MeshError, match="they share 4 nodes, and are merged there"):
        with_surfaces(merged, Surface(name="up", bodies=("a", "b")), bodies=("a", "b"))
    with pytest.raises(MeshError, match="a group of the mesh has this name already"):
        with_surfaces(two_boxes(), UP.with_keys(name="lower"))
