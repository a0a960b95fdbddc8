"""What a model file holds, before the scene says what is used of it: the common form of all readers.

A reader takes over what it understands, in the file's own units, and reports everything else as a ``Finding``: what it does
not understand is never left out in silence.  ``library/complete.py`` makes a scene of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from ..tables.constant_loads import Bolt, Statics
from ..tables.joint import Joint
from ..tables.structure import Body, Mass, Material, Orientation, Point, Spring, Support, Tie
from ..tables.table import Vector

NO_NODES = np.empty(0, dtype=np.int64)
_MOST_HOLES = 8  # numbers left out for each that is there, for which a table of them all is worth its memory

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
    nodes: np.ndarray  # (n_cells, n_nodes) index into FileModel.points
    numbers: np.ndarray  # (n_cells,) numbers of the file


@dataclass
class Group:
    """A named set; a node may be named by itself or as a corner of a cell."""

    nodes: np.ndarray = field(default_factory=lambda: NO_NODES)  # named nodes, index into FileModel.points
    cells: dict[int, np.ndarray] = field(default_factory=dict)  # block of FileModel.cells: its named rows

    def add_nodes(self, nodes: np.ndarray) -> None:
        self.nodes = np.union1d(self.nodes, nodes)

    def add_cells(self, block: int, rows: np.ndarray) -> None:
        self.cells[block] = np.union1d(self.cells.get(block, NO_NODES), rows).astype(np.int64)


@dataclass(frozen=True)
class Equations:
    """Linear equations between displacements, sum of coefficient times displacement = 0; in each one term follows the others."""

    equation: np.ndarray  # (n_terms,) number of the equation, from 0, rising
    nodes: np.ndarray  # (n_terms,) index into FileModel.points; -1 - i: number i of ``points``
    axes: np.ndarray  # (n_terms,) 0, 1, 2: x, y, z; 3, 4, 5: rotations of points
    coefficients: np.ndarray  # (n_terms,)
    where: tuple[str, ...]  # where each equation stands in the file, for messages: "*EQUATION, line 12"
    is_support: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n_equations,) or none: in turned axes
    points: tuple[str, ...] = ()  # names of connected points that terms mean

    @property
    def n_supports(self) -> int:
        """How many of them are supports in turned axes."""
        return int(np.count_nonzero(self.is_support))

    def without_supports(self) -> Equations | None:
        """Return the others; None where there are none."""
        if not self.n_supports:
            return self
        equations = np.flatnonzero(~self.is_support)
        if not len(equations):
            return None
        is_other = np.isin(self.equation, equations)
        equation, where = np.searchsorted(equations, self.equation[is_other]), tuple(self.where[i] for i in equations)
        terms = self.nodes[is_other], self.axes[is_other], self.coefficients[is_other]
        return Equations(equation, *terms, where, points=self.points)


@dataclass(frozen=True, kw_only=True)
class LoadsAtRest:
    """What acts on the structure before it vibrates, and in the file's program stays."""

    word: str  # as the user would name it, and leave it out in [model] ignore
    step: int
    table: Statics = Statics.of_file()
    large: str = ""  # as the user would name large displacements, and leave them out; "": displacements are small
    axis: Vector = (0.0, 0.0, 0.0)  # of the rotation
    axis_point: Vector = (0.0, 0.0, 0.0)

    @property
    def acts(self) -> bool:
        """Whether there is any load of a kind that is taken over."""
        return bool(self.kinds)

    @property
    def kinds(self) -> list[str]:
        """What of each kind there is, in words."""
        names = ("forces", "pressures", "bolts", "temperatures", "displacements")
        counted = [f"{len(entries)} {name}" for name in names if (entries := getattr(self.table, name))]
        return counted + ["rotation"] * bool(self.table.rotation_speed)


@dataclass(frozen=True, kw_only=True)
class FileSectors:
    """The cyclic symmetric sector that a file states, in its own units; None where it does not say."""

    sectors: int | None = None
    axis: Vector | None = None
    axis_point: Vector | None = None
    faces: tuple[str, str] | None = None  # groups, the high one in the positive sense about the axis


@dataclass(frozen=True, kw_only=True)
class FileStep:
    """What a step of a file states, in words, and what of it is taken over."""

    number: int  # from 1; 0: the model itself, before the first step
    procedure: str  # "*STATIC", with the name of the step
    states: Mapping[str, str]  # of "supports", "loads" and "temperatures" those that it states
    taken: tuple[str, ...] = ()  # the parts that are taken over, of ``states``


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Something of the file that is not taken over."""

    word: str  # as the user would name it, and waive it in [model] ignore: "*CONTACT PAIR", "CELAS2", "CONM1"
    where: str  # "line 12", "bolts.inc, line 3"
    effect: str  # what it does, in the file's program: "two surfaces in contact", "output alone"
    changes: bool  # whether leaving it out changes the answer
    # what of the model it belongs to, "materials", "supports", ...: without effect where that is not taken over; "statics": where
    # the scene states what acts before the vibration
    part: str = ""
    surfaces: tuple[str, ...] = ()  # the groups that it connects: a joint or tie of the scene between them takes its place
    is_glued: bool = False  # whether the file holds them together as one, as a tie does


@dataclass(frozen=True)
class FileModel:
    """Points, cells and groups of a file in its own units, and what else it says of the structure.  Rank 0 only."""

    points: np.ndarray  # (n_points, 3) length
    numbers: np.ndarray  # (n_points,) node numbers of the file
    cells: tuple[Cells, ...]
    groups: dict[str, Group]
    notes: tuple[str, ...] = ()
    fields: dict[str, np.ndarray] = field(default_factory=dict)  # (n_points,) each: numbers at the nodes; NaN where it has none
    materials: Mapping[str, Material] = field(default_factory=dict)  # by name
    orientations: Mapping[str, Orientation] = field(default_factory=dict)  # by name
    bodies: Mapping[str, Body] = field(default_factory=dict)  # by name
    supports: tuple[Support, ...] = ()
    ties: tuple[Tie, ...] = ()
    joints: tuple[Joint, ...] = ()  # each with a finding between the same surfaces, for scenes that do not take it over
    connected: tuple[Point, ...] = ()  # points with six degrees of freedom
    masses: tuple[Mass, ...] = ()
    springs: tuple[Spring, ...] = ()
    equations: Equations | None = None
    bolts: tuple[Bolt, ...] = ()
    statics: LoadsAtRest | None = None
    cyclic: FileSectors | None = None
    steps: tuple[FileStep, ...] = ()  # the model itself first; none: the format has no steps, or the file none
    step: int = 0  # whose conditions are taken over; 0: the file has no steps
    findings: tuple[Finding, ...] = ()
    facts: tuple[str, ...] = ()  # what `microslip check` lists with it: the file's title, parts, instances, systems


def sectors_in_words(sectors: FileSectors) -> str:
    """Return what a scene has to state of a sector, for a message.  Local."""
    n, (low, high) = "..." if sectors.sectors is None else sectors.sectors, sectors.faces or ("LOW", "HIGH")
    if sectors.axis is None or sectors.axis_point is None:
        return f"state [cyclic] with sectors = {n}, its axis, faces and engine_order"
    axis, point = ([float(f"{value:.9g}") for value in values] for values in (sectors.axis, sectors.axis_point))
    return (
        f"state [cyclic] with sectors = {n}, axis = {axis}, axis_point = {point} (here in the file's unit of length, there in "
        f'm), faces = ["{low}", "{high}"] and engine_order'
    )


def names_of_tags(keys: set[tuple[int, int]]) -> dict[tuple[int, int], str]:
    """Name groups that have a dimension and a tag only: by the tag, with the dimension where the tag is not unique."""
    tags = [tag for _, tag in keys]
    word = ("point", "curve", "surface", "volume")
    return {(dim, tag): str(tag) if tags.count(tag) == 1 else f"{word[dim]} {tag}" for dim, tag in sorted(keys)}


def held_alike(held: np.ndarray) -> Iterator[tuple[tuple[int, ...], np.ndarray]]:
    """Yield which axes are held at some nodes, and the positions of the nodes, by what is held (n_points, 3).  Local."""
    code = held @ np.array([4, 2, 1])
    for pattern in np.unique(code[code > 0]):
        nodes = np.flatnonzero(code == pattern)
        yield tuple(int(axis) for axis in np.flatnonzero(held[nodes[0]])), nodes


def index_of(numbers: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of ``wanted`` in ``numbers`` and the numbers that are not there.  Local."""
    wanted = np.asarray(wanted)
    if len(numbers) == 0:
        return np.zeros(wanted.shape, dtype=np.int64), np.unique(wanted)
    low, high = int(numbers.min()), int(numbers.max())
    if (numbers[1:] > numbers[:-1]).all() and wanted.size < len(numbers):
        index = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
    elif high - low < _MOST_HOLES * len(numbers):
        index = _by_table(numbers, wanted, low, high)
    else:
        order = np.argsort(numbers, kind="stable")
        index = order[np.minimum(np.searchsorted(numbers, wanted, sorter=order), len(numbers) - 1)]
    is_missing = numbers[index] != wanted
    return index, np.unique(wanted[is_missing]) if is_missing.any() else NO_NODES


def _by_table(numbers: np.ndarray, wanted: np.ndarray, low: int, high: int) -> np.ndarray:
    """Return the positions of ``wanted``, any where there is none, from a table of all numbers from low to high."""
    table = np.zeros(high - low + 1, dtype=np.int64)
    table[numbers[::-1] - low] = np.arange(len(numbers))[::-1]  # the first one counts where a number stands twice
    with np.errstate(invalid="ignore"):  # numbers of a table of decimals may be none
        return table[np.clip(wanted.astype(np.int64), low, high) - low]
