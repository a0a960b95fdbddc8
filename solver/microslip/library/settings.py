"""The settings of every stage from a scene.  No other stage reads scenes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..continuation.settings import ResponseSettings
from ..fourier.harmonics import Harmonics
from ..messages.errors import CaseError
from ..points.band import Band
from ..receptance.excitation import Excitation
from ..reduction.settings import ModalDamping, ReductionSettings
from ..scene.read import changed
from ..scene.schema import Scene
from ..scene.solution import ACCURACY_OF_MODES
from ..tables.vibration import Damping

KEYS = {"harmonics": "harmonics", "samples": "samples", "solver": "tolerance"}  # of [solver], for each part of the accuracy


def reduction_settings(scene: Scene) -> ReductionSettings:
    """Return the method of a scene, its modes and loads.  Local."""
    solver, damping = scene.solver, scene.damping
    keys = ("method", "modes", "verify_modes", "interface_modes", "condensed", "in_point_check", "energy_tolerance")
    return ReductionSettings(
        accuracy=scene.accuracy or ACCURACY_OF_MODES,
        insists=solver.accuracy is not None,
        excitation=excitation(scene),
        damping=None if damping is None else _damping(damping),
        band=band(scene),
        level=max(scene.response.levels),
        where=str(scene.path),
        **{key: getattr(solver, key) for key in keys},
    )


def excitation(scene: Scene) -> Excitation:
    """Return how the loads of a scene vary in time, and its harmonics.  Local.

    Of a whole disc each load has two shapes, a quarter of a cycle apart: docs/theory.md, section 17.
    """
    shapes = [(load.harmonic, phase) for load in scene.loads for phase in load.phases]
    if scene.cyclic is not None and scene.cyclic.whole:
        shapes = [(n, phase + more) for n, phase in shapes for more in (0.0, 0.5 * math.pi)]
    return Excitation(tuple(shapes), Harmonics(scene.chosen_harmonics))


def response_settings(scene: Scene) -> ResponseSettings:
    """Return the settings of a scene's response, with defaults chosen by the program.  Local."""
    solver, response, steps = scene.solver, scene.response, scene.continuation
    return ResponseSettings(
        levels=response.levels,
        band=band(scene),
        at=response.at,
        direction=response.direction,
        points=response.points,
        **{key: getattr(steps, key, None) for key in ("ds", "ds_min", "ds_max")},
        samples=solver.samples,
        follows_path=solver.between_samples == "path",
        tolerance=solver.tolerance,
        accuracy=scene.accuracy,
        is_corrected=solver.accuracy_of == "corrected",
        keeps=frozenset(part for part, key in KEYS.items() if not scene.chooses(key)),
        chooses_steps="points" not in response.model_fields_set,
        peaks=response.peaks,
        stability=response.stability,
        sensitivities=response.sensitivities,
        loaded=max((load.harmonic for load in scene.loads), default=1) or 1,
    )


def has_error_bars(scene: Scene) -> bool:
    """Return whether the error of every point is estimated: that of harmonic 1, where there is one.  Local."""
    return scene.solver.error_bars and not scene.is_static


def refuse_statics(scene: Scene, command: str) -> None:
    """Raise CaseError where nothing vibrates.  Local."""
    if scene.is_static:
        raise CaseError(
            f"{scene.path}: [solver] harmonics = 0 is a static balance; {command} needs a vibration: state at least 1, and a "
            "load in harmonic 1"
        )


def refuse_discs(scene: Scene, command: str, why: str) -> None:
    """Raise CaseError for a disc computed from one sector.  Local."""
    if scene.cyclic is not None:
        raise CaseError(f"{scene.path}: [cyclic]: {command} {why}")


@dataclass(frozen=True)
class Units:
    """The units of a scene's results."""

    outputs: tuple[str, ...]
    level: str  # "1" where loads of several kinds share it

    @property
    def works(self) -> list[int]:
        """The outputs whose amplitude times the level is a work."""
        return [k for k, unit in enumerate(self.outputs) if unit == "m" and self.level == "N"]


def units_of(scene: Scene) -> Units:
    """Return the units of a scene's results.  Local."""
    of_loads = {load.unit for load in scene.loads}
    return Units(
        tuple(output.unit for output in scene.outputs) * n_sectors_of(scene), of_loads.pop() if len(of_loads) == 1 else "1"
    )


def n_sectors_of(scene: Scene) -> int:
    """Return how many sectors have outputs: all of a whole disc, else 1.  Local."""
    return scene.cyclic.sectors if scene.cyclic is not None and scene.cyclic.whole else 1


def output_names(scene: Scene) -> tuple[str, ...]:
    """Return the names of the outputs, of a whole disc with the number of each sector, sector after sector.  Local."""
    names, n = tuple(output.name for output in scene.outputs), n_sectors_of(scene)
    return names if n == 1 else tuple(f"{name} {s}" for s in range(n) for name in names)


def number_of_output(scene: Scene, name: str | None) -> int | None:
    """Return the number of an output from 0, of a whole disc also of that of sector 0; the first by default, or None.  Local."""
    names, of_sector_0 = output_names(scene), [output.name for output in scene.outputs]  # which come first
    known = names if name in names else of_sector_0
    return 0 if name is None else list(known).index(name) if name in known else None


def band(scene: Scene) -> Band:
    """Return the range of frequencies of a scene.  Local."""
    response = scene.response
    return Band(frequencies=response.frequencies, mode=response.mode, span=response.span)


def _damping(damping: Damping) -> ModalDamping:
    return ModalDamping(
        ratio=damping.ratio,
        rayleigh=damping.rayleigh,
        ratios=damping.ratios or (),
        of_modes=damping.modes or (),
        structural=damping.structural or 0.0,
    )


def by_method(scene: Scene, method: str) -> Scene:
    """Return the scene with another method.  Local.

    Raises
    ------
    CaseError : the method cannot compute it
    """
    return changed(scene, {"solver": {"method": method}})
