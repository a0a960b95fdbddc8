"""Peaks over a number of the scene: from each peak of the linear response through the requested range."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from ..error_estimate.estimate import ErrorEstimator
from ..fourier.amplitudes import to_complex
from ..harmonic.balance import HarmonicBalance
from ..harmonic.operating_point import LawParameter, OperatingPoint
from ..messages.errors import CaseError
from ..points.branch import SEGMENTS, Branch, Point
from ..points.peak import Peak
from ..points.sweep import Sweep
from ..receptance.motions import linear_motion, output_motion
from ..receptance.reduced_model import ReducedModel
from .accuracy import Accuracy, accuracy_of
from .branch_points import harmonics_of, iterate_of
from .checkpointer import NO_CHECKPOINTS, Checkpointer, finished_or
from .follow import follow_branch
from .iterate import Iterate
from .levels import ResponseProblem, linear_curve, most_points
from .peaks import PeakPath, follow_peak, nobody, with_value
from .problems import ForcedResponse
from .resonances import FAINT_PEAK
from .tops import maxima

STUCK = 0.9  # of the level from which the first pair slips at a linear peak: all stick there
UNDAMPED = 1e-7  # damping ratio of a linear peak below which it counts as undamped: its width is that of the samples
UNBOUNDED = "the peak is infinite while all pairs stick, as nothing damps it: it is not followed; state [damping]"
BEYOND = 1e-2  # of the last value of a curve that ends early, beyond which the response shows why
NEAR = 0.25  # of the linear half-power width, within which a maximum there is the same one
LEAST = 1e-3  # of the level, at which a peak begins if some pairs slip or are open at every level


@dataclass(frozen=True, eq=False)
class PeakRequest:
    """A number over which the peaks of an output are followed."""

    varies: str | LawParameter  # "level" [N], "damping" as a factor, or a number of the contact law
    range: tuple[float, float]  # in its unit, from the first to the second
    at: tuple[float, ...]  # values that must be points
    output: int
    level: float  # N, where it does not vary

    @property
    def begin(self) -> OperatingPoint:
        """The operating point at the begin of the range, without its frequency."""
        return with_value(self.varies, self.range[0], OperatingPoint(0.0, self.level))


@dataclass(frozen=True, eq=False)
class PeakCurve:
    """One peak over a number: ``parameters`` of a point of the branch are that number and the frequency [rad/s]."""

    linear: Peak  # with all pairs stuck at the begin of the range, amplitude per newton
    branch: Branch

    def damping_ratio(self, point: Point) -> float:
        """Return the damping ratio [-] of one mode with this peak's amplitude for its level, eq. (7.10).  Local, on rank 0."""
        size = float(np.hypot(*point.response[self.linear.output, 1:3]))
        level = self.branch.level or point.parameters[0]
        return self.linear.damping * abs(self.linear.amplitude) * level / size * (self.linear.omega / point.omega) ** 2


def peak_curves(
    of: ResponseProblem,
    request: PeakRequest,
    on_point: Callable[[Point], None] = nobody,
    checkpointer_of: Callable[[int], Checkpointer] = lambda peak: NO_CHECKPOINTS,
) -> list[PeakCurve]:
    """Return the curve of every linear peak of an output over a number, each with its checkpointer.  Collective.

    A curve that ends early has the reason in the ``failure`` of its branch.

    Raises
    ------
    CaseError : the output has no linear peak in the range of frequencies, or the law does not have the values of the range
    """
    peaks = beginnings(of, request)
    tops = cache(partial(tops_at_begin, of, request))

    def curve(k: int) -> PeakCurve:
        checkpointer = checkpointer_of(k)

        def follow() -> Branch:
            return _follow(of, request, peaks[k], lambda: top_of_peak(tops(), peaks, k), on_point, checkpointer)

        # no points: the search for the first one failed, and is repeated
        return PeakCurve(peaks[k], finished_or(checkpointer, follow, on_point, stores_empty=False))

    return [curve(k) for k in range(len(peaks))]


def beginnings(of: ResponseProblem, request: PeakRequest) -> list[Peak]:
    """Return the linear peaks of an output at the begin of a range.  Collective.

    Raises
    ------
    CaseError : as :func:`peak_curves`
    """
    equation = of.at_level(request.level).equation
    if isinstance(request.varies, LawParameter):
        for value in request.range:
            try:
                equation.under(OperatingPoint(0.0, request.level, law=((request.varies, value),)))
            except ValueError as why:
                raise CaseError(f"[[response.over]] range: {value:g} is no value that the law of these pairs has: {why}") from why
    peaks = linear_peaks(of, equation.under(request.begin).model_at(request.begin), request.output)
    if not peaks:
        low, high = (end / (2.0 * np.pi) for end in sorted((of.sweep.start, of.sweep.stop)))
        raise CaseError(
            f"[[response.over]]: output {request.output + 1} has no peak between {low:.6g} and {high:.6g} Hz while all pairs "
            "are closed and stick, those open at rest, too; widen [response] frequencies, or name another output"
        )
    return peaks


def _follow(
    of: ResponseProblem,
    request: PeakRequest,
    stuck: Peak,
    top: Callable[[], Iterate | None],
    on_point: Callable[[Point], None],
    checkpointer: Checkpointer,
) -> Branch:
    """Return the curve of one peak, from its last checkpoint if there is one.  Collective.

    It begins at the ``top`` of the curve at the begin of the range if no peak over the level reaches that.
    """
    equation, varies = of.at_level(request.level).equation, request.varies
    level = 0.0 if varies == "level" else request.level
    if stuck.damping < UNDAMPED:
        return Branch(level, failure=UNBOUNDED)
    begins, why = peak_at_begin(of, request, stuck, top)
    if why is not None:
        return Branch(level, failure=why)
    estimator, accuracy = _error_bars(of, equation)
    path = PeakPath(varies, Sweep(*request.range, request.at, may_miss=True), stuck, request.level, begins=begins)
    branch = follow_peak(
        equation,
        path,
        of.settings.tolerance,
        estimator=estimator,
        accuracy=accuracy,
        on_point=on_point,
        checkpointer=checkpointer,
    )
    branch.level = level
    if branch.failure is not None and branch.points:
        branch.failure += beyond_the_end(of, request, stuck, branch.points[-1])
    return branch


def _error_bars(of: ResponseProblem, equation: HarmonicBalance) -> tuple[ErrorEstimator | None, Accuracy | None]:
    """Return the error bars of a curve of peaks, and the accuracy that chooses its harmonics and samples.  Collective."""
    if of.enriched is None:
        return None, None
    accuracy = accuracy_of(of.settings, equation)
    return ErrorEstimator(of.enriched), accuracy and replace(accuracy, chooses_steps=False)


def beyond_the_end(of: ResponseProblem, request: PeakRequest, stuck: Peak, last: Point) -> str:
    """Describe the response beyond the ``last`` peak of a curve that ends early, for its message.  Collective."""
    (begin, end), (value, omega) = request.range, last.parameters
    step = BEYOND * abs(value)
    beyond = min(value + step, end) if end > begin else max(value - step, end)
    places = np.array([top.parameters[1] for _, top in tops_at_begin(of, replace(request, range=(beyond, end)))])
    if not len(places):
        return ""
    near, hertz = places[np.argmin(np.abs(places - omega))], 2.0 * np.pi
    if abs(near - omega) < NEAR * stuck.width:
        return f"; 1 % beyond, the response has a maximum near by, at {near / hertz:.5g} Hz: begin another range there"
    at = ", ".join(f"{place / hertz:.5g}" for place in places)
    return (
        f"; 1 % beyond, the response has maxima only at {at} Hz: the one followed, last at {omega / hertz:.5g} Hz, "
        "has met a minimum and exists no longer"
    )


def peak_at_begin(
    of: ResponseProblem, request: PeakRequest, stuck: Peak, top: Callable[[], Iterate | None]
) -> tuple[Iterate | None, str | None]:
    """Return a peak at the begin of a range, where pairs slip there, or why there is none.  Collective.

    It is followed over the level from stick, or is the ``top`` of the curve where that fails.
    """
    begin, equation = request.begin, of.at_level(request.level).equation.under(request.begin)
    sticks = STUCK * slips_from(equation, stuck.omega, begin.damping)
    if sticks >= begin.level:
        return None, None
    way = Sweep(max(sticks, LEAST * begin.level), begin.level)
    lead = follow_peak(equation, PeakPath("level", way, stuck, damping=begin.damping, is_homotopy=True), of.settings.tolerance)
    begins = top() if lead.failure else _arrived(lead, ForcedResponse(equation, begin.level), request)
    why = f"on the way up to {begin.level:g} N: {lead.failure}; nor has the curve there a peak that belongs to this one"
    return begins, why if begins is None else None


@dataclass(frozen=True, eq=False)
class _AtBegin(ForcedResponse):
    """The response at the begin of a range."""

    damping: float  # -, factor

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        return replace(super().at(parameters), damping=self.damping)


def tops_at_begin(of: ResponseProblem, request: PeakRequest) -> list[tuple[float, Iterate]]:
    """Return amplitudes and motions of the maxima of the output on the response at the begin of a range, by rising frequency.

    Collective.
    """
    at, equation = request.begin, of.at_level(request.level).equation
    problem = _AtBegin(equation.under(at), at.level, at.damping)
    task = replace(of.task(at.level), problem=problem, sweep=replace(of.sweep, at=()))
    branch = follow_branch(task, most_points(of.settings.points))
    if branch.failure is not None:
        back = follow_branch(replace(task, sweep=task.sweep.reverse), most_points(of.settings.points), segment=1)
        branch = branch.with_segment(back, SEGMENTS[1])
    points = [branch.points[i] for output, i in maxima(branch) if output == request.output]
    motions = [iterate_of(point, problem, harmonics_of(branch, point, equation.harmonics)) for point in points]
    tops = [
        (float(np.hypot(*point.response[request.output, 1:3])), replace(there, parameters=(request.range[0], point.omega)))
        for point, there in zip(points, motions)
    ]
    return sorted(tops, key=lambda top: top[1].parameters[1])


def top_of_peak(tops: list[tuple[float, Iterate]], peaks: list[Peak], k: int) -> Iterate | None:
    """Return the top of a curve that belongs to the ``k``-th linear peak; None where none does.  Local.

    As many tops as peaks correspond in order.  Otherwise a peak has the highest top between the previous peak and itself: slip
    and gaps only lower a frequency.
    """
    if len(tops) == len(peaks):
        return tops[k][1]
    below, own = peaks[k - 1].omega if k > 0 else 0.0, peaks[k].omega
    between = [top for top in tops if below < top[1].parameters[1] <= own + peaks[k].width]
    return max(between, key=lambda top: top[0])[1] if between else None


@dataclass(frozen=True, eq=False)
class PeakAt:
    """The peak of an output at a level."""

    curve: PeakCurve  # of one point; of none if the search failed, with the reason in ``failure`` of the branch
    there: Iterate | None  # its motion, the guess for a peak near by

    @property
    def linear(self) -> Peak:
        """The peak with all pairs stuck, amplitude per newton."""
        return self.curve.linear


def peak_at(of: ResponseProblem, output: int, level: float, near: PeakAt | None = None) -> PeakAt:
    """Return the peak of an output at a level, with its error bar: from a peak near by, else as a curve of peaks begins.

    Collective.  Of several peaks it is the largest of the linear response, or the one whose linear peak is next to that of
    ``near``.  A point that Newton's method does not find from there is searched for as without it.

    Raises
    ------
    CaseError : the output has no peak in the range of frequencies
    """
    request = PeakRequest("level", (level, 2.0 * level), (), output, level)
    peaks, equation = beginnings(of, request), of.at_level(level).equation
    stuck = (
        max(peaks, key=lambda peak: abs(peak.amplitude))
        if near is None
        else min(peaks, key=lambda peak: abs(peak.omega - near.linear.omega))
    )
    begins = None if near is None else near.there
    is_near = begins is not None
    if begins is None:
        k = peaks.index(stuck)
        begins, why = peak_at_begin(of, request, stuck, lambda: top_of_peak(tops_at_begin(of, request), peaks, k))
        if why is not None:
            return PeakAt(PeakCurve(stuck, Branch(level, failure=why)), None)
    estimator, accuracy = _error_bars(of, equation)
    path = PeakPath("level", Sweep(level, 2.0 * level), stuck, level, begins=begins, is_homotopy=is_near)
    branch = follow_peak(equation, path, of.settings.tolerance, estimator=estimator, accuracy=accuracy, until=lambda point: True)
    if branch.failure is not None and near is not None and is_near:
        return peak_at(of, output, level, replace(near, there=None))
    there = None
    if branch.points:
        there = iterate_of(
            branch.points[0], ForcedResponse(equation, level), harmonics_of(branch, branch.points[0], equation.harmonics)
        )
    branch.level = level
    return PeakAt(PeakCurve(stuck, branch), there)


def _arrived(lead: Branch, problem: ForcedResponse, request: PeakRequest) -> Iterate:
    """Return the end of a branch over the level as the first point of a curve.  Collective."""
    there = iterate_of(lead.points[-1], problem, harmonics_of(lead, lead.points[-1], problem.equation.harmonics))
    return replace(there, parameters=(request.range[0], lead.points[-1].omega))


# -- the linear response -----------------------------------------------------------------------------------------------


def linear_peaks(of: ResponseProblem, model: ReducedModel, output: int) -> list[Peak]:
    """Return the peaks of an output of a model while all pairs stick, per newton, by rising frequency.  Collective."""
    curve = of.curve if model is of.model else linear_curve(model, of.sweep)
    none = np.zeros((3 * model.n_pairs, model.N_H))

    def harmonic(omega: float) -> complex:
        cos, sin = output_motion(model, 1.0, omega, none)[output, model.harmonics.columns(1)]
        return complex(cos, -sin)

    sizes = np.hypot(*curve.response[:, output, 1:3].T)
    tops = 1 + np.flatnonzero((sizes[1:-1] > sizes[:-2]) & (sizes[1:-1] >= sizes[2:]) & (sizes[1:-1] > FAINT_PEAK * sizes.max()))
    peaks = []
    for i in tops:
        omega = _top(lambda w: abs(harmonic(w)), *curve.omega[[i - 1, i + 1]])
        width = _width(lambda w: abs(harmonic(w)), omega, curve.omega, sizes, i)
        peaks.append(Peak(output, omega, harmonic(omega), width, 0.0, 0, 0))
    return model.comm.bcast(peaks)


def _top(size: Callable[[float], float], low: float, high: float) -> float:
    """Return where an amplitude is highest between two frequencies."""
    from scipy.optimize import minimize_scalar  # slow import, seldom needed

    least = minimize_scalar(lambda w: -size(w), bounds=(low, high), method="bounded", options={"xatol": 1e-6 * (high - low)})
    return float(least.x)


def _width(size: Callable[[float], float], omega: float, omegas: np.ndarray, sizes: np.ndarray, i: int) -> float:
    """Return the half-power width of a peak near the ``i``-th frequency of a curve; twice one half without the other."""
    from scipy.optimize import brentq  # slow import, seldom needed

    half, sides = size(omega) / np.sqrt(2.0), []
    for below in (np.flatnonzero(sizes[:i] < half)[-1:], i + np.flatnonzero(sizes[i:] < half)[:1]):
        if len(below):
            end = float(omegas[below[0]])
            sides.append(abs(omega - brentq(lambda w: size(w) - half, *sorted((end, omega)))))
    return float(np.sum(sides) * (2.0 / len(sides))) if sides else 1e-3 * omega


def slips_from(equation: HarmonicBalance, omega: float, damping: float = 1.0) -> float:
    """Return the level [N] from which the first pair slips at a frequency; infinite where none does.  Collective."""
    model = equation.model_at(OperatingPoint(omega, 1.0, damping=damping))
    U = np.abs(to_complex(linear_motion(model, 1.0, omega))).sum(axis=1).reshape(-1, 3)
    used = float(np.max(equation.law.utilisation(U), initial=0.0))
    used = max(equation.comm.allgather(used))
    return 1.0 / used if used > 0.0 else np.inf
