"""Beyond a resonance that neither damping nor friction holds (docs/theory.md, section 7)."""

from __future__ import annotations

import numpy as np

from .iterate import PointState
from .point_solver import PointSolver

OFF = 4.0 ** np.arange(5)  # times the distance of the last point from the resonance, at which a branch is begun beyond it
BEYOND = "the motion grows without bound before this point, at a resonance that neither damping nor friction holds: begun anew"


def where_unbounded(solver: PointSolver, before: PointState, now: PointState) -> float | None:
    """Return where 1 / |U'| falls to 0 on the straight line through the last two points, docs/theory.md, eq. (7.5).

    Collective.  None where it does not, where the branch has turned back, or where it goes along something else than a frequency.
    """
    a, b = (solver.norm(solver.vibration(state.iterate.U)) for state in (before, now))
    step = now.iterate.parameter - before.iterate.parameter
    is_frequency = solver.problem.at(before.iterate.parameters).omega != solver.problem.at(now.iterate.parameters).omega
    if not b > a > 0.0 or step * solver.sweep.direction <= 0.0 or not is_frequency:
        return None
    return now.iterate.parameter + step * a / (b - a)


def places_beyond(solver: PointSolver, before: PointState, now: PointState) -> list[float]:
    """Return where a branch may begin anew beyond a resonance that the last two points rise to, the nearest first.  Collective.

    None is so far off that a value asked for, or the end of the range, lies before it.
    """
    here, resonance = now.iterate.parameter, where_unbounded(solver, before, now)
    if resonance is None:
        return []
    places = [float(resonance + off * (resonance - here)) for off in OFF]
    return [there for there in places if not solver.sweep.beyond(there) and not solver.sweep.asked_between(here, there)]
