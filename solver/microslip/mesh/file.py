"""What a mesh file holds, before the scene says what is used of it: the common form of all readers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

NO_NODES = np.empty(0, dtype=np.int64)

# Every kind a file may hold, as this program calls it: dimension and number of nodes.
KINDS = {
    "point": (0, 1),
    "line2": (1, 2),
    "line3": (1, 3),
    "tri3": (2, 3),
    "tri6": (2, 6),
    "quad4": (2, 4),
    "quad8": (2, 8),
    "quad9": (2, 9),
    "tet4": (3, 4),
    "tet10": (3, 10),
    "hex8": (3, 8),
    "hex20": (3, 20),
    "hex27": (3, 27),
    "wedge6": (3, 6),
    "wedge15": (3, 15),
    "wedge18": (3, 18),
    "pyramid5": (3, 5),
    "pyramid13": (3, 13),
    "pyramid14": (3, 14),
}


@dataclass(frozen=True)
class Cells:
    """Cells of one kind, nodes in VTK order."""

    kind: str  # a key of KINDS, or the reader's own word for a kind that is not among them
    nodes: np.ndarray  # (n_cells, n_nodes) index into FileMesh.points
    numbers: np.ndarray  # (n_cells,) numbers of the file


@dataclass
class Group:
    """A named set; a node may be named by itself or as a corner of a cell."""

    nodes: np.ndarray = field(default_factory=lambda: NO_NODES)  # named nodes, index into FileMesh.points
    cells: dict[int, np.ndarray] = field(default_factory=dict)  # block of FileMesh.cells: its named rows

    def add_nodes(self, nodes: np.ndarray) -> None:
        self.nodes = np.union1d(self.nodes, nodes)

    def add_cells(self, block: int, rows: np.ndarray) -> None:
        self.cells[block] = np.union1d(self.cells.get(block, NO_NODES), rows).astype(np.int64)


@dataclass(frozen=True)
class FileMesh:
    """Points, cells and groups of a file in its own length unit.  Rank 0 only."""

    points: np.ndarray  # (n_points, 3) mesh units
    numbers: np.ndarray  # (n_points,) node numbers of the file
    cells: tuple[Cells, ...]
    groups: dict[str, Group]
    notes: tuple[str, ...] = ()
    fields: dict[str, np.ndarray] = field(default_factory=dict)  # (n_points,) each: numbers at the nodes; NaN where it has none


def names_of_tags(keys: set[tuple[int, int]]) -> dict[tuple[int, int], str]:
    """Name groups that have a dimension and a tag only: by the tag, with the dimension where the tag is not unique."""
    tags = [tag for _, tag in keys]
    word = ("point", "curve", "surface", "volume")
    return {(dim, tag): str(tag) if tags.count(tag) == 1 else f"{word[dim]} {tag}" for dim, tag in sorted(keys)}


def index_of(numbers: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of ``wanted`` in ``numbers`` and the numbers that are not there.  Local."""
    if len(numbers) == 0:
        return np.zeros(np.shape(wanted), dtype=np.int64), np.unique(wanted)
    order = np.argsort(numbers, kind="stable")
    found = np.minimum(np.searchsorted(numbers, wanted, sorter=order), len(numbers) - 1)
    index = order[found]
    return index, np.unique(np.asarray(wanted)[numbers[index] != wanted])
