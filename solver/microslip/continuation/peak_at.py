"""One peak of the forced response, from a solution near by and without the curve (docs/theory.md, section 7, eq. (7.13)).

Solutions are taken at given phases of harmonic 1 of the pairs' motion, which turns by half a cycle along a resonance.  The peak
is the solution at whose two neighbours, a fixed angle before and after it, the output has the same amplitude.  This definition
does not depend on where a search starts, and the angle lies above that of the corners where samples of the contact law begin or
end to slip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..contact.law import STICK
from ..error_estimate.estimate import ErrorEstimator, output_amplitude
from ..error_estimate.sensitivities import sensitivities_of
from ..harmonic.balance import HarmonicBalance
from ..messages.errors import ConvergenceError
from ..points.branch import Point
from ..points.selection import AllPairs
from ..points.sensitivities import COMMON, NUMBERS, of_size
from ..points.sweep import Sweep
from .acceptance import accept
from .constraint_rows import Constraint, Plane, Scaling
from .corrector import BorderedSystem, Correction
from .follow import advance
from .iterate import Iterate, interpolate
from .maximum_by_phase import DISTANCE, rotated
from .output_rows import AmplitudeRow
from .outputs import output_at
from .point_record import point_record
from .point_solver import PointSolver, Workspace
from .problems import ForcedResponse, Problem
from .steps import ArcLength
from .task import BranchTask
from .ways_out import MOSTLY

SAMPLES = 4.0  # of the contact law between the solutions, at least: corners are one sample from each other
SETTLED = 2e-5  # rad: a shift of the peak below which one solution more is the peak
MOST_HALVES = 2  # times that the way to a phase is halved where Newton's method fails
CLOSER = 2  # times that the angle itself is halved then
FARTHEST = 1.0  # of that angle: a step towards the peak
MOST_STEPS = 12
LEAST, FAR = 0.3, 2.0  # of the motion of a guess and of the frequency of the start: solutions beyond belong to no peak here
MOST = 100.0  # of the motion of a guess: beyond it the mean slip, which nothing determines where all pairs slip, has drifted
WIDTHS = 10.0  # from a peak, within which the branch reaches its half-power point
STEP = np.pi / 16.0  # of this branch: rad, and of its scaled arc length
SHORTEST, EASY = 4096.0, 8  # this step over the shortest one, Newton iterations at which their length is unchanged
MOST_POINTS = 60  # of this branch
HALF_POWER = 0.5**0.5  # share of the amplitude of a peak
LEAST_SHARE = 0.02  # of the amplitude: steps of this size towards a half-power point are divided no further
LEAST_FIRST = 0.08  # the same of the first one, from the peak
NO_PEAK = "no peak of the output near the start"


Starts = tuple[Iterate, Iterate | None, Iterate | None]  # near a peak, and near the ends of its half-power width if known


@dataclass(frozen=True, eq=False)
class PeakPoint:
    """A peak of one output; the same on all ranks but for the motion."""

    iterate: Iterate
    point: Point  # its record: energies, states, error bar
    amplitude: float  # of harmonic 1
    sides: tuple[Iterate | None, Iterate | None]  # at 1 / sqrt 2 of the amplitude, above and below its frequency; None: none
    newton: int  # iterations of all solutions
    by_pairs: np.ndarray | None = None  # derivatives of amplitude, phase and frequency [Hz], as those of a Peak, on request
    by_common: np.ndarray | None = None

    @property
    def width(self) -> float:
        """The half-power width [rad/s]; NaN without one of its ends."""
        above, below = self.sides
        return float("nan") if above is None or below is None else abs(above.parameter - below.parameter)

    @property
    def starts(self) -> Starts:
        """The start of a search near by."""
        return self.iterate, *self.sides


class _Lost(Exception):
    """Newton's method fails, or the amplitude has no maximum near."""


def peak_near(
    problem: ForcedResponse,
    output: int,
    starts: Starts,
    width: float,
    tolerance: float,
    estimator: ErrorEstimator | None = None,
    needs_width: Callable[[Point], bool] = lambda point: True,
    has_rates: bool = False,
) -> PeakPoint | str:
    """Return the peak of an output near some motions, eq. (7.13), with its half-power width, or why there is none.  Collective.

    Parameters
    ----------
    starts : with the frequency as their parameter [rad/s]
    width : rad/s, unit of the frequency: about the half-power width
    estimator : of the error bar of the peak
    needs_width : of the record of the peak: whether its half-power points are sought; collective
    has_rates : whether the derivatives of amplitude, phase and frequency are computed, eq. (11.10)
    """
    workspace, harmonics = Workspace(problem.equation), problem.equation.harmonics
    start, *sides = (side and side.on(harmonics) for side in starts)
    assert start is not None
    try:
        search = _Search(problem, output, start, width, tolerance, workspace)
        peak = search.peak()
        solution = replace(peak.solution, newton=search.newton)
        point, _ = point_record(problem, AllPairs(), (solution, search.every), False, estimator)
        above = below = None
        if needs_width(point):
            phases = {np.sign(search.phase_from(peak.iterate, side)): side for side in sides if side is not None}
            above, below = (search.half_power(peak, way, phases.get(way)) for way in (-1.0, 1.0))
        rates = search.rates(peak) if has_rates else (None, None)
        return PeakPoint(solution.iterate, point, peak.size, (above, below), search.newton, *rates)
    except _Lost as problem_text:
        return str(problem_text)
    finally:
        workspace.destroy()


@dataclass(frozen=True, eq=False)
class _At:
    """A solution at a phase, and the amplitude of the output there."""

    solution: Correction
    size: float

    @property
    def iterate(self) -> Iterate:
        return self.solution.iterate


@dataclass(frozen=True, eq=False)
class _Known:
    """A solution at a phase from a peak, and its share of the amplitude of the peak."""

    phase: float
    iterate: Iterate
    share: float


class _Search:
    """The search for one peak.  Collective on the communicator of the equation."""

    def __init__(
        self, problem: ForcedResponse, output: int, start: Iterate, width: float, tolerance: float, workspace: Workspace
    ):
        self.problem, self.output, self.start, self.newton = problem, output, start, 0
        self.equation: HarmonicBalance = problem.equation
        self.every = self.equation.every_pair
        self.distance = max(DISTANCE, SAMPLES * 2.0 * np.pi / self.equation.n_samples)
        sweep = Sweep(start.parameter, start.parameter + width)
        self.solver = PointSolver(problem, AllPairs(), sweep, tolerance, workspace)
        self.scaling = self._scaling(start)
        self.sides: tuple[_At, _At] | None = None  # of the peak, the solutions with equal amplitudes
        self.W = -width / 2.0  # rad/s of the frequency for each unit of the tangent of the phase

    def _scaling(self, there: Iterate) -> Scaling:
        size = self.solver.norm(there.U)
        if size == 0.0:
            raise _Lost("the pairs do not move: no phase")
        return self.solver.scaling(size, self.solver.force(there, self.every))

    # -- solutions at a phase ----------------------------------------------------------------------------------------

    def at(self, reference: Iterate, theta: float, guess: Iterate, is_patient: bool = False) -> _At:
        """Return the solution whose motion in harmonic 1 has the phase ``theta`` [rad] from that of the reference."""
        about = rotated(reference, theta)
        normal, first = np.zeros_like(about.U), about.harmonics.columns(1)
        normal[..., first] = rotated(about, 0.5 * np.pi).U[..., first]
        size = self.solver.norm(normal)
        if size == 0.0:
            raise _Lost("the pairs do not move: no phase")
        return self.solved(Plane(about, normal / size, (0.0,)), guess, is_patient)

    def solved(self, row: Constraint, guess: Iterate, is_patient: bool = False, problem: Problem | None = None) -> _At:
        """Return the solution under a row, near a guess, with the mean slip free or held as in a ``problem``."""
        system = BorderedSystem(problem or self.problem, (row,), self.scaling, self.every)
        corrector = self.solver.workspace.corrector(self.equation, self.solver.resolution)
        solution = corrector.correct(system, guess)
        self.newton += solution.newton
        if solution.failure is not None and is_patient:
            solution = corrector.correct(system, guess, is_patient)
            self.newton += solution.newton
        if solution.failure is not None:
            raise _Lost(solution.failure)
        before, size = (self.solver.norm(there.U) for there in (guess, solution.iterate))
        if not LEAST * before <= size <= MOST * before or not 1.0 / FAR < solution.iterate.parameter / self.start.parameter < FAR:
            raise _Lost("the solution at this phase lies elsewhere")
        return _At(solution, self.amplitude(solution.iterate))

    def released(self, there: Iterate) -> ForcedResponse:
        """Return the problem without springs on the mean slip where too few pairs slip in a motion, as along a curve."""
        if self.equation.held is None:
            return self.problem
        state = self.equation.contact_forces(there.U, self.every, tangents=False).state
        moving, n_pairs = self.equation.comm.allreduce(int(np.count_nonzero(state != STICK))), self.equation.model.n_pairs
        return self.problem if moving >= MOSTLY * n_pairs else self.problem.with_equation(self.equation.holding(None))

    def amplitude(self, there: Iterate) -> float:
        """Return |a| of harmonic 1 of the output, the same on all ranks."""
        return abs(output_at(self.equation, self.problem.at(there.parameters), there.U, self.every, self.output))

    # -- the peak ----------------------------------------------------------------------------------------------------

    def peak(self) -> _At:
        """Return the peak; with neighbours closer by where there are none at the usual angle, beyond the end of a branch."""
        here = self.at(self.start, 0.0, self.start, is_patient=True)
        for k in range(CLOSER + 1):
            try:
                return self._settled(here, self.distance / 2.0**k)
            except _Lost:
                if k == CLOSER:
                    raise
        raise AssertionError

    def _settled(self, here: _At, distance: float) -> _At:
        """Return the solution between two neighbours of equal amplitude, eq. (7.13), by secants from a solution near by."""
        ends: tuple[Iterate, Iterate] | None = None
        before: tuple[float, float] | None = None  # the last shift, and the difference before it
        for _ in range(MOST_STEPS):
            self.scaling = self._scaling(here.iterate)
            guesses = (None, None) if ends is None else ends
            low, high = (self.turned(here, way, end, is_patient=True) for way, end in zip((-distance, distance), guesses))
            rise, bend = 0.5 * (high.size - low.size), low.size - 2.0 * here.size + high.size
            self.W = (high.iterate.parameter - low.iterate.parameter) / (2.0 * np.tan(distance))
            slope = bend if before is None else (rise - before[1]) / before[0]
            slope = slope if slope < 0.0 else bend
            shift = float(np.clip(-rise / slope, -FARTHEST, FARTHEST)) if slope < 0.0 else FARTHEST * float(np.sign(rise))
            below, guess, above = (_along(low.iterate, here.iterate, high.iterate, shift + way) for way in (-1.0, 0.0, 1.0))
            if abs(shift) * distance <= SETTLED:
                self.sides = low, high
                return self.at(guess, 0.0, guess)
            here, ends, before = self.at(guess, 0.0, guess, is_patient=True), (below, above), (shift, rise)
        raise _Lost(NO_PEAK)

    def rates(self, peak: _At) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
        """Return the derivatives of amplitude, phase and frequency [Hz] of a peak, (3, n_numbers, n_pairs) and (3, n_common).

        None if an adjoint solve fails.  docs/theory.md, eq. (11.10).
        """
        assert self.sides is not None, "the peak is settled"
        low, here, high = (self._rates_at(at.iterate) for at in (self.sides[0], peak, self.sides[1]))
        if low is None or here is None or high is None:
            return None, None
        by_phase = [d[:, -1] / d[1, -1] for d in (low, here, high)]  # of amplitude and phase, with the frequency [s]
        at_phase = [d[0] - d[1] * of[0] for d, of in zip((low, here, high), by_phase)]
        d_phase = (at_phase[2] - at_phase[0]) / (by_phase[0][0] - by_phase[2][0])
        d_omega = (d_phase - here[1]) / here[1, -1]
        d = np.stack([here[0] + here[0, -1] * d_omega, d_phase, d_omega / (2.0 * np.pi)])
        d[:, -1] = 0.0
        return d[:, : -len(COMMON)].reshape(3, len(NUMBERS), -1), d[:, -len(COMMON) :]

    def _rates_at(self, there: Iterate) -> np.ndarray | None:
        """Return derivatives of amplitude and phase where the frequency stays, those of pairs first, as one row each."""
        at, equation = self.problem.at(there.parameters), self.equation
        rows = [self.output, equation.model.n_outputs + self.output]
        sensitivities = sensitivities_of(equation, at, there.U, self.every, self.solver.workspace.adjoints(equation))
        p = equation.full_force(equation.contact_forces(there.U, self.every, tangents=False))
        cos, sin = output_amplitude(equation.model_at(at), at, p)[rows]
        d = np.concatenate([sensitivities.of_pairs[rows].reshape(2, -1), sensitivities.common[rows]], axis=1)
        return equation.comm.bcast(np.stack(of_size(cos, sin, *d))) if sensitivities.is_solved else None

    def turned(self, here: _At, theta: float, guess: Iterate | None = None, is_patient: bool = False, depth: int = 0) -> _At:
        """Return the solution at a phase from another one, by halves of the way where Newton's method fails.

        ``is_patient`` at the end of the last half.
        """
        try:
            return self.at(here.iterate, theta, guess or self._as_one_mode(here.iterate, theta, 0.0))
        except _Lost:
            if depth == MOST_HALVES:
                raise
        middle = self.turned(here, 0.5 * theta, is_patient=is_patient, depth=depth + 1)
        turned, back = rotated(middle.iterate, 0.5 * theta), rotated(here.iterate, theta)
        omega = 2.0 * middle.iterate.parameter - here.iterate.parameter
        return self.at(here.iterate, theta, Iterate(2.0 * turned.U - back.U, (omega,), turned.harmonics), is_patient)

    def _as_one_mode(self, there: Iterate, theta: float, phase: float) -> Iterate:
        """Return a motion at a phase from that at another ``phase`` from the peak, as if it were of one mode."""
        turned, omega = rotated(there, theta - phase), there.parameter + self.W * (np.tan(theta) - np.tan(phase))
        return Iterate(turned.U * (np.cos(theta) / np.cos(phase)), (float(omega),), there.harmonics)

    # -- half the power ----------------------------------------------------------------------------------------------

    def half_power(self, peak: _At, way: float, start: Iterate | None) -> Iterate | None:
        """Return the solution at 1 / sqrt 2 of the amplitude of a peak, in the ``way`` of its phase; None without one.

        Where Newton's method fails: through larger shares of the amplitude unless the mean slip is held, then along the branch.
        """
        guess = start or self._guess([_Known(0.0, peak.iterate, 1.0)], way * 0.25 * np.pi)
        side = self._at_share(peak, HALF_POWER, guess, way)
        if side is None and self.equation.held is None:
            side = self._through_shares(peak, way)
        side = side or self._along_branch(peak, way)
        return None if side is None else side.iterate

    def _through_shares(self, peak: _At, way: float) -> _Known | None:
        """Return the half-power point through shares as large as Newton's method needs."""
        known, share = [_Known(0.0, peak.iterate, 1.0)], 0.5 * (1.0 + HALF_POWER)
        for _ in range(MOST_STEPS):
            last = known[-1]
            of_mode = float(np.arccos(share))
            phase = way * of_mode if last.share == 1.0 else last.phase * of_mode / float(np.arccos(last.share))
            side = self._at_share(peak, share, self._guess(known, phase), way)
            if side is not None:
                known, share = [*known, side], max(HALF_POWER, share - 2.0 * (last.share - share))
                if side.share == HALF_POWER:
                    return side
            elif last.share - share < (LEAST_SHARE if len(known) > 1 else LEAST_FIRST):
                return None
            else:
                share = 0.5 * (last.share + share)
        return None

    def _along_branch(self, peak: _At, way: float) -> _Known | None:
        """Return the half-power point along the branch from the peak, between the last two points of it."""
        reach = -way * WIDTHS * 2.0 * abs(self.W)
        sweep = Sweep(peak.iterate.parameter - reach, peak.iterate.parameter + reach)
        steps = ArcLength(ds=STEP, ds_min=STEP / SHORTEST, ds_max=2.0 * STEP, turn=STEP, easy=EASY)
        task = BranchTask(self.problem, AllPairs(), sweep, steps, self.solver.tolerance)
        try:
            first = accept(task, task.start(self.solver.workspace), (peak.solution, self.every))
            before = self._as_one_mode(peak.iterate, -way * STEP, 0.0)
            state = first.state.after(replace(first.now, iterate=before), first.now, 0.25 * STEP)
        except ConvergenceError:
            return None
        for _ in range(MOST_POINTS):
            advanced = advance(task, state)
            state, self.newton = advanced.state, self.newton + advanced.newton
            if state.is_done or advanced.failure is not None or state.before is None or state.now is None:
                return None
            last_two = self.equation.comm.bcast((state.before.amplitude[self.output], state.now.amplitude[self.output]))
            high, low = map(abs, last_two)
            if low <= HALF_POWER * peak.size:
                harmonics, share = self.equation.harmonics, (high - HALF_POWER * peak.size) / (high - low)
                a, b = (there.iterate.on(harmonics) for there in (state.before, state.now))
                guess = interpolate(a, b, a.parameter + share * (b.parameter - a.parameter))
                return self._at_share(peak, HALF_POWER, guess, way, is_patient=True, problem=state.solver.problem)
        return None

    def _at_share(
        self, peak: _At, share: float, guess: Iterate, way: float, is_patient: bool = False, problem: Problem | None = None
    ) -> _Known | None:
        """Return the solution at a share of the amplitude of a peak, in the ``way`` of its phase."""
        row = AmplitudeRow(self.output, share * peak.size)
        try:
            there = self.solved(row, guess, is_patient, problem or self.released(guess)).iterate
        except _Lost:
            return None
        phase = self.phase_from(peak.iterate, there)
        return _Known(phase, there, share) if phase * way > 0.0 else None

    def phase_from(self, reference: Iterate, there: Iterate) -> float:
        """Return the phase [rad] of a motion from a reference, both in harmonic 1.  Collective."""
        first = reference.harmonics.columns(1)
        a, b = (u[..., 0] - 1j * u[..., 1] for u in (reference.U[..., first], there.on(reference.harmonics).U[..., first]))
        return float(np.angle(self.equation.comm.allreduce(complex(np.vdot(a, b)))))

    def _guess(self, known: list[_Known], theta: float) -> Iterate:
        """Return a motion at a phase from the last solutions, as if it were of one mode that changes with tan theta."""
        last = known[-1]
        one = self._as_one_mode(last.iterate, theta, last.phase)
        if len(known) < 2:
            return one
        first, tan = known[-2], np.tan([known[-2].phase, theta, last.phase])
        other, s = self._as_one_mode(first.iterate, theta, first.phase), (tan[1] - tan[0]) / (tan[2] - tan[0])
        omega = first.iterate.parameter + s * (last.iterate.parameter - first.iterate.parameter)
        return Iterate(other.U + s * (one.U - other.U), (float(omega),), one.harmonics)


def _along(low: Iterate, here: Iterate, high: Iterate, t: float) -> Iterate:
    """Return the place at ``t`` of the parabola through three solutions at -1, 0 and 1.  Local."""
    weights = 0.5 * t * (t - 1.0), 1.0 - t * t, 0.5 * t * (t + 1.0)
    U = weights[0] * low.U + weights[1] * here.U + weights[2] * high.U
    omega = float(np.dot(weights, [there.parameter for there in (low, here, high)]))
    return Iterate(U, (omega,), here.harmonics)
