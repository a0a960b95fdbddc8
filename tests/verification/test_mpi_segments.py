"""A branch that ends early is also followed from the other end, then with short steps; runs on any number of ranks."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from matrix_scenes import branches_of, requested, write_matrix_scene
from mpi4py import MPI
from verification.fold import FOLDS, followed, mass
from verification.sharp_peaks import response_of

from microslip.continuation import levels
from microslip.library.follow_response import follow
from microslip.observe.level_log import remarks
from microslip.results.read import read_results
from microslip.run import RunOptions, run
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
FOLD = FOLDS["softening"]
BETWEEN, AT = (1.31, 1.6), (1.3101, 1.315, 1.33, 1.345)  # all lie between the turning points, as the start does


def scene_between_the_folds(folder, direction="up", error_bars=False):
    """Write a scene whose range begins between two turning points: the branch from its start ends at the lower one."""
    if COMM.rank == 0:
        write_matrix_scene(
            folder,
            mass(FOLD),
            [FOLD.level],
            BETWEEN,
            at=AT,
            points=40,
            direction=direction,
            harmonics=7,
            samples=512,
            tolerance=1e-10,
            error_bars=error_bars,
        )
    COMM.barrier()
    return folder / "scene.toml"


def responses(branch, omega) -> np.ndarray:
    """Return all solutions at one of ``AT``, by ascending amplitude."""
    close = [point.response[0] for point in requested(branch) if abs(point.omega - omega) < 1e-12 * omega]
    return np.array(sorted(close, key=lambda u: np.hypot(*u[1:3])))


def test_two_segments_are_the_branch_through_both_folds(shared_path):
    (branch,) = branches_of(scene_between_the_folds(shared_path), COMM)
    omega, segment = (np.array([getattr(point, name) for point in branch.points]) for name in ("omega", "segment"))
    assert (np.diff(segment) >= 0).all() and set(segment) == {0, 1}
    first, second = omega[segment == 0], omega[segment == 1]
    assert first[0] == pytest.approx(BETWEEN[0]) and first.max() > 1.35  # over the upper turning point, out of the range
    assert second[[0, -1]] == pytest.approx(BETWEEN[::-1]) and (np.diff(second) < 0.0).all()
    assert "back out of the range" in branch.broken
    (shared_path / "whole").mkdir(exist_ok=True)
    whole = followed(FOLD, "up", shared_path / "whole", COMM)
    for at in AT:
        computed, expected = responses(branch, at), responses(whole, at)
        assert len(computed) == 3 and len(expected) == (3 if at in FOLD.at else 0)
        if at not in FOLD.at:  # between the start and the last point of the first segment
            continue
        assert computed == pytest.approx(expected, abs=1e-7 * np.abs(expected).max())


def test_a_branch_that_reaches_its_end_has_one_segment(shared_path):
    (branch,) = branches_of(scene_between_the_folds(shared_path, "down"), COMM)
    assert branch.broken is None and {point.segment for point in branch.points} == {0}


def test_a_branch_that_ends_early_from_both_ends_is_followed_with_short_steps(shared_path, monkeypatch):
    """The real branch reaches its end; of the first two segments only the first points are used."""
    follow, lengths = levels.follow_branch, []

    def ending_early(task, max_points, on_point, segment, checkpointer):
        lengths.append((task.steps.ds, task.steps.ds_min, task.steps.ds_max))
        branch = follow(task, max_points, on_point, segment, checkpointer)
        return replace(branch, points=branch.points[:5], failure=f"reason {segment}") if segment < 2 else branch

    scene = scene_between_the_folds(shared_path, "down")
    (whole,) = branches_of(scene, COMM)
    monkeypatch.setattr(levels, "follow_branch", ending_early)
    (branch,) = branches_of(scene, COMM)
    assert branch.failure is None and sorted({point.segment for point in branch.points}) == [0, 1, 2]
    assert branch.broken == "reason 0; and from the other end of the range: reason 1"
    assert lengths[1] == lengths[0] and 4.0 * np.array(lengths[2]) == pytest.approx(np.array(lengths[0]))
    short = [point for point in branch.points if point.segment == 2]
    assert short[0].omega == whole.points[0].omega and short[-1].omega == whole.points[-1].omega
    assert len(short) > 2 * len(whole.points)
    for here, there in zip(requested(replace(branch, points=short)), requested(whole), strict=True):
        assert here.response == pytest.approx(there.response, abs=1e-7 * np.abs(there.response).max())
    (line,) = (line for line in remarks(branch) if "reason" in line)
    ways = "from the other end of the range and with steps a quarter as long"
    assert line == f"  in three segments: followed {ways} as well, since {branch.broken}"


@pytest.mark.study
@pytest.mark.ranks(1)
@pytest.mark.parametrize("system", [1, 13, 65])
def test_curves_of_random_structures_that_end_early_are_completed_by_short_steps(system):
    with response_of(7, system, True, 1024) as response:
        (branch,) = follow(replace(response, settings=replace(response.settings, points=30)))
        omega = np.array([point.omega for point in branch.points if point.segment == 2])
    assert branch.failure is None and omega[[0, -1]] == pytest.approx([response.sweep.start, response.sweep.stop])


@pytest.mark.ranks(2)
def test_results_have_both_segments(shared_path):
    folder = shared_path / "out"
    run(read_scene(scene_between_the_folds(shared_path, error_bars=True)), COMM, folder, RunOptions(screen=False))
    COMM.barrier()
    with open(folder / "frf.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["segment"] for row in rows] == sorted(row["segment"] for row in rows) and rows[-1]["segment"] == "1"
    level = read_results(folder / "results.h5").levels[0]
    assert level.status == "complete" and level.segment.tolist() == [int(row["segment"]) for row in rows]
    assert (
        "in two segments: followed from the other end of the range as well, since hb: a fold" in (folder / "run.log").read_text()
    )
