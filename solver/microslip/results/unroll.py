"""Contact surfaces laid flat: connected patches of faces in plane coordinates, a cell for each pair.  NumPy and SciPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..elements import RINGS
from .record import Joint

_FLAT = np.cos(np.radians(60.0))  # normals further apart than this from their mean: the patch is rolled off
_ELONGATED = 1.3  # ratio of extents above which the longer one is drawn along x
_SAME = 1e-6  # of the extent: corners of cells this near each other are one
_PLACES = 20  # in a row of a grid by number, at least: few pairs make no large picture


@dataclass(frozen=True)
class Patch:
    """A connected part of a joint in plane coordinates [m], seen from body 1."""

    label: str
    x_label: str  # the model axis that x follows, "" if none
    pairs: np.ndarray  # (m,) indices of pairs
    points: np.ndarray  # (m, 2) places
    cells: list[np.ndarray]  # (k, 2) polygons; one for each face and pair
    cell_pair: np.ndarray  # (n_cells,) the pair that a cell belongs to
    outlines: list[np.ndarray]  # (k, 2) the faces
    spacing: float  # between neighbouring pairs [m]
    to_scale: bool = True  # False where the pairs have no position: a grid by their numbers

    @property
    def size(self) -> np.ndarray:
        """Extent of faces, or of points with half their spacing around them, (2,) m."""
        return np.ptp(self.corners, axis=0)

    @property
    def corners(self) -> np.ndarray:
        """Points (k, 2) that span the extent."""
        margin = 0.0 if self.outlines else 0.5 * self.spacing
        row_end = np.zeros((0, 2)) if self.to_scale else np.array([[_PLACES - 0.5, 0.0]])
        return np.concatenate([self.points - margin, self.points + margin, row_end, *self.outlines])


def patches(joint: Joint, n_sectors: int = 1) -> list[Patch]:
    """Return the contact surfaces of all joints, in the order of their first pairs.  Local.

    Pairs that no face names make one patch a joint, without cells.  The pairs of several sectors follow each other.
    """
    surfaces = []
    part = _parts(joint)
    parts = [np.flatnonzero(part == i) for i in np.unique(part)]
    parts.sort(key=lambda pairs: (joint.joint[pairs[0]], pairs[0]))
    for pairs in parts:
        siblings = [other for other in parts if joint.joint[other[0]] == joint.joint[pairs[0]]]
        where = _in_sector(joint, pairs, siblings, n_sectors) or _label(joint, pairs, siblings)
        surfaces.append(_patch(joint, pairs, joint.names[joint.joint[pairs[0]]] + where))
    return surfaces


def _in_sector(joint: Joint, pairs: np.ndarray, siblings: list[np.ndarray], n_sectors: int) -> str:
    """Return the position of a patch within its sector, that of sector 0, and the sector; "" where it belongs to several."""
    n = joint.n_pairs // n_sectors
    first, sector = [other for other in siblings if other[-1] < n], pairs[0] // n
    own = [other for other in first if np.array_equal(other, pairs - sector * n)]
    return f"{_label(joint, own[0], first)}, sector {sector}" if own and n_sectors > 1 else ""


def _label(joint: Joint, pairs: np.ndarray, siblings: list[np.ndarray]) -> str:
    """Return the position of a patch among those of its joint: the coordinates [mm] in which they differ most."""
    centres = 1e3 * np.array([joint.position[other].mean(axis=0) for other in siblings])
    spread = np.ptp(centres, axis=0)
    if not np.isfinite(centres).all() or spread.max() == 0.0:
        return ""
    rounded = np.round(centres, 2 - int(np.floor(np.log10(0.5 * spread.max())))) + 0.0  # no -0
    for n in (1, 2, 3):
        axes = np.sort(np.argsort(-spread, kind="stable")[:n])
        if len(np.unique(rounded[:, axes], axis=0)) == len(siblings):
            break
    place = rounded[[other[0] for other in siblings].index(pairs[0])]
    return (" at " + ", ".join(f"{'xyz'[k]} = {place[k]:.10g}" for k in axes) + " mm").replace("-", "\u2212")


def _parts(joint: Joint) -> np.ndarray:
    """Return a part number for every pair, (n_pairs,): pairs joined by faces, or by the corners of their cells, share it."""
    n = joint.n_pairs
    ends = [np.zeros((0, 2), dtype=int)]
    for faces in joint.faces:
        ends += [faces[:, [0, k]] for k in range(1, faces.shape[1])]
    ends.append(_shared_corners(joint))
    a, b = np.concatenate(ends).T
    lonely = np.setdiff1d(np.arange(n), np.concatenate([a, b]))
    for name in np.unique(joint.joint[lonely]):
        members = lonely[joint.joint[lonely] == name]
        a, b = np.concatenate([a, members[:1].repeat(len(members))]), np.concatenate([b, members])
    return connected_components(sp.coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)[1]


def _patch(joint: Joint, pairs: np.ndarray, label: str) -> Patch:
    position, normal = joint.position[pairs], joint.frame[pairs, 2]
    is_placed = np.isfinite(position).all() and np.isfinite(normal).all()
    if not is_placed or (len(pairs) > 1 and np.ptp(position, axis=0).max() == 0.0):
        return Patch(label, "", pairs, _number_grid(len(pairs)), [], np.zeros(0, dtype=int), [], 1.0, to_scale=False)
    mean = normal.mean(axis=0)
    length = np.linalg.norm(mean)
    is_flat = length > 0.0 and (normal @ mean >= _FLAT * length).all()
    points, along, x_axis, around = _project(position, mean / length) if is_flat else _roll_off(position, normal)
    where = np.full(joint.n_pairs, -1)
    where[pairs] = np.arange(len(pairs))
    cells, cell_pair, outlines = [], [], []
    for faces in joint.faces:
        for face in faces[where[faces[:, 0]] >= 0] if faces.shape[1] in RINGS else ():
            in_turn = face[list(RINGS[len(face)])]
            ring = _unwrapped(points[where[in_turn]], around)
            outlines.append(ring)
            cells += parts_of(ring, len(face) in (6, 8))
            cell_pair += list(in_turn)
    for i in np.flatnonzero(has_cell(joint.cells[pairs])):
        ring = points[i] + (joint.cells[pairs[i]] - position[i]) @ along[i].T
        outlines.append(ring)
        cells.append(ring)
        cell_pair.append(pairs[i])
    return Patch(label, _axis_name(x_axis), pairs, points, cells, np.array(cell_pair, dtype=int), outlines, _spacing(points))


def _spacing(points: np.ndarray) -> float:
    """Return the distance to the nearest neighbour that nearly all points keep; that of a single point is arbitrary."""
    if len(points) < 2:
        return 1e-3
    return float(np.quantile(cKDTree(points).query(points, k=2)[0][:, 1], 0.1))


def _shared_corners(joint: Joint) -> np.ndarray:
    """Return pairs (m, 2) whose cells share a corner, within one joint: the first of them and each other."""
    owner = np.repeat(np.flatnonzero(has_cell(joint.cells)), 4)
    if len(owner) == 0:
        return np.zeros((0, 2), dtype=int)
    corners = joint.cells[owner[::4]].reshape(-1, 3)
    grain = _SAME * np.ptp(corners, axis=0).max()
    key = np.column_stack([joint.joint[owner], np.round(corners / grain)])
    _, first, same = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return np.column_stack([owner[first[same.ravel()]], owner])


def has_cell(cells: np.ndarray) -> np.ndarray:
    """Return which of the ``cells`` (n, 4, 3) of pairs have an area, (n,) bool.  Local."""
    return np.isfinite(cells).all(axis=(1, 2)) & (np.ptp(cells, axis=1).max(axis=1, initial=0.0) > 0.0)


def _project(position: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return coordinates in the mean plane, the longer extent along x; their directions, (n, 2, 3); x; no period."""
    offset = position - position.mean(axis=0)
    axis = int(np.argmin(np.abs(normal)))
    x = np.eye(3)[axis] - normal[axis] * normal
    x /= np.linalg.norm(x)
    y = np.cross(normal, x)
    flat = np.column_stack([offset @ x, offset @ y])
    extent, directions = np.linalg.eigh(flat.T @ flat)
    if extent[1] > _ELONGATED**2 * extent[0]:
        x = directions[0, 1] * x + directions[1, 1] * y
        x *= np.sign(x[np.argmax(np.abs(x))])
    axes = np.stack([x, np.cross(normal, x)])
    return offset @ axes.T, np.tile(axes, (len(position), 1, 1)), x, 0.0


def _roll_off(position: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return coordinates on the cylinder that fits best, cut where it is widest open; their directions; x; the period."""
    axis = np.linalg.eigh(normal.T @ normal)[1][:, 0]
    axis *= np.sign(axis[np.argmax(np.abs(axis))])
    side = np.eye(3)[np.argmin(np.abs(axis))]
    a = np.cross(axis, side)
    a /= np.linalg.norm(a)
    across = np.stack([a, np.cross(axis, a)])
    n, q = normal @ across.T, position @ across.T
    # q = centre + radius n, for centre and radius
    rows = np.concatenate(
        [
            np.column_stack([np.ones(len(n)), np.zeros(len(n)), n[:, 0]]),
            np.column_stack([np.zeros(len(n)), np.ones(len(n)), n[:, 1]]),
        ]
    )
    fitted = np.linalg.lstsq(rows, np.concatenate([q[:, 0], q[:, 1]]), rcond=None)[0][2]
    radius = abs(fitted)  # below 0 where the normals point to the axis
    angle = np.arctan2(n[:, 1], n[:, 0])
    turned = np.sort(angle)
    gaps = np.append(np.diff(turned), turned[0] + 2.0 * np.pi - turned[-1])
    cut = turned[(np.argmax(gaps) + 1) % len(turned)]
    angle = np.mod(angle - cut + 1e-9, 2.0 * np.pi)
    along = np.stack([np.sign(fitted) * np.cross(axis, normal), np.tile(axis, (len(normal), 1))], axis=1)
    return np.column_stack([radius * angle, position @ axis]), along, np.zeros(3), 2.0 * np.pi * radius


def _unwrapped(ring: np.ndarray, period: float) -> np.ndarray:
    """Return a face whose nodes lie on both sides of the cut in one piece."""
    if period and np.ptp(ring[:, 0]) > period / 2.0:
        ring = ring.copy()
        ring[ring[:, 0] < period / 2.0, 0] += period
    return ring


def parts_of(ring: np.ndarray, has_middles: bool) -> list[np.ndarray]:
    """Return the part of a face nearest to each node of its ring (n, any), where every second one may be the middle of a side.

    Local.  The corners of a part are means of rows of the ring, for every quantity.
    """
    centre = ring.mean(axis=0)
    after, inner = (ring + np.roll(ring, -1, axis=0)) / 2.0, (ring + centre) / 2.0
    cells = []
    for i, node in enumerate(ring):
        sides = [node, after[i - 1], after[i]]
        if not has_middles:
            cells.append(np.array([sides[0], sides[1], centre, sides[2]]))
        elif i % 2 == 0:
            cells.append(np.array([sides[0], sides[1], inner[i], sides[2]]))
        else:
            cells.append(np.array([sides[0], sides[1], inner[i - 1], centre, inner[(i + 1) % len(ring)], sides[2]]))
    return cells


def _number_grid(n: int) -> np.ndarray:
    """Return places for n pairs by number, row by row, about 4 times as wide as high."""
    columns = max(_PLACES, int(np.ceil(2.0 * np.sqrt(n))))
    return np.column_stack([np.arange(n) % columns, -(np.arange(n) // columns)]).astype(float)


def _axis_name(x: np.ndarray) -> str:
    k = int(np.argmax(np.abs(x)))
    return "xyz"[k] if abs(x[k]) > 0.9 else ""
