"""`microslip sweep`: table, arrays with named axes, parts of a job array, continued sweeps, messages; on any number of ranks."""

import csv

import h5py
import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.parallel.agree import on_root

FRICTION, STIFFNESS = "joints.joint.friction", "joints.joint.tangential_stiffness"


@pytest.fixture
def scene(comm, shared_path):
    """Return the scene of one mass on a Jenkins element that sticks at its level."""
    system = scenes.jenkins_mass()

    def write():
        more = {"points": 15, "harmonics": 1, "samples": 64, "tolerance": 1e-9, "error_bars": False}
        return write_matrix_scene(shared_path, system, [0.4], (0.5, 2.5), **more)

    return on_root(comm, write)


def rows_of(folder):
    with (folder / "sweep.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.pictures
@pytest.mark.ranks(1, 2)
def test_a_grid_has_a_table_and_arrays_with_named_axes(comm, scene, program, shared_path):
    out = shared_path / "out"
    status, messages, err = program("sweep", scene, "--set", f"{FRICTION}=0.5,0.8", "--set", "level=0.3:0.6:3:log", "--out", out)
    assert (status, err) == (0, "") and "6 samples, grid 2 x 3" in messages
    rows = rows_of(out)
    assert [row["status"] for row in rows] == ["done"] * 6
    with h5py.File(out / "sweep.h5") as file:
        data = file["amplitude"]
        assert data.shape == (2, 3) and data.attrs["units"] == "m"
        assert [dim[0].name.strip("/") for dim in data.dims] == [FRICTION, "level"]
        assert file["level"][:] == pytest.approx(np.geomspace(0.3, 0.6, 3))
        assert data[:].ravel() == pytest.approx([float(row["amplitude_m"]) for row in rows], rel=1e-8)
        assert list(file.attrs["keys"]) == [FRICTION, "level"]
    on_root(comm, lambda: (out / "peak_map.png").stat().st_size)


def test_parts_and_continued_sweeps_give_the_same_table(comm, scene, program, shared_path):
    """A part of a job array, the other part, and an interrupted run: each sample is computed once, and the tables are equal."""
    arguments = "--scatter", f"{FRICTION}=10", "--scatter", "level=20:uniform", "--samples", "4", "--seed", "3"
    whole, parts = shared_path / "whole", shared_path / "parts"
    assert program("sweep", scene, *arguments, "--out", whole)[0] == 0
    status, messages, _ = program("sweep", scene, *arguments, "--part", "1/2", "--out", parts)
    assert status == 0 and "2 of 4 samples are not computed yet" in messages
    assert [row["status"] for row in rows_of(parts)] == ["done", "missing", "done", "missing"]
    assert program("sweep", scene, *arguments, "--part", "2/2", "--out", parts)[0] == 0

    def cut():
        path = next((whole / "samples").glob("*.jsonl"))
        path.write_bytes(path.read_bytes()[:-40])

    on_root(comm, cut)
    status, messages, _ = program("sweep", scene, *arguments, "--out", whole)
    assert status == 0 and "3 of them were computed by an earlier run" in messages
    status, messages, _ = program("sweep", scene, *arguments, "--out", parts)
    assert status == 0 and "4 of them were computed" in messages
    for first, second in zip(rows_of(whole), rows_of(parts), strict=True):
        for name in ("amplitude_m", "frequency_Hz", "width_Hz", "damping", "friction_J"):
            assert float(first[name]) == pytest.approx(float(second[name]), rel=1e-5, nan_ok=True), name


@pytest.mark.ranks(1)
@pytest.mark.pictures
def test_indices_curves_and_one_at_a_time_designs(comm, scene, program, shared_path):
    out, separate = shared_path / "out", shared_path / "alone"
    arguments = "--scatter", f"{FRICTION}=5", "--scatter", "level=5", "--design", "indices", "--samples", "2", "--curves"
    status, messages, _ = program("sweep", scene, *arguments, "--out", out)
    assert status == 0 and "percentiles of the samples" in messages
    with h5py.File(out / "sweep.h5") as file:
        curves, peaks = file["curve"][:], file["amplitude"][:]
        assert curves.shape == (8, 201) and (np.nanmax(curves, axis=1) <= peaks * (1.0 + 1e-6)).all()
    with (out / "indices.csv").open(newline="") as file:
        assert [row["key"] for row in csv.DictReader(file)] == [FRICTION, "level"]
    one_by_one = "--set", f"{FRICTION}=0.9,1.1", "--set", "level=0.3,0.5", "--one-by-one"
    status, messages, _ = program("sweep", scene, *one_by_one, "--out", separate)
    assert status == 0 and "level from 0.3 to 0.5: peak from" in messages
    names = on_root(comm, lambda: {path.name for folder in (out, separate) for path in folder.glob("*.png")})
    assert {"indices.png", "bands.png", "tornado.png", "scatter.png"} <= names
    assert program("sweep", scene, "--set", f"{FRICTION}=0.9,1.1", "--out", out)[0] == 0
    names_left = on_root(comm, lambda: {path.name for path in out.iterdir()})  # files of the first sweep are deleted
    assert "sweep.png" in names_left and names_left.isdisjoint({"indices.csv", "indices.png", "bands.png", "scatter.png"})


@pytest.mark.ranks(1, 2)
def test_a_sample_that_fails_ends_with_status_3_after_the_others(comm, scene, program, shared_path):
    table, out = shared_path / "samples.csv", shared_path / "out"
    on_root(comm, lambda: table.write_text(f"# factors\n{STIFFNESS}, level\n0.9, 0.4\n1e3, 0.4\n1.0, -2\n-1, 0.4\n"))
    status, _, err = program("sweep", scene, "--table", table, "--out", out)
    assert status == 2 and "2 of 4 samples are outside what the scene allows" in err and "levels" in err
    status, messages, err = program("sweep", scene, "--table", table, "--outside", "skip", "--out", out)
    assert status == 3 and "1 of 4 samples have no peak" in err and "sample 1" in err
    assert [row["status"] for row in rows_of(out)] == ["done", "failed", "outside", "outside"]


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("", "exactly one of --set"),
        ("--set level=1,2 --scatter level=3", "exactly one of --set"),
        ("--set level=1:2", "--set level=1:2: expected KEY=A,B"),
        ("--set level=0:2:3:log", "above 0 where they are logarithmic"),
        ("--set level=1,x", "expected KEY=A,B"),
        ("--set level=1,2 --set level=3,4", "level is stated twice"),
        ("--set level=1,3,1", "level: the value 1 is stated 2 times"),
        ("--set level=2:2:3 --one-by-one", "level: the value 2 is stated 3 times"),
        ("--set joints.joint.frction=1,2", 'nearest is "friction"'),
        ("--set level=1,2 --samples 3", "belong to --scatter"),
        ("--scatter level=10:gauss", "expected the distribution lognormal, normal or uniform"),
        ("--scatter level=-5", "percent above 0"),
        ("--scatter loads.1.phase=5", "is 0 in the scene"),
        ("--scatter level=5 --design sobl", 'nearest is "sobol"'),
        ("--table none.csv", "none.csv: there is no such file"),
        ("--set level=1,2 --output tip", "there is no output 'tip'"),
        ("--set level=1,2 --part 3/2", "'3/2' is not I/N"),
    ],
)
def test_invalid_options_of_a_sweep_are_rejected(scene, program, shared_path, options, message):
    status, _, err = program("sweep", scene, *options.split(), "--out", shared_path / "out")
    assert status == 2 and message in err and "Traceback" not in err


@pytest.mark.ranks(1)
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1.0,2.0\n3.0,4.0\n", "the columns have no names"),
        ("level\n", "there is no sample in it"),
        ("level\n1.0,2.0\n", "sample 0 has 2 cells"),
        ("level\nhigh\n", "expected a finite number, found 'high'"),
        ("level;joints.joint.friction\n0.4;1\n", "separated by semicolons, not by commas"),
        ("", "the columns have no names"),
    ],
)
def test_an_invalid_table_is_rejected(scene, program, shared_path, text, message):
    (shared_path / "table.csv").write_text(text)
    status, _, err = program("sweep", scene, "--table", shared_path / "table.csv", "--out", shared_path / "out")
    assert status == 2 and message in err
