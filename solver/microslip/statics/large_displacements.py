"""Equilibrium with large displacements: Newton's method with equilibria of small displacements (docs/theory.md, section 12)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from ..assembly.system import System
from ..mesh.data import ContactPairs
from ..messages.errors import CaseError, ConvergenceError
from .equilibrium import Flexibility, Rest, equilibrium

CLOSE = 1e-8  # change of the last step over the largest displacement: the next change would be its square
MOST_STEPS = 12  # Newton steps under one fraction of the load
SHORTEST = 1.0 / 16.0  # shortest step, as a fraction of the load


@dataclass(frozen=True, eq=False)
class About:
    """The structure linearised about a displacement, under a fraction of the load."""

    system: System  # with K_T [N/m]
    forces_owned: np.ndarray  # (n_dof_owned,) N, this rank's rows of the forces besides that fraction of the constant loads
    pairs: ContactPairs  # with the areas of the deformed surfaces


@dataclass(frozen=True, eq=False)
class LargeProblem:
    """An equilibrium problem with large displacements, for :func:`large_equilibrium`."""

    system: System
    # arguments: this rank's rows of a displacement, fraction of the load, whether the stress is in equilibrium
    about: Callable[[np.ndarray, float, bool], About]
    forces_owned: np.ndarray  # (n_dof_owned,) N, constant, this rank's rows
    n_steps: int  # load steps of each contact problem
    free_bodies: Callable[[], str]
    where: str  # the scene file, for messages


def large_equilibrium(problem: LargeProblem) -> tuple[Rest, About, int]:
    """Return the rest under all loads, the structure linearised about it, and the number of Newton steps.

    Collective.  docs/theory.md, eq. (12.14).  Load steps without solution are halved.

    Raises
    ------
    ConvergenceError : no equilibrium, for example beyond the buckling load; on every rank
    ResourceError : not enough memory for a factor
    """
    u, rest = np.zeros(len(problem.forces_owned)), None
    fraction, step, n_taken = 0.0, 1.0, 0
    while fraction < 1.0:
        next_fraction = min(fraction + step, 1.0)
        try:
            attempt, n_more = _under(problem, u, next_fraction)
        except (CaseError, ConvergenceError) as failure:
            step *= 0.5
            if step < SHORTEST:
                reached = f"{fraction:.1%} of the load" if fraction > 0.0 else "the very beginning of the load"
                raise ConvergenceError(
                    f"{problem.where}: [statics] large_displacements: no equilibrium beyond {reached}: {failure}"
                ) from failure
            continue
        rest, u, fraction, n_taken, step = attempt, attempt.u_owned, next_fraction, n_taken + n_more, min(2.0 * step, 1.0)
    assert rest is not None, "at least one step"
    return rest, problem.about(u, 1.0, True), n_taken


def _under(problem: LargeProblem, u: np.ndarray, fraction: float) -> tuple[Rest, int]:
    """Return the rest under a fraction of the load, from a displacement (n_dof_owned,), and the number of steps.  Collective."""
    comm = problem.system.comm
    for k in range(1, MOST_STEPS + 1):
        rest = _step(problem, u, fraction, k > 1)
        change, size = (comm.allreduce(np.abs(local).max(initial=0.0), MPI.MAX) for local in (rest.u_owned - u, rest.u_owned))
        u = rest.u_owned
        if k > 1 and change <= CLOSE * size:
            return rest, k
    raise ConvergenceError(f"{MOST_STEPS} steps of Newton's method, and the last changed u by {change:.1e} m of {size:.1e} m")


def _step(problem: LargeProblem, u: np.ndarray, fraction: float, is_stressed: bool) -> Rest:
    """Return the rest of the structure linearised about a displacement.  Collective; frees its factor."""
    about = problem.about(u, fraction, is_stressed)
    try:
        G = Flexibility.of(about.system, about.pairs)
        try:
            loads = fraction * problem.forces_owned + about.forces_owned
            return equilibrium(G, about.pairs, loads, problem.n_steps, free_bodies=problem.free_bodies)
        finally:
            G.destroy()
    finally:
        about.system.destroy(problem.system)
