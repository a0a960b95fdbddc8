"""Folds over the level of the loads, compared with closed-form solutions; every test runs on any number of ranks."""

import numpy as np
import pytest
from dense_model import amplitude, forced, reduced
from mpi4py import MPI
from oracles import scenes
from scipy.optimize import brentq, minimize_scalar

from microslip.continuation.follow import advance, follow_branch
from microslip.continuation.problems import LevelHomotopy
from microslip.continuation.steps import ArcLength
from microslip.continuation.task import BranchTask
from microslip.continuation.ways_out import Stuck, across_the_corner
from microslip.points.selection import AllPairs
from microslip.points.sweep import Sweep

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
K, C, STOP, GAP = 1.0, 0.05, 5.0, 1.0  # N/m, N s/m, N/m, m: a mass of 1 kg on a spring, a stop of stiffness STOP beyond the gap
OMEGA = 1.2  # rad/s, above the resonance without the stop, below the highest with it
N_SAMPLES = 1024


def mass():
    return scenes.make_system(
        "mass and stop",
        [[1.0]],
        [[K]],
        [[-1, -1, 0, -1, -1, -1]],
        mu=0.0,
        N0=-STOP * GAP,
        k_t=1.0,
        k_n=STOP,
        C=np.array([[C]]),
        loads=[{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}],
        output=[1.0],
        omega=(0.5, 2.0),
        levels={},
    )


def level_of(a):
    """Return the level [N] at which harmonic 1 has the amplitude ``a`` [m], with the mean that balances the stop."""

    def contact_angle(mean):  # half the angle of a cycle in which the stop is in contact
        return np.arccos(np.clip((GAP - mean) / a, -1.0, 1.0))

    def sum_of_means(mean):
        return K * mean + STOP / np.pi * (a * np.sin(contact_angle(mean)) + (mean - GAP) * contact_angle(mean))

    angle = contact_angle(brentq(sum_of_means, -a, a, xtol=1e-15))
    stiffness = K + STOP / np.pi * (angle - np.sin(angle) * np.cos(angle))
    return a * np.hypot(stiffness - OMEGA**2, C * OMEGA)


def task_over_level(highest, ds=0.02):
    model, law = reduced(mass(), COMM, 1)
    problem = LevelHomotopy(forced(model, law, N_SAMPLES, 1.0).equation, OMEGA)
    return BranchTask(problem, AllPairs(), Sweep(0.05, highest), ArcLength(ds=ds, ds_min=1e-6, ds_max=2.5 * ds), 1e-10)


def over_level(highest):
    return follow_branch(task_over_level(highest), 400)


def test_a_branch_over_the_level_has_the_two_folds_of_a_stiffening_stop():
    curve = over_level(1.0)
    assert curve.failure is None
    levels = np.array([point.parameters[0] for point in curve.points])
    sizes = np.array([amplitude(point) for point in curve.points])
    assert levels[[0, -1]] == pytest.approx([0.05, 1.0]) and np.all(np.diff(sizes) > 0.0)
    exact = np.array([level_of(a) for a in sizes])
    assert levels == pytest.approx(exact, rel=20.0 / N_SAMPLES**2, abs=20.0 / N_SAMPLES**2)
    top, bottom = np.flatnonzero(np.diff(np.sign(np.diff(levels)))) + 1  # two turning points, no third
    upper = minimize_scalar(lambda a: -level_of(a), bounds=(sizes[top - 1], sizes[top + 1]), method="bounded")
    lower = minimize_scalar(lambda a: level_of(a), bounds=(sizes[bottom - 1], sizes[bottom + 1]), method="bounded")
    assert levels[top] == pytest.approx(-upper.fun, rel=1e-2) and levels[bottom] == pytest.approx(lower.fun, rel=2e-2)
    assert -upper.fun > 2.0 * lower.fun  # three solutions over most of the range


@pytest.mark.parametrize("usual", [0.8, pytest.param(0.4, marks=pytest.mark.ranks(1))])
def test_usual_steps_across_a_corner_lead_to_solutions_ahead(usual):
    """From every point of a curve with two folds: a mass without friction has the solutions of the closed form, and no others."""
    task = task_over_level(1.0, 0.1)
    workspace, steps = task.workspace(), ArcLength(ds=usual, ds_min=1e-6, ds_max=2.0 * usual)
    state, turns, sizes = task.start(workspace), [], []
    while not state.is_done:
        state = advance(task, state).state
        if state.before is None or state.is_done:
            continue
        solver, before, now = state.solver, state.before, state.now
        for on in across_the_corner(Stuck("ahead", solver, steps, earlier=state.earlier, before=before, now=now)):
            there = on.solved[0].iterate
            turns.append(solver.turn(before.iterate, now.iterate, there, now.size))
            sizes.append((solver.norm(solver.vibration(there.U)), there.parameter))
    workspace.destroy()
    assert len(turns) > 50 and max(turns) <= 0.25 * np.pi
    assert [level for _, level in sizes] == pytest.approx([level_of(a) for a, _ in sizes], rel=1e-3, abs=1e-3)
