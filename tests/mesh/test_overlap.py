"""Contact of surfaces with different meshes: averages over what their faces share, and what is refused."""


import numpy as np
import pytest
from box_meshes import KINDS, box, joint, mesh_of

from microslip import elements
from microslip.mesh.pairing import contact_points, pair_contacts
from microslip.mesh.surface import surface_of

TOUCH = {
    "lower_top": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) < TOUCH["n"]),
    "upper_bottom": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) >= TOUCH["n"]),
    "n": 0,
}
SURFACES = ("upper_bottom", "lower_top")


def boxes(lower="hex8", upper="hex8", n_lower=(2, 3, 1), n_upper=(3, 4, 1), size=(1.0, 1.0, 1.0), shift=(0.0, 0.0)):
    """Return two boxes of their own meshes, the upper one on the lower one at z = 1."""
    first, second = box(lower, n_lower), box(upper, n_upper, size=size, origin=(*shift, 1.0))
    TOUCH["n"] = len(first[0])
    groups = {name: claim for name, claim in TOUCH.items() if name != "n"}
    return mesh_of(("lower", lower, *first), ("upper", upper, *second), groups=groups)


def skewed(mesh, amount=0.12):
    """Move the nodes inside the square within each plane z, differently in the two bodies: faces without parallel sides."""
    x, y = mesh.points[:, 0].copy(), mesh.points[:, 1].copy()
    own = np.where(np.arange(len(x)) < TOUCH["n"], 1.0, -1.3)
    bump = amount * own * np.sin(np.pi * x) * np.sin(np.pi * y)
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


@pytest.mark.parametrize("lower", KINDS)
@pytest.mark.parametrize("upper", ["hex8", "tet10"])
def test_flat_averages(lower, upper):
    """Both sides keep linear fields, and a uniform pressure loads both as their shape functions ask."""
    mesh = boxes(lower, upper)
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing="auto"))
    assert points.note and (points.area > 0.0).all()
    for side in (points.side1, points.side2):
        np.testing.assert_allclose(side.sum(axis=1), 1.0, rtol=1e-13)
        np.testing.assert_allclose(side @ mesh.points, points.position, atol=1e-13)
    np.testing.assert_allclose(points.position, points.cells.mean(axis=1), atol=1e-13) if upper == "hex8" else None
    assert points.area.sum() == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(points.z, np.tile([0.0, 0.0, 1.0], (points.n_points, 1)), atol=1e-12)
    np.testing.assert_allclose(points.side1.T @ points.area, consistent_areas(mesh, "upper_bottom"), atol=1e-13)
    np.testing.assert_allclose(points.side2.T @ points.area, consistent_areas(mesh, "lower_top"), atol=1e-13)


@pytest.mark.parametrize("kinds", [("hex8", "hex8"), ("tet4", "hex8"), ("wedge6", "tet4")])
def test_skewed_faces(kinds):
    mesh = skewed(boxes(*kinds, n_lower=(3, 3, 1), n_upper=(4, 5, 1)))
    points = contact_points(mesh, joint(surfaces=SURFACES, pairing="points"))
    for group, side in zip(SURFACES, (points.side1, points.side2)):
        np.testing.assert_allclose(side @ mesh.points, points.position, atol=1e-12)
        np.testing.assert_allclose(side.T @ points.area, consistent_areas(mesh, group), atol=1e-9)


def test_matching_meshes_stay_node_to_node():
    mesh = boxes(n_upper=(2, 3, 1))
    auto, nodes = (pair_contacts(mesh, [joint(pairing=pairing)]) for pairing in ("auto", "nodes"))
    np.testing.assert_array_equal(auto.node1, nodes.node1)
    assert auto.notes == () and (auto.weights1 != nodes.weights1).nnz == 0
