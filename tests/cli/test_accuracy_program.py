"""What `microslip run` says where the accuracy asked for is not met, and where it is."""

import h5py
import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import scenes
from processes import microslip

MISSED = "accuracy not met"


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("harmonics, accuracy", [(1, 2e-3), (None, 1e-2)])
def test_points_that_miss_the_accuracy_say_so(tmp_path, harmonics, accuracy, ranks):
    """One harmonic, stated, is too few in slip; left to the program, enough are taken."""
    stated = {} if harmonics is None else {"harmonics": harmonics}
    write_matrix_scene(
        tmp_path, scenes.chain(), [0.3, 100.0], (520.0, 600.0), outputs=[6], points=12, accuracy=accuracy, **stated
    )
    done = microslip("run", "scene.toml", "--out", "out", ranks=ranks, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "out" / "results.h5") as file:
        sticks, slips = (file[f"levels/{i:04d}/notes"].asstr()[:] for i in (0, 1))
        bars = file["levels/0001/error_m"][:, 0].sum(axis=1)
        peak = np.hypot(*file["levels/0001/response"][:, 0, 1:3].T).max()
    noted = np.array([MISSED in note for note in slips])
    log = (tmp_path / "out" / "run.log").read_text()
    assert not any(MISSED in note for note in sticks)
    if harmonics is None:
        assert not noted.any() and MISSED not in log and bars.max() < accuracy * peak
    else:
        assert bars.max() > accuracy * peak and noted[np.argmax(bars)]
        line = next(line for line in log.splitlines() if MISSED in line)
        assert f"{noted.sum()} of {len(noted)} points" in line and log.count(MISSED) == 1
