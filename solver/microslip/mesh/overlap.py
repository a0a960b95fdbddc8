"""Contact of two surfaces of any meshes: a point for each cell of the first, both sides averaged over what the second covers.

A face of the first surface has a few cells.  Each is laid in its plane and cut with the facets of the second surface that
face it, and what the two meshes interpolate is averaged over the parts that they share.  Both averages keep rigid and linear
motions, and a uniform pressure loads each face as its shape functions ask: it crosses a flat joint of any two meshes unchanged.
As a mortar, a face that is covered wholly takes moments in place of means: what varies within a cell is felt, too.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import scipy.sparse as sp
import shapely
from scipy.spatial import cKDTree

from .. import elements
from ..parallel.errors import MeshError
from ..parallel.words import place
from .contact_points import ContactPoints, check_opposite
from .data import Mesh
from .projection import project_on_surface
from .settings import GEOMETRY, MORTAR, Joint
from .surface import Surface, on_mesh

NEAR = 0.1  # of the size of the larger faces: how far apart the surfaces of a joint may lie, where it states no tolerance
FAR = 0.1  # of the mesh's diagonal, the same where the gap is that of the mesh
WHOLE = 0.9  # of each cell of a face that has moments
COVERED = 0.98  # of the first surface must have a partner
LAYERS = 1.05  # of a cell that the second surface may cover: more is a second layer
_LEAST = 1e-6  # of a cell: a smaller share with a partner is none
_FACING = np.cos(np.radians(60.0))  # facets that turn further away from a cell are no candidates
_NEWTON, _CONVERGED, _FAULTY = 30, 1e-14, 1e-6  # steps to local coordinates, and the residual over the size of a face
_GRAIN = 1e-12  # of the surface, to which the corners of shared parts are rounded: edges that nearly coincide then do
_ARCS = 12  # pieces of a curved edge of a face, half as many of a cell's
_BEND = 5e-4  # of a cell: corners of an outline that are no further from the line between others are left out
_CHUNK = 4000  # triangles that are sampled at a time


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
        return np.einsum("mkj,mij->mki", points - self.centre[i][:, None], self.axes[i])


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
    shared = _joined([shared_parts(mesh, own, second, reach) for own in cells])
    centre, area, corners = (np.concatenate([getattr(own, name) for own in cells]) for name in ("centre", "area", "corners"))
    share = shared.covered / shared.whole
    _check_covered(mesh, joint, first, second, share, area, centre, reach)
    area_shared = np.minimum(share, 1.0) * area
    note_on = area_shared.sum() / area.sum()
    if joint.pairing == MORTAR:
        moments = _joined([shared_parts(mesh, own, second, reach, by_moments=True) for own in cells])
        shared, area_shared = _with_moments(cells, shared, share, moments, area_shared)
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
        note=f"joint {joint.name!r}: {len(kept)} contact points, in cells of {first.group!r}; {second.group!r} covers "
        f"{note_on:.2%} of them, {distance.min():.3g} to {distance.max():.3g} m away (at most {reach:.3g} m)",
    )


def reach_of(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> float:
    """Return how far apart the surfaces may lie [m].  Local."""
    if joint.tolerance is not None:
        return joint.tolerance
    if joint.gap == GEOMETRY:
        return FAR * mesh.diagonal
    return NEAR * max(np.sqrt(side.areas.sum() / sum(map(len, side.faces.values()))) for side in (first, second))


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


def _with_moments(
    cells: list[Cells], means: Shared, share: np.ndarray, moments: Shared, area: np.ndarray
) -> tuple[Shared, np.ndarray]:
    """Return the moments of the faces that are covered wholly, the means of the others, and the areas (n,) [m2].  Local."""
    n_each = [len(elements.CELLS[own.kind]) for own in cells]
    n_cells = np.concatenate([np.full(len(own.area) // n, n) for own, n in zip(cells, n_each, strict=True)])
    face = np.repeat(np.arange(len(n_cells)), n_cells)
    is_whole = np.ones(len(n_cells), dtype=bool)
    np.logical_and.at(is_whole, face, (share >= WHOLE) & (moments.covered > 0.0))
    rows = is_whole[face]
    per_covered = np.bincount(face, area) / np.maximum(np.bincount(face, moments.covered), 1e-300)
    chosen, others = sp.diags(rows.astype(float)), sp.diags((~rows).astype(float))
    both = Shared(
        (chosen @ moments.side1 + others @ means.side1).tocsr(),
        (chosen @ moments.side2 + others @ means.side2).tocsr(),
        np.where(rows, moments.covered, means.covered),
        means.whole,
    )
    return both, np.where(rows, moments.covered * per_covered[face], area)


def shared_parts(mesh: Mesh, cells: Cells, second: Surface, reach: float, by_moments: bool = False) -> Shared:
    """Return what the cells share with facets of the second surface that face them within ``reach`` [m].  Local.

    With ``by_moments`` a row is that of a face's polynomial that is 1 at the integration point in the cell.
    """
    n, n_nodes = len(cells.area), len(mesh.points)
    n_own = len(elements.CELLS[cells.kind])
    bend, flat = _BEND * cells.radius, cells.in_plane(np.arange(n), cells.outline)[:, :, :2]
    outlines = _polygons(flat, bend)
    side1, side2, covered = sp.csr_matrix((n, n_nodes)), sp.csr_matrix((n, n_nodes)), np.zeros(n)
    for kind, facets in second.faces.items():
        i, j = _candidates(mesh, cells, kind, facets, reach)
        corners = elements.FACE_KINDS[kind].nodes[: elements.FACE_KINDS[kind].n_corners]
        ring = _outlines(kind, mesh.points[facets], corners, _ARCS)
        rings = _polygons(cells.in_plane(i, ring[j])[:, :, :2], bend[i])
        parts = shapely.intersection(outlines[i], rings, grid_size=_GRAIN * np.ptp(flat))
        piece, triangles = _triangles(parts)
        for start in range(0, len(piece), _CHUNK):
            own = slice(start, start + _CHUNK)
            at, on = i[piece[own]], j[piece[own]]
            near, w1, w2 = _averages(mesh, cells, at, triangles[own], kind, facets[on], reach, by_moments)
            rows = at[near][:, None]
            if by_moments:
                rows = rows // n_own * n_own + np.arange(n_own)
            side1 = side1 + _sum(rows, cells.faces[at[near]], w1, side1.shape)
            side2 = side2 + _sum(rows, facets[on[near]], w2, side2.shape)
            np.add.at(covered, rows, w1.sum(axis=2))
    return Shared(side1, side2, covered, shapely.area(outlines))


def _candidates(mesh: Mesh, cells: Cells, kind: str, facets: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return cells and facets that may share a part, (m,) each: near each other, their normals roughly opposite."""
    points = mesh.points[facets]
    centre = points.mean(axis=1)
    radius = np.linalg.norm(points - centre[:, None], axis=2).max(axis=1)
    found = cKDTree(centre).query_ball_point(cells.centre, cells.radius + radius.max(initial=0.0) + reach)
    i = np.repeat(np.arange(len(found)), [len(own) for own in found])
    j = np.concatenate([np.array(own, dtype=np.int64) for own in found]) if len(found) else i
    is_near = np.linalg.norm(cells.centre[i] - centre[j], axis=1) <= cells.radius[i] + radius[j] + reach
    normal = elements.face_normals(kind, points).mean(axis=1)
    is_facing = -np.einsum("mi,mi->m", cells.axes[i, 2], normal[j]) > _FACING * np.linalg.norm(normal[j], axis=1)
    return i[is_near & is_facing], j[is_near & is_facing]


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
    or with ``by_moments`` the number of polynomials of the cell's face that they are multiplied with.
    """
    samples = elements.FINER_SAMPLES if by_moments else elements.SAMPLES
    edge1, edge2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    weight = np.outer(edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0], samples.weights)
    xi, eta = samples.points.T[:, None, :, None]
    where = triangles[:, :1] + xi * edge1[:, None] + eta * edge2[:, None]
    N1, height1, local = _interpolated(mesh, cells, i, cells.kind, cells.faces[i], where)
    N2, height2, _ = _interpolated(mesh, cells, i, kind, facets, where)
    near = np.abs(height2 - height1).mean(axis=1) <= reach
    tested = elements.point_functions(cells.kind, local[near]) if by_moments else np.ones((*weight[near].shape, 1))
    tested = weight[near][:, :, None] * tested
    w1, w2 = (np.einsum("tsq,tsk->tqk", tested, N[near]) for N in (N1, N2))
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
        residual = where - np.einsum("tsk,tkj->tsj", N, nodes[:, :, :2])
        if (np.abs(residual).max(axis=2) <= _CONVERGED * size).all():
            break
        J = np.einsum("tsrk,tkj->tsjr", slopes, nodes[:, :, :2])
        xi = xi + np.linalg.solve(J, residual[..., None])[..., 0]
    worst = np.abs(residual).max(axis=(1, 2)) / size[:, 0]
    if not (worst <= _FAULTY).all():
        at = faces[np.argmax(np.nan_to_num(worst, nan=np.inf))]
        raise MeshError(f"{mesh.path}: the face of nodes {', '.join(map(str, mesh.numbers[at]))} is too distorted for contact")
    return N, np.einsum("tsk,tk->ts", N, nodes[:, :, 2]), xi


def _at(shape, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return shape functions (t, s, k) and their slopes (t, s, 2, k) at (t, s, 2)."""
    flat = xi.reshape(-1, 2)
    return shape.values(flat).reshape(*xi.shape[:2], -1), shape.derivatives(flat).reshape(*xi.shape[:2], 2, -1)


def _sum(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, shape: tuple[int, int]) -> sp.csr_matrix:
    """Return the sum of values (m, q, k) in rows (m, q) and columns (m, k)."""
    row, column = np.broadcast_to(rows[:, :, None], values.shape), np.broadcast_to(columns[:, None], values.shape)
    return sp.csr_matrix((values.ravel(), (row.ravel(), column.ravel())), shape)


def _joined(parts: list[Shared]) -> Shared:
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
