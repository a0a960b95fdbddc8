"""A maximum over the frequency found by its phase, as a row of the system (docs/theory.md, section 7).

Along a resonance the motion of the pairs turns by half a cycle, folds included.  Solutions are taken at a given phase theta of
that motion, and the amplitude of the output is the parabola through three of them: its top is the maximum.  The distance of the
three is far above that of the corners where samples begin or end to slip, so that these do not count, and the top varies
smoothly with other parameters.  A mode that hardly moves the pairs does not turn their motion; then the phase is that of the
output.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..error_estimate.estimate import output_amplitude
from .constraint_rows import Constraint, Plane
from .corrector import BorderedSystem, Correction, Corrector
from .iterate import Iterate
from .output_rows import PhaseRow

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
    is_of_output: bool = False  # the phase is that of the output, not that of the pairs' motion

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
        self.apart = max(APART, SAMPLES * 2.0 * np.pi / system.equation.n_samples)
        if row.is_of_output:
            a = self.output(guess)
            self.size, self.phase = abs(a), float(np.angle(a))
            return
        quarter = rotated(guess, 0.5 * np.pi).U
        self.size = float(np.sqrt(corrector.comm.allreduce(float(np.vdot(quarter, quarter)))))

    def maximum(self) -> Correction:
        """Return the maximum, or the last solve with why there is none."""
        if self.size == 0.0:
            return Correction(self.guess, 0, 0, float("inf"), "nothing moves: no phase")
        theta, about, before = 0.0, self.guess, None
        ends = [-np.inf, np.inf]  # phases between which the amplitude has its top
        for _ in range(MOST_TRIES):
            here = self.solved(theta, about, self.system.constraints)
            if here.failure is not None:
                if before is None:
                    return self.counted(here)
                theta, about = 0.5 * (theta + before[0]), halfway(before[1], about)
                continue
            held = (Plane.fixed_parameter(here.iterate),)
            low = self.solved(theta - self.apart, self.as_one_mode(here.iterate, -self.apart), held)
            if low.failure is not None:
                return self.counted(low)
            high = self.solved(theta + self.apart, self.opposite(low.iterate, here.iterate), held)
            if high.failure is not None:
                high = self.solved(theta + self.apart, self.turned(here.iterate, self.apart), held)
            if high.failure is not None:
                return self.counted(high)
            sizes = np.array([abs(self.output(solution.iterate)) for solution in (low, here, high)])
            top, before = top_of(sizes), (theta, here.iterate)
            ends[0 if top > 0.0 else 1] = theta
            if abs(top) > NEAR and not ends[0] + self.apart < theta + self.apart * top < ends[1] - self.apart:
                top = (0.5 * sum(ends) - theta) / self.apart
            theta, about = theta + self.apart * top, along(low.iterate, here.iterate, high.iterate, top)
            if abs(top) <= NEAR:
                return self.counted(self.solved(theta, about, self.system.constraints, is_top=True))
        return self.counted(here, NO_MAXIMUM)

    def turned(self, there: Iterate, theta: float) -> Iterate:
        """Return the motion of the pairs ``theta`` [rad] later, where it turns with the mode.  Local."""
        return there if self.row.is_of_output else rotated(there, theta)

    def as_one_mode(self, there: Iterate, theta: float) -> Iterate:
        """Return about the solution ``theta`` [rad] beyond one near the top of a resonance, as if it were of one mode.  Local."""
        width, turned = self.system.scaling.parameters[1], self.turned(there, theta)
        value, omega = turned.parameters
        size = 1.0 if self.row.is_of_output else np.cos(theta)
        return replace(turned, U=size * turned.U, parameters=(value, omega - 0.5 * width * np.tan(theta)))

    def opposite(self, side: Iterate, here: Iterate) -> Iterate:
        """Return about the solution as far beyond ``here`` as ``side`` is before it, on the line through both.  Local."""
        parameters = 2.0 * np.array(here.parameters) - side.parameters
        U = 2.0 * here.U - self.turned(side, self.apart).U
        return self.turned(replace(here, U=U, parameters=tuple(map(float, parameters))), self.apart)

    def solved(self, theta: float, guess: Iterate, constraints: tuple[Constraint, ...], is_top: bool = False) -> Correction:
        """Return the solution ``theta`` [rad] beyond the phase of the guess of the search, under other rows."""
        system, tolerance = replace(self.system, constraints=(self.at(theta), *constraints)), self.corrector.tolerance
        solution = self.corrector.correct(system, guess, self.is_patient, tolerance if is_top else max(tolerance, LOOSE))
        self.newton, self.krylov = self.newton + solution.newton, self.krylov + solution.krylov
        return solution

    def at(self, theta: float) -> Constraint:
        """Return the row of that phase.  Local."""
        if self.row.is_of_output:
            return PhaseRow(self.row.output, self.size, self.phase + theta)
        about = rotated(self.guess, theta)
        return Plane(about, rotated(about, 0.5 * np.pi).U / self.size, (0.0,) * len(about.parameters))

    def output(self, there: Iterate) -> complex:
        """Return the output [m] at a solution, the same on all ranks."""
        problem, at = self.system.problem, self.system.problem.at(there.parameters)
        equation = problem.equation.under(at)
        p = equation.full_force(equation.contact_forces(there.U, self.system.selected, tangents=False))
        cos, sin = output_amplitude(equation.model_at(at), at, p)[self.row.output :: equation.model.n_outputs]
        return self.corrector.comm.bcast(complex(cos, -sin))

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


def halfway(a: Iterate, b: Iterate) -> Iterate:
    """Return the middle of two iterates.  Local."""
    parameters = 0.5 * (np.array(a.parameters) + b.parameters)
    return replace(b, U=0.5 * (a.U + b.U), parameters=tuple(map(float, parameters)))


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
