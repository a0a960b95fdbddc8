"""The content of a model file in the common form of all readers, before the scene selects from it.

A reader takes over the entries that it understands, in the file's own units, and reports every other entry as a ``Finding``:
nothing is ignored silently.  ``library/complete.py`` makes a scene from a ``FileModel``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..messages.words import counted
from ..tables.constant_loads import Bolt, Statics
from ..tables.joint import Joint
from ..tables.structure import Body, Mass, Material, Orientation, Point, Spring, Support, Tie
from ..tables.table import Vector

NO_NODES = np.empty(0, dtype=np.int64)
_MOST_HOLES = 8  # unused numbers per used one up to which a table of all numbers is made

_DIMENSIONS = {"point": 0, "line": 1, "tri": 2, "quad": 2, "tet": 3, "hex": 3, "wedge": 3, "pyramid": 3}
_SIZES = (
    "point line2 line3 tri3 tri6 quad4 quad8 quad9 tet4 tet10 hex8 hex20 hex27 wedge6 wedge15 wedge18 "
    "pyramid5 pyramid13 pyramid14"
)
# Kinds of cells in a file, by this program's names: dimension and number of nodes.
KINDS = {shape + size: (_DIMENSIONS[shape], int(size or 1)) for shape, size in re.findall(r"([a-z]+)(\d*)", _SIZES)}


@dataclass(frozen=True)
class Cells:
    """Cells of one kind, nodes in VTK order."""

    kind: str  # a key of KINDS, or the reader's word for another kind
    nodes: np.ndarray  # (n_cells, n_nodes) index into FileModel.points
    numbers: np.ndarray  # (n_cells,) element numbers of the file


@dataclass
class Group:
    """A named set of nodes and cells."""

    nodes: np.ndarray = field(default_factory=lambda: NO_NODES)  # named nodes, index into FileModel.points
    cells: dict[int, np.ndarray] = field(default_factory=dict)  # block of FileModel.cells: rows in the set

    def add_nodes(self, nodes: np.ndarray) -> None:
        """Add nodes, by their index into FileModel.points.  Local."""
        self.nodes = np.union1d(self.nodes, nodes)

    def add_cells(self, block: int, rows: np.ndarray) -> None:
        """Add rows of a block of FileModel.cells.  Local."""
        self.cells[block] = np.union1d(self.cells.get(block, NO_NODES), rows).astype(np.int64)

    def add_elements(self, cells: Sequence[Cells], numbers: np.ndarray) -> None:
        """Add the cells of elements of these numbers."""
        for i, block in enumerate(cells):
            rows = np.flatnonzero(np.isin(block.numbers, numbers))
            if len(rows):
                self.add_cells(i, rows)


@dataclass(frozen=True)
class Equations:
    """Linear equations between displacements, sum of coefficient times displacement = 0; each determines one displacement."""

    equation: np.ndarray  # (n_terms,) number of the equation, from 0, ascending
    nodes: np.ndarray  # (n_terms,) index into FileModel.points; -1 - i: number i of ``points``
    axes: np.ndarray  # (n_terms,) 0, 1, 2: x, y, z; 3, 4, 5: rotations of points
    coefficients: np.ndarray  # (n_terms,)
    where: tuple[str, ...]  # place of each equation in the file, for messages: "*EQUATION, line 12"
    is_support: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n_equations,) or empty: in turned axes
    points: tuple[str, ...] = ()  # names of the connected points in terms

    @property
    def n_supports(self) -> int:
        """Number of equations that are supports in turned axes."""
        return int(np.count_nonzero(self.is_support))

    def without_supports(self) -> Equations | None:
        """Return the equations that are not supports, or None if there are none."""
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
    """Loads that act on the structure before it vibrates and remain constant in the file's program."""

    word: str  # name for the user, also in [model] ignore
    step: int
    table: Statics = Statics.of_file()
    large: str = ""  # name of the option of large displacements, also in [model] ignore; "": small displacements
    axis: Vector = (0.0, 0.0, 0.0)  # axis of the rotation
    axis_point: Vector = (0.0, 0.0, 0.0)

    @property
    def acts(self) -> bool:
        """Whether there is a load of a kind that is taken over."""
        return bool(self.kinds)

    @property
    def kinds(self) -> list[str]:
        """Return a text for each kind of load that is present."""
        names = ("forces", "pressures", "bolts", "temperatures", "displacements")
        present = [counted(len(entries), name[:-1]) for name in names if (entries := getattr(self.table, name))]
        return present + ["rotation"] * bool(self.table.rotation_speed)


@dataclass(frozen=True, kw_only=True)
class FileSectors:
    """The sector of a cyclic structure as its file states it, in the file's units; None for values that the file lacks."""

    sectors: int | None = None
    axis: Vector | None = None
    axis_point: Vector | None = None
    faces: tuple[str, str] | None = None  # groups (low, high); high in the positive sense about the axis


@dataclass(frozen=True, kw_only=True)
class FileStep:
    """The conditions that a step of a file states, as text, and those that are taken over."""

    number: int  # from 1; 0: the model itself, before the first step
    procedure: str  # "*STATIC", with the name of the step
    states: Mapping[str, str]  # text of each of "supports", "loads" and "temperatures" that the step states
    taken: tuple[str, ...] = ()  # keys of ``states`` that are taken over


@dataclass(frozen=True, kw_only=True)
class Finding:
    """An entry of the file that is not taken over, or not as its program does."""

    word: str  # name for the user, also in [model] ignore: "*CONTACT PAIR", "CELAS2", "CONM1"
    where: str  # "line 12", "bolts.inc, line 3"
    effect: str  # its effect in the file's program: "two surfaces in contact", "output alone"
    changes: bool  # whether leaving it out changes the answer
    # part of the model: "materials", "supports", ...; the finding has no effect if that part is not taken over; "statics": no
    # effect if the scene states the loads at rest
    part: str = ""
    surfaces: tuple[str, ...] = ()  # groups that the entry connects: a joint or tie of the scene between them replaces it
    is_glued: bool = False  # whether the entry is a tie of the groups
    is_taken: bool = False  # whether it is taken over all the same, where its program would leave it out


@dataclass(frozen=True)
class FileModel:
    """Points, cells, groups and all other data of the structure in a file, in the file's units.  Rank 0 only."""

    points: np.ndarray  # (n_points, 3) length
    numbers: np.ndarray  # (n_points,) node numbers of the file
    cells: tuple[Cells, ...]
    groups: dict[str, Group]
    notes: tuple[str, ...] = ()
    fields: dict[str, np.ndarray] = field(default_factory=dict)  # (n_points,) each: values at the nodes, or NaN
    materials: Mapping[str, Material] = field(default_factory=dict)  # by name
    orientations: Mapping[str, Orientation] = field(default_factory=dict)  # by name
    bodies: Mapping[str, Body] = field(default_factory=dict)  # by name
    supports: tuple[Support, ...] = ()
    ties: tuple[Tie, ...] = ()
    joints: tuple[Joint, ...] = ()  # each also has a finding between the same surfaces, for scenes that do not take over joints
    connected: tuple[Point, ...] = ()  # points with six degrees of freedom
    masses: tuple[Mass, ...] = ()
    springs: tuple[Spring, ...] = ()
    equations: Equations | None = None
    bolts: tuple[Bolt, ...] = ()
    statics: LoadsAtRest | None = None
    cyclic: FileSectors | None = None
    steps: tuple[FileStep, ...] = ()  # the model itself first; empty: the format or the file has no steps
    step: int = 0  # step whose conditions are taken over; 0: the file has no steps
    findings: tuple[Finding, ...] = ()
    facts: tuple[str, ...] = ()  # listed by `microslip check`: the file's title, parts, instances, systems


def sectors_in_words(sectors: FileSectors) -> str:
    """Return the text of a message with the keys of [cyclic] that the scene needs.  Local."""
    n, (low, high) = "..." if sectors.sectors is None else sectors.sectors, sectors.faces or ("LOW", "HIGH")
    if sectors.axis is None or sectors.axis_point is None:
        return f"state [cyclic] with sectors = {n}, its axis, faces and engine_order"
    axis, point = ([float(f"{value:.9g}") for value in values] for values in (sectors.axis, sectors.axis_point))
    return (
        f"state [cyclic] with sectors = {n}, axis = {axis}, axis_point = {point} (here in the file's unit of length, there in "
        f'm), faces = ["{low}", "{high}"] and engine_order'
    )


def names_of_tags(keys: set[tuple[int, int]]) -> dict[tuple[int, int], str]:
    """Return names of groups that have only a dimension and a tag: the tag, with the dimension if the tag is not unique."""
    tags = [tag for _, tag in keys]
    word = ("point", "curve", "surface", "volume")
    return {(dim, tag): str(tag) if tags.count(tag) == 1 else f"{word[dim]} {tag}" for dim, tag in sorted(keys)}


def family_of(kind: str) -> str:
    """Return a kind of cells without its number of nodes: "hex" of "hex20".  Local."""
    return kind.rstrip("0123456789")


def fixed_alike(fixed: np.ndarray) -> Iterator[tuple[tuple[int, ...], np.ndarray]]:
    """Yield each combination of held axes and the positions of its nodes, from ``fixed`` (n_points, 3).  Local."""
    code = fixed @ np.array([4, 2, 1])
    for pattern in np.unique(code[code > 0]):
        nodes = np.flatnonzero(code == pattern)
        yield tuple(int(axis) for axis in np.flatnonzero(fixed[nodes[0]])), nodes


def index_of(numbers: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of ``wanted`` in ``numbers``, and the wanted numbers that are missing.  Local."""
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
    """Return the positions of ``wanted``, arbitrary for missing numbers, from a table of all numbers from low to high."""
    table = np.zeros(high - low + 1, dtype=np.int64)
    table[numbers[::-1] - low] = np.arange(len(numbers))[::-1]  # the first position of a repeated number
    with np.errstate(invalid="ignore"):  # decimals may be NaN
        return table[np.clip(wanted.astype(np.int64), low, high) - low]
