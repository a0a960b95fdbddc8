"""`microslip trade`, from the scene to table, picture and choices, on any number of ranks."""

import csv
import time
from types import SimpleNamespace

import pytest
from bar_scene import write_bar
from lap_joint import LapJoint, lap_joint
from lap_scene import SCENE as LAP
from msh import write_msh

from microslip.parallel.agree import on_root
from microslip.studies.trade import bench
from microslip.studies.trade import reference as trade_reference
from microslip.studies.trade.study import PARAMETERS

pytestmark = pytest.mark.ranks(1, 2)
MASS = """
[model]
stiffness = "K.mtx"
mass = "M.mtx"
[[joints]]
name = "slider"
pairs = "pairs.csv"
[[loads]]
dof = 0
[[outputs]]
name = "mass"
dof = 0
[damping]
ratio = 0.02
[response]
levels = [0.02, 0.8]
frequencies = [0.1, 0.3]
"""


def write_mass(folder):
    """Write the scene of one mass on a spring and a friction element."""
    for name, value in (("K", 1.0), ("M", 1.0)):
        (folder / f"{name}.mtx").write_text(f"%%MatrixMarket matrix coordinate real symmetric\n1 1 1\n1 1 {value}\n")
    (folder / "pairs.csv").write_text("x1,y1,z1,x2,y2,z2,mu,n0,g0,kt,kn\n0,-1,-1,-1,-1,-1,1.0,1.0,0.0,1.0,1.0\n")
    path = folder / "mass.toml"
    path.write_text(MASS)
    return path


@pytest.fixture
def program(comm, shared_path, program, monkeypatch):
    """Return a function of the writer of a scene and arguments that returns status and messages of all ranks.  Collective.

    A level has few points, and the reference few refinements; seconds are processor time, which other processes do not change.
    """
    monkeypatch.setattr(bench, "time", SimpleNamespace(perf_counter=time.process_time, process_time=time.process_time))
    for name, value in (("POINTS", 8), ("RUNGS", (3, 7, 15)), ("MOST_SAMPLES", 1024)):
        monkeypatch.setattr(trade_reference, name, value)

    def run(write, *arguments):
        return program("trade", on_root(comm, write, shared_path), "--out", shared_path / "out", *arguments)

    return run


def rows(folder):
    with open(folder / "out" / "trade.csv", newline="") as file:
        return [entry for entry in csv.DictReader(file) if entry["level_N"] == "all"]


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.pictures
def test_one_mass_from_scene_to_choices(program, shared_path, comm):
    seconds = "5" if comm.size == 1 else "1.5"  # several ranks on few processors may end earlier
    status, out, err = program(write_mass, "--seconds", seconds, "--vary", "harmonics,samples", "--levels", "0.8")
    assert (status, err) == (0, "")
    entries = [entry for entry in rows(shared_path) if not entry["failure"]]
    kinds = {entry["parameter"] for entry in entries}
    assert {"base"} <= kinds <= {"base", "harmonics", "samples", "combination", "accuracy"}
    by_H = {
        int(entry["harmonics"]): float(entry["error_percent"]) for entry in entries if entry["parameter"] in ("base", "harmonics")
    }
    base = next(entry for entry in entries if entry["parameter"] == "base")
    assert float(base["error_percent"]) <= float(base["bar_percent"]) < 5.0
    if comm.size == 1:
        assert by_H[1] > by_H[5] and "harmonics 1 -> 2:" in out
        covered = [float(entry["covered_percent"]) for entry in entries if entry["covered_percent"]]
        assert covered and sum(covered) / len(covered) >= 90.0
        assert "lie under their bar" in out
    assert any(entry["on_front"] for entry in entries)
    assert "more would change" in out
    assert "for 1 %:" in out and (shared_path / "out" / "trade.png").exists()


@pytest.mark.study
@pytest.mark.ranks(1)
def test_every_parameter_of_a_scene_with_a_mesh_and_another_mesh(program, shared_path, comm):
    other = shared_path / "fine"

    def write(folder):
        other.mkdir()
        write_bar(other, divisions=(6, 2, 2))
        return write_bar(folder)

    mesh = str(other / "bar.msh")
    status, out, err = program(write, "--seconds", "3", "--levels", "30", "--meshes", mesh)
    assert (status, err) == (0, "")
    table = rows(shared_path)
    assert {entry["parameter"] for entry in table} >= set(PARAMETERS)
    coarse, fine = (entry for entry in table if entry["parameter"] == "mesh")
    assert float(coarse["error_percent"]) > 1.0 and float(fine["error_percent"]) == 0.0
    assert "meshes, against the finest" in out


def test_a_scene_without_a_joint_is_rejected(program):
    def write(folder):
        path = write_mass(folder)
        path.write_text(MASS.replace('[[joints]]\nname = "slider"\npairs = "pairs.csv"\n', ""))
        return path

    status, _, err = program(write)
    assert status == 2 and err.count("[[joints]] is missing: without a joint the response is linear") == 1


@pytest.mark.study
@pytest.mark.ranks(1)
def test_other_meshes_of_two_beams_in_a_lap_joint(program, shared_path):
    """Two bodies in bending, three meshes of them, the finest of quadratic elements: ordered by size."""
    kinds = {"coarse": ("hex8", 2), "finer": ("hex8", 4), "finest": ("hex20", 4)}

    def write(folder):
        for name, (kind, n) in kinds.items():
            write_msh(
                str(folder / f"{name}.msh"), lap_joint(LapJoint(kind=kind, n_free=n, n_overlap=n, n_width=1, n_thickness=1))
            )
        path = folder / "lap.toml"
        text = LAP.replace("lap.msh", "coarse.msh").replace("frequencies = [10.0, 1000.0]", "mode = 1\nspan = [0.9, 1.1]")
        path.write_text(text.replace("friction = 0.3", "friction = 0.05").replace("preload = 1e6", "preload = 3e7"))
        return path

    meshes = ",".join(str(shared_path / f"{name}.msh") for name in ("finest", "finer"))
    status, out, err = program(write, "--seconds", "3", "--levels", "2", "--vary", "mesh", "--meshes", meshes)
    assert (status, err) == (0, "")
    entries = [entry for entry in rows(shared_path) if entry["parameter"] == "mesh"]
    assert [entry["value"] for entry in entries] == ["coarse.msh", "finer.msh", "finest.msh"]
    assert not any(entry["failure"] for entry in entries) and len({entry["points"] for entry in entries}) == 1
    peaks = [float(entry["frequency_percent"]) for entry in entries]
    assert peaks[0] > peaks[1] > peaks[2] == 0.0 and float(entries[2]["error_percent"]) == 0.0
    assert "meshes, against the finest, finest.msh" in out and "no pair slips" not in out


def with_mass(*changes):
    """Return a writer of the scene of one mass with some parts replaced."""

    def write(folder):
        path, text = write_mass(folder), MASS
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize(
    "changes, message",
    [
        (
            [
                ("frequencies = [0.1, 0.3]", "frequencies = [0.1, 0.3]\n[solver]\nharmonics = 0"),
                ("[[loads]]\ndof = 0", "[[loads]]\ndof = 0\nharmonic = 0"),
            ],
            "[solver] harmonics = 0 is a static balance; trade needs a vibration: state at least 1",
        ),
        ([("[[loads]]\ndof = 0", "[[loads]]\ndof = 0\nharmonic = 0")], "[[loads]] harmonic = 0: all loads are constant"),
        (
            [("[[loads]]\ndof = 0", "[[loads]]\ndof = 0\nharmonic = 2")],
            "[[loads]] harmonic = 2: nothing moves in harmonic 1, of which trade measures errors; state harmonic = 1, and 2 times",
        ),
    ],
)
def test_a_scene_without_vibration_in_harmonic_1_is_rejected(program, changes, message):
    status, _, err = program(with_mass(*changes))
    assert status == 2 and err.count(message) == 1


def test_an_output_without_motion_is_rejected(program):
    def write(folder):
        path = with_mass(("[[outputs]]", '[[outputs]]\nname = "still"\ndof = 1\n[[outputs]]'))(folder)
        for name in ("K", "M"):
            (folder / f"{name}.mtx").write_text("%%MatrixMarket matrix coordinate real symmetric\n2 2 2\n1 1 1.0\n2 2 30.0\n")
        return path

    status, _, err = program(write, "--levels", "0.8")
    assert status == 2 and err.count('[[outputs]] 1 ("still") does not move in harmonic 1 at 0.8 N') == 1


@pytest.mark.ranks(1)
def test_without_slip_only_modes_are_varied(program, shared_path):
    status, out, err = program(write_bar, "--levels", "0.001", "--seconds", "60", "--vary", "harmonics,modes,samples")
    assert (status, err) == (0, "")
    assert out.count("no pair slips or opens at 0.001 N: the response is linear") == 1
    table = rows(shared_path)
    assert {"base", "modes"} <= {entry["parameter"] for entry in table} <= {"base", "modes", "accuracy", "combination"}
    by_modes = {
        int(entry["modes"]): float(entry["error_percent"])
        for entry in table
        if entry["parameter"] in ("base", "modes") and not entry["failure"]
    }
    assert "    modes = " in out and "    harmonics = " not in out and "    tolerance = " not in out
    assert len(by_modes) > 2 and by_modes[min(by_modes)] > 10.0 * by_modes[max(by_modes)]


def test_without_slip_parameters_without_effect_are_rejected(program):
    status, _, err = program(write_mass, "--levels", "0.02", "--vary", "harmonics,samples")
    assert status == 2
    assert err.count("--vary harmonics,samples: no pair slips or opens at 0.02 N, and of a linear response none") == 1
