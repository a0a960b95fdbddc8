"""From the settings of a response to one branch per level."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..contact.law import Law
from ..error_estimate.estimate import ErrorEstimator
from ..error_estimate.sensitivities import exact_adjoints
from ..fourier.amplitudes import to_complex
from ..harmonic.balance import HarmonicBalance
from ..messages.errors import CaseError
from ..messages.words import counted
from ..points.band import frequency_band
from ..points.bifurcation import Bifurcation
from ..points.branch import SEGMENTS, SHORT_STEPS, SHORTER, Branch, Point
from ..points.peak import Peak
from ..points.selection import AllPairs, Selection
from ..points.sweep import Sweep
from ..receptance.motions import linear_motion, output_motion
from ..receptance.on_ranks import on_ranks
from ..receptance.reduced_model import ReducedModel
from ..receptance.truncated_modes import EnrichedModel
from .accuracy import accuracy_of, steps_for
from .bifurcations import bifurcations_of
from .checkpointer import Checkpointer, Checkpointers, finished_or, no_checkpoints
from .corrector import Correction
from .follow import follow_branch
from .grid import advancing
from .iterate import Iterate
from .linear_levels import is_linear, sticks_up_to
from .peaks import peaks_of
from .point_record import point_record, with_sensitivities, with_stability
from .problems import ForcedResponse
from .resonances import unresolved_peaks
from .settings import ResponseSettings
from .steps import ArcLength, LinearCurve, arc_lengths, linear_frequencies
from .task import BranchTask

if TYPE_CHECKING:
    from mpi4py import MPI

USUAL_POINTS = 100


@dataclass(frozen=True, eq=False)
class ResponseProblem:
    """Data that all levels of a response share."""

    settings: ResponseSettings
    model: ReducedModel
    law: Law  # of all pairs
    selection: Selection
    sweep: Sweep
    curve: LinearCurve  # the response with every pair stuck
    enriched: EnrichedModel | None = None  # the model that error bars compare with; None: no error bars

    @property
    def steps(self) -> ArcLength:
        """The step lengths, stated or by the number of points."""
        return arc_length_steps(self.settings, self.curve)

    def on_ranks(self, comm: MPI.Comm) -> ResponseProblem:
        """Return the same problem for some of the ranks, ``comm``, which continue alone.  Collective on all ranks."""
        model = on_ranks(self.model, comm)
        return replace(self, model=model, enriched=self.enriched and self.enriched.on_ranks(model, comm))

    def at_level(self, level: float) -> ForcedResponse:
        """Return the problem that is continued at a level [N].  Local."""
        return ForcedResponse(HarmonicBalance.of_all(self.model, self.law, self.settings.samples), level)

    def task(self, level: float) -> BranchTask:
        """Return the branch of a level [N] over the whole range, without error bars and accuracy.  Local."""
        return BranchTask(self.at_level(level), self.selection, self.sweep, self.steps, self.settings.tolerance)

    def frequencies_of(self, level: float) -> tuple[Branch, list[float]]:
        """Return the curve of a level [N], followed once through the range without error bars, and its frequencies [rad/s].

        Collective.  Each frequency lies further in the direction of the sweep than those before; of a constant response they are
        the ends of the range.
        """
        task, ends = self.task(level), [self.sweep.start, self.sweep.stop]
        branch = follow_branch(task, most_points(self.settings.points))
        return branch, ends if task.problem.is_constant and branch.points else advancing(branch.points, self.sweep.direction)


def response_problem(
    settings: ResponseSettings,
    model: ReducedModel,
    law: Law,
    selection: Selection,
    omega_n: np.ndarray,
    enriched: EnrichedModel | None = None,
    has_curve: bool = True,
) -> ResponseProblem:
    """Return the problem that all levels share: the range about the modes ``omega_n`` [rad/s], the linear curve.  Collective.

    Static columns are solved for in the order in which the pairs are likely to slip.  Without ``has_curve`` there is no linear
    curve, and no level can be followed.

    Raises
    ------
    CaseError : a range that the modes do not reach, or an undamped resonance on it; on every rank
    """
    sweep = frequency_sweep(settings, omega_n)
    if not has_curve:
        return ResponseProblem(settings, model, law, selection, sweep, LinearCurve(*np.zeros((4, 0))), enriched)
    curve = linear_curve(model, sweep, law)
    if model.n_pairs > 0 and not all(columns.known.all() for columns in model.static_columns):
        model.expect_to_slip(likely_to_slip(model, law, curve))
    return ResponseProblem(settings, model, law, selection, sweep, curve, enriched)


def frequency_sweep(settings: ResponseSettings, omega_n: np.ndarray) -> Sweep:
    """Return the range of [response] in rad/s, in the requested direction.  Local.

    Raises
    ------
    CaseError : the requested mode was not computed, or a frequency of ``at`` lies outside the range
    """
    low, high = frequency_band(settings.band, omega_n)
    highest = float(np.max(omega_n, initial=0.0)) / (2 * np.pi)
    if len(omega_n) and low > 10.0 * highest:
        raise CaseError(
            f"[response] starts at {low:g} Hz, far above the highest of the {counted(len(omega_n), 'mode')} computed, "
            f"{highest:.4g} Hz; check the unit (Hz), or raise [solver] modes"
        )
    outside = [f for f in settings.at if not low <= f <= high]
    if outside:
        stated = "frequencies" if settings.band.frequencies is not None else "span"
        raise CaseError(
            f"[response] at = {outside[0]:g} Hz lies outside {low:.6g} to {high:.6g} Hz; choose one there, or widen "
            f"[response] {stated}"
        )
    start, stop = (low, high) if settings.direction == "up" else (high, low)
    return Sweep(2 * np.pi * start, 2 * np.pi * stop, tuple(2 * np.pi * f for f in settings.at))


def linear_curve(model: ReducedModel, sweep: Sweep, law: Law | None = None) -> LinearCurve:
    """Return the stuck curve over the range, every resonance in it resolved.  Collective.

    Its length is that of the pairs' motion; of the outputs' where there is no pair.  Without the ``law`` of the pairs no level is
    known to be linear, nor one of a constant motion: it is left to the solver.
    """
    ends = min(sweep.start, sweep.stop), max(sweep.start, sweep.stop)
    omega = model.comm.bcast(linear_frequencies(*ends, *model.loaded_modes))
    none = np.zeros((3 * model.n_pairs, model.N_H))
    at_each = [(output_motion(model, 1.0, w, none), linear_motion(model, 1.0, w)) for w in omega]
    outputs, motions = map(list, zip(*at_each))
    s = arc_lengths(model.comm, motions if model.n_pairs else outputs, omega, sweep.scale)
    stuck = np.zeros(len(omega))
    if law is not None and model.n_pairs > 0 and not model.harmonics.is_constant:
        stuck = sticks_up_to(model, law, motions)
    return LinearCurve(omega, model.harmonics.carry(np.array(outputs), model.recorded), s, stuck)


def linear_branch(task: BranchTask, curve: LinearCurve, n_points: int, on_point: Callable[[Point], None]) -> Branch:
    """Return a linear branch at equal steps of its length, at requested frequencies and at peaks; nothing is solved.

    Collective.
    """
    problem, sweep, clock = task.problem, task.sweep, time.perf_counter()
    omegas = np.interp(np.linspace(0.0, curve.s[-1], n_points), curve.s, curve.omega) if n_points > 1 else np.array([sweep.start])
    equation, branch = problem.equation, Branch(problem.at((sweep.start,)).level)
    omegas = np.union1d(omegas, sweep.at)
    if n_points > 1:
        omegas = np.union1d(omegas, unresolved_peaks(curve, omegas))
    for omega in omegas[:: int(sweep.direction)]:
        there = Iterate(equation.linear_motion(problem.at((omega,))), (float(omega),), equation.harmonics)
        solution = Correction(there, 0, 0, 0.0, None), equation.every_pair
        point, _ = point_record(problem, AllPairs(), solution, omega in sweep.at, task.estimator)
        point = with_stability(problem, there, point) if task.has_stability else point
        if task.has_sensitivities:  # without pairs no solve is needed
            point = with_sensitivities(problem, solution, point, exact_adjoints(equation))
        now = time.perf_counter()
        point, clock = replace(point, seconds=now - clock), now
        on_point(point)
        branch.points.append(point)
    return branch


def most_points(points: int) -> int:
    """Return the bound of the points of a branch that never ends; corners and folds need some, however few are requested."""
    return 10 * (points + USUAL_POINTS)


def arc_length_steps(settings: ResponseSettings, curve: LinearCurve) -> ArcLength:
    """Return the step lengths: the length of the linear curve divided by the requested number of points, unless stated.  Local.

    Stated ones are shares of that length.  Few points make long steps, but none of them blind: the shortest step
    is no longer than that of the usual number of points.
    """
    stated = stated_steps(settings, curve)
    ds = stated.get("ds", curve.s[-1] / settings.points)
    return ArcLength(**{"ds": ds, "ds_min": min(ds, curve.s[-1] / USUAL_POINTS) / 4096.0, "ds_max": 2.0 * ds} | stated)


def stated_steps(settings: ResponseSettings, curve: LinearCurve) -> dict[str, float]:
    """Return the step lengths that are stated, from shares of the length of the linear curve.  Local."""
    requested = {key: getattr(settings, key) for key in ("ds", "ds_min", "ds_max")}
    return {key: curve.s[-1] * value for key, value in requested.items() if value}


def likely_to_slip(model: ReducedModel, law: Law, curve: LinearCurve) -> np.ndarray:
    """Return the pairs by falling share of their limits that the linear peak takes up.

    Collective: one broadcast.  Only the order of static solves depends on it.
    """
    U = np.abs(motion_at_peak(model, curve)).reshape(model.n_pairs, 3, model.N_H).sum(axis=2)
    order = np.argsort(-law.utilisation(U), kind="stable")
    return model.comm.bcast(order)  # all ranks solve for the same columns, also where a tie falls otherwise on some


def motion_at_peak(model: ReducedModel, curve: LinearCurve) -> np.ndarray:
    """Return the motion of all pairs where the first output peaks linearly, (3 n_pairs, N_H) [m/N].  Collective."""
    at_peak = np.argmax(np.abs(curve.response[:, 0, 1:]).max(axis=1, initial=0.0))
    return linear_motion(model, 1.0, curve.omega[at_peak], slice(None))


def levels_of_slip(of: ResponseProblem) -> np.ndarray | None:
    """Return about which levels the pairs begin to slip by the linear peak, rising, (n_pairs,) [N].  Collective.

    None where there is no pair, or nothing that vibrates.
    """
    if of.model.n_pairs == 0 or of.model.harmonics.is_constant:
        return None
    moved = np.abs(to_complex(motion_at_peak(of.model, of.curve))).sum(axis=1).reshape(-1, 3)
    with np.errstate(divide="ignore"):
        return np.sort(1.0 / of.law.utilisation(moved))


def nobody(event: str, *news: Any) -> None:
    """Do nothing: without an observer."""


def follow_levels(
    of: ResponseProblem, notify: Callable[..., None] = nobody, checkpointers: Checkpointers = no_checkpoints
) -> list[Branch]:
    """Return the branches of all levels, one after the other.  Collective, as is ``notify``, called with levels and points.

    Its first argument is the name of a method of :class:`~microslip.observe.observer.Observers`.
    """
    branches = []
    for number, level in enumerate(of.settings.levels):
        notify("level_started", number)
        branches.append(follow_level(of, level, partial(notify, "point", number), checkpointers))
        notify("level_finished", number, branches[-1])
    return branches


def follow_level(
    of: ResponseProblem,
    level: float,
    on_point: Callable[[Point], None] = lambda point: None,
    checkpointers: Checkpointers = no_checkpoints,
) -> Branch:
    """Return the branch of one level [N], with error bars if there is an enriched model, and peaks if requested.  Collective.

    A branch that ends early is followed from the other end of the range as well: folds that lead it back, or a corner that
    Newton does not pass in one direction, are often on one side only.  If that ends early, too, it is followed with shorter steps
    from the start: a long step may have led to another part of the curve.
    """
    return with_peaks(of, whole_branch(of, level, on_point, checkpointers), checkpointers)


def with_peaks(of: ResponseProblem, branch: Branch, checkpointers: Checkpointers) -> Branch:
    """Return the branch of a level with its peaks and bifurcations, if requested: saved ones, or solved for.  Collective."""
    settings, checkpointer = of.settings, checkpointers(of.model.comm, branch.level, 0)

    def solve_for_peaks() -> list[Peak]:
        return peaks_of(of.at_level(branch.level), branch, settings.tolerance, settings.sensitivities, of.curve)

    def locate_bifurcations() -> list[Bifurcation]:
        return bifurcations_of(of.at_level(branch.level), branch, settings.tolerance)

    if settings.peaks and not of.model.harmonics.is_constant:
        branch.peaks = checkpointer.solved_for(Peak, solve_for_peaks)
    if settings.stability:
        branch.bifurcations = checkpointer.solved_for(Bifurcation, locate_bifurcations)
    return branch


def whole_branch(of: ResponseProblem, level: float, on_point: Callable[[Point], None], checkpointers: Checkpointers) -> Branch:
    """Return the branch of a level, of two or three segments where those before end early.  Collective."""
    branch = first = _segment(of, level, on_point, checkpointers)
    for number, again in ((1, replace(of, sweep=of.sweep.reverse)), (SHORT_STEPS, of)):
        has_room = len(branch.points) < most_points(of.settings.points)
        is_useful = number != SHORT_STEPS or first.points  # else it has no first point, either
        if branch.failure is None or of.model.harmonics.is_constant or not (has_room and is_useful):
            break
        branch = branch.with_segment(_segment(again, level, on_point, checkpointers, number), SEGMENTS[number])
    return branch


def _segment(
    of: ResponseProblem, level: float, on_point: Callable[[Point], None], checkpointers: Checkpointers, segment: int = 0
) -> Branch:
    """Return one segment, from its checkpoint or followed to its end."""
    checkpointer = checkpointers(of.model.comm, level, segment)
    return finished_or(checkpointer, lambda: _follow_one_way(of, level, on_point, segment, checkpointer), on_point)


def _follow_one_way(
    of: ResponseProblem, level: float, on_point: Callable[[Point], None], segment: int, checkpointer: Checkpointer
) -> Branch:
    """Follow a level in one direction, with the requested accuracy; without pairs nothing is solved.  Collective."""
    task, n_points = task_of(of, level), of.settings.points
    if of.model.n_pairs > 0:
        shares = SHORTER if segment == SHORT_STEPS else 1
        task = replace(task, steps=task.steps.divided(shares))
        return follow_branch(task, most_points(shares * n_points), on_point, segment, checkpointer)
    if task.problem.is_constant:
        task, n_points = replace(task, sweep=replace(of.sweep, at=())), 1
    branch = linear_branch(task, of.curve, n_points, on_point)
    checkpointer.save(task, None, branch.points)
    return branch


def task_of(of: ResponseProblem, level: float) -> BranchTask:
    """Return the branch of a level [N] over the whole range, with the requested accuracy.  Collective."""
    settings, task = of.settings, of.task(level)
    adjoints = exact_adjoints(of.model) if settings.sensitivities else None
    estimator = None if of.enriched is None else ErrorEstimator(of.enriched, adjoints)
    task = replace(task, estimator=estimator, has_stability=settings.stability, has_sensitivities=settings.sensitivities)
    if of.model.n_pairs == 0:
        return task
    equation, steps = task.problem.equation, task.steps
    linear = is_linear(equation, level, of.curve)
    accuracy = accuracy_of(settings, equation, linear) if estimator else None
    if accuracy is not None and accuracy.chooses_steps:
        steps = ArcLength(**asdict(steps_for(accuracy.target)) | stated_steps(settings, of.curve))
    return replace(task, steps=steps, accuracy=accuracy, is_linear=linear)
