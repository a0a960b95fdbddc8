"""A scene made ready for its response: what every benchmark starts from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from microslip.continuation.levels import arc_length_steps, frequency_sweep, linear_curve
from microslip.continuation.problems import ForcedResponse
from microslip.continuation.steps import ArcLength, LinearCurve
from microslip.continuation.sweep import Sweep
from microslip.harmonic.balance import HarmonicBalance
from microslip.library.response_settings import response_settings
from microslip.observe.log import RunLog, Stage
from microslip.parallel.agree import on_root
from microslip.receptance.model import ReducedModel
from microslip.reduction.build import reduce_structure
from microslip.run import Structure, build_structure
from microslip.scene.read import read_scene

MODES = 20  # of a scene with a mesh that states none


@dataclass(frozen=True)
class Prepared:
    """A reduced scene, all static columns solved for, and the time and memory of each stage."""

    scene: Any
    structure: Structure
    model: ReducedModel
    sweep: Sweep
    curve: LinearCurve
    steps: ArcLength
    stages: list[Stage]

    def problem(self, level: float) -> ForcedResponse:
        return ForcedResponse(HarmonicBalance.of_all(self.model, self.structure.pairs.law, self.scene.solver.samples), level)


def with_modes(scene):
    """Return the scene with a stated number of modes, the same for every method: as the scene says, else ``MODES``.

    Matrices may be too small for so many: theirs are left to the program.
    """
    if scene.model.mesh is None:
        return scene
    return scene.model_copy(update={"solver": scene.solver.model_copy(update={"modes": scene.solver.modes or MODES})})


def prepare(path: str, comm, points: int | None = None) -> Prepared:
    """Return a scene, reduced; ``points`` a level in place of the scene's.  Collective on ``comm``."""
    scene = with_modes(on_root(comm, read_scene, path))
    with RunLog(comm, screen=False) as log:
        structure = build_structure(scene, comm, log)
        with log.stage("static solutions of loads and outputs"):
            model = reduce_structure(structure.linearised, structure.modes, scene)
        with log.stage("static columns of all pairs"):
            model.G_static.require(np.arange(model.n_pairs))
    settings = replace(response_settings(scene), points=points or scene.response.points)
    sweep = frequency_sweep(settings, model.omega_n)
    curve = linear_curve(model, sweep)
    steps = arc_length_steps(settings, curve)
    return Prepared(scene, structure, model, sweep, curve, steps, log.stages)
