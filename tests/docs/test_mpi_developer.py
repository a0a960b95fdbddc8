"""The developer's script gives the curve of the library, and prints the shapes that its page shows."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from microslip.continuation.follow import follow_branch
from microslip.continuation.levels import arc_length_steps
from microslip.continuation.task import BranchTask
from microslip.library.build import build
from microslip.library.prepare import prepare
from microslip.scene.read import read_scene

DOCS = Path(__file__).parents[2] / "docs"
SCRIPT = DOCS / "developer" / "curve.py"
MESH = DOCS.parent / "meshes" / "fan_small.msh"


@pytest.mark.ranks(1)
@pytest.mark.slow
@pytest.mark.skipif(not MESH.exists(), reason="make demo makes the mesh")
def test_the_inner_calls_give_the_curve_of_the_library(comm):
    lines = []
    branch = runpy.run_path(str(SCRIPT))["curve"](comm=comm, show=lines.append)
    if comm.size == 1:
        assert "\n".join(lines) in (DOCS / "developer.md").read_text(encoding="utf-8")
    scene = read_scene(DOCS.parent / "jobs" / "fan_small.toml")
    scene = scene.model_copy(update={"solver": scene.solver.model_copy(update={"modes": 20})})
    with build(scene, comm) as structure:
        ready = prepare(structure, has_bars=False).response
        steps = arc_length_steps(replace(ready.settings, points=24), ready.curve)
        task = BranchTask(ready.at_level(5.0), ready.selection, ready.sweep, steps, ready.settings.tolerance)
        points = follow_branch(task, 240).points
    ours, theirs = (np.array([point.response for point in some]) for some in (branch.points, points))
    assert np.abs(ours - theirs).max() < 1e-10 * np.abs(theirs).max()
