"""From a model file to a first curve by `new`, `check` and `run`, on any number of ranks; faults are reported once."""

import re

import numpy as np
import pytest
from plain_model import inp, plain

from microslip.parallel.agree import on_root
from microslip.results.read import read_results


@pytest.fixture
def model(shared_path, comm):
    """Return the model file, without names for the two sides in contact."""
    whole = plain()
    on_root(comm, lambda: (shared_path / "m.inp").write_text(inp(whole)))
    return shared_path / "m.inp"


def edit(comm, path, *changes):
    """Change a file on one rank."""

    def write():
        text = re.sub(r"^#> ", "", path.read_text(), flags=re.MULTILINE)
        for old, new in changes:
            assert re.search(old, text, flags=re.MULTILINE)
            text = re.sub(old, new, text, flags=re.MULTILINE)
        path.write_text(text)

    on_root(comm, write)


QUICK = (
    (r"^levels = \S+ \S+", "levels = [0.4]"),
    (r"^span = .*", "span = [0.95, 1.02]\npoints = 6\n[solver]\nmodes = 4\nerror_bars = false"),
)
BY_BODIES = """[[surfaces]]
name = "up"
bodies = ["BAR-1.ALL", "PLATE-1.ALL"]
[[surfaces]]
name = "low"
bodies = ["PLATE-1.ALL", "BAR-1.ALL"]
[[joints]]"""


@pytest.mark.ranks(1)
def test_new_check_and_run_by_names_and_by_bodies(comm, program, model, shared_path):
    scene, out = shared_path / "first.toml", shared_path / "out"
    status, messages, _ = program("new", model, "--out", scene)
    assert status == 0 and messages.count("BAR_BOTTOM on PLATE_TOP: 3 faces on 3, 0.0005 m2, touching, node to node") == 1
    status, _, error = program("check", scene)
    assert status == 2 and "and tangential_stiffness, normal_stiffness and preload\n" in error
    edit(comm, scene, *QUICK)
    status, messages, _ = program("check", scene, "--out", out)
    assert status == 0 and "joint      BAR_BOTTOM_PLATE_TOP: 8 pairs on 0.0005 m2" in messages and "picture " in messages
    peaks, slips = [], []
    for changes in ((), ((r"^\[\[joints\]\]", BY_BODIES), (r'"BAR_BOTTOM", "PLATE_TOP"', '"up", "low"'))):
        edit(comm, scene, *changes)
        status, messages, error = program("run", scene, "--out", out)
        assert status == 0, error
        peaks.append(on_root(comm, lambda: np.abs(read_results(str(out / "results.h5")).levels[0].response).max()))
        (slip,) = re.findall(r"by the linear peak, pairs slip from about (\S+) N", messages)
        slips.append(slip)
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-9) and peaks[0] > 0.0 and slips[0] == slips[1]
    assert "surface 'up': 3 faces of 'BAR-1.ALL' on 'PLATE-1.ALL', 0.0005 m2" in messages
    assert on_root(comm, lambda: (out / "mesh.png").stat().st_size) > 10_000


FIXED = (
    "*Step, name=Fixed, perturbation",
    "*Frequency",
    "4,",
    "*Boundary",
    "BAR_BOTTOM, ENCASTRE",
    "PLATE_TOP, ENCASTRE",
    "*End Step",
)


@pytest.mark.ranks(1)
def test_a_fixed_interface_step_does_not_hold_the_joint(comm, program, shared_path):
    """From such a file `new` writes a scene with free pairs, as its second step does; unchanged, the joint is rejected."""
    on_root(comm, lambda: (shared_path / "m.inp").write_text(inp(plain(), FIXED)))
    scene, out = shared_path / "first.toml", shared_path / "out"
    status, messages, _ = program("new", shared_path / "m.inp", "--out", scene)
    assert status == 0 and "left out: BAR_BOTTOM (xyz), PLATE_TOP (xyz), which fix both sides of a joint" in messages
    edit(comm, scene, *QUICK)
    peaks = []
    for changes in ((), ((r"^step = 1", "step = 2"), (r"^take = .*\n", ""), (r"^\[\[supports\]\]\ngroup.*\nfix.*\n", ""))):
        edit(comm, scene, *changes)
        status, messages, error = program("check", scene)
        assert status == 0, error
        assert "WARNING" not in messages and ("held: " not in messages) and "PLATE_BASE: x, y, z" in messages
        assert messages.count("*FREQUENCY, PERTURBATION") == 2
        assert program("run", scene, "--out", out)[0] == 0
        peaks.append(on_root(comm, lambda: np.abs(read_results(str(out / "results.h5")).levels[0].response).max()))
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-12)
    edit(comm, scene, (r"^step = 2", "step = 1"))
    status, _, error = program("check", scene)
    assert status == 2 and "fix both sides of all its 8 pairs" in error
    edit(comm, scene, (r"^step = 1", "step = 3"))
    status, _, error = program("check", scene)
    assert status == 2 and error.count("microslip: error: ") == 1
    assert '[model] step = 3: the file has 2 steps, 1: *FREQUENCY, PERTURBATION "Fixed"; 2: *FREQUENCY, PERTURBATION' in error


def test_all_faults_of_a_scene_are_reported_in_one_check(comm, program, shared_path):
    """An open question, a tie and a joint of faces without contact, an output without a node: one message, status 2."""
    on_root(comm, lambda: (shared_path / "m.inp").write_text(inp(plain(), ("*Gap, elset=D", "0.1"))))
    scene = shared_path / "first.toml"
    assert program("new", shared_path / "m.inp", "--out", scene)[0] == 0
    tie = '[[ties]]\nsurfaces = ["PLATE_BASE", "BAR_BOTTOM"]\n[[joints]]'
    edit(comm, scene, (r"^ignore = .*\n", ""), (r"^\[\[joints\]\]", tie), (r'"BAR_BOTTOM", "PLATE_TOP"\]', '"BAR_BOTTOM", "PLATE_BASE"]'),
         (r'name = "tip"\nnode = \d+', 'name = "tip"\nnode = 99999'))  # fmt: skip
    status, _, error = program("check", scene)
    assert status == 2 and error.count("microslip: error: ") == 1
    assert re.search(r"(?s)error: 4 faults:\n  1\. .*\*GAP.*\n  2\. .*joint .*\n  3\. .*tie .*\n  4\. .*node = 99999", error)


def test_a_model_file_is_checked_and_a_scene_is_not_overwritten(comm, program, model, shared_path):
    status, messages, _ = program("check", model)
    assert status == 0 and messages.count("model      ") == 1 and "supports   PLATE_BASE: x, y, z" in messages
    on_root(comm, lambda: (shared_path / "mine.toml").write_text("mine"))
    status, _, error = program("new", model, "--out", shared_path / "mine.toml")
    assert status == 2 and error.count("microslip: error: ") == 1 and "is not overwritten" in error
    assert on_root(comm, lambda: (shared_path / "mine.toml").read_text()) == "mine"
