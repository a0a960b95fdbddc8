"""What run.log says was not computed, as a user reads it; and what was."""

from itertools import takewhile

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from matrix_scenes import write_matrix_scene
from oracles import scenes
from processes import microslip

SCALED = "no pair leaves sticking anywhere on its linear curve: scaled, not solved"


def not_computed(path) -> list[str]:
    lines = path.read_text().splitlines()
    start = lines.index("not computed, for the scene does not require it:") + 1
    return [line.strip() for line in takewhile(lambda line: line.startswith("  "), lines[start:])]


@pytest.mark.parametrize("ranks, groups", [(1, 1), (2, 2)])
def test_the_level_that_sticks_is_scaled_and_the_other_solved(tmp_path, ranks, groups):
    write_matrix_scene(tmp_path, scenes.spatial_mass(), [0.02, 0.4], (1.0, 1.6), outputs=[0], points=8)
    done = microslip("run", "scene.toml", "--groups", groups, "--out", "out", ranks=ranks, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    log = (tmp_path / "out" / "run.log").read_text()
    assert log.count(SCALED) == 1
    assert "level 1 of 2: 0.02 N" in log[: log.index(SCALED)].splitlines()[-2]
    table = np.genfromtxt(tmp_path / "out" / "frf.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    low, high = (table[table["level_N"] == level] for level in (0.02, 0.4))
    assert not low["newton"].any() and high["newton"].any()
    said = not_computed(tmp_path / "out" / "run.log")
    assert "Newton iterations at 0.02 N: no pair leaves sticking, the linear response is scaled" in said
    assert "damping matrix: [damping] gives that of each mode" in said
    assert "fields for ParaView: the scene has no mesh" in said
    assert not any(line.startswith(("static columns", "error bars", "even harmonics")) for line in said)


def test_no_static_column_where_nothing_slips(tmp_path):
    write_matrix_scene(tmp_path, scenes.spatial_mass(), [0.01, 0.02], (1.0, 1.6), outputs=[0], points=8, accuracy=1e-3)
    done = microslip("run", "scene.toml", "--out", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    said = not_computed(tmp_path / "out" / "run.log")
    assert "static columns of 1 of 1 pairs: none of these was let slip or open" in said
    assert "Newton iterations at 0.01, 0.02 N: no pair leaves sticking, the linear response is scaled" in said


def test_a_scene_without_joint_has_no_contact_at_all(tmp_path):
    for name, matrix in (("K", [[2e4, -1e4], [-1e4, 1e4]]), ("M", np.eye(2))):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", sp.csr_matrix(np.array(matrix)))
    (tmp_path / "free.toml").write_text(
        '[model]\nstiffness = "K.mtx"\nmass = "M.mtx"\n[[loads]]\ndof = 1\nscale = 1.0\n[[outputs]]\nname = "a"\ndof = 0\n'
        "[damping]\nratio = 0.01\n[response]\nlevels = [1.0]\nfrequencies = [5.0, 15.0]\npoints = 9\n[solver]\nerror_bars = false\n")
    done = microslip("run", "free.toml", "--out", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    said = not_computed(tmp_path / "out" / "run.log")
    assert "contact forces and static columns: the scene has no pair, the response is linear" in said
    assert "error bars: [solver] asks for none" in said
    assert not any("Newton" in line for line in said)
