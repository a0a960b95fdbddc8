"""All bad inputs."""

from __future__ import annotations

from . import bad_commands, bad_discs, bad_machines, bad_matrices, bad_models, bad_results, bad_scenes
from .case import Case

BY_SORT: dict[str, list[Case]] = {
    "scene": bad_scenes.CASES,
    "model": bad_models.CASES,
    "matrices": bad_matrices.CASES,
    "command": bad_commands.CASES,
    "results": bad_results.CASES,
    "disc": bad_discs.CASES,
    "machine": bad_machines.CASES,
}
CASES = [case for cases in BY_SORT.values() for case in cases]
