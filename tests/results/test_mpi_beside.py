"""Processes beside a run draw their share of the pictures; what they do not draw, the run does."""

import os
from pathlib import Path

import pytest
from mpi4py import MPI
from synthetic_results import branch, two_flanks, write

from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.results import beside
from microslip.results.beside import Drawers
from microslip.results.draw import draw
from microslip.results.plots import PICTURES

COMM = MPI.COMM_WORLD
DRAWN = ("response", "states", "slip_map", "rom_size", "energy", "energy_map")  # of results without error bars and statics
pytestmark = pytest.mark.ranks(1, 2)


@pytest.fixture
def results(shared_path):
    pairs = two_flanks(5, 1)
    return Path(on_root(COMM, lambda: write(shared_path, [branch(1.0, pairs)], pairs)))


@pytest.fixture
def two_beside(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(3 * COMM.size))
    monkeypatch.delenv(beside.VARIABLE)


def pictures_in(folder):
    COMM.barrier()
    return on_root(COMM, lambda: sorted(path.name for path in folder.glob("*.png")))


@pytest.mark.slow
def test_every_picture_is_drawn_once(results, two_beside, monkeypatch):
    own = []
    monkeypatch.setattr("microslip.results.draw.draw_share", lambda _, share: own.append(share))
    with Drawers(COMM) as drawers:
        drawers.begin(results, results.parent)
        draw(COMM, results.parent, drawers)
    assert own == [slice(3 * (COMM.size - COMM.rank) - 1, None, 3 * COMM.size)]
    theirs = [one.__name__.removeprefix("draw_") for i, one in enumerate(PICTURES) if i % 3 < 2]
    assert pictures_in(results.parent) == sorted(f"{name}.png" for name in theirs if name in DRAWN)


def test_what_a_process_does_not_draw_the_run_draws(results, two_beside, monkeypatch):
    own = []
    monkeypatch.setattr("microslip.results.draw.draw_share", lambda _, share: own.append(share.start))
    with Drawers(COMM) as drawers:
        for one in drawers._processes:
            one.process.kill()
            one.process.wait()
        drawers.begin(results, results.parent)
        draw(COMM, results.parent, drawers)
    assert own == [3 * (COMM.size - COMM.rank) - 1 - i for i in range(3)]


def test_without_cores_to_spare_ranks_draw_all_of_it(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(COMM.size))
    with Drawers(COMM) as drawers:
        assert drawers.own == slice(COMM.size - 1 - COMM.rank, None, COMM.size) and drawers.left() == []


@pytest.mark.slow
def test_what_a_process_meets_is_raised_on_every_rank(results, two_beside, monkeypatch):
    monkeypatch.setattr("microslip.results.draw.draw_share", lambda *share: None)
    with Drawers(COMM) as drawers, pytest.raises(CaseError, match=r"nowhere\.h5"):
        drawers.begin(results.with_name("nowhere.h5"), results.parent)
        draw(COMM, results.parent, drawers)


def test_they_are_no_ranks_of_the_job_and_end_when_nobody_asks(two_beside, monkeypatch):
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    seen = []
    popen = beside.subprocess.Popen
    monkeypatch.setattr(beside.subprocess, "Popen", lambda *args, **keys: seen.append(keys["env"]) or popen(*args, **keys))
    with Drawers(COMM) as drawers:
        processes = [one.process for one in drawers._processes]
    assert len(seen) == 2 and not any(key.startswith(("OMPI_", "PMI", "SLURM_")) for each in seen for key in each)
    assert all(process.poll() is not None for process in processes)


@pytest.mark.parametrize(("cores", "said", "n"), [(1, None, 0), (2, None, 1), (16, None, 3), (16, "1", 1), (16, "0", 0)])
def test_cores_that_no_rank_uses_have_one_each(cores, said, n, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(cores * COMM.size))
    monkeypatch.delenv(beside.VARIABLE) if said is None else monkeypatch.setenv(beside.VARIABLE, said)
    assert beside.spare(COMM) == n
