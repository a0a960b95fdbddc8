"""Derivatives checked by their Taylor remainder: |r(x + h d) - r(x) - h J d| falls as h^2 where no sample switches."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from microslip.continuation.constraint_rows import Plane, Scaling
from microslip.continuation.corrector import BorderedSystem
from microslip.continuation.iterate import Iterate

STEPS = 1e-3 * 0.25 ** np.arange(4)
UNIT = 1e-4  # unit of the motion [m]


class Place:
    """A problem with a plane for each parameter, at ``share`` times its linear motion; all pairs may slip."""

    def __init__(self, problem, parameters, share, seed=0):
        self.problem, equation = problem, problem.equation
        self.comm, self.rng = equation.comm, np.random.default_rng(seed + equation.comm.rank)
        self.last = self.comm.rank == self.comm.size - 1
        self.U = share * equation.linear_motion(problem.at(parameters))
        about = Iterate(self.U, parameters, equation.harmonics)
        k = len(parameters)
        slopes = np.random.default_rng(7).standard_normal((k, k))  # the same on all ranks
        planes = tuple(Plane(about, self.rng.standard_normal(self.U.shape), tuple(slope)) for slope in slopes)
        self.nu = np.ones(k)
        self.system = BorderedSystem(problem, planes, Scaling(UNIT, tuple(map(float, parameters))), equation.every_pair)

    @property
    def n_active(self):
        equation = self.problem.equation
        return len(equation.contact_forces(self.U, equation.every_pair, tangents=False).active)

    def owned(self, nu):
        """Return parameters on the rank that owns them, zeros elsewhere."""
        return nu if self.last else np.zeros_like(nu)

    def linearise(self):
        return self.system.linearise(self.U, self.owned(self.nu))

    def residual(self, d_xi, d_nu):
        """Return the scaled residual at a distance from the place: rows of this rank, and constraints."""
        return self.system.residual(self.U + UNIT * d_xi, self.owned(self.nu + d_nu))

    def size(self, rows, of_constraints):
        """Return the norm over all ranks."""
        return np.sqrt(
            self.comm.allreduce(float(np.vdot(rows, rows)), op=MPI.SUM) + float(np.vdot(of_constraints, of_constraints))
        )


def assert_second_order(place, columns="both", rows="both"):
    """Assert that the Jacobian, or a block of it, is the residual's derivative.

    ``columns`` are those of "motion" or "parameters", ``rows`` those of "motion" or "constraints".
    """
    d_xi = place.rng.standard_normal(place.U.shape) * (columns != "parameters")
    d_nu = 0.05 * np.random.default_rng(5).standard_normal(len(place.nu)) * (columns != "motion")
    linear, border = place.linearise()
    first = linear.product(d_xi, place.owned(d_nu), border)
    reference = place.residual(np.zeros_like(d_xi), np.zeros_like(d_nu))
    included = np.array([rows != "constraints", rows != "motion"])

    def size(h):
        moved = place.residual(h * d_xi, h * d_nu)
        return place.size(*(factor * (b - a - h * s) for factor, a, b, s in zip(included, reference, moved, first)))

    assert_square_of_step([size(h) for h in STEPS], place.size(*(factor * s for factor, s in zip(included, first))))


def assert_square_of_step(remainders, first):
    """Assert that remainders at ``STEPS`` fall as their squares, down to rounding of ``first``, |J d|."""
    rounding = 1e-11 * first
    computed = np.maximum(remainders, rounding)
    assert first > 0.0
    assert computed[-1] <= 1e-6 * first  # a wrong derivative leaves 1.6e-5 of its error at the smallest step
    rates = np.log2(computed[:-1] / computed[1:]) / 2.0
    assert np.all(rates[computed[1:] > 10.0 * rounding] > 1.7), (computed, first)
