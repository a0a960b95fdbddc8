"""Time formats of users and schedulers, and the remaining time of a job."""

import json
import pickle
import time

import pytest

from microslip.system.walltime import TimeLimit, seconds_of, time_limit


@pytest.mark.parametrize(
    "text, seconds",
    [
        ("3600", 3600.0),
        ("90m", 5400.0),
        ("1h30m", 5400.0),
        ("1d2h", 93600.0),
        ("45s", 45.0),
        ("2:30", 150.0),
        ("01:30:00", 5400.0),
        ("1-12", 129600.0),
        ("1-12:30", 131400.0),
        ("1-12:30:05", 131405.0),
        (" 5 ", 5.0),
        ("UNLIMITED", None),
        ("INVALID", None),
        ("NOT_SET", None),
        ("", None),
        ("-5", None),
        ("30m1h", None),
        ("1:2:3:4", None),
        ("nan", None),
        ("9" * 400, None),
        ("٣", None),
    ],
)
def test_times(text, seconds):
    assert seconds_of(text) == seconds


def nothing(command):
    return ""


def test_without_a_scheduler_the_limit_is_that_of_the_option():
    assert time_limit(None, {}, nothing) is None
    limit = time_limit(60.0, {}, nothing)
    assert limit.source == "--walltime, 60 s" and 59.0 < limit.remaining <= 60.0


def test_the_limit_of_slurm_is_read_or_queried():
    limit = time_limit(None, {"SLURM_JOB_ID": "7", "SLURM_JOB_END_TIME": f"{int(time.time()) + 100}"}, nothing)
    assert limit.source == "the time limit of Slurm job 7" and 97.0 < limit.remaining <= 100.0
    commands = []

    def squeue(command):
        commands.append(command)
        return "1-00:01:00"

    assert time_limit(None, {"SLURM_JOB_ID": "7"}, squeue).seconds == 86460.0
    assert commands == [["squeue", "-h", "-j", "7", "-o", "%L"]]
    assert time_limit(None, {"SLURM_JOB_ID": "7"}, lambda command: "UNLIMITED") is None


def test_an_elapsed_end_time_is_ignored():
    assert time_limit(None, {"SLURM_JOB_ID": "7", "SLURM_JOB_END_TIME": "1000"}, nothing) is None


def test_the_limit_of_pbs_is_queried():
    began = time.strftime("%a %b %d %H:%M:%S %Y", time.localtime(time.time() - 600.0))
    job = {"Resource_List": {"walltime": "01:00:00"}, "resources_used": {"walltime": "00:05:00"}}
    environment = {"PBS_JOBID": "7.host", "PBS_WALLTIME": "120"}

    def left(job):
        return time_limit(None, environment, lambda command: json.dumps({"Jobs": {"7.host": job}})).seconds

    assert left(job) == 3300.0
    assert left(job | {"stime": began}) == pytest.approx(3000.0, abs=2.0)
    for answer in ("", "qstat: Unknown Job Id", "{}", '{"Jobs": {"7": 3}}', '{"Jobs": {"7": {"Resource_List": {}}}}'):
        assert time_limit(None, environment, lambda command, answer=answer: answer).seconds == 120.0


def test_the_shorter_of_two_limits_applies():
    environment = {"SLURM_JOB_ID": "7"}
    assert "Slurm" in time_limit(3600.0, environment, lambda command: "10:00").source
    assert "--walltime" in time_limit(300.0, environment, lambda command: "10:00").source


def test_a_missing_or_failing_scheduler_sets_no_limit(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert time_limit(None, {"SLURM_JOB_ID": "7"}) is None
    (tmp_path / "squeue").write_text("#!/bin/sh\necho 10:00\nexit 1\n")
    (tmp_path / "squeue").chmod(0o755)
    assert time_limit(None, {"SLURM_JOB_ID": "7"}) is None
    (tmp_path / "squeue").write_text("#!/bin/sh\necho 10:00\n")
    assert time_limit(None, {"SLURM_JOB_ID": "7"}).seconds == 600.0
    monkeypatch.setattr("microslip.system.walltime._PATIENCE", 0.2)
    (tmp_path / "squeue").write_text("#!/bin/sh\nexec /bin/sleep 60\n")
    assert time_limit(None, {"SLURM_JOB_ID": "7"}) is None


def test_the_remaining_time_is_sent_to_other_machines():
    limit = TimeLimit(100.0, "x", time.monotonic() - 40.0)
    assert pickle.loads(pickle.dumps(limit)).seconds == pytest.approx(60.0, abs=1.0)
