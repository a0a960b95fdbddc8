"""Nonlinear modes: extended periodic motion, continued over the logarithm of the modal amplitude (docs/theory.md, section 15).

Without a load, a negative damping sigma M supplies the energy that friction and damping dissipate.  The parameters are ln q,
omega and sigma; the two rows in addition to that of the step are the equation of the leading mode, eta_j = q.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..fourier.amplitudes import to_complex
from ..fourier.harmonics import Harmonics
from ..harmonic.balance import HarmonicBalance
from ..harmonic.operating_point import OperatingPoint, Rates
from ..messages.errors import ConvergenceError
from ..points.branch import Branch, Point
from ..points.selection import AllPairs
from ..points.sweep import Sweep
from ..receptance.leading_mode import coordinate, coordinate_rate, led_by, pushed_by
from ..receptance.reduced_model import ReducedModel
from .checkpointer import NO_CHECKPOINTS, Checkpointer, finished_or
from .constraint_rows import Place, Scaling
from .follow import follow_branch
from .iterate import Iterate
from .point_solver import PointSolver, Workspace
from .problems import KnownCurve, LinearResponse, ProblemBase
from .steps import ArcLength
from .task import BranchTask

UNIT = 0.1  # of the mode's frequency: the unit of omega and sigma in the norm of steps
STEPS_OF_MODES = ArcLength(ds=0.15, ds_min=1e-5, ds_max=0.3)
STEPS_OF_PUSHES = ArcLength(ds=0.02, ds_min=1e-5, ds_max=0.02)  # of the range of ln q: a constant motion has no length
MOST_POINTS = 1000


@dataclass(frozen=True, eq=False)
class ModalEquation:
    """The real or the imaginary part of eta_j / q - 1 = 0, eq. (15.3), in the unit of the parameters."""

    j: int
    part: Callable[[complex | np.ndarray], np.ndarray]  # np.real or np.imag
    takes_linearisation: ClassVar[bool] = True

    def of_motion(self, U: np.ndarray, scaling: Scaling) -> float:
        """Return 0: the modal coordinate follows from the contact forces.  Local."""
        return 0.0

    def value(self, of_motion: float, place: Place) -> float:
        """Return the row, eq. (15.3).  Collective; the same on all ranks."""
        return float(self.part(place.once(_modal_error, self.j))) / UNIT

    def gradient(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Return its derivatives by motion (n_owned, 3, N_H) and scaled parameters (3,).  Collective."""
        n_U, n_nu = place.once(_modal_gradient, self.j)
        return self.part(n_U) * (place.scaling.U / UNIT), self.part(n_nu) / UNIT


def _modal_error(place: Place, j: int) -> complex:
    """Return eta_j / q - 1, eq. (15.3).  Local; the same on all ranks."""
    at, forces, equation = place.linear.at, place.linear.forces, place.linear.equation
    eta = coordinate(equation.model_at(at), j, at.omega, forces.active)
    return eta.under(at.level, _first(place, forces.p)) / at.level - 1.0


def _modal_gradient(place: Place, j: int) -> tuple[np.ndarray, np.ndarray]:
    """Return its complex derivatives by motion (n_owned, 3, N_H) [1/m] and scaled parameters (3,).  Local."""
    at, forces, equation = place.linear.at, place.linear.forces, place.linear.equation
    model, p_1, q, owned = equation.model_at(at), _first(place, forces.p), at.level, equation.model.owned
    eta = coordinate(model, j, at.omega, forces.active)
    rates = [coordinate_rate(model, j, at.omega, forces.active, *d).under(q, p_1) / q for d in ((1.0, 0.0), (0.0, 1.0))]
    n_nu = np.array([eta.per_load - eta.under(q, p_1) / q, *rates]) * place.scaling.parameters
    mine = (forces.active >= owned.start) & (forces.active < owned.stop)
    by_p = np.array([1.0, -1j])[:, None, None] * eta.by_pairs.reshape(-1, 3)[mine] / q  # by cos and sin of the forces, (2, m, 3)
    P = place.linear.P.reshape(-1, 3, model.N_H, 3 * model.N_H)[:, :, model.harmonics.columns(1)]
    n_U = np.zeros(place.U.shape, dtype=complex)
    n_U[forces.active_owned] = np.einsum("nai,ainj->aj", by_p, P).reshape(-1, *place.U.shape[1:])
    return n_U, n_nu


def _first(place: Place, p: np.ndarray) -> np.ndarray:
    """Return the complex amplitude of harmonic 1 of forces (3 n_active, N_H), (3 n_active,)."""
    return to_complex(p[:, place.linear.equation.harmonics.columns(1)])[:, 0]


@dataclass(frozen=True, eq=False)
class NonlinearMode(ProblemBase):
    """A nonlinear mode, eq. (15.1), of a model that mode j leads; parameters are ln q, omega [rad/s] and sigma [1/s]."""

    j: int
    omega: float  # rad/s, of the mode while all pairs stick
    sigma: float  # 1/s, minus its damping then

    @classmethod
    def of(cls, equation: HarmonicBalance, j: int) -> NonlinearMode:
        """Return mode j (from 0) of a model, whose loads are left out.  Local.

        Raises
        ------
        ConvergenceError : the damped mode of the stuck structure does not vibrate; on every rank
        """
        equation = equation.of(led_by(equation.model, j))
        return cls(equation, j, *damped_mode(equation.model, j))

    @property
    def units(self) -> tuple[float, ...]:
        """Units of omega and sigma [rad/s, 1/s]: ``UNIT`` times the frequency of the mode."""
        return UNIT * self.omega, UNIT * self.omega

    @property
    def constraints(self) -> tuple[ModalEquation, ...]:
        """Real and imaginary part of eq. (15.3)."""
        return ModalEquation(self.j, np.real), ModalEquation(self.j, np.imag)

    @property
    def curve(self) -> KnownCurve:
        """The mode while all pairs stick, at its frequency and damping."""
        return LinearResponse(self, (self.omega, self.sigma))

    def allows(self, parameters: tuple[float, ...]) -> bool:
        """Return whether the frequency is above zero and q a number above zero; sigma has any value.  Local."""
        return parameters[1] > 0.0 and 0.0 < self.at(parameters).level < np.inf

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        """Return frequency, level q and further damping sigma for (ln q, omega, sigma).  Local."""
        log_q, omega, sigma = parameters
        return OperatingPoint(omega, float(np.exp(log_q)), sigma)

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rates, ...]:
        """Return the rates of the operating point with ln q, omega and sigma.  Local."""
        return {"level": float(np.exp(parameters[0]))}, {"omega": 1.0}, {"sigma": 1.0}

    def where(self, parameter: float) -> str:
        """Return the modal amplitude q of a point and the mode, for messages.  Local."""
        return f"modal amplitude {np.exp(parameter):.4g} kg^1/2 m of mode {self.j + 1}"


def damped_mode(model: ReducedModel, j: int) -> tuple[float, float]:
    """Return omega [rad/s] and sigma [1/s] of mode j of the stuck structure, the model being led by it.  Local.

    With damping that couples no modes eq. (15.4) gives omega_j and -2 zeta_j omega_j.
    """
    k, _ = model.index_of(1)
    modes = model.groups[k].receptance.modes
    omega_j, damping, none = float(modes.omega_n[j]), modes.damping, np.zeros(0, dtype=int)
    start = omega_j, -float(damping.diagonal[j] + damping.structural_diagonal[j] / omega_j)
    if not damping.couples_modes:
        return start

    def eta(x: np.ndarray) -> np.ndarray:
        value = coordinate(model.with_damping(x[1]), j, float(x[0]), none).per_load - 1.0
        return np.array([value.real, value.imag])

    from scipy.optimize import root  # slow import, seldom needed

    solution = root(eta, start, tol=1e-14)
    if not np.linalg.norm(eta(solution.x)) < 1e-10 or solution.x[0] <= 0.0:
        raise ConvergenceError(f"backbone: mode {j + 1} is damped too strongly to vibrate by itself")
    return float(solution.x[0]), float(solution.x[1])


def follow_mode(
    problem: NonlinearMode,
    sweep: Sweep,
    tolerance: float,
    on_point: Callable[[Point], None] = lambda point: None,
    until: Callable[[Point], bool] = lambda point: False,
    checkpointer: Checkpointer = NO_CHECKPOINTS,
) -> Branch:
    """Return the branch of a nonlinear mode over ln q, from its checkpoints if there are any.  Collective.

    Parameters
    ----------
    sweep : range of ln q; values in ``at`` are points
    until : returns whether the branch may end at a point

    Returns
    -------
    branch : ``parameters`` of a point are ln q, omega [rad/s] and sigma [1/s]; why it ends early is in ``failure``
    """
    task = BranchTask(problem, AllPairs(), sweep, STEPS_OF_MODES, tolerance)
    return finished_or(
        checkpointer, lambda: follow_branch(task, MOST_POINTS, on_point, checkpointer=checkpointer, until=until), on_point
    )


def resolved_again(
    problem: NonlinearMode, points: Sequence[Point], harmonics: Harmonics, n_samples: int, tolerance: float
) -> np.ndarray:
    """Return omega and sigma of points at the same amplitudes with other harmonics and samples, (n, 2); NaN where a solve fails.

    Collective.  ``points`` are of the branch of the problem; their motion is on rank 0.
    """
    equation, pairs = problem.equation.resolved(harmonics, n_samples), AllPairs()
    other, workspace = problem.with_equation(equation), Workspace(equation, n_parameters=1 + len(problem.units))
    results = []
    try:
        for point in points:
            U = equation.comm.bcast(point.U if equation.comm.rank == 0 else None)
            U = Harmonics.full(U.shape[-1]).carry(U, harmonics)[equation.model.owned]
            solver = PointSolver(other, pairs, Sweep(point.parameters[0], point.parameters[0] + 1.0), tolerance, workspace)
            guess = Iterate(U, point.parameters, harmonics)
            solution, _ = solver.solve_at(guess, solver.norm(U), equation.every_pair)
            results.append(solution.iterate.parameters[1:] if solution.failure is None else (np.nan, np.nan))
    finally:
        workspace.destroy()
    return np.array(results).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class QuasiStaticMode(ProblemBase):
    """The static response to omega_j^2 q' M phi_j over ln q', each load from rest in one straight step; eq. (15.5)."""

    @classmethod
    def of(cls, equation: HarmonicBalance, j: int) -> QuasiStaticMode:
        """Return that of mode j (from 0) of a model, whose loads are left out.  Local."""
        return cls(HarmonicBalance(pushed_by(equation.model, j), equation.law, 1))

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        """Return the level q' for (ln q',), at the frequency 1 rad/s, which a constant motion does not depend on.  Local."""
        return OperatingPoint(1.0, float(np.exp(parameters[0])))

    def allows(self, parameters: tuple[float, ...]) -> bool:
        """Return True: ln q' has any value.  Local."""
        return True

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rates, ...]:
        """Return the rate of the level with ln q'.  Local."""
        return ({"level": float(np.exp(parameters[0]))},)

    def where(self, parameter: float) -> str:
        """Return the static modal amplitude q' of a point, for messages.  Local."""
        return f"a static modal amplitude of {np.exp(parameter):.4g} kg^1/2 m"


def follow_pushes(problem: QuasiStaticMode, sweep: Sweep, tolerance: float) -> Branch:
    """Return the static responses over a range of ln q'.  Collective."""
    return follow_branch(BranchTask(problem, AllPairs(), sweep, STEPS_OF_PUSHES, tolerance), MOST_POINTS)
