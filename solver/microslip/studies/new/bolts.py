"""Bolts of a mesh: connected parts with a round, solid shank and a head or nuts at its ends, and the place of a cut."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ... import elements
from ...formats.model import FileModel
from ...mesh.components import parts_of
from ...mesh.cut import cut_through
from ...mesh.data import Mesh
from ...mesh.skin import Skin
from ...mesh.touching import Touching
from ...messages.errors import MeshError
from ...tables.constant_loads import Bolt
from ...tables.table import Vector

_LONGER = 1.3  # least ratio of the second moment along the axis to those across it
_ROUND = 0.25  # largest relative difference of the second moments across the axis
_SLICES = 40  # slices along the axis
_SHANK = 0.3  # least length of the shank over the length of the part
_SAME = 1.12  # largest radius of a slice of the shank over the smallest
_WIDER = 1.25  # least radius of a head over the radius of the shank
_FULL = (0.75, 1.1)  # volume of the shank over its cylinder; smaller for coarse meshes
_NUT = 4.0  # largest radius of a nut over the radius of the shank
_HOLE = 0.8  # least radius of its hole over the radius of the shank
_ACROSS = 0.3  # largest |cosine| between the normals of a thread and the axis


@dataclass(frozen=True, eq=False)
class Shank:
    """A bolt: shank, nuts, and a cut."""

    part: int  # number of the connected part in the skin
    body: str
    axis: np.ndarray  # (3,) unit, towards the largest head
    radius: float  # m
    position: np.ndarray  # (3,) m, point on the axis in the free part of the shank
    rings: tuple[int, ...] = ()  # numbers of parts that are nuts or washers
    group: str | None = None  # group of the file that cuts the shank

    @property
    def direction(self) -> Vector:
        """The axis, rounded."""
        x, y, z = (np.round(self.axis, 3) + 0.0).tolist()
        return x, y, z


@dataclass(frozen=True, eq=False)
class _Part:
    """Elements of a connected part: centres (n, 3) [m], volumes (n,) [m3], and corners of each, padded by the first."""

    centre: np.ndarray
    volume: np.ndarray
    corners: np.ndarray  # (n, 8, 3) m
    body: str


def find_bolts(mesh: Mesh, skin: Skin, touching: Touching, body_of: Mapping[str, str], inner: Collection[str]) -> list[Shank]:
    """Return the bolts of a mesh.  Local, rank 0.

    ``body_of``: the body of each group of elements; the groups ``inner`` have no outer face and may be cuts.
    """
    n_parts, part = parts_of([block.nodes for block in mesh.elements], len(mesh.points))
    parts = {i: _part(mesh, part, i, body_of) for i in np.unique(skin.part).tolist()} if n_parts > 1 else {}
    shanks = [shank for i, of_part in parts.items() if (shank := _shank(i, of_part)) is not None]
    shanks = [_with_nuts(skin, touching, shank, parts, {other.part for other in shanks}) for shank in shanks]
    cuts = _cuts_of_file(mesh, inner) if shanks else []
    group_of = {int(part[nodes[0]]): name for name, nodes in reversed(cuts) if (part[nodes] == part[nodes[0]]).all()}
    return [replace(shank, group=group_of.get(shank.part)) for shank in shanks]


def uncut(mesh: Mesh, file: FileModel, bolts: Sequence[Shank]) -> list[Shank]:
    """Return the bolts without a cut in the file, with rounded positions.  Local, rank 0."""
    _, part = parts_of([block.nodes for block in mesh.elements], len(mesh.points))
    cut = {int(part[node]) for bolt in file.bolts for node in mesh.node_groups.get(bolt.group, ())}
    digits = 6 - int(np.floor(np.log10(mesh.diagonal)))
    return [replace(bolt, position=np.round(bolt.position, digits) + 0.0) for bolt in bolts if bolt.part not in cut]


def _part(mesh: Mesh, part: np.ndarray, number: int, body_of: Mapping[str, str]) -> _Part:
    """Return the elements of a part."""
    centres, volumes, corners, body = [], [], [], ""
    for block in mesh.elements:
        nodes = block.nodes[part[block.nodes[:, 0]] == number]
        if not len(nodes):
            continue
        n = elements.KINDS[block.kind].n_corners
        points = mesh.points[nodes[:, [*range(n), *[0] * (8 - n)]]]
        centres.append(points[:, :n].mean(axis=1))
        volumes.append(elements.volumes(block.kind, mesh.points[nodes]))
        corners.append(points)
        body = body_of[block.group]
    return _Part(np.concatenate(centres), np.concatenate(volumes), np.concatenate(corners), body)


def _shank(number: int, part: _Part) -> Shank | None:
    """Return the shank of a part: longer than wide, round and solid at its thinnest section; None for other parts."""
    middle = part.volume @ part.centre / part.volume.sum()
    arms = part.centre - middle
    moments, directions = np.linalg.eigh(np.einsum("e,ei,ej->ij", part.volume, arms, arms))
    if moments[2] < _LONGER * moments[1] or moments[1] - moments[0] > _ROUND * moments[1]:
        return None
    axis = directions[:, 2]
    along = (part.corners - middle) @ axis
    radius = np.linalg.norm(part.corners - middle - along[:, :, None] * axis, axis=2).max(axis=1)
    low, high = along.min(), along.max()
    edges = np.linspace(low, high, _SLICES + 1)
    inner = 1e-3 * (high - low)
    is_in = (along.min(axis=1)[:, None] < edges[1:] - inner) & (along.max(axis=1)[:, None] > edges[:-1] + inner)
    widest = np.where(is_in, radius[:, None], 0.0).max(axis=0)
    first, last = _longest_run(widest <= _SAME * widest[1:-1].min())
    start, end, r = edges[first], edges[last], widest[first:last].min(initial=np.inf)
    if not end - start >= _SHANK * (high - low):
        return None
    centre = (part.centre - middle) @ axis
    inside = (centre > start) & (centre < end)
    cylinder = np.pi * r**2 * np.ptp(along[inside]) if inside.any() else np.inf
    if not _FULL[0] <= part.volume[inside].sum() / cylinder <= _FULL[1]:
        return None
    ends = [widest[:first].max(initial=0.0), widest[last:].max(initial=0.0)]
    if max(ends) < _WIDER * r:
        return None
    sign = 1.0 if ends[1] >= ends[0] else -1.0
    at = _free_place(centre[inside], start, end)
    return Shank(number, part.body, sign * axis, float(r), middle + at * axis)


def _longest_run(flags: np.ndarray) -> tuple[int, int]:
    """Return the begin and the end of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    runs = edges.reshape(-1, 2)
    return tuple(runs[np.argmax(np.diff(runs, axis=1))].tolist()) if len(runs) else (0, 0)


def _free_place(along: np.ndarray, start: float, end: float) -> float:
    """Return the plane position in the middle third of ``start`` to ``end`` farthest from the centres of elements."""
    low, high = start + (end - start) / 3.0, end - (end - start) / 3.0
    inside = np.sort(along[(along > low) & (along < high)])
    if len(inside) < 2 or np.diff(inside).max() < 1e-3 * (end - start):
        return float((low + high) / 2.0)
    largest = int(np.argmax(np.round(np.diff(inside) / (end - start), 6)))
    return float(inside[largest : largest + 2].mean())


def _with_nuts(skin: Skin, touching: Touching, shank: Shank, parts: dict[int, _Part], bolts: set[int]) -> Shank:
    """Return a shank with its nuts and washers, and its cut outside the nuts."""
    rings = tuple(number for number, part in parts.items() if number not in bolts and _is_ring(part, shank, parts[shank.part]))
    is_thread = (skin.part[touching.face] == shank.part) & (np.abs(skin.normal[touching.face] @ shank.axis) < _ACROSS)
    on_thread = set(skin.part[touching.other[is_thread]].tolist())
    nuts = tuple(number for number in rings if number in on_thread)
    shank = replace(shank, rings=rings)
    if not nuts:
        return shank
    along, radius = _around(parts[shank.part].centre, shank)
    nut_end = max(float(_around(parts[nut].corners, shank)[0].max()) for nut in nuts)
    head = float(along[radius > shank.radius].min(initial=along.max()))
    if head <= nut_end:
        return shank
    at = _free_place(along[(along > nut_end) & (along < head)], nut_end, head)
    return replace(shank, position=shank.position + at * shank.axis)


def _around(points: np.ndarray, shank: Shank) -> tuple[np.ndarray, np.ndarray]:
    """Return the axial coordinates of points (..., 3) from the cut of a shank, and their distances from its axis [m]."""
    arms = points - shank.position
    along = arms @ shank.axis
    return along, np.linalg.norm(arms - along[..., None] * shank.axis, axis=-1)


def _is_ring(part: _Part, shank: Shank, bolt: _Part) -> bool:
    """Return whether a part is a ring around a shank, no wider than a nut."""
    (along, radius), (of_bolt, _) = _around(part.corners, shank), _around(bolt.corners, shank)
    is_along_shank = along.min() > of_bolt.min() - shank.radius and along.max() < of_bolt.max() + shank.radius
    return bool(is_along_shank and radius.max() <= _NUT * shank.radius and radius.min() >= _HOLE * shank.radius)


def _cuts_of_file(mesh: Mesh, inner: Collection[str]) -> list[tuple[str, np.ndarray]]:
    """Return the groups of the file that are complete cuts, with their nodes."""
    named = {block.group for block in mesh.faces if block.group in inner}
    cuts = []
    for name in named:
        try:
            cuts.append((name, cut_through(mesh, Bolt.of_file(group=name)).nodes))
        except MeshError:
            continue
    return sorted(cuts, key=lambda cut: cut[0])
