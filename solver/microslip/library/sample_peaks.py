"""Peaks of samples of a scene's numbers; the structure is rebuilt only for numbers that change it.

The scene itself is solved first, along its curve.  Each sample begins at its peak as the samples solved so far have it, and only
where Newton's method does not come from there to the peak the curve of the sample is followed.  The peak does not depend on where
the search began (continuation/peak_at.py).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..contact.law import OPEN, SLIP, STICK
from ..continuation.acceptance import judged
from ..continuation.accuracy import Memory, Resolution, accuracy_of
from ..continuation.branch_points import harmonics_of, iterate_of
from ..continuation.corrector import Correction
from ..continuation.iterate import Iterate
from ..continuation.levels import ResponseProblem, follow_level, linear_curve
from ..continuation.peak_at import PeakPoint, Starts, peak_near
from ..continuation.peak_curves import linear_peaks
from ..continuation.point_record import HELD, point_record
from ..continuation.problems import ForcedResponse
from ..continuation.ways_out import MOSTLY
from ..error_estimate.estimate import ErrorEstimator
from ..fourier.harmonics import Harmonics
from ..harmonic.mean_slip import is_held_by_its_joint_alone
from ..harmonic.operating_point import LawParameter, OperatingPoint
from ..messages.errors import CaseError, ConvergenceError
from ..messages.words import hint, listed
from ..observe.log import RunLog
from ..points.branch import Branch, Point
from ..points.error_parts import total
from ..points.peak import Peak
from ..points.selection import AllPairs
from ..receptance.reduced_model import ReducedModel
from ..scene.overrides import words_of
from ..scene.schema import Scene
from .build import Structure, WholeStructure, build
from .peak_curves import number_of_joint
from .prepare import Prepared, prepare
from .respond import prepared_with, scene_with, with_modes_for
from .settings import n_sectors_of, number_of_output, reduction_settings, refuse_statics
from .varied import Varied, as_keys, load_factors, of_joints

DONE, FAILED, OUTSIDE, MISSING = "done", "failed", "outside", "missing"
NEIGHBOURS = 3  # samples, in addition to one for each number and the scene, from which a motion is interpolated
MOST_BETWEEN = 12  # peaks tried on the way from the nearest sample to one that Newton's method does not reach
MOST_WEIGHT = 3.0  # sum of the sizes of their weights, beyond which only the nearest is used
CURVE_POINTS = 201  # frequencies of the curves of samples
UNKNOWN_WIDTH = 0.02  # of a peak over its frequency, where none of the linear response is in the range
BAR_NOTED = 2.0  # times a stated accuracy, from which the error bar of a peak is noted
NO_WIDTH = "half-power width not found"
NO_PEAK = "its amplitude has no maximum between the ends of [response] frequencies; widen them, or state another level"
NAN = float("nan")

Law = tuple[tuple[LawParameter, float], ...]


@dataclass(frozen=True)
class Sample:
    """The peak of one sample; the same on every rank."""

    values: tuple[float, ...]
    status: str = DONE  # or FAILED, OUTSIDE: the scene does not allow the values
    why: str = ""  # it has no peak, or the notes of its point
    amplitude: float = NAN  # of harmonic 1, in the unit of the output
    phase: float = NAN  # rad
    frequency: float = NAN  # Hz
    width: float = NAN  # Hz, between the solutions at 1 / sqrt 2 of the amplitude
    damping: float = NAN  # -, of one mode with this amplitude for its level; NaN without a linear peak in the range
    friction_J: float = NAN  # loss a cycle
    damping_J: float = NAN
    error: float = NAN  # error bar of the amplitude
    slipping: int = 0  # pairs
    open: int = 0
    newton: int = 0  # iterations
    seconds: float = 0.0
    is_followed: bool = False  # its curve was, too
    curve: tuple[float, ...] = field(default=(), repr=False)  # amplitudes at the frequencies of all curves; () without

    def as_texts(self) -> dict[str, Any]:
        """Return it as JSON can represent it."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @classmethod
    def from_texts(cls, texts: dict[str, Any]) -> Sample:
        """Return the sample of the texts by ``as_texts``.

        Raises
        ------
        TypeError, KeyError : they are of no sample
        """
        return cls(**(texts | {"values": tuple(texts["values"]), "curve": tuple(texts["curve"])}))


@dataclass(frozen=True, eq=False)
class _Problem:
    """A prepared sample: its response problem, with its law and stiffness, at its level."""

    of: ResponseProblem
    level: float
    resolution: Resolution

    def forced(self, held: bool) -> ForcedResponse:
        """Return the forced response of the sample in its resolution.  Local."""
        problem = self.of.at_level(self.level)
        equation = problem.equation.resolved(self.resolution.harmonics, self.resolution.n_samples)
        return problem.with_equation(equation.holding(np.zeros((equation.n_owned, 2)) if held else None))


def output_of(scene: Scene, name: str | None) -> int:
    """Return the number of an output, from 0, of a whole disc of any sector; that of the first one if None.  Local.

    Raises
    ------
    CaseError : the scene has no such output
    """
    output, names = number_of_output(scene, name), [output.name for output in scene.outputs]
    if output is None:
        sectors = f", each followed by a sector, 0 to {n - 1}" if (n := n_sectors_of(scene)) > 1 else ""
        raise CaseError(
            f"{scene.source}: sweep: there is no output {name!r}{hint(str(name), names)}; there are {listed(names)}{sectors}"
        )
    return output


class SamplePeaks:
    """The peaks of samples on the ranks of a structure.  All methods are collective on ``structure.comm``.

    Parameters
    ----------
    structure : of the scene; stays open
    varied : the numbers that vary
    output : its name; the first one if None
    spread : (n_keys,) of the samples, by which their distances are measured
    has_curves : whether the curve of each sample is computed, too

    Raises
    ------
    CaseError : no such output, nothing that vibrates, no peak of the scene itself in the range; on every rank
    ConvergenceError, ResourceError : the curve of the scene itself; on every rank
    """

    def __init__(
        self,
        structure: Structure,
        varied: Varied,
        output: str | None = None,
        spread: np.ndarray | None = None,
        has_curves: bool = False,
        log: RunLog | None = None,
    ):
        scene = structure.scene
        refuse_statics(scene, "sweep")
        self.reference, self.varied, self.output = structure, varied, output_of(scene, output)
        self.log = log or RunLog(structure.comm, screen=False)
        self.spread = np.ones(len(varied.keys)) if spread is None else np.where(spread > 0.0, spread, 1.0)
        self.has_curves = has_curves
        self._built: tuple[Any, Structure] = ((), structure)
        self._prepared: tuple[Any, Prepared] | None = None
        self.solved: list[tuple[np.ndarray, Starts, bool]] = []  # values, motions, whether the mean slip is held
        self._loose: tuple[ReducedModel, bool] | None = None  # whether only the joint supports a body of a model
        for i in np.flatnonzero(varied.is_factor):  # of no pair of the joint: reported before anything is solved
            number_of_joint(scene, structure.pairs, *words_of(varied.keys[i])[1:])
        self.nominal = self._solve_nominal()

    def close(self) -> None:
        """Free the structure that was built for samples.  Collective."""
        if self._built[1] is not self.reference:
            self._built[1].close()
        self._built, self._prepared = ((), self.reference), None

    # -- the scene itself --------------------------------------------------------------------------------------------

    def _solve_nominal(self) -> Sample:
        """Return the peak of the scene itself, from its curve, which decides harmonics and samples where the scene does not."""
        began, scene = time.perf_counter(), self.reference.scene
        level = max(scene.response.levels)
        of = self._prepare(self.reference, scene, "nominal").response
        branch = follow_level(_alone(of), level)
        peak, held = highest_of(of, level, branch, self.output)
        if isinstance(peak, str):
            error = ConvergenceError if branch.failure else CaseError
            raise error(f"{scene.source}: sweep: the scene itself has no peak at {level:g}: {peak}")
        self.resolution = Resolution(peak[1], peak[2], of.settings.tolerance)
        near = peak[0][0].parameter
        linear = self._nearest_linear(of, near)
        self.target = near if linear is None else linear.omega
        self.grid = np.linspace(min(of.sweep.start, of.sweep.stop), max(of.sweep.start, of.sweep.stop), CURVE_POINTS)
        problem = _Problem(of, level, self.resolution)
        if of.model.n_pairs == 0:
            sample = self._of_linear(problem, self.varied.nominal, branch)
        else:
            sample = self._of_peak(problem, peak[0], self.varied.nominal, branch, held)
        if sample.status != DONE:
            raise ConvergenceError(f"{scene.source}: sweep: no peak of the scene itself at {level:g}: {sample.why}")
        return replace(sample, seconds=time.perf_counter() - began)

    # -- samples -----------------------------------------------------------------------------------------------------

    def solve(self, values: Sequence[float]) -> Sample:
        """Return the peak of a sample; one without a peak has the reason in ``why``.

        Raises
        ------
        ResourceError, Interrupted : on every rank
        """
        began, values = time.perf_counter(), tuple(map(float, values))
        try:
            sample = self._solved(values)
        except (CaseError, ConvergenceError) as problem:
            sample = Sample(values, FAILED, str(problem))
        return replace(sample, seconds=time.perf_counter() - began)

    def _solved(self, values: tuple[float, ...]) -> Sample:
        problem = self._problem(values)
        branch = None
        if self.has_curves:
            branch = follow_level(_alone(problem.of), problem.level)
        x = np.array(values)
        if problem.of.model.n_pairs == 0:
            return self._of_linear(problem, x, branch)
        sample = self._from_others(problem, x, branch)
        if sample.status == DONE:
            return sample
        problem, newton = self._problem(values), sample.newton
        branch = branch or follow_level(_alone(problem.of), problem.level)
        newton += sum(point.newton for point in branch.points)
        start, held = highest_of(problem.of, problem.level, branch, self.output)
        if isinstance(start, str):
            return Sample(values, FAILED, f"{sample.why}; along its curve: {start}", newton=newton, is_followed=True)
        sample = self._of_peak(problem, start[0], x, branch, held, near=start[0][0].parameter)
        return replace(sample, newton=newton + sample.newton, is_followed=True)

    def _from_others(self, problem: _Problem, x: np.ndarray, branch: Branch | None) -> Sample:
        """Return the sample at ``x`` from those solved, if necessary by way of samples half way from the nearest one."""
        to, newton, why = [x], 0, ""
        for _ in range(MOST_BETWEEN):
            is_last = len(to) == 1
            sample = self._from_near(problem, to[-1], branch if is_last else None, has_width=is_last)
            newton, why = newton + sample.newton, why or sample.why
            if sample.status == DONE:
                to.pop()
            elif (middle := self._halfway(to[-1])) is not None:
                to.append(middle)
            else:
                break
            if not to:
                return replace(sample, newton=newton)
            try:
                problem = self._problem(tuple(to[-1]))
            except (CaseError, ConvergenceError):
                break
        return Sample(tuple(x), FAILED, why, newton=newton)

    def _from_near(self, problem: _Problem, x: np.ndarray, branch: Branch | None, has_width: bool) -> Sample:
        """Return the sample at ``x`` from those around and from the nearest one."""
        newton, sample = 0, Sample(tuple(x), FAILED, "no sample near by")
        for starts, is_held in self._starts(x, problem.forced(False).equation.shape):
            held = is_held or self._is_held_at(problem, self._state(problem, starts[0]))
            sample = self._of_peak(problem, starts, x, branch, held, has_width)
            newton += sample.newton
            if sample.status == DONE:
                break
        return replace(sample, newton=newton)

    def _halfway(self, x: np.ndarray) -> np.ndarray | None:
        """Return numbers half way from the nearest sample, geometrically if positive; None if another structure is needed."""
        known = [at for at, *_ in self.solved if np.isfinite(at).all()]
        nearest = self.reference.comm.bcast(min(known, key=lambda at: np.linalg.norm((at - x) / self.spread), default=None))
        others = [i for i in range(len(x)) if i not in self.varied.having("law", "load", "level")]
        if nearest is None or not np.array_equal(nearest[others], x[others]):
            return None
        is_positive = (nearest > 0.0) & (x > 0.0)
        return np.where(is_positive, np.sqrt(np.abs(nearest * x)), 0.5 * (nearest + x))

    def _starts(self, x: np.ndarray, shape: tuple[int, int, int]) -> list[tuple[Starts, bool]]:
        """Return motions to begin from, of the samples around one and of the nearest one, and whether its mean slip is held."""
        known = [
            (at, starts, held) for at, starts, held in self.solved if starts[0].U.shape[:2] == shape[:2] and np.isfinite(at).all()
        ]
        comm = self.reference.comm
        if not comm.allreduce(int(bool(known))) == comm.size:
            return []
        places = (np.array([at for at, *_ in known]) - x) / self.spread
        order = np.argsort(np.linalg.norm(places, axis=1), kind="stable")[: 2 * len(x) + NEIGHBOURS]
        _, nearest, held = known[order[0]]
        weights = affine_weights(places[order])
        if weights is None:
            return [(nearest, held)]
        around = [known[i][1] for i in order]
        mean = (_mean(weights, [each[0] for each in around]), *(_side(weights, around, k) for k in (1, 2)))
        return [(mean, held), (nearest, held)]

    def _of_peak(
        self,
        problem: _Problem,
        starts: Starts,
        x: np.ndarray,
        branch: Branch | None,
        held: bool,
        has_width: bool = True,
        near: float | None = None,
    ) -> Sample:
        """Return the sample of the peak near some motions, and remember it for others.

        ``held``: the mean slip is held by springs at first; whether it is at the peak is decided there, as along a curve.
        ``near``: frequency [rad/s] that its linear peak is nearest to, by default that of the scene itself.
        """
        of, values = problem.of, tuple(map(float, x))
        linear = self._nearest_linear(of, near)
        width = UNKNOWN_WIDTH * starts[0].parameter if linear is None else linear.width

        def needs_width(point: Point) -> bool:
            return has_width and self._is_held_at(problem, point.state) == held

        peak = self._searched(problem, starts, width, held, needs_width)
        if isinstance(peak, str):
            return Sample(values, FAILED, peak)
        wanted = self._is_held_at(problem, peak.point.state)
        for hold in (wanted, held) if wanted != held else ():  # as it was where Newton's method fails
            other = self._searched(problem, (peak.iterate, *starts[1:]), width, hold, lambda point: has_width)
            if not isinstance(other, str):
                peak, held = replace(other, newton=peak.newton + other.newton), hold
                break
        if has_width:
            problem, peak = self._refined(problem, peak, width, held)
        low, high = sorted((of.sweep.start, of.sweep.stop))
        if not low <= peak.iterate.parameter <= high:
            f = peak.iterate.parameter / (2.0 * np.pi)
            return Sample(values, FAILED, f"its peak at {f:.6g} Hz lies outside [response] frequencies", newton=peak.newton)
        self.solved.append((x, peak.starts, held))
        return self._record(problem, peak.point, peak.width, peak.newton, linear, values, branch)

    def _of_linear(self, problem: _Problem, x: np.ndarray, branch: Branch | None) -> Sample:
        """Return the sample of a structure without pairs: the linear peak nearest to that of the scene itself.  Collective."""
        values, linear = tuple(map(float, x)), self._nearest_linear(problem.of, None)
        if linear is None:
            return Sample(values, FAILED, "its linear response has no peak in [response] frequencies")
        forced = problem.forced(False)
        equation, at = forced.equation, (linear.omega,)
        there = Iterate(equation.linear_motion(forced.at(at)), at, equation.harmonics)
        solution = Correction(there, 0, 0, 0.0, None), equation.every_pair
        estimator = None if problem.of.enriched is None else ErrorEstimator(problem.of.enriched)
        try:
            point, _ = point_record(forced, AllPairs(), solution, False, estimator)
        finally:
            if estimator is not None:
                estimator.destroy()
        return self._record(problem, point, linear.width, 0, linear, values, branch)

    def _searched(
        self, problem: _Problem, starts: Starts, width: float, held: bool, needs_width: Callable[[Point], bool]
    ) -> PeakPoint | str:
        """Return the peak near some motions, or why there is none."""
        estimator = None if problem.of.enriched is None else ErrorEstimator(problem.of.enriched)
        try:
            return peak_near(
                problem.forced(held), self.output, starts, width, problem.resolution.tolerance, estimator, needs_width
            )
        finally:
            if estimator is not None:
                estimator.destroy()

    def _refined(self, problem: _Problem, peak: PeakPoint, width: float, held: bool) -> tuple[_Problem, PeakPoint]:
        """Return the peak with as many harmonics and samples as a stated accuracy needs there, and the problem with these."""
        comm, output, memory = problem.of.model.comm, slice(self.output, self.output + 1), Memory()
        accuracy = accuracy_of(problem.of.settings, problem.forced(held).equation)
        while accuracy is not None:
            ratios, memory = judged(comm, accuracy, memory, peak.point, output)
            finer, memory = accuracy.finer(problem.resolution, ratios, memory)
            if finer is None:
                break
            better = replace(problem, resolution=finer)
            other = self._searched(better, peak.starts, width, held, lambda point: True)
            if isinstance(other, str):
                break
            problem, peak = better, replace(other, newton=peak.newton + other.newton)
        return problem, peak

    def _state(self, problem: _Problem, motion: Iterate) -> np.ndarray:
        """Return the state of all pairs in a motion under the law of a sample, on rank 0.  Collective."""
        equation = problem.forced(False).equation
        U = motion.on(equation.harmonics).U
        return equation.gather(equation.contact_forces(U, equation.every_pair, tangents=False).state)

    def _is_held_at(self, problem: _Problem, state: np.ndarray) -> bool:
        """Return whether a curve has its mean slip held there: most pairs slip, and a body is supported by the joint alone."""
        comm = problem.of.model.comm
        share = comm.bcast(float((state != STICK).mean()))
        if share < MOSTLY:
            return False
        if self._loose is None or self._loose[0] is not problem.of.model:
            self._loose = problem.of.model, is_held_by_its_joint_alone(problem.of.model, problem.forced(False).equation.law)
        return self._loose[1]

    def _record(
        self,
        problem: _Problem,
        point: Point,
        width: float,  # rad/s
        newton: int,
        linear: Peak | None,
        values: tuple[float, ...],
        branch: Branch | None,
    ) -> Sample:
        comm = problem.of.model.comm

        def numbers() -> dict[str, Any]:
            cos, sin = point.response[self.output, 1:3]
            size = float(np.hypot(cos, sin))
            damping = NAN
            if linear is not None:
                per_level = abs(linear.amplitude) * problem.level / size * (linear.omega / point.omega) ** 2
                damping = linear.damping * per_level
            curve = () if branch is None or not self.has_curves else amplitudes_at(branch, self.output, self.grid)
            error = NAN if point.error is None else float(total(point.error[self.output]))
            notes = list(point.notes)
            if (target := problem.of.settings.accuracy) is not None and error > BAR_NOTED * target * size:
                notes.append(f"error bar of {error / size:.2g} of the peak, [solver] accuracy = {target:g}")
            return {
                "amplitude": size,
                "phase": float(np.arctan2(-sin, cos)),
                "frequency": point.omega / (2.0 * np.pi),
                "width": width / (2.0 * np.pi),
                "damping": damping,
                "friction_J": float(point.friction),
                "damping_J": float(point.damping),
                "error": error,
                "slipping": int(np.count_nonzero(point.state == SLIP)),
                "open": int(np.count_nonzero(point.state == OPEN)),
                "newton": newton,
                "curve": curve,
                "why": "; ".join((*notes, *([] if np.isfinite(width) else [NO_WIDTH]))),
            }

        fields = comm.bcast(numbers() if comm.rank == 0 else None)
        return Sample(values, **fields)

    def _nearest_linear(self, of: ResponseProblem, omega: float | None) -> Peak | None:
        """Return the linear peak nearest to a frequency [rad/s], by default to that of the scene itself; None without one."""
        peaks, near = linear_peaks(of, of.model, self.output), omega or self.target
        return min(peaks, key=lambda peak: abs(np.log(peak.omega / near)), default=None)

    # -- the changes of a sample ---------------------------------------------------------------------------------------

    def _problem(self, values: tuple[float, ...]) -> _Problem:
        """Return the problem of a sample, which reuses as much as its numbers allow.

        Raises
        ------
        CaseError : the scene or the law does not allow a number; on every rank
        """
        scene = self.varied.scene_at(values)  # the schema first
        try:
            return self._with_law(scene, values, ())
        except ValueError as problem:  # the law of a built structure: another one may have it
            law = self.varied.items(values, "law")
            if any(self.varied.is_factor[i] for i in self.varied.having("law")):
                raise CaseError(str(problem)) from None
            return self._with_law(scene, values, law)

    def _with_law(self, scene: Scene, values: tuple[float, ...], as_built: tuple[tuple[str, float], ...]) -> _Problem:
        varied, rest, loads = self.varied, self.varied.items(values, "rest"), self.varied.items(values, "load")
        structure = self._structure(values, as_built)
        keys = as_keys(varied.items(values, "settings"))
        settings = scene_with(structure.scene, keys, {}) if keys else structure.scene
        key = varied.items(values, "build", "rest", "settings", "load"), as_built
        if rest:
            prepared = self._cached(key, lambda: prepared_with(structure, of_joints(rest), keys)[0])
        else:
            factors = load_factors(structure.scene, scene) if loads else None
            if loads:
                settings = settings.with_keys(loads=scene.loads)
            prepared = self._prepare(structure, settings, key, factors)
        level = next((value for _, value in varied.items(values, "level")), max(prepared.scene.response.levels))
        of = prepared.response
        if not as_built:
            of = self._with_parameters(of, prepared, varied.items(values, "law"))
        return _Problem(of, level, self._resolution(of, keys))

    def _resolution(self, of: ResponseProblem, keys: dict[str, Any]) -> Resolution:
        """Return harmonics and samples: those of the scene itself, unless these vary."""
        harmonics = of.model.harmonics if "harmonics" in keys else self.resolution.harmonics
        n_samples = of.settings.samples if "samples" in keys else self.resolution.n_samples
        tolerance = of.settings.tolerance if "tolerance" in keys else self.resolution.tolerance
        return Resolution(harmonics, n_samples, tolerance)

    def _with_parameters(self, of: ResponseProblem, prepared: Prepared, items: tuple[tuple[str, float], ...]) -> ResponseProblem:
        """Return a problem with other numbers of its contact law, and the structure with its stiffness.

        Raises
        ------
        ValueError : the law does not have them, or the update loses too many digits; on every rank
        """
        law, of_law = [], of.law
        for key, value in items:
            _, joint, number = words_of(key)
            parameter, _ = number_of_joint(prepared.scene, prepared.pairs, joint, number)
            law.append((parameter, value))
            of_law = of_law.with_parameters(parameter.name, parameter.pairs, value * parameter.shape)
        if not law:
            return of
        model = of.at_level(1.0).equation.under(OperatingPoint(0.0, 1.0, law=tuple(law))).model
        curve = of.curve if model is of.model else linear_curve(model, of.sweep)
        return replace(of, law=of_law, model=model, curve=curve)

    def _structure(self, values: tuple[float, ...], as_built: tuple[tuple[str, float], ...]) -> Structure:
        """Return the structure of a sample, built again where one of its numbers needs that."""
        key = self.varied.items(values, "build"), as_built
        if not any(key):
            return self.reference
        if self._built[0] != key:
            self.close()
            kinds = ("build", "law") if as_built else ("build",)
            scene = self.varied.scene_at(values, *kinds)
            self._built = key, self._of_scene(scene)
        return self._built[1]

    def _of_scene(self, scene: Scene) -> Structure:
        """Return the structure of a scene; of a disc that differs in its sectors alone, with the modes of the reference."""
        disc = self.reference
        if isinstance(disc, WholeStructure) and disc.shares_modes_with(scene):
            return disc.with_sectors(scene)
        return build(scene, disc.comm, None)

    def _prepare(self, structure: Structure, scene: Scene, key: Any, factors: np.ndarray | None = None) -> Prepared:
        """Return a structure prepared with another scene; the last one is stored."""

        def make() -> Prepared:
            with_modes, _ = with_modes_for(structure, reduction_settings(scene), structure.pairs)
            return prepare(with_modes, scene, load_factors=factors)

        return self._cached(key, make)

    def _cached(self, key: Any, make: Callable[[], Prepared]) -> Prepared:
        if self._prepared is None or self._prepared[0] != key:
            self._prepared = key, make()
        return self._prepared[1]


def highest_of(of: ResponseProblem, level: float, branch: Branch, output: int) -> tuple[Any, bool]:
    """Return motions at the top and the half power of a curve, harmonics and samples, or why there is none; and if held."""
    sizes = [float(np.hypot(*point.response[output, 1:3])) for point in branch.points]
    inner = [i for i in range(1, len(sizes) - 1) if sizes[i] >= sizes[i - 1] and sizes[i] >= sizes[i + 1]]
    top = of.model.comm.bcast(max(inner, key=lambda i: sizes[i], default=None))
    if top is None:
        return branch.failure or NO_PEAK, False
    return starts_at(of, level, branch, output, top), HELD in branch.points[top].notes


def starts_at(of: ResponseProblem, level: float, branch: Branch, output: int, top: int) -> tuple[Starts, Harmonics, int]:
    """Return motions at a top of a curve and at its half power, and the harmonics and samples there.  Collective."""
    point, problem = branch.points[top], of.at_level(level)
    sizes = [float(np.hypot(*each.response[output, 1:3])) for each in branch.points]
    harmonics = harmonics_of(branch, point, problem.equation.harmonics)

    def motion(i: int) -> Iterate:
        return iterate_of(branch.points[i], problem, harmonics_of(branch, branch.points[i], harmonics)).on(harmonics)

    ends = of.model.comm.bcast([half_power_of(sizes, range(top, end, way)) for end, way in ((len(sizes), 1), (-1, -1))])
    ends = ends if of.sweep.stop > of.sweep.start else ends[::-1]
    sides = [None if end is None else _mean(np.array([1.0 - end[2], end[2]]), [motion(i) for i in end[:2]]) for end in ends]
    return (motion(top), sides[0], sides[1]), harmonics, point.samples


def _alone(of: ResponseProblem) -> ResponseProblem:
    """Return a problem whose curves have neither peaks nor stability; with error bars only where they choose harmonics."""
    keeps_all = {"harmonics", "samples"} <= of.settings.keeps
    settings = replace(of.settings, peaks=False, stability=False)
    return replace(of, settings=settings, enriched=None if keeps_all else of.enriched)


def affine_weights(places: np.ndarray) -> np.ndarray | None:
    """Return weights (n,) that interpolate from places (n, d) to 0: exact for linear functions, mostly from near places.  Local.

    The least of weights times distances; None if the nearest place alone is as good.
    """
    distance = np.linalg.norm(places, axis=1)
    if len(places) < 2 or distance[0] == 0.0:
        return None
    A, near = np.column_stack([np.ones(len(places)), places]).T, 1.0 / distance**2
    gram = (A * near) @ A.T
    gram += 1e-6 * np.diag(np.maximum(np.diag(gram), 1e-300))
    weights = near * (A.T @ np.linalg.solve(gram, np.eye(len(A))[0]))
    weights /= weights.sum()
    return weights if np.abs(weights).sum() <= MOST_WEIGHT else None


def half_power_of(sizes: Sequence[float], way: Sequence[int]) -> tuple[int, int, float] | None:
    """Return the points of a curve between which its top falls to 1 / sqrt 2, and the share of the way.  Local."""
    half = np.sqrt(0.5) * sizes[way[0]]
    for before, after in pairwise(way):
        if sizes[after] <= half:
            return before, after, float((sizes[before] - half) / (sizes[before] - sizes[after]))
    return None


def _mean(weights: np.ndarray, motions: list[Iterate]) -> Iterate:
    """Return the weighted mean of motions and of their parameters."""
    harmonics = motions[0].harmonics
    U = sum(w * there.on(harmonics).U for w, there in zip(weights, motions))
    omega = float(np.dot(weights, [there.parameter for there in motions]))
    return Iterate(np.asarray(U), (omega,), harmonics)


def _side(weights: np.ndarray, around: list[Starts], k: int) -> Iterate | None:
    """Return the weighted mean of the motions at one end of the width; None if one of them is not known."""
    motions = [each[k] for each in around]
    known = [there for there in motions if there is not None]
    return _mean(weights, known) if len(known) == len(motions) else None


def amplitudes_at(branch: Branch, output: int, omegas: np.ndarray) -> tuple[float, ...]:
    """Return the amplitudes of a curve at frequencies [rad/s]; of several there the highest, NaN beyond its ends.  Local."""
    omega = np.array([point.omega for point in branch.points])
    size = np.array([np.hypot(*point.response[output, 1:3]) for point in branch.points])
    segment = np.array([point.segment for point in branch.points])
    amplitudes = np.full(len(omegas), np.nan)
    for i in np.flatnonzero(segment[:-1] == segment[1:]):
        low, high = sorted((omega[i], omega[i + 1]))
        within = (low <= omegas) & (omegas <= high)
        if high > low:
            share = (omegas[within] - omega[i]) / (omega[i + 1] - omega[i])
            amplitudes[within] = np.fmax(amplitudes[within], size[i] + share * (size[i + 1] - size[i]))
    return tuple(map(float, amplitudes))
