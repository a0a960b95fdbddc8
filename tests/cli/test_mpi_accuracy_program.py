"""Notes of `microslip run` on points that miss the requested accuracy; on any number of ranks."""

import h5py
import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.parallel.agree import on_root

MISSED = "accuracy not met"


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize("harmonics, accuracy", [(1, 2e-3), (None, 1e-2)])
def test_points_that_miss_the_accuracy_are_noted(comm, shared_path, program, harmonics, accuracy):
    """A single stated harmonic is too few in slip; harmonics chosen by the program are enough."""
    stated = {} if harmonics is None else {"harmonics": harmonics}

    def write():
        sweep = {"levels": [0.3, 100.0], "frequencies": (520.0, 600.0), "points": 12}
        return write_matrix_scene(shared_path, scenes.chain(), **sweep, outputs=[6], accuracy=accuracy, **stated)

    status, _, err = program("run", on_root(comm, write), "--out", shared_path / "out")
    assert (status, err) == (0, "")
    comm.barrier()
    with h5py.File(shared_path / "out" / "results.h5") as file:
        sticks, slips = (file[f"levels/{i:04d}/notes"].asstr()[:] for i in (0, 1))
        bars = file["levels/0001/error_m"][:, 0].sum(axis=1)
        peak = np.hypot(*file["levels/0001/response"][:, 0, 1:3].T).max()
    noted = np.array([MISSED in note for note in slips])
    log = (shared_path / "out" / "run.log").read_text()
    assert not any(MISSED in note for note in sticks)
    if harmonics is None:
        assert not noted.any() and MISSED not in log and bars.max() < accuracy * peak
    else:
        assert bars.max() > accuracy * peak and noted[np.argmax(bars)]
        line = next(line for line in log.splitlines() if MISSED in line)
        assert f"{noted.sum()} of {len(noted)} points" in line and log.count(MISSED) == 1
