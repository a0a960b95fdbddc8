"""Solve single points of a branch, in whatever harmonics and samples (docs/theory.md, section 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..fourier.harmonics import Harmonics
from ..harmonic.residual import HarmonicBalance
from ..parallel.errors import ConvergenceError
from ..reduction.selection import Selection
from .accuracy import Resolution
from .corrector import ConstraintRow, Correction, Corrector, Iterate, Scaling, row_weights
from .sweep import Sweep

SHRINKS = 0.5  # of the unit of U: a motion below it is solved again in its own unit


@dataclass(frozen=True)
class State:
    """A converged point as the next step needs it."""

    iterate: Iterate
    selected: np.ndarray  # B of the next point
    size: float  # |U| over all ranks [m]
    force: float  # |f_nl| over all ranks [N]
    sticks: bool  # no pair slips or opens: the point lies on the linear curve
    sliding: float  # share of the pairs that do not stick
    amplitude: np.ndarray  # (n_outputs,) complex, of harmonic 1 [m]


def interpolate(a: Iterate, b: Iterate, parameter: float) -> Iterate:
    """Return the point of the chord from ``a`` to ``b`` at a value of the parameter.  Local."""
    share = (parameter - a.parameter) / (b.parameter - a.parameter)
    return Iterate(a.U + share * (b.U - a.U), parameter)


class PointSolver:
    """Newton at one point of a branch: its units, its set B of pairs, its harmonics and samples."""

    def __init__(self, problem: HarmonicBalance, selection: Selection, sweep: Sweep, tolerance: float):
        self.problem, self.selection, self.sweep = problem, selection, sweep
        self.comm, self.tolerance = problem.comm, tolerance
        self.corrector = Corrector(problem, tolerance)
        self.spent = 0  # Newton iterations so far

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        self.corrector.destroy()

    def solve(
        self, guess: Iterate, row: ConstraintRow, size: float, selected: np.ndarray, force: float | None = None
    ) -> tuple[Correction, np.ndarray]:
        """Correct a guess; with the in-point check, again with the pairs that want to slip, until none is left out.

        ``size`` [m] and ``force`` [N] are what residuals are measured by, of a point near by.  Where the answer is much
        smaller, or ``force`` is not known, it is solved again by its own.
        """
        size = size or 1.0
        scaling = Scaling(size, self.sweep.scale) if force is None else self.scaling(size, force)
        newton = krylov = 0
        while True:
            found = self.corrector.correct(guess, row, scaling, selected)
            newton, krylov, self.spent = newton + found.newton, krylov + found.krylov, self.spent + found.newton
            found = replace(found, newton=newton, krylov=krylov)
            if found.failure:
                return found, selected
            own = self.norm(found.iterate.U)
            if force is None or 0.0 < own < SHRINKS * size:
                row = replace(row, n_U=row.n_U * ((own or size) / size))  # the same plane in the new unit
                size, force = own or size, self.force(found.iterate.U, selected)
                scaling, guess = self.scaling(size, force), found.iterate
                continue
            if not self.selection.checks_in_point:
                return found, selected
            forces = self.problem.contact_forces(found.iterate.U, np.ones_like(selected), tangents=False)
            left_out = forces.active[~selected[forces.active]]
            if len(left_out) == 0:
                return found, selected
            selected = selected.copy()
            selected[left_out] = True
            guess = found.iterate

    def solve_at(
        self, guess: Iterate, size: float, selected: np.ndarray, force: float | None = None
    ) -> tuple[Correction, np.ndarray]:
        """Correct a guess at its own parameter; the answer carries exactly that value, not its last bit's rounding.

        Raises
        ------
        ConvergenceError : the stuck structure resonates there without damping; on every rank
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            U_lin, _ = self.problem.linear_motion(guess.parameter)
        if not np.isfinite(self.norm(U_lin)):
            raise ConvergenceError(
                f"hb: the stuck structure resonates without damping at {self.problem.where(guess.parameter)}: "
                "its linear response is infinite there; state [damping], or another frequency"
            )
        found, selected = self.solve(guess, ConstraintRow.fixed_parameter(guess), size, selected, force)
        return replace(found, iterate=Iterate(found.iterate.U, guess.parameter)), selected

    # -- harmonics and samples ---------------------------------------------------------------------------------

    @property
    def harmonics(self) -> Harmonics:
        return self.problem.model.harmonics

    @property
    def resolution(self) -> Resolution:
        return Resolution(self.harmonics, self.problem.n_samples, self.tolerance)

    def change_to(self, resolution: Resolution) -> None:
        """Go on with other harmonics, samples and tolerance.  Collective; motions at hand are carried over by :meth:`fitted`."""
        if resolution != self.resolution:
            self.problem = self.problem.resolved(resolution.harmonics, resolution.n_samples)
            self.tolerance = resolution.tolerance
            self.corrector.destroy()
            self.corrector = Corrector(self.problem, self.tolerance)

    def fitted(self, iterate: Iterate) -> Iterate:
        """Return a motion in the harmonics of the problem, from whatever set it was solved in.  Local."""
        N_H = iterate.U.shape[-1]
        if N_H == self.harmonics.n_coefficients:
            return iterate
        solved_in = Harmonics.full(N_H) if N_H % 2 else Harmonics.odd_up_to(N_H - 1)
        return replace(iterate, U=solved_in.carry(iterate.U, self.harmonics))

    def carried(self, state: State) -> State:
        """Return a point in the harmonics of the problem.  Local."""
        return replace(state, iterate=self.fitted(state.iterate))

    def still(self, found: Correction, selected: np.ndarray, was: Resolution) -> tuple[Correction, np.ndarray]:
        """Return a solution found with the resolution ``was`` as one of the problem as it is now.  Collective."""
        if was == self.resolution:
            return found, selected
        guess = self.fitted(found.iterate)
        again, used = self.solve_at(guess, self.norm(guess.U), selected)
        if again.failure is None:
            return again, used
        self.change_to(was)
        return found, selected

    def again(self, state: State) -> State:
        """Return a point as the problem has it now, so that the way to the next one is that of the branch.  Collective."""
        state = self.carried(state)
        found, _ = self.solve_at(state.iterate, state.size, state.selected, state.force)
        return state if found.failure else replace(state, iterate=found.iterate)

    def solve_with(
        self, finer: Resolution, found: Correction, selected: np.ndarray, force: float | None = None
    ) -> tuple[Correction, np.ndarray]:
        """Solve a point of contact forces ``force`` [N] again with more; go back where Newton fails.  Collective."""
        coarse = self.resolution
        self.change_to(finer)
        guess = self.fitted(found.iterate)
        better, used = self.solve_at(guess, self.norm(guess.U), selected, force)
        better = replace(better, newton=found.newton + better.newton, krylov=found.krylov + better.krylov)
        if better.failure:
            self.change_to(coarse)
        return better, used

    # -- units and lengths -------------------------------------------------------------------------------------

    def scaling(self, size: float, force: float) -> Scaling:
        """Return the units of a point near one of this size [m] and force [N].  Local."""
        rows = row_weights(self.stiffness[:, :, None], size, force, self.tolerance)
        return Scaling(size, self.sweep.scale, rows, float(row_weights(self.stiffest, size, force, self.tolerance)))

    @cached_property
    def stiffness(self) -> np.ndarray:
        """The springs of this rank's pairs, (n_owned, 3) [N/m]."""
        return self.problem.law.stiffness

    @cached_property
    def stiffest(self) -> np.ndarray:
        """The stiffest spring of all pairs [N/m].  Collective at first."""
        return np.array(max(self.comm.allgather(float(self.stiffness.max(initial=0.0)))))

    def force(self, U: np.ndarray, selected: np.ndarray) -> float:
        """Return |f_nl| over all ranks [N] under a motion of this rank's pairs.  Collective."""
        p = self.problem.full_force(self.problem.contact_forces(U, selected, tangents=False))
        return self.force_of(U, p.reshape(-1, *U.shape[1:])[self.problem.model.owned])

    def force_of(self, U: np.ndarray, p: np.ndarray) -> float:
        """Return |p + K_J U| over all ranks [N].  Collective."""
        return self.norm(p + self.stiffness[:, :, None] * U)

    def norm(self, U: np.ndarray) -> float:
        return float(np.sqrt(self.comm.allreduce(float(np.vdot(U, U)))))

    def length(self, d_xi: np.ndarray, d_nu: float) -> float:
        """Return the length of a step.

        The mean does not count: it drifts with the slip in which sliders settle, and turns sharply where that ends, while the
        branch goes straight on.
        """
        return float(np.hypot(self.norm(self.vibration(d_xi)), d_nu))

    def vibration(self, U: np.ndarray) -> np.ndarray:
        """Return the harmonics above the mean."""
        return U[..., self.harmonics.vibration]

    def distance(self, now: State, there: Iterate) -> float:
        """Return the length of a step in its own norm."""
        d_xi = (self.fitted(there).U - self.fitted(now.iterate).U) / (now.size or 1.0)
        return self.length(d_xi, (there.parameter - now.iterate.parameter) / self.sweep.scale)
