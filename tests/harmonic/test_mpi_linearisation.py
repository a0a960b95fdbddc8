"""The linearisation of harmonic balance, block by block; every test runs on any number of ranks."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from dense_model import reduced
from mpi4py import MPI
from oracles import scenes
from petsc4py import PETSc
from taylor import STEPS, UNIT, Place, assert_second_order, assert_square_of_step

from microslip.continuation.constraint_rows import Plane, Scaling
from microslip.continuation.corrector import BorderedSystem, Corrector
from microslip.continuation.iterate import Iterate
from microslip.continuation.output_rows import AmplitudeRow, PhaseRow
from microslip.continuation.problems import DampingHomotopy, ForcedResponse, LevelHomotopy, ProblemBase
from microslip.harmonic.adjoint_solver import AdjointSolver
from microslip.harmonic.balance import HarmonicBalance
from microslip.harmonic.linearisation import Linearisation
from microslip.harmonic.newton_solver import NewtonSolver
from microslip.harmonic.operating_point import LawParameter, OperatingPoint
from microslip.harmonic.whole_inverse import WholeInverse
from microslip.receptance.damping import Damping
from microslip.receptance.per_group import PerGroup

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM = MPI.COMM_WORLD  # the two-pair system leaves a third rank without pairs
OMEGA, LEVEL = 555.0, 100.0


def chain(H=3, full_damping=False):
    system = scenes.chain()
    model, law = reduced(system, COMM, H)
    if full_damping:
        receptance = model.receptance_of(1)
        coupled = Damping(np.diag(receptance.modes.damping.diagonal) + 3.0)
        coupled_modes = replace(receptance.modes, damping=coupled)
        model = replace(model, receptances=PerGroup.single(replace(receptance, modes=coupled_modes)))
    return HarmonicBalance.of_all(model, law, 128)


class TwoParameters(ProblemBase):
    """The equation over frequency and level at once, as a peak that is followed over the level."""

    def at(self, parameters):
        return OperatingPoint(*parameters)

    def rates(self, parameters):
        return {"omega": 1.0}, {"level": 1.0}


@dataclass(frozen=True, eq=False)
class FrequencyAndLaw(ProblemBase):
    """The equation over frequency and a parameter of the contact law."""

    varies: LawParameter

    @property
    def law_parameters(self):
        return (self.varies,)

    def at(self, parameters):
        return OperatingPoint(parameters[0], LEVEL, law=((self.varies, parameters[1]),))

    def rates(self, parameters):
        return {"omega": 1.0}, {self.varies: 1.0}


def over(name, pairs, shape, share_of_preload=1.0):
    """Return the maker of a problem over frequency and a parameter of some pairs; a negative share of N0 is a gap."""
    parameter = LawParameter(name, np.array(pairs), np.array(shape))

    def problem(equation):
        law = replace(equation.law, N0=share_of_preload * equation.law.N0)
        return FrequencyAndLaw(replace(equation, law=law), parameter)

    return problem


GAPS = [0.1 * 60.0 / 8e5, 0.1 * 40.0 / 6e5]
PROBLEMS = {
    "frequency and friction": (over("mu", [0, 1], [0.3, 0.25]), (OMEGA, 1.1)),
    "frequency and preload": (over("N0", [0, 1], [60.0, 40.0]), (OMEGA, 0.9)),
    "frequency and preload of a pair": (over("N0", [1], [1.0]), (OMEGA, 35.0)),
    "frequency and gap": (over("gap", [0, 1], GAPS, -0.1), (OMEGA, 1.2)),
    "frequency and tangential stiffness": (over("k_t", [0, 1], [5e5, 4e5]), (OMEGA, 1.1)),
    "frequency and normal stiffness of a pair": (over("k_n", [1], [6e5]), (OMEGA, 0.9)),
    "frequency": (lambda equation: ForcedResponse(equation, LEVEL), (OMEGA,)),
    "level": (lambda equation: LevelHomotopy(equation, OMEGA), (90.0,)),
    "damping": (lambda equation: DampingHomotopy(equation, OMEGA, LEVEL), (0.6,)),
    "frequency and level": (TwoParameters, (OMEGA, 90.0)),
}


@pytest.mark.parametrize("rows", ["motion", "constraints"])
@pytest.mark.parametrize("columns", ["motion", "parameters", "both"])
@pytest.mark.parametrize("full_damping", [False, True])
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_jacobian_is_the_derivative_of_the_residual(name, full_damping, columns, rows):
    problem, parameters = PROBLEMS[name]
    place = Place(problem(chain(full_damping=full_damping)), parameters, 1.3)
    assert place.n_active == 2
    assert_second_order(place, columns, rows)


@pytest.mark.parametrize("name", PROBLEMS)
def test_constraints_on_phase_and_amplitude_of_an_output_have_exact_derivatives(name):
    """The derivatives by every parameter, including those that change the contact forces at constant motion."""
    problem, parameters = PROBLEMS[name]
    place = Place(problem(chain()), parameters, 1.3)
    place.system = replace(place.system, constraints=(PhaseRow(0, UNIT, 0.7), AmplitudeRow(0, UNIT))[: len(parameters)])
    d_xi, d_nu = place.rng.standard_normal(place.U.shape), 0.05 * np.random.default_rng(5).standard_normal(len(parameters))
    linear, border = place.linearise()
    _, rate = linear.product(d_xi, place.owned(d_nu), border)
    _, ahead = place.residual(1e-5 * d_xi, 1e-5 * d_nu)
    _, behind = place.residual(-1e-5 * d_xi, -1e-5 * d_nu)
    assert rate == pytest.approx((ahead - behind) / 2e-5, rel=1e-6, abs=1e-6 * np.abs(rate).max())


@pytest.mark.parametrize("name", PROBLEMS)
def test_held_mean_slip_is_in_the_derivative(name):
    problem, parameters = PROBLEMS[name]
    equation = chain()
    about = np.random.default_rng(COMM.rank).standard_normal((equation.n_owned, 2))
    assert_second_order(Place(problem(equation.holding(about)), parameters, 1.3))


@pytest.mark.parametrize("option, tolerance", [(None, 2e-3), ("1e-10", 1e-8)])
@pytest.mark.parametrize("share", [1e-2, 1.3])
@pytest.mark.parametrize("name", PROBLEMS)
def test_a_newton_step_solves_the_bordered_system(name, share, option, tolerance):
    problem, parameters = PROBLEMS[name]
    place, options = Place(problem(chain()), parameters, share), PETSc.Options()
    if option:
        options["hb_ksp_rtol"] = option  # it also selects double precision
    solver = NewtonSolver(COMM)
    try:
        linear, border = place.linearise()
        b_U, b_nu = place.rng.standard_normal(place.U.shape), np.arange(1.0, 1.0 + len(parameters))
        step = linear.solve(b_U, place.owned(b_nu), border, solver)
        rows, of_constraints = linear.product(step.d_xi, step.d_nu_owned, border)
    finally:
        options.delValue("hb_ksp_rtol")
        solver.destroy()
    assert step.reason > 0
    assert step.product == pytest.approx(rows, abs=1e-8)
    assert place.size(rows - b_U, of_constraints - b_nu) < tolerance * place.size(b_U, b_nu)


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_solver_solves_systems_of_different_points_one_after_the_other(name):
    """The same pairs are active; a parameter of their stiffness changes the structure."""
    problem, parameters = PROBLEMS[name]
    options, solver, equation = PETSc.Options(), NewtonSolver(COMM), chain()
    options["hb_ksp_rtol"] = "1e-10"
    try:
        for factor in (1.0, 1.2, 0.9):
            place = Place(problem(equation), (*parameters[:-1], factor * parameters[-1]), 1.3)
            assert place.n_active == 2
            linear, border = place.linearise()
            b_U, b_nu = place.rng.standard_normal(place.U.shape), np.arange(1.0, 1.0 + len(parameters))
            step = linear.solve(b_U, place.owned(b_nu), border, solver)
            rows, of_constraints = linear.product(step.d_xi, step.d_nu_owned, border)
            assert place.size(rows - b_U, of_constraints - b_nu) < 1e-8 * place.size(b_U, b_nu)
    finally:
        options.delValue("hb_ksp_rtol")
        solver.destroy()


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_newton_step_is_solved_directly_where_gmres_fails(name):
    """GMRES stops after the few iterations that borders need with an exact preconditioner."""
    problem, parameters = PROBLEMS[name]
    place, options, solver = Place(problem(chain()), parameters, 1.3), PETSc.Options(), NewtonSolver(COMM)
    options["hb_ksp_rtol"], options["hb_ksp_max_it"] = "1e-7", "9"
    try:
        linear, border = place.linearise()
        b_U, b_nu = place.rng.standard_normal(place.U.shape), np.arange(1.0, 1.0 + len(parameters))
        step = linear.solve(b_U, place.owned(b_nu), border, solver)
        rows, of_constraints = linear.product(step.d_xi, step.d_nu_owned, border)
    finally:
        options.delValue("hb_ksp_rtol")
        options.delValue("hb_ksp_max_it")
        solver.destroy()
    assert step.reason > 0 and isinstance(solver.preconditioner, WholeInverse)
    assert place.size(rows - b_U, of_constraints - b_nu) < 1e-6 * place.size(b_U, b_nu)


@pytest.mark.parametrize("name", ["frequency", "level", "damping"])
def test_the_adjoint_gives_the_gradient_of_the_forces_along_the_solution(name):
    """d <B, p(U)> / d nu = - tau . d r / d nu of solutions U(nu), with (1 + G^T P^T) chi = B and tau = P^T chi."""
    of_equation, (parameter,) = PROBLEMS[name]
    problem, unit = of_equation(chain()), (parameter,)
    equation, options = problem.equation, PETSc.Options()
    B = np.random.default_rng(3).standard_normal((1, 3 * equation.model.n_pairs, equation.model.N_H))
    options["hb_ksp_rtol"] = "1e-10"
    corrector, solver = Corrector(COMM, equation.shape, 1e-13), AdjointSolver(COMM)
    guess = Iterate(equation.linear_motion(problem.at(unit)), unit, equation.harmonics)

    def solved(h):
        """Return the linearisation at the solution for the parameter times 1 + ``h``, and <B, p>."""
        place = replace(guess, parameters=(parameter * (1.0 + h),))
        system = BorderedSystem(problem, (Plane.fixed_parameter(place),), Scaling(UNIT, unit), equation.every_pair)
        correction = corrector.correct(system, place)
        assert correction.failure is None
        forces = equation.contact_forces(correction.iterate.U, equation.every_pair, tangents=True)
        p = np.vdot(B, equation.full_force(forces))
        return Linearisation.of(equation, problem.at(place.parameters), forces), p

    try:
        linear, reference = solved(0.0)
        _, tau, is_solved = linear.solve_transposed(B, solver)
        (rate,) = problem.rates(unit)
        slope = -parameter * COMM.allreduce(float(np.vdot(tau[0], linear.rate(rate))))
        remainders = [abs(solved(h)[1] - reference - h * slope) for h in STEPS]
    finally:
        options.delValue("hb_ksp_rtol")
        corrector.destroy()
        solver.destroy()
    assert is_solved and len(linear.forces.active) == 2
    assert_square_of_step(remainders, abs(slope))


def test_the_law_of_an_operating_point_has_its_parameters_and_is_cached():
    equation = chain()
    some, all_of = LawParameter("N0", np.array([1]), np.array([40.0])), LawParameter("mu", np.arange(2), np.array([0.3, 0.25]))
    at = OperatingPoint(OMEGA, LEVEL, law=((some, 0.5), (all_of, 2.0)))
    computed = equation.under(at)
    owned = equation.model.owned
    assert computed.law.N0.tolist() == [60.0, 20.0][owned] and computed.law.mu.tolist() == [0.6, 0.5][owned]
    assert equation.under(replace(at, omega=600.0)) is computed
    assert equation.under(replace(at, law=((some, 0.6), (all_of, 2.0)))) is not computed
    assert equation.under(OperatingPoint(OMEGA, LEVEL)) is equation


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("name", [name for name in PROBLEMS if name.startswith("frequency and ") and "level" not in name])
def test_the_rate_by_a_law_parameter_is_the_slope_of_the_residual(name, held):
    make, (omega, value) = PROBLEMS[name]
    problem, equation = make(chain()), make(chain()).equation
    U = 1.3 * equation.linear_motion(problem.at((omega, value)))
    equation = equation.holding(np.zeros((equation.n_owned, 2)) if held else None)

    def linear(value):
        at = problem.at((omega, value))
        under = equation.under(at)
        return Linearisation.of(under, at, under.contact_forces(U, equation.every_pair, tangents=True))

    def residual(value):
        place = linear(value)
        return place.equation.residual(U, place.at, place.forces)

    h = 1e-5 * value
    rate = equation.gather(linear(value).rate(problem.rates((omega, value))[1]))
    slope = equation.gather(residual(value + h) - residual(value - h)) / (2.0 * h)
    assert np.abs(slope).max() > 1e-7 / value
    assert np.abs(rate - slope).max() < 1e-6 * np.abs(slope).max()


def test_two_parameters_and_two_constraints_give_the_level_of_a_prescribed_motion():
    """The frequency and a component of the motion are prescribed: the solution has the level of the forced response."""
    equation, omega = chain(), 560.0
    forced_response = ForcedResponse(equation, LEVEL)
    corrector = Corrector(COMM, equation.shape, 1e-10)
    U_lin = equation.linear_motion(forced_response.at((omega,)))
    size = np.sqrt(COMM.allreduce(float(np.vdot(U_lin, U_lin))))
    guess = Iterate(U_lin, (omega,), equation.harmonics)
    plane = Plane.fixed_parameter(guess)
    correction = corrector.correct(BorderedSystem(forced_response, (plane,), Scaling(size, (400.0,)), equation.every_pair), guess)
    corrector.destroy()
    assert correction.failure is None
    U = correction.iterate.U
    n_U = np.zeros(equation.shape)
    if equation.n_owned and equation.model.owned.start == 0:
        n_U[0, 0, 1] = 1.0
    corrector = Corrector(COMM, equation.shape, 1e-10, n_parameters=2)
    away = Iterate(1.02 * U, (omega, 0.95 * LEVEL), equation.harmonics)
    about = Iterate(U, (omega, 0.0), equation.harmonics)
    constraints = (Plane.fixed_parameter(about), Plane(about, n_U, (0.0, 0.0)))
    system = BorderedSystem(TwoParameters(equation), constraints, Scaling(size, (400.0, LEVEL)), equation.every_pair)
    solution = corrector.correct(system, away)
    corrector.destroy()
    assert solution.failure is None
    assert solution.iterate.parameters == pytest.approx((omega, LEVEL), rel=1e-7)
    assert solution.iterate.U == pytest.approx(U, abs=1e-7 * size)


def test_damping_homotopy_starts_without_vibration_and_ends_at_the_problem():
    equation = chain()
    homotopy = DampingHomotopy(equation, OMEGA, LEVEL)
    U = equation.linear_motion(OperatingPoint(OMEGA, LEVEL))
    end, begin = (equation.linear_motion(homotopy.at((t,))) for t in (1.0, 1e-9))
    size = COMM.allreduce(np.abs(U).max(initial=0.0), op=MPI.MAX)
    assert end == pytest.approx(U, abs=1e-13 * size)
    assert COMM.allreduce(np.abs(begin[..., 1:]).max(initial=0.0), op=MPI.MAX) < 1e-4 * size
    assert homotopy.where(0.5).endswith("damped further by 555 M")


def test_forces_and_columns_of_the_last_evaluation_are_reused_for_the_same_point_only():
    equation, without_cache = chain(), chain()
    U = np.zeros(equation.shape)
    first = equation.contact_forces(U, equation.every_pair, tangents=False)
    with_tangents = equation.contact_forces(U, equation.every_pair, tangents=True)  # sticking pairs have no tangents
    assert first.P is None and with_tangents.P.shape == (0, 3 * equation.model.N_H, 3 * equation.model.N_H)
    p = np.random.default_rng(5).standard_normal((3 * equation.model.n_pairs, equation.model.N_H))
    pairs = np.arange(equation.model.n_pairs)
    for omega, active in [(OMEGA, pairs), (OMEGA, pairs), (OMEGA, pairs[:1]), (1.1 * OMEGA, pairs[:1]), (OMEGA, pairs)]:
        at, columns = OperatingPoint(omega, LEVEL), replace(without_cache).receptance(OperatingPoint(omega, LEVEL), active)
        some = p[: 3 * len(active)]
        np.testing.assert_array_equal(equation.receptance(at, active).apply(some), columns.apply(some))
    assert equation.receptance(at, pairs) is equation.receptance(at, pairs)
