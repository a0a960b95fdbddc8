"""The mean slip that nothing holds: held where Newton fails, let go where pairs stick again (docs/theory.md, section 5)."""

from __future__ import annotations

from dataclasses import replace

from .acceptance import Accepted
from .iterate import PointState
from .point_solver import PointSolver
from .steps import ArcLength

MOVED = 0.5  # share of the pairs whose sliders move, or have come to rest elsewhere, from which the mean of the slip may be held
MOSTLY = 0.8  # share of the pairs that slip or are open, below which it is let go


def hold(solver: PointSolver, now: PointState) -> PointSolver | None:
    """Return the solver with the mean slip held about what it is at a point, a solution; None where that is of no help.

    Collective.
    """
    if solver.equation.held is not None or now.moved < MOVED or not solver.is_loose:
        return None
    return solver.holding(solver.equation.mean_force(now.iterate.U, now.selected))


def let_go(after: Accepted, steps: ArcLength) -> Accepted:
    """Return a point with the mean slip no longer held; still held where Newton does not find it so.  Collective.

    The springs may have let the mean drift far from where the pairs that stick again hold it: it is looked for where it is,
    and where it is without slip.
    """
    solver, now = after.state.solver.holding(None), after.now
    at_rest, mean = now.iterate.U.copy(), solver.harmonics.mean
    at_rest[..., mean] = solver.linear_motion(now.iterate.parameter)[..., mean]
    for U in (at_rest, now.iterate.U):
        found, selected = solver.solve_near(replace(now.iterate, U=U), now)
        if found.failure is None and solver.distance(now, found.iterate) <= steps.ds_max:
            free = replace(now, iterate=found.iterate, selected=selected)
            return replace(after, state=replace(after.state, solver=solver), now=free)
    return after
