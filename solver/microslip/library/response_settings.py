"""The door of the response: its settings from a scene, with what was stated and what the program chooses."""

from __future__ import annotations

from ..continuation.settings import ResponseSettings
from ..scene.schema import Scene

_KEYS = {"harmonics": "harmonics", "samples": "samples", "solver": "tolerance"}  # of [solver], for each part of the accuracy


def response_settings(scene: Scene) -> ResponseSettings:
    """Return what a scene asks of its response.  Local."""
    solver, response, steps = scene.solver, scene.response, scene.continuation
    return ResponseSettings(
        levels=response.levels,
        frequencies=response.frequencies,
        mode=response.mode,
        span=response.span,
        at=response.at,
        direction=response.direction,
        points=response.points,
        **{key: getattr(steps, key, None) for key in ("ds", "ds_min", "ds_max")},
        samples=solver.samples,
        tolerance=solver.tolerance,
        accuracy=solver.accuracy,
        keeps=frozenset(part for part, key in _KEYS.items() if not scene.chooses(key)),
        chooses_steps="points" not in response.model_fields_set,
        loaded=max((load.harmonic for load in scene.loads), default=1) or 1,
    )
