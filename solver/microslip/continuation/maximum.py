"""A maximum over the frequency as a row of the system, solved for between two solutions (docs/theory.md, section 7).

Where a sample of the contact law begins or ends to slip, the slope of an amplitude jumps.  Near its peak a curve bends mostly by
such jumps: the maximum is a corner, without a zero of the slope for Newton's method.  The other rows of the system define a curve
of solutions, on which the maximum is bracketed between a solution with rising and one with falling amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..contact.law import STICK
from ..harmonic.adjoint_solver import AdjointSolver
from .constraint_rows import Plane
from .corrector import BorderedSystem, Correction, Corrector
from .iterate import Iterate
from .output_rates import Rates, output_rates
from .outputs import output_at

EXACT = 1e-8  # relative tolerance of the linear solves for rates
MOST_SOLUTIONS = 40
CLOSE = 1e-3  # share of the first interval within which a corner is enclosed
CLOSEST = 1e-12  # share of it that is not divided further
REACH = 0.3  # most of a first step towards the maximum, in the scaled norm, where no neighbour on the curve is known
DIVISIONS = 4  # of the parts of the curve next to the highest solution, between the neighbours of a maximum where pairs slip
FURTHER = 12  # further divisions, if a search from the highest solution ends lower
ABOVE = 1e-5  # of a maximum, by which one on another piece of the curve must be higher
SAME = 0.1  # of the distance to a maximum, within which a solution is the maximum itself
WIDE = 0.99  # of a maximum: if the solution that first showed it is lower, others next to it may be higher
SHARES = 0.5, 0.2  # of such a part from its higher end, where it is divided; the second if Newton's method fails
INWARD = tuple(0.5**k for k in range(1, 9))  # of the way from a neighbour that the search begins at, to a higher solution
ONWARD = 1.0, 0.3, 0.1  # of the part on the other side, lengths of an extrapolation
BACK = 0.9  # cosine of the angle between two chords from a solution, above which they are on the same part of the curve
HALVES = 3  # of the way from one solution to another one, where Newton's method fails
OVERSHOOT = 1.5  # times the distance to the maximum of a resonance: the first step ends beyond it


Row = list[tuple[Iterate, float]]  # a solution between two that are lower, along the curve, with their amplitudes


@dataclass(frozen=True, eq=False)
class Sample:
    """A solution on the curve of the other rows, and the amplitude of the output there; numbers agree on all ranks."""

    t: float  # its coordinate
    iterate: Iterate
    rate: np.ndarray  # (n_owned, 3, N_H) dU / dt [m]
    size: float  # |a|
    slope: float  # d|a| / dt

    def tangent(self, t: float) -> float:
        """Return the amplitude at a coordinate on the tangent of the curve [m].  Local."""
        return self.size + self.slope * (t - self.t)


@dataclass(frozen=True, eq=False)
class Maximum:
    """The amplitude of harmonic 1 of an output is at a maximum over the frequency, other parameters fixed."""

    output: int
    omega: int  # number of the frequency among the parameters
    forward: AdjointSolver
    neighbours: tuple[Iterate, ...] = ()  # solutions on both sides of the maximum, where they are known

    def correct(self, corrector: Corrector, system: BorderedSystem, guess: Iterate) -> Correction:
        """Return the maximum near a guess, under the k - 1 rows of the system.

        Collective; never raises for divergence, which comes back as ``failure``.
        """
        return _Search(self, corrector, system).maximum(guess)

    def rates(self, system: BorderedSystem, there: Iterate) -> Rates | None:
        """Return the output and its rates at a solution; None if the Jacobian is singular.  Collective."""
        return output_rates(system, there, [self.output], self.forward)


class _Search:
    """The search for one maximum.  Collective on the communicator of the corrector."""

    def __init__(self, row: Maximum, corrector: Corrector, system: BorderedSystem):
        self.row, self.corrector, self.system = row, corrector, system
        self.newton = self.krylov = 0
        self.neighbours = row.neighbours
        self.solution: Correction | None = None  # the last one that converged
        self.normal: Plane | None = None  # its coordinate t, through the first solution; None before that is known

    def maximum(self, guess: Iterate) -> Correction:
        """Return the maximum; about the highest of some solutions if pairs slip or the guess alone does not lead to it."""
        if len(self.row.neighbours) != 2:
            return self.from_guess(guess, self.at_frequency(guess))
        given, first = guess, self.solved(guess, self.at_frequency(guess))
        if first.failure is not None:  # as from the linear motion where pairs slip
            higher = max(self.row.neighbours, key=self.size)
            first = self.solved(higher, self.at_frequency(higher))
        if first.failure is not None:
            return first
        guess = first.iterate
        before, after = ((there, self.size(there)) for there in self.row.neighbours)
        if any(map(self.slips, (guess, *self.row.neighbours))):
            guess = self.inside(given, guess)
        else:
            maximum = self.from_guess(guess, self.at_frequency(guess))
            is_higher = self.is_as_high(maximum, self.size(guess))
            if is_higher and not self.slips(maximum.iterate):
                return maximum
            self.normal, guess = None, maximum.iterate if is_higher else guess
        size = self.size(guess)
        row = self.narrowed([before, (guess, size), after], DIVISIONS)
        if row is None:
            return self.from_guess(guess, self.at_frequency(guess))
        maximum = self.within(row)
        highest = self.size(maximum.iterate)
        if size < WIDE * highest:
            row = self.narrowed([before, (maximum.iterate, highest), after], DIVISIONS)
            if row is not None and row[1][1] > highest:
                maximum = self.within(row)
        return self.on_higher_piece(maximum)

    def inside(self, given: Iterate, solution: Iterate) -> Iterate:
        """Return a higher solution on the way from a neighbour to the other one, if the search begins at it.  Collective.

        The curve rises from there; the way is halved until it leads to such a solution.
        """
        for end, other in (self.row.neighbours, self.row.neighbours[::-1]):
            for share in INWARD if self.distance(given, end) == 0.0 else ():
                there = self.on_line(end, other, share)
                if there is not None and self.size(there) > self.size(end):
                    return there
        return solution

    def at_frequency(self, about: Iterate) -> Plane:
        """Return the plane of the frequency of a place.  Local."""
        return Plane(about, np.zeros_like(about.U), tuple(np.eye(len(about.parameters))[self.row.omega]))

    def on_higher_piece(self, maximum: Correction) -> Correction:
        """Return the highest solution of a piece of the curve that overlaps the one of a maximum, where that is higher.

        Where a pair begins to slip its mean position may jump, and with it the solution: the curve continues next to its end.
        """
        best, size, state = maximum, self.size(maximum.iterate), self.state(maximum.iterate)
        for end in self.neighbours if self.normal else ():
            if self.corrector.comm.allreduce(int(np.count_nonzero(self.state(end) != state))):
                top, within = self.along_piece(end, maximum.iterate)
                if top is not None and top.size > size:
                    best, size = replace(self.ended(top), within=within), top.size
        return replace(best, newton=self.newton, krylov=self.krylov)

    def along_piece(self, end: Iterate, top: Iterate) -> tuple[Sample | None, float]:
        """Return the highest solution on the piece of a neighbour of a maximum, and the width [rad/s] that it is known to.

        Steps to the place of the maximum, ``top``, and beyond it, halved where the solution is no longer on the piece.  None
        if that leads to the maximum itself and the tangent there shows no higher solution before it.
        """
        here, t, size = self.at(self.place(end), end), self.place(top), self.size(top)
        step = 0.0 if here is None else t - here.t
        for _ in range(MOST_SOLUTIONS):
            if here is None or here.slope * step <= 0.0:
                return None, 0.0
            new = self.at(here.t + step, self.ahead_of(here, step))
            same = SAME * self.distance(here.iterate, top)
            if new is not None and new.size >= here.size and self.distance(new.iterate, top) > same:
                if new.slope * step <= 0.0:
                    return self.between(*((here, new) if step > 0.0 else (new, here)))
                here = new
            elif (t - here.t) / step > 0.5 and here.tangent(t) <= (1.0 + ABOVE) * size:
                return None, 0.0
            elif abs(here.slope * step) > self.corrector.tolerance * here.size:
                step *= 0.5
            else:
                break
        return here, abs(step * self.coordinate_plane.n_nu[self.row.omega] * self.system.scaling.parameters[self.row.omega])

    def is_as_high(self, maximum: Correction, size: float) -> bool:
        """Return whether a search ended at a solution that is not lower than one that it began near.  Collective."""
        return maximum.failure is None and self.size(maximum.iterate) >= (1.0 - self.corrector.tolerance) * size

    def from_guess(self, guess: Iterate, plane: Plane) -> Correction:
        """Return the maximum near a guess, whose plane leads to a first solution."""
        start, failure = self.sample(guess, plane)
        if start is None:
            return failure
        ends = self.enclosed(start)
        if ends is None:
            return replace(self.ended(start), failure="the output has no maximum near by")
        best, within = self.between(*ends)
        return replace(self.ended(best), within=within)

    def ended(self, best: Sample) -> Correction:
        """Return a sample as the outcome of all solves."""
        assert self.solution is not None
        return replace(self.solution, iterate=best.iterate, newton=self.newton, krylov=self.krylov)

    # -- the highest of some solutions on the curve ----------------------------------------------------------------

    def narrowed(self, row: Row, divisions: int) -> Row | None:
        """Return the highest of some solutions between a solution and its neighbours, and the two next to it.

        The curve of a sampled law has small maxima near the highest one, at corners; and it may turn back at its top, beyond
        which a coordinate fixed at one solution does not reach.  Comparing amplitudes avoids both.  None without two lower
        neighbours.
        """
        for _ in range(divisions):
            (low, _), (here, _), (high, _) = row
            below, above = self.beside(high, here, low), self.beside(low, here, high)
            row = [each for each in (row[0], below, row[1], above, row[2]) if each is not None]
            k = int(np.argmax([size for _, size in row]))
            if not 0 < k < len(row) - 1:
                return None
            row = row[k - 1 : k + 2]
        return row

    def within(self, row: Row) -> Correction:
        """Return the maximum between two solutions near the one between them.

        If a search from that one ends lower, the highest solution after further divisions.
        """
        (before, _), (here, size), (after, _) = row
        self.neighbours, self.normal = (before, after), None
        chord = self.chord(before, after)
        assert chord is not None, "the neighbours are lower than the solution between them"
        maximum = self.from_guess(here, replace(chord, about=here))
        if self.is_as_high(maximum, size):
            return maximum
        (before, _), (here, _), (after, _) = self.narrowed(row, FURTHER) or row
        ends = [there.parameters[self.row.omega] for there in (before, here, after)]
        return replace(maximum, iterate=here, failure=None, within=max(ends) - min(ends))

    def beside(self, other: Iterate, here: Iterate, end: Iterate) -> tuple[Iterate, float] | None:
        """Return a solution between this one and an end of the curve, with its amplitude; None without one.

        If the curve bends so much that planes across the chord do not meet it, or meet its part on the other side, the solution
        is extrapolated from there.
        """
        reach, back = self.distance(here, end), self.distance(other, here)
        for share in SHARES:
            there = self.on_line(here, end, share)
            if there is not None and self.distance(there, here) <= reach and not self.leads_back(there, here, other):
                return there, self.size(there)
        for share in ONWARD:
            if share * back < reach:
                there = self.on_line(other, here, 1.0 + share)
                if there is not None and self.distance(there, here) <= 2.0 * share * back:
                    return there, self.size(there)
        return None

    def leads_back(self, there: Iterate, here: Iterate, other: Iterate) -> bool:
        """Return whether the chords from here to a solution and to the other one are nearly parallel.  Collective."""
        a, b, c = self.distance(there, here), self.distance(other, here), self.distance(there, other)
        return a * a + b * b - c * c > 2.0 * a * b * BACK

    def on_line(self, a: Iterate, b: Iterate, share: float) -> Iterate | None:
        """Return the solution on the plane across a chord, at a share of its length; None without one."""
        chord = self.chord(a, b)
        if chord is None:
            return None
        parameters = tuple(float(p + share * (q - p)) for p, q in zip(a.parameters, b.parameters))
        about = replace(a, U=a.U + share * (b.U - a.U), parameters=parameters)
        solution = self.solved(about, replace(chord, about=about))
        return solution.iterate if solution.failure is None else None

    def chord(self, a: Iterate, b: Iterate) -> Plane | None:
        """Return the plane across the chord from one solution to another; None where they are one.  Collective."""
        scaling = self.system.scaling
        n_U, n_nu = (b.U - a.U) / scaling.U, np.subtract(b.parameters, a.parameters) / scaling.parameters
        length = np.sqrt(self.dot(n_U, n_U) + n_nu @ n_nu)
        return Plane(a, n_U / length, tuple(n_nu / length)) if length > 0.0 else None

    def distance(self, a: Iterate, b: Iterate) -> float:
        """Return the distance of two motions in the scaled norm.  Collective."""
        n_U = (b.U - a.U) / self.system.scaling.U
        return float(np.sqrt(self.dot(n_U, n_U)))

    def slips(self, there: Iterate) -> bool:
        """Return whether a pair does not stick in a motion.  Collective."""
        return self.corrector.comm.allreduce(int(np.count_nonzero(self.state(there) != STICK))) > 0

    def state(self, there: Iterate) -> np.ndarray:
        """Return the states of this rank's pairs in a motion.  Collective as :meth:`.HarmonicBalance.under`."""
        equation, at = self.system.equation, self.system.problem.at(there.parameters)
        return equation.under(at).contact_forces(there.U, self.system.selected, tangents=False).state

    def size(self, there: Iterate) -> float:
        """Return the amplitude of the output at a solution, the same on all ranks."""
        at = self.system.problem.at(there.parameters)
        return abs(output_at(self.system.equation, at, there.U, self.system.selected, self.row.output))

    # -- solutions on the curve ------------------------------------------------------------------------------------

    def sample(self, guess: Iterate, plane: Plane, t: float = 0.0) -> tuple[Sample | None, Correction]:
        """Return the solution on a plane across the curve, None where there is none; the first one makes the coordinate."""
        solution = self.solved(guess, plane)
        if solution.failure is None:
            rates = self.row.rates(self.system, solution.iterate)
            if rates is not None:
                self.solution = solution
                return self.along(solution.iterate, rates, t), solution
            solution = replace(solution, failure="the linearisation is singular")
        return None, replace(solution, newton=self.newton, krylov=self.krylov)

    def solved(self, guess: Iterate, plane: Plane) -> Correction:
        """Return the solution on a plane, from a guess.  Collective."""
        system = replace(self.system, constraints=(plane, *self.system.constraints))
        solution = self.corrector.correct(system, guess)
        self.newton, self.krylov = self.newton + solution.newton, self.krylov + solution.krylov
        return solution

    def along(self, there: Iterate, rates: Rates, t: float) -> Sample:
        """Return a solution as a sample of the curve."""
        d_nu = np.eye(len(there.parameters))[self.row.omega]
        if self.normal is None:
            self.normal = self.coordinate(there, rates, d_nu)
        length, size = self.ahead(rates, d_nu), float(np.hypot(*rates.a))
        slope = float(rates.a @ (d_nu @ rates.a_nu)) / (size or 1.0) / length
        size, slope = self.corrector.comm.bcast((size, slope))
        rate = np.tensordot(d_nu, rates.V, 1) * (self.system.scaling.U / length)
        return Sample(t, there, rate, size, slope)

    def coordinate(self, there: Iterate, rates: Rates, d_nu: np.ndarray) -> Plane:
        """Return the plane normal to the curve at its first solution; the mean does not count, as in the norm of steps."""
        n_U = np.tensordot(d_nu, rates.V, 1)
        n_U[..., there.harmonics.mean] = 0.0
        length = np.sqrt(self.dot(n_U, n_U) + d_nu @ d_nu)
        return Plane(there, n_U / length, tuple(d_nu / length))

    def ahead(self, rates: Rates, d_nu: np.ndarray) -> float:
        """Return how far a change of the parameters leads along the coordinate."""
        return self.dot(self.coordinate_plane.n_U, np.tensordot(d_nu, rates.V, 1)) + float(
            np.dot(self.coordinate_plane.n_nu, d_nu)
        )

    @property
    def coordinate_plane(self) -> Plane:
        """The plane of the coordinate, once the first solution is known."""
        assert self.normal is not None
        return self.normal

    def dot(self, a: np.ndarray, b: np.ndarray) -> float:
        return self.corrector.comm.allreduce(float(np.vdot(a, b)))

    def place(self, there: Iterate) -> float:
        """Return the coordinate of a place."""
        about, scaling = self.coordinate_plane.about, self.system.scaling
        d_nu = np.subtract(there.parameters, about.parameters) / scaling.parameters
        return self.dot(self.coordinate_plane.n_U, (there.U - about.U) / scaling.U) + float(
            np.dot(self.coordinate_plane.n_nu, d_nu)
        )

    def at(self, t: float, guess: Iterate) -> Sample | None:
        """Return the solution at a coordinate."""
        return self.sample(guess, replace(self.coordinate_plane, about=self.moved(self.coordinate_plane.about, t)), t)[0]

    def part_way(self, here: Sample, t: float) -> Sample | None:
        """Return a solution on the way to a coordinate, halved until Newton's method converges; None if it does not."""
        for way in (t - here.t) * 0.5 ** np.arange(1, HALVES + 1):
            there = self.at(here.t + way, self.ahead_of(here, way))
            if there is not None:
                return there
        return None

    def ahead_of(self, here: Sample, way: float) -> Iterate:
        """Return a place ``way`` further, along the direction of the curve at a solution."""
        return replace(self.moved(here.iterate, way), U=here.iterate.U + way * here.rate)

    def moved(self, there: Iterate, way: float) -> Iterate:
        """Return a place further along the normal."""
        scaling, normal = self.system.scaling, self.coordinate_plane
        parameters = there.parameters + way * np.array(normal.n_nu) * scaling.parameters
        return Iterate(there.U + way * scaling.U * normal.n_U, tuple(map(float, parameters)), there.harmonics)

    # -- the maximum between them ----------------------------------------------------------------------------------

    def enclosed(self, start: Sample) -> tuple[Sample, Sample] | None:
        """Return two solutions of which the first rises and the second falls, by coordinate; None if no falling one follows."""
        way, here = float(np.sign(start.slope)), start
        if way == 0.0:
            return start, start
        neighbours = [abs(t) for t in map(self.place, self.neighbours) if t * way > 0.0]
        likely = OVERSHOOT * abs(start.slope) / (start.size or 1.0)
        step = way * (0.5 * min(neighbours) if neighbours else min(max(likely, 1e-3 * REACH), REACH))
        for _ in range(MOST_SOLUTIONS // 2):
            new = self.at(here.t + step, self.ahead_of(here, step))
            if new is None:
                step *= 0.5
            elif new.slope * way <= 0.0:
                return (here, new) if way > 0.0 else (new, here)
            else:
                here, step = new, 2.0 * step
        return None

    def between(self, low: Sample, high: Sample) -> tuple[Sample, float]:
        """Return the best solution between a rising and a falling one, and the width [rad/s] that it is known to.

        The next solution is at the zero of the slopes' secant (a smooth maximum) or at the crossing of the tangents (a corner:
        the slopes at the ends do not approach each other as the interval shrinks).
        """
        first, tolerance = high.t - low.t, self.corrector.tolerance
        lengths, jumps = list[float](), list[float]()
        for _ in range(MOST_SOLUTIONS):
            length, jump, corner = high.t - low.t, low.slope - high.slope, crossing(low, high)
            flattest = min(low, high, key=lambda end: abs(end.slope))
            if abs(flattest.slope) * first <= tolerance * flattest.size:
                return flattest, 0.0
            best = min(low, high, key=lambda end: abs(end.slope * (corner - end.t)))
            is_corner = not jumps or jump / jumps[-1] > (length / lengths[-1]) ** 0.5
            is_met = is_corner and abs(best.slope * (corner - best.t)) <= tolerance * best.size
            if (is_met and length <= CLOSE * first) or length <= CLOSEST * first:
                break
            t = corner if is_corner else low.t + length * low.slope / jump
            if is_met:  # from the other side, too
                t = corner + (0.5 if best is low else -0.5) * CLOSE * first
            if len(lengths) > 2 and length > 0.25 * lengths[-3]:
                t = 0.5 * (low.t + high.t)
            new = self.at(t, hermite(low, high, t)) or self.part_way(best, t)
            if new is None:
                break
            low, high = (new, high) if new.slope > 0.0 else (low, new)
            lengths.append(length)
            jumps.append(jump)
        width = abs(high.iterate.parameters[self.row.omega] - low.iterate.parameters[self.row.omega])
        return best, width


def crossing(low: Sample, high: Sample) -> float:
    """Return the crossing of the tangents of the amplitude at two solutions, eq. (7.8), if between them; else the middle."""
    width = high.t - low.t
    way = np.divide(high.size - low.size - high.slope * width, low.slope - high.slope) if low.slope != high.slope else np.nan
    return low.t + float(way) if 0.0 < way < width else 0.5 * (low.t + high.t)


def hermite(a: Sample, b: Sample, t: float) -> Iterate:
    """Return the place at ``t`` of the cubic through two solutions along their directions; parameters on the chord.  Local."""
    width = b.t - a.t
    s = (t - a.t) / width
    h_a, h_b, d_a, d_b = (1 + 2 * s) * (1 - s) ** 2, s * s * (3 - 2 * s), s * (1 - s) ** 2, s * s * (s - 1)
    U = h_a * a.iterate.U + h_b * b.iterate.U + width * (d_a * a.rate + d_b * b.rate)
    parameters = tuple(float(p + s * (q - p)) for p, q in zip(a.iterate.parameters, b.iterate.parameters))
    return Iterate(U, parameters, a.iterate.harmonics)
