"""Contact of two surfaces of any meshes: a point for each cell of the first, both sides averaged over what the second covers.

A face of the first surface has a few cells.  Each is laid in its plane and cut with the facets of the second surface that
face it, and what the two meshes interpolate is averaged over the parts that they share.  Both averages keep rigid and linear
motions, and a uniform pressure loads each face as its shape functions ask: it crosses a flat joint of any two meshes unchanged.
As a mortar, a face that is covered wholly takes moments in place of means: what varies within a cell is felt, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import scipy.sparse as sp
import shapely

from .. import elements
from ..parallel.errors import MeshError
from ..parallel.words import place
from .contact_points import ContactPoints, check_opposite
from .data import Mesh
from .near import pairs_within, trees_by_size
from .penetration import check_sunk
from .projection import project_on_surface
from .settings import GEOMETRY, MORTAR, Joint
from .surface import Surface, face_size, on_mesh

NEAR = 0.1  # of the size of the larger faces: how far apart the surfaces of a joint may lie, where it states no tolerance
FAR = 0.1  # of the mesh's diagonal, the same where the gap is that of the mesh
WHOLE = 0.9  # of each cell of a face that has moments
COVERED = 0.98  # of the first surface must have a partner
LAYERS = 1.05  # of a cell that the second surface may cover: more is a second layer
_LEAST = 1e-6  # of a cell: a smaller share with a partner is none
_FACING = np.cos(np.radians(60.0))  # facets that turn further away from a cell are no candidates
_NEWTON, _CONVERGED, _FAULTY = 30, 1e-14, 1e-6  # steps to local coordinates, and the residual over the size of a face
_GRAIN = 1e-12  # of the largest cell's radius: corners of shared parts are rounded so that edges that nearly coincide do
_ARCS = 12  # pieces of a curved edge of a face, half as many of a cell's
_BEND = 5e-4  # of a cell: corners of an outline that are no further from the line between others are left out
_CHUNK = 4000  # triangles that are sampled at a time, and pairs of cell and facet that are cut


@dataclass(frozen=True, eq=False)
class Cells:
    """The n cells of faces of one kind, each in its plane."""

    kind: str
    faces: np.ndarray  # (n, n_face_nodes) nodes of the face that each belongs to
    corners: np.ndarray  # (n, 4, 3) m
    outline: np.ndarray  # (n, k, 3) m, curved edges in pieces
    centre: np.ndarray  # (n, 3) m
    axes: np.ndarray  # (n, 3, 3) rows x, y in the plane, z out of the body
    area: np.ndarray  # (n,) m2, of the curved surface

    @property
    def radius(self) -> np.ndarray:
        return np.linalg.norm(self.corners - self.centre[:, None], axis=2).max(axis=1)

    def in_plane(self, i: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return points (m, k, 3) in the axes of cells ``i`` (m,), the same shape [m]."""
        return (points - self.centre[i][:, None]) @ self.axes[i].transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class Shared:
    """What n cells share with the second surface, or its moments; weights are not yet divided by what is covered."""

    side1: sp.csr_matrix  # (n, n_nodes) m2
    side2: sp.csr_matrix  # (n, n_nodes) m2
    covered: np.ndarray  # (n,) m2, in the cells' planes, or the moment of that
    whole: np.ndarray  # (n,) m2, of the cells in their planes


def overlapping_faces(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> ContactPoints:
    """Return a point for each cell of the first surface that the second one covers, at least in part.  Local, rank 0.

    docs/theory.md, eq. (2.3); of a mortar eq. (2.11).

    Raises
    ------
    MeshError : sides too far apart or facing away, several layers, or a part of the first surface without a partner
    """
    reach = reach_of(mesh, joint, first, second)
    cells = [cells_of(mesh, kind, faces) for kind, faces in first.faces.items()]
    by_moments = joint.pairing == MORTAR
    of_kinds = [shared_parts(mesh, own, second, reach, by_moments) for own in cells]
    means, moments = (_joined([both[which] for both in of_kinds]) for which in (0, 1))
    centre, area, corners = (np.concatenate([getattr(own, name) for own in cells]) for name in ("centre", "area", "corners"))
    share = means.covered / means.whole
    _check_covered(mesh, joint, first, second, share, area, centre, reach)
    area_shared = np.minimum(share, 1.0) * area
    is_covered = area_shared.sum() / area.sum()
    face = _face_of(cells)
    has_moments = by_moments & _is_whole(face, share, moments.covered)
    shared, area_shared = _with_moments(face, has_moments, means, moments, area_shared)
    kept = np.flatnonzero(share > _LEAST)
    side1, side2 = (sp.diags(1.0 / shared.covered[kept]) @ side[kept] for side in (shared.side1, shared.side2))
    n1, n2 = side1 @ on_mesh(mesh, first), side2 @ on_mesh(mesh, second)
    n1, n2 = (n / np.linalg.norm(n, axis=1, keepdims=True) for n in (n1, n2))
    x1, x2 = side1 @ mesh.points, side2 @ mesh.points
    check_opposite(mesh, joint, n1, n2, x1)
    z = (n2 - n1) / np.linalg.norm(n2 - n1, axis=1, keepdims=True)
    distance = np.einsum("pi,pi->p", z, x1 - x2)
    return ContactPoints(
        side1=side1.tocsr(),
        side2=side2.tocsr(),
        z=z,
        area=area_shared[kept],
        position=(x1 + x2) / 2,
        distance=distance,
        cells=corners[kept],
        note=f"joint {joint.name!r}: {len(kept)} contact points, {_in_words(first, by_moments, has_moments[kept])}; "
        f"{second.group!r} covers {is_covered:.2%} of them, {distance.min():.3g} to {distance.max():.3g} m away "
        f"(at most {reach:.3g} m)",
    )


def _in_words(first: Surface, by_moments: bool, has_moments: np.ndarray) -> str:
    """Say what the points of a joint are, (n,) of which have moments."""
    if not by_moments:
        return f"in cells of {first.group!r}"
    n_means = np.count_nonzero(~has_moments)
    means = f" ({n_means} of them means over cells, in faces that are not covered wholly)" if n_means else ""
    return f"mortars on faces of {first.group!r}{means}"


def reach_of(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> float:
    """Return how far apart the surfaces may lie [m].  Local."""
    if joint.tolerance is not None:
        return joint.tolerance
    if joint.gap == GEOMETRY:
        return FAR * mesh.diagonal
    return NEAR * max(face_size(side) for side in (first, second))


def cells_of(mesh: Mesh, kind: str, faces: np.ndarray) -> Cells:
    """Return the cells of some faces, face by face.  Local."""
    xi = elements.CELLS[kind]
    points = mesh.points[faces]
    N = elements.FACE_KINDS[kind].values(xi.reshape(-1, 2)).reshape(*xi.shape[:2], -1)
    corners = np.einsum("cka,fai->fcki", N, points).reshape(-1, 4, 3)
    area = np.stack([elements.part_integrals(kind, points, own).sum(axis=1) for own in xi], axis=1).ravel()
    x, z = corners[:, 1] - corners[:, 3], np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x -= np.einsum("pi,pi->p", x, z)[:, None] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    axes = np.stack([x, np.cross(z, x), z], axis=1)
    outline = np.stack([_outlines(kind, points, own, _ARCS // 2) for own in xi], axis=1).reshape(len(corners), -1, 3)
    return Cells(kind, np.repeat(faces, len(xi), axis=0), corners, outline, corners.mean(axis=1), axes, area)


def _outlines(kind: str, points: np.ndarray, corners: np.ndarray, n_pieces: int) -> np.ndarray:
    """Return the outline of a polygon in the coordinates of faces, (n_faces, k, 3) [m], curved edges in pieces.  Local.

    ``points`` (n_faces, n_face_nodes, 3) m; ``corners`` (n_corners, 2) in turn.
    """
    shape = elements.FACE_KINDS[kind]
    pieces = n_pieces if len(shape.nodes) > shape.n_corners else 1
    share = np.arange(pieces)[:, None] / pieces
    edges = np.roll(corners, -1, axis=0) - corners
    return shape.values((corners[:, None] + share * edges[:, None]).reshape(-1, 2)) @ points


def _polygons(outlines: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """Return polygons (n,) of outlines (n, k, 2) without corners that lie within ``bend`` (n,) [m] of others' lines.  Local."""
    return shapely.simplify(shapely.polygons(outlines), bend, preserve_topology=False)


def _face_of(cells: list[Cells]) -> np.ndarray:
    """Return the number of the face of each cell, (n,)."""
    n_cells = [np.full(len(own.area) // n, n) for own in cells for n in [len(elements.CELLS[own.kind])]]
    return np.repeat(np.arange(sum(map(len, n_cells))), np.concatenate(n_cells))


def _is_whole(face: np.ndarray, share: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Return which of n cells belong to faces that are covered wholly, so that the moments of what is covered are positive."""
    is_whole = np.ones(face.max(initial=-1) + 1, dtype=bool)
    np.logical_and.at(is_whole, face, (share >= WHOLE) & (moments > 0.0))
    return is_whole[face]


def _with_moments(
    face: np.ndarray, has_moments: np.ndarray, means: Shared, moments: Shared, area: np.ndarray
) -> tuple[Shared, np.ndarray]:
    """Return the moments of cells that have them, the means of the others, and the areas (n,) [m2].  Local."""
    chosen, others = sp.diags(has_moments.astype(float)), sp.diags((~has_moments).astype(float))
    both = Shared(
        (chosen @ moments.side1 + others @ means.side1).tocsr(),
        (chosen @ moments.side2 + others @ means.side2).tocsr(),
        np.where(has_moments, moments.covered, means.covered),
        means.whole,
    )
    per_covered = np.bincount(face, area) / np.maximum(np.bincount(face, moments.covered), 1e-300)
    return both, np.where(has_moments, moments.covered * per_covered[face], area)


class _Integrals:
    """Sums of integrals over parts of n cells, as they come: of both sides' shape functions, and of what is covered."""

    def __init__(self, n: int, n_nodes: int):
        self.n, self.n_nodes = n, n_nodes
        self.sides: tuple[list, list] = ([], [])  # of each, (values, rows, columns)
        self.covered = np.zeros(n)  # m2

    def add(self, rows: np.ndarray, faces: np.ndarray, facets: np.ndarray, w1: np.ndarray, w2: np.ndarray) -> None:
        """Add integrals (m, q, n_face_nodes) and (m, q, n_facet_nodes) [m2] to rows (m, q), which lie near each other."""
        np.add.at(self.covered, rows, w1.sum(axis=2))
        for found, nodes, values in zip(self.sides, (faces, facets), (w1, w2), strict=True):
            first, last = rows.min(initial=0), rows.max(initial=0)
            row = np.broadcast_to(rows[:, :, None] - first, values.shape).ravel()
            column = np.broadcast_to(nodes[:, None], values.shape).ravel()
            own = sp.csr_matrix((values.ravel(), (row, column)), (last - first + 1, self.n_nodes)).tocoo()
            found.append((own.data, own.row + first, own.col))

    def shared(self, whole: np.ndarray) -> Shared:
        """Return the sums; ``whole`` (n,) m2."""
        none = (np.zeros(0), np.zeros(0, dtype=int), np.zeros(0, dtype=int))
        sides = []
        for found in self.sides:
            values, rows, columns = map(np.concatenate, zip(none, *found, strict=True))
            sides.append(sp.csr_matrix((values, (rows, columns)), (self.n, self.n_nodes)))
        return Shared(side1=sides[0], side2=sides[1], covered=self.covered, whole=whole)


def shared_parts(mesh: Mesh, cells: Cells, second: Surface, reach: float, by_moments: bool = False) -> tuple[Shared, Shared]:
    """Return what the cells share with facets of the second surface that face them within ``reach`` [m], and its moments.  Local.

    A row of the moments is that of a face's polynomial that is 1 at the integration point in the cell; without ``by_moments``
    they are those of nothing.
    """
    n, n_nodes = len(cells.area), len(mesh.points)
    n_own = len(elements.CELLS[cells.kind])
    outlines = _polygons(cells.in_plane(np.arange(n), cells.outline)[:, :, :2], _BEND * cells.radius)
    means, moments = _Integrals(n, n_nodes), _Integrals(n, n_nodes)
    for kind, facets in second.faces.items():
        for at, on, triangles in _parts(mesh, cells, outlines, kind, facets, reach):
            near, w1, w2 = _averages(mesh, cells, at, triangles, kind, facets[on], reach, by_moments)
            at, faces, facing = at[near], cells.faces[at[near]], facets[on[near]]
            means.add(at[:, None], faces, facing, w1[:, :1], w2[:, :1])
            if by_moments:
                of_face = at[:, None] // n_own * n_own + np.arange(n_own)
                moments.add(of_face, faces, facing, w1[:, 1:], w2[:, 1:])
    whole = shapely.area(outlines)
    return means.shared(whole), moments.shared(whole)


def _parts(mesh: Mesh, cells: Cells, outlines: np.ndarray, kind: str, facets: np.ndarray, reach: float):
    """Yield, some at a time, the cells (t,), facets (t,) and triangles (t, 3, 2) [m] in the cells' planes of what they share."""
    i, j = _candidates(mesh, cells, kind, facets, reach)
    corners = elements.FACE_KINDS[kind].nodes[: elements.FACE_KINDS[kind].n_corners]
    ring = _outlines(kind, mesh.points[facets], corners, _ARCS)
    bend, box = _BEND * cells.radius, shapely.bounds(outlines)
    grain = _GRAIN * cells.radius.max()
    for start in range(0, len(i), _CHUNK):
        at, on = i[start : start + _CHUNK], j[start : start + _CHUNK]
        rings = _polygons(cells.in_plane(at, ring[on])[:, :, :2], bend[at])
        meet = _boxes_meet(box[at], shapely.bounds(rings))
        at, on = at[meet], on[meet]
        piece, triangles = _triangles(shapely.intersection(outlines[at], rings[meet], grid_size=grain))
        for first in range(0, len(piece), _CHUNK):
            own = slice(first, first + _CHUNK)
            yield at[piece[own]], on[piece[own]], triangles[own]


def _boxes_meet(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return which of n pairs of boxes, rows of least and largest x and y, have points in common."""
    return (a[:, :2] <= b[:, 2:]).all(axis=1) & (b[:, :2] <= a[:, 2:]).all(axis=1)


def _candidates(mesh: Mesh, cells: Cells, kind: str, facets: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return cells and facets that may share a part, (m,) each, in turn: near each other, their normals roughly opposite."""
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
    """Return triangles (t, 3, 2) whose signed areas add up to those of polygons, and the polygon of each, (t,)."""
    polygons, of = shapely.get_parts(parts, return_index=True)
    is_area = (shapely.get_type_id(polygons) == shapely.GeometryType.POLYGON) & (shapely.area(polygons) > 0.0)
    polygons, of = shapely.normalize(polygons[is_area]), of[is_area]  # outer rings turn right
    ring, owner = shapely.get_coordinates(polygons, return_index=True)
    first = np.searchsorted(owner, owner)  # of the polygon's ring, for each of its points
    k = np.flatnonzero((np.arange(len(ring)) > first) & (np.append(owner[1:], -1) == owner))
    return of[owner[k]], np.stack([ring[first[k]], ring[k + 1], ring[k]], axis=1)


def _averages(
    mesh: Mesh, cells: Cells, i: np.ndarray, triangles: np.ndarray, kind: str, facets: np.ndarray, reach: float, by_moments: bool
):
    """Return which of t triangles in cells ``i`` lie within reach, and the integrals of both sides' shape functions over those.

    Shapes: (t,) bool, (m, q, n_face_nodes) and (m, q, n_facet_nodes) [m2], of a face of the cell's and the facets' kind; q = 1,
    and with ``by_moments`` as many more as there are polynomials of the cell's face, multiplied with each of these.
    """
    samples = elements.FINER_SAMPLES if by_moments else elements.SAMPLES
    edge1, edge2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    weight = np.outer(_cross(edge1, edge2), samples.weights)
    xi, eta = samples.points.T[:, None, :, None]
    where = triangles[:, :1] + xi * edge1[:, None] + eta * edge2[:, None]
    N1, height1, local = _interpolated(mesh, cells, i, cells.kind, cells.faces[i], where)
    N2, height2, _ = _interpolated(mesh, cells, i, kind, facets, where)
    near = np.abs(height2 - height1).mean(axis=1) <= reach
    tested = weight[near][:, :, None]
    if by_moments:
        tested = np.concatenate([tested, tested * elements.point_functions(cells.kind, local[near])], axis=2)
    w1, w2 = (tested.transpose(0, 2, 1) @ N[near] for N in (N1, N2))
    return near, w1, w2


def _interpolated(mesh: Mesh, cells: Cells, i: np.ndarray, kind: str, faces: np.ndarray, where: np.ndarray):
    """Return shape functions (t, s, k), height over the cell's plane (t, s) [m] and local coordinates (t, s, 2) of faces (t, k)
    at places (t, s, 2) in it.

    Newton's method for the local coordinates, from the middle of the face.

    Raises
    ------
    MeshError : a face is so distorted that it has none
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


def _joined(parts: Sequence[Shared]) -> Shared:
    def join(name: str):
        values = [getattr(part, name) for part in parts]
        return sp.vstack(values).tocsr() if sp.issparse(values[0]) else np.concatenate(values)

    return Shared(**{field.name: join(field.name) for field in fields(Shared)})


def _check_covered(mesh: Mesh, joint: Joint, first: Surface, second: Surface, share, area, centre, reach: float) -> None:
    """Raise MeshError where too much of the first surface has no partner, or several."""
    where = f"{mesh.path}: joint {joint.name!r}"
    if share.max(initial=0.0) > LAYERS:
        raise MeshError(
            f"{where}: {second.group!r} covers {first.group!r} more than once at {place(centre[np.argmax(share)])} m; "
            "restrict the group to the faces that touch, or state a smaller tolerance in the joint"
        )
    covered = np.minimum(share, 1.0) @ area / area.sum()
    if covered >= (COVERED if first.group not in mesh.found else _LEAST):
        return
    foot = project_on_surface(mesh.points, second.faces, mesh.points[first.nodes])
    worst = int(np.argmax(foot.distance))
    near = foot.distance <= reach
    if covered <= _LEAST and not near.any():
        check_sunk(mesh, joint, first, second, foot)
    if covered <= _LEAST and near.any():  # they lie on each other: what is wrong is where they look
        normals2 = np.einsum("pk,pki->pi", foot.weights, on_mesh(mesh, second)[foot.nodes])
        normals2 /= np.linalg.norm(normals2, axis=1, keepdims=True)
        check_opposite(mesh, joint, first.normals[near], normals2[near], mesh.points[first.nodes[near]])
    found = f"{1.0 - covered:.1%} of the area of {first.group!r}" if covered > _LEAST else "no contact point found: all its faces"
    advice = "name the smaller surface first, restrict the first group to what touches, or state a larger tolerance"
    if covered <= _LEAST:
        apart = "" if joint.gap == GEOMETRY else ' (gap = "geometry" where they are apart at rest)'
        advice = f"bring the surfaces together, or state a larger tolerance{apart}"
    raise MeshError(
        f"{where}: {found} have no partner within {reach:.3g} m on {second.group!r}; the worst is node "
        f"{mesh.numbers[first.nodes[worst]]} of {first.group!r} at {place(mesh.points[first.nodes[worst]])} m, "
        f"{foot.distance[worst]:.3g} m from the other side; {advice}"
    )
