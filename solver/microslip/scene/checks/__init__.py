"""Checks across the tables of a scene: references between tables, contradictions, and missing files."""

from collections.abc import Callable, Iterable

from ..schema import Scene
from . import solution, structure
from .disc import of_disc
from .solution import of_wear


def contradictions(scene: Scene) -> list[str]:
    """Return the contradictions between the tables of a scene, one text each.  Local."""
    of_kind = structure.of_matrices if scene.model.mesh is None else structure.of_a_mesh
    checks: tuple[Callable[[Scene], Iterable[str]], ...] = (
        *(structure.materials, structure.same_groups, structure.same_names, solution.harmonics, solution.constant_loads),
        *(structure.base, structure.outputs, structure.surfaces, structure.statics, structure.volumes_as_faces),
        *(structure.points, solution.bars, solution.peaks, solution.stability, solution.sensitivities, solution.over),
        *(solution.mode, of_wear, of_disc, of_kind, solution.damping),
    )
    return [text for check in checks for text in check(scene)]
