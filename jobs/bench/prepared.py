"""A scene prepared for its response: the start of every benchmark."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from microslip.continuation.levels import ResponseProblem, arc_length_steps
from microslip.continuation.problems import ForcedResponse
from microslip.continuation.steps import ArcLength, LinearCurve
from microslip.library.build import Structure, build
from microslip.library.prepare import prepare as ready
from microslip.observe.log import RunLog, Stage
from microslip.parallel.agree import on_root
from microslip.points.sweep import Sweep
from microslip.receptance.reduced_model import ReducedModel
from microslip.scene.read import read_scene

MODES = 20  # of a scene with a mesh and without a stated number


@dataclass(frozen=True)
class Prepared:
    """A scene reduced by `receptance`, all static columns solved for, and the time and memory of each stage."""

    scene: Any
    structure: Structure
    response: ResponseProblem
    stages: list[Stage]

    @property
    def model(self) -> ReducedModel:
        return self.response.model

    @property
    def sweep(self) -> Sweep:
        return self.response.sweep

    @property
    def curve(self) -> LinearCurve:
        return self.response.curve

    @property
    def steps(self) -> ArcLength:
        return self.response.steps

    def steps_of(self, points: int) -> ArcLength:
        """Return the step lengths for another number of points per level."""
        return arc_length_steps(replace(self.response.settings, points=points), self.curve)

    def problem(self, level: float) -> ForcedResponse:
        return self.response.at_level(level)


def of_bench(scene, points: int | None = None):
    """Return the scene with `receptance` and a fixed number of modes for every method: the scene's, else ``MODES``.

    Of matrices, which may be too small for so many, the program chooses.  ``points`` per level replaces the scene's.
    """
    modes = scene.solver.modes if scene.model.mesh is None else scene.solver.modes or MODES
    solver = scene.solver.model_copy(update={"method": "receptance", "modes": modes})
    response = scene.response.model_copy(update={"points": points or scene.response.points})
    return scene.model_copy(update={"solver": solver, "response": response})


def prepare(path: str, comm, points: int | None = None) -> Prepared:
    """Return a scene, reduced; ``points`` per level replaces the scene's.  Collective on ``comm``."""
    scene = of_bench(on_root(comm, read_scene, path), points)
    with RunLog(comm, screen=False) as log:
        structure = build(scene, comm, log)
        with log.stage("reduction"):
            response = ready(structure, has_bars=False).response
        with log.stage("static columns of all pairs"):
            response.model.receptance_of(1).static.G_static.require(np.arange(response.model.n_pairs))
    return Prepared(scene, structure, response, log.stages)
