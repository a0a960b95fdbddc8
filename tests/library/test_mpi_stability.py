"""[response] stability = true from the scene to the files, and from the files of a previous run; on any number of ranks."""

import csv

import numpy as np
import pytest
from bar_scene import write_bar
from mpi4py import MPI

import microslip
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.results.read import read_results
from microslip.run import RunOptions, run
from microslip.scene.read import changed

COMM = MPI.COMM_WORLD
LEVELS = (0.1, 50.0)  # all pairs stick; some slip


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    return comm.bcast(tmp_path_factory.mktemp("stability"))


@pytest.fixture(scope="module")
def scene(comm, folder):
    path = on_root(comm, lambda: write_bar(folder, modes=4, harmonics=3, samples=64))
    return changed(microslip.read(path), {"response": {"levels": LEVELS, "points": 4, "stability": True}})


@pytest.mark.ranks(1)
def test_multipliers_are_written_and_restored(comm, folder, scene):
    with microslip.build(scene, comm) as structure:
        response = microslip.respond(structure)
    for _ in range(2):  # the second time from the files of the first run
        run(scene, comm, folder / "out", RunOptions(screen=False))
        written = read_results(str(folder / "out" / "results.h5"))
        for level in written.levels:
            assert level.stable.all() and response.stability[level.level].all()
            assert level.bifurcations == () or all(there.kind == "fold" for there in level.bifurcations)
            assert 0.5 < np.hypot(*level.multipliers[:, 0].T).max() < 1.0 + 1e-4
            assert np.allclose(level.multipliers, response.level(level.level).multipliers, atol=1e-6)
            n_slip = np.count_nonzero(level.state, axis=1)
            assert np.array_equal(level.neutral_sliders + n_slip, np.full(len(n_slip), written.joint.n_pairs))
    if comm.rank == 0:
        with open(folder / "out" / "frf.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        assert {row["stable"] for row in rows} == {"1"}
        assert float(rows[0]["largest_multiplier"]) == pytest.approx(np.hypot(*written.levels[0].multipliers[0, 0]), rel=1e-9)
        assert "stability: every point is stable" in (folder / "out" / "run.log").read_text()


def test_without_stability_there_are_no_multipliers(comm, scene):
    with microslip.build(changed(scene, {"response": {"stability": False, "levels": [0.1]}}), comm) as structure:
        response = microslip.respond(structure)
    assert response.stability == {}
    assert response.level(0.1).multipliers is None


@pytest.mark.parametrize("change", [{"solver": {"harmonics": 0}}, {"damping": {"structural": 0.01}}])
def test_responses_without_a_cycle_in_time_are_rejected(scene, change):
    with pytest.raises(CaseError, match="stability = true"):
        changed(scene, change)
