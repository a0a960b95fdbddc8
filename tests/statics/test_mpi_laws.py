"""Rough surfaces and Iwan joints at rest, and vibration about rest; on one rank and on several."""

import numpy as np
import pytest
from rest_scene import GUIDED, HEIGHT, LENGTH, WIDTH, at_one_frequency, eccentric, folder_with_bar, force, scene_of

import microslip
from microslip.messages.errors import CaseError, ConvergenceError
from microslip.restart.structure_arrays import pairs_of, to_arrays

ELASTIC = 'friction = 0.3\ntangential_stiffness = 1.0e12\nnormal_stiffness = 2.0e12\npreload = "static"\n'
HEIGHT_OF_ROUGHNESS, PRESSURE, AREA = 2e-6, 1e6, LENGTH * WIDTH
ROUGH = f'law = "rough"\nfriction = 0.3\npreload = {PRESSURE}\nroughness_height = {HEIGHT_OF_ROUGHNESS}\n'
POWER = ROUGH + f"exponent = 2.0\nroughness_pressure = {PRESSURE}\n"
STATIC_POWER = POWER.replace(f"preload = {PRESSURE}", 'preload = "static"')
IWAN = 'law = "iwan"\nslip_force = 400.0\ntangential_stiffness = 1e12\nnormal_stiffness = 2e12\nchi = -0.5\nbeta = 0.3\n'


folder = pytest.fixture(scope="module")(folder_with_bar)


def forces_beyond_preload(pairs):
    """Return the forces of the joint at rest beyond the stated preload, (n_pairs, 3) [N] in model axes."""
    N = pairs.N0 - PRESSURE * pairs.area
    return np.einsum("pji,pj->pi", pairs.frame, np.column_stack([pairs.T0, -N]))


@pytest.mark.parametrize("law, exponent", [(ROUGH, np.inf), (POWER, 2.0)])
def test_rough_surfaces_balance_the_load_and_stiffen_with_pressure(comm, folder, law, exponent):
    statics = eccentric(400.0) + force(60.0, 20.0, -300.0)
    with microslip.build(scene_of(comm, folder, statics, (ELASTIC, law)), comm) as structure:
        pairs = structure.pairs
    forces = forces_beyond_preload(pairs)
    assert forces.sum(axis=0) == pytest.approx([60.0, 20.0, -700.0], rel=1e-9)
    moment = 300.0 * 0.5 * LENGTH + 400.0 * 0.9 * LENGTH  # about y at the height of the joint, without a moment of friction
    assert -(forces[:, 2] @ pairs.position[:, 0]) == pytest.approx(moment + 60.0 * HEIGHT, rel=1e-6)
    ratio = pairs.N0 / (PRESSURE * pairs.area)
    at_first = (1.0 if np.isinf(exponent) else exponent) * PRESSURE / HEIGHT_OF_ROUGHNESS * pairs.area
    assert (
        pairs.k_n == pytest.approx(at_first * ratio ** (1.0 - 1.0 / exponent), rel=1e-12)
        and ratio.max() > 3.0 > 1.5 > ratio.min()
    )
    assert pairs.k_t / pairs.k_n == pytest.approx(np.full(pairs.n_pairs, 1.4 / 1.7), rel=1e-12)
    assert not pairs.open_at_rest.any() and np.hypot(*pairs.T0.T).max() > 0.0


def approach(N, area):
    """Return the approach of surfaces without initial pressure under the normal force N."""
    return HEIGHT_OF_ROUGHNESS * (N / (PRESSURE * area)) ** 0.5


@pytest.mark.parametrize("size", [0.5, 700.0, 50_000.0])
def test_the_approach_of_a_block_on_rough_ground_follows_the_power_law(comm, folder, size):
    """The pressure is 1 kPa to 100 MPa; the law is stated at 1 MPa."""
    with microslip.build(
        scene_of(comm, folder, force(0.1 * size, 0.05 * size, -size), (ELASTIC, STATIC_POWER)), comm
    ) as structure:
        pairs, system = structure.pairs, structure.linearised.system
        first, last = system.K.getOwnershipRange()
        du = comm.allreduce(system.R[:, first:last] @ system.rest_owned).reshape(-1, 3)
    forces = np.einsum("pji,pj->pi", pairs.frame, np.column_stack([pairs.T0, -pairs.N0]))
    assert forces.sum(axis=0) == pytest.approx([0.1 * size, 0.05 * size, -size], rel=1e-8) and not pairs.open_at_rest.any()
    assert du[:, 2] == pytest.approx(-approach(pairs.N0, pairs.area), rel=1e-8)
    assert pairs.k_n == pytest.approx(2.0 * pairs.N0 / approach(pairs.N0, pairs.area), rel=1e-9)
    assert pairs.k_t / pairs.k_n == pytest.approx(np.full(pairs.n_pairs, 1.4 / 1.7), rel=1e-12)


@pytest.mark.ranks(1)
@pytest.mark.slow
def test_rough_surfaces_that_open_at_rest_vibrate_about_their_gaps(comm, folder):
    """Pairs open under a load without preload, or against a stated preload."""
    for statics, law in ((eccentric(1000.0), STATIC_POWER), (eccentric(-200.0), POWER)):
        with microslip.build(scene_of(comm, folder, statics, (ELASTIC, law), name="gaps"), comm) as structure:
            pairs, restored = structure.pairs, pairs_of(*to_arrays(structure))
            response = microslip.respond(structure, levels=[20.0], points=3, span=[0.98, 1.02], error_bars=False)
        assert 0 < pairs.open_at_rest.sum() < pairs.n_pairs and not pairs.law.stiffness[pairs.open_at_rest].any()
        assert np.all(pairs.N0[pairs.open_at_rest] <= 0.0) and not pairs.T0[pairs.open_at_rest].any()
        N = np.maximum(pairs.N0, 0.0) - (PRESSURE * pairs.area if law is POWER else 0.0)
        load = 1000.0 if law is STATIC_POWER else -200.0
        assert N.sum() == pytest.approx(load, rel=1e-8)
        assert N @ pairs.position[:, 0] == pytest.approx(
            0.9 * LENGTH * load, rel=0.05
        )  # friction on the bottom adds a small moment
        assert np.array_equal(restored.law.lift, pairs.law.lift) and np.array_equal(restored.law.stiffness, pairs.law.stiffness)
        assert response.branches[0].failure is None and max(point.energy.sum() for point in response.branches[0].points) > 0.0


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_vibration_of_rough_surfaces_about_rest_equals_that_under_a_mean_load(comm, folder):
    """Without friction the constant load in the preloads and as harmonic 0 is the same nonlinear problem."""
    statics = "stress_stiffening = false\n" + eccentric(60.0)
    common = (
        ("ratio = 0.01", "rayleigh = [100.0, 0.0]"),
        ("modes = 8", "modes = 123"),
        ("samples = 64", "samples = 64\ntolerance = 1e-11"),
        ("points = 10", "points = 10\nat = [2500.0]"),
        ("mode = 1\nspan = [0.9, 1.1]", "frequencies = [2400.0, 2600.0]"),
        *GUIDED,
    )
    law = (ELASTIC.replace("0.3", "0.0"), ROUGH.replace("0.3", "0.0").replace(f"{PRESSURE}", "1e5"))
    about_rest, _, pairs = at_one_frequency(comm, scene_of(comm, folder, statics, *common, law, name="rest"))
    loads = "".join(
        f'[[loads]]\ngroup = "{group}"\ndirection = [0.0, 0.0, {size}]\nharmonic = 0\n'
        for group, size in (("bar_end", -9.6), ("bar_top", -2.4))
    )
    mean = ("axis = [0.0, 0.0, 1.0]\n", ""), ("[[outputs]]", loads + "[[outputs]]")
    as_mean, _, _ = at_one_frequency(comm, scene_of(comm, folder, None, *common, law, *mean, name="mean"))
    assert np.ptp(pairs.N0 / pairs.area) > 0.5e5 and np.abs(pairs.T0).max() < 1e-12
    assert about_rest == pytest.approx(as_mean, abs=1e-6 * np.abs(as_mean).max())


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_an_iwan_joint_bears_tension(comm, folder):
    """The joint bears tension and slips in part; the vibration starts from the positions of its sliders."""
    with microslip.build(scene_of(comm, folder, force(150.0, 50.0, 300.0), (ELASTIC, IWAN)), comm) as structure:
        pairs = structure.pairs
        assert np.einsum("pji,pj->i", pairs.frame[:, :2], pairs.T0)[:2] == pytest.approx([150.0, 50.0], rel=1e-9)
        friction = pairs.law.bundle.held_at_rest
        assert (
            friction == pytest.approx(np.hypot(*pairs.T0.T), rel=1e-9)
            and np.isnan(pairs.N0).all()
            and not pairs.open_at_rest.any()
        )
        restored = pairs_of(*to_arrays(structure))
        assert np.array_equal(restored.law.w0, pairs.law.w0) and pairs.law.w0.any()
        response = microslip.respond(structure, levels=[20.0], points=3, span=[0.99, 1.01], samples=32, error_bars=False)
        assert response.branches[0].failure is None and max(point.energy.sum() for point in response.branches[0].points) > 0.0


REFUSED = {
    "open": (
        eccentric(-200.0),
        ROUGH.replace(f"{HEIGHT_OF_ROUGHNESS}", "2e-9"),
        CaseError,
        r"[1-9]\d* of 15 pairs carry no force of a joint with law = \"rough\" at rest",
    ),
    "torn off": (force(0.0, 0.0, 600.0), POWER, ConvergenceError, "no equilibrium beyond .* body 'bar' moves along"),
    "torn off Iwan": (force(900.0, 0.0, 0.0), IWAN, ConvergenceError, "no equilibrium beyond"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_loads_that_such_joints_cannot_bear_are_refused(comm, folder, name):
    statics, law, error, message = REFUSED[name]
    with pytest.raises(error, match=message):
        microslip.build(scene_of(comm, folder, statics, (ELASTIC, law), name="refused"), comm)
