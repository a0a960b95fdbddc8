"""The shapes of Ansys solids: hexahedra with coincident nodes (equal numbers) are prisms, pyramids and tetrahedra."""

from typing import NamedTuple

import numpy as np

from ...messages.errors import MeshError
from ..draft import cells_of
from ..model import Cells


class _Shape(NamedTuple):
    """The nodes of a row that form a cell."""

    family: str
    corners: list[int]
    middles: list[int]
    equal: tuple[tuple[int, int], ...] = ()  # coincident corners
    n_equal: int = 0  # pairs of equal corners


# corners I J K L M N O P and mid-side nodes Q R S T U V W X Y Z A B
_WHOLE = (
    _Shape("hex", list(range(8)), list(range(8, 20))),
    _Shape("wedge", [0, 1, 2, 4, 5, 6], [8, 9, 11, 12, 13, 15, 16, 17, 18], ((2, 3), (6, 7)), 2),
    _Shape("pyramid", [0, 1, 2, 3, 4], [8, 9, 10, 11, 16, 17, 18, 19], ((4, 5), (4, 6), (4, 7)), 6),
    _Shape("tet", [0, 1, 2, 4], [8, 9, 11, 16, 17, 18], ((2, 3), (4, 5), (4, 6), (4, 7)), 7),
)
_TETRAHEDRON = _Shape("tet", [0, 1, 2, 3], [4, 5, 6, 7, 8, 9])  # elements without other shapes


def solids(rows: np.ndarray, elements: np.ndarray, numbers: np.ndarray) -> list[Cells]:
    """Return the cells of solids of 8 or 20 nodes, by their shape.  Local.

    Parameters
    ----------
    rows : (n, 8 or 20) node numbers; 0 for mid-side nodes that are left out
    elements : (n,) element numbers, for messages and cells
    numbers : (n_points,) node numbers of the file

    Raises
    ------
    MeshError : another shape, some mid-side nodes left out, or a node that does not exist
    """
    corners, is_linear = rows[:, :8], ~(rows[:, 8:] > 0).any(axis=1)
    n_equal = sum((corners[:, i] == corners[:, j]).astype(int) for i in range(8) for j in range(i))
    cells, is_known = [], np.zeros(len(rows), dtype=bool)
    for shape in _WHOLE:
        has_shape = (n_equal == shape.n_equal) & ~is_known
        for i, j in shape.equal:
            has_shape &= corners[:, i] == corners[:, j]
        is_known |= has_shape
        cells += _by_order(shape, rows[has_shape], is_linear[has_shape], elements[has_shape], numbers)
    if not is_known.all():
        raise MeshError(
            f"element {elements[~is_known][0]}: its coincident nodes do not form a hexahedron, prism, pyramid or tetrahedron"
        )
    return cells


def tetrahedra(rows: np.ndarray, elements: np.ndarray, numbers: np.ndarray) -> list[Cells]:
    """Return the cells of SOLID187 and similar elements, (n, 10), whose nodes are in the order of this program.  Local."""
    is_linear = ~(rows[:, 4:] > 0).any(axis=1)
    return _by_order(_TETRAHEDRON, rows, is_linear, elements, numbers)


def _by_order(shape: _Shape, rows: np.ndarray, is_linear: np.ndarray, elements: np.ndarray, numbers: np.ndarray) -> list[Cells]:
    """Return the cells of one shape, with none and with all mid-side nodes."""
    cells = []
    for has_nodes, nodes in ((is_linear, shape.corners), (~is_linear, shape.corners + shape.middles)):
        if has_nodes.any():
            cells.append(_cells(f"{shape.family}{len(nodes)}", rows[has_nodes][:, nodes], elements[has_nodes], numbers))
    return cells


def faces(rows: np.ndarray, elements: np.ndarray, numbers: np.ndarray) -> list[Cells]:
    """Return the cells of surface elements of up to 8 nodes (I J K L and mid-side nodes; K = L: a triangle).  Local."""
    cells = []
    is_quadratic = (rows[:, 4:8] > 0).all(axis=1) if rows.shape[1] >= 8 else np.zeros(len(rows), dtype=bool)
    is_triangle = rows[:, 2] == rows[:, 3]
    for kind, is_kind, columns in (
        ("quad8", is_quadratic & ~is_triangle, [0, 1, 2, 3, 4, 5, 6, 7]),
        ("tri6", is_quadratic & is_triangle, [0, 1, 2, 4, 5, 7]),
        ("quad4", ~is_quadratic & ~is_triangle, [0, 1, 2, 3]),
        ("tri3", ~is_quadratic & is_triangle, [0, 1, 2]),
    ):
        if is_kind.any():
            cells.append(_cells(kind, rows[is_kind][:, columns], elements[is_kind], numbers))
    return cells


def _cells(kind: str, nodes: np.ndarray, elements: np.ndarray, numbers: np.ndarray) -> Cells:
    dropped = (nodes <= 0).any(axis=1)
    if dropped.any():
        raise MeshError(f"element {elements[dropped][0]}: a mid-side node is left out; mesh it with all of them, or with none")
    return cells_of(kind, elements, nodes, numbers)
