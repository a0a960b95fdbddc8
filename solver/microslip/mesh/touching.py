"""Detection of touching faces of bodies by geometry, with or without named groups, for any meshes.

Two faces touch if sample points of either face have their feet on the other within a tolerance, and the normals are roughly
opposite.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from .. import elements
from ..elements import FACE_KINDS
from ..messages.errors import Faults, MeshError
from ..messages.words import counted, place
from ..tables.structure import Surface
from ..tables.structure_tables import StructureTables
from .data import FaceBlock, Mesh
from .near import classes_of_size
from .plane_cut import faces_through, plane_of
from .skin import Skin, groups_of_bodies, skin_of_mesh
from .surface import nodes_of

NEAR = 0.1  # of the size of the larger of two faces: default tolerance of their distance
TURNED = 45.0  # degrees: largest angle between the normal of a face and the stated normal
_FACING = np.cos(np.radians(60.0))  # cosine of the largest deviation from opposite normals of touching faces
_BESIDE = 0.05  # of the size of a face: accepted distance of a foot beyond its edge, for curved surfaces
_CHUNK = 50_000  # points per projection
# sample points inside a face, so that faces that only meet at an edge do not touch
_PLACES = {
    3: np.array([(1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3)]),
    4: np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]),
}


@dataclass(frozen=True, eq=False)
class Touching:
    """m pairs of touching faces of a skin; each pair appears in both orders."""

    face: np.ndarray  # (m,) number of a face
    other: np.ndarray  # (m,) number of the touching face
    gap: np.ndarray  # (m,) m, mean distance along the normal, positive for a gap
    share: np.ndarray  # (n_faces,) fraction of the sample points of each face that lie on others


def find_touching(skin: Skin, tolerance: float | None = None, near: float = NEAR) -> Touching:
    """Return the faces of a skin that touch faces of other bodies or other connected parts.

    Local, rank 0.

    Parameters
    ----------
    tolerance : largest distance [m]; None: ``near`` times the size of the larger face
    """
    face, other = _candidates(skin, tolerance, near)
    at, on, gap = _hits(skin, np.concatenate([face, other]), np.concatenate([other, face]), tolerance, near)
    share = np.bincount(at, minlength=skin.n_faces) / np.maximum(_n_places(skin), 1)
    return _paired(skin, at, on, gap, share)


def _paired(skin: Skin, at: np.ndarray, on: np.ndarray, gap: np.ndarray, share: np.ndarray) -> Touching:
    """Return the unique pairs in both orders, with mean gaps."""
    key = np.concatenate([at * skin.n_faces + on, on * skin.n_faces + at])
    pairs, pair_index = np.unique(key, return_inverse=True)
    mean = np.bincount(pair_index, np.concatenate([gap, gap]), len(pairs)) / np.maximum(
        np.bincount(pair_index, minlength=len(pairs)), 1
    )
    n = max(skin.n_faces, 1)
    return Touching(pairs // n, pairs % n, mean, share)


def _reach(skin: Skin, face: np.ndarray, other: np.ndarray, tolerance: float | None, near: float) -> np.ndarray:
    """Return the largest accepted distance of pairs of faces, (m,) [m]."""
    if tolerance is not None:
        return np.full(len(face), tolerance)
    return near * np.maximum(skin.size[face], skin.size[other])


def _candidates(skin: Skin, tolerance: float | None, near: float) -> tuple[np.ndarray, np.ndarray]:
    """Return unique pairs of near faces with opposite normals, not of one part and without shared nodes."""
    pairs = [np.zeros((2, 0), dtype=np.int64)]
    several = len(np.unique(skin.part)) > 1 or len(np.unique(skin.body)) > 1
    radius, size = skin.radius, skin.size
    for members in classes_of_size(radius) if several else ():
        largest = radius[members].max()
        reach = tolerance if tolerance is not None else near * np.maximum(size, size[members].max())
        smaller = np.flatnonzero(radius <= largest)  # pairs with larger faces belong to other classes
        within = (radius + largest + reach)[smaller]
        lists = cKDTree(skin.centre[members]).query_ball_point(skin.centre[smaller], within, return_sorted=False)
        count = np.fromiter(map(len, lists), dtype=np.int64, count=len(lists))
        face = np.repeat(smaller, count)
        other = members[np.fromiter(chain.from_iterable(lists), dtype=np.int64, count=count.sum())]
        close = (skin.body[face] != skin.body[other]) | (skin.part[face] != skin.part[other])
        close[close] = np.einsum("mi,mi->m", skin.normal[face[close]], skin.normal[other[close]]) < -_FACING
        pairs.append(np.stack([face[close], other[close]]))
    face, other = np.unique(np.sort(np.concatenate(pairs, axis=1), axis=0), axis=1)
    distance = np.linalg.norm(skin.centre[face] - skin.centre[other], axis=1)
    close = distance <= radius[face] + radius[other] + _reach(skin, face, other, tolerance, near)
    close[close] = ~_share_a_node(skin, face[close], other[close])
    return face[close], other[close]


def _share_a_node(skin: Skin, face: np.ndarray, other: np.ndarray) -> np.ndarray:
    corners = skin.corners
    return (corners[face][:, :, None] == corners[other][:, None, :]).any(axis=(1, 2))


def _n_places(skin: Skin) -> np.ndarray:
    """Return the number of sample points of each face, (n_faces,)."""
    counts = [np.full(len(nodes), len(_PLACES[FACE_KINDS[kind].n_corners])) for kind, nodes in skin.faces.items()]
    return np.concatenate([np.zeros(0, dtype=np.int64), *counts])


def _hits(skin: Skin, face: np.ndarray, other: np.ndarray, tolerance: float | None, near: float):
    """Return the sample points that lie on the other face of a pair (m,), each once, with the nearest face.

    (k,) each: the face, the other face, the gap [m].
    """
    place_of, point, row = _points_of(skin, face)
    reach = _reach(skin, face, other, tolerance, near)[row]
    close = np.linalg.norm(point - skin.centre[other[row]], axis=1) <= skin.radius[other[row]] + reach
    place_of, point, row = place_of[close], point[close], row[close]
    distance, gap, within = _feet(skin, point, other[row], reach[close])
    place_of, row, distance, gap = place_of[within], row[within], distance[within], gap[within]
    order = np.lexsort((other[row], distance, place_of))
    first = order[np.diff(place_of[order], prepend=-1) > 0]
    return face[row[first]], other[row[first]], gap[first]


def _points_of(skin: Skin, face: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a unique number for each sample point of some faces (k,), the points (k, 3), and the row of each."""
    most = max(map(len, _PLACES.values()))
    numbers, points, rows_of_points = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]
    for kind, rows, nodes in _each_kind(skin, face):
        N = FACE_KINDS[kind].values(_PLACES[FACE_KINDS[kind].n_corners])
        numbers.append((face[rows][:, None] * most + np.arange(len(N))).ravel())
        points.append(np.einsum("pa,fai->fpi", N, skin.points[nodes]).reshape(-1, 3))
        rows_of_points.append(np.repeat(rows, len(N)))
    return np.concatenate(numbers), np.concatenate(points), np.concatenate(rows_of_points)


def _each_kind(skin: Skin, face: np.ndarray):
    """Yield each kind of face with its rows of ``face`` and their nodes."""
    for (kind, nodes), start in zip(skin.faces.items(), skin.first):
        rows = np.flatnonzero((face >= start) & (face < start + len(nodes)))
        yield kind, rows, nodes[face[rows] - start]


def _feet(skin: Skin, point: np.ndarray, other: np.ndarray, reach: np.ndarray):
    """Return for each point (k,) its distance from a face, the normal component [m], and whether its foot is within reach."""
    distance, gap = np.full(len(point), np.inf), np.zeros(len(point))
    for kind, rows, nodes in _each_kind(skin, other):
        for start in range(0, len(rows), _CHUNK):
            at, corners = rows[start : start + _CHUNK], skin.points[nodes[start : start + _CHUNK]]
            xi, distance[at] = elements.nearest_on_faces(kind, corners, point[at])
            foot = np.einsum("fa,fai->fi", FACE_KINDS[kind].values(xi), corners)
            gap[at] = np.einsum("fi,fi->f", point[at] - foot, skin.normal[other[at]])
    tangential = np.sqrt(np.maximum(distance**2 - gap**2, 0.0))
    return distance, gap, (np.abs(gap) <= reach) & (tangential <= _BESIDE * skin.size[other])


def with_touching_surfaces(mesh: Mesh, tables: StructureTables) -> Mesh:
    """Return the mesh with the groups of faces defined by touching bodies or planes.  Local, rank 0.

    Raises
    ------
    MeshError : faces that do not touch, or the name of an existing group
    """
    if not tables.surfaces:
        return mesh
    skin = skin_of_mesh(mesh)
    touching: Mapping[float | None, Touching] = {
        tolerance: find_touching(skin, tolerance)
        for tolerance in {surface.tolerance for surface in tables.surfaces if surface.through is None}
    }
    blocks, groups, notes = list(mesh.faces), dict(mesh.node_groups), list(mesh.notes)
    planes = {surface.name: plane_of(surface) for surface in tables.surfaces if surface.through is not None}
    faults = Faults()
    for surface in tables.surfaces:
        with faults.collected():
            by_kind, note = _touching_faces(mesh, skin, touching.get(surface.tolerance), surface, tables)
            blocks += [FaceBlock(kind, surface.name, nodes) for kind, nodes in by_kind.items()]
            groups[surface.name] = nodes_of(by_kind)
            notes.append(f"surface {surface.name!r}: {note}")
    faults.refuse()
    names = mesh.touching_faces | {surface.name for surface in tables.surfaces}
    return replace(mesh, faces=tuple(blocks), node_groups=groups, notes=tuple(notes), touching_faces=names, planes=planes)


def _touching_faces(mesh: Mesh, skin: Skin, touching: Touching | None, surface: Surface, tables: StructureTables):
    """Return the faces of a surface by kind, and a note on them."""
    if surface.name in mesh.node_groups:
        raise MeshError(f"[[surfaces]] {surface.name!r}: a group of the mesh has this name already; take another")
    body, other = surface.bodies
    if surface.through is not None:
        by_kind = faces_through(mesh, tables.bodies[body].group, surface)
        return by_kind, f"{counted(sum(map(len, by_kind.values())), 'face')} inside {body!r}, through {place(surface.through)} m"
    assert touching is not None, "the faces that touch, by their tolerance"
    faces = _faces_of(mesh, skin, touching, surface, tables)
    area = (skin.area * touching.share)[faces].sum()
    return skin.by_kind(faces), f"{counted(len(faces), 'face')} of {body!r} on {other!r}, {area:.6g} m2"


def _faces_of(mesh: Mesh, skin: Skin, touching: Touching, surface: Surface, tables: StructureTables) -> np.ndarray:
    """Return the faces of the first body that touch the second, ascending."""
    number = {group: i for i, group in enumerate(groups_of_bodies(mesh))}
    body, other = (number[tables.bodies[name].group] for name in surface.bodies)
    face = np.unique(touching.face[(skin.body[touching.face] == body) & (skin.body[touching.other] == other)])
    if len(face) and surface.normal is not None:
        turned = skin.normal[face] @ (np.array(surface.normal) / np.linalg.norm(surface.normal))
        face = face[turned >= np.cos(np.radians(TURNED)) - 1e-12]
    if not len(face):
        raise MeshError(_nothing(mesh, skin, surface, body, other))
    return face


def _nothing(mesh: Mesh, skin: Skin, surface: Surface, body: int, other: int) -> str:
    """Return the message for bodies without touching faces, with their smallest distance."""
    within = f"within {surface.tolerance:g} m" if surface.tolerance is not None else f"within {NEAR:g} of the size of the faces"
    facing = "" if surface.normal is None else f" with normals within {TURNED:g} degrees of {place(surface.normal)}"
    text = f"[[surfaces]] {surface.name!r}: no face of {surface.bodies[0]!r}{facing} lies on {surface.bodies[1]!r} {within}"
    if body != other:
        first, second = skin.nodes_of(skin.body == body), skin.nodes_of(skin.body == other)
        shared = np.intersect1d(first, second)
        if len(shared):
            return f"{text}: they share {counted(len(shared), 'node')}, and are merged there; give each body its own nodes"
        distance, _ = cKDTree(mesh.points[second]).query(mesh.points[first])
        nearest_node = first[np.argmin(distance)]
        text += (
            f"; the nearest nodes are {distance.min():.3g} m apart, at node {mesh.numbers[nearest_node]} "
            f"{place(mesh.points[nearest_node])} m"
        )
    return f"{text}; state a larger tolerance, or other bodies"
