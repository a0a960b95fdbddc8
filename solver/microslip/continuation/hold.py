"""The mean slip that nothing holds: held where most pairs slip or Newton fails (docs/theory.md, section 5)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .acceptance import Accepted
from .point_solver import PointSolver
from .steps import ArcLength

MOSTLY = 0.8  # share of the pairs that slip or are open, from which the mean of the slip is held, and below which it is let go
MOVED = 0.5  # share of the pairs whose sliders move, or have come to rest elsewhere, from which it is held where Newton fails


def hold(solver: PointSolver, moving: float, least: float, anyhow: bool = False) -> PointSolver | None:
    """Return the solver with the mean slip held about the state of rest; None where it is, or nothing asks for it.

    Collective.  ``moving`` is a share of the pairs, ``least`` that from which it is held, if nothing but its joint holds a body;
    ``anyhow`` from any share on.
    """
    if solver.equation.held is not None or (moving < least and not anyhow) or not solver.is_loose:
        return None
    return solver.holding(np.zeros((solver.equation.n_owned, 2)))


def let_go(after: Accepted, steps: ArcLength) -> Accepted:
    """Return a point with the mean slip no longer held; still held where Newton does not find it so.  Collective.

    It is looked for where the mean is that of the linear motion, from which the springs may have let it drift.
    """
    solver, now = after.state.solver.holding(None), after.now
    at_rest, mean = now.iterate.U.copy(), solver.harmonics.mean
    at_rest[..., mean] = solver.on_curve(now.iterate.parameter).U[..., mean]
    found, selected = solver.solve_near(replace(now.iterate, U=at_rest), now)
    if found.failure is not None or solver.distance(now, found.iterate) > steps.ds_max:
        return after
    free = replace(now, iterate=found.iterate, selected=selected)
    return replace(after, state=replace(after.state, solver=solver), now=free)
