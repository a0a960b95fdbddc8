"""The state of a branch as arrays, independent of the number of ranks; a restored state continues bitwise identically.

In addition to the last points it contains the resolution, the regularisation of the mean slip, the data of the accuracy, the next
step, the neighbours of the last maximum, and the points of the preconditioners, which are rebuilt there.  These are no part of a
solution, but decide its last bits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np

from ..fourier.harmonics import Harmonics
from ..harmonic.balance import HarmonicBalance
from ..harmonic.linearisation import Linearisation
from ..harmonic.operating_point import OperatingPoint
from ..harmonic.preconditioner import HarmonicPreconditioner, PairsPreconditioner
from ..harmonic.subdomain_preconditioners import SectorsPreconditioner, SubdomainPreconditioner
from ..harmonic.whole_inverse import WholeInverse
from .accuracy import Memory, Resolution
from .corrector import Neighbours
from .iterate import Iterate, PointState
from .point_solver import Workspace
from .problems import Problem
from .state import BranchState
from .task import BranchTask

Arrays = dict[str, np.ndarray]  # by a path: "now/U"
_POINTS = ("earlier", "before", "now")
_NUMBERS = ("size", "force", "sticks", "sliding", "moved")
_numbers = attrgetter(*_NUMBERS)
_KINDS = (WholeInverse, HarmonicPreconditioner, SubdomainPreconditioner, SectorsPreconditioner)


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a state that changes seldom: its source, and the function for its arrays.  ``arrays`` is collective."""

    of: object
    arrays: Callable[[], Arrays]

    def gathered(self) -> Part:
        """Return the part with its arrays, which take no other rank any more.  Collective."""
        arrays = self.arrays()
        return replace(self, arrays=lambda: arrays)


def state_arrays(state: BranchState) -> Arrays:
    """Return the arrays of a state that none of its parts has.  Collective."""
    solver, equation, memory = state.solver, state.solver.equation, state.memory
    newton = solver.workspace.newton_solver(equation, solver.resolution)
    arrays = {
        "resolution": np.array([equation.n_samples, solver.tolerance]),
        "harmonics": np.array(equation.harmonics.chosen),
        "step": np.array([state.ds, solver.is_linear, state.is_done, newton.needs_preconditioner]),
        "counts": np.array([*memory.calm.values(), *memory.patience.values()]),
        "ceiling": np.array(memory.ceiling),
    }
    if memory.peak is not None:
        arrays["peak"] = memory.peak
    if equation.held is not None:
        arrays["held"] = equation.gather(equation.held)
    return arrays


def parts_of(task: BranchTask, state: BranchState) -> dict[str, Part]:
    """Return the last points of a state and where its preconditioners were made, by name; the same ones on every rank.  Local."""
    solver, parts = state.solver, dict[str, Part]()
    for name in _POINTS:
        point = getattr(state, name)
        if point is not None:
            parts[name] = Part(point, partial(point_arrays, solver.equation, point))
    corrector = solver.workspace.corrector(solver.equation, solver.resolution)
    if corrector.neighbours is not None:
        parts["neighbours"] = Part(corrector.neighbours, partial(_of_neighbours, solver.equation, corrector.neighbours))
    newton = corrector.newton_solver
    adjoint, forward = (task.estimator.adjoint_solver, task.estimator.forward_solver) if task.estimator else (None, None)
    for name, solver_of in (("newton", newton), ("adjoint", adjoint), ("forward", forward)):
        if solver_of and solver_of.preconditioner is not None:
            parts[name] = Part(solver_of.preconditioner, partial(_of_preconditioner, solver_of.preconditioner))
    return parts


def from_arrays(task: BranchTask, arrays: Arrays, workspace: Workspace) -> BranchState:
    """Return the stored state, for the ranks of the task.  Collective: preconditioners are built again."""
    start = task.start(workspace)
    n_samples, tolerance = arrays["resolution"]
    solver = start.solver.resolved(Resolution(_harmonics(arrays["harmonics"]), int(n_samples), float(tolerance)))
    owned = solver.equation.model.owned
    solver = solver.holding(arrays["held"][owned] if "held" in arrays else None)
    ds, is_linear, is_done, needs_preconditioner = arrays["step"]
    parts = start.memory.calm.keys()
    calm, patience = (dict(zip(parts, map(int, counts))) for counts in arrays["counts"].reshape(2, -1))
    memory = Memory(arrays.get("peak"), calm, patience, int(arrays["ceiling"]))
    points = {name: point_state(under(name, arrays), owned) for name in _POINTS if f"{name}/U" in arrays}
    corrector = workspace.corrector(solver.equation, solver.resolution)
    if "neighbours/bend" in arrays:
        corrector.neighbours = _neighbours(under("neighbours", arrays), owned)
    made = _made_again(under("newton", arrays), solver.problem) if "newton/U" in arrays else None
    corrector.newton_solver.restore(made, bool(needs_preconditioner))
    if task.estimator is not None:
        exact = task.estimator.exact
        if "adjoint/U" in arrays:
            transposed = _made_again(under("adjoint", arrays), solver.problem, exact, transposed=True)
            task.estimator.adjoint_solver.restore(transposed)
        if "forward/U" in arrays:
            task.estimator.forward_solver.restore(_made_again(under("forward", arrays), solver.problem, exact))
    solver = replace(solver, is_linear=bool(is_linear))
    return BranchState(solver, memory, float(ds), is_done=bool(is_done), **points)


# -- a point -------------------------------------------------------------------------------------------------------


def point_arrays(equation: HarmonicBalance, point: PointState) -> Arrays:
    """Return a point's arrays.  Collective."""
    there = point.iterate
    return {
        "U": equation.gather(there.U),
        "parameters": np.array(there.parameters),
        "harmonics": np.array(there.harmonics.chosen),
        "selected": point.selected,
        "amplitude": point.amplitude,
        "numbers": np.array(_numbers(point), dtype=float),
    }


def point_state(arrays: Arrays, owned: slice) -> PointState:
    """Return the point of some arrays.  Local."""
    parameters = tuple(map(float, arrays["parameters"]))
    there = Iterate(arrays["U"][owned].copy(), parameters, _harmonics(arrays["harmonics"]))
    size, force, sticks, sliding, moved = map(float, arrays["numbers"])
    return PointState(there, arrays["selected"], size, force, bool(sticks), sliding, moved, arrays["amplitude"])


def _of_neighbours(equation: HarmonicBalance, neighbours: Neighbours) -> Arrays:
    """Return the arrays of the neighbours of a maximum.  Collective."""
    return {
        "distance": np.array(neighbours.distance),
        "bend": np.array(neighbours.bend),
        "U": np.stack([equation.gather(side.U) for side in neighbours.sides]),
        "parameters": np.array([side.parameters for side in neighbours.sides]),
        "harmonics": np.array(neighbours.sides[0].harmonics.chosen),
    }


def _neighbours(arrays: Arrays, owned: slice) -> Neighbours:
    """Return the neighbours of a maximum.  Local."""
    harmonics, sides = _harmonics(arrays["harmonics"]), zip(arrays["U"], arrays["parameters"])
    before, after = (Iterate(U[owned].copy(), tuple(map(float, parameters)), harmonics) for U, parameters in sides)
    return Neighbours(float(arrays["distance"]), float(arrays["bend"]), (before, after))


# -- where a preconditioner was made -------------------------------------------------------------------------------


def _of_preconditioner(made: WholeInverse | PairsPreconditioner) -> Arrays:
    """Return the arrays that a preconditioner can be made of again.  Collective."""
    equation, at = made.made_at.equation, made.made_at.at
    held = {} if equation.held is None else {"held": equation.gather(equation.held)}
    return held | {
        "kind": np.array(_KINDS.index(type(made))),
        "U": equation.gather(made.made_at.forces.U),
        "selected": made.made_at.forces.selected,
        "at": np.array([at.omega, at.level, at.sigma, at.damping, *(value for _, value in at.law)]),
        "harmonics": np.array(equation.harmonics.chosen),
        "n_samples": np.array(equation.n_samples),
    }


def _made_again(arrays: Arrays, problem: Problem, exact: Any = None, transposed: bool = False) -> Any:
    """Return the preconditioner made there, on request of the ``transposed``; ``exact`` gives a better equation.  Collective."""
    omega, level, sigma, damping, *values = map(float, arrays["at"])
    at = OperatingPoint(omega, level, sigma, tuple(zip(problem.law_parameters, values)), damping)
    equation, owned = problem.equation.under(at), problem.equation.model.owned
    equation = equation.resolved(_harmonics(arrays["harmonics"]), int(arrays["n_samples"]))
    equation = equation.holding(arrays["held"][owned] if "held" in arrays else None)
    equation = exact(equation) if exact else equation
    forces = equation.contact_forces(arrays["U"][owned], arrays["selected"], tangents=True)
    linear = Linearisation.of(equation, at, forces)
    return _KINDS[int(arrays["kind"])](linear.transposed() if transposed else linear)


def _harmonics(chosen: np.ndarray) -> Harmonics:
    return Harmonics(tuple(map(int, chosen)))


def over(name: str, arrays: Mapping[str, np.ndarray]) -> Arrays:
    """Return arrays with ``name`` over theirs.  Local."""
    return {f"{name}/{key}": value for key, value in arrays.items()}


def under(name: str, arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arrays under ``name``.  Local."""
    return {key.removeprefix(f"{name}/"): value for key, value in arrays.items() if key.startswith(f"{name}/")}
