"""The nodal diameters of a disc in the folder of a run and in the cache: other runs use them, an interrupted run continues."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from discs import cyclic, load, output, write_sector
from mpi4py import MPI
from scene_text import joint, table

from microslip.library.build import build
from microslip.modes.eigen import lowest_modes
from microslip.parallel.agree import on_root
from microslip.reduction import mistuning
from microslip.restart.folder import Restart
from microslip.results.fields import read_fields
from microslip.results.read import read_results
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)
STAGE_OF_MODES = re.compile(r"\n *modes  +[0-9.]+ s")
COMM = MPI.COMM_WORLD
END = """[damping]
ratio = 0.01
[response]
levels = [20.0]
frequencies = [1400.0, 1410.0]
points = 3
fields = false
[solver]
modes = 12
harmonics = 2
samples = 64
error_bars = false
"""


def curve(folder):
    """Return the frequencies and the responses of a run's level, and its log.  Collective."""

    def read():
        (level,) = read_results(str(folder / "results.h5")).levels
        return np.array(level.frequency), np.array(level.response), (folder / "run.log").read_text()

    return on_root(COMM, read)


def run(program, scene, folder, *more):
    status, _, messages = program("run", str(scene), "--out", str(folder), *more)
    assert status == 0, messages
    COMM.barrier()
    return curve(folder)


@pytest.mark.ranks(1)
def test_a_run_with_another_friction_uses_all_cached_nodal_diameters(shared_path, program, monkeypatch):
    monkeypatch.setenv("MICROSLIP_CACHE", str(shared_path / "cache"))
    scene = on_root(COMM, lambda: write_sector(shared_path, 5, END, friction=0.05))
    _, _, first = run(program, scene, shared_path / "first")
    changed = ("--set", "joints.root.friction=0.06")
    at, cached, log = run(program, scene, shared_path / "second", *changed)
    computed = [d for d in range(3) if f"\nnodal diameter {d}\n" in first]
    assert computed == [0, 1, 2]
    assert all(f"nodal diameter {d}: the structure is that of an earlier run" in log for d in computed)
    assert STAGE_OF_MODES.search(first) and not STAGE_OF_MODES.search(log)  # a pair that slips for the first time uses the factor
    monkeypatch.setenv("MICROSLIP_CACHE", "off")
    at_without, without, _ = run(program, scene, shared_path / "third", *changed)
    np.testing.assert_allclose(at, at_without, rtol=1e-8)
    np.testing.assert_allclose(cached, without, atol=1e-6 * np.abs(without).max())


def test_modes_computed_again_have_the_phases_of_the_lost_ones(shared_path, program, monkeypatch):
    """The files of the modes are removed before fields are written; the eigensolver then returns other phases."""
    monkeypatch.setenv("MICROSLIP_CACHE", "off")
    end = END.replace("fields = false\n", "")
    scene, folder = on_root(COMM, lambda: write_sector(shared_path, 5, end, friction=0.05)), shared_path / "run"
    run(program, scene, folder)
    (expected,) = [motion.u for motion in read_fields(str(folder / "results.h5")).peaks.values()]

    def lose_modes():
        for modes in (folder / "restart").glob("setup-*/*/modes-*"):
            modes.unlink()
        (folder / "results.h5").unlink()

    on_root(COMM, lose_modes)

    def of_other_phases(linearised, n):
        modes = lowest_modes(linearised, n)
        phases = np.exp(1j * np.arange(n)) if np.iscomplexobj(modes.phi_owned) else (-1.0) ** np.arange(n)
        return replace(modes, phi_owned=modes.phi_owned * phases)

    monkeypatch.setattr("microslip.restart.stored_structure.lowest_modes", of_other_phases)
    run(program, scene, folder)
    (moved,) = [motion.u for motion in read_fields(str(folder / "results.h5")).peaks.values()]
    np.testing.assert_allclose(moved, expected, atol=1e-8 * np.abs(expected).max())


@pytest.mark.study
@pytest.mark.ranks(1)
@pytest.mark.parametrize("order", [1, 3])
def test_cached_modes_are_selected_as_in_a_first_run(shared_path, program, monkeypatch, order):
    """Each nodal diameter has the modes that its harmonics need; order 3 of 5 sectors rotates in the other direction."""
    end = END.replace("modes = 12", "accuracy = 0.01").replace("error_bars = false\n", "")
    scene = on_root(COMM, lambda: write_sector(shared_path, 5, end, friction=0.05, wave={"engine_order": order}))
    monkeypatch.setenv("MICROSLIP_CACHE", str(shared_path / "cache"))
    run(program, scene, shared_path / "first")
    changed = ("--set", "joints.root.friction=0.06")
    *_, cached = run(program, scene, shared_path / "second", *changed)
    monkeypatch.setenv("MICROSLIP_CACHE", "off")
    *_, without = run(program, scene, shared_path / "third", *changed)
    picked = [re.findall(r"modes: \d+, picked|modes: all \d+", log) for log in (cached, without)]
    assert "of an earlier run" in cached and "of an earlier run" not in without and picked[0] == picked[1]


def test_a_run_that_lost_its_last_files_continues_with_the_same_numbers(shared_path, program, monkeypatch):
    monkeypatch.setenv("MICROSLIP_CACHE", "off")
    scene, folder = on_root(COMM, lambda: write_sector(shared_path, 5, END, friction=0.05)), shared_path / "run"
    at, response, _ = run(program, scene, folder)
    on_root(COMM, lambda: [(folder / name).unlink() for name in ("results.h5", "frf.csv")] and None)
    continued, same, log = run(program, scene, folder)
    assert "continues from the checkpoints in" in log and "has no set-up yet" not in log
    assert "nodal diameter 1: the structure is that of this folder" in log and "factor of the stuck structure" not in log
    notes = [line for line in log.splitlines() if line.startswith(("cyclic", "nodal diameter", "modes", "factor"))]
    assert notes and len(set(notes)) == len(notes) and not any(note.startswith("factor") for note in notes)
    np.testing.assert_array_equal(continued, at)
    np.testing.assert_array_equal(same, response)

    def lose_levels():
        for level in (folder / "restart").glob("level-*"):
            shutil.rmtree(level)
        for name in ("results.h5", "frf.csv"):
            (folder / name).unlink()

    on_root(COMM, lose_levels)
    continued, same, log = run(program, scene, folder)
    assert not STAGE_OF_MODES.search(log)
    np.testing.assert_array_equal(continued, at)
    np.testing.assert_array_equal(same, response)


BLADES = "stiffness = 0.01, density = 0.005, friction = 0.1"
CONTACT = "friction = 0.1, contact_stiffness = 0.05"


@pytest.mark.parametrize("scatter", [BLADES, pytest.param(CONTACT, marks=pytest.mark.ranks(1))])
def test_discs_whose_sectors_differ_in_other_ways_share_the_disc_of_identical_sectors(shared_path, program, monkeypatch, scatter):
    """With other differences, from the cache and from the folder of the run: the numbers are those of a first run, fields too."""
    monkeypatch.setenv("MICROSLIP_CACHE", str(shared_path / "cache"))
    how = {"engine_order": 1, "whole": True, "blades": ["blade"]}
    end = (
        END.replace("fields = false\n", "")
        .replace("modes = 12", "modes = 6")
        .replace("error_bars = false\n", "")
        .replace("[20.0]", "[4.0]")
    )
    scene = on_root(COMM, lambda: write_sector(shared_path, 5, end, friction=0.05, wave=how))
    _, _, first = run(program, scene, shared_path / "first", "--set", f"cyclic.scatter={{{scatter}, seed = 1}}")
    other = ("--set", f"cyclic.scatter={{{scatter}, seed = 2}}")
    at, cached, log = run(program, scene, shared_path / "second", *other)
    assert "modes of all nodal diameters" in first and "modes of all nodal diameters" not in log
    assert log.count("the disc of identical sectors is that of an earlier run") == log.count("cyclic: sectors differ by") == 1
    monkeypatch.setenv("MICROSLIP_CACHE", "off")
    at_without, without, log = run(program, scene, shared_path / "third", *other)
    assert "modes of all nodal diameters" in log
    np.testing.assert_allclose(at, at_without, rtol=1e-8)
    np.testing.assert_allclose(cached, without, atol=1e-8 * np.abs(without).max())
    fields = [read_fields(str(shared_path / name / "results.h5")) for name in ("second", "third")]
    (moved,), (expected,) = ([motion.u for motion in each.peaks.values()] for each in fields)
    np.testing.assert_allclose(moved, expected, atol=1e-6 * np.abs(expected).max())

    def lose_levels():
        for path in (shared_path / "third" / "restart").glob("level-*"):
            shutil.rmtree(path)
        (shared_path / "third" / "results.h5").unlink()

    on_root(COMM, lose_levels)
    at_again, again, log = run(program, scene, shared_path / "third", *other)
    assert "the disc of identical sectors is that of this folder" in log and "modes of all nodal diameters" not in log
    np.testing.assert_array_equal(at_again, at_without)
    np.testing.assert_array_equal(again, without)


WHOLE = {"engine_order": 1, "whole": True, "blades": ["blade"]}
OF_BLADES = END.replace("modes = 12", "modes = 6").replace("[20.0]", "[4.0]")


def set_ups(folder):
    """Return the folders of the nodal diameters of the disc with static shapes in a run's folder, in order.  Rank 0."""
    return sorted((folder / "restart").glob("setup-*/shaped-diameter-*"))


def without_results(folder):
    """Remove the levels and the results of a run, which keeps its set-up.  Rank 0."""
    for path in (folder / "restart").glob("level-*"):
        shutil.rmtree(path)
    (folder / "results.h5").unlink()


def other_signs(K, M, ritz=mistuning._ritz):
    """Return the static shapes with the other sign of every second one, which are as good."""
    omega2, X = ritz(K, M)
    return omega2, X * (-1.0) ** np.arange(X.shape[1])


def test_nodal_diameters_of_different_computations_are_not_combined(shared_path, program, monkeypatch):
    """Static shapes of one computation and matrices of the blades of another would give a wrong disc."""
    monkeypatch.setenv("MICROSLIP_CACHE", "off")
    scene = on_root(COMM, lambda: write_sector(shared_path, 5, OF_BLADES, friction=0.05, wave=WHOLE))
    of_run = ("--set", "cyclic.scatter={stiffness = 0.01, seed = 1}")
    _, expected, _ = run(program, scene, shared_path / "first", *of_run)
    with monkeypatch.context() as patch:
        patch.setattr(mistuning, "_ritz", other_signs)
        run(program, scene, shared_path / "second", *of_run)

    def mix():
        first, second = (set_ups(shared_path / name) for name in ("first", "second"))
        assert len(first) == len(second) == 3
        for mine, other in zip(first[1:], second[1:]):
            shutil.rmtree(mine)
            shutil.copytree(other, mine)
        without_results(shared_path / "first")

    on_root(COMM, mix)
    _, mixed, log = run(program, scene, shared_path / "first", *of_run)
    assert "modes of all nodal diameters" in log
    np.testing.assert_allclose(mixed, expected, atol=1e-8 * np.abs(expected).max())
    on_root(COMM, lambda: without_results(shared_path / "first"))
    _, again, log = run(program, scene, shared_path / "first", *of_run)
    assert "modes of all nodal diameters" not in log  # all are of one computation again
    np.testing.assert_array_equal(again, mixed)


def test_a_run_whose_cache_is_removed_has_the_modes_in_its_folder(shared_path, program, monkeypatch):
    monkeypatch.setenv("MICROSLIP_CACHE", str(shared_path / "cache"))
    end = OF_BLADES.replace("fields = false\n", "")
    scene = on_root(COMM, lambda: write_sector(shared_path, 5, end, friction=0.05, wave=WHOLE))
    run(program, scene, shared_path / "first", "--set", "cyclic.scatter={stiffness = 0.01, seed = 1}")
    prepared = Restart.prepared

    def and_lose_the_cache(*arguments):
        result = prepared(*arguments)
        on_root(COMM, lambda: shutil.rmtree(shared_path / "cache"))
        return result

    monkeypatch.setattr(Restart, "prepared", and_lose_the_cache)
    *_, log = run(program, scene, shared_path / "second", "--set", "cyclic.scatter={stiffness = 0.01, seed = 2}")
    assert "of an earlier run" in log and "fields for ParaView" in log


SECTOR_AT_SPEED = Path(__file__).parents[1] / "data" / "sector_at_speed.inp"  # five sectors, *DLOAD CENTRIF in its first step


def write_sector_at_speed(folder):
    """Write a disc whose material, bodies, support and rotation are those of its model file."""
    shutil.copy(SECTOR_AT_SPEED, folder / "sector.inp")
    text = table("model", mesh="sector.inp") + joint("root", "slot", name="root", friction=0.05, preload=2e7, k_t=5e11)
    text += cyclic(5, **WHOLE) + load(5) + output(5) + OF_BLADES
    (folder / "sector.toml").write_text(text)
    return folder / "sector.toml"


def test_the_loads_at_rest_of_a_model_file_are_those_of_the_whole_disc(shared_path, program, monkeypatch):
    """They refuse contact that differs; other differences are those of a disc that is built, also after the first one."""
    monkeypatch.setenv("MICROSLIP_CACHE", "off")
    scene = on_root(COMM, lambda: write_sector_at_speed(shared_path))
    status, _, messages = program(
        "run", scene, "--out", shared_path / "refused", "--set", "cyclic.scatter={friction=0.1, seed=1}"
    )
    assert status == 2 and "friction of a sector takes part in it" in messages
    settings = [f"cyclic.scatter={{stiffness=0.01, seed={seed}}}" for seed in (1, 2)]
    run(program, scene, shared_path / "run", "--set", settings[0])
    scenes = [read_scene(scene, [setting]) for setting in settings]
    with build(scenes[0], COMM) as first:
        assert first.shares_modes_with(scenes[1])
        first.with_sectors(scenes[1]).close()
