"""What a model file holds, before the scene says what is used of it: the common form of all readers.

A reader takes over what it understands, in the file's own units, and reports everything else as a ``Finding``: what it does
not understand is never left out in silence.  ``library/complete.py`` makes a scene of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

Vector = tuple[float, float, float]
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


@dataclass(frozen=True, kw_only=True)
class FileMaterial:
    """A linear elastic material in units of the file, keys as in a scene; None: the file does not say."""

    young: float | Vector | None = None  # three along its axes
    poisson: float | Vector | None = None
    shear: Vector | None = None
    elasticity: tuple[tuple[float, ...], ...] | None = None  # (6, 6) in its axes
    density: float | None = None
    expansion: float | Vector | None = None

    @property
    def has_axes(self) -> bool:
        """Whether it differs by direction."""
        return self.elasticity is not None or isinstance(self.young, tuple)

    @property
    def lacking(self) -> list[str]:
        """The keys that a scene needs beside those that are stated."""
        needed = ("density",) if self.elasticity is not None else ("young", "poisson", "density")
        return [key for key in needed if getattr(self, key) is None]

    @property
    def modulus(self) -> float | None:
        """The largest Young's modulus, or stress of a unit strain."""
        if self.elasticity is not None:
            return max(map(max, self.elasticity))
        return max(self.young) if isinstance(self.young, tuple) else self.young

    def with_axes(self) -> FileMaterial:
        """Return a material whose expansion alone differs by direction as one that has axes; any other as it is."""
        E, nu = self.young, self.poisson
        if not isinstance(self.expansion, tuple) or not isinstance(E, float) or not isinstance(nu, float):
            return self
        return replace(self, young=(E, E, E), poisson=(nu, nu, nu), shear=(0.5 * E / (1.0 + nu),) * 3)


@dataclass(frozen=True, kw_only=True)
class FileOrientation:
    """The axes of a material: two directions that span its first two, or the third, around which the first is radial."""

    directions: tuple[Vector, Vector] | None = None
    axis: Vector | None = None
    axis_point: Vector | None = None  # length


@dataclass(frozen=True, kw_only=True)
class FileBody:
    """A group of volume elements and what they are made of."""

    group: str
    material: str  # a key of FileModel.materials
    orientation: str | None = None  # a key of FileModel.orientations, of a material that has axes
    integration: str = "full"  # "full", "reduced", "reduced-both"
    incompatible_modes: bool = True  # in 8-node hexahedra


@dataclass(frozen=True, kw_only=True)
class FileSupport:
    """A group of nodes, or a point, that is held in model axes; in others it is among the ``Equations``."""

    group: str | None = None
    point: str | None = None
    fix: tuple[str, ...]  # of "x", "y", "z"; of a point "rx", "ry", "rz", too


@dataclass(frozen=True, kw_only=True)
class FileTie:
    """Two groups of faces glued: the nodes of the first follow the facets of the second."""

    surfaces: tuple[str, str]
    name: str | None = None
    tolerance: float | None = None  # length


@dataclass(frozen=True, kw_only=True)
class FileJoint:
    """Two groups of faces in contact with friction; None: the file does not say."""

    name: str
    surfaces: tuple[str, str]  # the first is the one whose points press on the second
    pairing: str = "auto"  # as in a scene
    friction: float | None = None
    tangential_stiffness: float | None = None  # force a volume
    normal_stiffness: float | None = None
    touches_within: float | None = None  # length: surfaces that are no farther apart touch; None: the gap is that of the mesh
    is_complete: bool  # whether it says all that makes a joint under constant loads


@dataclass(frozen=True, kw_only=True)
class FilePoint:
    """A point with six degrees of freedom, connected to a group of nodes."""

    name: str
    position: Vector
    group: str
    connection: str = "rigid"  # or "distributing"
    weights: str = "area"  # of a distributing one, or "equal"
    mass: float = 0.0
    inertia: tuple[float, ...] | None = None  # about the point: xx, yy, zz and maybe xy, yz, zx
    stiffness: Vector | None = None  # force a length, springs to ground
    rotational_stiffness: Vector | None = None  # moment a radian


@dataclass(frozen=True, kw_only=True)
class FileMass:
    """A point mass at each node of a group."""

    group: str
    mass: float


@dataclass(frozen=True, kw_only=True)
class FileSpring:
    """A spring or damper along a direction: of each node of one group to ground, or between the single nodes of two groups."""

    groups: tuple[str, ...]
    direction: Vector | None = None  # None: along the line between the two nodes
    stiffness: float = 0.0  # force a length
    damping: float = 0.0  # force a velocity


@dataclass(frozen=True)
class Equations:
    """Linear equations between displacements, sum of coefficient times displacement = 0; in each one term follows the others."""

    equation: np.ndarray  # (n_terms,) number of the equation, from 0, rising
    nodes: np.ndarray  # (n_terms,) index into FileModel.points
    axes: np.ndarray  # (n_terms,) 0, 1, 2: x, y, z
    coefficients: np.ndarray  # (n_terms,)
    where: tuple[str, ...]  # where each equation stands in the file, for messages: "*EQUATION, line 12"
    is_support: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n_equations,) or none: in turned axes

    @property
    def n_supports(self) -> int:
        """How many of them are supports in turned axes."""
        return int(np.count_nonzero(self.is_support))

    def without_supports(self) -> Equations | None:
        """Return the others; None where there are none."""
        if not self.n_supports:
            return self
        kept = np.flatnonzero(~self.is_support)
        own = np.isin(self.equation, kept)
        where = tuple(self.where[i] for i in kept)
        equation = np.searchsorted(kept, self.equation[own])
        return Equations(equation, self.nodes[own], self.axes[own], self.coefficients[own], where) if len(kept) else None


@dataclass(frozen=True, kw_only=True)
class FileBolt:
    """A cut through a shank, to be tightened."""

    name: str
    group: str  # faces of the cut
    force: float | None = None  # to which the file tightens it


@dataclass(frozen=True, kw_only=True)
class FileForce:
    """A constant force, shared by the nodes of a group, or on a point."""

    group: str | None = None
    point: str | None = None
    force: Vector


@dataclass(frozen=True, kw_only=True)
class FileStatics:
    """What acts on the structure before it vibrates, and in the file's program stays."""

    word: str  # as the user would name it, and leave it out in [model] ignore
    step: int
    forces: tuple[FileForce, ...] = ()
    pressures: tuple[tuple[str, float], ...] = ()  # group of faces, force an area
    bolts: tuple[tuple[str, str, float], ...] = ()  # name, group of faces of the cut, force
    temperatures: tuple[tuple[str, float], ...] = ()  # group of a body, by how much it is warmer than without stress
    displacements: tuple[tuple[str, Vector], ...] = ()  # group of supported nodes, by which they are moved
    large: str = ""  # as the user would name large displacements, and leave them out; "": displacements are small
    speed: float = 0.0  # radians a time
    axis: Vector = (0.0, 0.0, 0.0)
    axis_point: Vector = (0.0, 0.0, 0.0)

    @property
    def acts(self) -> bool:
        """Whether there is any load of a kind that is taken over."""
        return bool(self.kinds)

    @property
    def kinds(self) -> list[str]:
        """What of each kind there is, in words."""
        names = ("forces", "pressures", "bolts", "temperatures", "displacements")
        counted = [f"{len(own)} {name}" for name in names if (own := getattr(self, name))]
        return counted + ["rotation"] * bool(self.speed)


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
    materials: Mapping[str, FileMaterial] = field(default_factory=dict)  # by name
    orientations: Mapping[str, FileOrientation] = field(default_factory=dict)  # by name
    bodies: Mapping[str, FileBody] = field(default_factory=dict)  # by name
    supports: tuple[FileSupport, ...] = ()
    ties: tuple[FileTie, ...] = ()
    joints: tuple[FileJoint, ...] = ()  # each with a finding between the same surfaces, for scenes that do not take it over
    connected: tuple[FilePoint, ...] = ()  # points with six degrees of freedom
    masses: tuple[FileMass, ...] = ()
    springs: tuple[FileSpring, ...] = ()
    equations: Equations | None = None
    bolts: tuple[FileBolt, ...] = ()
    statics: FileStatics | None = None
    findings: tuple[Finding, ...] = ()
    facts: tuple[str, ...] = ()  # what `microslip check` lists beside this: the file's title, parts, instances, systems


def names_of_tags(keys: set[tuple[int, int]]) -> dict[tuple[int, int], str]:
    """Name groups that have a dimension and a tag only: by the tag, with the dimension where the tag is not unique."""
    tags = [tag for _, tag in keys]
    word = ("point", "curve", "surface", "volume")
    return {(dim, tag): str(tag) if tags.count(tag) == 1 else f"{word[dim]} {tag}" for dim, tag in sorted(keys)}


def held_alike(held: np.ndarray) -> Iterator[tuple[tuple[int, ...], np.ndarray]]:
    """Yield which axes are held at some nodes, and the positions of the nodes, by what is held (n_points, 3).  Local."""
    code = held @ np.array([4, 2, 1])
    for one in np.unique(code[code > 0]):
        nodes = np.flatnonzero(code == one)
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
