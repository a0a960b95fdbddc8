"""Peaks: the maxima of the outputs along a curve, each solved for as a point (docs/theory.md, section 7)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..contact.law import STICK
from ..error_estimate.estimate import ErrorEstimator, output_amplitude
from ..error_estimate.sensitivities import sensitivities_of
from ..fourier.amplitudes import to_complex
from ..harmonic.adjoint_solver import AdjointSolver
from ..harmonic.balance import HarmonicBalance
from ..harmonic.operating_point import LawParameter, OperatingPoint, Rates
from ..parallel.agree import on_root
from ..points.branch import Branch, Point
from ..points.peak import Peak
from ..points.selection import AllPairs
from ..points.sensitivities import COMMON, NUMBERS, of_size
from ..points.sweep import Sweep
from .accuracy import Accuracy
from .branch_points import equation_at, harmonics_of, iterate_of
from .checkpointer import NO_CHECKPOINTS, Checkpointer
from .constraint_rows import EnclosedRow
from .corrector import BorderedSystem
from .follow import Emit, follow_branch
from .iterate import Iterate, interpolate
from .maximum import EXACT, Maximum
from .maximum_by_phase import MaximumByPhase
from .outputs import output_at, outputs_at
from .point_solver import PointSolver, Workspace
from .problems import ForcedResponse, KnownCurve, LinearResponse, ProblemBase
from .steps import ArcLength, LinearCurve
from .task import BranchTask
from .tops import Top, between_points, hidden, maxima

STEPS_OF_PEAKS = ArcLength(ds=0.2, ds_min=1e-4, ds_max=0.4, turn=0.5, easy=60)  # each point takes 10 to 20 iterations
STEPS_OF_LEADS = replace(STEPS_OF_PEAKS, ds_min=1e-2)  # no shorter ones where a curve continues otherwise
MOST_POINTS = 1000
ASIDE, FARTHER = 1e-3, 0.05  # half-power widths to both sides of a peak, where derivatives are taken: of its size; of its place
TURNED = 0.25 * np.pi  # rad, of the motion of pairs over the half-power width of a peak of the mode that moves them
SAME, SAME_MOTION = 1e-5, 1e-2  # of frequency and amplitude, and of the motion, by which one peak may differ from itself
SHARES_OF_STEP = (*(0.5**k for k in range(8, 0, -1)), 0.75, 1.0)  # to solutions between its ends
MANY_SAMPLES = 1024  # from which the error of the place, of second order in that distance, is above that of the corners
FARTHER_BY = 50.0 ** (1.0 / 3.0)  # from one to the other, so that each solution leads to the next


def nobody(point: Point) -> None:
    """Do nothing with a point: without an observer."""


@dataclass(frozen=True, eq=False)
class PeakOver(ProblemBase):
    """The peak of an output over a number of the operating point: parameters are its value and the frequency [rad/s].

    While all pairs stick, the peak is that of the linear response, at the frequency ``stuck``.
    """

    varies: str | LawParameter  # "level", "damping" or a parameter of the contact law
    level: float  # N, where it does not vary
    stuck: float  # rad/s
    width: float  # rad/s, unit of the frequency: about the half-power width
    row: EnclosedRow  # over the second parameter
    begins: Iterate | None = None  # a solution to begin from; None: the linear response
    damping: float = 1.0  # -, factor, where it does not vary

    @property
    def units(self) -> tuple[float, ...]:
        """Unit of the frequency [rad/s]: ``width``."""
        return (self.width,)

    @property
    def maximum(self) -> EnclosedRow:
        """The row of the maximum: ``row``."""
        return self.row

    @property
    def curve(self) -> KnownCurve:
        """The linear response at its own peak; from ``begins``, if there is one."""
        return (
            LinearResponse(self, (self.stuck,))
            if self.begins is None
            else FromSolution(self, (self.stuck,), solution=self.begins)
        )

    @property
    def law_parameters(self) -> tuple[LawParameter, ...]:
        """The parameter of the contact law that varies, if it is one."""
        return (self.varies,) if isinstance(self.varies, LawParameter) else ()

    def allows(self, parameters: tuple[float, ...]) -> bool:
        """Return whether the frequency is above zero, and the value, too, or that the law has its value.

        Collective where the law varies.
        """
        if not self.law_parameters:
            return min(parameters) > 0.0
        return parameters[1] > 0.0 and self.equation.allows(self.at(parameters))

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        """Return the operating point for the value that varies and the frequency [rad/s].  Local.

        Below 0, where a step beyond the end of a range may lead, a parameter of the law is 0.
        """
        value, omega = parameters
        value = max(value, 0.0) if self.law_parameters else value
        return with_value(self.varies, value, OperatingPoint(omega, self.level, damping=self.damping))

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rates, ...]:
        """Return the rates of the operating point with the value that varies and the frequency.  Local."""
        is_constant = self.law_parameters and parameters[0] < 0.0
        return {self.varies: 0.0 if is_constant else 1.0}, {"omega": 1.0}

    def without_solution(self, parameter: float, why: str) -> str:
        """Return the message for lack of a first peak, and ``why`` Newton's method did not converge.  Local."""
        return (
            f"hb: no first peak at {self.where(parameter)}: neither from the peak near by ({why}) nor in another way; "
            "begin at another value, or raise [solver] samples"
        )

    def where(self, parameter: float) -> str:
        """Return the value that varies and the level, for messages.  Local."""
        if self.varies == "level":
            return f"level {parameter:.4g} N"
        return f"the value {parameter:.4g} at level {self.level:.4g} N"


@dataclass(frozen=True, eq=False, kw_only=True)
class FromSolution(LinearResponse):
    """The linear response of a problem, except at the value at which a solution is known."""

    solution: Iterate

    def at(self, parameter: float) -> Iterate:
        """Return the solution at its own value of the parameter, the linear response at others.  Local."""
        if parameter != self.solution.parameter:
            return super().at(parameter)
        return self.solution.on(self.problem.equation.harmonics)


def peaks_of(
    problem: ForcedResponse, branch: Branch, tolerance: float, sensitivities: bool = False, curve: LinearCurve | None = None
) -> list[Peak]:
    """Return every maximum of every output on a branch, to the solver's tolerance, by output and place.  Collective.

    A maximum has lower neighbours on both sides; the end of the range is none.  With the linear ``curve``, its maxima between two
    points at which all pairs stick are included.  With ``sensitivities`` the peaks have the derivatives of amplitude, phase and
    frequency.
    """
    tops = [Top(output, (i - 1, i + 1), i) for output, i in maxima(branch)]
    if curve is not None:
        tops += on_root(problem.equation.comm, between_points, branch, curve)
    tops += hidden(problem, branch, curve)
    tops.sort(key=lambda top: (top.output, top.between))
    forward, solved = AdjointSolver(problem.equation.comm, EXACT, np.float64), list[tuple[Top, tuple[Peak, Iterate]]]()

    def add(top: Top, near: Iterate | None = None) -> None:
        peak = peak_about(problem, branch, top, tolerance, forward, sensitivities, near)
        if peak is not None and not any(is_same(problem.equation, peak, other) for _, other in solved):
            solved.append((top, peak))

    try:
        for top in tops:
            add(top)
        for top, (peak, there) in [each for each in solved if each[1][0].within > 0.0]:
            for other in others_at_corner(problem, branch, top, there, [peak for _, (peak, _) in solved]):
                add(other, there)
    finally:
        forward.destroy()
    return [peak for _, (peak, _) in sorted(solved, key=lambda each: (each[0].output, each[0].between))]


def others_at_corner(problem: ForcedResponse, branch: Branch, top: Top, there: Iterate, solved: list[Peak]) -> list[Top]:
    """Return the tops of other outputs at a corner, where they exceed both ends of its interval, without ``solved`` ones in it.

    Collective.  A maximum at a corner may be narrow, and no point beside it shows it.
    """
    ends = [branch.points[k] for k in top.between]
    equation, at = equation_at(branch.points[top.point], problem.equation, there.harmonics), problem.at(there.parameters)
    sizes = np.abs(outputs_at(equation, at, equation.contact_forces(there.U, equation.every_pair, tangents=False)))

    def higher() -> list[int]:
        low, high = sorted(end.omega for end in ends)
        known = {peak.output for peak in solved if low <= peak.omega <= high}
        of_ends = np.max([np.hypot(*end.response[:, 1:3].T) for end in ends], axis=0)
        return [int(output) for output in np.flatnonzero(sizes > (1.0 + SAME) * of_ends) if output not in known]

    return [replace(top, output=output, omega=None) for output in on_root(equation.comm, higher)]


def is_same(equation: HarmonicBalance, a: tuple[Peak, Iterate], b: tuple[Peak, Iterate]) -> bool:
    """Return whether two peaks are the same, as where a branch is traced back.  Collective."""
    (p, at_p), (q, at_q) = a, b
    differs = abs(abs(p.amplitude) - abs(q.amplitude)) > SAME * abs(q.amplitude)
    if p.output != q.output or differs or abs(p.omega - q.omega) > SAME * q.omega:
        return False
    U, V = (there.U[..., there.harmonics.vibration] for there in (at_p, at_q.on(at_p.harmonics)))
    distance, size = equation.agreed_sum(np.array([np.sum((U - V) ** 2), np.sum(U**2)]))
    return bool(distance <= SAME_MOTION**2 * size)


@dataclass(frozen=True, eq=False)
class PeakPath:
    """A peak of an output, followed over a number of the operating point.

    Attributes
    ----------
    varies : "level" [N], "damping" (a factor) or a parameter of the contact law
    sweep : range of that number, from an end where all pairs stick or near to it; values in ``at`` are points
    stuck : the peak of the linear response
    level, damping : N and factor, where they do not vary
    begins : the peak at the begin of the range, where the linear response is not near
    is_homotopy : on the way to a first point, which has other ways
    """

    varies: str | LawParameter
    sweep: Sweep
    stuck: Peak
    level: float = 1.0
    damping: float = 1.0
    begins: Iterate | None = None
    is_homotopy: bool = False

    @property
    def begin(self) -> OperatingPoint:
        """The operating point at the begin, without a frequency."""
        return with_value(self.varies, self.sweep.start, OperatingPoint(0.0, self.level, damping=self.damping))


def follow_peak(
    equation: HarmonicBalance,
    path: PeakPath,
    tolerance: float,
    *,
    estimator: ErrorEstimator | None = None,
    accuracy: Accuracy | None = None,
    on_point: Emit = nobody,
    until: Callable[[Point], bool] = lambda point: False,
    checkpointer: Checkpointer = NO_CHECKPOINTS,
) -> Branch:
    """Return the peak of an output over a number of the operating point, as one branch.  Collective.

    It ends where the maximum merges with a minimum of the curve; only there would the branch turn back, as a minimum.

    Parameters
    ----------
    equation : with the pairs' law and samples
    estimator, accuracy : error bars, destroyed at the end; the accuracy that chooses harmonics and samples
    on_point : called with each point
    until : ends the branch at a point
    checkpointer : of this branch

    Returns
    -------
    branch : ``parameters`` of a point are the number and the frequency [rad/s]; why it ends early is in ``failure``
    """
    stuck, is_lead = path.stuck, path.is_homotopy and path.begins is None  # no point of a lead is recorded
    row = MaximumByPhase(stuck.output, not turns(equation, stuck, path.begin), has_corners=not is_lead)
    problem = PeakOver(equation, path.varies, path.level, stuck.omega, stuck.width, row, path.begins, path.damping)
    steps = STEPS_OF_LEADS if path.is_homotopy else STEPS_OF_PEAKS
    task = BranchTask(problem, AllPairs(), path.sweep, steps, tolerance, estimator, accuracy, is_homotopy=path.is_homotopy)
    return follow_branch(task, MOST_POINTS, on_point, checkpointer=checkpointer, until=until)


def with_value(varies: str | LawParameter, value: float, at: OperatingPoint) -> OperatingPoint:
    """Return an operating point with another value of "level", "damping" or a parameter of the contact law."""
    if isinstance(varies, LawParameter):
        return replace(at, law=((varies, value),))
    return replace(at, level=value) if varies == "level" else replace(at, damping=value)


def turns(equation: HarmonicBalance, stuck: Peak, begin: OperatingPoint) -> bool:
    """Return whether the phase of the pairs' linear motion changes along a peak, by a quarter of a cycle as for one mode.

    Collective.  ``begin`` is the operating point without frequency and level.
    """
    equation, columns = equation.under(begin), equation.harmonics.columns(1)
    at = [replace(begin, omega=stuck.omega + half, level=1.0) for half in (-0.5 * stuck.width, 0.5 * stuck.width)]
    below, above = (to_complex(equation.linear_motion(point).reshape(-1, equation.model.N_H)[:, columns]) for point in at)
    return abs(np.angle(equation.comm.allreduce(complex(np.vdot(above, below))))) > TURNED


def peak_about(
    problem: ForcedResponse,
    branch: Branch,
    top: Top,
    tolerance: float,
    forward: AdjointSolver,
    sensitivities: bool = False,
    near: Iterate | None = None,
) -> tuple[Peak, Iterate] | None:
    """Return the maximum of an output about a top of a branch, or about a solution ``near`` it, and its motion.  Collective.

    If the search fails, the point of the top; None if no point shows the top and no higher solution is reached.

    With the harmonics and samples of the point; its mean slip is regularised if it was at the point.
    """
    output, point = top.output, branch.points[top.point]
    harmonics = harmonics_of(branch, point, problem.equation.harmonics)
    equation = equation_at(point, problem.equation, harmonics)
    before, start, after = (iterate_of(branch.points[k], problem, harmonics) for k in (top.between[0], top.point, top.between[1]))
    solved, ends = start, [float(np.hypot(*branch.points[k].response[output, 1:3])) for k in top.between]
    if top.omega is not None:
        start = replace(start, U=equation.linear_motion(problem.at((top.omega,))), parameters=(top.omega,))
    around = [there.parameter for there in (before, start, after)]
    within, workspace, every = max(around) - min(around), Workspace(equation), equation.every_pair
    try:
        sweep = Sweep(point.omega, point.omega + within)
        solver = PointSolver(problem.with_equation(equation), AllPairs(), sweep, tolerance, workspace)
        rises = equation.comm.bcast(top.point == top.between[int(np.argmin(ends))])  # from this end into the step
        if near is not None:
            start = near
        elif top.is_hidden and rises:
            row = climbed(solver, output, start, after if top.point == top.between[0] else before)
            if row is None:
                return None
            before, start, after = row
        scaling = solver.scaling(solver.norm(start.U) or 1.0, solver.force(start, every))
        system = BorderedSystem(solver.problem, (), scaling, every)
        corrector = workspace.corrector(equation, solver.resolution)
        solution = Maximum(output, 0, forward, (before, after)).correct(corrector, system, start)
        there, newton, within = (solved, 0, within) if solution.failure else (solution.iterate, solution.newton, solution.within)
        forces, at = equation.contact_forces(there.U, every, tangents=False), problem.at(there.parameters)
        amplitude = complex(outputs_at(equation, at, forces)[output])
        is_higher = equation.comm.bcast(abs(amplitude) > (1.0 + tolerance) * max(ends))
        if (top.is_hidden or near is not None) and (solution.failure or not is_higher):
            return None
        width = half_power_width(branch, output, top.between, at.omega, abs(amplitude))
        derivatives = about_a_peak(solver, there, output, width, within) if sensitivities else (None, None)
    finally:
        workspace.destroy()
    slipping = int(np.count_nonzero(equation.gather(forces.state) != STICK))
    return Peak(output, at.omega, amplitude, width, within, slipping, newton, point.segment, *derivatives), there


def climbed(solver: PointSolver, output: int, here: Iterate, other: Iterate) -> list[Iterate] | None:
    """Return the last three of solutions from one towards another, of which the output is highest at the second.  Collective.

    At fixed frequencies, at first each twice as far as the one before.  None without them.
    """
    problem, equation, every = solver.problem, solver.equation, solver.equation.every_pair
    size, force, sizes, row = solver.norm(here.U) or 1.0, solver.force(here, every), list[float](), [here]
    for share in SHARES_OF_STEP:
        omega = here.parameter + share * (other.parameter - here.parameter)
        guess = interpolate(row[-2], row[-1], omega) if len(row) > 1 else replace(here, parameters=(omega,))
        solution, _ = solver.solve_at(guess, size, every, force)
        if solution.failure:
            return None
        row.append(solution.iterate)
        sizes = [abs(output_at(equation, problem.at(there.parameters), there.U, every, output)) for there in row[-3:]]
        if len(row) > 2 and sizes[0] < sizes[1] > sizes[2]:
            return row[-3:]
    return None


def about_a_peak(
    solver: PointSolver, there: Iterate, output: int, width: float, within: float
) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
    """Return the derivatives of amplitude, phase and frequency [Hz] of a peak, (3, n_numbers, n_pairs) and (3, n_common).

    Collective.  docs/theory.md, eq. (11.7): from those of two solutions, one on each side, at a small fraction of the
    half-power ``width`` [rad/s].  None unless the amplitude rises at the first and falls at the second.
    """
    every, n_out = solver.equation.every_pair, solver.equation.model.n_outputs
    rows, size, force = [output, n_out + output], solver.norm(there.U) or 1.0, solver.force(there, every)

    def solved(near: Iterate, omega: float) -> Iterate | None:
        """Return the solution at a frequency, from the peak and another solution on that side."""
        guess = Iterate(there.U, (omega,), there.harmonics) if near is there else interpolate(there, near, omega)
        solution, _ = solver.solve_at(guess, size, every, force)
        return None if solution.failure else solution.iterate

    def rates(at: Iterate) -> np.ndarray | None:
        """Return the derivatives of amplitude and phase, those of pairs first, (2, n_numbers n_pairs + n_common)."""
        point, equation = solver.problem.at(at.parameters), solver.equation
        sensitivities = sensitivities_of(equation, point, at.U, every, solver.workspace.adjoints(equation))
        p = equation.full_force(equation.contact_forces(at.U, every, tangents=False))
        cos, sin = output_amplitude(equation.model_at(point), point, p)[rows]
        d = np.concatenate([sensitivities.of_pairs[rows].reshape(2, -1), sensitivities.common[rows]], axis=1)
        return equation.comm.bcast(np.stack(of_size(cos, sin, *d))) if sensitivities.is_solved else None

    unit, brackets = width if np.isfinite(width) else 0.02 * there.parameter, list[list[np.ndarray]]()
    sides, way, middle = (there, there), ASIDE * unit, rates(there)
    while way <= FARTHER * unit * (1.0 + 1e-9):
        low, high = (solved(side, there.parameter + sign * way) for side, sign in zip(sides, (-1.0, 1.0)))
        if low is None or high is None:
            break
        both = [rate for rate in map(rates, (low, high)) if rate is not None]
        if len(both) == 2 and both[0][0, -1] > 0.0 > both[1][0, -1] and 2.0 * way > within:
            brackets.append(both)
        sides, way = (low, high), way * FARTHER_BY
    if middle is None or not brackets:
        return None, None
    rising, falling = brackets[0]
    share = rising[0, -1] / (rising[0, -1] - falling[0, -1])
    near, shift = ((high[0] - low[0]) / (low[0, -1] - high[0, -1]) for low, high in (brackets[-2:] * 2)[:2])
    if solver.equation.n_samples >= MANY_SAMPLES:
        shift += (near - shift) * FARTHER_BY**2 / (FARTHER_BY**2 - 1.0)
    at_peak = middle if within == 0.0 else (1.0 - share) * rising + share * falling
    d = np.stack([at_peak[0], at_peak[1] + at_peak[1, -1] * shift, shift / (2.0 * np.pi)])
    d[:, -1] = 0.0
    return d[:, : -len(COMMON)].reshape(3, len(NUMBERS), -1), d[:, -len(COMMON) :]


def half_power_width(branch: Branch, output: int, between: tuple[int, int], omega: float, amplitude: float) -> float:
    """Return the width [rad/s] of a peak between two points of a branch, between the places of the curve at 1 / sqrt 2 of it.

    Local.  From the peak, at ``omega``, on, (|a*|^2 / |a|^2 - 1)^1/2 is taken along straight lines between the points, as it is
    proportional to the distance from the resonance of one mode.  NaN where the curve ends or rises before it is so low.
    """
    sides = []
    for way, i in zip((-1, 1), between):
        k, before = i, (omega, 0.0)
        while 0 <= k < len(branch.points) and branch.points[k].segment == branch.points[i].segment:
            lower = float(np.hypot(*branch.points[k].response[output, 1:3]))
            if lower > (1.0 + SAME) * amplitude:
                break
            here = branch.points[k].omega, np.sqrt(max((amplitude / lower) ** 2 - 1.0, 0.0)) if lower > 0.0 else np.inf
            if here[1] >= 1.0:
                share = (1.0 - before[1]) / (here[1] - before[1])
                sides.append(before[0] + share * (here[0] - before[0]))
                break
            if here[1] < before[1] and k != i:
                break
            before, k = here, k + way
    return abs(sides[1] - sides[0]) if len(sides) == 2 else float("nan")
