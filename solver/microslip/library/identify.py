"""Identification: numbers of a scene that explain a measurement, by least squares with the adjoint Jacobian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2
from scipy.stats import t as student

from ..formats.measured import Measured, measured_of, read_measured
from ..messages.errors import ConvergenceError
from ..parallel.agree import on_root
from .arguments import refuse_no_structure
from .build import Structure
from .fitted_numbers import fitted_numbers
from .measured_model import MeasuredModel
from .respond import scene_with
from .settings import output_names, refuse_discs, refuse_statics, units_of

PLAUSIBLE = 0.999  # share of measurements whose residuals are smaller, if the model is right and the deviations are as stated
ALIKE = 0.98  # correlation beyond which numbers cannot be distinguished
MOST_EVALUATIONS = 60
MOST_WEIGHTINGS = 4  # fits, each with the deviations that the residuals of the one before have where none are stated
WEAK = 1e-3  # deviations over the bounds, of a row that ties each number to its start: for numbers the data do not determine
ROUNDING = 1e-12  # of the largest square of an effect, up to which others are rounding


@dataclass(frozen=True, eq=False)
class Identified:
    """The numbers that explain a measurement best, how well they are known, and the response with them; k numbers, n rows."""

    keys: tuple[str, ...]
    units: tuple[str, ...]
    start: np.ndarray  # (k,) values of the scene
    values: np.ndarray  # (k,)
    low: np.ndarray  # (k,) 95 % confidence interval; for a number that does not affect the data, its bounds
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
    scene: Any = field(repr=False)  # with the fitted values, where it states single numbers
    factors: Mapping[str, float] = field(default_factory=dict)  # numbers that it does not: times the values of files or laws

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
    refuse_no_structure(structure, "identify")
    scene = scene_with(structure.scene, {**keys, "sensitivities": True, "error_bars": False}, {})
    refuse_statics(scene, "identify")
    refuse_discs(scene, "identify", "is for structures that are modelled in full")
    rows = on_root(structure.comm, _rows_of, scene, measured)
    fitted = on_root(structure.comm, fitted_numbers, scene, structure, bounds)
    model = MeasuredModel(structure, scene, rows, fitted)
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


def _least_squares(model: MeasuredModel, start: np.ndarray, begin: np.ndarray, edges: np.ndarray) -> Any:
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


@dataclass(frozen=True, eq=False)
class _Spread:
    """Deviations of residuals and fitted numbers; k numbers affect the data."""

    is_seen: np.ndarray  # (n_numbers,) bool
    n_determined: int  # combinations of numbers that the data determine
    free: np.ndarray  # (n_residuals,) degrees of freedom of each
    variance: np.ndarray  # (n_residuals,) over their deviations; 1 of stated ones
    covariance: np.ndarray  # (k, k) of x; of combinations that are not determined the distance of the bounds


def _spread(model: MeasuredModel, done: Any, edges: np.ndarray) -> _Spread:
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


def identified(model: MeasuredModel, done: Any, begin: np.ndarray, edges: np.ndarray, before: Measured) -> Identified:
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


def _scene_of(model: MeasuredModel, values: np.ndarray) -> tuple[Any, dict[str, float]]:
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
