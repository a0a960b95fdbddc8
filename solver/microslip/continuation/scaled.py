"""Levels known to be linear are scaled from the linear response, not solved (docs/theory.md, section 7)."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from ..contact.law import Law
from ..harmonic.residual import HarmonicBalance
from ..receptance import motion as receptance
from ..receptance.model import ReducedModel
from .corrector import ConstraintRow, Correction, Iterate
from .follow import BranchFollower
from .steps import LinearCurve

FINER = 2  # times the samples of the scene, where the linear curve is tested for slip
MARGIN = 1.0 - 1e-9  # of the level up to which no pair leaves sticking, for roundoff


def sticks_up_to(model: ReducedModel, law: Law, motions: list[np.ndarray]) -> np.ndarray:
    """Return a level [N] at each of n points of the linear curve up to which no pair leaves sticking, (n,).

    Collective on ``model.comm``.  ``motions`` holds this rank's rows (3 n_owned, N_H) [m/N] at each of the points.  At higher
    levels they may stick, too: the law answers for the amplitudes of all harmonics peaking together.
    """
    most_moved = np.array([np.abs(receptance.to_complex(U)).sum(axis=1) for U in motions])  # m per newton
    most = law.take(np.arange(model.n_pairs)[model.owned]).slip_safety(most_moved.reshape(len(motions), -1, 3))  # N
    least = np.nan_to_num(most.min(axis=1, initial=np.inf), nan=0.0, posinf=np.inf)
    model.comm.Allreduce(MPI.IN_PLACE, least, op=MPI.MIN)
    return least


def is_linear(problem: HarmonicBalance, curve: LinearCurve) -> bool:
    """Tell whether no pair leaves sticking anywhere on the sampled linear curve at the level of ``problem``.

    Collective on ``problem.comm``: one evaluation of the pairs at each point where the bound alone does not tell, worst first.  A
    level that slips so costs one evaluation.  A constant motion, of harmonic 0 alone, is left to the solver.
    """
    if problem.model.harmonics.highest == 0:
        return False
    finer = problem.resolved(problem.model.harmonics, FINER * problem.n_samples)
    for i in np.argsort(curve.sticks_up_to, kind="stable"):
        if problem.level <= MARGIN * curve.sticks_up_to[i]:
            return True
        if curve.sticks_up_to[i] == 0.0 or not sticks(finer, curve.omega[i]):
            return False
    return True


def sticks(problem: HarmonicBalance, omega: float) -> bool:
    """Tell whether every pair sticks, closed, at every sample of the linear response.  Collective on ``problem.comm``."""
    everything = np.ones(problem.model.n_pairs, dtype=bool)
    return len(problem.contact_forces(problem.linear_motion(omega)[0], everything, tangents=False).active) == 0


class ScaledFollower(BranchFollower):
    """The stepping loop of a level known to be linear: the points that a solver would find, without solving.

    Each is the linear response at its frequency, tested by the law itself.  Should a pair leave sticking between two samples of
    the linear curve after all, the branch is solved for from there on.
    """

    scaled = True

    def solve(
        self, guess: Iterate, row: ConstraintRow, size: float, selected: np.ndarray, force: float | None = None
    ) -> tuple[Correction, np.ndarray]:
        """Return the linear response at the parameter of the guess; solve once a pair has left sticking."""
        self.scaled = self.scaled and sticks(self.problem, guess.parameter)
        if not self.scaled:
            return super().solve(guess, row, size, selected, force)
        U, _ = self.problem.linear_motion(guess.parameter)
        return Correction(Iterate(U, guess.parameter), 0, 0, 0.0, None), selected
