"""Contact of surfaces with different meshes: averages over the overlap of their faces, and refused input."""

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import KINDS, box, joint, mesh_of

from microslip import elements
from microslip.mesh.pairing import contact_frames, contact_points, pair_contacts
from microslip.mesh.surface import surface_of
from microslip.messages.errors import MeshError

TOUCH = {
    "lower_top": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) < TOUCH["n"]),
    "upper_bottom": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) >= TOUCH["n"]),
    "upper_top": lambda x: x[:, 2] == 2.0,
    "lower_bottom": lambda x: x[:, 2] == 0.0,
    "n": 0,
}
SURFACES = ("upper_bottom", "lower_top")


def boxes(lower="hex8", upper="hex8", n_lower=(2, 3, 1), n_upper=(3, 4, 1), size=(1.0, 1.0, 1.0), shift=(0.0, 0.0)):
    """Return two boxes with different meshes, the upper one on the lower one at z = 1."""
    first, second = box(lower, n_lower), box(upper, n_upper, size=size, origin=(*shift, 1.0))
    TOUCH["n"] = len(first[0])
    groups = {name: claim for name, claim in TOUCH.items() if name != "n"}
    return mesh_of(("lower", lower, *first), ("upper", upper, *second), groups=groups)


def skewed(mesh, amount=0.12):
    """Move inner nodes within each plane z, differently in the two bodies, so that faces have no parallel sides."""
    x, y = mesh.points[:, 0].copy(), mesh.points[:, 1].copy()
    factor = np.where(np.arange(len(x)) < TOUCH["n"], 1.0, -1.3)
    bump = amount * factor * np.sin(np.pi * x) * np.sin(np.pi * y)
    mesh.points[:, 0] += bump
    mesh.points[:, 1] += 0.7 * bump
    return mesh


def consistent_areas(mesh, group):
    """Return the integrals of the shape functions of a surface by node of the mesh, (n_nodes,)."""
    total = np.zeros(len(mesh.points))
    for kind, faces in surface_of(mesh, group).faces.items():
        forces = elements.pressure_forces(kind, mesh.points[faces])
        np.add.at(total, faces, -np.einsum("fai,fai->fa", forces, elements.face_normals(kind, mesh.points[faces])))
    return total


@pytest.mark.slow
@pytest.mark.parametrize("lower", KINDS)
@pytest.mark.parametrize("upper", ["hex8", "tet10"])
def test_averages_over_cells_are_exact_for_linear_fields_and_uniform_pressure(lower, upper):
    """Both sides reproduce linear fields, and a uniform pressure gives the consistent nodal forces on both."""
    mesh = boxes(lower, upper)
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing="points"))
    assert points.note and (points.area > 0.0).all()
    for side in (points.side1, points.side2):
        np.testing.assert_allclose(side.sum(axis=1), 1.0, rtol=1e-13)
        np.testing.assert_allclose(side @ mesh.points, points.position, atol=1e-13)
    if upper == "hex8":  # rectangles: the mean of the corners is the centre of the cell
        np.testing.assert_allclose(points.position, points.cells.mean(axis=1), atol=1e-13)
    assert points.area.sum() == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(points.z, np.tile([0.0, 0.0, 1.0], (points.n_points, 1)), atol=1e-12)
    np.testing.assert_allclose(points.side1.T @ points.area, consistent_areas(mesh, "upper_bottom"), atol=1e-13)
    np.testing.assert_allclose(points.side2.T @ points.area, consistent_areas(mesh, "lower_top"), atol=1e-13)


@pytest.mark.parametrize("lower", ["hex20", "tet4"])
@pytest.mark.parametrize("upper", ["hex8", "hex20", "tet4", "tet10"])
def test_mortars_are_exact_for_linear_fields_and_uniform_pressure(lower, upper):
    """A mortar reproduces linear fields and gives the consistent nodal forces of a uniform pressure."""
    mesh = boxes(lower, upper)
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing="mortar"))
    assert (points.area > 0.0).all() and points.area.sum() == pytest.approx(1.0, rel=1e-12)
    for group, side in zip(SURFACES, (points.side1, points.side2)):
        np.testing.assert_allclose(side.sum(axis=1), 1.0, rtol=1e-12)
        np.testing.assert_allclose(side @ mesh.points, points.position, atol=1e-12)
        np.testing.assert_allclose(side.T @ points.area, consistent_areas(mesh, group), atol=1e-12)


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "tet10"])
def test_a_mortar_of_matching_meshes_has_the_consistent_stiffness(kind):
    """The stiffness is the integral of products of shape functions; equal motion of both sides has no relative motion."""
    mesh = boxes(kind, kind, n_upper=(2, 3, 1))
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing="mortar"))
    ((face_kind, faces),) = surface_of(mesh, "upper_bottom").faces.items()
    rule, is_square = elements.FINER_SAMPLES, face_kind.startswith("quad")
    local = np.concatenate([2.0 * rule.points - 1.0, 1.0 - 2.0 * rule.points]) if is_square else rule.points
    N = elements.FACE_KINDS[face_kind].values(local)
    of_face = np.einsum("s,sa,sb->ab", np.resize(rule.weights, len(local)), N, N) / np.resize(rule.weights, len(local)).sum()
    exact = np.zeros((len(mesh.points), len(mesh.points)))
    for face in faces:
        exact[np.ix_(face, face)] += of_face / len(faces)
    side1, side2 = points.side1.toarray(), points.side2.toarray()
    np.testing.assert_allclose(side1.T @ (points.area[:, None] * side1), exact, atol=1e-13)
    field = np.sin(3.0 * mesh.points[:, 0] + mesh.points[:, 1])
    np.testing.assert_allclose(side1 @ field, side2 @ field, atol=1e-12)


def test_a_mortar_uses_means_on_partly_covered_faces():
    mesh = boxes(n_lower=(5, 4, 1), n_upper=(8, 8, 1), size=(1.008, 1.008, 1.0))
    mortar, means = (contact_points(mesh, joint(surfaces=SURFACES, pairing=pairing)) for pairing in ("mortar", "points"))
    same = np.abs((mortar.side1 - means.side1).toarray()).max(axis=1) < 1e-12
    assert np.count_nonzero(same) == 4 * 15  # points of the faces along two edges
    assert "contact points, mortars on faces of 'upper_bottom' (60 of them means over cells," in mortar.note
    assert "contact points, in cells of 'upper_bottom'; 'lower_top' covers" in means.note
    for points in (mortar, means):
        assert (points.area > 0.0).all() and points.area.sum() == pytest.approx(1.0, rel=1e-9)
        np.testing.assert_allclose(points.side2.T @ points.area, consistent_areas(mesh, "lower_top"), atol=1e-12)


@pytest.mark.parametrize("pairing", ["points", "mortar"])
@pytest.mark.parametrize("kinds", [("hex8", "hex8"), ("tet4", "hex8"), ("wedge6", "tet4")])
def test_contact_points_on_skewed_faces_are_exact_for_linear_fields_and_uniform_pressure(kinds, pairing):
    mesh = skewed(boxes(*kinds, n_lower=(3, 3, 1), n_upper=(4, 5, 1)))
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing=pairing))
    assert (points.area > 0.0).all()
    for group, side in zip(SURFACES, (points.side1, points.side2)):
        np.testing.assert_allclose(side @ mesh.points, points.position, atol=1e-12)
        np.testing.assert_allclose(side.T @ points.area, consistent_areas(mesh, group), atol=1e-9)


@pytest.mark.parametrize("pairing", ["points", "mortar"])
@pytest.mark.parametrize("n_lower", [(4, 2, 1), (5, 2, 1)])
@pytest.mark.parametrize("kind, tolerance", [("hex20", 1e-4), ("tet10", 1e-4), ("hex8", 1e-2)])
def test_curved_edges_in_the_surface_lose_no_area(kind, tolerance, n_lower, pairing):
    """All area of a plane joint along an arc, as of a curved dovetail, has a partner."""
    mesh = boxes(kind, kind, n_lower=n_lower, n_upper=(4, 2, 1))
    mesh.points[:, 1] += 0.2 * mesh.points[:, 0] ** 2
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing=pairing))
    assert points.area.sum() == pytest.approx(1.0, rel=tolerance)
    n_cells = {"hex20": 9, "tet10": 6, "hex8": 4}[kind]
    assert points.n_points == n_cells * sum(map(len, surface_of(mesh, "upper_bottom").faces.values()))
    for side in (points.side1, points.side2):
        np.testing.assert_allclose(side @ mesh.points, points.position, atol=1e-12)


@pytest.mark.parametrize("kinds", [("hex8", "tet4"), ("hex20", "hex20")])
def test_auto_selects_mortars_for_different_meshes(kinds):
    mesh = boxes(*kinds)
    auto, mortar = (contact_points(mesh, joint(surfaces=SURFACES, pairing=pairing)) for pairing in ("auto", "mortar"))
    for name in ("side1", "side2"):
        assert (getattr(auto, name) != getattr(mortar, name)).nnz == 0
    np.testing.assert_array_equal(auto.area, mortar.area)
    assert auto.note == mortar.note and "contact points, mortars on faces of 'upper_bottom'; 'lower_top' covers" in auto.note


def test_auto_uses_means_only_in_rows_of_partly_covered_faces():
    """A strip of one row of faces, whose edges protrude, has mortars; a fine mesh has means along these edges."""
    mesh = boxes(n_lower=(3, 2, 1), n_upper=(4, 1, 1), size=(1.0, 1.015, 1.0), shift=(0.0, -0.0075))
    thin = boxes(n_lower=(3, 2, 1), n_upper=(4, 12, 1), size=(1.0, 1.015, 1.0), shift=(0.0, -0.0075))
    for boxes_, n_means in ((mesh, 0), (thin, 32)):
        auto, means = (contact_points(boxes_, joint(surfaces=SURFACES, pairing=pairing)) for pairing in ("auto", "points"))
        same = np.abs((auto.side1 - means.side1).toarray()).max(axis=1) < 1e-12
        assert np.count_nonzero(same) == n_means and (f"({n_means} of them means" in auto.note) is (n_means > 0)


def test_matching_meshes_have_node_to_node_pairs():
    mesh = boxes(n_upper=(2, 3, 1))
    auto, nodes = (pair_contacts(mesh, [joint(pairing=pairing)]) for pairing in ("auto", "nodes"))
    np.testing.assert_array_equal(auto.node1, nodes.node1)
    assert auto.notes == () and (auto.weights1 != nodes.weights1).nnz == 0


def ring_sectors(inner, outer, n_inner, n_outer):
    """Return two concentric sectors of 90 degrees about the y axis that touch at radius 2, mid-sides on the arcs."""
    mesh = boxes(inner, outer, n_inner, n_outer)
    angle, radius = np.pi / 2 * mesh.points[:, 0], 1.0 + mesh.points[:, 2]
    mesh.points[:] = np.stack([-radius * np.cos(angle), mesh.points[:, 1], radius * np.sin(angle)], axis=1)
    return mesh


@pytest.mark.parametrize("pairing", ["points", "mortar"])
@pytest.mark.parametrize("kinds, tolerance", [(("hex20", "hex20"), 2e-4), (("tet10", "hex20"), 2e-3), (("hex8", "hex8"), 0.02)])
def test_a_cylinder_of_two_meshes_has_its_area_and_normals(kinds, tolerance, pairing):
    mesh = ring_sectors(*kinds, (5, 2, 1), (7, 3, 1))
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing=pairing))
    assert (points.area > 0.0).all() and points.area.sum() == pytest.approx(np.pi, rel=tolerance)
    radial = points.position * (1.0, 0.0, 1.0)
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    assert np.einsum("pi,pi->p", radial, points.z).min() > np.cos(np.radians(7.0))
    for side in (points.side1, points.side2):
        np.testing.assert_allclose(side.sum(axis=1), 1.0, rtol=1e-12)
    assert np.abs(points.distance).max() < 0.02


def test_only_the_first_surface_must_be_covered():
    """The area is that of a small first surface on a larger second one; the reverse order is refused."""
    mesh = boxes(n_lower=(5, 5, 1), n_upper=(2, 2, 1), size=(0.37, 0.41, 1.0), shift=(0.21, 0.33))
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing="auto"))
    assert points.n_points == 16
    assert points.area.sum() == pytest.approx(0.37 * 0.41, rel=1e-12)
    np.testing.assert_allclose(points.side1.T @ points.area, consistent_areas(mesh, "upper_bottom"), atol=1e-13)
    with pytest.raises(
        MeshError,
        match=r"joint 'joint': 8\d\.\d% of the area of 'lower_top' have no partner within .* on 'upper_bottom'; the worst is node .* name the smaller",
    ):
        contact_points(mesh, joint(surfaces=SURFACES[::-1], pairing="auto"))


def test_a_surface_with_the_gap_of_the_mesh_may_have_a_partner_in_part():
    """As in contact pairs of other programs, the larger surface may be first, and a tenth of it may have a partner."""
    mesh = boxes(n_lower=(5, 5, 1), n_upper=(2, 2, 1), size=(0.37, 0.41, 1.0), shift=(0.21, 0.33))
    mesh.points[np.arange(len(mesh.points)) >= TOUCH["n"], 2] += 0.01
    points = contact_points(mesh, joint(surfaces=SURFACES[::-1], pairing="auto", gap="geometry"))
    assert points.area.sum() == pytest.approx(0.37 * 0.41, rel=1e-12)
    np.testing.assert_allclose(points.distance, 0.01, rtol=1e-9)
    assert points.note.startswith("WARNING: joint") and points.note.endswith("; the rest has no partner and stays free")


def test_inclined_faces_with_the_gap_of_the_mesh_have_no_contact_points():
    """A round surface on a plane has points where their normals differ by less than 20 degrees, with that area."""
    mesh = boxes(n_lower=(4, 4, 1), n_upper=(48, 2, 1))
    upper = np.arange(len(mesh.points)) >= TOUCH["n"]
    angle, radius = np.radians(90.0) * (mesh.points[upper, 0] - 0.5), 2.5 - mesh.points[upper, 2]
    mesh.points[upper, 0] = 0.5 + 0.3 * radius * np.sin(angle)
    mesh.points[upper, 2] = 1.46 - 0.3 * radius * np.cos(angle)
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing="points", gap="geometry"))
    assert points.area.sum() == pytest.approx(0.45 * np.radians(40.0), rel=0.06)  # of 0.45 times a quarter turn
    assert points.z[:, 2].min() > np.cos(np.radians(20.0 / 2.0)) and points.distance.min() == pytest.approx(0.01, abs=1e-3)


def test_distant_and_reversed_surfaces_are_refused():
    mesh = boxes()
    upper = np.arange(len(mesh.points)) >= TOUCH["n"]
    mesh.points[upper, 2] += 0.5
    with pytest.raises(
        MeshError, match=r"no contact point found: .* within 0.0[34]\d* m .* the worst is node .* 0.5 m from the other side"
    ):
        contact_points(mesh, joint(surfaces=SURFACES, pairing="auto"))
    gap = pair_contacts(mesh, [joint(surfaces=SURFACES, pairing="auto", preload=0.0, gap="geometry", tolerance=0.6)])
    np.testing.assert_allclose(-gap.N0 / gap.k_n, 0.5, rtol=1e-12)
    mesh.points[upper, 2] -= 1.5  # the bodies fill the same space
    for changes in ({"pairing": "auto", "tolerance": 0.1}, {"pairing": "auto"}, {"pairing": "points"}, {"pairing": "projected"}):
        with pytest.raises(MeshError, match="do not face each other at .* the outward normals are 180 degrees from opposite"):
            contact_points(mesh, joint(surfaces=("upper_top", "lower_top"), **changes))


def test_penetration_at_rest_is_refused():
    mesh = boxes()
    mesh.points[np.arange(len(mesh.points)) >= TOUCH["n"], 2] -= 0.01
    with pytest.raises(MeshError, match=r"the sides penetrate at rest, by 0.01 m at \(.*\) m; move them apart, or state the gap"):
        pair_contacts(mesh, [joint(surfaces=SURFACES, pairing="auto", preload=0.0, gap="geometry")])
    pairs = pair_contacts(mesh, [joint(surfaces=SURFACES, pairing="auto")])  # within the tolerance
    assert pairs.n_pairs == 48
    assert "joint 'joint': the sides penetrate in the mesh, by 0.01 m at " in pairs.notes[-1]
    mesh.points[np.arange(len(mesh.points)) >= TOUCH["n"], 2] -= 0.015
    for gap in ({}, {"gap": 0.1, "preload": 0.0}):
        message = (
            r"by 0.025 m at \(.*\) m, more than 5% of the size of their faces, 0.02\d* m: .* state tolerance = 0.026 \(m\) in the"
        )
        with pytest.raises(MeshError, match=message):
            pair_contacts(mesh, [joint(surfaces=SURFACES, pairing="auto", **gap)])
        pairs = pair_contacts(mesh, [joint(surfaces=SURFACES, pairing="auto", tolerance=0.026, **gap)])
        assert pairs.n_pairs == 48 and "penetrate" in pairs.notes[-1]
    mesh.points[np.arange(len(mesh.points)) >= TOUCH["n"], 2] -= 0.075
    for pairing in ("auto", "points", "projected"):
        with pytest.raises(
            MeshError, match=r"the sides penetrate at rest, by 0.1 m at .*, more than 5% of .* tolerance = 0.11 \(m\)"
        ):
            pair_contacts(mesh, [joint(surfaces=SURFACES, pairing=pairing)])
    mesh.points[np.arange(len(mesh.points)) >= TOUCH["n"], 2] += 0.09
    mesh.points[np.arange(len(mesh.points)) >= TOUCH["n"], 2] += 0.02
    assert not any("penetrate" in note for note in pair_contacts(mesh, [joint(surfaces=SURFACES, pairing="auto")]).notes)


def test_a_gap_of_the_mesh_is_suggested_unless_stated():
    mesh = boxes()
    mesh.points[np.arange(len(mesh.points)) >= TOUCH["n"], 2] += 0.5
    for gap, is_suggested in ((0.0, True), ("geometry", False)):
        with pytest.raises(MeshError, match="or state a larger tolerance") as caught:
            pair_contacts(mesh, [joint(surfaces=SURFACES, pairing="auto", preload=0.0, gap=gap, tolerance=0.1)])
        assert ('gap = "geometry"' in str(caught.value)) is is_suggested


def test_the_gap_to_a_plane_is_that_of_the_mesh():
    mesh = boxes()
    tilted = {"against": "plane", "plane_point": (0.0, 0.0, -0.1), "plane_normal": (0.0, 0.6, 3.0)}
    for pairing in ("auto", "points"):
        pairs = pair_contacts(mesh, [joint(surfaces=("lower_bottom",), **tilted, gap="geometry", preload=0.0, pairing=pairing)])
        z = np.array([0.0, 0.6, 3.0]) / np.hypot(0.6, 3.0)
        np.testing.assert_allclose(pairs.frame[:, 2], np.tile(z, (pairs.n_pairs, 1)), atol=1e-12)
        np.testing.assert_allclose(-pairs.N0 / pairs.k_n, (pairs.position - (0.0, 0.0, -0.1)) @ z, atol=1e-13)
        assert (pairs.node2 == -1).all() and pairs.weights2.nnz == 0


@pytest.mark.parametrize(
    "point, normal, keys, message",
    [
        ((0.0, 0.0, -0.1), (0.0, 0.0, -1.0), {}, "faces away from the plane at .* plane_normal points from the rigid ground"),
        ((0.0, 0.0, -0.1), (3.0, 0.0, 1.0), {}, "is at 72 degrees to the plane at its nearest point, .* check plane_normal"),
        ((0.0, 0.0, -0.5), (0.0, 0.0, 1.0), {}, r"is 0.5 m from the plane at its nearest point, .*; check plane_point"),
        ((0.0, 0.0, 0.5), (0.0, 0.0, 1.0), {}, r"is -0.5 m from the plane"),
        ((0.0, 0.0, -0.05), (0.0, 0.0, 1.0), {"tolerance": 1e-6}, "at most 1e-06 m are expected"),
    ],
)
def test_a_distant_or_inclined_plane_is_refused(point, normal, keys, message):
    plane = {"against": "plane", "plane_point": point, "plane_normal": normal}
    with pytest.raises(MeshError, match=message):
        pair_contacts(boxes(), [joint(surfaces=("lower_bottom",), **plane, gap="geometry", preload=0.0, **keys)])


@pytest.mark.parametrize(
    "first, second",
    [(SURFACES, SURFACES), (SURFACES, SURFACES[::-1]), (("lower_bottom",), ("lower_bottom",)), (SURFACES, SURFACES[:1])],
)
def test_faces_in_two_joints_are_refused(first, second):
    joints = [joint(name="one", surfaces=first, pairing="auto"), joint(name="other", surfaces=second, pairing="auto")]
    with pytest.raises(MeshError, match=r"faces belong to joint 'one' and to joint 'other', .* they would touch twice"):
        pair_contacts(boxes(), joints)


def test_the_tangent_rotates_the_frames():
    mesh = boxes()
    pairs = pair_contacts(mesh, [joint(surfaces=SURFACES, pairing="auto", tangent=(1.0, 1.0, 5.0))])
    np.testing.assert_allclose(pairs.frame[:, 0], np.tile([0.5**0.5, 0.5**0.5, 0.0], (pairs.n_pairs, 1)), atol=1e-12)
    with pytest.raises(MeshError, match=r"joint 'joint': tangent = \(0, 0, 2\) is normal to the surface"):
        pair_contacts(mesh, [joint(surfaces=SURFACES, pairing="auto", tangent=(0.0, 0.0, 2.0))])


def test_contact_points_do_not_depend_on_numbering():
    """Surfaces with nodes and faces in another order have the same points, frames and areas."""
    mesh = boxes("hex20", "tet10")
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing="points"))
    rng = np.random.default_rng(3)
    new = rng.permutation(len(mesh.points))
    blocks = tuple(
        replace(block, nodes=new[block.nodes][order], numbers=block.numbers[order])
        for block in mesh.elements
        for order in [rng.permutation(len(block.nodes))]
    )
    renumbered = replace(
        mesh,
        points=mesh.points[np.argsort(new)],
        elements=blocks,
        node_groups={name: np.sort(new[nodes]) for name, nodes in mesh.node_groups.items()},
    )
    other = contact_points(renumbered, joint(surfaces=SURFACES, pairing="points"))

    def described(contacts):
        table = np.column_stack([contacts.position, contacts.z, contact_frames(contacts.z).reshape(-1, 9), contacts.area])
        return table[np.lexsort(np.round(table, 9).T)]

    np.testing.assert_allclose(described(points), described(other), atol=1e-11)


@pytest.mark.parametrize("kinds", [("hex8", "hex8"), ("tet10", "hex20")])
def test_nodes_are_projected_on_facets(kinds):
    mesh = boxes(*kinds)
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing="projected"))
    first = surface_of(mesh, "upper_bottom")
    assert points.n_points == len(first.nodes) and points.area.sum() == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(points.side1 @ mesh.points, points.side2 @ mesh.points, atol=1e-12)
    with pytest.raises(MeshError, match=r"% of the area of 'lower_top' have no partner within .* name the smaller surface first"):
        narrow = boxes(*kinds, size=(0.5, 1.0, 1.0))
        contact_points(narrow, joint(surfaces=SURFACES[::-1], pairing="projected"))


def test_projection_of_matching_nodes_gives_node_to_node_pairs():
    mesh = boxes("hex20", "hex20", n_upper=(2, 3, 1))
    nodes, projected = (pair_contacts(mesh, [joint(surfaces=SURFACES, pairing=pairing)]) for pairing in ("nodes", "projected"))
    assert (abs(nodes.weights2 - projected.weights2) > 1e-10).nnz == 0
    np.testing.assert_allclose(nodes.area, projected.area, rtol=1e-12)
