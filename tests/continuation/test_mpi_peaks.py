"""Peaks as points of their own, against exact ones and a fine sweep; every test runs on any number of ranks."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from dense_model import amplitude, branch, forced, reduced
from exact_jenkins import ExactJenkins
from mpi4py import MPI
from oracles import exact, scenes
from scipy.optimize import root

from microslip.continuation import maximum_by_phase
from microslip.continuation.branch_points import iterate_of
from microslip.continuation.constraint_rows import Plane, Scaling
from microslip.continuation.corrector import BorderedSystem, Corrector
from microslip.continuation.iterate import Iterate
from microslip.continuation.levels import linear_curve
from microslip.continuation.maximum import EXACT, Maximum, Sample, _Search
from microslip.continuation.outputs import output_at
from microslip.continuation.peaks import PeakOver, PeakPath, follow_peak, half_power_width, peaks_of
from microslip.continuation.tops import between_points, maxima
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.adjoint_solver import AdjointSolver
from microslip.harmonic.operating_point import LawParameter
from microslip.observe.level_log import peak_lines
from microslip.points.branch import Branch
from microslip.points.sweep import Sweep

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD


def damper():
    """Return the friction damper of Ansys' verification manual, VM320: one mass, one Jenkins element, mu N = 246.048 N."""
    return scenes.make_system(
        "friction damper",
        [[944.6]],
        [[2.4e7]],
        [[0, -1, -1, -1, -1, -1]],
        mu=1.0,
        N0=246.048,
        k_t=2.4e7,
        k_n=0.0,
        C=np.array([[7700.0]]),
        loads=[{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}],
        output=[1.0],
        omega=(150.0, 300.0),
        levels={},
    )


def peaks(system, level, H, n_samples, points=40):
    curve = branch(system, COMM, level, H=H, n_samples=n_samples, points=points)
    assert curve.failure is None
    return curve, peaks_of(forced(*reduced(system, COMM, H), n_samples, level), curve, 1e-9)


@pytest.mark.ranks(1)
def test_the_peak_of_one_harmonic_is_met_as_samples_grow():
    """Exact with one harmonic: 1.4979492641e-5 m at 209.21110546 rad/s."""
    for n_samples in (128, 256, 1024):
        _, (peak,) = peaks(damper(), 123.024, 1, n_samples)
        assert abs(peak.amplitude) == pytest.approx(1.4979492641e-5, rel=5.0 / n_samples**2)
        assert peak.omega == pytest.approx(209.21110546, rel=0.6 / n_samples)  # the slope knows where slip ends to a sample


def exact_peak(level):
    """Return amplitude and frequency of the damper's peak in one harmonic: its equation, and its derivative by the frequency."""
    m, k, c = 944.6, 2.4e7, 7700.0

    def missing(x):
        X, omega = 1e-5 * np.exp(x[0]), 209.2 * x[1]
        a1, b1, _ = exact.jenkins_harmonic(X, 2.4e7, 246.048)
        in_phase, lag = k * X + a1 - m * omega**2 * X, c * omega * X + b1
        return (np.hypot(in_phase, lag) / level - 1.0, (lag * c - 2.0 * m * omega * in_phase) / (c * level))

    X, omega = root(missing, [0.4, 1.0], tol=1e-14).x
    return 1e-5 * np.exp(X), 209.2 * omega


@pytest.mark.ranks(1)
def test_peaks_of_exact_coefficients_are_those_of_the_closed_form():
    """At levels from just beyond stick, 110 N, to gross slip; 1.4979492641e-5 m at 209.21110546 rad/s."""
    assert exact_peak(123.024) == pytest.approx((1.4979492641e-5, 209.21110546), rel=1e-9)
    model, law = reduced(damper(), COMM, 1)
    law, missed = ExactJenkins.of(law), []
    for level in (110.0, 123.024, 180.0, 240.0, 290.0):
        curve = branch(damper(), COMM, level, H=1, points=40, tolerance=1e-11, law_of=ExactJenkins.of)
        assert curve.failure is None
        (peak,) = peaks_of(forced(model, law, 128, level), curve, 1e-11)
        X, omega = exact_peak(level)
        missed.append((abs(peak.amplitude) / X - 1.0, peak.omega / omega - 1.0))
    print(f"amplitude and frequency off by {np.abs(missed).max(axis=0)}")
    assert np.abs(missed).max() < 1e-9


@pytest.mark.ranks(1)
@pytest.mark.slow
def test_peaks_are_those_of_a_fine_sweep():
    system = scenes.chain()
    curve, solved = peaks(system, 100.0, 3, 128)
    assert solved and all(peak.within < 1e-5 * peak.omega for peak in solved)
    near = np.sort([peak.omega * (1.0 + np.linspace(-1e-4, 1e-4, 9)) for peak in solved], axis=None)
    fine = branch(system, COMM, 100.0, H=3, n_samples=128, points=40, at=tuple(near))
    for peak in solved:
        sizes = np.array([amplitude(point) / abs(peak.amplitude) for point in fine.points if point.requested])
        beside = sizes[np.abs(sizes - 1.0) < 1e-4]  # a folded branch passes there on other parts, too
        assert len(beside) >= 5
        assert beside.max() == pytest.approx(1.0, abs=1e-8)


def test_a_maximum_at_a_corner_is_one_of_every_output_that_has_it(monkeypatch):
    """No point shows it for the second output, which moves by half as much."""
    system = damper() | {"output": np.array([[1.0], [0.5]])}
    monkeypatch.setattr("microslip.continuation.peaks.maxima", lambda of: [top for top in maxima(of) if top[0] == 0])
    monkeypatch.setattr("microslip.continuation.peaks.hidden", lambda *of: [])
    _, (first, *others) = peaks(system, 123.024, 1, 128)
    assert first.output == 0 and first.within > 0.0
    (second,) = others
    assert second.output == 1 and second.omega == pytest.approx(first.omega, rel=1e-6)
    assert second.amplitude == pytest.approx(0.5 * first.amplitude, rel=1e-6)
    assert len(peaks(system, 1.0, 1, 128)[1]) == 1  # no corner while all pairs stick


@pytest.mark.parametrize(("points", "error"), [(8, 0.05), (100, 0.002)])
def test_a_linear_peak_and_its_width_are_those_of_the_oscillator(points, error):
    _, (peak,) = peaks(damper(), 1.0, 1, 128, points=points)
    omega_0, c = np.sqrt(4.8e7 / 944.6), 7700.0 / 944.6
    assert peak.omega == pytest.approx(np.sqrt(omega_0**2 - c**2 / 2.0), rel=1e-9)
    assert peak.damping == pytest.approx(c / (2.0 * omega_0), rel=error)
    assert peak.slipping == 0


def test_the_linear_response_has_no_maximum_where_elements_of_a_sticking_pair_slip():
    """As those of rough and Iwan pairs, whose state is that of the whole pair."""
    sizes, omega = np.array([1.0, 3.0, 1.0]), np.array([0.9, 1.0, 1.1])
    linear = SimpleNamespace(omega=omega, response=sizes[:, None, None] * np.array([0.0, 1.0, 0.0]))

    def tops(p):
        ends = [
            SimpleNamespace(omega=w, segment=0, state=np.zeros(1), p=p, response=np.array([[0.0, 1.0, 0.0]])) for w in omega[::2]
        ]
        return between_points(Branch(1.0, ends), linear)

    settled, slips = np.array([[[0.5, 0.0, 0.0]] * 3]), np.array([[[0.0, 1e-3, 0.0]] * 3])
    assert [top.omega for top in tops(settled)] == [1.0] and tops(slips) == []


def test_a_maximum_between_two_points_is_that_of_the_linear_response(monkeypatch):
    """The last point of a curve lies beyond the peak, that before far below it: no point is a maximum."""
    curve, (peak,) = peaks(damper(), 1.0, 1, 128)
    beyond = next(point for point in curve.points if point.omega > 1.002 * peak.omega)
    curve.points = [*(point for point in curve.points if point.omega < 0.95 * peak.omega), beyond]
    model, law = reduced(damper(), COMM, 1)
    problem = forced(model, law, 128, 1.0)
    linear = linear_curve(model, Sweep(*damper()["omega"]))
    (between,) = peaks_of(problem, curve, 1e-9, curve=linear)
    assert between.omega == pytest.approx(peak.omega, rel=1e-9)
    assert between.amplitude == pytest.approx(peak.amplitude, rel=1e-7)
    assert between.within == 0.0 and between.slipping == 0
    (by_slope,) = peaks_of(problem, curve, 1e-9)
    assert by_slope.amplitude == pytest.approx(between.amplitude, rel=1e-9)
    monkeypatch.setattr(Maximum, "correct", lambda self, corrector, system, guess: SimpleNamespace(failure="diverged"))
    (unsolved,) = peaks_of(problem, curve, 1e-9, curve=linear)
    assert unsolved.within > 0.0 and unsolved.omega in {point.omega for point in curve.points}
    assert peaks_of(problem, curve, 1e-9) == []


@pytest.mark.ranks(1)
def test_a_maximum_lower_than_the_points_beside_it_has_no_width():
    """Between two antiresonances the curve rises above it before it falls to 1 / sqrt 2 of it, or the points do not show that."""
    points = [
        SimpleNamespace(omega=omega, segment=0, response=np.array([[0.0, size, 0.0]])) for omega, size in ((1.0, 3.0), (2.0, 3.0))
    ]
    assert np.isnan(half_power_width(SimpleNamespace(points=points), 0, (0, 1), 1.5, 1.0))


def two_masses():
    """Return two masses between grounds, one sliding on the other and one on the ground; the load moves mode 2 nine times as much."""
    return scenes.make_system(
        "two masses",
        np.eye(2),
        [[2.0, -1.0], [-1.0, 2.0]],
        [[0, -1, -1, 1, -1, -1], [1, -1, -1, -1, -1, -1]],
        mu=1.0,
        N0=1.0,
        k_t=0.3,
        k_n=0.0,
        zeta=0.02,
        loads=[{"vector": np.array([1.0, -0.8]), "harmonic": 1, "phase": 0.0}],
        output=[1.0, 0.0],
        omega=(0.8, 2.4),
        levels={},
    )


@pytest.mark.parametrize(("level", "slipping"), [(0.01, 0), (4.0, 1)], ids=["stuck", "slipping"])
@pytest.mark.parametrize("down", [False, True], ids=["up", "down"])
def test_a_maximum_before_an_antiresonance_is_listed_where_amplitudes_of_points_do_not_show_it(level, slipping, down):
    """One point behind the lower peak, higher than all before; the next one, beyond the antiresonance, is higher yet."""
    curve, of_curve = peaks_at(level, down)
    low, high = sorted(of_curve, key=lambda peak: peak.omega)
    near = low.omega * (1.0 + np.linspace(-1e-3, 1e-3, 21))
    fine = branch(two_masses(), COMM, level, points=40, at=tuple(near), down=down)
    sweep = max(amplitude(point) for point in fine.points if point.requested)
    assert -1e-9 <= abs(low.amplitude) / sweep - 1.0 < 1e-4 and low.slipping == slipping
    beyond = [point for point in curve.points if point.omega > low.omega]
    behind = min((point for point in beyond if point.omega > 1.005 * low.omega), key=lambda point: point.omega)
    rising = [point for point in beyond if point.omega > 1.3 * low.omega and amplitude(point) > abs(low.amplitude)]
    before = [point for point in curve.points if point.omega < 0.95 * low.omega]
    curve.points = [*rising, behind, *before] if down else [*before, behind, *rising]
    assert len(list(maxima(curve))) == 1
    problem = forced(*reduced(two_masses(), COMM, 3), 128, level)
    listed = peaks_of(problem, curve, 1e-9)
    for peak, of in zip(sorted(listed, key=lambda peak: peak.omega), (low, high), strict=True):
        assert peak.omega == pytest.approx(of.omega, rel=1e-6)
        assert abs(peak.amplitude) == pytest.approx(abs(of.amplitude), rel=1e-8)
    curve.points = [*curve.points, *curve.points[::-1]]
    assert len(peaks_of(problem, curve, 1e-9)) == 2, "a branch that goes back on itself has each peak once"


@pytest.mark.parametrize(("level", "slipping"), [(0.01, 0), (4.0, 1)], ids=["stuck", "slipping"])
@pytest.mark.parametrize("down", [False, True], ids=["up", "down"])
def test_a_maximum_and_a_minimum_within_one_step_are_listed_by_the_slopes_at_its_ends(level, slipping, down):
    """The curve rises from point to point over the lower peak and the antiresonance, and at both of these points."""
    curve, of_curve = peaks_at(level, down)
    low, high = sorted(of_curve, key=lambda peak: peak.omega)
    before = [point for point in curve.points if point.omega < 0.98 * low.omega]
    last = max(before, key=lambda point: point.omega)
    behind = [point for point in curve.points if point.omega > 1.3 * low.omega and amplitude(point) > amplitude(last)]
    behind = [point for point in behind if point.omega < high.omega or amplitude(point) > 0.1 * abs(high.amplitude)]
    assert amplitude(min(behind, key=lambda point: point.omega)) < 0.95 * abs(low.amplitude)
    curve.points = [*behind, *before] if down else [*before, *behind]
    assert len(list(maxima(curve))) == 1
    listed = peaks_of(forced(*reduced(two_masses(), COMM, 3), 128, level), curve, 1e-9)
    for peak, of in zip(sorted(listed, key=lambda peak: peak.omega), (low, high), strict=True):
        assert peak.omega == pytest.approx(of.omega, rel=1e-6)
        assert abs(peak.amplitude) == pytest.approx(abs(of.amplitude), rel=1e-8)
    assert low.slipping == slipping


def test_a_maximum_is_a_solution_where_the_guess_is_none(forward):
    """At the frequency of the linear peak, between two points, from twice the linear motion, under which the pair slips."""
    level = 123.024
    curve, (peak,) = peaks(damper(), level, 1, 128)
    problem = forced(*reduced(damper(), COMM, 1), 128, level)
    ends = [min(curve.points, key=lambda point: abs(point.omega - omega)) for omega in (195.0, 235.0)]
    before, after = (iterate_of(point, problem, Harmonics.up_to(1)) for point in ends)
    U = 2.0 * problem.equation.linear_motion(problem.at((225.0,)))
    scaling, every = Scaling(1e-5, (8.0,)), problem.equation.every_pair
    corrector, system = Corrector(COMM, U.shape, 1e-9), BorderedSystem(problem, (), scaling, every)
    solution = Maximum(0, 0, forward, (before, after)).correct(corrector, system, Iterate(U, (225.0,), before.harmonics))
    again = corrector.correct(replace(system, constraints=(Plane.fixed_parameter(solution.iterate),)), solution.iterate)
    assert solution.failure is None and again.failure is None and again.newton == 0
    out = output_at(problem.equation, problem.at(solution.iterate.parameters), solution.iterate.U, every, 0)
    assert abs(out) == pytest.approx(abs(peak.amplitude), rel=1e-5)
    corrector.destroy()


def peaks_at(level, down):
    """Return a curve of the two masses and its peaks."""
    curve = branch(two_masses(), COMM, level, points=150, down=down)
    assert curve.failure is None
    return curve, peaks_of(forced(*reduced(two_masses(), COMM, 3), 128, level), curve, 1e-9)


@pytest.fixture
def forward():
    solver = AdjointSolver(COMM, EXACT, np.float64)
    yield solver
    solver.destroy()


def test_rates_of_an_output_are_differences_of_solutions(forward):
    """Of two parameters, level and frequency, at a point where no sample switches near by."""
    equation = forced(*reduced(damper(), COMM, 1), 256, 1.0).equation
    problem = PeakOver(equation, "level", 1.0, 225.0, 8.0, Maximum(0, 1, forward))
    every, units = problem.equation.every_pair, np.array([10.0, 8.0])
    corrector, scaling = Corrector(COMM, problem.equation.shape, 1e-12, 2), Scaling(1e-5, tuple(units))

    def solved(parameters):
        guess = Iterate(problem.equation.linear_motion(problem.at(parameters)), parameters, problem.equation.harmonics)
        planes = tuple(Plane(guess, np.zeros_like(guess.U), tuple(row)) for row in np.eye(2))
        system = BorderedSystem(problem, planes, scaling, every)
        solution = corrector.correct(system, guess)
        assert solution.failure is None
        return solution.iterate, problem.maximum.rates(system, solution.iterate)

    outside = (-123.024, 200.0)  # no residual there, behind a solution that has one
    guess = replace(solved((123.024, 200.0))[0], parameters=outside)
    planes = tuple(Plane(guess, np.zeros_like(guess.U), tuple(row)) for row in np.eye(2))
    assert corrector.correct(BorderedSystem(problem, planes, scaling, every), guess).failure is not None
    here, h = np.array([123.024, 200.0]), 1e-5
    there, rates = solved(tuple(here))
    for j, step in enumerate(h * np.diag(units)):
        (before, of_before), (after, of_after) = solved(tuple(here - step)), solved(tuple(here + step))
        assert (of_after.a - of_before.a) / (2.0 * h) == pytest.approx(rates.a_nu[j], rel=1e-4)
        assert (after.U - before.U) / (2.0 * h * scaling.U) == pytest.approx(rates.V[j], rel=1e-4, abs=1e-6)
    corrector.destroy()


@pytest.mark.ranks(1)
def test_the_peak_over_the_level_is_one_branch():
    """From stuck through the level whose peak is known exactly to gross slip: 1.4979492641e-5 m at 209.21110546 rad/s."""
    n_samples, levels = 512, (123.024, 180.0, 240.0)
    of_curves = {level: peaks(damper(), level, 1, n_samples)[1][0] for level in (1.0, *levels)}
    equation = forced(*reduced(damper(), COMM, 1), n_samples, 1.0).equation
    curve = follow_peak(equation, PeakPath("level", Sweep(10.0, 300.0, levels), of_curves[1.0]), 1e-10)
    assert curve.failure is None and len(curve.points) < 60
    assert curve.points[0].state.max() == 0 < curve.points[-1].state.max()
    requested = [point for point in curve.points if point.requested]
    assert amplitude(requested[0]) == pytest.approx(1.4979492641e-5, rel=5.0 / n_samples**2)
    assert requested[0].omega == pytest.approx(209.21110546, rel=0.6 / n_samples)
    for point, level in zip(requested, levels, strict=True):
        assert point.parameters == (level, point.omega)
        peak = of_curves[level]  # of another corner, it may be
        assert amplitude(point) == pytest.approx(abs(peak.amplitude), rel=10.0 / n_samples**2)
        assert point.omega == pytest.approx(peak.omega, rel=1.0 / n_samples)


def test_a_peak_near_the_end_of_a_branch_is_between_closer_solutions(monkeypatch):
    """Where no solution lies 0.06 rad before it: the usual distance is two samples, 0.098 rad."""
    level, stuck = 123.024, peaks(damper(), 1.0, 1, 128)[1][0]
    equation = forced(*reduced(damper(), COMM, 1), 128, 1.0).equation
    lead = follow_peak(equation, PeakPath("level", Sweep(100.0, level), stuck), 1e-10).points[-1]
    begins = iterate_of(lead, forced(*reduced(damper(), COMM, 1), 128, level), Harmonics.up_to(1))
    solved = maximum_by_phase._Search.solved

    def ending(search, theta, *rest, **keys):
        solution = solved(search, theta, *rest, **keys)
        return replace(solution, failure="the branch ends") if theta < -0.06 else solution

    monkeypatch.setattr(maximum_by_phase._Search, "solved", ending)
    path = PeakPath("level", Sweep(level, 200.0), stuck, level, begins=begins, is_homotopy=True)
    curve = follow_peak(equation, path, 1e-10, until=lambda point: True)
    assert curve.failure is None
    assert amplitude(curve.points[0]) == pytest.approx(amplitude(lead), rel=1e-5)


@pytest.mark.study
@pytest.mark.ranks(1)
def test_the_peak_over_friction_is_that_of_laws_that_have_its_values():
    """One mass: its peak depends on level / (mu N) alone, so that half the friction is twice the level at half the size."""
    stuck, twice = (peaks(damper(), level, 1, 128)[1][0] for level in (1.0, 246.048))
    equation, friction = forced(*reduced(damper(), COMM, 1), 128, 1.0).equation, LawParameter("mu", np.arange(1), np.ones(1))
    curve = follow_peak(equation, PeakPath(friction, Sweep(2.0, 0.5), stuck, level=123.024), 1e-10)
    assert curve.failure is None
    assert amplitude(curve.points[-1]) == pytest.approx(0.5 * abs(twice.amplitude), rel=10.0 / 128**2)


@pytest.mark.ranks(1)
def test_a_peak_over_friction_ends_without_friction():
    """The law has no values below: steps beyond the end keep that of 0.  One mass: |X| = F / (2 zeta (1 - zeta^2)^(1/2) k)."""
    stuck = peaks(damper(), 1.0, 1, 128)[1][0]
    equation, friction = forced(*reduced(damper(), COMM, 1), 128, 1.0).equation, LawParameter("mu", np.arange(1), np.ones(1))
    down = follow_peak(equation, PeakPath(friction, Sweep(2.0, 0.0), stuck, level=123.024), 1e-10)
    assert down.failure is None
    last, zeta = down.points[-1], 7700.0 / (2.0 * np.sqrt(944.6 * 2.4e7))
    assert last.parameters[0] == 0.0
    assert amplitude(last) == pytest.approx(123.024 / (2.0 * zeta * np.sqrt(1.0 - zeta**2) * 2.4e7), rel=1e-6)
    assert last.omega == pytest.approx(np.sqrt(2.4e7 / 944.6 * (1.0 - 2.0 * zeta**2)), rel=1e-6)
    begins = iterate_of(last, forced(*reduced(damper(), COMM, 1), 128, 123.024), Harmonics.up_to(1))
    begins = replace(begins, parameters=last.parameters)
    up = follow_peak(equation, PeakPath(friction, Sweep(0.0, 2.0), stuck, level=123.024, begins=begins), 1e-10)
    assert up.failure is None and up.points[0].parameters[0] == 0.0
    assert amplitude(up.points[0]) == pytest.approx(amplitude(last), rel=1e-6)
    assert amplitude(up.points[-1]) == pytest.approx(amplitude(down.points[0]), rel=10.0 / 128**2)


@pytest.mark.ranks(1)
@pytest.mark.parametrize(
    "size, slope",
    [
        pytest.param(lambda t: 1.0 - (t - 0.3) ** 2, lambda t: 0.6 - 2.0 * t, id="a maximum"),
        pytest.param(lambda t: 1.0 - abs(t - 0.3), lambda t: np.sign(0.3 - t), id="a corner"),
    ],
)
@pytest.mark.parametrize("failures", [0, 2])
def test_a_maximum_or_a_corner_is_enclosed(size, slope, failures):
    """Where the first solves fail, nearer to a known solution."""

    def sample(t, guess=None):
        there = Iterate(np.zeros((0, 3, 3)), (float(t),), Harmonics.up_to(1))
        return left.pop() if left else Sample(t, there, there.U, size(t), slope(t))

    left: list = []
    ends = sample(0.0), sample(1.0)
    left += [None] * failures
    search = _Search.__new__(_Search)
    vars(search).update(corrector=SimpleNamespace(tolerance=1e-9), row=SimpleNamespace(omega=0), at=sample)
    vars(search).update(moved=lambda there, way: there)
    best, within = search.between(*ends)
    assert best.t == pytest.approx(0.3, abs=1e-6) and within < 2e-3 and not left


@pytest.mark.ranks(1)
def test_a_peak_that_no_solve_reaches_says_so():
    """A tolerance below rounding: the highest point of the curve comes back, and is marked."""
    curve = branch(damper(), COMM, 123.024, H=1, n_samples=128, points=40)
    (peak,) = peaks_of(forced(*reduced(damper(), COMM, 1), 128, 123.024), curve, 1e-30)
    assert peak.within > 1e-4 * peak.omega
    assert abs(peak.amplitude) == pytest.approx(max(amplitude(point) for point in curve.points), rel=1e-6)
    assert "(within " in peak_lines(SimpleNamespace(peaks=[peak]), ["mass"])[0]
