"""A maximum over the frequency found by its phase, as a row of the system (docs/theory.md, section 7).

Along a resonance the motion of the pairs turns by half a cycle, folds included.  Solutions are taken at a given phase theta of
that motion, and the amplitude of the output is the parabola through three of them: its top is the maximum.  The distance of the
three is far above that of the corners where samples begin or end to slip, so that these do not count, and the top varies
smoothly with other parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..error_estimate.estimate import output_amplitude
from .constraint_rows import Constraint, Plane
from .corrector import BorderedSystem, Correction, Corrector
from .iterate import Iterate

APART = 0.04  # rad between the three solutions, at least
SAMPLES = 2.0  # and at least as many samples of the contact law: maxima of the sampled curve lie about one apart
NEAR = 1.0  # of that distance within which the top of a parabola is taken as the maximum
FARTHEST = 8.0  # of that distance by which a search goes on at most
MOST_TRIES = 12
LOOSE = 1e-5  # tolerance of the three, which only place the top: it moves by about their error over the distance
NO_MAXIMUM = "the output has no maximum near by"


@dataclass(frozen=True, eq=False)
class MaximumByPhase:
    """The amplitude of harmonic 1 of an output is at its maximum over the frequency, the first parameter fixed, eq. (7.9)."""

    output: int

    def correct(self, corrector: Corrector, system: BorderedSystem, guess: Iterate, is_patient: bool = False) -> Correction:
        """Return the maximum near a guess, under the row of the system beside that of the phase.

        Collective; never raises for divergence, which comes back as ``failure``.
        """
        return _Search(self, corrector, system, guess, is_patient).maximum()


class _Search:
    """The search for one maximum.  Collective on the communicator of the corrector."""

    def __init__(self, row: MaximumByPhase, corrector: Corrector, system: BorderedSystem, guess: Iterate, is_patient: bool):
        self.row, self.corrector, self.system, self.guess, self.is_patient = row, corrector, system, guess, is_patient
        self.newton = self.krylov = 0
        turned = rotated(guess, 0.5 * np.pi).U
        self.apart = max(APART, SAMPLES * 2.0 * np.pi / system.equation.n_samples)
        self.size = float(np.sqrt(corrector.comm.allreduce(float(np.vdot(turned, turned)))))

    def maximum(self) -> Correction:
        """Return the maximum, or the last solve with why there is none."""
        if self.size == 0.0:
            return Correction(self.guess, 0, 0, float("inf"), "the pairs do not move: no phase")
        theta, about = 0.0, self.guess
        for _ in range(MOST_TRIES):
            here = self.solved(theta, about, self.system.constraints)
            if here.failure is not None:
                return self.counted(here)
            held = (Plane.fixed_parameter(here.iterate),)
            low = self.solved(theta - self.apart, self.as_one_mode(here.iterate, -self.apart), held)
            if low.failure is not None:
                return self.counted(low)
            high = self.solved(theta + self.apart, opposite(low.iterate, here.iterate, self.apart), held)
            if high.failure is not None:
                high = self.solved(theta + self.apart, rotated(here.iterate, self.apart), held)
            if high.failure is not None:
                return self.counted(high)
            sizes = np.array([self.amplitude(solution.iterate) for solution in (low, here, high)])
            top = top_of(sizes)
            theta, about = theta + self.apart * top, along(low.iterate, here.iterate, high.iterate, top)
            if abs(top) <= NEAR:
                return self.counted(self.solved(theta, about, self.system.constraints, is_top=True))
        return self.counted(here, NO_MAXIMUM)

    def as_one_mode(self, there: Iterate, theta: float) -> Iterate:
        """Return about the solution ``theta`` [rad] beyond one near the top of a resonance, as if it were of one mode.  Local."""
        width, turned = self.system.scaling.parameters[1], rotated(there, theta)
        value, omega = turned.parameters
        return replace(turned, U=np.cos(theta) * turned.U, parameters=(value, omega - 0.5 * width * np.tan(theta)))

    def solved(self, theta: float, guess: Iterate, constraints: tuple[Constraint, ...], is_top: bool = False) -> Correction:
        """Return the solution whose motion has the phase ``theta`` [rad] from the guess of the search, under other rows."""
        about = rotated(self.guess, theta)
        phase = Plane(about, rotated(about, 0.5 * np.pi).U / self.size, (0.0,) * len(about.parameters))
        system, tolerance = replace(self.system, constraints=(phase, *constraints)), self.corrector.tolerance
        solution = self.corrector.correct(system, guess, self.is_patient, tolerance if is_top else max(tolerance, LOOSE))
        self.newton, self.krylov = self.newton + solution.newton, self.krylov + solution.krylov
        return solution

    def amplitude(self, there: Iterate) -> float:
        """Return |a| of the output at a solution, the same on all ranks."""
        problem, at = self.system.problem, self.system.problem.at(there.parameters)
        equation = problem.equation.under(at)
        p = equation.full_force(equation.contact_forces(there.U, self.system.selected, tangents=False))
        amplitudes = output_amplitude(equation.model_at(at), at, p)
        return self.corrector.comm.bcast(float(np.hypot(*amplitudes[self.row.output :: equation.model.n_outputs])))

    def counted(self, solution: Correction, failure: str | None = None) -> Correction:
        """Return a solution as the outcome of all solves."""
        return replace(solution, newton=self.newton, krylov=self.krylov, failure=failure or solution.failure)


def rotated(there: Iterate, theta: float) -> Iterate:
    """Return the motion ``theta`` of a cycle [rad] later, u_n exp(i n theta), at the same parameters.  Local."""
    harmonics, U = there.harmonics, there.U.copy()
    cos, sin = there.U[..., harmonics.cos], there.U[..., harmonics.sin]
    c, s = np.cos(harmonics.above_mean * theta), np.sin(harmonics.above_mean * theta)
    U[..., harmonics.cos], U[..., harmonics.sin] = c * cos + s * sin, c * sin - s * cos
    return replace(there, U=U)


def opposite(side: Iterate, here: Iterate, theta: float) -> Iterate:
    """Return about the solution ``theta`` [rad] beyond ``here``, on the line from the one as far before it.  Local."""
    turned = rotated(side, theta)
    parameters = 2.0 * np.array(here.parameters) - side.parameters
    return rotated(replace(here, U=2.0 * here.U - turned.U, parameters=tuple(map(float, parameters))), theta)


def top_of(sizes: np.ndarray) -> float:
    """Return where the parabola through three sizes at -1, 0 and 1 is highest, within the reach of a search."""
    rise, bend = 0.5 * (sizes[2] - sizes[0]), sizes[0] - 2.0 * sizes[1] + sizes[2]
    if bend >= 0.0:
        return FARTHEST * float(np.sign(rise))
    return float(np.clip(-rise / bend, -FARTHEST, FARTHEST))


def along(low: Iterate, here: Iterate, high: Iterate, t: float) -> Iterate:
    """Return the place at ``t`` of the parabola through three solutions at -1, 0 and 1; beyond, of a line.  Local."""
    weights = (0.5 * t * (t - 1.0), 1.0 - t * t, 0.5 * t * (t + 1.0)) if abs(t) <= 1.0 else (-0.5 * t, 1.0, 0.5 * t)
    U = weights[0] * low.U + weights[1] * here.U + weights[2] * high.U
    parameters = np.array([there.parameters for there in (low, here, high)]).T @ weights
    return replace(here, U=U, parameters=tuple(map(float, parameters)))
