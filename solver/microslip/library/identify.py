"""Identification: numbers of a scene that explain a measurement, by least squares with the adjoint Jacobian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2
from scipy.stats import t as student

from ..assembly.pair_file import COLUMNS
from ..contact.law import STICK
from ..continuation.grid import solved_at, task_at
from ..continuation.levels import ResponseProblem, follow_level, response_problem
from ..continuation.peak_at import PeakPoint, Starts, peak_near
from ..continuation.peak_curves import linear_peaks
from ..continuation.peaks import maxima
from ..continuation.point_record import HELD
from ..continuation.ways_out import MOSTLY
from ..formats.csv_table import read_table
from ..formats.measured import Measured, measured_of, read_measured
from ..fourier.harmonics import Harmonics
from ..harmonic.balance import HarmonicBalance
from ..messages.errors import CaseError, ConvergenceError
from ..messages.words import hint, listed
from ..parallel.agree import on_root
from ..points.branch import Branch
from ..points.sensitivities import of_size
from ..receptance.other_springs import with_springs
from ..receptance.springs import SpringChange
from ..results.sensitivities import Varied
from .build import Structure
from .prepare import Prepared, prepare
from .respond import scene_with
from .sample_peaks import UNKNOWN_WIDTH, starts_at
from .sensitivities import NUMBER_OF, damping_key, numbers_of_law, varied_numbers
from .settings import output_names, refuse_discs, refuse_statics, units_of

if TYPE_CHECKING:
    from mpi4py import MPI

PLAUSIBLE = 0.999  # share of measurements whose residuals are smaller, if the model is right and the deviations are as stated
OF_AMPLITUDE, OF_PHASE, OF_FREQUENCY = 0.02, 0.03, 1e-3  # deviations where none are stated: of the largest; rad; of the frequency
ALIKE = 0.98  # correlation beyond which numbers cannot be distinguished
MOST_EVALUATIONS = 60
MOST_WEIGHTINGS = 4  # fits, each with the deviations that the residuals of the one before have where none are stated
SAME_WEIGHTS = 0.1  # relative change of these deviations at which the fit is left as it is
MOST_PRECISE = 1e-3  # of such a deviation before, at least, where the residuals vanish
WEAK = 1e-3  # deviations, of a row that holds each number at its start: a rank for what the data do not see; over its bounds
ROUNDING = 1e-12  # of the largest square of an effect, up to which others are rounding
AT_REST = ("friction", "preload", "gap")
IN_FILE = {  # the columns of a file of pairs
    "friction": "mu",
    "preload": "n0",
    "gap": "g0",
    "tangential_stiffness": "kt",
    "normal_stiffness": "kn",
    "slip_force": "mu",
}


@dataclass(frozen=True, eq=False)
class Fitted:
    """A number that is fitted: within bounds, over its logarithm where these are above 0."""

    varied: Varied
    low: float
    high: float

    @property
    def is_log(self) -> bool:
        """Whether the search takes the logarithm of the number."""
        return self.low > 0.0

    def x(self, value: float) -> float:
        """Return the variable of the search for a value."""
        return float(np.log(value)) if self.is_log else value

    def value(self, x: float) -> float:
        """Return the value for a variable of the search."""
        return float(np.exp(x)) if self.is_log else float(x)


@dataclass(frozen=True, eq=False)
class Identified:
    """The numbers that explain a measurement best, how well they are known, and the response with them; k numbers, n rows."""

    keys: tuple[str, ...]
    units: tuple[str, ...]
    start: np.ndarray  # (k,) values of the scene
    values: np.ndarray  # (k,)
    low: np.ndarray  # (k,) 95 % confidence interval; of a number that the data do not see its bounds
    high: np.ndarray  # (k,)
    correlation: np.ndarray  # (k, k)
    unseen: tuple[str, ...]  # on which the data do not depend, within their noise, from bound to bound
    alike: tuple[tuple[str, str, float], ...]  # pairs that cannot be distinguished, and their correlation
    at_bounds: tuple[str, ...]
    measured: Measured
    fit: Measured  # the same rows, computed
    before: Measured  # with the values of the scene
    rms: float  # of the residuals over their deviations
    has_deviations: bool  # every row has a stated one
    is_explained: bool  # the residuals are not larger than stated deviations allow; True without these
    dof: int  # rows less combinations of numbers that the data determine
    evaluations: int
    outcome: str  # of the least squares
    is_converged: bool  # otherwise the last values are no least squares, and their intervals mean nothing
    scene: Any = field(repr=False)  # with the values put in, as far as it states them as single numbers
    factors: Mapping[str, float] = field(default_factory=dict)  # numbers that it does not: times what files or laws state

    def __getitem__(self, key: str) -> float:
        """Return the value of a number."""
        return float(self.values[self.keys.index(key)])


def identify(
    structure: Structure,
    measured: str | Path | Mapping[str, Sequence[Any]] | Measured,
    bounds: Mapping[str, tuple[float, float]],
    **keys: Any,
) -> Identified:
    """Return the numbers within ``bounds`` that explain a measurement best.

    Collective on ``structure.comm``; the same on every rank.  Least squares of amplitudes, phases and frequencies of peaks over
    their standard deviations, docs/theory.md, eq. (11.8); where none are stated they follow from the residuals, of each of the
    three alone.

    Parameters
    ----------
    measured : a CSV, MATLAB or universal file, or columns: ``frequency_Hz`` or ``peak_frequency_Hz``, ``amplitude_m``,
        ``phase_rad``, ``level_N``, ``output`` and deviations ``sigma_m``, ``sigma_phase_rad``, ``sigma_frequency_Hz``
    bounds : by key, ``"joints.NAME.friction"`` and the like or ``"damping.ratio"``; of numbers that differ from pair to pair
        those of a factor.  The fit begins at the values of the scene
    keys : of [response], [solver] and [damping], as :func:`respond` has them

    Raises
    ------
    CaseError : wrong data, an unknown number or bounds that do not hold the scene's value; on every rank
    ConvergenceError : no response with the values of the scene; on every rank
    """
    structure.refuse_closed()
    scene = scene_with(structure.scene, {**keys, "sensitivities": True, "error_bars": False}, {})
    refuse_statics(scene, "identify")
    refuse_discs(scene, "identify", "is for structures that are modelled in full")
    rows = on_root(structure.comm, _rows_of, scene, measured)
    fitted = on_root(structure.comm, _fitted, scene, structure, bounds)
    model = _Model(structure, scene, rows, fitted)
    begin = np.array([each.x(each.varied.value) for each in fitted])
    edges = np.array([[each.x(each.low), each.x(each.high)] for each in fitted]).T
    if not np.isfinite(model.residuals(begin)).all():
        raise ConvergenceError(f"identify: with the values of the scene {model.failure}")
    before = model.fit
    done = _least_squares(model, begin, begin, edges)
    for _ in range(MOST_WEIGHTINGS - 1):
        if not (done.status > 0 and model.reweigh(_spread(model, done, edges).variance)):
            break
        done = _least_squares(model, done.x, begin, edges)
    return identified(model, done, begin, edges, before)


def _least_squares(model: _Model, start: np.ndarray, begin: np.ndarray, edges: np.ndarray) -> Any:
    """Return SciPy's solution from ``start``, with numbers weakly held at ``begin``.  Collective.  docs/theory.md, eq. (11.8)."""
    weak = np.diag(WEAK / (edges[1] - edges[0]))
    done = least_squares(
        lambda x: np.concatenate([model.residuals(x), weak @ (x - begin)]),
        start,
        lambda x: np.concatenate([model.jacobian(x), weak]),
        bounds=tuple(edges),
        x_scale="jac",
        xtol=1e-9,
        ftol=1e-10,
        max_nfev=MOST_EVALUATIONS,
    )
    done.fun, done.jac = model.residuals(done.x), model.jacobian(done.x)
    return done


def _rows_of(scene: Any, measured: Any) -> Measured:
    if isinstance(measured, Measured):
        return measured
    of = output_names(scene), units_of(scene).outputs, scene.response.levels
    if isinstance(measured, Mapping):
        return measured_of(measured, "identify", *of)
    return read_measured(Path(measured), *of, scene.response.frequencies)


def refuse_bounds(scene: Any, bounds: Mapping[str, tuple[float, float]]) -> None:
    """Refuse numbers and bounds that the scene alone shows to be wrong, before its structure is built.  Local; reads pair files.

    Raises
    ------
    CaseError : as :func:`identify`; joints and numbers of a model file are not known here
    """
    keys, joints = _offered(scene), {joint.name: joint for joint in scene.joints}
    if not bounds:
        raise CaseError(f"identify: numbers to fit are missing; there are {listed(keys)}")
    for key, ends in bounds.items():
        name, _, number = key.removeprefix("joints.").rpartition(".")
        if scene.statics is not None and number in AT_REST:
            raise CaseError(f"identify: {key} changes the state of rest with [statics]; fit stiffness and damping alone")
        is_of_file = scene.model.mesh is not None and key.startswith("joints.") and name not in joints and number in NUMBER_OF
        if key not in keys and not is_of_file:
            raise _no_number(key, keys)
        value = scene.damping.ratio if key == "damping.ratio" else getattr(joints.get(name), number, None)
        value = 1.0 if name in joints and joints[name].pairs is not None else value  # a factor
        _check_bounds(key, *ends, float(value) if isinstance(value, float) and value > 0.0 else None)
        if number == "gap" and f"joints.{name}.normal_stiffness" in bounds:
            raise CaseError(f"identify: {name}.gap and {name}.normal_stiffness: fit one of them, which the other depends on")


def _no_number(key: str, keys: Sequence[str]) -> CaseError:
    only = "; damping.ratio is a number where it is all damping there is" if key.startswith("damping") else ""
    return CaseError(f"identify: there is no number {key!r}{hint(key, list(keys))}; there are {listed(list(keys))}{only}")


def _offered(scene: Any) -> list[str]:
    """Return the numbers to fit of which the scene states more than 0."""
    of_joints = [
        f"joints.{joint.name}.{number}"
        for joint in scene.joints
        for number in NUMBER_OF
        if number in numbers_of_law(joint.law) and not (scene.statics is not None and number in AT_REST)
        if _states(scene, joint, number)
    ]
    return [*of_joints, *(key for key in [damping_key(scene)] if key == "damping.ratio")]


def _states(scene: Any, joint: Any, number: str) -> bool:
    """Return whether pairs of a joint have, or may have, more than 0 of a number."""
    if joint.pairs is not None:
        return bool((read_table(scene.folder / joint.pairs, COLUMNS, what="pair")[0][IN_FILE[number]] > 0.0).any())
    if joint.parameters is not None or number in joint.fields:
        return True
    return bool(getattr(joint, number)) or (number == "gap" and joint.has_gap_of_mesh)


def _check_bounds(key: str, low: float, high: float, value: float | None) -> None:
    """Raise CaseError unless bounds are of at least 0, rise, and hold the value of the scene where it is known."""
    if 0.0 <= low < high < np.inf and (value is None or low <= value <= high):
        return
    if 0.0 <= low < high < np.inf:
        raise CaseError(f"identify: {key} = {low:g}:{high:g}: the fit begins at the scene's value, {value:g}, not within")
    raise CaseError(f"identify: {key} = {low:g}:{high:g}: two bounds of at least 0 are expected, the lower one first")


def _fitted(scene: Any, structure: Structure, bounds: Mapping[str, tuple[float, float]]) -> list[Fitted]:
    """Return the numbers to fit.  CaseError as :func:`identify`."""
    refuse_bounds(scene, bounds)
    known = {each.key: each for each in varied_numbers(scene, structure.pairs) if each.key not in ("level", "damping")}
    fitted = []
    for key, ends in bounds.items():
        if key not in known:
            raise _no_number(key, list(known))
        low, high = map(float, ends)
        value = known[key].value
        assert value is not None, "only the level has none"
        _check_bounds(key, low, high, value)
        fitted.append(Fitted(known[key], low, high))
    return fitted


class _Model:
    """The measured rows as the structure has them at values of the numbers.  Collective."""

    def __init__(self, structure: Structure, scene: Any, rows: Measured, fitted: Sequence[Fitted]):
        self.structure, self.scene, self.rows, self.fitted = structure, scene, rows, list(fitted)
        self.evaluations, self.failure = 0, ""
        stated = np.stack([rows.deviation, rows.deviation_of_phase, rows.deviation_of_frequency])
        largest = np.array([np.nanmax(rows.amplitude[rows.output == k], initial=0.0) for k in rows.output])
        usual = np.stack([OF_AMPLITUDE * largest, np.full(rows.n, OF_PHASE), OF_FREQUENCY * rows.frequency])
        self.deviations = np.where(np.isfinite(stated), stated, usual)
        target = np.stack([rows.amplitude, rows.phase, rows.frequency if rows.of_peaks else np.full(rows.n, np.nan)])
        self.target, self.counts = target, np.isfinite(target)
        self.is_stated = np.isfinite(stated)[self.counts]  # (n_residuals,) bool, the deviation
        kind = np.nonzero(self.counts)[0]
        self.unstated = [rows for k in range(3) if (rows := ~self.is_stated & (kind == k)).any()]  # (n_residuals,) bool each
        self._known: tuple[bytes, np.ndarray, np.ndarray] | None = None
        self._peaks: dict[tuple[float, int, float], _KnownPeak] = {}
        self.fit = rows

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Return the residuals over their deviations; inf where there is no response."""
        return self._at(x)[0]

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Return their derivatives by x, (n_residuals, k)."""
        return self._at(x)[1]

    def reweigh(self, variance: np.ndarray) -> bool:
        """Update unstated deviations by the ``variance`` of residuals (n_residuals,); return whether they change.  Local.

        Without stated deviations their ratios alone count, and the largest stays.
        """
        if len(self.unstated) + self.is_stated.any() < 2:
            return False
        scale = np.sqrt(variance if self.is_stated.any() else variance / max(variance.max(), 1e-300))
        scale = np.where(self.is_stated, 1.0, np.maximum(scale, MOST_PRECISE))
        if np.abs(scale - 1.0).max() <= SAME_WEIGHTS:
            return False
        self.deviations[self.counts] *= scale
        if self._known is not None:
            x, residuals, jacobian = self._known
            self._known = x, residuals / scale, jacobian / scale[:, None]
        return True

    def _at(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._known is None or self._known[0] != x.tobytes():
            self.evaluations += 1
            try:
                computed = self._computed([each.value(x_i) for each, x_i in zip(self.fitted, x)])
            except (ConvergenceError, ValueError) as problem:
                self.failure = f"there is no response: {problem}"
                computed = np.full_like(self.target, np.inf), np.zeros((*self.target.shape, len(x)))
            self._known = (x.tobytes(), *self.structure.comm.bcast(self._as_residuals(x, *computed)))
        return self._known[1], self._known[2]

    def _as_residuals(self, x: np.ndarray, values: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        difference = values - self.target
        with np.errstate(invalid="ignore"):
            difference[1] = np.where(np.isfinite(difference[1]), np.angle(np.exp(1j * difference[1])), difference[1])
        self.fit = replace(self.rows, amplitude=values[0], phase=values[1], frequency=values[2])
        by_x = [each.value(x_i) if each.is_log else 1.0 for each, x_i in zip(self.fitted, x)]
        scaled = rates * by_x / self.deviations[:, :, None]
        return (difference / self.deviations)[self.counts], scaled[self.counts]

    def _computed(self, values: list[float]) -> tuple[np.ndarray, np.ndarray]:
        """Return amplitude, phase and frequency of the rows, (3, n), and their derivatives by the numbers, (3, n, k)."""
        of, varied = self._problem(values), [
            replace(each.varied, weights=np.array(1.0 / value)) if each.varied.number == "damping" else each.varied
            for each, value in zip(self.fitted, values)
        ]  # fmt: skip
        responses, rates = np.zeros((3, self.rows.n)), np.zeros((3, self.rows.n, len(values)))
        for level in np.unique(self.rows.level):
            chosen = np.flatnonzero(self.rows.level == level)
            rows = self.rows.rows(chosen)
            at = _peaks_near(of, level, rows, varied, self._peaks) if rows.of_peaks else _points_at(of, level, rows, varied)
            responses[:, chosen], rates[:, chosen] = at
        return responses, rates

    def _problem(self, values: list[float]) -> ResponseProblem:
        """Return the problem with these values; contact stiffness by (4.7)."""
        ratio = [value for each, value in zip(self.fitted, values) if each.varied.number == "damping"]
        scene = scene_with(self.scene, {"ratio": ratio[0]}, {}) if ratio else self.scene
        prepared = self._prepared(scene)
        law, model = prepared.response.law, prepared.model
        for each, value in zip(self.fitted, values):
            varied = each.varied
            if varied.number != "damping":
                law = law.with_parameters(varied.number, varied.pairs, value * varied.weights)
        K_J = law.stiffness.ravel()
        dK = K_J - prepared.response.law.stiffness.ravel()
        if dK.any():
            model = with_springs(model, SpringChange(dK, K_J, model.stated_damping))
        settings = replace(prepared.response.settings, peaks=False, stability=False, sensitivities=False, accuracy=None, at=())
        if not self.rows.of_peaks:
            return replace(prepared.response, settings=settings, model=model, law=law, enriched=None)
        return response_problem(settings, model, law, prepared.response.selection, self.structure.excited.omega_n)

    def _prepared(self, scene: Any) -> Prepared:
        return prepare(self.structure, scene, has_bars=False)


def _points_at(of: ResponseProblem, level: float, rows: Measured, varied: Sequence[Varied]) -> tuple[np.ndarray, np.ndarray]:
    """Return amplitude, phase and frequency of rows of a level (3, n), and their derivatives (3, n, k).  Collective."""
    omegas, place = np.unique(2.0 * np.pi * rows.frequency, return_inverse=True)
    order = slice(None, None, -1) if of.settings.direction == "down" else slice(None)
    problem = replace(of.at_level(level), equation=HarmonicBalance.of_all(of.model, of.law, of.settings.samples))
    task = replace(task_at(problem, of.selection, list(omegas[order]), of.settings.tolerance), has_sensitivities=True)
    branch: Branch = solved_at(task, list(omegas[order]))
    if branch.failure or len(branch.points) < len(omegas):
        raise ConvergenceError(branch.failure or "points are missing")
    points = branch.points[order]
    responses, rates = np.zeros((3, rows.n)), np.zeros((3, rows.n, len(varied)))
    for i, (j, k) in enumerate(zip(place, rows.output)):
        cos, sin = points[j].response[k, 1:3]
        responses[:, i] = np.hypot(cos, sin), np.arctan2(-sin, cos), rows.frequency[i]
        for m, each in enumerate(varied):
            d_cos, d_sin = each.rate(points[j].by_pairs[k], points[j].by_common[k])
            rates[:2, i, m] = of_size(cos, sin, d_cos, d_sin)
    return responses, rates


@dataclass(frozen=True, eq=False)
class _KnownPeak:
    """Where the search for the peak of a row begins: a peak with other values of the numbers, or the top of a curve."""

    starts: Starts
    harmonics: Harmonics
    n_samples: int
    is_held: bool  # its mean slip, by springs
    width: float  # rad/s, of the linear peak
    share: float  # of the pairs that do not stick

    def peak(self, of: ResponseProblem, level: float, output: int) -> PeakPoint | str:
        """Return the smooth peak near by with its derivatives, or why there is none.  Collective."""
        problem = of.at_level(level)
        equation = problem.equation.resolved(self.harmonics, self.n_samples)
        equation = equation.holding(np.zeros((equation.n_owned, 2)) if self.is_held else None)
        forced, tolerance = problem.with_equation(equation), of.settings.tolerance
        return peak_near(forced, output, self.starts, self.width, tolerance, needs_width=lambda point: False, has_rates=True)

    def at(self, peak: PeakPoint, comm: MPI.Comm) -> _KnownPeak:
        """Return it at a peak that was found.  Collective."""
        share = comm.bcast(float((peak.point.state != STICK).mean()))
        return replace(self, starts=(peak.iterate, None, None), share=share)


def _near_on_curve(of: ResponseProblem, level: float, branch: Branch, output: int, omega: float) -> _KnownPeak:
    """Return the top of a curve nearest to a frequency.  Collective.  ConvergenceError without one."""
    tops = of.model.comm.bcast([i for k, i in maxima(branch) if k == output])
    if not tops:
        raise ConvergenceError(
            branch.failure or f"at {level:g} N output {output + 1} has no peak within the range of frequencies"
        )
    top = min(tops, key=lambda i: abs(branch.points[i].omega - omega))
    here = branch.points[top].omega
    linear = min(linear_peaks(of, of.model, output), key=lambda peak: abs(peak.omega - here), default=None)
    width = UNKNOWN_WIDTH * here if linear is None else linear.width
    return _KnownPeak(*starts_at(of, level, branch, output, top), HELD in branch.points[top].notes, width, 0.0)


def _peaks_near(
    of: ResponseProblem, level: float, rows: Measured, varied: Sequence[Varied], known: dict[tuple[float, int, float], _KnownPeak]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the same of the peaks nearest to the rows, from those ``known`` by level, output and frequency.  Collective.

    Along a curve where one is not known, Newton's method fails, or springs begin or cease to hold its mean slip.
    """
    comm, branch = of.model.comm, None
    responses, rates = np.zeros((3, rows.n)), np.zeros((3, rows.n, len(varied)))
    for i, (frequency, k) in enumerate(zip(rows.frequency, rows.output)):
        key = level, int(k), float(frequency)
        near = known.get(key)
        peak = near.peak(of, level, int(k)) if near else ""
        there = None if near is None or isinstance(peak, str) else near.at(peak, comm)
        if near is None or there is None or (near.share < MOSTLY) != (there.share < MOSTLY):
            branch = branch or follow_level(of, level)
            near = _near_on_curve(of, level, branch, int(k), 2.0 * np.pi * frequency)
            peak = near.peak(of, level, int(k))
            there = None if isinstance(peak, str) else near.at(peak, comm)
        if isinstance(peak, str) or there is None or peak.by_pairs is None or peak.by_common is None:
            why = peak if isinstance(peak, str) else "no solutions next to it"
            raise ConvergenceError(f"at {level:g} N, output {k + 1}, the peak near {frequency:.6g} Hz: {why}")
        known[key] = there
        cos, sin = comm.bcast(peak.point.response[k, 1:3])
        responses[:, i] = peak.amplitude, np.arctan2(-sin, cos), peak.iterate.parameter / (2.0 * np.pi)
        rates[:, i] = np.array([each.rate(peak.by_pairs, peak.by_common) for each in varied]).T
    return responses, rates


@dataclass(frozen=True, eq=False)
class _Spread:
    """How far residuals and fitted numbers spread; k numbers are seen."""

    is_seen: np.ndarray  # (n_numbers,) bool
    n_determined: int  # combinations of numbers that the data determine
    free: np.ndarray  # (n_residuals,) degrees of freedom of each
    variance: np.ndarray  # (n_residuals,) over their deviations; 1 of stated ones
    covariance: np.ndarray  # (k, k) of x; of combinations that are not determined the distance of the bounds


def _spread(model: _Model, done: Any, edges: np.ndarray) -> _Spread:
    """Return it at the end of a fit.  Local.  docs/theory.md, eq. (11.9)."""
    J, noise, variance = done.jac, np.ones(len(done.fun)), np.ones(len(done.fun))
    for rows in model.unstated:
        noise[rows] = max(float(np.sqrt(np.mean(done.fun[rows] ** 2))), 1e-12)
    effects = J / noise[:, None] * (edges[1] - edges[0])  # from bound to bound
    is_seen = np.linalg.norm(effects, axis=0) > 1.0
    squares, combinations = np.linalg.eigh(effects[:, is_seen].T @ effects[:, is_seen])
    combinations *= (edges[1] - edges[0])[is_seen, None]
    are_determined = squares > max(1.0, ROUNDING * squares.max(initial=0.0))
    determined, others = combinations[:, are_determined], combinations[:, ~are_determined]
    J_seen = J[:, is_seen]
    J_determined = J_seen @ determined
    inverse = determined @ np.linalg.pinv(J_determined.T @ J_determined, hermitian=True) @ determined.T
    free = 1.0 - np.einsum("ij,jk,ik->i", J_seen, inverse, J_seen)
    for rows in model.unstated:
        variance[rows] = np.sum(done.fun[rows] ** 2) / max(float(free[rows].sum()), 1.0)
    covariance = inverse @ (J_seen.T * variance) @ J_seen @ inverse + others @ others.T
    return _Spread(is_seen, determined.shape[1], free, variance, covariance)


def identified(model: _Model, done: Any, begin: np.ndarray, edges: np.ndarray, before: Measured) -> Identified:
    """Return the least-squares solution with intervals: docs/theory.md, eq. (11.9)."""
    fitted, keys = model.fitted, tuple(each.varied.key for each in model.fitted)
    spread = _spread(model, done, edges)
    is_seen, free, covariance = spread.is_seen, spread.free, spread.covariance
    rms = float(np.sqrt(np.mean(done.fun**2)))
    dof = len(done.fun) - spread.n_determined
    of_stated = float(np.sum(done.fun[model.is_stated] ** 2)), max(float(free[model.is_stated].sum()), 1.0)
    deviation = np.full(len(keys), np.inf)
    if dof > 0 or model.is_stated.all():  # otherwise the deviations of the data are unknown
        deviation[is_seen] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    correlation = np.eye(len(keys))
    of_seen = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    correlation[np.ix_(is_seen, is_seen)] = np.divide(covariance, of_seen, out=np.eye(len(of_seen)), where=of_seen > 0.0)
    way = student.ppf(0.975, max(dof, 1)) * deviation
    ends = np.array([np.clip(done.x - way, *edges), np.clip(done.x + way, *edges)])
    low, high = (np.array([each.value(x) for each, x in zip(fitted, end)]) for end in ends)
    near = np.minimum(done.x - edges[0], edges[1] - done.x) <= 1e-3 * (edges[1] - edges[0])
    values = np.array([each.value(x) for each, x in zip(fitted, done.x)])
    scene, factors = _scene_of(model, values)
    return Identified(
        keys=keys,
        units=tuple(each.varied.unit for each in fitted),
        start=np.array([each.value(x) for each, x in zip(fitted, begin)]),
        values=values,
        low=low,
        high=high,
        correlation=correlation,
        unseen=tuple(key for key, seen in zip(keys, is_seen) if not seen),
        alike=tuple(
            (keys[i], keys[j], float(correlation[i, j]))
            for i in range(len(keys))
            for j in range(i)
            if abs(correlation[i, j]) > ALIKE
        ),
        at_bounds=tuple(key for key, is_near, seen in zip(keys, near, is_seen) if is_near and seen),
        measured=model.rows,
        fit=model.fit,
        before=before,
        rms=rms,
        has_deviations=bool(model.is_stated.all()),
        is_explained=not model.is_stated.any() or of_stated[0] <= chi2.ppf(PLAUSIBLE, of_stated[1]),
        dof=dof,
        evaluations=model.evaluations,
        outcome=str(done.message),
        is_converged=done.status > 0,
        scene=scene,
        factors=factors,
    )


def _scene_of(model: _Model, values: np.ndarray) -> tuple[Any, dict[str, float]]:
    """Return the scene with the values put in, and the numbers that it does not state as one."""
    stated = {each.varied.key: float(value) for each, value in zip(model.fitted, values)}
    ratio, joints, factors = {}, dict[str, dict[str, float]](), dict[str, float]()
    surfaces = {joint.name: joint for joint in model.structure.scene.joints}
    for key, value in stated.items():
        if key == "damping.ratio":
            ratio = {"ratio": value}
            continue
        name, number = key.removeprefix("joints.").rsplit(".", 1)
        if name in surfaces and isinstance(getattr(surfaces[name], number), float):
            joints.setdefault(name, {})[number] = value
        else:
            factors[key] = value
    from ..scene.read import changed

    tables = {"damping": ratio} if ratio else {}
    return changed(model.structure.scene, tables, joints), factors
