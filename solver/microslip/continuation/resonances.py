"""Detection of resonances that a step would pass without a point on them (docs/theory.md, section 7).

Far off, a resonance leaves the motion small on both sides and turns it by half a cycle.  With 1 / eta a straight line in the
frequency, as of one mode, the two ends of a step determine the largest motion in between.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from ..receptance.motions import modal_motion
from ..receptance.reduced_model import HarmonicGroup
from .iterate import Iterate, PointState
from .point_solver import PointSolver
from .steps import LinearCurve

RISES = np.sqrt(2.0)  # over the higher end of a step, beyond which the motion between the ends is computed: half power
SEEN = 0.3  # share of the motion of an output at the ends that the peak of a mode has, at least, to be looked for
LEAST_DAMPING = 1e-6  # ratio with which the width of an undamped mode is reckoned
FAINT_PEAK = 0.02  # of the largest amplitude of an output, below which a peak of the linear curve is not looked for
TINY = 1e-300  # where the line meets 0: as high as numbers go
PASSED = "a resonance may lie between the point before and this one, too sharp for the shortest step"  # a note of a point
NEAREST, FARTHEST = 0.1, 0.75  # shares of a step that passes over a resonance in which it is looked for


def passed_over(solver: PointSolver, now: PointState, there: Iterate) -> float | None:
    """Return the share of a step at which a resonance is expected that no point would show; None where there is none.

    Collective.  It compares the motion of the pairs as a whole, which turns with the resonances of whatever state the joint is
    in, and each mode of the stuck structure that the step passes.
    """
    if "omega" not in solver.problem.rates(there.parameters)[0]:
        return None
    share = turned_over(solver, now.iterate, there)
    if share is None or stay_stuck(solver, now, there):
        share = modes_passed(solver, now.iterate, there)
    return None if share is None else float(np.clip(share, NEAREST, FARTHEST))


def stay_stuck(solver: PointSolver, now: PointState, there: Iterate) -> bool:
    """Return whether all pairs stick at a point and at the next one: both lie on the linear curve.  Collective if the first does.

    That curve is a function of the frequency.  Without damping it may pass through no motion at all, where it turns round as it
    does at a resonance.
    """
    return now.sticks and solver.problem.curve.holds(there.parameters)


def highest_between(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest |eta| between complex amplitudes ``a`` and ``b`` of one mode, and the share of the way at which it is.

    Local.  docs/theory.md, eq. (7.4).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        start, way = 1.0 / a, 1.0 / b - 1.0 / a
        share = np.clip(np.nan_to_num(-(start * way.conj()).real / np.abs(way) ** 2), 0.0, 1.0)
        nearest = np.abs(start + share * way)
        return np.where(np.isfinite(nearest), 1.0 / np.maximum(nearest, TINY), 0.0), share


def turned_over(solver: PointSolver, here: Iterate, there: Iterate) -> float | None:
    """Return the share of a step at which the motion of all pairs rises between its ends; None where it does not.  Collective."""
    U, V = solver.vibration(here.on(solver.harmonics).U), solver.vibration(there.on(solver.harmonics).U)
    products = np.array([np.vdot(U, U), np.vdot(V, V), np.vdot(U, V)])
    solver.comm.Allreduce(MPI.IN_PLACE, products)
    if products[2] >= 0.0:
        return None
    a, b = np.sqrt(products[:2])
    turn = np.arccos(max(products[2] / (a * b), -1.0))
    highest, share = highest_between(np.array(a + 0j), np.array(b * np.exp(-1j * turn)))
    return float(share) if highest > RISES * max(a, b) else None


def modes_passed(solver: PointSolver, here: Iterate, there: Iterate) -> float | None:
    """Return the share of a step at which a mode of the stuck structure peaks unseen; None where none does.

    Collective where the step passes one whose half-power width is shorter: the pairs' forces at both ends.  The highest counts.
    """
    at, to = (solver.problem.at(iterate.parameters) for iterate in (here, there))
    low, high, model = min(at.omega, to.omega), max(at.omega, to.omega), solver.equation.model
    passed = [_passed(group, low, high) for group in model.groups]
    if not any(modes.any() for modes in passed):
        return None
    peaks = []
    for group, modes, a, b in zip(model.groups, passed, _modal_motion(solver, here), _modal_motion(solver, there)):
        o = group.receptance.modes.o
        background = np.maximum(np.abs(o @ a), np.abs(o @ b))  # (n_outputs, n_harmonics)
        highest, where = highest_between(a, b)
        rises = modes & (highest > RISES * np.maximum(np.abs(a), np.abs(b)))
        is_visible = np.abs(o)[:, :, None] * highest > SEEN * background[:, None, :]  # (n_outputs, m, n_harmonics)
        peaks += [(highest[k, n], where[k, n]) for k, n in np.argwhere(rises & is_visible.any(axis=0))]
    return max(peaks)[1] if peaks else None


def unresolved_peaks(curve: LinearCurve, omegas: np.ndarray) -> np.ndarray:
    """Return the frequencies [rad/s] of the peaks of a sampled linear curve on whose half-power width no one of ``omegas`` lies.

    Local.  Peaks of any output and harmonic, from ``FAINT_PEAK`` of its largest on.
    """
    frequencies = []
    for amplitude in np.moveaxis(np.hypot(curve.response[..., 1::2], curve.response[..., 2::2]), 0, -1).reshape(
        -1, len(curve.omega)
    ):
        inner = amplitude[1:-1]
        tops = 1 + np.flatnonzero((inner > amplitude[:-2]) & (inner >= amplitude[2:]) & (inner > FAINT_PEAK * amplitude.max()))
        for i in tops:
            below = np.flatnonzero(amplitude < amplitude[i] / RISES)
            low, high = below[below < i].max(initial=0), below[below > i].min(initial=len(amplitude) - 1)
            if not np.any((curve.omega[low] <= omegas) & (omegas <= curve.omega[high])):
                frequencies.append(curve.omega[i])
    return np.unique(frequencies)


def _passed(group: HarmonicGroup, low: float, high: float) -> np.ndarray:
    """Return which modes a step between two frequencies passes in which harmonic, longer than their width, (m, n_harmonics)."""
    n, modes = group.harmonics.numbers, group.receptance.modes
    omega_n = modes.omega_n[:, None]
    passed = (n * low < omega_n) & (omega_n < n * high)
    if passed.any():
        passed &= n * (high - low) > 2.0 * np.maximum(modes.zeta[:, None], LEAST_DAMPING) * omega_n
    return passed


def _modal_motion(solver: PointSolver, there: Iterate) -> list[np.ndarray]:
    """Return the modal amplitudes of each group of the harmonics at a solution.  Collective."""
    equation, at, there = solver.equation_at(there), solver.problem.at(there.parameters), there.on(solver.harmonics)
    p = equation.full_force(equation.contact_forces(there.U, equation.every_pair, tangents=False))
    return modal_motion(equation.model_at(at), at.level, at.omega, p)
