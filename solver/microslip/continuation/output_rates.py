"""How outputs and the motion change with the parameters along solutions (docs/theory.md, section 7, eq. (7.7))."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..error_estimate.estimate import output_amplitude, sensitivity
from ..harmonic.adjoint_solver import AdjointSolver
from ..harmonic.linearisation import Linearisation
from .corrector import BorderedSystem
from .iterate import Iterate

DIFFERENCE = 1e-3  # of the unit of a parameter, over which rates at fixed forces are differences of the fourth order


@dataclass(frozen=True, eq=False)
class Rates:
    """Outputs at a solution, and how they and the motion change with the k parameters, others fixed; parameters are scaled."""

    a: np.ndarray  # (2 n_outputs,) cosines, then sines
    a_nu: np.ndarray  # (k, 2 n_outputs)
    V: np.ndarray  # (k, n_owned, 3, N_H) dU / d nu, in the unit of the motion


def output_rates(system: BorderedSystem, there: Iterate, outputs: list[int], forward: AdjointSolver) -> Rates | None:
    """Return some outputs and their rates at a solution, eq. (7.7), dU/dnu = -J^-1 dr/dnu; None if J is singular.  Collective."""
    problem, units, scaling = system.problem, np.array(system.scaling.parameters), system.scaling
    at = problem.at(there.parameters)
    equation = system.equation.under(at)
    model, N_H = equation.model_at(at), equation.model.N_H
    rows = [*outputs, *(model.n_outputs + output for output in outputs)]
    linear = Linearisation.of(equation, at, equation.contact_forces(there.U, system.selected, tangents=True))
    p, rates = equation.full_force(linear.forces), problem.rates(there.parameters)
    right = np.stack([-unit * equation.gather(linear.rate(rate)).reshape(-1, N_H) for rate, unit in zip(rates, units)])
    V, P_V, is_solved = linear.solve_several(right, forward)
    B = sensitivity(model, at.omega)[rows][:, equation.model.owned_rows]
    by_motion = equation.agreed_sum(-P_V @ B.reshape(len(rows), -1).T)

    def amplitude(nu: np.ndarray) -> np.ndarray:
        """Return the outputs at other parameters under the same forces."""
        beside = problem.at(tuple(map(float, there.parameters + nu * units)))
        return output_amplitude(equation.model_at(beside), beside, p)[rows]

    at_fixed_forces = np.array([rate_along(amplitude, direction) for direction in np.eye(len(units))])
    V = V.reshape(len(V), *equation.shape) / scaling.U
    return Rates(amplitude(np.zeros(len(units))), at_fixed_forces + by_motion, V) if is_solved else None


def rate_along(f: Callable[[np.ndarray], np.ndarray], direction: np.ndarray) -> np.ndarray:
    """Return the derivative of ``f`` at 0 along a direction, by differences of the fourth order."""
    h = DIFFERENCE * direction
    return (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * DIFFERENCE)
