"""Sliders that start at a phase of the cycle: plain marching from that phase, waves, and derivatives."""

import numpy as np
import pytest
from test_combined import elastic, motions

from microslip.contact.law import SLIP, STICK, Law
from microslip.contact.laws import columns_of_joint, joined, law_of
from microslip.contact.started import StartedLaw, started_at
from microslip.fourier.coefficients import analyse, shifted, synthesise
from microslip.fourier.harmonics import Harmonics

N_H, N_T = 7, 64
FULL = Harmonics.full(N_H)


def settling(n, seed=3):
    """Return a law of friction circles, whose residual forces depend on the start, and motions with some pairs at rest."""
    return elastic(n, 2, separate=np.zeros(n, dtype=bool)), 0.6 * motions(n, 0.3, seed=seed)


def test_members_that_depend_on_the_phase_are_redefined():
    """Each member of Law is redefined, or does not depend on the phase of the start."""
    of_law = {name for name in vars(Law) if not name.startswith("_")}
    assert of_law - set(vars(StartedLaw)) == {
        *("n_pairs", "stiffness", "springs", "order", "elements_order", "parameters", "n_memory", "sliders"),
        *("step", "memoryless_rate", "slip_safety", "utilisation", "slipping_share", "keeps_half_wave_symmetry"),
    }


@pytest.mark.parametrize("k", [1, 17, 63])
def test_a_start_at_a_sample_is_the_return_map_marched_from_that_sample(k):
    law, U = elastic(40, 77).followed(False), 0.6 * motions(40, 0.3)
    cycle = StartedLaw(law, np.full(40, 2.0 * np.pi * k / N_T)).cycle(U, N_T)
    du, before, forces = np.moveaxis(synthesise(U, N_T), -1, 0), np.zeros((40, 3)), np.zeros((N_T, 40, 3))
    for j in np.arange(k, k + 4 * N_T) % N_T:
        before, _, _ = law.step(du[j], before)
        forces[j] = before
    np.testing.assert_allclose(cycle.p, analyse(np.moveaxis(forces, 0, -1), FULL), atol=1e-13)


def test_the_force_of_a_pair_at_rest_after_slip_depends_on_the_start():
    law, U = settling(200)
    from_zero, from_phase = (StartedLaw(law, np.full(200, start)).cycle(U, N_T) for start in (0.0, 20.0 * np.pi / N_T))
    rests = (from_zero.state == STICK) & from_zero.p.any(axis=(1, 2))
    assert rests.sum() > 10 and np.abs(from_zero.p - from_phase.p)[rests, :, 0].max() > 1e-3
    slides = from_zero.state == SLIP
    np.testing.assert_array_equal(from_zero.state, from_phase.state)
    assert slides.sum() > 10 and np.median(np.abs(from_zero.p - from_phase.p)[slides, :, 0]) < 1e-6  # slip removes the start


def test_a_wave_has_the_same_forces_in_every_sector_with_any_number_of_samples():
    law, U = settling(30)
    unshifted = law.cycle(U, 61)
    for phase in (0.7, -2.0 * np.pi / 5.0):
        start = np.full(30, -phase)
        started = StartedLaw(law, start).cycle(shifted(U, np.full((30, 1), phase), FULL), 61)
        np.testing.assert_allclose(started.p, shifted(unshifted.p, np.full((30, 1), phase), FULL), atol=1e-13)
        np.testing.assert_array_equal(started.state, unshifted.state)
        np.testing.assert_array_equal(started.active, unshifted.active)


@pytest.mark.parametrize("harmonics", [FULL, Harmonics((1, 3)), Harmonics((0, 2, 3))])
def test_derivatives_with_a_start_agree_with_differences(harmonics):
    rng = np.random.default_rng(5)
    law, U = settling(25)
    started = StartedLaw(law, rng.uniform(-3.0, 3.0, 25)).take(slice(5, None))
    U = FULL.carry(U, harmonics)[5:]
    cycle, dU, h = started.cycle(U, N_T, True, harmonics), rng.standard_normal(U.shape), 1e-7
    both_sides = [started.cycle(U + sign * h * dU, N_T, False, harmonics).p for sign in (1.0, -1.0)]
    product = np.einsum("mij,mj->mi", cycle.P, dU[cycle.active].reshape(len(cycle.active), -1))
    difference = ((both_sides[0] - both_sides[1]) / (2.0 * h)).reshape(20, -1)[cycle.active]
    assert np.abs(difference - product).max() < 1e-5 * np.abs(product).max()
    mu, pairs = started.law.mu, np.arange(20)
    both_sides = [started.with_parameters("mu", pairs, mu + sign * h).cycle(U, N_T, False, harmonics).p for sign in (1.0, -1.0)]
    rate = started.parameter_rate("mu", U, N_T, harmonics)
    assert np.abs((both_sides[0] - both_sides[1]) / (2.0 * h) - rate).max() < 1e-5 * np.abs(rate).max()


def test_a_joint_states_its_start_and_others_start_at_0():
    law, _ = settling(3)
    columns = {name: getattr(law, name) for name in ("mu", "N0", "k_t", "k_n", "separate", "open_at_rest")} | {
        "T0": np.zeros((3, 2))
    }
    start = joined(
        [(2, columns_of_joint("elastic-coulomb", {"start": -1.5}, 2)), (1, columns_of_joint("elastic-coulomb", {}, 1))]
    )
    started = law_of(np.full(3, "elastic-coulomb"), columns | start)
    np.testing.assert_array_equal(started.start, [-1.5, -1.5, 0.0])
    assert started_at(law, None) is law and started_at(law, np.zeros(3)) is law
