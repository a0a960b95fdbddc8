"""The reduction methods, one file each, one registry: what the scene's ``method`` names.

A method takes the stuck structure, its modes, the pairs and the scene, and returns a :class:`Reduction`.  Harmonic balance and
continuation know none of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from ..reduction import Reduction
from . import adaptive, adaptive_energy, craig_bampton, full, joint_interface_modes, receptance, rubin, trial_vectors


class Method(Protocol):
    """What each file has."""

    def reduce(self, linearised, modes, pairs, scene) -> Reduction: ...

    def coordinates(self, solver, n_modes: int, n_dof: int, n_pairs: int, n_loads: int) -> int: ...


METHODS: dict[str, Method] = {
    "receptance": receptance,
    "adaptive": adaptive,
    "adaptive-energy": adaptive_energy,
    "full": full,
    "rubin": rubin,
    "craig-bampton": craig_bampton,
    "joint-interface-modes": joint_interface_modes,
    "trial-vectors": trial_vectors,
}
CHECKS: dict[str, Callable[..., None]] = {"full": full.check}  # of size, before anything is solved


def check_size(scene, n_dof: int, n_rows: int, comm) -> None:
    """Refuse a structure that is too large for the scene's method, from its DOFs and 3 rows a pair.  Collective on ``comm``."""
    if scene.solver.method in CHECKS:
        CHECKS[scene.solver.method](scene, n_dof, n_rows, comm)


def reduce_by_method(linearised, modes, pairs, scene) -> Reduction:
    """Return the reduction by the scene's method.  Collective."""
    return METHODS[scene.solver.method].reduce(linearised, modes, pairs, scene)
