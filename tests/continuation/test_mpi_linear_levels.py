"""Levels at which all pairs stick: their points are scaled, and equal those of the solver; on any number of ranks."""

from types import SimpleNamespace

import numpy as np
import pytest
from dense_model import forced, reduced
from mpi4py import MPI
from oracles import scenes

from microslip.continuation import linear_levels
from microslip.continuation.follow import follow_branch
from microslip.continuation.levels import levels_of_slip, linear_curve
from microslip.continuation.linear_levels import is_linear
from microslip.continuation.steps import ArcLength
from microslip.continuation.task import BranchTask
from microslip.fourier.coefficients import synthesis_matrix
from microslip.points.selection import AllPairs, NonStickingPairs
from microslip.points.sweep import Sweep
from microslip.receptance.motions import linear_motion

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
FREQUENCIES = {"chain": (450.0, 640.0), "spatial": (1.0, 1.6)}


def prepared(name, *, at=(), down=False, **changes):
    """Return the model of a scene, its parameters, the sweep and the linear curve."""
    system = {**scenes.SCENES[name](), **changes}
    model, parameters = reduced(system, COMM, 3)
    low, high = FREQUENCIES[name]
    sweep = Sweep(*((high, low) if down else (low, high)), at)
    return model, parameters, sweep, linear_curve(model, sweep, parameters)


def slip_level(model, parameters, curve):
    """Return the level at which the first pair leaves sticking: k_t |du_t| = mu (N0 - k_n du_z) at one of 256 samples."""
    synthesis = synthesis_matrix(model.harmonics, 256)
    motions = np.array([linear_motion(model, 1.0, omega, slice(None)) for omega in curve.omega])
    x, y, z = (motions.reshape(len(motions), -1, 3, model.N_H) @ synthesis.T).transpose(2, 0, 1, 3)
    mu, N0, k_t, k_n = (values[:, None] for values in (parameters.mu, parameters.N0, parameters.k_t, parameters.k_n))
    assert not parameters.separate.any()
    return float(1.0 / np.max((k_t * np.hypot(x, y) + mu * k_n * z) / (mu * N0)))


def equation_of(model, parameters):
    return forced(model, parameters, 128, 1.0).equation


def follow(model, parameters, sweep, curve, level, is_linear, selection=None):
    ds = curve.s[-1] / 40
    steps, problem = ArcLength(ds=ds, ds_min=ds / 1024, ds_max=2 * ds), forced(model, parameters, 128, level)
    return follow_branch(BranchTask(problem, selection or AllPairs(), sweep, steps, 1e-12, is_linear=is_linear), 400)


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("name", ["chain", "spatial"])
def test_levels_at_which_pairs_begin_to_slip_follow_from_the_linear_peak(name):
    model, parameters, _, curve = prepared(name)
    levels = levels_of_slip(SimpleNamespace(model=model, law=parameters, curve=curve))
    assert levels[0] == pytest.approx(
        slip_level(model, parameters, curve), rel=0.1
    )  # the amplitudes of all directions are combined
    assert len(levels) == model.n_pairs and (np.diff(levels) >= 0.0).all()


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("name", ["chain", "spatial"])
def test_a_level_is_linear_exactly_up_to_the_first_slip(name):
    model, parameters, _, curve = prepared(name)
    first = slip_level(model, parameters, curve)
    assert 0.0 < curve.sticks_up_to.min() <= first * (1 + 1e-6)
    for factor, expected in ((1e-6, True), (0.5, True), (0.999, True), (1.001, False), (3.0, False), (1e6, False)):
        assert is_linear(equation_of(model, parameters), factor * first, curve) == expected


@pytest.mark.slow
@pytest.mark.parametrize("down", [False, pytest.param(True, marks=pytest.mark.ranks(1))])
@pytest.mark.parametrize("name, selection", [("chain", AllPairs()), ("spatial", AllPairs()), ("chain", NonStickingPairs())])
def test_a_scaled_level_equals_the_solved_level(name, selection, down):
    low, high = FREQUENCIES[name]
    at = (low + 0.3 * (high - low), high)
    model, parameters, sweep, curve = prepared(name, at=at, down=down)
    level = 0.9 * slip_level(model, parameters, curve)
    scaled_branch = follow(model, parameters, sweep, curve, level, True, selection)
    solved_branch = follow(model, parameters, sweep, curve, level, False, selection)
    assert scaled_branch.failure is None and scaled_branch.is_linear and not solved_branch.is_linear
    assert [point.omega for point in scaled_branch.points] == pytest.approx(
        [point.omega for point in solved_branch.points], rel=1e-12
    )
    assert sorted(point.omega for point in scaled_branch.points if point.requested) == pytest.approx(at, rel=1e-14)
    for scaled, solved in zip(scaled_branch.points, solved_branch.points, strict=True):
        assert (scaled.newton, scaled.krylov, scaled.friction) == (0, 0, 0.0)
        assert not scaled.state.any() and scaled.unknowns == solved.unknowns
        size = np.abs(solved.response).max()
        assert scaled.response == pytest.approx(solved.response, rel=1e-10, abs=1e-13 * size)
        assert [scaled.damping, scaled.input] == pytest.approx([solved.damping, solved.input], rel=1e-10)
        if COMM.rank == 0:
            assert np.abs(scaled.U - solved.U).max() <= 1e-10 * np.abs(solved.U).max()
            assert not scaled.p.any()
    assert not model.receptance_of(1).static.G_static.known.any()


@pytest.mark.ranks(1, 2, 3)
def test_a_scaled_level_is_proportional_to_its_load():
    model, parameters, sweep, curve = prepared("chain")
    first = slip_level(model, parameters, curve)
    small, large = (follow(model, parameters, sweep, curve, factor * first, True) for factor in (1e-9, 0.9))
    assert len(small.points) == len(large.points)
    for a, b in zip(small.points, large.points, strict=True):
        assert b.omega == pytest.approx(a.omega, rel=1e-12)
        assert b.response / 0.9 == pytest.approx(a.response / 1e-9, rel=1e-8, abs=1e-12 * np.abs(b.response).max())


@pytest.mark.parametrize("changes", [{"mu": 0.0}, {"N0": 0.0}, {"N0": -1.0}])
def test_pairs_without_friction_preload_or_contact_at_rest_exclude_linear_levels(changes):
    system = scenes.chain()
    altered = {
        key: np.where(np.arange(len(system[key])) == len(system[key]) - 1, value, system[key]) for key, value in changes.items()
    }
    model, parameters, _, curve = prepared("chain", **altered)
    for level in (1e-12, 1e-3, 1.0):
        assert not is_linear(equation_of(model, parameters), level, curve)


def test_without_contact_parameters_no_level_is_linear():
    model, parameters, sweep, _ = prepared("chain")
    assert not is_linear(equation_of(model, parameters), 1e-12, linear_curve(model, sweep))


def test_a_constant_motion_is_solved():
    system = scenes.spatial_mass()
    system["loads"] = [{**load, "harmonic": 0, "phase": 0.0} for load in system["loads"]]
    model, parameters = reduced(system, COMM, 0)
    curve = linear_curve(model, Sweep(*FREQUENCIES["spatial"]), parameters)
    assert curve.sticks_up_to.max() == 0.0
    assert not is_linear(equation_of(model, parameters), 1e-9, curve)


@pytest.mark.slow
def test_a_level_wrongly_declared_linear_is_solved():
    """The branch of a level that slips is declared linear: it is that of the solver."""
    model, parameters, sweep, curve = prepared("chain")
    level = 1.5 * slip_level(model, parameters, curve)
    scaled_branch, solved_branch = (follow(model, parameters, sweep, curve, level, is_linear) for is_linear in (True, False))
    assert scaled_branch.failure is None and not scaled_branch.is_linear
    assert any(point.state.any() for point in scaled_branch.points)
    assert [point.omega for point in scaled_branch.points] == pytest.approx(
        [point.omega for point in solved_branch.points], rel=1e-6
    )
    for scaled, solved in zip(scaled_branch.points, solved_branch.points, strict=True):
        assert scaled.response == pytest.approx(solved.response, rel=1e-6, abs=1e-8 * np.abs(solved.response).max())


def test_a_level_that_slips_costs_one_evaluation(monkeypatch):
    model, parameters, _, curve = prepared("chain")
    level, calls = 10.0 * slip_level(model, parameters, curve), []
    monkeypatch.setattr(
        linear_levels, "sticks", lambda equation, at, real=linear_levels.sticks: calls.append(at) or real(equation, at)
    )
    assert not is_linear(equation_of(model, parameters), level, curve)
    assert len(calls) == 1
