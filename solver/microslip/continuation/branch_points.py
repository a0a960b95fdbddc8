"""Points of a branch as iterates and equations again."""

from __future__ import annotations

import numpy as np

from ..fourier.harmonics import Harmonics
from ..harmonic.balance import HarmonicBalance
from ..points.branch import Branch, Point
from .iterate import Iterate
from .point_record import HELD
from .problems import ProblemBase


def iterate_of(point: Point, problem: ProblemBase, harmonics: Harmonics) -> Iterate:
    """Return a point of a branch in some harmonics.  Collective: one broadcast."""
    model = problem.equation.model
    U = model.comm.bcast(point.U if model.comm.rank == 0 else None)
    U = Harmonics.full(U.shape[-1]).carry(U, harmonics) if U.size else np.zeros((0, 3, harmonics.n_coefficients))
    return Iterate(U[model.owned], point.parameters or (point.omega,), harmonics)


def equation_at(point: Point, equation: HarmonicBalance, harmonics: Harmonics) -> HarmonicBalance:
    """Return the equation with the samples of a point, and with its mean slip held if that of the point is.  Local."""
    equation = equation.resolved(harmonics, point.samples)
    return equation.holding(np.zeros((equation.n_owned, 2)) if HELD in point.notes else None)


def harmonics_of(branch: Branch, point: Point, otherwise: Harmonics) -> Harmonics:
    """Return the harmonics of a point: those of the equation, or those that the accuracy chose.  Local."""
    if branch.odd:
        return Harmonics.odd_up_to(point.harmonics)
    return otherwise if otherwise.highest == point.harmonics else Harmonics.up_to(point.harmonics)
