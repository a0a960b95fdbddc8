"""Jumps of cycles compared with the closed form of one pair that slides by a prescribed amplitude between rigid bodies."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.energy import pair_energy
from microslip.library.jumps import JumpControl, WornState, follow_wear, wear_on
from microslip.messages.errors import ConvergenceError

X, N0, MU, K, PER_ENERGY, CYCLES = 1e-4, 100.0, 0.5, 1e7, 1e-5, 100.0  # K of k_t and k_n; PER_ENERGY: alpha / area
PRELOAD, DEPTH = 14.145065266, 8.585493e-6  # after 100 cycles
SAMPLES = 1024
FINE = JumpControl(CYCLES, most=4e-9, tolerance=1e-2, most_jumps=3000)


@dataclass(frozen=True)
class Slid:
    energy: np.ndarray

    @property
    def rate(self):
        return PER_ENERGY * self.energy


def by_formula(depth):
    """Return the cycle of a Jenkins element whose preload decreases with the depth."""
    N = N0 - K * depth
    return Slid(4.0 * MU * N * np.maximum(X - MU * N / K, 0.0))


def by_law(depth):
    """Return the same cycle by the contact law of the program."""
    ones = np.ones(1)
    law = ElasticCoulomb(MU * ones, N0 - K * depth, K * ones, K * ones, np.zeros(1, dtype=bool))
    U = np.zeros((1, 3, 3))
    U[0, 0, 1] = X
    return Slid(pair_energy(U, law.cycle(U, SAMPLES, tangents=False).p))


def worn(control, evaluate=by_formula):
    state = WornState(0.0, np.zeros(1), np.zeros(1), evaluate(np.zeros(1)))
    return [state, *follow_wear(evaluate, control, state)]


def logistic(cycles):
    """Return the preload after some cycles: dN/dc = -a N (X - b N)."""
    a, b = 4.0 * MU * K * PER_ENERGY, MU / K
    return 1.0 / (b / X + (1.0 / N0 - b / X) * np.exp(a * X * cycles))


def test_jumps_agree_with_the_closed_form():
    last = worn(FINE)[-1]
    print(f"depth {last.depth[0] / DEPTH - 1.0:.1e}, preload {(N0 - K * last.depth[0]) / PRELOAD - 1.0:.1e}")
    assert last.cycles == CYCLES
    assert logistic(CYCLES) == pytest.approx(PRELOAD, rel=1e-9)
    assert N0 - K * last.depth[0] == pytest.approx(PRELOAD, rel=1e-6)
    assert last.depth[0] == pytest.approx(DEPTH, rel=1e-6)


def test_wear_by_the_contact_law_agrees_with_the_formula():
    control = JumpControl(CYCLES, most=4e-7, tolerance=1e-2)
    of_law, of_formula = worn(control, by_law), worn(control)
    assert of_law[-1].depth[0] == pytest.approx(of_formula[-1].depth[0], rel=20.0 / SAMPLES**2)


def test_the_error_falls_with_the_square_of_the_jump():
    errors = []
    for n in (20, 40, 80):
        state = WornState(0.0, np.zeros(1), np.zeros(1), by_formula(np.zeros(1)), CYCLES / n)
        for _ in range(n):
            state = replace(wear_on(by_formula, JumpControl(CYCLES, 2e-6, 0.04), state), jump=CYCLES / n)
        errors.append(abs(state.depth[0] - (N0 - logistic(CYCLES)) / K) / DEPTH)
    ratios = np.array(errors[:-1]) / errors[1:]
    print(f"orders {np.log2(ratios)}")
    assert ratios == pytest.approx(4.0, rel=0.1), errors


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3])
def test_the_tolerance_bounds_the_error(tolerance):
    states = worn(JumpControl(CYCLES, most=1e-5, tolerance=tolerance))
    exact = np.array([(N0 - logistic(state.cycles)) / K for state in states])
    computed = np.array([state.depth[0] for state in states])
    print(f"tolerance {tolerance:g}: {abs(computed - exact).max() / computed[-1]:.2g} in {len(states) - 1} jumps")
    assert abs(computed - exact).max() < tolerance * computed[-1]
    assert all(state.error <= tolerance * max(state.depth[0], 1e-5) for state in states)
    assert len(states) < 4.0 / np.sqrt(tolerance) + 10


def test_a_joint_that_loses_its_preload_wears_to_its_end():
    """The preload falls to zero exponentially; a midpoint beyond zero, where nothing slides, is no equilibrium."""
    per_cycle = 0.1

    def evaluate(depth):
        return Slid(per_cycle / PER_ENERGY * np.maximum(1.0 - depth, 0.0))

    control = JumpControl(1e6, most=0.05, tolerance=1e-2)
    states = worn(control, evaluate)
    for state in states:
        assert abs(1.0 - state.depth[0] - np.exp(-per_cycle * state.cycles)) < 1e-2
    assert states[-1].cycles == 1e6 and len(states) < 60
    assert abs(1.0 - states[-1].depth[0]) < 1e-5


def test_jumps_are_limited_to_the_requested_depth():
    depth = np.array([state.depth[0] for state in worn(JumpControl(CYCLES, most=3e-7, tolerance=0.5))])
    assert np.diff(depth).max() < 1.1 * 3e-7


def test_volume_is_that_of_the_energy():
    for state in worn(JumpControl(CYCLES, most=1e-6, tolerance=1e-2)):
        assert state.depth == pytest.approx(PER_ENERGY * state.energy, rel=1e-14)


def test_a_pair_that_does_not_slide_does_not_wear():
    (only,) = worn(FINE, lambda depth: Slid(np.zeros(1)))
    assert only.cycles == 0.0 and only.depth[0] == 0.0


def test_too_many_jumps_return_the_completed_jumps():
    control, states = JumpControl(CYCLES, most=1e-8, tolerance=1e-2, most_jumps=5), []
    first = WornState(0.0, np.zeros(1), np.zeros(1), by_formula(np.zeros(1)))
    with pytest.raises(ConvergenceError, match="5 jumps have led to"):
        for state in follow_wear(by_formula, control, first):
            states.append(state)
    assert len(states) == 5
