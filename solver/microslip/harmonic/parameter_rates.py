"""Derivatives of the equation of harmonic balance by numbers of the contact law, and by those of the structure.

docs/theory.md, sections 4, 6 and 11.  A stiffness of the law also changes the structure with all pairs stuck.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..contact.law import Law
from ..receptance.damping import Damping
from ..receptance.motions import linear_motion, linear_motion_rate
from ..receptance.springs import stated_damping_rate
from .balance import HarmonicBalance
from .mean_slip import HOLD
from .operating_point import ContactForces, LawParameter, OperatingPoint, Rates, stiffness_rates


def law_rate(equation: HarmonicBalance, forces: ContactForces, parameter: LawParameter) -> np.ndarray:
    """Return the derivative of p of the active pairs of all ranks by a parameter of the law, (3 n_active, N_H).

    Collective: one gather.  The motion is constant.
    """
    active_owned, d_p = forces.active_owned, np.zeros((len(forces.active_owned), 3, equation.model.N_H))
    _, chosen, of_parameter = np.intersect1d(active_owned + equation.model.owned.start, parameter.pairs, return_indices=True)
    if len(chosen):
        law, U = equation.law.take(active_owned[chosen]), forces.U[active_owned[chosen]]
        d_p[chosen] = _rate_of(equation, law, parameter.name, U) * parameter.shape[of_parameter, None, None]
    return equation.gather(d_p.reshape(-1, equation.model.N_H))


def _rate_of(equation: HarmonicBalance, law: Law, name: str, U: np.ndarray) -> np.ndarray:
    """Return how p of some pairs changes with a parameter of each under a motion that stays, (n, 3, N_H).  Local."""
    rate = law.parameter_rate(name, U, equation.n_samples, equation.harmonics)
    if equation.held is not None:
        rate[:, :2, 0] *= 1.0 - HOLD
    return rate


def contact_force_rates(equation: HarmonicBalance, forces: ContactForces, names: Sequence[str]) -> list[np.ndarray | None]:
    """Return how p + K_J U of this rank's pairs changes with the parameter of each, (n_owned, 3, N_H) for each name.

    Local.  The motion stays as it is.  None where no pair's law has the parameter.
    """
    active, law, rates = forces.active_owned, equation.law.take(forces.active_owned), list[np.ndarray | None]()
    for name in names:
        rate = np.zeros(equation.shape) if name in equation.law.parameters else None
        if rate is not None and len(active) and name in law.parameters:
            rate[active] = _rate_of(equation, law, name, forces.U[active])
        if rate is not None and name in ("k_t", "k_n"):
            rate += unit_springs(equation, name)[:, :, None] * forces.U
        rates.append(rate)
    return rates


def unit_springs(equation: HarmonicBalance, name: str) -> np.ndarray:
    """Return the rate of the springs K_J of this rank's pairs by a stiffness of each, (n_owned, 3).  Local."""
    n = equation.n_owned
    return equation.cached(f"springs of {name}", n, lambda: _springs_of(equation.law, name, np.ones(n)))


def spring_rate(equation: HarmonicBalance, parameter: LawParameter) -> np.ndarray:
    """Return the derivative of K_J of the pairs of a stiffness parameter by its value, (m, 3) in ascending pair order.

    Collective: one gather.
    """
    mine = equation.owned_by_rank(parameter)
    pairs_owned = parameter.pairs[mine] - equation.model.owned.start
    unit = _springs_of(equation.law.take(pairs_owned), parameter.name, parameter.shape[mine])
    return equation.gather(unit[np.argsort(pairs_owned)])


def moved_by_springs(equation: HarmonicBalance, at: OperatingPoint, parameter: LawParameter, V: np.ndarray) -> np.ndarray:
    """Return G dK_J V, (n_owned, 3, N_H), for motions V of this rank's pairs and the derivative dK_J by a stiffness.

    Collective: two gathers.  The result is minus the derivative of V, the motion under given forces, with constant damping
    matrix.
    """
    pairs, owned = np.sort(parameter.pairs), equation.model.owned
    mine = (pairs >= owned.start) & (pairs < owned.stop)
    forces = spring_rate(equation, parameter)[mine][:, :, None] * V[pairs[mine] - owned.start]
    return equation.receptance(at, pairs).apply(equation.gather(forces.reshape(-1, equation.model.N_H)))


def structure_rates(equation: HarmonicBalance, rates: Rates) -> tuple[float, float, list[Damping] | None]:
    """Return the rates of omega, of sigma and of the damping of each group; None: it is constant.

    Local; collective by a stiffness: one gather.
    """
    of_springs, stated, of_damping = stiffness_rates(rates), equation.model.stated_damping, None
    if of_springs and stated is not None:
        dK = np.zeros((equation.model.n_pairs, 3))
        for parameter, of_value in of_springs:
            dK[np.sort(parameter.pairs)] += of_value * spring_rate(equation, parameter)
        of_damping = [Damping(stated_damping_rate(group.receptance.modes, stated, dK.ravel())) for group in equation.model.groups]
    elif rates.get("damping", 0.0):
        of_damping = [group.receptance.modes.stated_part(stated, rates["damping"]) for group in equation.model.groups]
    return rates.get("omega", 0.0), rates.get("sigma", 0.0), of_damping


def rate_of_linear_motion(equation: HarmonicBalance, at: OperatingPoint, rates: Rates) -> np.ndarray:
    """Return the derivative of U_lin by a parameter, (n_owned, 3, N_H).  Local; collective for a stiffness: one gather."""
    model, level = equation.model_at(at), rates.get("level", 0.0)
    d_U = linear_motion_rate(model, at.level, at.omega, *structure_rates(equation, rates)).reshape(equation.shape)
    per_newton = linear_motion(model, 1.0, at.omega).reshape(equation.shape) if level else 0.0
    d_U = d_U + level * per_newton
    for parameter, of_value in stiffness_rates(rates):
        d_U -= of_value * moved_by_springs(equation, at, parameter, equation.linear_motion(at))
    return d_U


def _springs_of(law: Law, name: str, values: np.ndarray) -> np.ndarray:
    """Return the springs K_J that k_t or k_n of each pair makes, (n, 3) [N/m], where these have the ``values`` (n,).  Local."""
    springs = law.with_parameters(name, np.arange(law.n_pairs), values).stiffness.copy()
    springs[:, [2] if name == "k_t" else [0, 1]] = 0.0
    return springs
