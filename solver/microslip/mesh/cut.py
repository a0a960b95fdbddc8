"""Cuts through the shanks of bolts: faces, normal, and the elements on the side of the normal."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from .. import elements
from ..messages.errors import MeshError
from ..messages.words import counted, place
from ..tables.constant_loads import Bolt
from .data import Mesh
from .plane_cut import is_below
from .surface import n_corners

MOST_TURN = 45.0  # degrees between a face of the cut and the mean normal


@dataclass(frozen=True, eq=False)
class Cut:
    """A cut through a shank, with the elements that touch it on the side of the normal."""

    nodes: np.ndarray  # (n_nodes,) index into Mesh.points
    normal: np.ndarray  # (3,) unit, the mean of the faces
    area: float  # m2, across the normal
    numbers: dict[tuple[str, str], np.ndarray]  # by kind and group of the elements: their numbers in the user's file


@dataclass(frozen=True, eq=False)
class _Near:
    """The elements that touch some nodes, counted over all blocks, and their faces; inner faces appear twice."""

    block: np.ndarray  # (n_elements,) index into Mesh.elements
    row: np.ndarray  # (n_elements,) in the block
    centre: np.ndarray  # (n_elements, 3) m
    owner: np.ndarray  # (n_faces,) element of each face
    label: np.ndarray  # (n_faces,) equal for equal corners
    corners: np.ndarray  # (n_faces, 4) sorted corners; the first twice for a triangle
    vector: np.ndarray  # (n_faces, 3) m2, outward area vector
    nodes: list[np.ndarray]  # nodes of each face


def cuts_through(mesh: Mesh, bolts: Sequence[Bolt]) -> list[Cut]:
    """Return the cut of each bolt.  Local, rank 0.

    Raises
    ------
    MeshError : a group that is not a cut, or cuts that touch each other
    """
    cuts, users = [], dict[int, str]()
    for bolt in bolts:
        cut = cut_through(mesh, bolt)
        for node in np.unique(np.concatenate([_nodes_of(mesh, cut), cut.nodes])):
            other = users.setdefault(int(node), bolt.label)
            if other != bolt.label:
                raise MeshError(
                    f"{mesh.path}: bolts {other!r} and {bolt.label!r}: their cuts lie side by side at node "
                    f"{mesh.numbers[node]} {place(mesh.points[node])} m; leave two layers of elements between cuts"
                )
        cuts.append(cut)
    return cuts


def cut_through(mesh: Mesh, bolt: Bolt) -> Cut:
    """Return the cut of a bolt's group.  Local, rank 0.

    The faces of the group if it has any, otherwise the inner faces of elements with all nodes in the group.

    Raises
    ------
    MeshError : faces that are not inner faces, are in several pieces, far from one plane, or end inside the body
    """
    where = f"{mesh.path}: bolt {bolt.label!r}: group {bolt.group!r}"
    near = _elements_near(mesh, mesh.node_groups[bolt.group])
    in_cut = _faces_of_cut(mesh, bolt.group, near, where)
    _check_one_piece(near, in_cut, where)
    plane = mesh.planes.get(bolt.group)
    normal, area = _mean_normal(near.vector[in_cut], where) if plane is None else _of_plane(mesh, near, in_cut, plane)
    nodes = np.unique(np.concatenate([near.nodes[i] for i in np.flatnonzero(in_cut)]))
    is_cut = np.zeros(len(mesh.points), dtype=bool)
    is_cut[nodes] = True
    touches = np.array([is_cut[mesh.elements[b].nodes[row]].any() for b, row in zip(near.block, near.row)])
    if plane is None:
        side = _sides(mesh, near, in_cut, normal, is_cut, where)
    else:
        side = np.where(is_below(mesh, near.centre, plane), -1, 1) * (1 if normal @ plane[1] > 0.0 else -1)
    numbers: dict[tuple[str, str], np.ndarray] = {}
    for b in np.unique(near.block):
        is_above = (near.block == b) & touches & (side > 0)
        block = mesh.elements[b]
        key = (block.kind, block.group)
        numbers[key] = np.concatenate([numbers.get(key, np.empty(0, dtype=np.int64)), block.numbers[near.row[is_above]]])
    return Cut(nodes, normal, area, {key: np.sort(above) for key, above in numbers.items() if len(above)})


def _nodes_of(mesh: Mesh, cut: Cut) -> np.ndarray:
    """Return the nodes of the elements of a cut."""
    nodes_of_faces = [
        block.nodes[np.isin(block.numbers, cut.numbers[block.kind, block.group])].ravel()
        for block in mesh.elements
        if (block.kind, block.group) in cut.numbers
    ]
    return np.unique(np.concatenate(nodes_of_faces))


def _elements_near(mesh: Mesh, nodes: np.ndarray) -> _Near:
    """Return the elements that touch any of ``nodes``."""
    is_near = np.zeros(len(mesh.points), dtype=bool)
    is_near[nodes] = True
    blocks, rows, centres, owners, corners, vectors, of_faces, n = [], [], [], [], [], [], [], 0
    for b, block in enumerate(mesh.elements):
        near = np.flatnonzero(is_near[block.nodes].any(axis=1))
        kind = elements.KINDS[block.kind]
        blocks.append(np.full(len(near), b))
        rows.append(near)
        centres.append(mesh.points[block.nodes[near, : kind.n_corners]].mean(axis=1))
        for face_kind, local in kind.faces:
            faces = block.nodes[near][:, list(local)]
            owners.append(n + np.arange(len(near)))
            corners.append(_padded(faces[:, : n_corners(face_kind)]))
            vectors.append(-elements.pressure_forces(face_kind, mesh.points[faces]).sum(axis=1))
            of_faces += list(faces)
        n += len(near)
    key = np.concatenate(corners)
    label = np.unique(key, axis=0, return_inverse=True)[1].ravel()
    block_of, row, centre, owner = (np.concatenate(values) for values in (blocks, rows, centres, owners))
    return _Near(block_of, row, centre, owner, label, key, np.concatenate(vectors), of_faces)


def _faces_of_cut(mesh: Mesh, group: str, near: _Near, where: str) -> np.ndarray:
    """Return which faces belong to the cut, (n_faces,); each twice, from both sides."""
    is_inner = np.bincount(near.label)[near.label] == 2
    named = [block.nodes[:, : n_corners(block.kind)] for block in mesh.faces if block.group == group]
    if named:
        wanted = np.unique(np.concatenate([_padded(faces) for faces in named]), axis=0)
        both, index = np.unique(np.concatenate([wanted, near.corners]), axis=0, return_inverse=True)
        is_wanted = np.zeros(len(both), dtype=bool)
        is_wanted[index.ravel()[: len(wanted)]] = True
        in_cut = is_wanted[index.ravel()[len(wanted) :]]
        n_outer = len(wanted) - len(np.unique(near.label[in_cut & is_inner]))
    else:
        member = np.zeros(len(mesh.points), dtype=bool)
        member[mesh.node_groups[group]] = True
        in_cut, n_outer = np.array([member[nodes].all() for nodes in near.nodes]) & is_inner, 0
    if n_outer or not in_cut.any():
        reason = f"{n_outer} of {counted(len(wanted), 'face')} are not" if n_outer else "it holds no face"
        raise MeshError(
            f"{where}: {reason} between two elements of the mesh; the cut of a bolt is a group of the inner faces "
            "that cross its shank from side to side, with the same nodes on both sides"
        )
    return in_cut


def _padded(faces: np.ndarray) -> np.ndarray:
    """Return the sorted corners of faces, (n, 4); the lowest one twice for triangles."""
    return np.sort(faces if faces.shape[1] == 4 else np.column_stack([faces, faces.min(axis=1)]), axis=1)


def _check_one_piece(near: _Near, in_cut: np.ndarray, where: str) -> None:
    """Raise MeshError if the faces of the cut are not connected."""
    corners = near.corners[in_cut]
    used, index = np.unique(corners, return_inverse=True)
    index = index.reshape(corners.shape)
    pattern = sp.coo_matrix((np.ones(3 * len(index)), (np.repeat(index[:, 0], 3), index[:, 1:].ravel())), (len(used),) * 2)
    n_pieces, _ = connected_components(pattern, directed=False)
    if n_pieces > 1:
        raise MeshError(f"{where}: the faces form {n_pieces} separate cuts; each shank needs a group and a bolt of its own")


def _mean_normal(vectors: np.ndarray, where: str) -> tuple[np.ndarray, float]:
    """Return the mean normal of faces that appear twice, outward from each side, and their projected area [m2].

    The largest component of the normal is positive; the choice of the side has no effect.
    """
    sizes = np.linalg.norm(vectors, axis=1)
    rough = np.linalg.eigh(np.einsum("fi,fj,f->ij", vectors, vectors, 1.0 / sizes))[1][:, -1]
    total = np.where((vectors @ rough)[:, None] > 0.0, vectors, -vectors).sum(axis=0)
    normal = _upward(total / np.linalg.norm(total))
    turn = np.degrees(np.arccos(np.clip(np.abs(vectors @ normal) / sizes, 0.0, 1.0))).max()
    if turn > MOST_TURN:
        raise MeshError(
            f"{where}: a face turns {turn:.0f} degrees from the mean normal {place(np.round(normal, 4) + 0.0)} of the cut (bound "
            f"{MOST_TURN:.0f}); a cut is roughly a plane across the shank"
        )
    return normal, float(np.linalg.norm(total)) / 2.0


def _of_plane(mesh: Mesh, near: _Near, in_cut: np.ndarray, plane: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the normal of a plane (2, 3), and the projected area of the faces along it, at any inclination [m2].

    The faces lie between elements whose centres are on different sides of the plane.
    """
    below = in_cut & is_below(mesh, near.centre[near.owner], plane)
    return _upward(plane[1]), float(near.vector[below].sum(axis=0) @ plane[1])


def _upward(normal: np.ndarray) -> np.ndarray:
    """Return a normal or its opposite, with a positive largest component."""
    return normal * np.sign(normal[np.argmax(np.abs(normal) - 1e-9 * np.arange(3))])


def _sides(mesh: Mesh, near: _Near, in_cut, normal, is_cut, where: str) -> np.ndarray:
    """Return for each element +1 on the side of the normal, -1 on the other side; 0 if it does not touch the cut.

    Elements connected by faces outside the cut are on the same side.
    """
    touches = np.array([is_cut[mesh.elements[b].nodes[row]].any() for b, row in zip(near.block, near.row)])
    piece = _pieces(near, touches, ~in_cut)
    of_face = -np.sign(near.vector @ normal)  # outward normals of elements below the cut point along the normal
    seeds = [np.unique(piece[near.owner[in_cut & (of_face == sign)]]) for sign in (-1.0, 1.0)]
    both = np.intersect1d(*seeds)
    if len(both):
        node = _node_at_end(mesh, near, in_cut, of_face, is_cut)
        raise MeshError(
            f"{where}: the cut does not go through: its two sides are connected around it, first at node "
            f"{mesh.numbers[node]} {place(mesh.points[node])} m; take all faces from side to side of the shank, which must not "
            "share nodes with the part around it"
        )
    middle = mesh.points[is_cut].mean(axis=0)
    side = np.where((near.centre - middle) @ normal > 0.0, 1, -1)  # elements that touch the cut without such a connection
    side[np.isin(piece, seeds[0])], side[np.isin(piece, seeds[1])] = -1, 1
    return np.where(touches, side, 0)


def _pieces(near: _Near, members: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Return a label for each element, equal for ``members`` connected by the faces in ``use``."""
    use = use & members[near.owner]
    order = np.flatnonzero(use)[np.argsort(near.label[use], kind="stable")]
    pair = near.label[order[1:]] == near.label[order[:-1]]
    first, second = near.owner[order[:-1][pair]], near.owner[order[1:][pair]]
    n = len(members)
    return connected_components(sp.coo_matrix((np.ones(len(first)), (first, second)), (n, n)), directed=False)[1]


def _node_at_end(mesh: Mesh, near: _Near, in_cut, of_face, is_cut) -> int:
    """Return a node of the cut around which its two sides are connected; any node if there is no single one."""
    for node in np.flatnonzero(is_cut):
        members = np.array([node in mesh.elements[b].nodes[row] for b, row in zip(near.block, near.row)])
        piece = _pieces(near, members, ~in_cut)
        at_node = in_cut & members[near.owner]
        if len(np.intersect1d(*(piece[near.owner[at_node & (of_face == sign)]] for sign in (-1.0, 1.0)))):
            return int(node)
    return int(np.flatnonzero(is_cut)[0])
