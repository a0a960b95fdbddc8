"""`diff` as started by a user, and scenes restored from results, on any number of ranks."""

import json

import pytest
from lap_scene import SCENE, write_mesh
from synthetic_results import branch, two_flanks, write

from microslip.parallel.agree import on_root
from microslip.results.read import read_results


@pytest.fixture
def files(comm, shared_path):
    """Return three results, the last of another level."""

    def make():
        pairs = two_flanks(4, 1)
        for name, level in (("a", 8.0), ("b", 8.0), ("c", 8.8)):
            curve = branch(level, pairs)
            curve.level = 8.0
            write(shared_path / name, [curve], pairs)

    on_root(comm, make)
    return [shared_path / name / "results.h5" for name in "abc"]


@pytest.mark.ranks(2, 3)
def test_status_of_equal_and_different_results(program, files):
    a, b, c = files
    status, out, err = program("diff", a, b)
    assert (status, err) == (0, "") and out.count("the same: the curves are equal") == 1
    status, out, err = program("diff", a, c, "--json")
    assert (status, err) == (1, "") and json.loads(out)["is_same"] is False
    assert program("diff", a, c, "--tolerance", "0.5", "--out", files[0].parent / "d")[0] == 0
    assert {path.name for path in (files[0].parent / "d").iterdir()} == {"diff.png", "diff.json"}


@pytest.mark.ranks(2)
def test_a_scene_restored_from_results_gives_the_same_results(program, comm, shared_path):
    def make():
        write_mesh(shared_path / "lap.msh")
        (shared_path / "lap.toml").write_text(SCENE)

    on_root(comm, make)
    keys = ("--set", "response.levels=[2.0]", "--set", "response.points=6", "--set", "response.frequencies=[250.0, 300.0]")
    assert program("run", shared_path / "lap.toml", *keys, "--out", shared_path / "one")[0] == 0
    first = shared_path / "one" / "results.h5"
    assert program("convert", first, "--to", "scene", "--out", shared_path / "back")[0] == 0
    assert program("run", shared_path / "back" / "lap.toml", "--out", shared_path / "two")[0] == 0
    status, out, err = program("diff", first, shared_path / "two" / "results.h5")
    assert status == 0 and "files read: the same 1" in out
    assert [line for line in out.splitlines() if "->" in line] == ['  model.mesh  "lap.msh"  ->  "../lap.msh"']
    origin = read_results(str(first)).origin
    assert origin is not None and origin.settings == keys[1::2] and origin.n_ranks == comm.size
    assert origin.inputs[0].key == "[model] mesh" and origin.inputs[0].size == (shared_path / "lap.msh").stat().st_size
