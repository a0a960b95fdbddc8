"""Levels divided into parts that groups of ranks follow at the same time: the same curves as without, including folds."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from bar_scene import write_bar
from verification import fold

import microslip
from microslip.contact.law import SLIP
from microslip.continuation.divided import coarse_curve, places
from microslip.library import side_by_side
from microslip.library.prepare import prepare
from microslip.library.respond import scene_with
from microslip.parallel.agree import on_root

pytestmark = pytest.mark.ranks(1, 2, 3)
AT = (4610.0, 4650.0, 4720.0)  # Hz, where pairs of the bar slip
LEVEL = 38.0  # N


@pytest.fixture(scope="module")
def bar(comm, tmp_path_factory):
    folder = comm.bcast(tmp_path_factory.mktemp("divided"))
    path = on_root(comm, lambda: write_bar(folder, modes=12, harmonics=3, samples=64, tolerance=1e-10))
    with microslip.build(microslip.read(path), comm) as structure:
        yield structure


def both(structure, n_groups, **keys):
    """Return the levels of a response without and with division."""
    return [microslip.respond(structure, n_groups=n_groups, divides=divides, **keys).results.levels for divides in (False, True)]


@pytest.mark.parametrize("keys", [{"error_bars": False}, {"accuracy": 1e-2}, {"method": "adaptive", "error_bars": False}])
def test_requested_points_of_a_divided_level_are_those_of_the_whole_curve(comm, bar, keys):
    tolerance = 1e-9 if "accuracy" not in keys else 1e-2
    (whole,), (divided,) = both(bar, comm.size, levels=(LEVEL,), at=AT, points=20, **keys)
    assert divided.failure == whole.failure == ""
    first, last = (level.frequency[[0, -1]] for level in (whole, divided))
    assert np.array_equal(first, last) and (divided.state == SLIP).any() and len(divided.frequency) > 20
    peak = np.abs(whole.response[:, 0]).max()
    a, b = (level.response[level.requested.astype(bool), 0, :3] for level in (whole, divided))
    assert len(a) == len(b) == len(AT) and np.abs(a - b).max() <= tolerance * peak


def test_points_of_a_divided_level_are_in_order_and_as_dense(comm, bar):
    (whole,), (divided,) = both(bar, comm.size, levels=(LEVEL,), points=20, error_bars=False)
    assert (np.diff(divided.frequency) > 0.0).all()  # the curve has no fold
    largest = [np.abs(np.diff(level.response[:, 0, 1:3], axis=0)).max() for level in (whole, divided)]
    assert largest[1] <= 1.5 * largest[0]


def test_peaks_of_several_divided_levels(comm, bar):
    whole, divided = both(bar, comm.size, levels=(1e-3, LEVEL), peaks=True, error_bars=False, points=20)
    for a, b in zip(whole, divided):
        (peak,), (followed_whole,) = a.peaks, b.peaks
        assert followed_whole.omega == pytest.approx(peak.omega, rel=1e-7) and abs(followed_whole.amplitude) == pytest.approx(
            abs(peak.amplitude), rel=1e-6
        )


@pytest.mark.parametrize("name", fold.FOLDS)
def test_parts_of_a_divided_level_pass_folds(comm, name, shared_path):
    case = fold.FOLDS[name]
    up = fold.followed(case, "up", shared_path, comm)
    with microslip.build(microslip.read(shared_path / "scene.toml"), comm) as structure:
        divided = microslip.respond(structure, n_groups=comm.size, divides=True, error_bars=False).branches[0]
    assert divided.failure is None and len(fold.turning_points(divided)) == len(fold.turning_points(up)) == 2
    assert fold.difference(case, up, divided) < 1e-8


def test_parts_begin_at_points_of_a_coarse_curve_of_few_harmonics(bar):
    prepared = prepare(bar, scene_with(bar.scene, {"levels": (LEVEL,), "error_bars": False, "points": 20}, {}))
    curve = coarse_curve(prepared.response, LEVEL)
    assert curve[0]["harmonics"].tolist() == [0, 1] and 5 < len(curve) < 20
    for n_parts in (1, 2, 4, 1000):
        at = places(curve, n_parts)
        assert len(at) <= n_parts - 1 and at == sorted(set(at)) and set(at) <= set(range(1, len(curve) - 1))
    assert coarse_curve(prepared.response, 1e-3) == [] and places([], 4) == []


def test_a_level_whose_parts_do_not_join_is_followed_as_a_whole(comm, bar, monkeypatch):
    (whole,) = microslip.respond(bar, levels=(LEVEL,), error_bars=False).results.levels
    monkeypatch.setattr(side_by_side, "joined", lambda parts: None)
    (followed_whole,) = microslip.respond(bar, levels=(LEVEL,), error_bars=False, n_groups=comm.size, divides=True).results.levels
    assert np.allclose(followed_whole.frequency, whole.frequency, rtol=1e-9) and followed_whole.failure == ""


def test_the_program_divides_levels_and_continues_with_those_not_complete(program, comm, shared_path, monkeypatch):
    path = on_root(comm, lambda: write_bar(shared_path, harmonics=1))
    settings = "--set", "response.levels=[30.0, 38.0]"

    def second_fails(of, level, *more):
        if level == 38.0:
            raise microslip.CaseError("a problem at the second level")
        return coarse_curve(of, level, *more)

    monkeypatch.setattr(side_by_side, "coarse_curve", second_fails)
    status, _, err = program("run", path, *settings, "--divide", "--out", shared_path / "out")
    assert status == 2 and "a problem at the second level" in err
    monkeypatch.setattr(side_by_side, "coarse_curve", coarse_curve)
    status, _, err = program("run", path, *settings, "--divide", "--out", shared_path / "out")
    assert (status, err) == (0, "")
    if comm.rank == 0:
        level, frequency = np.loadtxt(Path(shared_path) / "out" / "frf.csv", delimiter=",", skiprows=1, usecols=(0, 2)).T
        assert set(level) == {30.0, 38.0} and (np.diff(level) >= 0.0).all()
        assert all((np.diff(frequency[level == one]) > 0.0).all() for one in (30.0, 38.0))
        with h5py.File(Path(shared_path) / "out" / "results.h5") as file:
            assert [file[f"levels/{k:04d}"].attrs["status"] for k in range(2)] == ["complete"] * 2
        log = (Path(shared_path) / "out" / "run.log").read_text()
        assert "points are from an earlier run" in log and "each level divided among" in log
