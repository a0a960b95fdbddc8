"""Normals and tributary areas of faces."""

import numpy as np
import pytest
from box_meshes import KINDS, box
from small_fe import bent

from microslip import elements
from microslip.elements import FACE_KINDS, face_nodal_areas, face_normals

CORNER_FRACTION = {"quad4": 1.0 / 4.0, "quad8": 3.0 / 76.0, "tri3": 1.0 / 3.0, "tri6": 1.0 / 19.0}


def flat(kind):
    """Return nodes (n, 3) of the reference face in the plane z = 0."""
    return np.hstack([FACE_KINDS[kind].nodes, np.zeros((FACE_KINDS[kind].n_nodes, 1))])


@pytest.mark.parametrize("kind", FACE_KINDS)
def test_areas_of_a_straight_face_are_the_stated_fractions(kind):
    points = flat(kind) * [2.0, 3.0, 1.0]
    areas = face_nodal_areas(kind, points[None])[0]
    n_corners, area = FACE_KINDS[kind].n_corners, 24.0 if kind.startswith("quad") else 3.0
    assert areas[:n_corners] == pytest.approx(CORNER_FRACTION[kind] * area, rel=1e-13)
    if len(areas) > n_corners:
        assert areas[n_corners:] == pytest.approx((1.0 / n_corners - CORNER_FRACTION[kind]) * area, rel=1e-13)


@pytest.mark.parametrize("kind", FACE_KINDS)
def test_areas_of_curved_faces_are_positive_and_add_up(kind):
    """The area of a cylinder of radius 2 is radius x angle x height."""
    n = 8
    u, v = np.meshgrid(np.linspace(0.0, 1.0, n, endpoint=False), np.linspace(0.0, 1.0, n, endpoint=False))
    local = FACE_KINDS[kind].nodes if kind.startswith("tri") else (FACE_KINDS[kind].nodes + 1.0) / 2.0
    at = np.stack([u.ravel(), v.ravel()], axis=1)[:, None] + local / n
    points = np.stack([2.0 * np.cos(at[..., 0]), 2.0 * np.sin(at[..., 0]), 3.0 * at[..., 1]], axis=-1)
    areas = face_nodal_areas(kind, points)
    assert (areas > 0.0).all()
    exact = 2.0 * 3.0 * (0.5 if kind.startswith("tri") else 1.0)
    assert areas.sum() == pytest.approx(exact, rel=1e-3 if len(local) <= 4 else 3e-7)
    normals, radial = face_normals(kind, points), points * [0.5, 0.5, 0.0]
    assert np.linalg.norm(normals, axis=-1) == pytest.approx(1.0, rel=1e-14)
    assert np.einsum("fai,fai->fa", normals, radial).min() > (0.99 if len(local) <= 4 else 0.99999)


def test_normals_of_a_paraboloid_are_exact_on_quadratic_faces():
    for kind in ("quad8", "tri6"):
        points = flat(kind)
        x, y = points[:, 0], points[:, 1]
        points[:, 2] = 0.3 * x**2 - 0.2 * x * y + 0.1 * y**2 + 0.4 * x
        exact = np.stack([-(0.6 * x - 0.2 * y + 0.4), 0.2 * x - 0.2 * y, np.ones_like(x)], axis=1)
        exact /= np.linalg.norm(exact, axis=1, keepdims=True)
        assert face_normals(kind, points[None])[0] == pytest.approx(exact, abs=1e-14)


def test_a_collapsed_face_has_no_normal_and_no_nan():
    points = flat("quad4")
    points[3] = points[0]
    points[2] = points[1]
    assert np.array_equal(face_normals("quad4", points[None]), np.zeros((1, 4, 3)))


@pytest.mark.parametrize("kind", KINDS)
def test_faces_of_an_element_enclose_its_volume(kind):
    """Divergence theorem on straight elements: area vectors add up to 0, and their fluxes of x / 3 to the volume."""
    points, nodes = box(kind, (1, 1, 2), (1.0, 1.5, 4.0))
    x = points[nodes] @ np.array([[1.0, 0.2, 0.1], [0.3, 1.0, 0.0], [0.0, -0.2, 1.0]])
    closure, flux = np.zeros((len(x), 3)), np.zeros(len(x))
    for face_kind, local in elements.KINDS[kind].faces:
        vectors = face_nodal_areas(face_kind, x[:, local])[..., None] * face_normals(face_kind, x[:, local])
        closure += vectors.sum(axis=1)
        flux += np.einsum("ei,ei->e", vectors.sum(axis=1), x[:, local[0]]) / 3.0  # flat: any point of the face
    assert abs(closure).max() < 1e-14
    assert flux == pytest.approx(elements.mass(kind, x, 1.0).sum(axis=(1, 2)), rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_normals_point_out_of_curved_elements(kind):
    points, nodes = box(kind, (3, 3, 6), (1.0, 1.5, 4.0))
    x = bent(points)[nodes]
    centre = x.mean(axis=1, keepdims=True)
    for face_kind, local in elements.KINDS[kind].faces:
        outward = np.einsum("eai,eai->ea", face_normals(face_kind, x[:, local]), x[:, local] - centre)
        assert (outward > 0.0).all()


@pytest.mark.parametrize("kind", elements.CELLS)
def test_polynomials_of_integration_points_are_orthogonal_and_span_the_shape_functions(kind):
    rule, square = elements.FINER_SAMPLES, kind.startswith("quad")
    xi = np.concatenate([2.0 * rule.points - 1.0, 1.0 - 2.0 * rule.points]) if square else rule.points
    weights = np.resize(rule.weights, len(xi))
    L, N = elements.point_functions(kind, xi), elements.FACE_KINDS[kind].values(xi)
    np.testing.assert_allclose(L.sum(axis=1), 1.0, rtol=1e-12)
    products = np.einsum("s,sa,sb->ab", weights, L, L)
    np.testing.assert_allclose(products, np.diag(weights @ L), atol=1e-13)
    assert (weights @ L > 0.0).all() and L.shape[1] == len(elements.CELLS[kind])
    coefficients = np.linalg.lstsq(L, N, rcond=None)[0]
    np.testing.assert_allclose(L @ coefficients, N, atol=1e-12)
