"""Forces and moments at rest across joints and on bodies against statics; on one rank and on several."""

from dataclasses import replace

import numpy as np
import pytest
from blocks import box, stacked
from msh import write_msh
from rest_scene import HEIGHT, LENGTH, WIDTH, force, scene_of

import microslip
from microslip.messages.errors import ConvergenceError
from microslip.parallel.agree import on_root
from microslip.results.read import read_results
from microslip.statics.balance import BodiesAtRest, check_balance, in_words
from microslip.statics.equilibrium import Rest
from microslip.statics.loaded import Loaded

DENSITY, SPEED, DISTANCE = 7800.0, 400.0, 2e-4
GROUND = (LENGTH, WIDTH, 0.005)
TOP = np.array([0.5 * LENGTH, 0.5 * WIDTH, HEIGHT])


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    """Return the folder of a bar on ground, and of a bar with another mesh slightly above the ground."""
    path = comm.bcast(tmp_path_factory.mktemp("balance"))

    def write():
        bodies = stacked("hex8", (LENGTH, WIDTH, HEIGHT), (4, 2, 1), GROUND[2])
        write_msh(str(path / "bar.msh"), bodies)
        names = {"z0": "bar_bottom", "z1": "bar_top", "x0": "bar_start", "x1": "bar_end"}
        bar = box("hex8", (LENGTH, WIDTH, HEIGHT), (4, 2, 1), (0.0, 0.0, DISTANCE), names)
        ground = box("hex8", GROUND, (3, 3, 1), (0.0, 0.0, -GROUND[2]), {"z0": "ground_base", "z1": "ground_top"})
        write_msh(str(path / "above.msh"), {"bar": bar, "ground": ground})

    on_root(comm, write)
    return path


def balance_of(comm, scene):
    with microslip.build(scene, comm) as structure:
        return structure.balance


def closes(balance, within=1e-9):
    """Return whether forces and moments on all bodies balance."""
    imbalance, size = balance.bodies.left, balance.bodies.size
    moment = np.linalg.norm(imbalance[:, 3:], axis=1) / balance.bodies.reach
    return max((np.linalg.norm(imbalance[:, :3], axis=1) / size).max(), (moment / size).max()) < within


LOAD = np.array([150.0, 50.0, -1000.0])


@pytest.mark.parametrize("large", ["", "large_displacements = true\n"])
def test_joint_and_support_balance_the_load(comm, folder, large):
    balance = balance_of(comm, scene_of(comm, folder, large + force(*LOAD)))
    joints, bodies = balance.joints, balance.bodies
    assert joints.names == ("joint",) and bodies.names == ("body 'bar'", "body 'ground'")
    assert joints.about[0] == pytest.approx([0.5 * LENGTH, 0.5 * WIDTH, 0.0])
    assert joints.on_first[0, :3] == pytest.approx(-LOAD, rel=1e-9) and joints.on_second[0, :3] == pytest.approx(LOAD, rel=1e-9)
    moment = np.cross(TOP - joints.about[0], LOAD)
    assert joints.on_second[0, 3:] == pytest.approx(moment, abs=(1e-9 if not large else 1e-3) * 1000.0 * LENGTH)
    assert bodies.loads[:, :3] == pytest.approx(np.stack([LOAD, np.zeros(3)]), abs=1e-9)
    assert bodies.supports[:, :3] == pytest.approx(np.stack([np.zeros(3), -LOAD]), abs=1e-6)
    assert closes(balance)


def test_centrifugal_forces_are_those_of_mass_and_centroid(comm, folder):
    """The loads are m Omega^2 r of bar and ground, including the forces on supported nodes."""
    turning = f"rotation_speed = {SPEED}\n" + force(0.0, 0.0, -5000.0)
    balance = balance_of(comm, scene_of(comm, folder, turning))
    centroid = np.array([0.5 * LENGTH, 0.5 * WIDTH, 0.0])
    for i, thickness in enumerate((HEIGHT, GROUND[2])):
        expected = DENSITY * LENGTH * WIDTH * thickness * SPEED**2 * centroid
        assert balance.bodies.loads[i, :2] == pytest.approx(expected[:2], rel=1e-9)
    assert closes(balance)


def test_moments_on_distant_sides_differ_by_friction_times_the_distance(comm, folder):
    changes = (
        ('mesh = "bar.msh"', 'mesh = "above.msh"'),
        ('preload = "static"', f'preload = "static"\ntolerance = {2.0 * DISTANCE}\npairing = "points"'),
    )
    balance = balance_of(comm, scene_of(comm, folder, force(*LOAD), *changes, name="above"))
    joints = balance.joints
    difference = joints.on_first[0] + joints.on_second[0]
    assert difference[:3] == pytest.approx(np.zeros(3), abs=1e-9 * 1000.0)
    expected = np.cross([0.0, 0.0, DISTANCE], -LOAD)  # the forces on the bar act at this distance above the ground
    assert difference[3:] == pytest.approx(expected, abs=1e-6 * 1000.0 * DISTANCE)
    assert closes(balance)  # each body is in balance
    (line,) = (line for line in in_words(balance) if line.startswith("  joint: transmits"))
    assert "about (0.025, 0.005, " in line and "0.0e+00 of the forces" not in line.split("differ by")[0]


SPRUNG = """
[[points]]
name = "knob"
position = [0.06, 0.0, 0.03]
group = "bar_end"
mass = 0.2
stiffness = [1.0e6, 2.0e6, 1.0e6]
rotational_stiffness = [1.0e3, 0.0, 0.0]
[[springs]]
groups = ["bar_start"]
direction = [1.0, 1.0, 0.0]
stiffness = 1.0e5
[[masses]]
group = "bar_start"
mass = 0.01
"""


@pytest.mark.parametrize("large", [False, True])
def test_points_springs_and_masses_are_in_the_balance(comm, folder, large):
    at_knob = "".join(f'[[statics.forces]]\npoint = "knob"\nforce = [{x}, 0.0, -300.0]\n' for x in (20.0, 30.0))
    statics = f"large_displacements = {str(large).lower()}\nrotation_speed = 100.0\n" + force(0.0, 0.0, -700.0) + at_knob
    scene = scene_of(comm, folder, statics, ("[[loads]]", SPRUNG + "[[loads]]"), name=f"sprung {large}")
    balance = balance_of(comm, scene)
    bar = balance.bodies
    mass = DENSITY * LENGTH * WIDTH * HEIGHT
    outward = mass * 0.5 * LENGTH + 0.2 * 0.06  # masses at x = 0 have no centrifugal force
    assert bar.loads[0, :3] == pytest.approx([50.0 + 1e4 * outward, bar.loads[0, 1], -1300.0], rel=1e-3 if large else 1e-9)
    assert np.abs(bar.supports[0, :3]).min() > 0.1
    assert closes(balance, 1e-4 if large else 1e-9)


def test_heated_bodies_and_displaced_supports_are_in_balance(comm, folder):
    statics = (
        '[[statics.temperatures]]\ngroup = "ground"\ntemperature = 40.0\n'
        '[[statics.displacements]]\ngroup = "ground_base"\ndisplacement = [0.0, 1e-5, 0.0]\n'
    )
    balance = balance_of(comm, scene_of(comm, folder, force(*LOAD) + statics))
    assert balance.joints.on_second[0, :3] == pytest.approx(LOAD, rel=1e-9) and closes(balance)


def test_results_and_log_contain_the_balance(comm, folder, program):
    scene = scene_of(comm, folder, force(*LOAD), ("modes = 8", "modes = 4\nerror_bars = false"), name="run")
    status, output, error = program("run", scene.path, "--out", folder / "out", "--set", "response.sensitivities=true")
    assert status == 0 and "  change of the state of rest in the sensitivities: " in output, error
    assert "  body 'ground': joints (150, 50, -1000) N, supports (-150, -50, 1000) N; imbalance " in output

    def check():
        results = read_results(str(folder / "out" / "results.h5")).at_rest
        assert results["joints"].names == ("joint",)
        assert results["joints"].columns["on_first"][0, :3] == pytest.approx(-LOAD, rel=1e-9)
        assert sum(results["bodies"].columns[name][1] for name in ("loads", "joints", "supports")) == pytest.approx(0.0, abs=1e-9)

    on_root(comm, check)


def test_an_imbalance_is_an_error(comm, folder):
    with microslip.build(scene_of(comm, folder, force(*LOAD)), comm) as structure:
        balance, system, pairs = structure.balance, structure.linearised.system, structure.pairs
    loaded = Loaded(system, None, pairs, np.zeros(0), {}, "bar.toml")
    rest = Rest(np.zeros((pairs.n_pairs, 3)), np.zeros((pairs.n_pairs, 3)), np.zeros(0), 0, 0)
    check_balance(loaded, rest, balance)
    short = replace(balance, bodies=replace(balance.bodies, joints=0.99 * balance.bodies.joints))
    with pytest.raises(ConvergenceError, match=r"bar.toml: \[statics\]: the forces on body 'bar' are not in balance: of "):
        check_balance(loaded, rest, short)
    idle = [np.concatenate([getattr(balance.bodies, name), [[1e-12] * 6]]) for name in ("loads", "joints", "supports")]
    more = {name: np.append(getattr(balance.bodies, name), 1e-12) for name in ("size", "reach")}
    names, about = (*balance.bodies.names, "body 'idle'"), np.concatenate([balance.bodies.about, np.zeros((1, 3))])
    with_idle = replace(balance, bodies=BodiesAtRest(names, about, *idle, **more))
    check_balance(loaded, rest, with_idle)  # only rounding
    assert any("body 'idle': no forces; imbalance " in line for line in in_words(with_idle))
    nearly = replace(balance, bodies=replace(balance.bodies, joints=(1.0 - 1e-5) * balance.bodies.joints))
    check_balance(loaded, rest, nearly)
    assert sum("more than the 1e-06 that a solve should leave" in line for line in in_words(nearly)) == 2
