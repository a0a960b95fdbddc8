"""[response] peaks = true from the scene to the files: the bar of the tests on its joint; on any number of ranks."""

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
    return comm.bcast(tmp_path_factory.mktemp("peaks"))


@pytest.fixture(scope="module")
def scene(comm, folder):
    path = on_root(comm, lambda: write_bar(folder, modes=8, harmonics=3, samples=64))
    return changed(microslip.read(path), {"response": {"levels": LEVELS, "points": 20, "peaks": True}})


@pytest.mark.ranks(1)
def test_peaks_are_written_and_read_back(comm, folder, scene):
    with microslip.build(scene, comm) as structure:
        response = microslip.respond(structure)
    run(scene, comm, folder / "out", RunOptions(screen=False))
    written = read_results(str(folder / "out" / "results.h5"))
    assert set(response.peaks) == set(LEVELS)
    for level in written.levels:
        peaks, curve = level.peaks, np.hypot(level.response[:, 0, 1], level.response[:, 0, 2])
        assert peaks and all(peak.within < 1e-5 * peak.omega for peak in peaks)
        highest = max(abs(peak.amplitude) for peak in peaks if peak.output == 0)
        assert curve.max() <= highest * (1.0 + 1e-7)
        for one, other in zip(peaks, response.peaks[level.level], strict=True):
            assert (one.output, one.segment) == (other.output, other.segment)
            assert one.omega == pytest.approx(other.omega, rel=1e-5)
            assert abs(one.amplitude) == pytest.approx(abs(other.amplitude), rel=1e-6)
    slipping = [max(peak.slipping for peak in level.peaks) for level in written.levels]
    assert slipping[0] == 0 < slipping[1]
    log = on_root(comm, (folder / "out" / "run.log").read_text)
    assert log.count("  peak of ") == sum(len(level.peaks) for level in written.levels)


@pytest.mark.parametrize("solver", [{"harmonics": 0}, {"method": "adaptive"}])
def test_responses_without_peaks_are_rejected(scene, solver):
    with pytest.raises(CaseError, match="peaks = true"):
        changed(scene, {"solver": solver})
