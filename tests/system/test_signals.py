"""Handling of signals in this process."""

import os
import signal
import time
from contextlib import suppress

import numpy as np
import pytest
from mpi4py import MPI
from synthetic_results import branch, two_flanks, writer_of

from microslip.messages.errors import Interrupted
from microslip.observe.log import RunLog
from microslip.results.read import read_results
from microslip.results.table import ResponseTable
from microslip.system import signals
from microslip.system.files import atomic_write
from microslip.system.signals import STOPPING, obey_signals, save_requested, unbroken


@pytest.fixture(autouse=True)
def obeyed():
    handlers = {number: signal.getsignal(number) for number in (*STOPPING, signal.SIGUSR1)}
    for number in STOPPING:  # what runs in the background of a shell inherits that SIGINT, under nohup that SIGHUP is ignored
        signal.signal(number, signal.SIG_DFL)
    obey_signals()
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)
    signals._Requests.to_stop = None


def send(number):
    os.kill(os.getpid(), number)


@pytest.mark.parametrize("number", STOPPING)
def test_the_first_signal_stops_and_further_signals_are_ignored(number):
    with pytest.raises(Interrupted, match=f"stopped by {number.name}"):
        send(number)
    for other in STOPPING:
        send(other)


def test_a_signal_to_save_is_reported_once_and_stops_nothing():
    assert not save_requested()
    send(signal.SIGUSR1)
    send(signal.SIGUSR1)
    assert save_requested() and not save_requested()


def test_a_file_in_progress_is_completed_before_a_stop(tmp_path):
    path = tmp_path / "file"
    path.write_text("before")
    with pytest.raises(Interrupted), atomic_write(str(path)) as beside, open(beside, "w") as file:
        send(signal.SIGTERM)
        file.write("after")
    assert path.read_text() == "after" and os.listdir(tmp_path) == ["file"]


def test_both_files_have_the_last_point_before_a_stop(tmp_path, monkeypatch):
    pairs = two_flanks(4, 1)
    curve, writer, add = branch(8.0, pairs, n_points=3), writer_of(tmp_path, pairs), ResponseTable.add
    writer.level_started(0, 8.0)
    writer.point(0, 0, curve.points[0])
    monkeypatch.setattr(ResponseTable, "add", lambda *args: (send(signal.SIGTERM), add(*args)))
    with pytest.raises(Interrupted):
        writer.point(0, 1, curve.points[1])
    writer.save()
    writer.close()
    (level,) = read_results(writer.path).levels
    table = np.loadtxt(tmp_path / "frf.csv", delimiter=",", skiprows=1, usecols=2)
    assert len(level.frequency) == 2 and table == pytest.approx(level.frequency)


def test_nested_blocks_and_an_error_in_one():
    with pytest.raises(Interrupted):
        with unbroken():
            with unbroken():
                send(signal.SIGTERM)
            done = True
        done = False
    assert done
    with unbroken():  # at the end of the program
        send(signal.SIGTERM)
    obey_signals()
    with pytest.raises(ZeroDivisionError), unbroken():
        send(signal.SIGTERM)
        raise ZeroDivisionError


def test_a_rank_that_does_not_save_continues_for_a_while(monkeypatch):
    monkeypatch.setattr(signals, "TO_FIRST", 0.1)
    obey_signals(is_first=False)
    went_on = False
    with pytest.raises(Interrupted, match="stopped by SIGTERM"):
        send(signal.SIGTERM)
        went_on = True
        time.sleep(60.0)
    assert went_on


def test_signals_ignored_by_the_caller_remain_ignored():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    obey_signals()
    send(signal.SIGHUP)
    with pytest.raises(Interrupted):
        send(signal.SIGTERM)


def test_a_stop_suppressed_by_a_library_is_raised_in_the_next_stage():
    """A module whose import is interrupted by a signal is taken for a missing module."""
    log = RunLog(MPI.COMM_SELF, screen=False)
    with suppress(BaseException):
        send(signal.SIGTERM)
    with pytest.raises(Interrupted, match="stopped by SIGTERM"), log.stage("the next"):
        raise AssertionError("it began")


def test_an_error_that_a_library_makes_of_a_stop_is_the_stop():
    log = RunLog(MPI.COMM_SELF, screen=False)
    with pytest.raises(Interrupted, match="stopped by SIGTERM"), log.stage("one with an import"):
        try:
            send(signal.SIGTERM)
        except Interrupted:
            raise ImportError("initialization failed") from None
