"""Peaks over a number of a scene: the tables [[response.over]], and the same for programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np

from ..continuation.checkpointer import NO_CHECKPOINTS, Checkpointer
from ..continuation.peak_curves import PeakCurve, PeakRequest, beginnings, peak_curves
from ..harmonic.operating_point import LawParameter
from ..mesh.data import ContactPairs
from ..messages.errors import CaseError
from ..parallel.agree import on_root
from ..points.branch import Point
from ..results.record import COMPLETE, STOPPED, PeaksOver, level_result
from ..scene.schema import Scene
from ..scene.solution import Over
from .arguments import number_above, refuse_no_structure
from .build import Structure
from .prepare import Prepared, prepare
from .respond import Keys, scene_with, with_modes_for
from .sensitivities import FACTOR, LAW_NAMES, column_of, unit_of_pairs
from .settings import number_of_output, output_names, reduction_settings, units_of


@dataclass(frozen=True, eq=False)
class OverNumber:
    """A prepared table [[response.over]]: the followed parameter, and name and unit of its number."""

    key: str
    unit: str
    request: PeakRequest
    scale: float = 1.0  # of this number over the parameter of the request


def numbers_of(prepared: Prepared) -> list[OverNumber]:
    """Return the numbers over which peaks are followed, in the order of the scene.  Local.

    Raises
    ------
    CaseError : a joint of this name has no pairs, or no gap where that is to vary
    """
    return [_number(prepared.scene, prepared.pairs, over) for over in prepared.scene.response.over]


def _number(scene: Scene, pairs: ContactPairs, over: Over) -> OverNumber:
    output = number_of_output(scene, over.output)
    assert output is not None, "checked with the scene"
    level = over.level or max(scene.response.levels)
    of_joint = over.of_joint
    if over.key == "level":
        return OverNumber(over.key, units_of(scene).level, PeakRequest("level", over.range, over.at, output, level))
    if of_joint is None:
        stated = scene.damping if over.key == "damping.ratio" else None
        ratio = 1.0 if stated is None or stated.ratio is None else stated.ratio
        low, high, *at = (value / ratio for value in (*over.range, *over.at))
        unit = FACTOR if over.key == "damping" else "1"
        return OverNumber(over.key, unit, PeakRequest("damping", (low, high), tuple(at), output, level), ratio)
    parameter, unit = number_of_joint(scene, pairs, *of_joint)
    return OverNumber(over.key, unit, PeakRequest(parameter, over.range, over.at, output, level))


def number_of_joint(scene: Scene, pairs: ContactPairs, name: str, key: str) -> tuple[LawParameter, str]:
    """Return a number of a joint as a parameter of the law, and its unit: that of the scene where it states one for all pairs.

    Local.  A factor of gaps is of the pairs that have one, and a factor of preloads of the others.

    Raises
    ------
    CaseError : no pair of the joint has such a number
    """
    numbers = pairs.of_joint(name)
    column = column_of(pairs, key)[numbers]
    stated = next((getattr(joint, key) for joint in scene.joints if joint.name == name), None)
    if isinstance(stated, float) and stated > 0.0:
        return LawParameter(LAW_NAMES[key], numbers, column / stated), unit_of_pairs(pairs, numbers, key)
    has_one = column > 0.0 if key in ("gap", "preload") else np.full(len(column), True)
    if not has_one.any():
        other = "preload" if key == "gap" else "gap"
        raise CaseError(f"{scene.source}: joints.{name}.{key}: no pair of the joint has a {key}; vary joints.{name}.{other}")
    return LawParameter(LAW_NAMES[key], numbers[has_one], column[has_one]), FACTOR


def refuse_without_peaks(prepared: Prepared) -> None:
    """Raise CaseError where there is no peak to follow over a number, before anything is solved.  Collective."""
    for number in numbers_of(prepared):
        beginnings(prepared.response, number.request)


def followed(
    prepared: Prepared,
    number: OverNumber,
    on_point: Callable[[Point], None] = lambda point: None,
    checkpointer_of: Callable[[int], Checkpointer] = lambda peak: NO_CHECKPOINTS,
) -> list[PeaksOver]:
    """Return the peaks over a number as results, one of each peak of the linear response.  Collective.

    The same on every rank.  A curve that ends early has the reason in the ``failure`` of its points.

    Raises
    ------
    CaseError : no peak in the range of frequencies, or values that the law does not have; on every rank
    """
    model = prepared.model
    sizes = len(output_names(prepared.scene)), model.n_pairs, model.recorded.n_coefficients
    curves = peak_curves(prepared.response, number.request, on_point, checkpointer_of)
    return on_root(model.comm, lambda: [_record(number, curve, sizes) for curve in curves])


def _record(number: OverNumber, curve: PeakCurve, sizes: tuple[int, int, int]) -> PeaksOver:
    branch, linear = curve.branch, curve.linear
    return PeaksOver(
        number.key,
        number.unit,
        linear,
        number.scale * np.array([point.parameters[0] for point in branch.points]),
        np.array([curve.damping_ratio(point) for point in branch.points]),
        level_result(branch, sizes, STOPPED if branch.failure else COMPLETE),
    )


def peaks(
    structure: Structure,
    over: Mapping[str, Sequence[float]],
    *,
    output: str | None = None,
    values: Sequence[float] = (),
    level: float | None = None,
    **keys: Unpack[Keys],
) -> list[PeaksOver]:
    """Return the peaks of an output over numbers of the scene, a curve for each number and each peak of the linear response.

    Collective on ``structure.comm``; the same on every rank.

    Parameters
    ----------
    over : the two ends of the range, by ``"level"`` [N], ``"damping"`` (a factor of all damping), ``"damping.ratio"`` or a number
        of a joint, ``"joints.NAME.friction"`` and the like
    output : its name; the first one if None
    values : that are points of each curve
    level : N, where another number varies; the highest of the scene if None
    keys : as those of :func:`respond`

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : as :func:`respond`; also where the output has no peak; on every rank
    """
    refuse_no_structure(structure, "peaks")
    level = None if level is None else number_above(level, 0.0, "peaks: level")
    if not isinstance(over, Mapping) or not over or not all(_are_numbers(ends, (2,)) for ends in over.values()):
        raise CaseError(f'peaks: over = {over!r}: expected a mapping of keys to two ends, as {{"level": (0.1, 10.0)}}')
    if not _are_numbers(values, (None,)):
        raise CaseError(f"peaks: values = {values!r}: expected a list of numbers, points of each curve")
    tables = tuple(
        {"key": key, "range": tuple(map(float, ends)), "at": tuple(map(float, values))}
        | ({} if output is None else {"output": output})
        | ({} if level is None or key == "level" else {"level": level})
        for key, ends in over.items()
    )
    scene = scene_with(structure.scene, {**keys, "over": tables}, {})
    of_scene, _ = with_modes_for(structure, reduction_settings(scene), structure.pairs)
    prepared = prepare(of_scene, scene)
    return [curve for number in numbers_of(prepared) for curve in followed(prepared, number)]


def _are_numbers(values: Any, shape: tuple[int | None, ...]) -> bool:
    """Return whether an argument is an array of numbers of this shape, None for any number."""
    try:
        found = np.asarray(values, dtype=float).shape
    except (TypeError, ValueError):
        return False
    return len(found) == len(shape) and all(n in (m, None) for m, n in zip(found, shape))
