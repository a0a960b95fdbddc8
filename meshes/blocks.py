"""Structured blocks of any element kind: mapped, joined to bodies with named surfaces, and checked.

The generators of this folder and the tests build their meshes with it.  A block is a lattice twice as fine as
its cells, so that every mid-side node is a lattice point and is placed on the mapped, curved geometry.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

SIDES = ("x0", "x1", "y0", "y1", "z0", "z1")

# Corners of the elements that fill one cell, as lattice offsets 0 or 2; edges and outward faces in VTK order.
_HEX = [[(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]]
_WEDGES = [
    [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2)],
    [(0, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 2, 2), (0, 2, 2)],
]
# Six tetrahedra around the diagonal of the cell: the cut is the same on opposite faces, so neighbours always match.
_TETS = [
    [(0, 0, 0), (2, 0, 0), (2, 2, 0), (2, 2, 2)],
    [(0, 0, 0), (2, 0, 2), (2, 0, 0), (2, 2, 2)],
    [(0, 0, 0), (0, 2, 0), (0, 2, 2), (2, 2, 2)],
    [(0, 0, 0), (2, 2, 0), (0, 2, 0), (2, 2, 2)],
    [(0, 0, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2)],
    [(0, 0, 0), (0, 2, 2), (0, 0, 2), (2, 2, 2)],
]
_SHAPES: dict[str, tuple[list, list, list]] = {
    "hex": (
        _HEX,
        [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
        [(0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)],
    ),
    "wedge": (
        _WEDGES,
        [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
        [(0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
    ),
    "tet": (_TETS, [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)], [(0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)]),
}
KINDS = {
    "hex8": ("hex", 1),
    "hex20": ("hex", 2),
    "tet4": ("tet", 1),
    "tet10": ("tet", 2),
    "wedge6": ("wedge", 1),
    "wedge15": ("wedge", 2),
}


@dataclass(frozen=True)
class Body:
    """One body of one element kind; nodes in VTK order."""

    kind: str  # a key of KINDS
    points: np.ndarray  # (n_nodes, 3) m
    elements: np.ndarray  # (n_elements, n_nodes_of_kind)
    faces: dict[str, list[np.ndarray]]  # name: faces of each face kind, (n_faces, 3, 4, 6 or 8), normals outward

    def face_nodes(self, name: str) -> np.ndarray:
        """Return the nodes of a named surface, sorted.  Local."""
        return np.unique(np.concatenate([faces.ravel() for faces in self.faces[name]]))


def block(kind: str, mapping: Callable, divisions: tuple[int, int, int], names: dict[str, str] | None = None) -> Body:
    """Return a block of ``divisions`` cells, each one hexahedron, two wedges or six tetrahedra.  Local.

    Parameters
    ----------
    mapping : function of three arrays u, v, w (n,) in [0, 1] that returns the points (n, 3) [m]
    divisions : cells along u, v, w
    names : {side: surface name}, sides "x0" (u = 0), "x1" (u = 1), "y0" ... "z1"; sides not given have no name

    Raises
    ------
    ValueError: a side without cells.
    """
    if min(divisions) < 1:
        raise ValueError(f"a block needs at least one cell along each side, not {divisions}")
    offsets = _offsets(kind)  # (n_per_cell, n_nodes, 3)
    size = 2 * np.asarray(divisions) + 1
    cells = 2 * np.stack(np.meshgrid(*map(np.arange, divisions), indexing="ij"), axis=-1).reshape(-1, 1, 1, 3)
    places = (cells + offsets).reshape(-1, *offsets.shape[1:])  # (n_elements, n_nodes, 3)
    numbers = np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), tuple(size))
    used, elements = np.unique(numbers, return_inverse=True)
    lattice = np.stack(np.unravel_index(used, tuple(size)), axis=-1)
    points = np.asarray(mapping(*(lattice / (size - 1)).T), dtype=float)
    elements = elements.reshape(places.shape[:2])
    faces = {}
    for side, name in (names or {}).items():
        axis, end = divmod(SIDES.index(side), 2)
        on_side = lattice[:, axis] == end * (size[axis] - 1)
        faces[name] = [nodes[on_side[nodes].all(axis=1)] for nodes in _all_faces(kind, elements)]
        faces[name] = [nodes for nodes in faces[name] if len(nodes)]
    return Body(kind, points, elements, faces)


def box(kind: str, lengths, divisions: tuple[int, int, int], origin=(0.0, 0.0, 0.0), names=None) -> Body:
    """Return a box along the axes; its sides are the surfaces "x0", "x1", ... "z1", or as in ``names``.  Local."""

    def mapping(u, v, w):
        return np.asarray(origin) + np.stack([u, v, w], axis=-1) * np.asarray(lengths)

    return block(kind, mapping, divisions, {side: side for side in SIDES} if names is None else names)


def stacked(
    kind: str, lengths, divisions: tuple[int, int, int], ground_height: float, ground_divisions: int = 1
) -> dict[str, Body]:
    """Return a bar along x from the origin that rests on a plate of the same length and width.  Local.

    The nodes of the two touching surfaces, "bar_bottom" and "ground_top" at z = 0, coincide but are not shared.
    The bar's ends are "bar_start" (x = 0) and "bar_end"; the plate's underside is "ground_base".
    """
    length, width, _ = lengths
    bar = box(kind, lengths, divisions, names={"z0": "bar_bottom", "z1": "bar_top", "x0": "bar_start", "x1": "bar_end"})
    ground = box(
        kind,
        (length, width, ground_height),
        (*divisions[:2], ground_divisions),
        (0.0, 0.0, -ground_height),
        {"z1": "ground_top", "z0": "ground_base"},
    )
    return {"bar": bar, "ground": ground}


def join(parts: list[Body], tolerance: float = 1e-9) -> Body:
    """Return one body from blocks of one kind whose nodes coincide within ``tolerance`` [m] where they meet.  Local."""
    points = np.concatenate([part.points for part in parts])
    start = np.cumsum([0] + [len(part.points) for part in parts])
    close = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
    graph = coo_matrix((np.ones(len(close)), close.T), (len(points), len(points)))
    _, label = connected_components(graph, directed=False)
    _, first, label = np.unique(label, return_index=True, return_inverse=True)
    faces: dict[str, list[np.ndarray]] = {}
    for part, shift in zip(parts, start, strict=False):
        for name, blocks in part.faces.items():
            faces.setdefault(name, []).extend(label[nodes + shift] for nodes in blocks)
    faces = {name: _by_width(blocks) for name, blocks in faces.items()}
    elements = np.concatenate([label[part.elements + shift] for part, shift in zip(parts, start, strict=False)])
    return Body(parts[0].kind, points[first], elements, faces)


def skin(body: Body) -> list[np.ndarray]:
    """Return the faces that belong to one element only, an array for each face kind.  Local."""
    faces_of_parts = []
    for faces in _all_faces(body.kind, body.elements):
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        faces_of_parts.append(faces[np.sort(first[count == 1])])
    return faces_of_parts


def jacobian_minimum(body: Body) -> np.ndarray:
    """Return the smallest det J of every element over its nodes and 3 x 3 x 3 quadrature points, (n_elements,).  Local.

    Relative to the reference element of unit edges, so a positive value is about the volume of the element's cell [m3].
    """
    places = np.concatenate([_offsets(body.kind)[0] / 2.0, _quadrature(body.kind)[0]])
    return _determinants(body, places).min(axis=1)


def volumes(body: Body) -> np.ndarray:
    """Return the volume of every element, (n_elements,) [m3].  Local."""
    places, weights = _quadrature(body.kind)
    return _determinants(body, places) @ weights


def aspect_ratios(body: Body) -> np.ndarray:
    """Return longest over shortest edge of every element, along its corners, (n_elements,).  Local."""
    edges = np.asarray(_SHAPES[KINDS[body.kind][0]][1])
    ends = body.points[body.elements[:, edges]]
    lengths = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=-1)
    return lengths.max(axis=1) / lengths.min(axis=1)


def _offsets(kind: str) -> np.ndarray:
    """Return the lattice offsets of the nodes of the elements of one cell, (n_per_cell, n_nodes, 3)."""
    shape, order = KINDS[kind]
    corners = np.asarray(_SHAPES[shape][0])
    if order == 1:
        return corners
    edges = np.asarray(_SHAPES[shape][1])
    return np.concatenate([corners, corners[:, edges].sum(axis=2) // 2], axis=1)


def _all_faces(kind: str, elements: np.ndarray) -> list[np.ndarray]:
    """Return all faces of all elements, an array for each face kind, nodes in VTK order."""
    shape, order = KINDS[kind]
    corners, edges, faces = _SHAPES[shape]
    middle = {frozenset(edge): len(corners[0]) + i for i, edge in enumerate(edges)}
    rows = [list(face) for face in faces]
    if order == 2:
        rows = [row + [middle[frozenset(edge)] for edge in zip(row, row[1:] + row[:1], strict=True)] for row in rows]
    return _by_width([elements[:, row] for row in rows])


def _by_width(blocks: list[np.ndarray]) -> list[np.ndarray]:
    widths = sorted({nodes.shape[1] for nodes in blocks})
    return [np.concatenate([nodes for nodes in blocks if nodes.shape[1] == width]) for width in widths]


def _exponents(kind: str) -> np.ndarray:
    """Return the exponents of the monomials that span the shape functions of a kind, (n_nodes, 3)."""
    shape, order = KINDS[kind]
    every = np.array(list(itertools.product(range(order + 1), repeat=3)))
    if shape == "tet":
        return every[every.sum(axis=1) <= order]
    if shape == "wedge":  # order 2 in the triangle with z, order 1 in the triangle with z^2
        in_plane = every[:, :2].sum(axis=1)
        return every[in_plane + np.maximum(every[:, 2] - 1, 0) <= order]
    return every[np.where(every > 1, every, 0).sum(axis=1) <= order]  # serendipity: at most one exponent is 2


def _determinants(body: Body, places: np.ndarray) -> np.ndarray:
    """Return det J of every element at ``places`` (n_places, 3) of its reference element, (n_elements, n_places)."""
    exponents = _exponents(body.kind)
    at_nodes = np.prod((_offsets(body.kind)[0] / 2.0)[:, None, :] ** exponents, axis=2)
    gradient = []
    for axis in range(3):
        lowered = exponents.copy()
        lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
        gradient.append(exponents[:, axis] * np.prod(places[:, None, :] ** lowered, axis=2))
    d_shape = np.stack(gradient, axis=1) @ np.linalg.inv(at_nodes)  # (n_places, 3, n_nodes)
    return np.linalg.det(np.einsum("pan,enx->epax", d_shape, body.points[body.elements], optimize=True))


def _quadrature(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Return points and weights of a 3 x 3 x 3 rule; wedge (x >= y) and tet (x >= y >= z) are collapsed cubes."""
    points, weights = np.polynomial.legendre.leggauss(3)
    r, s, t = (axis.ravel() for axis in np.meshgrid(*[(points + 1.0) / 2.0] * 3, indexing="ij"))
    weight = np.einsum("i,j,k->ijk", *[weights / 2.0] * 3).ravel()
    shape = KINDS[kind][0]
    if shape == "hex":
        return np.stack([r, s, t], axis=1), weight
    if shape == "wedge":
        return np.stack([r, r * s, t], axis=1), weight * r
    return np.stack([r, r * s, r * s * t], axis=1), weight * r**2 * s
