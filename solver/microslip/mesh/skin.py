"""The skin of a mesh: outer faces of its elements, with body and connected part of each face."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .. import elements
from .components import parts_of
from .data import Mesh
from .surface import isin_rows

_MOST_CORNERS = 4


@dataclass(frozen=True, eq=False)
class Skin:
    """Outer faces with consecutive numbers, kind after kind; corners counter-clockwise seen from outside."""

    points: np.ndarray  # (n_points, 3) m
    faces: dict[str, np.ndarray]  # by kind: (n, n_face_nodes) index into ``points``
    body: np.ndarray  # (n_faces,) number of the body
    part: np.ndarray  # (n_faces,) number of the connected part
    first: np.ndarray = field(init=False)  # (n_kinds + 1,) number of the first face of each kind
    centre: np.ndarray = field(init=False)  # (n_faces, 3) m
    normal: np.ndarray = field(init=False)  # (n_faces, 3) at the centre, unit, outward; 0 if undefined
    area: np.ndarray = field(init=False)  # (n_faces,) m2

    def __post_init__(self):
        first = np.cumsum([0, *map(len, self.faces.values())])
        centre, normal, area = np.zeros((first[-1], 3)), np.zeros((first[-1], 3)), np.zeros(first[-1])
        for (kind, nodes), start in zip(self.faces.items(), first):
            of_kind, points, face = slice(start, start + len(nodes)), self.points[nodes], elements.FACE_KINDS[kind]
            middle = face.nodes[: face.n_corners].mean(axis=0)[None]
            centre[of_kind] = np.einsum("a,fai->fi", face.values(middle)[0], points)
            along, across = np.einsum("ra,fai->rfi", face.derivatives(middle)[0], points)
            normal[of_kind] = np.cross(along, across)
            area[of_kind] = elements.face_nodal_areas(kind, points).sum(axis=1)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0.0)
        for name, value in {"first": first, "centre": centre, "normal": normal, "area": area}.items():
            object.__setattr__(self, name, value)

    @property
    def n_faces(self) -> int:
        """The number of faces."""
        return int(self.first[-1])

    @property
    def size(self) -> np.ndarray:
        """Length of a side of each face, (n_faces,) [m]."""
        return np.sqrt(self.area)

    @property
    def radius(self) -> np.ndarray:
        """Distance of the farthest node of each face from its centre, (n_faces,) [m]."""
        return np.concatenate(
            [np.zeros(0)]
            + [
                np.linalg.norm(self.points[nodes] - self.centre[start : start + len(nodes), None], axis=2).max(axis=1)
                for nodes, start in zip(self.faces.values(), self.first)
            ]
        )

    @property
    def corners(self) -> np.ndarray:
        """Corners of each face, (n_faces, 4) index into ``points``; a triangle repeats the last one."""
        parts = [np.zeros((0, _MOST_CORNERS), dtype=np.int64)]
        for kind, nodes in self.faces.items():
            n = elements.FACE_KINDS[kind].n_corners
            parts.append(nodes[:, [*range(n), *[n - 1] * (_MOST_CORNERS - n)]])
        return np.concatenate(parts)

    @property
    def keys(self) -> np.ndarray:
        """Three corners that identify each face, (n_faces, 3), ascending."""
        return np.concatenate([np.zeros((0, 3), dtype=np.int64), *(_key(nodes, kind) for kind, nodes in self.faces.items())])

    def by_kind(self, some: np.ndarray) -> dict[str, np.ndarray]:
        """Return the nodes of some faces (a mask or ascending numbers) by kind; empty kinds are omitted."""
        chosen = np.zeros(self.n_faces, dtype=bool)
        chosen[some] = True
        by_kind = {
            kind: nodes[chosen[start : start + len(nodes)]] for (kind, nodes), start in zip(self.faces.items(), self.first)
        }
        return {kind: nodes for kind, nodes in by_kind.items() if len(nodes)}

    def nodes_of(self, some: np.ndarray) -> np.ndarray:
        """Return the nodes of some faces, ascending."""
        return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(nodes.ravel() for nodes in self.by_kind(some).values())]))


def skin_of(points: np.ndarray, blocks: Sequence[tuple[str, np.ndarray, int]]) -> Skin:
    """Return the skin of elements given as (kind, nodes (n_elements, n_nodes), number of the body).

    Local, rank 0.  Faces shared by two elements do not belong to the skin.
    """
    nodes: dict[str, list[np.ndarray]] = {}
    bodies: dict[str, list[np.ndarray]] = {}
    for kind, nodes_of_elements, body in blocks:
        for face, local in elements.KINDS[kind].faces:
            nodes.setdefault(face, []).append(nodes_of_elements[:, list(local)])
            bodies.setdefault(face, []).append(np.full(len(nodes_of_elements), body))
    _, part = parts_of([nodes_of_elements for _, nodes_of_elements, _ in blocks], len(points))
    faces, owners = {}, [np.zeros(0, dtype=np.int64)]
    for kind in sorted(nodes):
        all_faces, owner = np.concatenate(nodes[kind]), np.concatenate(bodies[kind])
        outer = _alone(_key(all_faces, kind), len(points))
        faces[kind] = all_faces[outer]
        owners.append(owner[outer])
    parts = [np.zeros(0, dtype=np.int64), *(part[nodes_of_elements[:, 0]] for nodes_of_elements in faces.values())]
    return Skin(points, faces, np.concatenate(owners), np.concatenate(parts))


def skin_of_mesh(mesh: Mesh) -> Skin:
    """Return the skin of a mesh; bodies are numbered as groups of its blocks first appear (``groups_of_bodies``).  Local."""
    number = {group: i for i, group in enumerate(groups_of_bodies(mesh))}
    return skin_of(mesh.points, [(block.kind, block.nodes, number[block.group]) for block in mesh.elements])


def groups_of_bodies(mesh: Mesh) -> list[str]:
    """Return the groups of volume elements, one per body, in the order of body numbers in the skin.  Local."""
    return list(dict.fromkeys(block.group for block in mesh.elements))


def faces_of_group(mesh: Mesh, skin: Skin, name: str) -> np.ndarray:
    """Return the faces of a group in a skin, ascending: faces in the group, or else faces with all nodes in it.  Local."""
    is_member = np.zeros(len(mesh.points), dtype=bool)
    is_member[mesh.node_groups[name]] = True
    inside = [is_member[chosen].all(axis=1) for chosen in skin.faces.values()]
    chosen = np.flatnonzero(np.concatenate([np.zeros(0, dtype=bool), *inside]))
    named = [_key(block.nodes, block.kind) for block in mesh.faces if block.group == name]
    return chosen[isin_rows(skin.keys[chosen], np.concatenate(named))] if named else chosen


def _key(nodes: np.ndarray, kind: str) -> np.ndarray:
    """Return the three lowest corners of faces, (n_faces, 3), which identify a face."""
    return np.sort(nodes[:, : elements.FACE_KINDS[kind].n_corners], axis=1)[:, :3]


def _alone(keys: np.ndarray, n_points: int) -> np.ndarray:
    """Return which faces have a unique key, (n_faces,) bool; a combination of two of its numbers cannot overflow."""
    high, low = keys[:, 0].astype(np.int64) * n_points + keys[:, 1], keys[:, 2]
    order = np.lexsort((low, high))
    same = (np.diff(high[order]) == 0) & (np.diff(low[order]) == 0)
    alone = np.ones(len(order), dtype=bool)
    alone[order[1:][same]] = False
    alone[order[:-1][same]] = False
    return alone
