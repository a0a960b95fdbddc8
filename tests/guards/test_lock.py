"""One run a folder: who holds it is named, and who is gone is recognised."""

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
    monkeypatch.setattr(lock, "FIRST_WORDS", 0.1)


def held(folder):
    """Return what is said of who holds a folder."""
    with pytest.raises(CaseError) as problem, locked(SELF, folder):
        pass
    return str(problem.value)


def leave(folder, **changes):
    """Leave a file as a run that was killed does."""
    folder.mkdir(exist_ok=True)
    (folder / NAME).write_text(json.dumps(lock._self() | changes))


def test_a_second_run_is_refused_and_a_third_is_not(tmp_path, locks):
    folder = tmp_path / "results" / "fan"
    with locked(SELF, folder) as said:
        assert said == []
        told = held(folder)
        assert f"{folder}: another run is at work there by process {os.getpid()} on {socket.gethostname()}, begun 2" in told
        assert "choose another folder with --out" in told
        with locked(SELF, tmp_path / "other"):
            pass
    assert os.listdir(folder) == []
    with pytest.raises(ZeroDivisionError), locked(SELF, folder):
        raise ZeroDivisionError
    with locked(SELF, folder) as said:
        assert said == []


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
    with locked(SELF, tmp_path) as (said,):
        assert said.startswith(f"{tmp_path / NAME} was left behind by process {other.pid} on ") and said.endswith("taken over")


def test_a_number_that_another_process_has_now_is_no_holder(tmp_path, locks):
    leave(tmp_path, process=os.getpid(), started="another boot 5")
    with locked(SELF, tmp_path) as (said,):
        assert "was left behind" in said


def test_another_machine_is_at_work_while_it_touches_the_file(tmp_path, locks, quick, capfd):
    leave(tmp_path, host="elsewhere", job="")
    goes_on, touched = threading.Event(), tmp_path / NAME

    def touch():
        while not goes_on.wait(0.02):
            os.utime(touched)

    thread = threading.Thread(target=touch)
    thread.start()
    try:
        assert "on elsewhere" in held(tmp_path)
        assert f"{NAME} is that of another run; watching for 0 s whether it is at work" in capfd.readouterr().err
    finally:
        goes_on.set()
        thread.join()
    with locked(SELF, tmp_path) as (said,):
        assert "on elsewhere" in said and "taken over" in said
    assert os.listdir(tmp_path) == []


def test_a_job_that_was_put_into_the_queue_again_need_not_wait(tmp_path, monkeypatch):
    monkeypatch.setenv("SLURM_JOB_ID", "7")
    leave(tmp_path, host="elsewhere")
    began = time.monotonic()
    with locked(SELF, tmp_path) as (said,):
        assert "job 7" in said and time.monotonic() - began < 30.0


@pytest.mark.parametrize("text", ["", "no JSON", "[1]", '{"host": 3, "process": {}}'])
def test_a_file_that_says_nothing(tmp_path, text, locks, quick):
    (tmp_path / NAME).write_text(text)
    os.utime(tmp_path / NAME, (0, 0))
    with locked(SELF, tmp_path):
        assert held(tmp_path)


def test_what_somebody_else_took_over_is_not_taken_away(tmp_path):
    with locked(SELF, tmp_path):
        os.remove(tmp_path / NAME)
        (tmp_path / NAME).write_text("another's")
    assert (tmp_path / NAME).read_text() == "another's"


def test_a_folder_that_cannot_be(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CaseError, match="cannot be written"), locked(SELF, tmp_path / "file"):
        pass


def test_a_process_that_gets_no_thread_says_so_and_leaves_nothing(tmp_path, monkeypatch):
    def refuse(thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    with pytest.raises(ResourceError, match="no further thread; see ulimit -v"), locked(SELF, tmp_path):
        pass
    assert os.listdir(tmp_path) == []
