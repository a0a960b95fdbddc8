"""Projection of points on surfaces: nearest facet, weights, edges, facets of very different size."""

from time import process_time

import numpy as np
import pytest
from box_meshes import KINDS, box, mesh_of
from scipy.spatial import Delaunay

from microslip.elements import FACE_KINDS, nearest_on_faces
from microslip.mesh.projection import project_on_surface
from microslip.mesh.surface import outward_faces

TOP = {"top": lambda x: x[:, 2] == 1.0}


def plate(kind, n=(4, 3, 1)):
    """Return the points and the faces of the upper side of a unit box."""
    mesh = mesh_of(("plate", kind, *box(kind, n)), groups=TOP)
    return mesh.points, outward_faces(mesh, "top")


@pytest.mark.parametrize("kind", KINDS)
def test_linear_fields_are_interpolated_exactly(kind):
    points, faces = plate(kind)
    queries = np.random.default_rng(0).uniform([0.0, 0.0, 0.7], [1.0, 1.0, 1.3], (500, 3))
    projection = project_on_surface(points, faces, queries)
    assert projection.foot == pytest.approx(queries * [1.0, 1.0, 0.0] + [0.0, 0.0, 1.0], abs=1e-12)
    assert projection.gap == pytest.approx(queries[:, 2] - 1.0, abs=1e-12) and projection.beyond.max() < 1e-12
    assert projection.distance == pytest.approx(np.abs(queries[:, 2] - 1.0), abs=1e-12)
    assert np.abs(projection.weights.sum(axis=1) - 1.0).max() < 1e-15
    assert np.einsum("fa,fai->fi", projection.weights, points[projection.nodes]) == pytest.approx(projection.foot, abs=1e-14)
    assert projection.normals == pytest.approx(np.tile([0.0, 0.0, 1.0], (500, 1)), abs=1e-12)
    for nodes, of_kind, row in zip(projection.nodes, projection.kind, projection.face, strict=True):
        assert set(nodes) == set(faces[of_kind][row])


@pytest.mark.parametrize("kind", KINDS)
def test_projected_nodes_have_weights_of_exactly_one_and_zero(kind):
    points, faces = plate(kind)
    nodes = np.unique(np.concatenate([rows.ravel() for rows in faces.values()]))
    rng = np.random.default_rng(1)
    for shift in (0.0, 1e-12):
        projection = project_on_surface(points, faces, points[nodes] + shift * rng.uniform(-1.0, 1.0, (len(nodes), 3)))
        assert set(np.unique(projection.weights)) == {0.0, 1.0}
        assert (projection.nodes[np.arange(len(nodes)), projection.weights.argmax(axis=1)] == nodes).all()


def test_a_point_beyond_the_edge_is_projected_on_the_edge():
    points, faces = plate("hex20")
    projection = project_on_surface(points, faces, np.array([[1.02, 0.4, 1.05], [-0.3, -0.4, 1.0], [0.5, 0.5, 0.9]]))
    assert projection.foot == pytest.approx(np.array([[1.0, 0.4, 1.0], [0.0, 0.0, 1.0], [0.5, 0.5, 1.0]]), abs=1e-12)
    assert projection.beyond == pytest.approx([0.02, 0.5, 0.0], abs=1e-12)
    assert projection.gap == pytest.approx([0.05, 0.0, -0.1], abs=1e-12)
    assert projection.distance == pytest.approx([np.hypot(0.02, 0.05), 0.5, 0.1], abs=1e-12)


def rough(n, seed):
    """Return a bumpy sheet of triangles of very different size: points (n_points, 3) and faces (n_faces, 3)."""
    rng = np.random.default_rng(seed)
    fine, coarse = rng.uniform(0.0, 1.0, (n, 2)) ** 6, rng.uniform(0.0, 1.0, (n // 20, 2))
    plane = np.concatenate([fine, coarse, [[0, 0], [1, 0], [0, 1], [1, 1]]])
    points = np.column_stack([plane, 0.2 * np.sin(5.0 * plane[:, 0]) * np.cos(4.0 * plane[:, 1])])
    return points, Delaunay(plane).simplices


@pytest.mark.slow
def test_the_nearest_of_facets_of_very_different_size_is_located():
    """The distance is the least of the distances to all facets."""
    points, faces = rough(400, 3)
    queries = np.random.default_rng(4).uniform(-0.2, 1.2, (60, 3)) * [1.0, 1.0, 0.6]
    projection = project_on_surface(points, {"tri3": faces}, queries)
    for i, query in enumerate(queries):
        _, every = nearest_on_faces("tri3", points[faces], np.tile(query, (len(faces), 1)))
        assert projection.distance[i] == pytest.approx(every.min(), abs=1e-13)
        assert every[projection.face[i]] == pytest.approx(every.min(), abs=1e-13)


def test_distant_bulging_faces_are_located():
    """The middle of a strongly bent quad8 is nearest although its corners are not."""
    nodes = np.column_stack([FACE_KINDS["quad8"].nodes, np.zeros(8)])
    bent = nodes.copy()
    bent[4:, 2] = 0.8
    flat = nodes[[0, 1, 2, 3]] * 0.2 + [0.0, 0.0, 3.6]
    points = np.concatenate([bent, flat])
    projection = project_on_surface(
        points, {"quad8": np.arange(8)[None], "quad4": np.arange(8, 12)[None]}, np.array([[0.0, 0.0, 2.5]])
    )
    assert projection.kind[0] == "quad8" and projection.distance[0] == pytest.approx(2.5 - 1.6)
    assert projection.nodes.shape == (1, 8)


def test_surfaces_of_mixed_kinds_have_padded_weights():
    points, quads = plate("hex8", (2, 2, 1))
    more, triangles = plate("wedge15", (3, 3, 1))
    faces = {"quad4": quads["quad4"], **{kind: rows + len(points) for kind, rows in triangles.items()}}
    projection = project_on_surface(
        np.concatenate([points, more + [1.0, 0.0, 0.0]]), faces, np.array([[0.3, 0.3, 1.1], [1.4, 0.3, 1.1]])
    )
    assert projection.kind[0] == "quad4" and projection.kind[1] in ("tri6", "quad8")
    assert (projection.weights[0, 4:] == 0.0).all() and (projection.nodes[0, 4:] == projection.nodes[0, 0]).all()
    assert projection.distance == pytest.approx(0.1, abs=1e-12)


def test_no_points_give_empty_arrays():
    points, faces = plate("hex8")
    projection = project_on_surface(points, faces, np.zeros((0, 3)))
    assert projection.weights.shape == (0, 4) and projection.foot.shape == (0, 3) and projection.distance.shape == (0,)


@pytest.mark.slow
def test_many_points_take_seconds():
    points, faces = plate("hex20", (60, 60, 1))
    queries = np.random.default_rng(5).uniform([0.0, 0.0, 0.98], [1.0, 1.0, 1.02], (100_000, 3))
    start = process_time()
    projection = project_on_surface(points, faces, queries)
    assert process_time() - start < 30.0
    assert projection.distance == pytest.approx(np.abs(queries[:, 2] - 1.0), abs=1e-12)
