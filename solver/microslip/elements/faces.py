"""Normals and tributary areas of element faces, from their curved surface."""

import numpy as np

from .kinds import FACE_KINDS
from .quadrature import collapsed, square, triangle


def _square_cells(n: int) -> np.ndarray:
    """Return the corners of n x n cells of the square, (n^2, 4, 2)."""
    low = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1).reshape(-1, 1, 2)
    return 2.0 / n * (low + np.array([(0, 0), (1, 0), (1, 1), (0, 1)])) - 1.0


# Corners of the cells of a face in its coordinates, (n_cells, 4, 2), in the same sense of rotation as the corners of the face.
# A linear face has a cell around each corner; a quad8 has nine, a tri6 six that touch a corner and the middle of a side each.
_THIRDS = [
    [(0, 0), (1 / 2, 0), (1 / 3, 1 / 3), (0, 1 / 2)],
    [(1, 0), (1 / 2, 1 / 2), (1 / 3, 1 / 3), (1 / 2, 0)],
    [(0, 1), (0, 1 / 2), (1 / 3, 1 / 3), (1 / 2, 1 / 2)],
]
_SIXTHS = [[a, b, c, c] for a, b, c, _ in _THIRDS] + [[a, c, c, d] for a, _, c, d in _THIRDS]
CELLS = {"tri3": np.array(_THIRDS), "tri6": np.array(_SIXTHS), "quad4": _square_cells(2), "quad8": _square_cells(3)}
# Nodes of a face in their order around it, by the number of nodes.
RINGS = {3: (0, 1, 2), 4: (0, 1, 2, 3), 6: (0, 3, 1, 4, 2, 5), 8: (0, 4, 1, 5, 2, 6, 3, 7)}
SAMPLES = collapsed(4)  # quadrature on a triangle of the overlap of two faces
FINER_SAMPLES = collapsed(5)  # the same, exact for shape functions times point functions

_RULES = {"quad4": square(2), "quad8": square(3), "tri3": triangle(3), "tri6": triangle(6)}


def point_functions(kind: str, xi: np.ndarray) -> np.ndarray:
    """Return the polynomials that are 1 at one integration point of a face and 0 at the others, (..., n), at ``xi`` (..., 2).

    Local.  docs/theory.md, eq. (2.11).  In the order of the cells, each of which has one of the points.  They are orthogonal,
    and the shape functions are sums of them.
    """
    from scipy.optimize import linear_sum_assignment  # slow import, seldom needed

    points, centres = _RULES[kind].points, CELLS[kind].mean(axis=1)
    _, at = linear_sum_assignment(np.linalg.norm(points - centres[:, None], axis=2))
    return _monomials(kind, xi) @ np.linalg.inv(_monomials(kind, points[at]))


def _monomials(kind: str, xi: np.ndarray) -> np.ndarray:
    """Return x^i y^j up to a degree in each of them (quadrilaterals) or in both together (triangles), (..., n), at (..., 2)."""
    degree = 2 if kind in ("tri6", "quad8") else 1
    powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1) if kind.startswith("quad") or i + j <= degree]
    return np.stack([xi[..., 0] ** i * xi[..., 1] ** j for i, j in powers], axis=-1)


def face_normals(kind: str, points: np.ndarray) -> np.ndarray:
    """Return the unit normals of the curved faces at their nodes.

    Local.

    Parameters
    ----------
    kind : a key of ``FACE_KINDS``
    points : (n_faces, n, 3) nodes of each face [m]; from outside, the corners turn left

    Returns
    -------
    normals : (n_faces, n, 3) outward; zero at a node where the face has no tangent plane
    """
    normals = _area_vectors(points, FACE_KINDS[kind].derivatives(FACE_KINDS[kind].nodes))
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0)


def face_nodal_areas(kind: str, points: np.ndarray) -> np.ndarray:
    """Return the share of each node in the area of its face: positive, adding up to the area as integrated.

    Local.

    Parameters
    ----------
    kind, points : as in ``face_normals``

    Returns
    -------
    areas : (n_faces, n) [m2]

    Notes
    -----
    docs/theory.md, eq. (2.2): node a gets the part ``integral N_a^2 / sum_b integral N_b^2`` of the face (lumping by
    the diagonal, after Hinton, Rock and Zienkiewicz 1976). The integral of N_a itself, the consistent load, is
    negative at the corners of quad8 and zero at those of tri6: no area. On a flat rectangle a corner of quad8 gets
    3/76 and a mid-side 4/19; on a straight triangle a corner of tri6 gets 1/19 and a mid-side 16/57; quad4 and tri3
    share equally.
    """
    rule = _RULES[kind]
    size = np.linalg.norm(_area_vectors(points, FACE_KINDS[kind].derivatives(rule.points)), axis=-1)
    squares = (size * rule.weights) @ FACE_KINDS[kind].values(rule.points) ** 2
    area = size @ rule.weights
    return squares * (area / squares.sum(axis=1))[:, None]


def part_integrals(kind: str, points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the integrals of N_a over a part of each face, (n_faces, n) [m2]; they add up to the area of the part.

    Local.  ``corners`` (4, 2) of the part in the face's coordinates turn left; other arguments as in ``face_normals``.
    """
    rule, bilinear = square(4), FACE_KINDS["quad4"]
    xi = bilinear.values(rule.points) @ corners
    slopes = np.einsum("qra,ai->qri", bilinear.derivatives(rule.points), corners)
    size = np.linalg.norm(_area_vectors(points, FACE_KINDS[kind].derivatives(xi)), axis=-1)
    return (size * rule.weights * np.linalg.det(slopes)) @ FACE_KINDS[kind].values(xi)


def pressure_forces(kind: str, points: np.ndarray, pressure: np.ndarray | None = None) -> np.ndarray:
    """Return the nodal forces of a pressure that pushes on the faces, (n_faces, n, 3) [N], consistent with their shapes.

    Local.  Arguments as in ``face_normals``.  As loads they may be negative at corners.  ``pressure`` (n_faces, n_q) [Pa] is that
    at the points of ``face_points``; a unit pressure without it.
    """
    rule = _RULES[kind]
    vectors = _area_vectors(points, FACE_KINDS[kind].derivatives(rule.points))
    if pressure is not None:
        vectors = vectors * pressure[:, :, None]
    return -np.einsum("q,qa,fqi->fai", rule.weights, FACE_KINDS[kind].values(rule.points), vectors)


def face_points(kind: str, points: np.ndarray) -> np.ndarray:
    """Return the quadrature points of the faces, (n_faces, n_q, 3) [m].  Local.  Arguments as in ``face_normals``."""
    return FACE_KINDS[kind].values(_RULES[kind].points) @ points


def _area_vectors(points: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Return dx/dxi_1 x dx/dxi_2, (n_faces, n_xi, 3), for slopes (n_xi, 2, n)."""
    tangents = np.einsum("qra,fai->rfqi", slopes, points)
    return np.cross(tangents[0], tangents[1])
