"""Two results compared as a user would: what was asked for, the structure, every level; one verdict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...messages.errors import CaseError
from ...results.measures import Shown
from ...results.read import read_results
from ...results.record import COMPLETE, Joint, LevelResult, ResultFile
from .compared_inputs import Change, facts_changed, inputs_changed, keys_changed
from .compared_levels import LevelDifference, compare_level

TOLERANCE = 1e-6  # of the peak, beyond what the points resolve
_OF_ACCURACY = 0.1  # the share of an accuracy that is the solver's, where that chose how exactly the points were solved
_LEVEL = 1e-9  # relative, within which two levels are one
_OF_PAIRS = ("mu", "N0", "k_t", "k_n", "area")


@dataclass(frozen=True)
class StructureDifference:
    """What two results say of the structure."""

    n_dof: tuple[int, int]  # 0: not known
    n_pairs: tuple[int, int]
    joints: tuple[tuple[str, ...], tuple[str, ...]]
    same_pairs: bool  # as many, between the same nodes, of the same joints
    pairs: dict[str, float]  # the largest difference of their numbers over the largest of A, where they are the same pairs
    n_modes: tuple[int, int]
    modes: float  # the largest relative difference of a natural frequency of those that both have
    mode: int  # which, from 1


@dataclass(frozen=True)
class Difference:
    """Two results, A and B, compared."""

    a: ResultFile
    b: ResultFile
    tolerance: float | None  # as asked for; None: as ``bound`` says, and what the points resolve
    bars: bool  # whether a difference inside the error bars counts as none
    keys: list[Change]
    facts: list[Change]
    inputs: list[Change] | None  # None: a file does not say what was read
    structure: StructureDifference
    levels: tuple[LevelDifference, ...]
    only: tuple[tuple[str, ...], tuple[str, ...]]  # levels and outputs that one of them has alone

    @property
    def shown(self) -> Shown:
        return self.a.shown

    def of_level(self, level: LevelDifference) -> tuple[LevelResult, LevelResult]:
        """Return a level as A and B have it."""
        return next(pair for pair in _levels(self.a, self.b)[0] if pair[0].level == level.level)

    @property
    def incomplete(self) -> tuple[str, ...]:
        """Return which results have levels that ended early, or that were at work when the file was written."""
        return tuple(
            name for name, results in (("A", self.a), ("B", self.b)) if any(level.status != COMPLETE for level in results.levels)
        )

    def is_level_same(self, level: LevelDifference) -> bool:
        """Tell whether the curves of a level are the same where both are."""
        if min(level.n_points) == 0:
            return max(level.n_points) == 0
        if self.bars and level.inside_bars:
            return True
        return (level.difference if self.tolerance is not None else level.beyond) <= self.bound(level)

    def bound(self, level: LevelDifference) -> float:
        """Return the difference over the peak up to which the curves of a level are the same."""
        return max(TOLERANCE, _OF_ACCURACY * level.closes_to) if self.tolerance is None else self.tolerance

    @property
    def is_same(self) -> bool:
        """Tell whether both hold the same levels and outputs, as far, and the same curves."""
        whole = all(level.is_whole or level.status[0] == level.status[1] and level.ends is None for level in self.levels)
        return bool(self.levels) and whole and not any(self.only) and all(map(self.is_level_same, self.levels))


def diff(path_a: str, path_b: str, tolerance: float | None = None, bars: bool = False) -> Difference:
    """Return how two result files differ.  Local; no MPI, no PETSc.

    Raises
    ------
    CaseError : a file cannot be read
    """
    return compared(read_results(path_a, motion=False), read_results(path_b, motion=False), tolerance, bars)


def compared(a: ResultFile, b: ResultFile, tolerance: float | None = None, bars: bool = False) -> Difference:
    """Return how two results differ.  Local."""
    if a.shown.is_static != b.shown.is_static and all(
        any(len(level.frequency) for level in results.levels) for results in (a, b)
    ):
        raise CaseError(f"{a.path} and {b.path}: one of them is of statics alone, and the other of vibration")
    structure = _structure(a, b)
    outputs, only_outputs = _outputs(a, b)
    pairs, only_levels = _levels(a, b)
    levels = tuple(compare_level(results, other, outputs, structure.same_pairs, a.shown) for results, other in pairs)
    only = [(*levels_of, *outputs_of) for levels_of, outputs_of in zip(only_levels, only_outputs)]
    requested = keys_changed(a, b), facts_changed(a, b), inputs_changed(a, b)
    return Difference(a, b, tolerance, bars, *requested, structure, levels, (only[0], only[1]))


def _outputs(a: ResultFile, b: ResultFile) -> tuple[list[tuple[str, str, int, int]], tuple[list[str], list[str]]]:
    """Return name, unit and numbers of the outputs that both have, and the names of the others."""
    of_a, of_b = ({(name, results.unit_of(k)): k for k, name in enumerate(results.outputs)} for results in (a, b))
    both = [(name, unit, k, of_b[name, unit]) for (name, unit), k in of_a.items() if (name, unit) in of_b]
    only = tuple(
        [f'output "{name}" in {unit}' for name, unit in results if (name, unit) not in other]
        for results, other in ((of_a, of_b), (of_b, of_a))
    )
    return both, only  # type: ignore[return-value]


def _levels(a: ResultFile, b: ResultFile) -> tuple[list[tuple[LevelResult, LevelResult]], tuple[list[str], list[str]]]:
    """Return the levels that both have, in the order of A, and the others as texts."""
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
    apart = np.abs(second - first) / np.where(first > 0.0, first, 1.0)
    same = _same_pairs(a.joint, b.joint)
    return StructureDifference(
        n_dof=(a.n_dof, b.n_dof),
        n_pairs=(a.joint.n_pairs, b.joint.n_pairs),
        joints=(a.joint.names, b.joint.names),
        same_pairs=same,
        pairs={name: _apart(getattr(a.joint, name), getattr(b.joint, name)) for name in _OF_PAIRS} if same else {},
        n_modes=(len(a.mode_frequency), len(b.mode_frequency)),
        modes=float(apart.max(initial=0.0)),
        mode=int(np.argmax(apart)) + 1 if n else 0,
    )


def _same_pairs(a: Joint, b: Joint) -> bool:
    """Tell whether two joints have as many pairs, in the same places."""
    if a.n_pairs != b.n_pairs or a.names != b.names or not np.array_equal(a.joint, b.joint):
        return False
    same_nodes = np.array_equal(a.node1, b.node1) and np.array_equal(a.node2, b.node2)
    size = float(np.ptp(a.position[np.isfinite(a.position)])) if np.isfinite(a.position).any() else 0.0
    return same_nodes and np.allclose(a.position, b.position, rtol=0.0, atol=1e-6 * size, equal_nan=True)


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    """Return the largest difference over the largest of A; infinite where one is known and the other not."""
    if not np.array_equal(np.isnan(a), np.isnan(b)):
        return float("inf")
    apart, size = np.nan_to_num(np.abs(b - a)).max(initial=0.0), np.nan_to_num(np.abs(a)).max(initial=0.0)
    return float(apart / size) if size > 0.0 else float(apart > 0.0)
