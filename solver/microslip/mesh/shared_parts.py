"""Intersections of the cells of one surface with the facets of another, for any meshes, and integrals over them.

Each cell is intersected in its plane with the facets of the second surface that face it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
import scipy.sparse as sp
import shapely

from .. import elements
from ..messages.errors import MeshError
from .cells import Cells, outlines
from .data import Mesh, stacked
from .near import pairs_within, trees_by_size
from .surface import Surface

_FACING = np.cos(np.radians(60.0))  # cosine of the largest angle between a cell and candidate facets
_NEWTON, _CONVERGED, _FAULTY = 30, 1e-14, 1e-6  # steps to local coordinates; residuals over the size of a face
_GRAIN = 1e-12  # of the largest cell's radius: rounding of corners that makes nearly equal edges coincide
_ARCS = 12  # pieces of a curved edge of a facet
_BEND = 5e-4  # of a cell: corners of an outline closer than this to the line between others are omitted
_CHUNK = 4000  # triangles, and pairs of cell and facet, per block


@dataclass(frozen=True, eq=False)
class Shared:
    """Integrals over intersections of n cells with the second surface, or moments; not divided by the covered area."""

    side1: sp.csr_matrix  # (n, n_nodes) m2
    side2: sp.csr_matrix  # (n, n_nodes) m2
    covered: np.ndarray  # (n,) m2, covered area in the cells' planes, or its moment
    cell_areas: np.ndarray  # (n,) m2, areas of the cells in their planes


def joined(parts: Sequence[Shared]) -> Shared:
    """Return the intersections of cells of several kinds, one kind after the other.  Local."""
    return Shared(**{field.name: stacked([getattr(part, field.name) for part in parts]) for field in fields(Shared)})


class _Integrals:
    """Accumulated integrals over parts of n cells: shape functions of both sides, and covered area."""

    def __init__(self, n: int, n_nodes: int):
        self.n, self.n_nodes = n, n_nodes
        self.sides: tuple[list, list] = ([], [])  # of each, (values, rows, columns)
        self.covered = np.zeros(n)  # m2

    def add(self, rows: np.ndarray, faces: np.ndarray, facets: np.ndarray, w1: np.ndarray, w2: np.ndarray) -> None:
        """Add integrals (m, q, n_face_nodes) and (m, q, n_facet_nodes) [m2] to rows (m, q), which are close together."""
        np.add.at(self.covered, rows, w1.sum(axis=2))
        for side, nodes, values in zip(self.sides, (faces, facets), (w1, w2), strict=True):
            first, last = rows.min(initial=0), rows.max(initial=0)
            row = np.broadcast_to(rows[:, :, None] - first, values.shape).ravel()
            column = np.broadcast_to(nodes[:, None], values.shape).ravel()
            weights = sp.csr_matrix((values.ravel(), (row, column)), (last - first + 1, self.n_nodes)).tocoo()
            side.append((weights.data, weights.row + first, weights.col))

    def shared(self, cell_areas: np.ndarray) -> Shared:
        """Return the sums; ``cell_areas`` (n,) m2."""
        none = (np.zeros(0), np.zeros(0, dtype=int), np.zeros(0, dtype=int))
        sides = []
        for side in self.sides:
            values, rows, columns = map(np.concatenate, zip(none, *side, strict=True))
            sides.append(sp.csr_matrix((values, (rows, columns)), (self.n, self.n_nodes)))
        return Shared(side1=sides[0], side2=sides[1], covered=self.covered, cell_areas=cell_areas)


@dataclass(frozen=True, eq=False)
class Parts:
    """t triangles that form the intersections of cells with facets of one kind, in the planes of the cells."""

    kind: str  # kind of the facets
    cell: np.ndarray  # (t,) number of the cell
    facet: np.ndarray  # (t, n_facet_nodes) nodes of the facet
    corners: np.ndarray  # (t, 3, 2) m


def shared_parts(mesh: Mesh, cells: Cells, second: Surface, reach: float, by_moments: bool = False) -> tuple[Shared, Shared]:
    """Return integrals over intersections of cells with facing facets within ``reach`` [m], and moments.  Local.

    A row of the moments belongs to the polynomial of a face that is 1 at the integration point in the cell; without
    ``by_moments`` the moments are empty.
    """
    n, n_nodes = len(cells.area), len(mesh.points)
    n_faces = len(elements.CELLS[cells.kind])
    polygons = _polygons(cells.in_plane(np.arange(n), cells.outline)[:, :, :2], _BEND * cells.radius)
    means, moments = _Integrals(n, n_nodes), _Integrals(n, n_nodes)
    for kind, facets in second.faces.items():
        for parts in _parts(mesh, cells, polygons, kind, facets, reach):
            near, w1, w2 = _averages(mesh, cells, parts, reach, by_moments)
            at, faces, facing = parts.cell[near], cells.faces[parts.cell[near]], parts.facet[near]
            means.add(at[:, None], faces, facing, w1[:, :1], w2[:, :1])
            if by_moments:
                of_face = at[:, None] // n_faces * n_faces + np.arange(n_faces)
                moments.add(of_face, faces, facing, w1[:, 1:], w2[:, 1:])
    cell_areas = shapely.area(polygons)
    return means.shared(cell_areas), moments.shared(cell_areas)


def _polygons(outlines: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """Return polygons (n,) of outlines (n, k, 2) without corners within ``bend`` (n,) [m] of the line between others.  Local."""
    return shapely.simplify(shapely.polygons(outlines), bend, preserve_topology=False)


def _parts(mesh: Mesh, cells: Cells, polygons: np.ndarray, kind: str, facets: np.ndarray, reach: float) -> Iterator[Parts]:
    """Yield in blocks the intersections of cells, given as ``polygons`` (n,), with the facets of a kind."""
    i, j = _candidates(mesh, cells, kind, facets, reach)
    corners = elements.FACE_KINDS[kind].nodes[: elements.FACE_KINDS[kind].n_corners]
    ring = outlines(kind, mesh.points[facets], corners, _ARCS)
    bend, box = _BEND * cells.radius, shapely.bounds(polygons)
    grain = _GRAIN * cells.radius.max()
    for start in range(0, len(i), _CHUNK):
        at, on = i[start : start + _CHUNK], j[start : start + _CHUNK]
        rings = _polygons(cells.in_plane(at, ring[on])[:, :, :2], bend[at])
        meet = _boxes_meet(box[at], shapely.bounds(rings))
        at, on = at[meet], on[meet]
        piece, triangles = _triangles(shapely.intersection(polygons[at], rings[meet], grid_size=grain))
        for first in range(0, len(piece), _CHUNK):
            chunk = slice(first, first + _CHUNK)
            yield Parts(kind, at[piece[chunk]], facets[on[piece[chunk]]], triangles[chunk])


def _boxes_meet(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return which of n pairs of boxes, rows of least and largest x and y, intersect."""
    return (a[:, :2] <= b[:, 2:]).all(axis=1) & (b[:, :2] <= a[:, 2:]).all(axis=1)


def _candidates(mesh: Mesh, cells: Cells, kind: str, facets: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return candidate pairs of cells and facets, (m,) each, in order: close, with roughly opposite normals."""
    points = mesh.points[facets]
    centre = points.mean(axis=1)
    radius = np.linalg.norm(points - centre[:, None], axis=2).max(axis=1)
    i, j = pairs_within(trees_by_size(centre, radius), cells.centre, cells.radius + reach)
    is_near = np.linalg.norm(cells.centre[i] - centre[j], axis=1) <= cells.radius[i] + radius[j] + reach
    normal = elements.face_normals(kind, points).mean(axis=1)
    is_facing = -np.einsum("mi,mi->m", cells.axes[i, 2], normal[j]) > _FACING * np.linalg.norm(normal[j], axis=1)
    i, j = i[is_near & is_facing], j[is_near & is_facing]
    order = np.lexsort((j, i))
    return i[order], j[order]


def _triangles(parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return triangles (t, 3, 2) with signed areas that sum up to the areas of polygons, and the polygon of each, (t,)."""
    polygons, of = shapely.get_parts(parts, return_index=True)
    is_area = (shapely.get_type_id(polygons) == shapely.GeometryType.POLYGON) & (shapely.area(polygons) > 0.0)
    polygons, of = shapely.normalize(polygons[is_area]), of[is_area]  # outer rings are clockwise
    ring, owner = shapely.get_coordinates(polygons, return_index=True)
    first = np.searchsorted(owner, owner)  # of the polygon's ring, for each of its points
    k = np.flatnonzero((np.arange(len(ring)) > first) & (np.append(owner[1:], -1) == owner))
    return of[owner[k]], np.stack([ring[first[k]], ring[k + 1], ring[k]], axis=1)


def _averages(mesh: Mesh, cells: Cells, parts: Parts, reach: float, by_moments: bool):
    """Return which of t triangles lie within reach, and the integrals of both sides' shape functions over these.

    Shapes: (t,) bool, (m, q, n_face_nodes) and (m, q, n_facet_nodes) [m2] for the kinds of the cell's face and the facets; q = 1,
    with ``by_moments`` 1 plus the number of polynomials of the cell's face, by each of which the integrand is multiplied.
    """
    samples = elements.FINER_SAMPLES if by_moments else elements.SAMPLES
    i, triangles = parts.cell, parts.corners
    edge1, edge2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    weight = np.outer(_cross(edge1, edge2), samples.weights)
    xi, eta = samples.points.T[:, None, :, None]
    where = triangles[:, :1] + xi * edge1[:, None] + eta * edge2[:, None]
    N1, height1, local = _interpolated(mesh, cells, i, cells.kind, cells.faces[i], where)
    N2, height2, _ = _interpolated(mesh, cells, i, parts.kind, parts.facet, where)
    near = np.abs(height2 - height1).mean(axis=1) <= reach
    tested = weight[near][:, :, None]
    if by_moments:
        tested = np.concatenate([tested, tested * elements.point_functions(cells.kind, local[near])], axis=2)
    w1, w2 = (tested.transpose(0, 2, 1) @ N[near] for N in (N1, N2))
    return near, w1, w2


def _interpolated(mesh: Mesh, cells: Cells, i: np.ndarray, kind: str, faces: np.ndarray, where: np.ndarray):
    """Return shape functions (t, s, k), heights (t, s) [m] and local coordinates (t, s, 2) of faces (t, k) at places (t, s, 2).

    The places are in the cells' planes, the heights above these.  The local coordinates come from Newton's method, from the
    middle of the face.

    Raises
    ------
    MeshError : a face is too distorted for local coordinates
    """
    shape, nodes = elements.FACE_KINDS[kind], cells.in_plane(i, mesh.points[faces])
    size = np.ptp(nodes[:, :, :2], axis=1).max(axis=1)[:, None]
    xi = np.tile(shape.nodes[: shape.n_corners].mean(axis=0), (*where.shape[:2], 1))
    for _ in range(_NEWTON):
        N, slopes = _at(shape, xi)
        residual = where - N @ nodes[:, :, :2]
        if (np.abs(residual).max(axis=2) <= _CONVERGED * size).all():
            break
        x_xi, x_eta = (slopes[:, :, r] @ nodes[:, :, :2] for r in (0, 1))  # columns of the slope of x, (t, s, 2)
        turned = np.stack([_cross(residual, x_eta), _cross(x_xi, residual)], axis=2)
        xi = xi + turned / _cross(x_xi, x_eta)[:, :, None]
    worst = np.abs(residual).max(axis=(1, 2)) / size[:, 0]
    if not (worst <= _FAULTY).all():
        at = faces[np.argmax(np.nan_to_num(worst, nan=np.inf))]
        raise MeshError(f"{mesh.path}: the face of nodes {', '.join(map(str, mesh.numbers[at]))} is too distorted for contact")
    return N, (N @ nodes[:, :, 2:])[:, :, 0], xi


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a_x b_y - a_y b_x of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _at(shape, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return shape functions (t, s, k) and their slopes (t, s, 2, k) at (t, s, 2)."""
    flat = xi.reshape(-1, 2)
    return shape.values(flat).reshape(*xi.shape[:2], -1), shape.derivatives(flat).reshape(*xi.shape[:2], 2, -1)
