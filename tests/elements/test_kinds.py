"""Shape functions and faces of every kind."""

import numpy as np
import pytest

from microslip.elements import FACE_KINDS, KINDS

ALL = {**KINDS, **FACE_KINDS}
N_NODES = {
    "tet4": 4,
    "tet10": 10,
    "hex8": 8,
    "hex20": 20,
    "wedge6": 6,
    "wedge15": 15,
    "pyramid5": 5,
    "pyramid13": 13,
    "tri3": 3,
    "tri6": 6,
    "quad4": 4,
    "quad8": 8,
}
QUADRATIC = ("tet10", "hex20", "wedge15", "pyramid13", "tri6", "quad8")
# Corners at the ends of the edges of the midside nodes, by the documentation of VTK.
MID_SIDES = {
    "tet10": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    "hex20": [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
    "wedge15": [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
    "pyramid13": [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)],
}


def some_points(kind, n=20):
    """Return points inside the reference element: convex combinations of its nodes."""
    weights = np.random.default_rng(1).dirichlet(np.ones(ALL[kind].n_nodes), n)
    return weights @ ALL[kind].nodes


@pytest.mark.parametrize("kind", ALL)
def test_shape_functions_are_one_at_their_node_and_zero_at_the_others(kind):
    assert ALL[kind].n_nodes == N_NODES[kind]
    assert np.array_equal(ALL[kind].values(ALL[kind].nodes), np.eye(N_NODES[kind]))


@pytest.mark.parametrize("kind", ALL)
def test_shape_functions_reproduce_polynomials(kind):
    xi, nodes = some_points(kind), ALL[kind].nodes
    N = ALL[kind].values(xi)
    assert N.sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert N @ nodes == pytest.approx(xi, abs=1e-14)
    if kind in QUADRATIC:
        products = nodes[:, :, None] * nodes[:, None, :]
        assert np.einsum("qa,aij->qij", N, products) == pytest.approx(xi[:, :, None] * xi[:, None, :], abs=1e-14)


@pytest.mark.parametrize("kind", ALL)
def test_derivatives_equal_differences_of_the_shape_functions(kind):
    xi, h = some_points(kind), 1e-5
    slopes = ALL[kind].derivatives(xi)
    for r, step in enumerate(h * np.eye(xi.shape[1])):
        difference = (ALL[kind].values(xi + step) - ALL[kind].values(xi - step)) / (2.0 * h)
        assert slopes[:, r] == pytest.approx(difference, abs=1e-9)


@pytest.mark.parametrize("kind", MID_SIDES)
def test_midside_nodes_are_between_the_corners_of_vtk(kind):
    nodes, n_corners = KINDS[kind].nodes, KINDS[kind].n_corners
    assert np.array_equal(nodes[n_corners:], nodes[np.array(MID_SIDES[kind])].mean(axis=1))


@pytest.mark.parametrize("kind", KINDS)
def test_faces_enclose_the_element_and_point_outward(kind):
    nodes, n_corners = KINDS[kind].nodes, KINDS[kind].n_corners
    edges = []
    for face_kind, local in KINDS[kind].faces:
        n_face_corners = FACE_KINDS[face_kind].n_corners
        corners = local[:n_face_corners]
        assert len(local) == FACE_KINDS[face_kind].n_nodes and (corners < n_corners).all()
        middles = (nodes[corners] + nodes[np.roll(corners, -1)]) / 2.0
        assert np.array_equal(nodes[local[n_face_corners:]], middles[: len(local) - n_face_corners])
        normal = np.cross(nodes[corners[1]] - nodes[corners[0]], nodes[corners[2]] - nodes[corners[0]])
        assert normal @ (nodes[corners].mean(axis=0) - nodes.mean(axis=0)) > 0.0
        edges += zip(corners, np.roll(corners, -1))
    assert sorted(edges) == sorted((b, a) for a, b in edges)  # every edge once in each direction


@pytest.mark.parametrize("kind", ["pyramid5", "pyramid13"])
def test_pyramids_are_compatible_with_their_neighbours(kind):
    """On each face the shape functions of a pyramid are those of the face, and all others are 0."""
    pyramid = KINDS[kind]
    for face_kind, local in pyramid.faces:
        face = FACE_KINDS[face_kind]
        at = some_points(face_kind)
        linear = FACE_KINDS[face_kind.replace("8", "4").replace("6", "3")]
        computed = pyramid.values(linear.values(at) @ pyramid.nodes[local[: face.n_corners]])
        expected = np.zeros_like(computed)
        expected[:, local] = face.values(at)
        assert computed == pytest.approx(expected, abs=1e-13)
