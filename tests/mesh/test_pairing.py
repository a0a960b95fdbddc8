"""Contact pairs: frames of the curved surface, areas, parameters, and refused input."""

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import KINDS, box, joint, mesh_of

from microslip.mesh.data import FaceBlock
from microslip.mesh.pairing import contact_frames, pair_contacts
from microslip.messages.errors import MeshError

TOUCH = {
    "lower_top": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) < len(x) / 2),
    "upper_bottom": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) >= len(x) / 2),
}


def two_boxes(kind, upper_kind=None, n=(2, 3, 1)):
    """Return a lower and an upper unit box that touch at z = 1, without common nodes."""
    lower, upper = box(kind, n), box(upper_kind or kind, n, origin=(0.0, 0.0, 1.0))
    return mesh_of(("lower", kind, *lower), ("upper", upper_kind or kind, *upper), groups=TOUCH)


def ring(kind, n=(6, 2, 1), sweep=np.pi / 2, groups=TOUCH):
    """Return two concentric ring sectors about the y axis that touch at radius 2, mid-sides on the arcs."""
    parts = []
    for name, low in (("lower", 0.0), ("upper", 1.0)):
        points, elements = box(kind, n, origin=(0.0, 0.0, low))
        parts.append((name, kind, points, elements))
    mesh = mesh_of(*parts, groups=groups)
    angle, radius = sweep * mesh.points[:, 0], 1.0 + mesh.points[:, 2]
    mesh.points[:] = np.stack([-radius * np.cos(angle), mesh.points[:, 1], radius * np.sin(angle)], axis=1)
    return mesh


@pytest.mark.parametrize("kind", KINDS)
def test_flat_pairs_have_frames_areas_and_matching_nodes(kind):
    mesh = two_boxes(kind)
    pairs = pair_contacts(mesh, [joint(surfaces=("upper_bottom", "lower_top"))])
    np.testing.assert_allclose(mesh.points[pairs.node1], mesh.points[pairs.node2])
    assert set(pairs.node1) == set(mesh.node_groups["upper_bottom"])
    assert set(pairs.node2) == set(mesh.node_groups["lower_top"])
    np.testing.assert_allclose(pairs.frame, np.tile(np.eye(3), (pairs.n_pairs, 1, 1)), atol=1e-12)
    assert (pairs.area > 0).all()
    assert pairs.area.sum() == pytest.approx(1.0, rel=1e-12)
    assert (np.diff(mesh.numbers[pairs.node1]) > 0).all()
    swapped = pair_contacts(mesh, [joint(surfaces=("lower_top", "upper_bottom"))])
    np.testing.assert_allclose(swapped.frame[:, 2], -pairs.frame[:, 2], atol=1e-12)


def test_parameters_are_per_unit_area():
    pairs = pair_contacts(two_boxes("hex8"), [joint(friction_limit="separate")])
    np.testing.assert_allclose(pairs.k_t, 2e13 * pairs.area)
    np.testing.assert_allclose(pairs.k_n, 3e13 * pairs.area)
    np.testing.assert_allclose(pairs.N0, 5e7 * pairs.area)
    assert (pairs.mu == 0.3).all() and pairs.separate.all()
    gap = pair_contacts(two_boxes("hex8"), [joint(gap=1e-5, preload=0.0)])
    np.testing.assert_allclose(-gap.N0 / gap.k_n, 1e-5)


def test_faces_index_pairs_and_cover_the_surface():
    mesh = two_boxes("hex20")
    pairs = pair_contacts(mesh, [joint("one"), joint("two", surfaces=("upper_bottom",))])  # the second joint is against ground
    assert pairs.joint == ("one",) * (pairs.n_pairs // 2) + ("two",) * (pairs.n_pairs // 2)
    assert [faces.shape for faces in pairs.faces] == [(6, 8), (6, 8)]
    assert set(pairs.faces[1].ravel()) == set(range(pairs.n_pairs // 2, pairs.n_pairs))


def test_no_joints_give_no_pairs():
    pairs = pair_contacts(two_boxes("hex8"), [])
    assert pairs.n_pairs == 0 and pairs.frame.shape == (0, 3, 3) and pairs.joint == ()


CYLINDERS = [("hex20", 0.3), ("wedge15", 0.3), ("tet10", 1.5), ("hex8", 8.0), ("tet4", 8.0)]


def assert_frames(frames):
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (len(frames), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)


@pytest.mark.parametrize("kind, tolerance", CYLINDERS)
def test_normals_and_areas_of_a_cylinder_are_accurate(kind, tolerance):
    mesh = ring(kind)
    pairs = pair_contacts(mesh, [joint()])  # body 1 is inside, body 2 outside: z points to the axis
    radial = pairs.position * (1.0, 0.0, 1.0) / 2.0
    angle = np.degrees(np.arccos(np.clip(-np.einsum("pi,pi->p", pairs.frame[:, 2], radial), -1, 1)))
    assert angle.max() < tolerance
    assert_frames(pairs.frame)
    np.testing.assert_allclose(pairs.frame[:, 0], np.tile([0.0, 1.0, 0.0], (pairs.n_pairs, 1)), atol=0.05)
    assert (pairs.area > 0).all()
    exact = np.pi if kind in ("hex20", "wedge15", "tet10") else 2.0 * 6 * 2.0 * np.sin(np.pi / 24)
    assert pairs.area.sum() == pytest.approx(exact, rel=1e-4 if exact == np.pi else 1e-12)


def test_frames_of_all_normals_are_orthonormal():
    rng = np.random.default_rng(1)
    z = rng.normal(size=(500, 3))
    z = np.concatenate([z / np.linalg.norm(z, axis=1, keepdims=True), np.eye(3), -np.eye(3)])
    frames = contact_frames(z)
    assert_frames(frames)
    np.testing.assert_allclose(frames[:, 2], z)


def test_named_faces_select_the_surface_in_any_order_of_nodes():
    mesh = two_boxes("hex8")
    top = mesh.node_groups["lower_top"]
    faces = next(block.nodes[:, [4, 5, 6, 7]] for block in mesh.elements if block.group == "lower")
    faces = faces[np.isin(faces, top).all(axis=1)]
    half = faces[mesh.points[faces][:, :, 0].mean(axis=1) < 0.5]
    groups = {**mesh.node_groups, "half": np.unique(half)}
    for order in ([0, 1, 2, 3], [3, 2, 1, 0], [1, 2, 3, 0]):
        named = replace(mesh, faces=(FaceBlock("quad4", "half", half[:, order]),), node_groups=groups)
        message = "0 of 8 nodes of 'half' and 4 of 12 nodes of 'upper_bottom' have no partner"
        with pytest.raises(MeshError, match=message):
            pair_contacts(named, [joint(surfaces=("half", "upper_bottom"))])


def test_a_hole_in_named_faces_has_no_contact():
    """All nodes of the middle face are in the group, but the face is not."""
    mesh, named = two_boxes("hex8", n=(3, 3, 1)), []
    for body, group, local in (("lower", "lower_top", [4, 5, 6, 7]), ("upper", "upper_bottom", [0, 1, 2, 3])):
        faces = next(block.nodes[:, local] for block in mesh.elements if block.group == body)
        is_middle = np.linalg.norm(mesh.points[faces].mean(axis=1)[:, :2] - 0.5, axis=1) < 0.1
        named.append(FaceBlock("quad4", group, faces[~is_middle]))
    mesh = replace(mesh, faces=tuple(named))
    pairs = pair_contacts(mesh, [joint()])
    assert pairs.n_pairs == 16 and pairs.faces[0].shape == (8, 4)
    assert pairs.area.sum() == pytest.approx(8 / 9)


def test_unmatched_nodes_are_counted_and_located():
    mesh = two_boxes("hex8")
    moved = mesh.node_groups["upper_bottom"][4]
    mesh.points[moved] += (2e-4, 0.0, 0.0)
    number = mesh.numbers[mesh.node_groups["lower_top"][4]]
    message = "1 of 12 nodes of 'lower_top' and 1 of 12 nodes of 'upper_bottom' have no partner"
    with pytest.raises(MeshError, match=rf"{message} within 2.45e-06 m; the worst is node {number} .*, 0.0002 m from"):
        pair_contacts(mesh, [joint()])
    assert pair_contacts(mesh, [joint(tolerance=1e-3)]).n_pairs == 12


def test_two_nodes_with_one_partner_are_refused():
    mesh = two_boxes("hex8")
    first, second = mesh.node_groups["upper_bottom"][:2]
    mesh.points[second] = mesh.points[first] + (0, 0.1, 0)
    with pytest.raises(MeshError, match="both lie within 0.6 m of node"):
        pair_contacts(mesh, [joint(tolerance=0.6)])


def test_a_surface_inside_merged_bodies_is_refused():
    points, elements = box("hex8", (2, 2, 2))
    groups = {"lower_top": lambda x: x[:, 2] == 0.5, "upper_bottom": lambda x: x[:, 2] == 0.5}
    mesh = mesh_of(("all", "hex8", points, elements), groups=groups)
    with pytest.raises(MeshError, match=r"lie inside the mesh, where elements share nodes.*needs nodes of its own"):
        pair_contacts(mesh, [joint()])


def test_surfaces_with_common_nodes_are_refused():
    points, elements = box("hex8", (2, 2, 2))
    groups = {"lower_top": lambda x: x[:, 2] == 1.0, "upper_bottom": lambda x: x[:, 0] == 1.0}
    mesh = mesh_of(("all", "hex8", points, elements), groups=groups)
    with pytest.raises(MeshError, match=r"share 3 nodes .* so the bodies are merged there and cannot slip"):
        pair_contacts(mesh, [joint()])


def test_a_sharp_edge_in_a_surface_is_refused():
    groups = {**TOUCH, "corner": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) < len(x) / 2) | (x[:, 0] == 1.0)}
    lower, upper = box("hex8"), box("hex8", origin=(0.0, 0.0, 1.0))
    mesh = mesh_of(("lower", "hex8", *lower), ("upper", "hex8", *upper), groups=groups)
    with pytest.raises(MeshError, match="meet in a sharp edge at node"):
        pair_contacts(mesh, [joint(surfaces=("corner", "upper_bottom"))])


def test_sides_that_do_not_face_each_other_are_refused():
    lower = box("hex8")
    mesh = mesh_of(("lower", "hex8", *lower), ("upper", "hex8", *lower), groups=TOUCH)  # the boxes coincide
    with pytest.raises(MeshError, match=r"do not face each other at 9 of 9 pairs: .* 180 degrees from opposite"):
        pair_contacts(mesh, [joint()])


def test_a_group_without_a_face_is_refused():
    mesh = two_boxes("hex8")
    mesh.node_groups["corner"] = mesh.node_groups["lower_top"][:1]
    with pytest.raises(MeshError, match="group 'corner' has no outer face of an element"):
        pair_contacts(mesh, [joint(surfaces=("corner", "upper_bottom"))])
