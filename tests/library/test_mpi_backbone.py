"""microslip.backbone: from a scene to frequency and damping over amplitude, files and messages; on any number of ranks."""

import csv
import re
from dataclasses import replace
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import exact, scenes
from scipy.optimize import root

import microslip
from microslip.contact.law import OPEN, STICK
from microslip.library import backbone
from microslip.library.backbone import ModePoint, QuasiStatic, comes_to_gross_slip
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.studies.backbone.command import band
from microslip.studies.backbone.report import Forced, in_words, statics_in_words

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD


def one_mass(**changes):
    """Return one mass on a Jenkins element, as in docs/validation.md: m = k = k_t = mu N = 1, c = 0.02."""
    system = scenes.jenkins_mass()
    return system | changes


def two_masses():
    """Return two separate masses, of which only the first has a joint."""
    return scenes.make_system(
        "two masses",
        np.eye(2),
        np.diag([1.0, 9.0]),
        [[0, -1, -1, -1, -1, -1]],
        mu=1.0,
        N0=1.0,
        k_t=1.0,
        k_n=0.0,
        C=0.02 * np.eye(2),
        loads=[{"vector": [1.0, 1.0], "harmonic": 1, "phase": 0.0}],
        output=[1.0, 0.0],
        omega=(0.5, 2.0),
        levels={},
    )


def on_a_stop():
    """Return a mass with a gap to a stop with friction."""
    return scenes.make_system(
        "stop",
        np.eye(2),
        np.array([[2.0, -0.5], [-0.5, 2.0]]),
        [[0, -1, 1, -1, -1, -1]],
        mu=0.3,
        N0=-0.5,
        k_t=1.0,
        k_n=1.0,
        C=0.02 * np.eye(2),
        loads=[{"vector": [1.0, 1.0], "harmonic": 1, "phase": 0.0}],
        output=[1.0, 0.0],
        omega=(0.5, 2.0),
        levels={},
    )


def one_slack():
    """Return the two masses with a second joint, closed without a preload, at the second mass."""
    both = {
        name: np.array(values)
        for name, values in {"mu": [1.0] * 2, "N0": [1.0, 0.0], "k_t": [1.0] * 2, "k_n": [0.0, 1.0]}.items()
    }
    return two_masses() | both | {"pair_dofs": [[0, -1, -1, -1, -1, -1], [-1, -1, 1, -1, -1, -1]], "separate": np.zeros(2, bool)}


@pytest.fixture
def scene_file(shared_path):
    """Return a function that writes a scene and returns its path.  Collective."""

    def write(system, frequencies=(0.5, 2.0), levels=(0.4,), **solver):
        solver = {"harmonics": 1, "samples": 512, "tolerance": 1e-9} | solver
        return on_root(COMM, lambda: write_matrix_scene(shared_path, system, levels, frequencies, **solver))

    return write


@pytest.fixture
def structure(scene_file):
    """Return a function that builds a structure.  Collective."""
    built = []

    def build(*args, **how):
        built.append(microslip.build(microslip.read(scene_file(*args, **how)), COMM))
        return built[-1]

    yield build
    for each in built:
        each.close()


@pytest.mark.parametrize("loss", (-4.0e-36, 0.0, 4.0e-36))
def test_rounding_of_the_loss_of_stuck_pairs_is_no_gross_slip(loss):
    none = np.zeros((1, 3)), np.zeros(1), np.full(1, STICK)
    points = [ModePoint(amplitude, 1.0, -0.02, *none, friction, 0.01, 1.0) for amplitude, friction in ((1.0, loss), (1.1, -loss))]
    assert not comes_to_gross_slip(points[:1]) and not comes_to_gross_slip(points)
    assert all(point.damping_by_friction == 0.0 for point in points)


def test_frequency_damping_and_friction_have_their_closed_form(structure):
    mode = microslip.backbone(structure(one_mass()))
    assert mode.failure is None and mode.first_slip == pytest.approx(1.0)
    assert mode.linear_frequency == pytest.approx(np.sqrt(2.0) / (2.0 * np.pi))
    assert mode.linear_damping == pytest.approx(0.01 / np.sqrt(2.0))
    assert mode.damping[-1] < mode.damping.max()
    for point, X, shape in zip(mode.points, mode.amplitude, mode.shape):
        a1, b1, _ = exact.jenkins_harmonic(X, 1.0, 1.0)
        assert shape[0] == pytest.approx(1.0)
        assert point.omega == pytest.approx(np.sqrt(1.0 + a1 / X), rel=1e-5)
        assert -point.sigma == pytest.approx(0.02 + b1 / X / point.omega, rel=1e-4)
        assert point.energy.sum() == pytest.approx(np.pi * b1 * X, rel=1e-4, abs=1e-4)
        assert point.friction == pytest.approx(point.energy.sum())
        assert point.supplied == pytest.approx(point.friction + np.pi * 0.02 * point.omega * X**2)


def test_changes_with_twice_the_samples_estimate_the_error(structure):
    """Three quarters of the error by samples, which falls with their square; one mass has no harmonics above 1."""
    mode = microslip.backbone(structure(one_mass(), samples=64), quasi_static=False)
    assert len(mode.checks) == 6
    for check in mode.checks:
        point = mode.points[check.point]
        assert point.damping_by_friction > 0.0
        a1, b1, _ = exact.jenkins_harmonic(point.amplitude, 1.0, 1.0)
        omega = np.sqrt(1.0 + a1 / point.amplitude)
        error = mode.damping[check.point] - (0.02 + b1 / point.amplitude / omega) / (2.0 * omega)
        assert abs(check.damping) < 0.05 * mode.damping[check.point]
        assert abs(check.damping) > 0.3 * abs(error)


def test_points_without_a_solution_with_twice_the_harmonics_are_stated(structure):
    mode = microslip.backbone(structure(one_mass()), quasi_static=False)
    size = abs(mode.shape[:, 0]) * mode.amplitude
    last = replace(mode.checks[-1], frequency=np.nan, damping=np.nan)
    some, none = (replace(mode, checks=checks) for checks in ((*mode.checks[:-1], last), (last,)))
    assert [line for line in in_words(some) if "at 5 points: frequency within" in line]
    (line,) = [line for line in in_words(none) if "twice the harmonics" in line]
    assert f"no solution at 1 of 1 point, {size[last.point]:.4g} m" in line and "state more harmonics" in line
    lifts = replace(none, points=(*mode.points[:-1], replace(mode.points[-1], state=np.array([OPEN]))))
    (line,) = [line for line in in_words(lifts) if "twice the harmonics" in line]
    assert f"pairs open from {size[-1]:.4g} m on" in line and "may have no solution" in line


@pytest.mark.ranks(1)
def test_phase_resonance_and_synthesis_are_forced_responses(structure):
    """With one mode the synthesis is exact, except that the friction damping is at the frequency of the mode."""
    built = structure(one_mass(), points=40)
    mode, response = microslip.backbone(built), microslip.respond(built, peaks=True, error_bars=False)
    (peak,) = [peak for peak in response.peaks[0.4] if peak.output == 0]
    by_mode = mode.forced(0.4)
    assert by_mode.peak[0] == pytest.approx(abs(peak.amplitude), rel=0.01)
    assert by_mode.resonance == pytest.approx(peak.omega / (2.0 * np.pi), rel=0.01)
    assert np.abs(by_mode.coefficients).max() == pytest.approx(by_mode.peak[0], rel=0.01)
    curve = response.level(0.4)
    size = np.hypot(*curve.response[:, 0, 1:3].T)
    inside = (by_mode.frequency.min() < curve.frequency) & (curve.frequency < by_mode.frequency.max())
    order = np.argsort(by_mode.frequency)
    near = np.interp(curve.frequency[inside], by_mode.frequency[order], np.abs(by_mode.coefficients[order, 0]))
    assert near == pytest.approx(size[inside], rel=0.1)
    assert np.isnan(mode.forced(1e9).peak[0])


@pytest.mark.ranks(1)
def test_statics_and_masings_rules_give_the_secant_and_the_loop(structure):
    """For one Jenkins element: alpha = k X + mu N, loss 4 mu N (X - 1)."""
    quasi = microslip.backbone(structure(one_mass())).quasi_static
    X = quasi.amplitude[quasi.amplitude > 1.0]
    omega = 2.0 * np.pi * quasi.frequency[quasi.amplitude > 1.0]
    assert omega == pytest.approx(np.sqrt(1.0 + 1.0 / X), rel=1e-6)
    by_friction = 4.0 * (X - 1.0) / (2.0 * np.pi * (omega * X) ** 2)
    assert quasi.damping[quasi.amplitude > 1.0] == pytest.approx(by_friction + 0.01 / omega, rel=1e-2)


@pytest.mark.ranks(1)
def test_a_mode_that_moves_pairs_only_by_rounding_is_linear(structure):
    """Two equal masses with a spring between them and a joint: their symmetric mode does not deform it."""
    system = two_masses()
    system["K"], system["C"] = np.array([[1.3, -0.3], [-0.3, 1.3]]), 0.02 * np.eye(2)
    system["pair_dofs"] = [[0, -1, -1, 1, -1, -1]]
    modes = [microslip.backbone(structure(system), mode=mode, farthest=4.0) for mode in (1, 2)]
    assert [np.isfinite(mode.first_slip) for mode in modes] == [False, True]
    assert "moves no pair of a joint" in modes[0].notes[-1]


def with_a_gap(gap=1.0):
    """Return two coupled masses: the first on a friction element, the second with a gap to a stop."""
    return scenes.make_system(
        "gap",
        np.eye(2),
        np.array([[1.3, -0.3], [-0.3, 1.6]]),
        [[0, -1, -1, -1, -1, -1], [-1, -1, 1, -1, -1, -1]],
        mu=[1.0, 0.3],
        N0=[1.0, -2.0 * gap],
        k_t=[1.0, 0.5],
        k_n=[1.0, 2.0],
        C=0.02 * np.eye(2),
        loads=[{"vector": [1.0, 0.0], "harmonic": 1, "phase": 0.0}],
        output=[1.0, 0.0],
        omega=(0.5, 3.0),
        levels={},
    )


@pytest.mark.parametrize("mode", (1, 2))
@pytest.mark.ranks(1)
def test_a_mode_begins_about_rest_with_open_pairs(structure, mode):
    """With all pairs closed the modes have 1.49 and 1.91 rad/s; about rest 1.22 and 1.55, until a pair slips or closes."""
    result = microslip.backbone(structure(with_a_gap(), harmonics=3), mode=mode, farthest=1.2)
    squares, phi = np.linalg.eigh(with_a_gap()["K"] + np.diag([1.0, 0.0]))
    omega, (x, z) = np.sqrt(squares[mode - 1]), np.abs(phi[:, mode - 1])
    assert result.linear_frequency * 2.0 * np.pi == pytest.approx(omega, rel=1e-12)
    assert result.linear_damping == pytest.approx(0.01 / omega)
    assert result.first_slip == pytest.approx(min(1.0 / x, 1.0 / z), rel=1e-8)
    assert result.frequency[0] == pytest.approx(result.linear_frequency, rel=1e-8)
    assert (result.open_at_rest, result.counts_open) == (1, True)
    assert "1 pair has a gap and is open at rest" in result.notes[-1]
    assert result.quasi_static.frequency[0] == pytest.approx(result.linear_frequency, rel=1e-8)


@pytest.mark.parametrize("mode", (1, 2))
def test_a_mode_whose_damping_couples_the_modes_begins_at_first_slip(structure, mode):
    """Its masses are out of phase, with larger amplitudes than in the undamped mode of the same modal amplitude."""
    system = with_a_gap() | {"C": np.diag([0.02, 0.5])}
    result = microslip.backbone(structure(system), mode=mode, farthest=1.2, quasi_static=False, error_bars=False)
    K = system["K"] + np.diag([1.0, 0.0])
    squares, phi = np.linalg.eigh(K)

    def singular(x):
        determinant = np.linalg.det(K - x[0] ** 2 * np.eye(2) + 1j * x[0] * (system["C"] - x[1] * np.eye(2)))
        return determinant.real, determinant.imag

    omega, xi = root(singular, (np.sqrt(squares[mode - 1]), phi[:, mode - 1] @ system["C"] @ phi[:, mode - 1]), tol=1e-13).x
    shape = np.array([0.3, K[0, 0] - omega**2 + 1j * omega * (0.02 - xi)])
    shape /= phi[:, mode - 1] @ shape
    assert result.linear_frequency == pytest.approx(omega / (2.0 * np.pi), rel=1e-9)
    assert result.first_slip == pytest.approx(np.min(1.0 / np.abs(shape)), rel=1e-6)
    assert np.min(1.0 / np.abs(phi[:, mode - 1])) > 1.001 * result.first_slip


@pytest.mark.ranks(1)
def test_a_mass_with_a_stop_has_the_frequency_of_its_two_parts(structure):
    """Half a cycle or more at sqrt(k / m) = 1, the rest of the cycle at 2: the stop has three times the spring stiffness."""
    system = scenes.make_system(
        "stop", np.eye(1), np.eye(1), [[-1, -1, 0, -1, -1, -1]], mu=0.3, N0=-1.5, k_t=0.5, k_n=3.0, C=[[1e-6]],
        loads=[{"vector": [1.0], "harmonic": 1, "phase": 0.0}], output=[1.0], omega=(0.5, 2.0), levels={},
    )  # fmt: skip
    mode = microslip.backbone(structure(system, harmonics=15, samples=1024), farthest=10.0)
    assert mode.first_slip == pytest.approx(0.5) and mode.linear_frequency == pytest.approx(0.5 / np.pi)
    assert mode.frequency[-1] == pytest.approx(_of_a_stop(mode.response[-1, 0], 0.5), rel=1e-4)
    assert 0.5 < mode.quasi_static.opens < 0.6


def _of_a_stop(harmonics, gap):
    """Return the frequency [Hz] of the free vibration with a stop of stiffness 3, k = m = 1, at the amplitude of a motion."""
    theta = np.linspace(0.0, 2.0 * np.pi, 4001)
    n = np.arange(1, (len(harmonics) + 1) // 2)[:, None]
    u = harmonics[0] + harmonics[1::2] @ np.cos(n * theta) + harmonics[2::2] @ np.sin(n * theta)
    A = max(u.max(), -u.min())  # on the free side
    in_contact = np.arccos(0.25 * gap / np.hypot(0.25 * gap, 0.5 * np.sqrt(A**2 - gap**2)))
    return 1.0 / (np.pi + 2.0 * np.arcsin(gap / A) + in_contact)


def test_first_slip_with_a_friction_force_at_rest_is_exact(structure):
    """Across the motion |T| = mu N where (k_t x)^2 + T0^2 = (mu N)^2; along it the limit is reduced by T0."""
    built = structure(one_mass())
    for T0, x in (((0.0, 0.6), 0.8), ((0.6, 0.0), 0.4)):
        pairs = replace(built.pairs, T0=np.array([T0]))
        mode = microslip.backbone(replace(built, pairs=pairs, results={}), farthest=1.5, quasi_static=False, error_bars=False)
        assert mode.first_slip == pytest.approx(x, rel=1e-8) and not mode.slips_at_rest
        assert mode.slipping[0] == 0


def test_the_first_amplitude_is_significant_with_pairs_at_their_limit_at_rest(structure):
    built = structure(two_masses() | {"pair_dofs": [[0, -1, -1, -1, -1, -1]]})
    pairs = replace(built.pairs, T0=np.array([[1.0 - 1e-15, 0.0]]))
    mode = microslip.backbone(replace(built, pairs=pairs, results={}), farthest=1.5, quasi_static=False, error_bars=False)
    assert mode.slips_at_rest and mode.first_slip == pytest.approx(1e-3)


def test_the_quasi_static_mode_covers_a_mode_of_falling_frequency(structure, monkeypatch):
    """It extends to the largest force of its points, not to that of the largest amplitude; otherwise it reports an early end."""
    by_statics = backbone.by_statics

    def with_soft_end(equation, problem, points, opens):
        last = replace(points[-1], amplitude=2.0 * points[-1].amplitude, omega=0.01 * points[-1].omega)
        return by_statics(equation, problem, [*points, last], opens)

    monkeypatch.setattr(backbone, "by_statics", with_soft_end)
    mode = microslip.backbone(structure(one_mass()), error_bars=False)
    quasi = mode.quasi_static
    assert quasi.amplitude.max() > 0.9 * mode.amplitude.max()
    assert quasi.failure == "the mode has its larger amplitudes at smaller static loads"


def test_a_mode_of_constant_frequency_is_compared_in_hertz():
    size = np.array([1.0, 2.0])
    quasi = QuasiStatic(size, np.array([9.9, 10.1]), np.array([0.1, 0.2]), 1.0, np.inf, None)
    mode = SimpleNamespace(
        shape=np.ones((2, 1)),
        amplitude=size,
        frequency=np.full(2, 10.0),
        damping=np.full(2, 0.2),
        linear_frequency=10.0,
        units="m",
    )
    assert "frequency within 0.1 Hz, damping within 50 % of the largest" in statics_in_words(mode, quasi)[0]


@pytest.mark.ranks(1)
def test_the_quasi_static_mode_reports_its_range_and_why_it_ends(structure):
    """One mass lifts off; another, held by friction only, slides away under the load of both limits."""
    lifts = one_mass(k_n=np.ones(1), N0=np.ones(1), pair_dofs=[[-1, -1, 0, -1, -1, -1]])
    both = {"mu": np.array([1.0, 0.05])} | {name: np.ones(2) for name in ("N0", "k_t", "k_n")}
    slides = one_mass(K=np.zeros((1, 1)), pair_dofs=[[0, -1, -1, -1, -1, -1]] * 2, separate=np.zeros(2, bool), **both)
    lifting, sliding = (
        microslip.backbone(structure(system, harmonics=2), farthest=farthest)
        for system, farthest in ((lifts, 5.0), (slides, 24.0))
    )
    assert 0.999 < lifting.quasi_static.opens < 1.2 and lifting.quasi_static.failure is None
    assert np.isinf(sliding.quasi_static.opens) and "no static equilibrium" in sliding.quasi_static.failure
    assert any("rules do not hold" in line for line in in_words(lifting))
    assert 2.0 * 0.525 == pytest.approx(
        (2.0 * np.pi * sliding.quasi_static.frequency[-1]) ** 2 * sliding.quasi_static.amplitude[-1]
    )
    assert any("it ends at" in line for line in in_words(sliding))


@pytest.mark.ranks(1)
def test_forced_responses_are_computed_about_the_mode():
    """Three half-power widths beyond its frequencies, and above 0 for any damping."""
    mode = SimpleNamespace(mode=2, linear_frequency=3.0, frequency=np.array([3.0, 2.5]), damping=np.array([0.01, 0.2]))
    mode.linear_damping, mode.counts_open = 0.01, False
    scenes_of = [SimpleNamespace(response=SimpleNamespace(mode=number)) for number in (2, 1, None)]
    assert [band(mode, scene) for scene in scenes_of] == [None, *[pytest.approx((2.5 / 2.2, 3.0 * 2.2))] * 2]
    mode.counts_open = True  # its number differs from that of the scene
    assert band(mode, scenes_of[0]) == pytest.approx((2.5 / 2.2, 3.0 * 2.2))


@pytest.mark.ranks(1)
def test_the_next_forced_peak_is_compared_with_a_mode():
    peaks = [SimpleNamespace(output=0, omega=2.0 * np.pi * f, amplitude=a) for f, a in ((1.0, 5.0), (3.1, 2.0j))]
    by_mode = SimpleNamespace(resonance=3.0, peak=np.array([1.9]))
    forced = Forced(1.0, by_mode, np.ones(2), np.array([[5.0], [2.0]]), peaks, None)
    assert (forced.peak, forced.error) == (2.0, pytest.approx(-0.05))
    assert replace(forced, peaks=[]).peak == 5.0


def test_a_mode_that_moves_no_pair_is_linear(structure):
    mode = microslip.backbone(structure(two_masses()), mode=2)
    assert mode.points == () and np.isinf(mode.first_slip)
    assert mode.linear_frequency == pytest.approx(3.0 / (2.0 * np.pi))
    assert "moves no pair of a joint" in mode.notes[-1]


@pytest.mark.ranks(1)
def test_a_harmonic_at_the_frequency_of_another_mode_is_reported(structure):
    """1.414 rad/s falls to 1: with mode 2 at 3.6 rad/s, it is three times the frequency at 1.2 rad/s."""
    system = two_masses()
    system["K"] = np.diag([1.0, 3.6**2])
    mode = microslip.backbone(structure(system, harmonics=3))
    (meeting,) = mode.meetings
    assert (meeting.harmonic, meeting.mode) == (3, 2)
    assert meeting.frequency == pytest.approx(1.2 / (2.0 * np.pi))
    assert np.interp(meeting.amplitude, mode.amplitude, mode.frequency) == pytest.approx(meeting.frequency, rel=1e-3)


@pytest.mark.parametrize(
    ("system", "mode", "message"),
    [
        (one_mass(), 2, "there is no mode 2: the structure has 1 mode, and only --mode 1 can be followed"),
        (one_mass(mu=np.zeros(1)), 1, "no pair has friction"),
        (two_masses() | {"K": np.diag([1.0, 2.0])}, 1, "modes 1, 2 have the same frequency, 0.225079 Hz"),
        (on_a_stop() | {"N0": np.zeros(1)}, 1, "no pair has friction and a preload, and none a gap"),
        (one_slack(), 2, "all pairs that mode 2 moves are closed without a preload"),
        (on_a_stop() | {"K": np.diag([2.0, 0.0])}, 1, "1 of 1 pair is open at rest, and without contact there"),
        (one_mass(loads=[{"vector": [1.0], "harmonic": n, "phase": 0.0} for n in (0, 1)]), 1, "[[loads]] with harmonic = 0"),
    ],
)
def test_structures_without_nonlinear_mode_are_rejected(structure, system, mode, message):
    with pytest.raises(CaseError) as caught:
        microslip.backbone(structure(system), mode=mode)
    assert message in str(caught.value)


def two_with_a_gap(k, k_n):
    """Return two masses: one of a spring k that a gap separates from another, k_n, and one with friction, stuck at omega = 1."""
    return scenes.make_system(
        "gap and friction",
        np.eye(2),
        np.diag([k, 0.5]),
        [[-1, -1, 0, -1, -1, -1], [1, -1, -1, -1, -1, -1]],
        mu=[0.5, 0.5],
        N0=[-0.5, 1.0],
        k_t=[k_n, 0.5],
        k_n=[k_n, 1.0],
        loads=[{"vector": np.ones(2), "harmonic": 1, "phase": 0.0}],
        output=[0.0, 1.0],
        omega=(0.3, 3.0),
        levels={},
        zeta=0.01,
    )


def test_modes_are_multiple_by_their_frequencies_at_rest(structure):
    """Where the gap is open: without its springs."""
    one_apart = structure(two_with_a_gap(0.2, 0.8))
    assert one_apart.omega_n == pytest.approx([1.0, 1.0])
    for mode, frequency in ((1, np.sqrt(0.2)), (2, 1.0)):
        followed = microslip.backbone(one_apart, mode=mode, farthest=1.1, quasi_static=False, error_bars=False)
        assert 2.0 * np.pi * followed.linear_frequency == pytest.approx(frequency)
    with pytest.raises(CaseError, match="modes 1, 2 have the same frequency"):
        microslip.backbone(structure(two_with_a_gap(1.0, 3.0)), mode=1)


def test_the_partner_of_a_multiple_mode_need_not_be_in_use(structure):
    system = two_masses() | {"K": np.diag([1.0, 2.0])}
    with pytest.raises(CaseError, match="modes 1, 2 have the same frequency"):
        microslip.backbone(structure(system, modes=1), mode=1)


@pytest.mark.pictures
def test_the_command_writes_table_arrays_and_pictures(scene_file, program, shared_path):
    path = scene_file(one_mass(), points=8, samples=64)
    status, out, err = program("backbone", path, "--out", shared_path / "out", "--levels", "0.4", "--farthest", "5")
    assert (status, err) == (0, "")
    if COMM.rank == 0:
        with open(shared_path / "out" / "backbone.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        assert float(rows[0]["0_m"]) == pytest.approx(1.0) and float(rows[-1]["0_m"]) == pytest.approx(5.0)
        with h5py.File(shared_path / "out" / "backbone.h5") as file:
            assert file["frequency"][:] == pytest.approx([float(row["frequency_Hz"]) for row in rows])
            assert file["energy"].shape == (len(rows), 1) and file["energy"].attrs["unit"] == "J" and file.attrs["failure"] == ""
        assert {"backbone.png", "synthesis.png", "synthesis.csv"} <= {each.name for each in (shared_path / "out").iterdir()}
        assert "level 0.4: peak" in out and "by statics and Masing's rules" in out
    COMM.Barrier()
    status, out, err = program("backbone", path, "--out", shared_path / "out", "--farthest", "5")
    assert (status, err) == (0, "")
    if COMM.rank == 0:
        names = {each.name for each in (shared_path / "out").iterdir()}
        assert "backbone.png" in names and not {"synthesis.png", "synthesis.csv"} & names


@pytest.mark.ranks(1)
def test_forced_responses_are_computed_if_the_scene_names_the_followed_mode(scene_file, program, shared_path):
    path = scene_file(one_mass(), points=8, samples=64)

    def names_the_mode():
        text = path.read_text()
        path.write_text(text.replace(re.search(r"frequencies = .*", text)[0], "mode = 1\nspan = [0.7, 1.3]"))

    on_root(COMM, names_the_mode)
    status, out, err = program("backbone", path, "--out", shared_path / "out", "--levels", "0.4", "--farthest", "5")
    assert (status, err) == (0, "")
    if COMM.rank == 0:
        assert "level 0.4: peak" in out


def test_a_mode_needs_no_linear_curve_and_one_batch_of_static_columns(structure, monkeypatch):
    """Three masses, each with a joint, which slip one after the other."""

    def no_curve(*_):
        raise AssertionError("a nonlinear mode begins at its own frequency")

    alike = {"mu": 1.0, "N0": np.array([0.5, 1.0, 1.5]), "k_t": 0.2, "k_n": 0.0, "C": 0.01 * np.eye(3)}
    links = 2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    places, load = [[i, -1, -1, -1, -1, -1] for i in range(3)], {"vector": np.eye(3)[0], "harmonic": 1, "phase": 0.0}
    system = scenes.make_system(
        "chain", np.eye(3), links, places, **alike, loads=[load], output=np.eye(3)[0], omega=(0.1, 3.0), levels={}
    )
    monkeypatch.setattr("microslip.continuation.levels.linear_curve", no_curve)
    chain = structure(system, (0.1, 3.0), (0.1,), samples=64)
    mode = microslip.backbone(chain, farthest=8.0, error_bars=False)
    assert mode.failure is None and mode.slipping[0] < mode.slipping[-1] == 3
    assert chain.statics.G_static.batches == 1
