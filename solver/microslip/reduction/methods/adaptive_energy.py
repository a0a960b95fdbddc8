"""`adaptive-energy`: the same, with the pairs that lost energy in the last solution, or opened."""

from __future__ import annotations

from ..internal_variable import reduce_to_pairs
from ..reduction import Reduction
from ..selection import DissipatingPairs


def coordinates(solver, n_modes: int, n_dof: int, n_pairs: int, n_loads: int) -> int:
    """Return how many unknowns a harmonic coefficient has at most.  Local."""
    return n_modes + 3 * n_pairs


def reduce(linearised, modes, pairs, scene) -> Reduction:
    """Return the reduction.  Collective."""
    solver = scene.solver
    return reduce_to_pairs(linearised, modes, scene, DissipatingPairs(solver.in_point_check, solver.energy_tolerance))
