"""The end of the program: one message, one status, and no rank left waiting, for any event on any rank."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from processes import LIMIT, MPIRUN, environment, python, wait_for

from microslip.guards.ending import conclude, expected, no_exit
from microslip.messages.errors import CaseError, ConvergenceError, Interrupted, ResourceError
from microslip.system.watchdog import wrong_limit

ENDINGS = Path(__file__).with_name("endings.py")


@pytest.mark.parametrize(
    "problem, status",
    [
        (CaseError("x"), 2),
        (ConvergenceError("x"), 3),
        (ResourceError("x"), 4),
        (Interrupted("x"), 5),
        (MemoryError(), 4),
        (OSError(errno.ENOSPC, "No space left on device", "frf.csv"), 4),
        (KeyboardInterrupt(), 5),
    ],
)
def test_each_problem_has_its_status(problem, status, capsys):
    def action():
        raise problem

    assert conclude(None, action) == status
    messages = capsys.readouterr().err
    assert messages.count("microslip: error: ") == 1
    assert "Traceback" not in messages


def test_a_full_disk_is_named_with_its_file():
    assert "frf.csv: No space left on device" in str(expected(OSError(errno.ENOSPC, "No space left on device", "frf.csv")))


def test_a_defect_shows_its_traceback(capsys):
    assert conclude(None, lambda: 1 // 0) == 70
    messages = capsys.readouterr().err
    assert "a defect of the program" in messages
    assert "ZeroDivisionError" in messages


def test_a_successful_end_prints_nothing(capsys):
    assert conclude(None, lambda: None) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "ending, status, message",
    [
        ("agreed", 2, "the first is wrong (rank 1; 1 of 2 ranks affected)"),
        ("alone_while_others_wait", 3, "one rank did not converge (rank 1 of 2, alone)"),
        ("alone_after_others_finished", 3, "one rank did not converge"),
        ("defect_while_others_wait", 70, "a defect of the program on rank 1 of 2"),
        ("out_of_memory", 4, "not enough memory"),
    ],
)
def test_two_ranks_end_with_one_message(ending, status, message):
    done = python(ENDINGS, ending, ranks=2)
    assert done.returncode == status
    assert done.stderr.count("microslip: error: ") == 1
    assert message in done.stderr
    assert ("Traceback" in done.stderr) == (status == 70)


def test_a_signal_to_one_rank_ends_both(tmp_path):
    command = [MPIRUN, "--oversubscribe", "-n", "2", sys.executable, str(ENDINGS), "waits_for_a_signal", str(tmp_path / "pid")]
    job = subprocess.Popen(command, env=environment(), stderr=subprocess.PIPE, text=True)
    try:
        wait_for(tmp_path / "pid0")
        os.kill(int(wait_for(tmp_path / "pid1")), signal.SIGTERM)
        messages = job.communicate(timeout=LIMIT)[1]
    finally:
        job.kill()
    assert job.returncode == 5
    assert messages.count("microslip: error: stopped by SIGTERM\n") == 1  # of the first rank, to which it was passed on


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_signal_during_a_long_call_ends_the_run(tmp_path, ranks):
    done = python(ENDINGS, "calls_without_an_answer", tmp_path / "out", ranks=ranks)
    assert done.returncode == 5  # a run that does not end exceeds the limit of `python`
    assert done.stderr.count("microslip: error: ") == 1
    assert "stopped by SIGTERM during a call that takes longer than 1 s; the results are elsewhere" in done.stderr
    assert list((tmp_path / "out").iterdir()) == []


def test_a_signal_to_mpirun_during_a_long_call_is_reported(tmp_path):
    command = [
        MPIRUN,
        "--oversubscribe",
        "-n",
        "2",
        sys.executable,
        str(ENDINGS),
        "waits_without_an_answer",
        str(tmp_path / "pid"),
    ]
    job = subprocess.Popen(command, env=environment(), stderr=subprocess.PIPE, text=True)
    try:
        for rank in range(2):
            wait_for(tmp_path / f"pid{rank}")
        job.send_signal(signal.SIGTERM)
        messages = job.communicate(timeout=LIMIT)[1]
    finally:
        job.kill()
    assert job.returncode not in (0, None)
    assert messages.count("microslip: SIGTERM arrived: the call in progress may end within 1 s; the results are elsewhere\n") == 1


def test_a_first_rank_that_waits_at_its_end_prints_its_message():
    done = python(ENDINGS, "hangs_on_its_way_out", ranks=2)
    assert done.returncode == 5
    assert done.stderr.count("microslip: error: stopped by SIGTERM\n") == 1 == done.stderr.count("microslip: error: ")


def test_a_run_that_hangs_after_its_message_ends():
    done = python(ENDINGS, "says_and_hangs")
    assert done.returncode == 5 and done.stderr == "microslip: error: stopped by SIGTERM\n"


def test_a_signal_at_the_very_end_changes_nothing():
    done = python(ENDINGS, "is_stopped_at_the_very_end")
    assert (done.returncode, done.stderr) == (0, "")


def test_deadlocked_ranks_print_their_stacks_and_end():
    done = python(ENDINGS, "hangs", ranks=2, variables={"MICROSLIP_WATCHDOG": 2})
    assert done.returncode not in (0, 5) and done.stderr.count("endings.py") >= 3
    first, *last = done.stderr.split("Timeout (0:00:02)!")
    assert last and first.count(" in hangs") == 2


def test_a_rank_that_makes_progress_is_not_ended():
    done = python(ENDINGS, "moves", variables={"MICROSLIP_WATCHDOG": 4})
    assert (done.returncode, done.stderr) == (0, "")


def test_a_long_call_is_not_ended():
    done = python(ENDINGS, "calls_long", variables={"MICROSLIP_WATCHDOG": 2.5})
    assert done.returncode == 0 and " in calls_long" not in done.stderr  # a busy machine needs longer to end the interpreter


def test_after_a_long_call_the_usual_limit_applies():
    done = python(ENDINGS, "calls_long_and_hangs", variables={"MICROSLIP_WATCHDOG": 1})
    assert done.returncode not in (0, 5) and "Timeout (0:00:01)!" in done.stderr and " in calls_long_and_hangs" in done.stderr


@pytest.mark.parametrize("text", ["soon", "-1", "nan", "1e9"])
def test_an_invalid_limit_of_the_watchdog_is_rejected(monkeypatch, text):
    monkeypatch.setenv("MICROSLIP_WATCHDOG", text)
    assert f"MICROSLIP_WATCHDOG={text}: a number of seconds is expected" in wrong_limit()


@pytest.mark.parametrize("text", ["", "0", "3600", "2.5"])
def test_valid_limits_of_the_watchdog_are_accepted(monkeypatch, text):
    monkeypatch.setenv("MICROSLIP_WATCHDOG", text)
    assert wrong_limit() is None


def test_an_exit_during_the_work_is_a_defect(capsys):
    def action():
        with no_exit():
            sys.exit(0)

    assert conclude(None, action) == 70
    assert "sys.exit(0) was called in the middle of the work" in capsys.readouterr().err
