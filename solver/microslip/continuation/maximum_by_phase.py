"""A maximum over the frequency, located by the phase of the motion, as a row of the system (docs/theory.md, section 7).

Along a resonance the motion of the pairs turns by half a cycle, folds included.  Solutions are taken at a given phase theta of
that motion, and the amplitude of the output is the parabola through three of them: its top is the maximum.  The distance of the
three is far above that of the corners where samples begin or end to slip, so that these do not count, and the top varies
smoothly with other parameters.  Two solutions about the phase and one at the top are enough where the curvature of the
parabola is known from the last maximum of the branch.  A mode that hardly moves the pairs does not turn their motion; then the
phase is that of the output.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .constraint_rows import Constraint, Plane
from .corrector import BorderedSystem, Correction, Corrector, Neighbours
from .iterate import Iterate
from .output_rows import PhaseRow
from .outputs import output_at

DISTANCE = 0.04  # rad between the solutions, at least
SAMPLES = 2.0  # and at least as many samples of the contact law: maxima of the sampled curve lie about one sample from each other
NEAR = 0.5  # of that distance: a parabola has its top within it if the middle solution is the highest
NEXT = 1.5  # of that distance, up to which a search shifts its three solutions
SETTLED = 0.02  # of that distance between a solution at the top and the top of the parabola through it
MOST_TOPS = 3  # solutions at a top until it settles
FARTHEST = 8.0  # of that distance, the longest step of a search
REACH = 0.25 * np.pi  # rad from the guess, the farthest phase of a search
MOST_TRIES = 12
CLOSER = 2  # times that the distance is halved where Newton's method fails next to a solution, as beyond the end of a branch
SHARP = 1.3  # 1/rad2, bend of the amplitude over the phase above which its top may be a corner; that of one mode is 1
LOOSE = 1e-5  # tolerance of solutions that only place the top: it moves by about their error over the distance
FAR = 2.0  # a solution beyond this factor of the guess's frequency, up or down, belongs to another peak
ELSEWHERE = "the solution at this phase lies elsewhere"
NO_MAXIMUM = "the output has no maximum near by"


@dataclass(frozen=True, eq=False)
class MaximumByPhase:
    """The amplitude of harmonic 1 of an output is at its maximum over the frequency, the first parameter fixed, eq. (7.9)."""

    output: int
    is_of_output: bool = False  # the phase is that of the output, not that of the pairs' motion
    has_corners: bool = True  # whether a maximum below a corner of the curve is recorded at the corner

    def correct(self, corrector: Corrector, system: BorderedSystem, guess: Iterate) -> Correction:
        """Return the maximum near a guess, subject to the other row of the system.

        Collective; never raises for divergence, which comes back as ``failure``.
        """
        return _Search(self, corrector, system, guess).maximum()

    def amplitude(self, system: BorderedSystem, there: Iterate) -> complex:
        """Return the output [m] at a solution, the same on all ranks."""
        at = system.problem.at(there.parameters)
        return output_at(system.equation, at, there.U, system.selected, self.output)


@dataclass(frozen=True, eq=False)
class _Three:
    """Solutions at the phases -1, ``t`` and 1 about a phase, in units of the distance; the middle one may be a guess, at 0."""

    t: float
    solutions: tuple[Iterate, Iterate, Iterate]
    sizes: tuple[float, float, float]  # m, their amplitudes
    is_even: bool  # solutions at -1, 0 and 1

    @property
    def has_top(self) -> bool:
        """Whether the middle solution is the highest: the top of the parabola is within half the distance of it."""
        return self.sizes[1] >= max(self.sizes)

    @property
    def bend(self) -> float:
        """The bend of the parabola through the amplitudes, above 0 where it has a top [m]."""
        low, size, high = self.sizes
        return (2.0 * size - (1.0 - self.t) * low - (1.0 + self.t) * high) / (1.0 - self.t**2)

    @property
    def top(self) -> float:
        """Where this parabola is highest."""
        rise = 0.5 * (self.sizes[2] - self.sizes[0])
        if self.bend <= 0.0:
            return FARTHEST * float(np.sign(rise))
        return float(np.clip(rise / self.bend, -FARTHEST, FARTHEST))

    def at(self, t: float) -> Iterate:
        """Return the place at ``t`` of the parabola through the solutions; beyond them, of a line.  Local."""
        if abs(t) <= 1.0:
            return combined(self.solutions, through(self.t, t))
        return combined(self.solutions, (0.5 * (self.t - t), 1.0, 0.5 * (t - self.t)))


class _Search:
    """The search for one maximum.  Collective on the communicator of the corrector."""

    def __init__(self, row: MaximumByPhase, corrector: Corrector, system: BorderedSystem, guess: Iterate):
        self.row, self.corrector, self.system, self.guess = row, corrector, system, guess
        self.newton = self.krylov = 0
        self.distance, known = max(DISTANCE, SAMPLES * 2.0 * np.pi / system.equation.n_samples), corrector.neighbours
        self.known = known if known is not None and known.distance == self.distance else None
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
        theta, about, before, three = 0.0, self.guess, None, None
        ends = [-np.inf, np.inf]  # phases between which the amplitude has its top
        for _ in range(MOST_TRIES):
            three = three or self.two_sides(theta, about) or self.with_middle(theta, about)
            if isinstance(three, Correction):
                if before is None:
                    return self.counted(three)
                theta, about, three = 0.5 * (theta + before[0]), halfway(before[1], about), None
                continue
            if abs(three.top) <= NEAR:
                solution, three = self.settled(theta, three)
                if solution is not None:
                    return self.counted(self.with_neighbours(solution, three))
            if not three.is_even:
                three = self.with_middle(theta, three.at(0.0), three)
                continue
            top, before = three.top, (theta, three.at(0.0))
            ends[0 if top > 0.0 else 1] = theta
            if not ends[0] < theta + self.distance * top < ends[1]:
                top = (0.5 * sum(ends) - theta) / self.distance
            is_next = abs(top) <= NEXT
            top = float(np.sign(top)) if is_next else top
            theta, about = theta + self.distance * top, three.at(top)
            if not (ends[0] < theta < ends[1] and abs(theta) <= REACH):
                break
            three = self.shifted(theta, three, int(top)) if is_next else None
        return self.counted(self.last, NO_MAXIMUM)

    def settled(self, theta: float, three: _Three) -> tuple[Correction | None, _Three]:
        """Return the solution at the top and the parabola through it; None if lower than a neighbour of a mere guess."""
        solution, is_sure = None, three.is_even
        for _ in range(MOST_TOPS):
            t = three.top
            solution = self.solved(theta + self.distance * t, three.at(t), self.system.constraints, is_top=True)
            if solution.failure is not None or not self.is_at_value:
                return solution, three
            low, _, high = three.solutions
            three = self.three(low, solution.iterate, high, t=t)
            if not three.has_top:
                return solution if is_sure else None, three
            if abs(three.top - t) <= SETTLED:
                break
        self.corrector.neighbours = self.neighbours(three)
        return solution, three

    # -- the solutions before and after a phase ---------------------------------------------------------------------

    def two_sides(self, theta: float, about: Iterate) -> _Three | None:
        """Return these solutions at the first parameter's value, the middle one as at the last maximum; None if that fails."""
        if not self.is_at_value:
            return None
        sides, bend = [], 1.0 if self.known is None else self.known.bend
        for way, share in ((-1, 1.0), (1, 0.5)):  # the first guess's error shifts the middle, half of the second's too
            guess = self.side(about, way)
            solution = self.solved(theta + way * self.distance, guess, self.system.constraints)
            if solution.failure is not None:
                return None
            sides.append(solution.iterate)
            off = self.turned(combined((solution.iterate, guess), (share, -share)), -way * self.distance)
            about = combined((about, off), (1.0, 1.0))
        low, high = (abs(self.output(side)) for side in sides)
        size = 0.5 * (low + high) / (1.0 - 0.5 * bend * self.distance**2)
        return _Three(0.0, (sides[0], about, sides[1]), (low, size, high), is_even=False)

    def with_middle(self, theta: float, about: Iterate, sides: _Three | None = None) -> _Three | Correction:
        """Return these solutions and the middle one, which is solved for first if they are unknown; or the failed solve."""
        here = self.solved(theta, about, self.system.constraints)
        if here.failure is not None:
            return here
        if sides is not None:
            low, _, high = sides.solutions
            return self.three(low, here.iterate, high)
        three = self.about(theta, here.iterate)
        for _ in range(CLOSER):
            if isinstance(three, Correction):
                self.distance, self.known = 0.5 * self.distance, None
                three = self.about(theta, here.iterate)
        return three

    def about(self, theta: float, here: Iterate) -> _Three | Correction:
        """Return a solution with those before and after it; or the failed solve."""
        held = (Plane.fixed_parameter(here),)
        before = self.solved(theta - self.distance, self.as_one_mode(here, -1), held)
        if before.failure is not None:
            return before
        after = self.solved(theta + self.distance, self.opposite(before.iterate, here, 1), held)
        if after.failure is not None:
            after = self.solved(theta + self.distance, self.turned(here, self.distance), held)
        return after if after.failure is not None else self.three(before.iterate, here, after.iterate)

    def shifted(self, theta: float, three: _Three, way: int) -> _Three | Correction:
        """Return the solutions about the next phase ``theta``, one ``way`` further; or the failed solve."""
        middle, here = three.solutions[1], three.solutions[1 + way]
        held = (Plane.fixed_parameter(here),)
        beyond = self.solved(theta + way * self.distance, self.opposite(middle, here, way), held)
        if beyond.failure is not None:
            return beyond
        low, high = (middle, beyond.iterate)[::way]
        return self.three(low, here, high)

    def three(self, low: Iterate, here: Iterate, high: Iterate, t: float = 0.0) -> _Three:
        """Return three solutions with their amplitudes."""
        before, size, after = (abs(self.output(there)) for there in (low, here, high))
        return _Three(t, (low, here, high), (before, size, after), is_even=t == 0.0)

    @property
    def is_at_value(self) -> bool:
        """Whether the row of the step holds the first parameter at its value.  Local, the same on all ranks."""
        return all(isinstance(row, Plane) and row.is_at_value for row in self.system.constraints)

    def side(self, there: Iterate, way: int) -> Iterate:
        """Return a guess of a neighbour of a solution near the top, from the neighbours of the last maximum.  Local."""
        if self.known is None:
            return self.as_one_mode(there, way)
        side = self.known.sides[way > 0].on(there.harmonics)
        return self.turned(combined((there, replace(side, U=self.size * side.U)), (1.0, 1.0)), way * self.distance)

    def neighbours(self, three: _Three) -> Neighbours:
        """Return the neighbours of the maximum, the solution in the middle.  Local."""
        low, here, high = (
            self.turned(there, (three.t - t) * self.distance) for there, t in zip(three.solutions, (-1.0, three.t, 1.0))
        )
        places = (combined((low, here, high), through(three.t, three.t + way)) for way in (-1.0, 1.0))
        before, after = (combined((place, here), (1.0, -1.0)) for place in places)
        sides = replace(before, U=before.U / self.size), replace(after, U=after.U / self.size)
        return Neighbours(self.distance, self.bend(three), sides)

    def with_neighbours(self, solution: Correction, three: _Three) -> Correction:
        """Return the solution at the top with its neighbours, where the curve may have a corner there.  Local."""
        low, _, high = three.solutions
        return replace(solution, neighbours=(low, high)) if self.row.has_corners and self.bend(three) > SHARP else solution

    def bend(self, three: _Three) -> float:
        """Return the bend of the amplitude over the phase [1/rad2], relative to the amplitude.  Local."""
        return three.bend / (three.sizes[1] * self.distance**2)

    def turned(self, there: Iterate, theta: float) -> Iterate:
        """Return the motion of the pairs ``theta`` [rad] later, where it turns with the mode.  Local."""
        return there if self.row.is_of_output else rotated(there, theta)

    def as_one_mode(self, there: Iterate, way: int) -> Iterate:
        """Return a guess of a neighbour of a solution near the top of a resonance, as if of a single mode.  Local."""
        theta, width = way * self.distance, self.system.scaling.parameters[1]
        turned = self.turned(there, theta)
        value, omega = turned.parameters
        size = 1.0 if self.row.is_of_output else np.cos(theta)
        return replace(turned, U=size * turned.U, parameters=(value, omega - 0.5 * width * np.tan(theta)))

    def opposite(self, side: Iterate, here: Iterate, way: int) -> Iterate:
        """Return about the solution one ``way`` on from ``here``, on the line through ``side``, which is before it.  Local."""
        return self.turned(combined((here, self.turned(side, way * self.distance)), (2.0, -1.0)), way * self.distance)

    def solved(self, theta: float, guess: Iterate, constraints: tuple[Constraint, ...], is_top: bool = False) -> Correction:
        """Return the solution ``theta`` [rad] beyond the phase of the guess of the search, under other rows."""
        system, tolerance = replace(self.system, constraints=(self.at(theta), *constraints)), self.corrector.tolerance
        solution = self.corrector.correct(system, guess, tolerance=tolerance if is_top else max(tolerance, LOOSE))
        self.newton, self.krylov = self.newton + solution.newton, self.krylov + solution.krylov
        if solution.failure is None and not 1.0 / FAR < solution.iterate.parameters[1] / self.guess.parameters[1] < FAR:
            solution = replace(solution, failure=ELSEWHERE)
        self.last = solution
        return solution

    def at(self, theta: float) -> Constraint:
        """Return the row of that phase.  Local."""
        if self.row.is_of_output:
            return PhaseRow(self.row.output, self.size, self.phase + theta)
        about = rotated(self.guess, theta)
        return Plane(about, rotated(about, 0.5 * np.pi).U / self.size, (0.0,) * len(about.parameters))

    def output(self, there: Iterate) -> complex:
        """Return the output [m] at a solution, the same on all ranks."""
        return self.row.amplitude(self.system, there)

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
    return combined((a, b), (0.5, 0.5))


def combined(places: Sequence[Iterate], weights: Sequence[float]) -> Iterate:
    """Return a weighted sum of iterates, their parameters included.  Local."""
    U, parameters = np.zeros_like(places[0].U), np.zeros(len(places[0].parameters))
    for there, weight in zip(places, weights):
        U += weight * there.U
        parameters += weight * np.array(there.parameters)
    return replace(places[0], U=U, parameters=tuple(map(float, parameters)))


def through(t: float, at: float) -> tuple[float, float, float]:
    """Return the weights at a place of the values at -1, ``t`` and 1 in the parabola through them.  Local."""
    return (
        (at - t) * (at - 1.0) / (2.0 * (1.0 + t)),
        (at + 1.0) * (at - 1.0) / (t**2 - 1.0),
        (at + 1.0) * (at - t) / (2.0 * (1.0 - t)),
    )
