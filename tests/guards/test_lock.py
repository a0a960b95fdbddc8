"""One run per folder: the run that locks it is named, and a lock of an ended run is recognised."""

import errno
import fcntl
import json
import os
import socket
import subprocess
import sys
import threading
import time

import pytest
from mpi4py import MPI

from microslip.guards import lock
from microslip.guards.lock import NAME, locked
from microslip.messages.errors import CaseError, ResourceError

SELF = MPI.COMM_SELF


@pytest.fixture(params=["flock", "none"])
def locks(request, monkeypatch):
    """File systems with and without locks."""

    def refuse(handle, how):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    if request.param == "none":
        monkeypatch.setattr(fcntl, "flock", refuse)
    return request.param


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(lock, "STILL", 0.4)
    monkeypatch.setattr(lock, "FIRST_CONTENT", 0.1)


def held(folder):
    """Return the message on the owner of a folder's lock."""
    with pytest.raises(CaseError) as problem, locked(SELF, folder):
        pass
    return str(problem.value)


def leave(folder, **changes):
    """Write a file as left by a killed run."""
    folder.mkdir(exist_ok=True)
    (folder / NAME).write_text(json.dumps(lock._self() | changes))


def test_a_second_run_is_rejected_and_a_later_one_is_not(tmp_path, locks):
    folder = tmp_path / "results" / "fan"
    with locked(SELF, folder) as notes:
        assert notes == []
        message = held(folder)
        assert f"{folder}: another run is at work there by process {os.getpid()} on {socket.gethostname()}, begun 2" in message
        assert "choose another folder with --out" in message
        with locked(SELF, tmp_path / "other"):
            pass
    assert os.listdir(folder) == []
    with pytest.raises(ZeroDivisionError), locked(SELF, folder):
        raise ZeroDivisionError
    with locked(SELF, folder) as notes:
        assert notes == []


def test_a_process_that_was_killed_is_recognised(tmp_path, locks):
    program = "import sys, time; from microslip.guards.lock import locked; from mpi4py import MPI; from pathlib import Path\n"
    program += "with locked(MPI.COMM_SELF, Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
    other = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    try:
        assert other.stdout.readline() == "held\n"
        assert f"by process {other.pid} on " in held(tmp_path)
    finally:
        other.kill()
        other.wait()
    with locked(SELF, tmp_path) as (notes,):
        assert notes.startswith(f"{tmp_path / NAME} was left behind by process {other.pid} on ") and notes.endswith("taken over")


def test_a_process_number_in_use_by_another_program_is_no_owner(tmp_path, locks):
    leave(tmp_path, process=os.getpid(), started="another boot 5")
    with locked(SELF, tmp_path) as (notes,):
        assert "was left behind" in notes


def test_another_machine_owns_the_lock_while_it_updates_the_file(tmp_path, locks, quick, capfd):
    leave(tmp_path, host="elsewhere", job="")
    goes_on, touched = threading.Event(), tmp_path / NAME

    def touch():
        while not goes_on.wait(0.02):
            os.utime(touched)

    thread = threading.Thread(target=touch)
    thread.start()
    try:
        assert "on elsewhere" in held(tmp_path)
        assert f"{NAME} belongs to another run; waiting 0 s to see whether that run is still at work" in capfd.readouterr().err
    finally:
        goes_on.set()
        thread.join()
    with locked(SELF, tmp_path) as (notes,):
        assert "on elsewhere" in notes and "taken over" in notes
    assert os.listdir(tmp_path) == []


def test_a_requeued_job_need_not_wait(tmp_path, monkeypatch):
    monkeypatch.setenv("SLURM_JOB_ID", "7")
    leave(tmp_path, host="elsewhere")
    began = time.monotonic()
    with locked(SELF, tmp_path) as (notes,):
        assert "job 7" in notes and time.monotonic() - began < 30.0


@pytest.mark.parametrize("text", ["", "no JSON", "[1]", '{"host": 3, "process": {}}'])
def test_a_lock_file_without_information(tmp_path, text, locks, quick):
    (tmp_path / NAME).write_text(text)
    os.utime(tmp_path / NAME, (0, 0))
    with locked(SELF, tmp_path):
        assert held(tmp_path)


def test_a_lock_taken_over_by_another_run_is_not_deleted(tmp_path):
    with locked(SELF, tmp_path):
        os.remove(tmp_path / NAME)
        (tmp_path / NAME).write_text("another's")
    assert (tmp_path / NAME).read_text() == "another's"


def test_an_impossible_folder_is_rejected(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CaseError, match="cannot be written"), locked(SELF, tmp_path / "file"):
        pass


def test_a_process_without_further_threads_reports_it_and_leaves_no_file(tmp_path, monkeypatch):
    def refuse(thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    with pytest.raises(ResourceError, match="no further thread; see ulimit -v"), locked(SELF, tmp_path):
        pass
    assert os.listdir(tmp_path) == []
