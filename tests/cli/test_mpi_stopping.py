"""Runs stopped by a signal or before a time limit: one message, status 5 on all ranks, and every point in the files."""

import json
import os
import signal

import h5py
import numpy as np
import pytest
from bar_scene import write_bar

from microslip.continuation import acceptance
from microslip.guards import lock
from microslip.guards.lock import NAME
from microslip.observe.stops import Stops
from microslip.parallel.agree import on_root
from microslip.restart.results_folder import UNFINISHED

record = acceptance.point_record


@pytest.fixture
def scene(comm, shared_path):
    return on_root(comm, write_bar, shared_path)


@pytest.fixture
def at_point_3(comm, monkeypatch):
    """Return a function that arranges an event during point 3, on rank 0."""

    def set_up(happens):
        numbers = iter(range(1000))

        def with_event(*arguments, **named):
            if next(numbers) == 3 and comm.rank == 0:
                happens()
            return record(*arguments, **named)

        monkeypatch.setattr(acceptance, "point_record", with_event)

    return set_up


def points(out):
    """Return the frequencies in the table, those in results.h5, and the status of the level there.  Local."""
    with h5py.File(out / "results.h5") as file:
        level = file["levels/0000"]
        return np.loadtxt(out / "frf.csv", delimiter=",", skiprows=1, usecols=2), level["frequency_Hz"][:], level.attrs["status"]


def test_sigusr1_saves_and_the_run_continues(program, scene, comm, shared_path, at_point_3, monkeypatch):
    saved_in_time, save = [], Stops._save_in_time

    def saves(self):
        save(self)
        saved_in_time.append(points(shared_path / "out"))

    monkeypatch.setattr(Stops, "_save_in_time", saves)
    at_point_3(lambda: os.kill(os.getpid(), signal.SIGUSR1))
    status, _, err = program("run", scene, "--out", shared_path / "out")
    assert (status, err) == (0, "")
    if comm.rank == 0:
        ((table, saved, state),) = saved_in_time
        assert state == "running" and 3 <= len(saved) <= 5 and np.allclose(saved, table)
        table, saved, state = points(shared_path / "out")
        assert state == "complete" and len(saved) == len(table) > 5
        assert "saved by SIGUSR1" in (shared_path / "out" / "run.log").read_text()
        assert not (shared_path / "out" / NAME).exists()


def test_the_time_limit_stops_all_ranks_before_its_end(program, scene, comm, shared_path, at_point_3, monkeypatch):
    at_point_3(lambda: monkeypatch.setattr("microslip.observe.stops.LEAST_MARGIN", 1e6))
    status, _, err = program("run", scene, "--walltime", "1:00:00", "--out", shared_path / "out")
    assert status == 5 and err.count("microslip: error: ") == 1 and "(rank" not in err
    assert "s before the end of --walltime, 3600 s; what was computed until then is in" in err
    assert "the same command continues from there" in err
    if comm.rank == 0:
        table, saved, state = points(shared_path / "out")
        assert state == "running" and 3 <= len(saved) <= 5 and np.allclose(saved, table)
        log = (shared_path / "out" / "run.log").read_text()
        assert log.count("s are left by --walltime, 3600 s") == 1 and "ended by Interrupted: stopped" in log
        assert not (shared_path / "out" / NAME).exists()
    monkeypatch.undo()
    monkeypatch.setattr("microslip.results.draw.draw_share", lambda *share: None)
    status, _, err = program("run", scene, "--out", shared_path / "out")
    assert (status, err) == (0, "")
    if comm.rank == 0:
        _, whole, state = points(shared_path / "out")
        assert state == "complete" and len(whole) > len(saved) and np.allclose(whole[: len(saved)], saved, rtol=1e-9)


def test_the_time_limit_stops_groups(program, scene, comm, shared_path, at_point_3, monkeypatch):
    at_point_3(lambda: monkeypatch.setattr("microslip.observe.stops.LEAST_MARGIN", 1e6))
    more = ("--set", "response.levels=[10.0,20.0,30.0]", "--groups", comm.size)
    status, _, err = program("run", scene, *more, "--walltime", "60m", "--out", shared_path / "out")
    assert status == 5 and err.count("microslip: error: stopped ") == 1


@pytest.mark.ranks(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_stops_with_every_point_saved(program, scene, shared_path, at_point_3, number):
    at_point_3(lambda: [signal.raise_signal(each) for each in (number, signal.SIGTERM)])
    inherited = signal.signal(number, signal.SIG_DFL)  # under nohup SIGHUP is ignored, and the program does not change that
    status, _, err = program("run", scene, "--out", shared_path / "out")
    signal.signal(number, inherited)
    assert status == 5 and err.count(f"microslip: error: stopped by {number.name}; what was computed until then is in") == 1
    table, saved, state = points(shared_path / "out")
    assert state == "running" and len(saved) >= 2 and np.allclose(saved, table)


def test_a_folder_in_use_is_rejected_on_all_ranks(program, scene, comm, shared_path):
    out = shared_path / "out"
    if comm.rank == 0:
        out.mkdir()
        (out / "frf.csv").write_text("the other's")
    with lock.locked(comm, out):
        for command in ("run", "export"):
            status, _, err = program(command, scene, "--out", out)
            assert status == 2 and err.count("microslip: error: ") == 1 and "another run is at work there by process" in err
    if comm.rank == 0:
        assert [file.name for file in out.iterdir()] == ["frf.csv"] and (out / "frf.csv").read_text() == "the other's"
        (out / NAME).write_text(json.dumps(lock._self() | {"process": 1, "started": "long ago"}))
    comm.Barrier()
    status, _, err = program("run", scene, "--walltime", "1s", "--out", out)
    assert status == 5
    if comm.rank == 0:
        assert f"{out / NAME} was left behind by process 1" in (out / UNFINISHED / "run.log").read_text()


@pytest.mark.ranks(1)
@pytest.mark.parametrize("text", ["0", "soon", "1h1d", "-3"])
def test_an_invalid_time_limit_is_rejected(program, scene, text):
    status, _, err = program("run", scene, f"--walltime={text}")
    assert status == 2 and f"argument --walltime: '{text}' is not a time above 0" in err


@pytest.mark.ranks(1)
@pytest.mark.parametrize("arguments", ["verify {} --levels 1", "compare {} --methods full"])
def test_a_command_without_checkpoints_says_that_it_starts_from_the_beginning(program, scene, shared_path, at_point_3, arguments):
    at_point_3(lambda: os.kill(os.getpid(), signal.SIGTERM))
    status, _, err = program(*arguments.format(scene).split(), "--out", shared_path / "out")
    name = arguments.split()[0]
    assert status == 5 and err.count("microslip: error: stopped by SIGTERM") == err.count("microslip: error: ") == 1
    assert err.endswith(f"; {name} stores no intermediate results, and the same command starts from the beginning\n")
