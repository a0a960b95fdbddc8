"""The joint at rest under constant loads, and vibration about rest; on one rank and on several."""

import csv

import numpy as np
import pytest
from rest_scene import GUIDED, LENGTH, WIDTH, at_one_frequency, eccentric, folder_with_bar, force, scene_of

import microslip
from microslip.continuation import ways_out
from microslip.library.complete import read_completed
from microslip.messages.errors import CaseError, ConvergenceError
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root

folder = pytest.fixture(scope="module")(folder_with_bar)


def test_normal_and_friction_forces_balance_the_load(comm, folder):
    with microslip.build(scene_of(comm, folder, force(150.0, 50.0, -1000.0)), comm) as structure:
        pairs = structure.pairs
        forces = np.column_stack([pairs.T0, -pairs.N0])  # balance the load on the bar
        total = np.einsum("pji,pj->i", pairs.frame, forces)
    assert not pairs.open_at_rest.any() and pairs.N0.min() > 0.0
    assert total == pytest.approx([150.0, 50.0, -1000.0], rel=1e-9)
    assert np.all(np.hypot(*pairs.T0.T) <= 0.3 * pairs.N0 * (1.0 + 1e-9))


@pytest.mark.ranks(1)
@pytest.mark.parametrize("pressure", [1e9, 3e9])
def test_an_unrealistic_pressure_is_a_warning(comm, folder, pressure):
    """A hundredth of the modulus of steel, 2.1e11 Pa, is between the two pressures."""
    statics = "stress_stiffening = false\n" + force(0.0, 0.0, -pressure * LENGTH * WIDTH)
    log = RunLog(comm, screen=False)
    microslip.build(scene_of(comm, folder, statics, *GUIDED), comm, log).close()
    (line,) = (note for note in log.notes if "pressure up to" in note)
    assert ("WARNING: " in line and "% of Young's modulus; check loads, units and overlap" in line) == (pressure > 2e9)


def test_an_eccentric_load_opens_the_far_side(comm, folder):
    with microslip.build(scene_of(comm, folder, eccentric(1000.0)), comm) as structure:
        pairs = structure.pairs
        x = pairs.position[:, 0]
        N = np.maximum(pairs.N0, 0.0)
        assert pairs.open_at_rest[x == 0.0].all() and not pairs.open_at_rest[x == LENGTH].any()
        assert N.sum() == pytest.approx(1000.0, rel=1e-9)
        assert (N @ x) / N.sum() == pytest.approx(0.9 * LENGTH, abs=0.02 * LENGTH)  # friction on the bottom adds a small moment
        assert not pairs.T0[pairs.open_at_rest].any()
        # the linearised structure has no springs at open pairs
        assert not pairs.law.stiffness[pairs.open_at_rest].any()


def test_without_friction_the_steps_do_not_matter(comm, folder):
    values = []
    for steps in (1, 7):
        with microslip.build(scene_of(comm, folder, f"steps = {steps}\n" + eccentric(800.0), *GUIDED), comm) as structure:
            values.append(structure.pairs.N0)
    assert values[0] == pytest.approx(values[1], abs=1e-9 * np.abs(values[0]).max())


NO_FRICTION = "no friction would hold it there: turn the loads or the axis round"
UNBALANCED = {
    "slides away": (
        force(400.0, 0.0, -1000.0),
        r"body 'bar' moves along \(1, 0, 0\): it slides where friction cannot hold it, and a friction of 0.4\d? would \(stated: 0.3\)",
    ),
    "slides askew": (
        force(0.0, 0.0, -1000.0) + force(-300.0, -400.0, 0.0, "bar_bottom"),
        r"body 'bar' moves along \(-0\.6, -0\.8, 0\): .* a friction of 0.5\d? would",
    ),
    "flies off": (force(0.0, 0.0, 10.0), rf"body 'bar' moves along \(0, 0, 1\): {NO_FRICTION}"),
    "tips over": (
        force(0.0, 0.0, -100.0) + force(0.0, 0.0, 200.0, "bar_end") + force(0.0, 0.0, -50.0, "bar_start"),
        rf"body 'bar' .*turns about \(0, -1, 0\) through \(0\.025, 0\.005, 0\.01\) m: {NO_FRICTION}",
    ),
}


@pytest.mark.parametrize("name", UNBALANCED)
def test_an_insufficiently_supported_bar_has_no_equilibrium(comm, folder, name):
    """The message states the fraction of the load, the body and the direction of its motion."""
    load, message = UNBALANCED[name]
    with pytest.raises(
        ConvergenceError, match=rf"scene.toml: \[statics\]: no equilibrium beyond .* pairs of 'joint' are open: {message}"
    ) as caught:
        microslip.build(scene_of(comm, folder, load), comm)
    assert caught.value.exit_status == 3 and "'ground'" not in str(caught.value)


def test_heating_a_bar_does_not_change_its_normal_force(comm, folder):
    temperature = '[[statics.temperatures]]\ngroup = "bar"\ntemperature = 100.0\n'
    with microslip.build(scene_of(comm, folder, force(0.0, 0.0, -100.0) + temperature, *GUIDED), comm) as structure:
        assert np.maximum(structure.pairs.N0, 0.0).sum() == pytest.approx(100.0, rel=1e-9)
        assert not structure.pairs.T0.any()


@pytest.mark.slow
@pytest.mark.ranks(1)
@pytest.mark.parametrize("first_point", ["usual", "held"])
def test_vibration_about_rest_equals_that_under_a_mean_load(comm, folder, first_point, monkeypatch):
    """Without slip, but with pairs that open and close, the load in the preloads and as harmonic 0 is the same problem.

    The first point may also come only from the mean slip held by weak springs, which are then released.
    """
    statics = "stress_stiffening = false\n" + eccentric(60.0)
    common = (
        ("ratio = 0.01", "rayleigh = [100.0, 0.0]"),  # modal damping would differ, because the modes differ
        ("friction = 0.3", "friction = 1e6"),
        ("modes = 8", "modes = 135"),
        ("samples = 64", "samples = 64\ntolerance = 1e-11"),
        ("points = 10", "points = 10\nat = [2500.0]"),
        ("mode = 1\nspan = [0.9, 1.1]", "frequencies = [2400.0, 2600.0]"),
    )
    about_rest, state, pairs = at_one_frequency(comm, scene_of(comm, folder, statics, *common, name="rest"))
    mean = (
        ("axis = [0.0, 0.0, 1.0]\n", ""),
        ('preload = "static"', "preload = 0.0"),
        (
            "[[outputs]]",
            '[[loads]]\ngroup = "bar_end"\ndirection = [0.0, 0.0, -9.6]\nharmonic = 0\n[[loads]]\ngroup = "bar_top"\ndirection = [0.0, 0.0, -2.4]\nharmonic = 0\n[[outputs]]',
        ),
    )
    if first_point == "held":
        ways = [way for way in ways_out.WAYS_OUT if way.where != "first" or way.attempt is ways_out.with_mean_slip_regularised]
        monkeypatch.setattr(ways_out, "WAYS_OUT", ways)
    as_mean, state_mean, _ = at_one_frequency(comm, scene_of(comm, folder, None, *common, *mean, name="mean"))
    assert pairs.open_at_rest.any() and (state == state_mean).all() and set(state) >= {0, 2}
    assert about_rest == pytest.approx(as_mean, abs=1e-6 * np.abs(as_mean).max())


def test_spin_and_stress_change_the_frequency(comm, folder):
    """The frequency with stress stiffening differs slightly from that without."""
    turning = "rotation_speed = 300.0\n" + force(0.0, 0.0, -5000.0)
    values = []
    for stiffens in ("true", "false"):
        with microslip.build(scene_of(comm, folder, f"stress_stiffening = {stiffens}\n" + turning), comm) as structure:
            values.append(structure.modes.frequency[0])
    assert values[0] != values[1] and values[0] == pytest.approx(values[1], rel=1e-2)


MISTAKES = {
    "nothing": ("steps = 3\n", (), r"\[statics\] loads nothing"),
    "pressure of 0": ('[[statics.pressures]]\ngroup = "bar_top"\npressure = 0.0\n', (), r"\[statics\] loads nothing"),
    "cut body": (
        '[[statics.bolts]]\ngroup = "bar"\nforce = 1.0\n',
        (),
        r"\[\[statics.bolts\]\] 1 group = 'bar': these are the elements of a body, and a bolt is cut by faces across its shank",
    ),
    "joined body": (
        force(0.0, 0.0, -1.0),
        (('"bar_bottom", "ground_top"', '"bar", "ground_top"'),),
        r"\[\[joints\]\] 1 .*group = 'bar': these are the elements of a body, and a joint has faces",
    ),
    "pressed body": (
        '[[statics.pressures]]\ngroup = "bar"\npressure = 1.0\n',
        (),
        r"\[\[statics.pressures\]\] 1 group = 'bar': these are the elements of a body, and a pressure acts on faces",
    ),
    "no axis": ("rotation_speed = 10.0\n", (("axis = [0.0, 0.0, 1.0]\n", ""),), "axis is missing"),
    "no expansion": (
        '[[statics.temperatures]]\ngroup = "bar"\ntemperature = 10.0\n',
        (("expansion = 1.2e-5\n", ""),),
        r"\[materials.steel\] expansion is missing",
    ),
    "no body": ('[[statics.temperatures]]\ngroup = "baar"\ntemperature = 10.0\n', (), 'no body has this group; nearest is "bar"'),
    "two temperatures": (
        2 * '[[statics.temperatures]]\ngroup = "bar"\ntemperature = 10.0\n',
        (),
        r'\[\[statics.temperatures\]\] group = "bar" is used 2 times; a body has one temperature',
    ),
    "no group": (force(0.0, 0.0, -1.0, "bar_tip"), (), r"\[\[statics.forces\]\] 1 group = 'bar_tip': there is no such group"),
    "no cut": (
        '[[statics.bolts]]\ngroup = "bar_tp"\nforce = 1.0\n',
        (),
        r"\[\[statics.bolts\]\] 1 group = 'bar_tp': there is no such group",
    ),
    "outer faces": (
        '[[statics.bolts]]\ngroup = "bar_top"\nforce = 1.0\n',
        (),
        "bolt 'bolt 1': group 'bar_top': 8 of 8 faces are not between two elements of the mesh",
    ),
    "bolt without force": (
        '[[statics.bolts]]\ngroup = "bar_top"\n',
        (),
        "exactly one of force, shortening is needed, found none",
    ),
    "bolt with both": (
        '[[statics.bolts]]\ngroup = "bar_top"\nforce = 1.0\nshortening = 1e-5\n',
        (),
        "exactly one of force, shortening is needed, found force and shortening",
    ),
    "negative bolt force": (
        '[[statics.bolts]]\ngroup = "bar_top"\nforce = -1.0\n',
        (),
        "force = -1.0: expected the clamping force in N to which the bolt is tightened, a number above 0",
    ),
    "one cut twice": (
        2 * '[[statics.bolts]]\ngroup = "bar_top"\nforce = 1.0\n',
        (),
        r'\[\[statics.bolts\]\] group = "bar_top" is used 2 times; each bolt needs its own',
    ),
    "no statics": (None, (), r"there is no table \[statics\]"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_bad_statics_are_refused_with_a_message(comm, folder, name):
    statics, changes, message = MISTAKES[name]
    with pytest.raises(CaseError, match=message):
        microslip.build(scene_of(comm, folder, statics, *changes, name=f"bad {name}"), comm)


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_time_integration_agrees_with_pairs_that_are_open_at_rest(comm, folder, program):
    changes = ("levels = [5.0]", "levels = [40.0]"), ("harmonics = 3", "harmonics = 7"), ("modes = 8", "modes = 12")
    scene = scene_of(comm, folder, eccentric(400.0), *changes, name="open")
    status, _, err = program("verify", scene.path, "--out", folder / "open", "--steps", "128", "--at", "1700")
    assert (status, err) == (0, "")

    def row():
        with open(folder / "open" / "verify.csv", newline="") as file:
            return next(csv.DictReader(file))

    computed = on_root(comm, row)
    assert float(computed["higher_harmonics"]) > 0.03  # pairs close and open
    assert float(computed["difference_with_phase"]) < 1e-3 and abs(float(computed["energy_closure"])) < 2e-3


def test_an_axis_without_rotation_is_noted(comm, folder):
    for statics in (force(0.0, 0.0, -1.0), "rotation_speed = 0.0\n" + force(0.0, 0.0, -1.0)):
        _, _, notes = read_completed(scene_of(comm, folder, statics), comm)
        assert [note[:37] for note in notes] == ["[model] axis: nothing turns about it;"]
    assert read_completed(scene_of(comm, folder, "rotation_speed = 10.0\n"), comm)[2] == ()


BALANCED = {
    "stretched": force(1000.0, 0.0, 0.0, "bar_end") + force(-1000.0, 0.0, 0.0, "bar_start"),
    "squeezed": force(-1000.0, 0.0, 0.0, "bar_end") + force(1000.0, 0.0, 0.0, "bar_start"),
    "pressed on both sides": force(0.0, 0.0, -1000.0) + force(0.0, 0.0, 1000.0, "bar_bottom"),
    "warm": '[[statics.temperatures]]\ngroup = "bar"\ntemperature = 100.0\n',
    "not loaded": force(0.0, 0.0, -1000.0, "ground_top"),
}


@pytest.mark.slow
@pytest.mark.parametrize("stiffening", ["", "stress_stiffening = false\n"])
@pytest.mark.parametrize("name", BALANCED)
def test_balanced_loads_without_contact_pressure_are_refused(comm, folder, name, stiffening):
    """Rounding errors in the joint are not a preload, with a singular or a regular stiffness at rest."""
    scene = scene_of(comm, folder, stiffening + BALANCED[name], name=f"balanced {name}")
    with pytest.raises(
        CaseError, match=r"balanced .*\.toml: \[statics\]: nothing presses on body 'bar' at rest: .* of 'joint' is "
    ) as caught:
        microslip.build(scene, comm)
    assert caught.value.exit_status == 2


def test_a_light_load_on_a_heated_body_is_a_preload(comm, folder):
    """The load is a twenty-millionth of all loads, well above rounding."""
    temperature = '[[statics.temperatures]]\ngroup = "bar"\ntemperature = 100.0\n'
    with microslip.build(scene_of(comm, folder, temperature + force(0.0, 0.0, -0.1)), comm) as structure:
        assert np.maximum(structure.pairs.N0, 0.0).sum() == pytest.approx(0.1, rel=1e-4)


def test_an_unstable_rest_is_refused(comm, folder):
    """Two opposite loads compress a bar beyond buckling."""
    statics = force(0.0, 0.0, -1e3) + force(-2e7, 0.0, 0.0, "bar_end") + force(2e7, 0.0, 0.0, "bar_start")
    with pytest.raises(CaseError, match="a stiffness matrix must not release energy; the stress at rest is part of it"):
        microslip.build(scene_of(comm, folder, statics), comm)
