"""Solutions at one frequency and level: the library's function behind ``microslip search`` (docs/theory.md, section 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..contact.law import OPEN, SLIP
from ..continuation.levels import frequency_sweep
from ..continuation.other_solutions import ON_CURVE, Solution, continued, curve_through, solutions_at
from ..messages.errors import CaseError
from ..points.branch import Branch
from ..points.multipliers import is_stable
from ..scene.schema import Scene
from .arguments import number_above, refuse_no_structure, whole_number
from .build import Structure
from .prepare import Prepared
from .respond import prepared_with
from .settings import output_names, refuse_statics, units_of

STARTS = 30


@dataclass(frozen=True, eq=False)
class FollowedCurve:
    """A curve as arrays, point by point; the same on every rank."""

    frequency: np.ndarray  # (n,) Hz
    response: np.ndarray  # (n, n_outputs, N_H)
    segment: np.ndarray  # (n,)
    multipliers: np.ndarray | None  # (n, 6, 2); None where stability is not computed
    failure: str | None  # why it ends early

    @property
    def amplitude(self) -> np.ndarray:
        """Of harmonic 1 of the outputs, (n, n_outputs)."""
        return np.hypot(self.response[..., 1], self.response[..., 2])


@dataclass(frozen=True, eq=False)
class SolutionAt:
    """A solution at the frequency of a search; the same on every rank."""

    response: np.ndarray  # (n_outputs, N_H) in their units
    residual: float  # scaled 2-norm
    multipliers: np.ndarray | None  # (6, 2); None where stability is not computed
    slipping: int  # numbers of pairs
    open: int
    source: str  # "curve", "level" or "deflation"
    curve: FollowedCurve | None = None  # through it; None unless requested, or if it is on the curve of the search
    notes: tuple[str, ...] = ()  # of the point, as that the mean slip is held by springs

    @property
    def amplitude(self) -> np.ndarray:
        """Of harmonic 1 of the outputs, (n_outputs,)."""
        return np.hypot(self.response[:, 1], self.response[:, 2])

    @property
    def phase(self) -> np.ndarray:
        """Of harmonic 1, u = amplitude cos(omega t + phase), (n_outputs,) [rad]."""
        return np.arctan2(-self.response[:, 2], self.response[:, 1])

    @property
    def stable(self) -> bool | None:
        """Whether a small disturbance decays; None where stability is not computed."""
        return None if self.multipliers is None else is_stable(self.multipliers)

    @property
    def largest_multiplier(self) -> float:
        """Modulus of the largest Floquet multiplier; NaN where stability is not computed."""
        return float("nan") if self.multipliers is None else float(np.hypot(*self.multipliers[0]))


@dataclass(frozen=True, eq=False)
class Search:
    """Solutions at a frequency and level, by rising amplitude of the first output.  There may be others."""

    frequency: float  # Hz
    level: float
    level_unit: str
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    solutions: tuple[SolutionAt, ...]
    curve: FollowedCurve  # of the level, from the begin of the range
    starts: int


def search(
    structure: Structure,
    at: float,
    *,
    level: float | None = None,
    starts: int = STARTS,
    seed: int = 1,
    follow: bool = False,
    **keys: Any,
) -> Search:
    """Return solutions at a frequency: those along the curve, over the level, and by deflation from many starts.

    Collective on ``structure.comm``; the same on every rank.  docs/theory.md, section 7.  With the harmonics and samples of
    the curve there.

    Parameters
    ----------
    at : frequency [Hz], in the range of [response]
    level : the highest of the scene if None
    starts : number of motions from which Newton's method with deflation begins
    seed : of the random ones
    follow : whether the curve is followed from each solution that is not on the curve of the level
    keys : as those of :func:`respond`, but levels and at

    Raises
    ------
    CaseError : a frequency outside the range, a disc of one sector, no joint, nothing that vibrates; on every rank
    ConvergenceError, ResourceError : no solution was found; on every rank
    """
    refuse_no_structure(structure, "search")
    at = number_above(at, 0.0, "search: at")
    starts, seed = whole_number(starts, 1, "search: starts"), whole_number(seed, 0, "search: seed")
    level = max(structure.scene.response.levels) if level is None else number_above(level, 0.0, "search: level")
    refuse_what_has_one(structure.scene)
    has_stability = structure.scene.damping is None or not structure.scene.damping.structural
    has_bars = structure.scene.accuracy is not None
    prepared, _ = prepared_with(structure, {}, {**keys, "levels": [level], "peaks": False}, has_bars=has_bars)
    of, omega = prepared.response, 2.0 * np.pi * at
    refuse_outside(prepared, at)
    curve = curve_through(of, level, omega, has_stability)
    solutions = []
    for solution in solutions_at(of, curve, omega, starts, seed, has_stability):
        through = continued(of, level, solution, has_stability) if follow and solution.source != ON_CURVE else None
        solutions.append(_solution(solution, through))
    scene, units = prepared.scene, units_of(prepared.scene)
    return Search(at, level, units.level, output_names(scene), units.outputs, tuple(solutions), _curve(curve), starts)


def refuse_what_has_one(scene: Scene) -> None:
    """Raise CaseError if a scene has one solution at every frequency, or solutions that a search does not support.  Local."""
    where = f"{scene.path}: search"
    refuse_statics(scene, "search")
    if not scene.joints:
        raise CaseError(f"{where}: the scene has no [[joints]]: its response is linear, one solution at each frequency")
    if scene.cyclic is not None and not scene.cyclic.whole:
        raise CaseError(
            f"{where}: [cyclic]: one sector represents only waves, and other solutions of a disc need not be waves; state "
            "whole = true in [cyclic]"
        )


def refuse_outside(prepared: Prepared, at: float) -> None:
    """Raise CaseError where a frequency [Hz] lies outside the range of the scene.  Local; the same on every rank."""
    settings, omega_n = prepared.response.settings, prepared.structure.excited.omega_n
    try:
        frequency_sweep(replace(settings, at=(at,)), omega_n)
    except CaseError as problem:
        raise CaseError(f"{prepared.scene.path}: search: {str(problem).replace('[response] at', '--at')}") from None


def _solution(solution: Solution, through: Branch | None) -> SolutionAt:
    point, curve = solution.point, None if through is None else _curve(through)
    slipping, is_open = (int(np.count_nonzero(point.state == kind)) for kind in (SLIP, OPEN))
    return SolutionAt(
        point.response, solution.residual, point.multipliers, slipping, is_open, solution.source, curve, point.notes
    )


def _curve(branch: Branch) -> FollowedCurve:
    def of(value: Any) -> np.ndarray:
        return np.array([value(point) for point in branch.points])

    known = bool(branch.points) and all(point.multipliers is not None for point in branch.points)
    return FollowedCurve(
        of(lambda point: point.omega) / (2.0 * np.pi),
        of(lambda point: point.response),
        of(lambda point: point.segment),
        of(lambda point: point.multipliers) if known else None,
        branch.failure,
    )
