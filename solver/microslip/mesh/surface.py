"""Contact surfaces: the outer faces of a group, their outward normals and tributary areas at the nodes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .. import elements
from ..messages.errors import MeshError
from ..messages.words import counted, place
from ..tables.joint import Joint
from .data import ContactPairs, Mesh

MOST_TURN = 40.0  # degrees between a face and the mean normal of its node, beyond which the node lies on an edge


@dataclass(frozen=True)
class Surface:
    """The faces of a group, oriented outward, and the tributary areas and normals of their nodes."""

    group: str
    faces: dict[
        str, np.ndarray
    ]  # by kind of face: (n_faces, n_face_nodes) index into Mesh.points; corners counter-clockwise from outside
    nodes: np.ndarray  # (n_nodes,) index into Mesh.points, sorted
    normals: np.ndarray  # (n_nodes, 3) outward, unit, averaged over the faces by their tributary areas
    areas: np.ndarray  # (n_nodes,) tributary areas [m2], positive; their sum is the area of the surface


def surface_of(mesh: Mesh, group: str) -> Surface:
    """Return the surface of a group.  Local, rank 0.

    The faces of the group if it has any; otherwise the outer faces of elements with all nodes in the group.

    Raises
    ------
    MeshError : no faces, faces inside a body, or an edge too sharp for one normal per node
    """
    faces = outward_faces(mesh, group)
    nodes = nodes_of(faces)
    area_normals, areas, parts = np.zeros((len(nodes), 3)), np.zeros(len(nodes)), []
    for kind, nodes_of_faces in faces.items():
        at = np.searchsorted(nodes, nodes_of_faces)
        normal = elements.face_normals(kind, mesh.points[nodes_of_faces])
        area = elements.face_nodal_areas(kind, mesh.points[nodes_of_faces])
        np.add.at(areas, at, area)
        np.add.at(area_normals, at, area[:, :, None] * normal)
        parts.append((at, normal))
    length = np.linalg.norm(area_normals, axis=1, keepdims=True)
    normals = np.divide(area_normals, length, out=np.zeros_like(area_normals), where=length > 0.0)
    for at, normal in parts:
        _check_edges(mesh, group, nodes, at, np.einsum("fni,fni->fn", normal, normals[at]))
    return Surface(group, faces, nodes, normals, areas)


def nodes_of(faces: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the nodes of faces (n_faces, n_face_nodes) by kind, at least one kind, ascending.  Local."""
    return np.unique(np.concatenate([of_kind.ravel() for of_kind in faces.values()]))


def on_mesh(mesh: Mesh, side: Surface) -> np.ndarray:
    """Return the normals of a surface at the nodes of the mesh, (n_nodes, 3), 0 elsewhere.  Local, rank 0."""
    normals = np.zeros(mesh.points.shape)
    normals[side.nodes] = side.normals
    return normals


def face_size(side: Surface) -> float:
    """Return the square root of the mean area of a surface's faces [m].  Local."""
    return float(np.sqrt(side.areas.sum() / sum(map(len, side.faces.values()))))


def outward_faces(mesh: Mesh, group: str) -> dict[str, np.ndarray]:
    """Return the outer faces of a group by kind, in the order of the elements: corners counter-clockwise seen from outside.

    Local, rank 0.

    Raises
    ------
    MeshError : the group has no outer face, or names faces that are not outer faces
    """
    outer: dict[str, np.ndarray] = {}
    named: dict[int, list[np.ndarray]] = {}
    n_inside = 0
    for block in mesh.faces:
        if block.group == group:
            named.setdefault(n_corners(block.kind), []).append(_key(block.nodes, block.kind))
    for kind, faces in _faces_within(mesh, mesh.node_groups[group]).items():
        key = _key(faces, kind)
        _, index, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
        is_outer = count[index.ravel()] == 1
        n_inside += np.count_nonzero(~is_outer)
        outer[kind] = faces[is_outer]
    if named:
        outer = _only_named(mesh, group, outer, {n: np.concatenate(keys) for n, keys in named.items()})
    outer = {kind: faces for kind, faces in outer.items() if len(faces)}
    if not outer:
        why = "they lie inside the mesh, where elements share nodes" if n_inside else "it holds no whole face"
        raise MeshError(
            f"{mesh.path}: group {group!r} has no outer face of an element ({why}); a contact surface is a "
            "group of faces, and each body needs nodes of its own there"
        )
    return outer


def _faces_within(mesh: Mesh, members: np.ndarray) -> dict[str, np.ndarray]:
    """Return all element faces, by kind, with all nodes in a set; inner faces appear twice."""
    is_member = np.zeros(len(mesh.points), dtype=bool)
    is_member[members] = True
    within: dict[str, list[np.ndarray]] = {}
    for block in mesh.elements:
        near = block.nodes[np.count_nonzero(is_member[block.nodes], axis=1) >= 3]
        for kind, local in elements.KINDS[block.kind].faces:
            faces = near[:, list(local)]
            within.setdefault(kind, []).append(faces[is_member[faces].all(axis=1)])
    return {kind: np.concatenate(within[kind]) for kind in sorted(within)}


def _only_named(mesh: Mesh, group: str, outer: dict, named: dict[int, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the outer faces named by the group; MeshError if it names other faces."""
    groups, n_matched = {}, 0
    for kind, faces in outer.items():
        wanted = named.get(n_corners(kind), np.empty((0, n_corners(kind)), dtype=np.int64))
        groups[kind] = faces[isin_rows(_key(faces, kind), wanted)]
        n_matched += len(groups[kind])
    n_named = sum(len(np.unique(keys, axis=0)) for keys in named.values())
    if n_matched < n_named:
        raise MeshError(
            f"{mesh.path}: {n_named - n_matched} of {counted(n_named, 'face')} of group {group!r} are not outer faces of a body: "
            "they lie inside the mesh, where elements share nodes, or on no element; bodies in contact need nodes of "
            "their own"
        )
    return groups


def n_corners(kind: str) -> int:
    """Return the number of corners of a kind of face, also of kinds that elements do not have, such as "quad9".  Local."""
    return 3 if kind.startswith("tri") else 4


def _key(faces: np.ndarray, kind: str) -> np.ndarray:
    return np.sort(faces[:, : n_corners(kind)], axis=1)


def isin_rows(rows: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return for every row whether it is among ``wanted``.  Local."""
    index = np.unique(np.concatenate([wanted, rows]), axis=0, return_inverse=True)[1].ravel()
    return np.isin(index[len(wanted) :], index[: len(wanted)])


def _check_edges(mesh: Mesh, group: str, nodes: np.ndarray, at: np.ndarray, cosine: np.ndarray) -> None:
    """Raise MeshError if a face deviates from the normal of its node by more than MOST_TURN."""
    if (cosine < np.cos(np.radians(MOST_TURN))).any():
        node = nodes[at.ravel()[np.argmin(cosine)]]
        raise MeshError(
            f"{mesh.path}: the faces of group {group!r} meet in a sharp edge at node {mesh.numbers[node]} "
            f"{place(mesh.points[node])} m, where a contact pair would have two normals; "
            "give the two sides of the edge as groups and joints of their own"
        )


def face_keys(faces: Mapping[str, np.ndarray]) -> set[tuple[int, ...]]:
    """Return keys of faces: the corners of each, ascending.  Local."""
    return {
        tuple(sorted(map(int, face[: elements.FACE_KINDS[kind].n_corners]))) for kind, nodes in faces.items() for face in nodes
    }


def stretched(mesh: Mesh, joints: Sequence[Joint], pairs: ContactPairs, u: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
    """Return the areas of the pairs over their unloaded areas, (n_pairs,), and the largest rotation of each joint [rad].

    Local, rank 0.  Areas and normals are taken at the nodes of the first surface.  ``u`` (n_nodes, 3) [m] is the displacement
    of ``Mesh.points``.
    """
    weights = abs(pairs.sides(len(mesh.points))[0])
    ratio, turns = np.ones(pairs.n_pairs), {}
    deformed = replace(mesh, points=mesh.points + u)
    for joint in joints:
        before, now = (surface_of(state, joint.groups[0]) for state in (mesh, deformed))
        of_nodes = np.ones(len(mesh.points))
        of_nodes[before.nodes] = now.areas / before.areas
        of_joint = pairs.of_joint(joint.name)
        ratio[of_joint] = (weights[of_joint] @ of_nodes) / weights[of_joint].sum(axis=1).A1
        across = np.linalg.norm(np.cross(before.normals, now.normals), axis=1)
        turns[joint.name] = float(np.arcsin(np.minimum(across, 1.0)).max())
    return ratio, turns
