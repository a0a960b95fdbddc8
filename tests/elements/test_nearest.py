"""The nearest point of a face: inside, on edges, on curved and warped faces."""

import numpy as np
import pytest
from scipy.optimize import minimize

from microslip.elements import FACE_KINDS, nearest_on_faces


def inner_points(kind, n, rng):
    """Return reference coordinates (n, 2) inside the face."""
    xi = rng.uniform(-0.95, 0.95, (n, 2))
    if kind.startswith("quad"):
        return xi
    r, s = np.sqrt(rng.uniform(0.0, 1.0, n)), rng.uniform(0.05, 0.95, n)
    return np.stack([r * (1.0 - s), r * s], axis=1)


def bent_face(kind):
    """Return a curved and sheared face, (n, 3); bilinear faces are warped."""
    x, y = FACE_KINDS[kind].nodes.T
    return np.stack([2.0 * x + 0.3 * y, 1.5 * y - 0.2 * x * y, 0.2 * x * x - 0.15 * x * y + 0.1 * y * y + 0.4 * x], axis=1)


@pytest.mark.parametrize("kind", FACE_KINDS)
def test_second_derivatives_equal_differences_of_the_first(kind):
    face, xi, h = FACE_KINDS[kind], inner_points(kind, 5, np.random.default_rng(0)), 1e-6
    second = face.second_derivatives(xi)
    for r, step in enumerate(h * np.eye(2)):
        central = (face.derivatives(xi + step) - face.derivatives(xi - step)) / (2.0 * h)
        assert second[:, r] == pytest.approx(central, abs=1e-8)


@pytest.mark.parametrize("kind", FACE_KINDS)
def test_points_above_and_below_a_curved_face_are_projected_exactly(kind):
    rng = np.random.default_rng(1)
    face, points, xi = FACE_KINDS[kind], bent_face(kind), inner_points(kind, 200, rng)
    t1, t2 = np.einsum("fra,ai->rfi", face.derivatives(xi), points)
    normal = np.cross(t1, t2)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = rng.uniform(-0.3, 0.3, 200)
    queries = face.values(xi) @ points + height[:, None] * normal
    computed, distance = nearest_on_faces(kind, np.tile(points, (200, 1, 1)), queries)
    assert computed == pytest.approx(xi, abs=1e-11)
    assert distance == pytest.approx(np.abs(height), abs=1e-12)


@pytest.mark.parametrize("kind", FACE_KINDS)
def test_distances_of_random_points_agree_with_a_minimiser(kind):
    """The reference is the nearest of 900 points of the face, refined by the bounded minimiser of SciPy."""
    rng = np.random.default_rng(2)
    face, points = FACE_KINDS[kind], bent_face(kind)
    queries = points.mean(axis=0) + rng.uniform(-4.0, 4.0, (40, 3))
    computed, distance = nearest_on_faces(kind, np.tile(points, (40, 1, 1)), queries)
    a, b = (grid.ravel() for grid in np.meshgrid(np.linspace(0.0, 1.0, 30), np.linspace(0.0, 1.0, 30)))
    is_quad = kind.startswith("quad")

    def local(s):  # the unit square to the face
        return 2.0 * s - 1.0 if is_quad else np.stack([s[:, 0] * (1.0 - s[:, 1]), s[:, 0] * s[:, 1]], axis=1)

    for query, least in zip(queries, distance, strict=True):
        square = np.stack([a, b], axis=1)
        distances = np.linalg.norm(face.values(local(square)) @ points - query, axis=1)
        refined = minimize(
            lambda s, to=query: np.sum((face.values(local(s[None]))[0] @ points - to) ** 2),
            square[np.argmin(distances)],
            bounds=[(0.0, 1.0)] * 2,
            tol=1e-14,
        )
        assert least <= distances.min() + 1e-12 and least == pytest.approx(np.sqrt(refined.fun), rel=1e-6)
    assert np.linalg.norm(np.einsum("fa,ai->fi", face.values(computed), points) - queries, axis=1) == pytest.approx(distance)


def test_the_nearest_point_of_a_collapsed_face_is_finite():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    xi, distance = nearest_on_faces("quad4", points[None], np.array([[0.3, 0.4, 0.0]]))
    assert distance == pytest.approx(0.4) and np.isfinite(xi).all()
