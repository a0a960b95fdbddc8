"""Steady states of the reduced model in time: exact solutions, an independent march, the energy balance, harmonic balance."""

import re

import numpy as np
import pytest
from dense_model import branch, reduced
from mpi4py import MPI
from oracles import exact, scenes, time_integration

from microslip.fourier.amplitudes import to_real
from microslip.receptance.motions import modal_motion, output_motion
from microslip.transient.march import March, StepContact
from microslip.transient.steady import coefficients, energies, from_harmonics, from_rest, samples, steady_state
from microslip.transient.transient_model import transient_model

COMM = MPI.COMM_SELF
pytestmark = pytest.mark.slow


def marched(system, omega, level, n_steps, accelerated=True, tolerance=1e-8, n_modes=None, most=400):
    """Return model, omega, level and the steady state reached from rest."""
    model, parameters = reduced(system, COMM, 3, n_modes)
    transient = transient_model(model, parameters)
    omega, level = np.atleast_1d(omega).astype(float), np.full(np.size(omega), float(level))
    steady = steady_state(March(transient, omega, level, n_steps), from_rest(transient, len(omega)), tolerance, most, accelerated)
    assert steady.distance.max() <= tolerance
    return transient, omega, level, steady


def output(transient, level, computed, H=15):
    omega = np.ones_like(level)  # without effect: the structures have supports
    return coefficients(samples(transient, omega, level, computed.cycle)[1], H)[:, 0]


def test_the_jenkins_mass_converges_to_its_exact_steady_state_at_second_order():
    omegas, errors = np.array([1.16, 1.25, 1.4]), []
    expected = np.array(
        [exact.jenkins_steady_state(w, 0.8, m=1.0, c=0.02, k=1.0, k_t=1.0, muN=1.0).harmonics(15) for w in omegas]
    )
    for n_steps in (32, 128):
        transient, _, level, steady = marched(scenes.jenkins_mass(), omegas, 0.8, n_steps, tolerance=1e-6)
        errors.append(np.abs(output(transient, level, steady) - expected).max() / np.abs(expected).max())
    assert errors[1] < 2e-3
    assert np.log2(errors[0] / errors[1]) / 2.0 == pytest.approx(2.0, abs=0.5)


@pytest.mark.parametrize("name, level, omega", [("spatial", 0.4, 1.3), ("spatial", 1.2, 1.2), ("chain", 100.0, 560.0)])
def test_the_steady_state_agrees_with_the_march_of_the_unreduced_system(name, level, omega):
    """Another scheme, all coordinates, another condensation of contact; the same steps, so that the law is sampled equally."""
    system = scenes.SCENES[name]()
    transient, _, levels, steady = marched(system, omega, level, 64, tolerance=1e-6)
    other = time_integration.steady_state(
        system, omega, level, n_steps=64, scheme="exponential", tolerance=1e-5, coarse=1, law="return"
    )
    theirs = system["output"] @ other.u_hat
    assert np.abs(output(transient, levels, steady)[0] - theirs).max() < 2e-3 * np.abs(theirs[1:]).max()
    assert np.array_equal(steady.cycle.state[0], other.state)


@pytest.mark.parametrize("name, level, omega", [("jenkins", 0.8, 1.2), ("spatial", 0.4, 1.3)])
def test_the_work_of_the_load_is_lost_by_damping_and_friction(name, level, omega):
    closures = []
    for n_steps in (64, 128):
        transient, omegas, levels, steady = marched(scenes.SCENES[name](), omega, level, n_steps)
        work, damping, friction = energies(transient, omegas, levels, steady.cycle)
        assert friction[0] > 0.01 * work[0] > 0.0
        closures.append(abs(work - damping - friction)[0] / work[0])
    assert closures[1] < 5e-3 and closures[1] < 0.6 * closures[0]


def test_accelerated_and_plain_integration_have_the_same_steady_state():
    """Both start at rest; the mass slips in every cycle, which removes the initial state."""
    system = scenes.spatial_mass()
    transient, _, level, quick = marched(system, [1.3, 1.6], 0.6, 32)
    _, _, _, slow = marched(system, [1.3, 1.6], 0.6, 32, accelerated=False)
    assert output(transient, level, quick) == pytest.approx(output(transient, level, slow), abs=1e-6)
    assert quick.periods.max() < 0.5 * slow.periods.min()


def test_the_steady_period_repeats():
    transient, omega, level, steady = marched(scenes.spatial_mass(), [1.3, 1.6], 0.6, 32)
    march = March(transient, omega, level, 32)
    z, p, cycle = march.period(steady.start.z, steady.start.p)
    before, after = march.scheme.pack(steady.start.z), march.scheme.pack(z)
    assert np.abs(after - before).max() < 1e-6 * np.abs(before).max()
    assert np.abs(p - steady.start.p).max() < 1e-6 * np.abs(cycle.p).max()
    assert cycle.p == pytest.approx(steady.cycle.p, abs=1e-6 * np.abs(cycle.p).max())


@pytest.mark.parametrize("n_modes", [2, None])
def test_harmonic_balance_converges_to_the_steady_state_with_more_harmonics(n_modes):
    """The same reduced model, with or without truncated modes, and the same samples: the difference is due to harmonics."""
    system, omega, level, values = {**scenes.chain(), "sampled": True}, 560.0, 20.0, []
    for H in (1, 3, 9):
        points = branch(
            system, COMM, level, low=550.0, high=570.0, H=H, n_samples=128, at=(omega,), points=4, n_modes=n_modes
        ).points
        (point,) = (harmonics for harmonics in points if harmonics.requested)
        values.append(point.response[0, 1:3])
    model, parameters = reduced(system, COMM, H, n_modes)
    transient = transient_model(model, parameters)
    omegas, levels = np.array([omega]), np.array([level])
    (eta,) = modal_motion(model, level, omega, point.p.reshape(-1, 2 * H + 1))
    start = from_harmonics(transient, omegas, to_real(eta, 2 * H + 1)[None], point.U[None], 128)
    mine = output(transient, levels, steady_state(March(transient, omegas, levels, 128), start, 1e-6, 60))[0, 1:3]
    differences = [np.hypot(*(mine - harmonics)) / np.hypot(*mine) for harmonics in values]
    assert differences[2] < 2e-3 and differences[2] < 0.5 * differences[1] < 0.5 * differences[0]


def test_the_linear_response_is_exact():
    system = scenes.chain()
    transient, omega, level, steady = marched(system, [410.0, 560.0, 777.0], 0.01, 128)
    model, _ = reduced(system, COMM, 3)
    none = np.zeros((3 * model.n_pairs, model.N_H))
    for i, w in enumerate(omega):
        expected = output_motion(model, 0.01, w, none)[0]
        assert output(transient, level, steady, 3)[i] == pytest.approx(expected, abs=5e-4 * np.abs(expected).max())
    assert steady.periods.max() == 2 and not steady.cycle.p.any()


def on_stops(open_at_rest):
    """Return a block between two closed pairs and two stops that are open at rest."""
    m, k = np.diag([1.0, 1.0, 1.0, 0.3, 0.2, 0.4]), np.diag([0.5, 0.4, 0.6, 0.8, 0.9, 0.7])
    k[:3, 3:] = k[3:, :3] = -0.1 * np.eye(3)
    return scenes.make_system(
        "stops",
        m,
        k,
        [[0, 1, 2, -1, -1, -1], [3, 4, 5, -1, -1, -1], [0, 1, 2, 3, 4, 5]],
        mu=0.4,
        N0=[1.0, -0.3, -0.2],
        k_t=[1.0, 0.8, 0.6],
        k_n=[1.5, 1.2, 0.9],
        C=0.05 * np.eye(6),
        loads=[{"vector": np.array([0.5, 0.2, 0.3, 0.2, 0.1, 1.0]), "harmonic": 1, "phase": 0.0}],
        output=[0, 0, 0, 0, 0, 1],
        omega=(0.8, 1.6),
        levels={},
    ) | {"open_at_rest": np.array([False, open_at_rest, open_at_rest])}


@pytest.mark.study
def test_pairs_without_springs_have_the_motion_of_those_with_springs():
    """The same structure twice: the law removes the springs of an open pair from K_L; damping is that of a matrix."""
    values = []
    for open_at_rest in (False, True):
        system = on_stops(open_at_rest)
        transient, _, level, one = marched(system, [1.1, 1.3], 0.8, 32, tolerance=1e-6)
        values.append(output(transient, level, one))
        assert (one.cycle.state[:, 1:] == 2).all() and np.abs(one.cycle.p).max(axis=(0, 1)).reshape(3, 3)[1:, 2].min() > 0.01
    assert values[0] == pytest.approx(values[1], abs=1e-5 * np.abs(values[0]).max())


def test_a_failed_step_names_a_motion_without_inertia():
    """A block supported only by its pair, by two of its three modes."""
    system = scenes.make_system(
        "hung",
        np.diag([1.0, 2.0, 3.0]),
        np.zeros((3, 3)),
        [[0, 1, 2, -1, -1, -1]],
        mu=0.3,
        N0=1.0,
        k_t=1.0,
        k_n=2.0,
        zeta=0.01,
        loads=[{"vector": np.array([1.0, 0.0, 0.0]), "harmonic": 1, "phase": 0.0}],
        output=[1, 0, 0],
        omega=(0.1, 1.0),
        levels={},
    )
    for n_modes, advice in (
        (2, "1 motion has neither inertia nor stiffness .* more .* modes, 3 at least"),
        (3, "take more steps a period"),
    ):
        transient = transient_model(*reduced(system, COMM, 1, n_modes))
        march = March(transient, np.array([0.9]), np.ones(1), 64)
        assert re.search(advice, StepContact(transient, march.scheme)._advice(0))
