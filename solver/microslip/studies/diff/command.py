"""The command `diff`: compare inputs, structure and every level of two results; one verdict."""

from dataclasses import dataclass

import numpy as np

from ...messages.errors import CaseError
from ...results.measures import Shown
from ...results.read import read_results
from ...results.record import COMPLETE, Joint, LevelResult, ResultFile
from .compared_inputs import Change, facts_changed, inputs_changed, keys_changed
from .compared_levels import LevelDifference, compare_level

TOLERANCE = 1e-6  # relative to the peak, beyond the resolution of the points
_OF_ACCURACY = 0.1  # fraction of an accuracy for the solver's error, if the accuracy chose the tolerance
_LEVEL = 1e-9  # relative difference of equal levels
_OF_PAIRS = ("mu", "N0", "k_t", "k_n", "area")


@dataclass(frozen=True)
class StructureDifference:
    """Differences of the structures of two results."""

    n_dof: tuple[int, int]  # 0: unknown
    n_pairs: tuple[int, int]
    joints: tuple[tuple[str, ...], tuple[str, ...]]
    same_pairs: bool  # equal number, nodes and joints
    pairs: dict[str, float]  # largest difference of each quantity over its largest value in A, for the same pairs
    n_modes: tuple[int, int]
    modes: float  # largest relative difference of the natural frequencies in both
    mode: int  # its number, from 1


@dataclass(frozen=True)
class Difference:
    """The comparison of two results, A and B."""

    a: ResultFile
    b: ResultFile
    tolerance: float | None  # requested; None: by ``bound``, plus the resolution of the points
    bars: bool  # whether differences inside the error bars are ignored
    keys: list[Change]
    facts: list[Change]
    inputs: list[Change] | None  # None: a result does not list its input files
    structure: StructureDifference
    levels: tuple[LevelDifference, ...]
    only: tuple[tuple[str, ...], tuple[str, ...]]  # levels and outputs in only one of them

    @property
    def shown(self) -> Shown:
        """The number shown of an output, as in A."""
        return self.a.shown

    def of_level(self, level: LevelDifference) -> tuple[LevelResult, LevelResult]:
        """Return the results of A and B at a level."""
        return next(pair for pair in _levels(self.a, self.b)[0] if pair[0].level == level.level)

    @property
    def incomplete(self) -> tuple[str, ...]:
        """Return which results have levels that ended early or were not finished when the file was written."""
        return tuple(
            name for name, results in (("A", self.a), ("B", self.b)) if any(level.status != COMPLETE for level in results.levels)
        )

    def is_level_same(self, level: LevelDifference) -> bool:
        """Return whether the curves of a level are the same in their common range."""
        if min(level.n_points) == 0:
            return max(level.n_points) == 0
        if self.bars and level.inside_bars:
            return True
        return (level.difference if self.tolerance is not None else level.beyond) <= self.bound(level)

    def bound(self, level: LevelDifference) -> float:
        """Return the accepted difference of the curves of a level, relative to the peak."""
        return max(TOLERANCE, _OF_ACCURACY * level.closes_to) if self.tolerance is None else self.tolerance

    @property
    def is_same(self) -> bool:
        """Return whether both have the same levels, outputs, ranges and curves."""
        whole = all(level.is_whole or level.status[0] == level.status[1] and level.ends is None for level in self.levels)
        return bool(self.levels) and whole and not any(self.only) and all(map(self.is_level_same, self.levels))


def diff(path_a: str, path_b: str, tolerance: float | None = None, bars: bool = False) -> Difference:
    """Return the difference of two result files.  Local; no MPI, no PETSc.  Raises CaseError: a file cannot be read."""
    return compared(read_results(path_a, motion=False), read_results(path_b, motion=False), tolerance, bars)


def compared(a: ResultFile, b: ResultFile, tolerance: float | None = None, bars: bool = False) -> Difference:
    """Return the difference of two results.  Local."""
    if a.shown.is_static != b.shown.is_static and all(
        any(len(level.frequency) for level in results.levels) for results in (a, b)
    ):
        raise CaseError(f"{a.path} and {b.path}: one of them is a static result, the other a vibration")
    structure = _structure(a, b)
    outputs, only_outputs = _outputs(a, b)
    pairs, only_levels = _levels(a, b)
    levels = tuple(compare_level(results, other, outputs, structure.same_pairs, a.shown) for results, other in pairs)
    only = [(*levels_of, *outputs_of) for levels_of, outputs_of in zip(only_levels, only_outputs)]
    requested = keys_changed(a, b), facts_changed(a, b), inputs_changed(a, b)
    return Difference(a, b, tolerance, bars, *requested, structure, levels, (only[0], only[1]))


def _outputs(a: ResultFile, b: ResultFile) -> tuple[list[tuple[str, str, int, int]], tuple[list[str], list[str]]]:
    """Return name, unit and numbers of the common outputs, and the names of the others."""
    of_a, of_b = ({(name, results.unit_of(k)): k for k, name in enumerate(results.outputs)} for results in (a, b))
    both = [(name, unit, k, of_b[name, unit]) for (name, unit), k in of_a.items() if (name, unit) in of_b]
    only = tuple(
        [f'output "{name}" in {unit}' for name, unit in results if (name, unit) not in other]
        for results, other in ((of_a, of_b), (of_b, of_a))
    )
    return both, only  # type: ignore[return-value]


def _levels(a: ResultFile, b: ResultFile) -> tuple[list[tuple[LevelResult, LevelResult]], tuple[list[str], list[str]]]:
    """Return the common levels in the order of A, and the others as texts."""
    left, pairs, only_a = list(b.levels), [], []
    for level in a.levels:
        near = [other for other in left if abs(other.level - level.level) <= _LEVEL * abs(level.level)]
        if near and a.level_unit == b.level_unit:
            pairs.append((level, near[0]))
            left = [other for other in left if other is not near[0]]
        else:
            only_a.append(f"level {level.level:g} {a.level_unit}")
    return pairs, (only_a, [f"level {level.level:g} {b.level_unit}" for level in left])


def _structure(a: ResultFile, b: ResultFile) -> StructureDifference:
    n = min(len(a.mode_frequency), len(b.mode_frequency))
    first, second = a.mode_frequency[:n], b.mode_frequency[:n]
    difference = np.abs(second - first) / np.where(first > 0.0, first, 1.0)
    same = _same_pairs(a.joint, b.joint)
    return StructureDifference(
        n_dof=(a.n_dof, b.n_dof),
        n_pairs=(a.joint.n_pairs, b.joint.n_pairs),
        joints=(a.joint.names, b.joint.names),
        same_pairs=same,
        pairs={name: _largest_difference(getattr(a.joint, name), getattr(b.joint, name)) for name in _OF_PAIRS} if same else {},
        n_modes=(len(a.mode_frequency), len(b.mode_frequency)),
        modes=float(difference.max(initial=0.0)),
        mode=int(np.argmax(difference)) + 1 if n else 0,
    )


def _same_pairs(a: Joint, b: Joint) -> bool:
    """Return whether two joints have the same number of pairs at the same positions."""
    if a.n_pairs != b.n_pairs or a.names != b.names or not np.array_equal(a.joint, b.joint):
        return False
    same_nodes = np.array_equal(a.node1, b.node1) and np.array_equal(a.node2, b.node2)
    size = float(np.ptp(a.position[np.isfinite(a.position)])) if np.isfinite(a.position).any() else 0.0
    return same_nodes and np.allclose(a.position, b.position, rtol=0.0, atol=1e-6 * size, equal_nan=True)


def _largest_difference(a: np.ndarray, b: np.ndarray) -> float:
    """Return the largest difference over the largest value of A; infinite where only one is known."""
    if not np.array_equal(np.isnan(a), np.isnan(b)):
        return float("inf")
    difference, size = np.nan_to_num(np.abs(b - a)).max(initial=0.0), np.nan_to_num(np.abs(a)).max(initial=0.0)
    return float(difference / size) if size > 0.0 else float(difference > 0.0)
