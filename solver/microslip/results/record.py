"""The contents of a result file, as arrays: the same classes are written and read.  NumPy only.

n_pairs contact pairs, n_outputs outputs, N_H = 2 H + 1 coefficients (mean, cos 1, sin 1, ...).
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from ..contact.laws import ELASTIC_COULOMB
from ..fourier.coefficients import amplitude
from ..points.bifurcation import BIFURCATION_QUANTITIES, Bifurcation
from ..points.branch import CLOSES_TO, QUANTITIES, Branch
from ..points.error_parts import total
from ..points.peak import PEAK_QUANTITIES, Peak
from ..points.quantities import Quantity, axis_lengths, declared
from .measures import Shown, peak, shown_with
from .origin import Origin

if TYPE_CHECKING:
    from ..mesh.data import ContactPairs

COMPLETE, STOPPED, RUNNING = "complete", "failed", "running"


@dataclass(frozen=True)
class LinearCurve:
    """The response with all pairs stuck, per unit level."""

    frequency: np.ndarray  # (n_linear,) Hz
    response: np.ndarray  # (n_linear, n_outputs, N_H) m/N


@dataclass(frozen=True, eq=False)
class LevelResult:
    """The converged points of one level, in the order of the branch.

    Each quantity of :class:`~microslip.points.branch.Point` is an attribute by its name, an array (n, ...) of the shape and
    unit that is declared there: ``level.frequency``, ``level.response``, ``level.du``; None where it was not read or computed.
    """

    level: float  # N
    status: str  # COMPLETE, STOPPED, RUNNING
    failure: str  # why the curve ends early; "" otherwise
    arrays: dict[str, np.ndarray | None]
    unit: str = "N"  # of the level
    closes_to: float = CLOSES_TO  # of the energy balance, by the tolerance of its points
    peaks: tuple[Peak, ...] | None = None  # maxima of the outputs, each solved for; None where they are not
    bifurcations: tuple[Bifurcation, ...] | None = None  # where stability changes, and folds; None without multipliers

    @property
    def top(self) -> int:
        """The point with the largest amplitude of the first output; 0 where there is none."""
        return peak(self.response) or 0

    @property
    def text(self) -> str:
        """The level with its unit."""
        return f"{self.level:g} {self.unit}".removesuffix(" 1")

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["arrays"][name]
        except KeyError:
            raise AttributeError(f"a level has no {name!r}") from None


@dataclass(frozen=True, eq=False)
class PeaksOver:
    """One peak of an output over a number of the scene, in the order of its curve; n points."""

    key: str  # "level", "joints.NAME.friction", ...
    unit: str  # of the number
    linear: Peak  # with all pairs stuck, at the start of the range; amplitude per unit of the level
    value: np.ndarray  # (n,) the number
    damping: np.ndarray  # (n,) damping ratio of one mode with this amplitude per unit of the level
    points: LevelResult  # the peaks as points; ``level`` is 0 if the level is the number that varies

    @property
    def frequency(self) -> np.ndarray:
        """Of the peak, (n,) [Hz]."""
        return self.points.frequency

    @property
    def amplitude(self) -> np.ndarray:
        """Of harmonic 1 of the output, (n,) in its unit."""
        return amplitude(self.points.response[:, self.linear.output])

    @property
    def error(self) -> np.ndarray | None:
        """The error bar of the amplitude, (n,); None without error bars."""
        return None if self.points.error is None else total(self.points.error[:, self.linear.output])

    @property
    def per_level(self) -> np.ndarray:
        """The amplitude per unit of the level, (n,)."""
        return self.amplitude / (self.points.level or self.value)


@dataclass(frozen=True, eq=False)
class Wear:
    """The wear of a joint after n numbers of cycles."""

    law: str  # of wear
    output: str
    cycles: np.ndarray  # (n,)
    depth: np.ndarray  # (n, n_pairs) m
    N0: np.ndarray  # (n, n_pairs) N at rest; below 0 a gap of -N0 / k_n, NaN without a limit
    frequency: np.ndarray  # (n,) Hz
    amplitude: np.ndarray  # (n,) of harmonic 1 of the output, in its unit
    damping: np.ndarray  # (n,) -, NaN where the frequency stays

    @property
    def normal_force(self) -> np.ndarray:
        """At rest, (n, n_pairs) [N]."""
        return np.maximum(np.nan_to_num(self.N0), 0.0)


_OPEN = "1 where a pair is open at rest, without springs"
_FRAME = "rows x, y (tangential), z (from body 2 into body 1)"


@dataclass(frozen=True)
class Joint:
    """The contact pairs: mesh.data.ContactPairs with the node numbers of the user's file.  Declared as the fields of a Point."""

    names: tuple[str, ...]  # of the joints
    joint: Annotated[np.ndarray, Quantity("joint", "pairs", "index into names", "joint of each pair", "i8")]
    node1: Annotated[
        np.ndarray, Quantity("node1", "pairs", "number in the mesh file", "node of body 1; -1 is ground, or no mesh", "i8")
    ]
    node2: Annotated[
        np.ndarray, Quantity("node2", "pairs", "number in the mesh file", "node of body 2; -1 is ground, or no mesh", "i8")
    ]
    position: Annotated[np.ndarray, Quantity("position", "pairs directions", "m", "place of the pair; NaN where it is not known")]
    frame: Annotated[np.ndarray, Quantity("frame", "pairs directions directions", "1", _FRAME)]
    area: Annotated[np.ndarray, Quantity("area", "pairs", "m2", "tributary area; NaN where it is not known")]
    mu: Annotated[np.ndarray, Quantity("mu", "pairs", "1", "friction coefficient")]
    N0: Annotated[np.ndarray, Quantity("N0", "pairs", "N", "normal preload; below 0 a gap of -N0 / k_n")]
    k_t: Annotated[np.ndarray, Quantity("k_t", "pairs", "N/m", "tangential stiffness")]
    k_n: Annotated[np.ndarray, Quantity("k_n", "pairs", "N/m", "normal stiffness")]
    separate: Annotated[
        np.ndarray, Quantity("separate", "pairs", "1", "1 where the two tangential directions slip separately", "u1")
    ]
    T0: Annotated[np.ndarray, Quantity("T0", "pairs tangents", "N", "friction force at rest, against body 1", optional=True)]
    open_at_rest: Annotated[np.ndarray, Quantity("open_at_rest", "pairs", "1", _OPEN, "u1", optional=True, earlier="apart")]
    cells: Annotated[
        np.ndarray,
        Quantity(
            "cells", "pairs corners directions", "m", "corners of the area of a pair; NaN where faces have it", optional=True
        ),
    ]
    laws: Annotated[np.ndarray, Quantity("law", "pairs", "index into laws", "contact law of each pair", "i8", optional=True)]
    faces: tuple[np.ndarray, ...] = ()  # (n_faces, 3, 4, 6 or 8) indices of pairs
    law_names: tuple[str, ...] = (ELASTIC_COULOMB,)
    law_columns: Mapping[str, np.ndarray] = field(
        default_factory=dict
    )  # (n_pairs,) each: further columns of laws; NaN: not this law

    @property
    def n_pairs(self) -> int:
        """The number of pairs."""
        return len(self.mu)

    @property
    def has_areas(self) -> bool:
        """Whether the areas of all pairs are known."""
        return bool((np.isfinite(self.area) & (self.area > 0.0)).all())


JOINT_QUANTITIES = declared(Joint)


@dataclass(frozen=True, eq=False)
class StaticTable:
    """A table of the equilibrium at rest: rows with names, columns of ``STATIC_TABLES``."""

    names: tuple[str, ...]
    columns: Mapping[str, np.ndarray]  # (n_rows, width) each; (n_rows,) of single numbers


# unit and width of the columns of each table, width 0 of single numbers; six numbers are a force and its moment
STATIC_TABLES: dict[str, dict[str, tuple[str, int]]] = {
    "bolts": {"area": ("m2", 0), "shortening": ("m", 0), "tightened": ("N", 0), "force": ("N", 0)},  # before other loads; at rest
    "joints": {"about": ("m", 3), "on_first": ("N, N m", 6), "on_second": ("N, N m", 6)},
    "bodies": {"about": ("m", 3), "loads": ("N, N m", 6), "joints": ("N, N m", 6), "supports": ("N, N m", 6)},
}


@dataclass(frozen=True)
class ResultFile:
    """The contents of a results.h5."""

    path: str  # "" before it is written
    title: str
    name: str  # of the scene
    method: str
    scene_text: str
    options: tuple[str, ...]  # options after -- on the command line
    versions: dict[str, str]
    outputs: tuple[str, ...]
    mode_frequency: np.ndarray  # (n_modes,) Hz
    joint: Joint
    linear: LinearCurve | None
    levels: tuple[LevelResult, ...] = field(default_factory=tuple)
    units: tuple[str, ...] = ()  # of the outputs; none given: m
    level_unit: str = "N"
    n_dof: int = 0  # of the structure; 0: an earlier version wrote the file
    origin: Origin | None = None  # None: an earlier version wrote the file
    requested: tuple[float, ...] = ()  # levels of the scene [N]; empty: an earlier version wrote the file
    at_rest: Mapping[str, StaticTable] = field(default_factory=dict)  # by keys of ``STATIC_TABLES``; none without [statics]
    over: tuple[PeaksOver, ...] = ()  # peaks over numbers of the scene
    wear: Wear | None = None  # None: no study of wear has added it

    @property
    def cyclic(self) -> Mapping[str, Any]:
        """The table [cyclic] of the scene; empty without one."""
        try:
            return tomllib.loads(self.scene_text).get("cyclic", {})
        except tomllib.TOMLDecodeError:  # results of no scene file
            return {}

    @property
    def n_sectors(self) -> int:
        """The number of sectors whose pairs are in the results; 1 unless they are those of a whole disc."""
        return int(self.cyclic["sectors"]) if self.cyclic.get("whole") else 1

    @property
    def of_sector(self) -> str:
        """The end of a heading above quantities of the pairs, for a disc that is computed from one sector."""
        return f"; one of {self.cyclic['sectors']} sectors" if self.cyclic and self.n_sectors == 1 else ""

    @property
    def solved(self) -> list[LevelResult]:
        """The levels that have points, in their order."""
        return [level for level in self.levels if len(level.frequency)]

    @property
    def missing(self) -> tuple[float, ...]:
        """The levels of the run that are not complete [N]: it is running, or was stopped."""
        ended = {level.level for level in self.levels if level.status != RUNNING}
        return tuple(level for level in self.requested if level not in ended)

    @cached_property
    def shown(self) -> Shown:
        """The quantity shown of an output: the mean where outputs move, but at no point back and forth."""
        responses = [level.response for level in self.solved]
        moves = any(response[..., 1:].any() for response in responses) or not any(
            response[..., 0].any() for response in responses
        )
        return shown_with(int(moves), self.unit_of(0), self.level_unit)

    def of_output(self, k: int) -> ResultFile:
        """Return the results of one output alone, with their title and levels; arrays are views.  Local."""
        columns, linear = slice(k, k + 1), self.linear
        axes = {quantity.name: quantity.axes for quantity in QUANTITIES}

        def of_level(level: LevelResult) -> LevelResult:
            arrays = {name: a if a is None or "outputs" not in axes[name] else a[:, columns] for name, a in level.arrays.items()}
            peaks = [replace(peak, output=0) for peak in level.peaks or () if peak.output == k]
            bifurcations = [replace(each, amplitude=each.amplitude[columns]) for each in level.bifurcations or ()]
            return replace(
                level,
                arrays=arrays,
                peaks=None if level.peaks is None else tuple(peaks),
                bifurcations=None if level.bifurcations is None else tuple(bifurcations),
            )

        return replace(
            self,
            outputs=self.outputs[columns],
            units=self.units[columns],
            linear=None if linear is None else LinearCurve(linear.frequency, linear.response[:, columns]),
            levels=tuple(map(of_level, self.levels)),
        )

    def unit_of(self, output: int) -> str:
        """Return the unit of an output."""
        return self.units[output] if self.units else "m"


def joint_of(pairs: ContactPairs, node_numbers: np.ndarray | None = None) -> Joint:
    """Return the record of :class:`~microslip.mesh.data.ContactPairs`; ``node_numbers`` are the user's.  Local."""
    names = tuple(dict.fromkeys(pairs.joint))
    given = {quantity.field: getattr(pairs, quantity.field) for quantity in JOINT_QUANTITIES}
    index = np.array([names.index(name) for name in pairs.joint], dtype=np.int64)
    law_names, laws = np.unique(pairs.laws, return_inverse=True)
    nodes = {name: _numbers(given[name], node_numbers) for name in ("node1", "node2")}
    indices = {"joint": index, "laws": laws.ravel()}
    named = {"names": names, "law_names": tuple(map(str, law_names)) or (ELASTIC_COULOMB,)}
    return Joint(**given | nodes | indices | named | {"faces": tuple(pairs.faces), "law_columns": dict(pairs.law_columns)})


def _numbers(nodes: np.ndarray, node_numbers: np.ndarray | None) -> np.ndarray:
    nodes = np.asarray(nodes)
    return np.full(len(nodes), -1) if node_numbers is None else np.where(nodes < 0, -1, node_numbers[nodes])


def level_result(branch: Branch, sizes: tuple[int, int, int], status: str, unit: str = "N") -> LevelResult:
    """Return the record of a level's points; ``sizes`` = (n_outputs, n_pairs, N_H).  Local, on rank 0."""
    n_outputs, n_pairs, N_H = sizes
    N_H = max([N_H, *(point.response.shape[-1] for point in branch.points)])  # points may have more harmonics than others
    lengths = axis_lengths(n_outputs, n_pairs, N_H)
    arrays = {quantity.name: quantity.array(branch.points, lengths) for quantity in QUANTITIES}
    peaks = None if branch.peaks is None else tuple(branch.peaks)
    bifurcations = None if branch.bifurcations is None else tuple(branch.bifurcations)
    return LevelResult(branch.level, status, branch.failure or "", arrays, unit, branch.closes_to, peaks, bifurcations)


def bifurcation_arrays(bifurcations: Sequence[Bifurcation], n_outputs: int) -> dict[str, np.ndarray]:
    """Return the bifurcations of a level as arrays (n, ...) by the names of ``BIFURCATION_QUANTITIES``.  Local."""
    arrays = {}
    for quantity in BIFURCATION_QUANTITIES:
        values = np.array([quantity.of(bifurcation) for bifurcation in bifurcations], dtype=quantity.kind)
        arrays[quantity.dataset] = values.reshape(len(bifurcations), *quantity.shape({"outputs": n_outputs}))
    return arrays


def peak_arrays(peaks: Sequence[Peak]) -> dict[str, np.ndarray]:
    """Return the peaks of a level as arrays (n_peaks, ...) by the names of ``PEAK_QUANTITIES`` that all peaks have.

    Local.
    """
    known = [quantity for quantity in PEAK_QUANTITIES if not quantity.axes or (peaks and _have(peaks, quantity))]
    return {quantity.dataset: np.array([quantity.of(peak) for peak in peaks], dtype=quantity.kind) for quantity in known}


def _have(peaks: Sequence[Peak], quantity: Quantity) -> bool:
    return all(quantity.of(peak) is not None for peak in peaks)
