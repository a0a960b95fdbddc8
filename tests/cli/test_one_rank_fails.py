"""A failure of one rank ends the job within ten seconds, with its cause on standard error, and no rank remains."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from bar_scene import write_bar
from faults import microslip_with
from processes import LIMIT, MPIRUN, environment

pytestmark = pytest.mark.slow
AFTER = 10.0  # s


def left_behind(folder, until):
    """Return the processes that still work in a folder at a given time."""
    while (computed := at_work(folder)) and time.monotonic() < until:
        time.sleep(0.1)
    return computed


def at_work(folder):
    """Return the processes that work in a folder."""
    values = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if os.readlink(entry / "cwd") == str(folder):
                    values.append(entry.name)
            except OSError:  # it has ended, or belongs to another user
                continue
    return values


@pytest.mark.parametrize(
    "moment, fault, rank, status, cause",
    [
        ("point:3", "kill", 1, {137}, "process rank 1 with PID"),
        # mpirun reports the end by PETSc's handler, or the signal if that is detected first
        ("stage:modes", "segfault", 0, {59, 139}, "Fatal Python error: Segmentation fault"),
    ],
)
def test_a_failure_of_one_rank_ends_both(tmp_path, moment, fault, rank, status, cause):
    write_bar(tmp_path)
    done = microslip_with(moment, fault, rank, "run", "bar.toml", "--out", "out", ranks=2, cwd=tmp_path)
    assert done.status in status and cause in done.err
    assert done.after is not None and done.after < AFTER
    assert left_behind(tmp_path, time.monotonic() + AFTER - done.after) == []


def test_a_signal_to_mpirun_is_passed_to_the_ranks_which_save(tmp_path):
    write_bar(tmp_path)
    slowly = "response.points=20000"
    command = [MPIRUN, "--oversubscribe", "-n", "2", sys.executable, "-m", "microslip", "run", "bar.toml", "--out", "out"]
    waits = environment() | {"OMPI_MCA_odls_base_sigkill_timeout": "3"}
    job = subprocess.Popen(
        [*command, "--set", slowly], cwd=tmp_path, env=waits, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    table, deadline = tmp_path / "out" / "frf.csv", time.monotonic() + LIMIT
    try:
        while not (table.exists() and len(table.read_text().splitlines()) > 5):
            assert time.monotonic() < deadline and job.poll() is None
            time.sleep(0.05)
        os.kill(job.pid, signal.SIGTERM)
        began = time.monotonic()
        messages = job.communicate(timeout=LIMIT)[1]
    finally:
        job.kill()
    assert job.returncode != 0 and time.monotonic() - began < AFTER
    assert messages.count("microslip: error: stopped by SIGTERM; what was computed until then is in out") == 1
    with h5py.File(tmp_path / "out" / "results.h5") as file:
        saved = file["levels/0000/frequency_Hz"][:]
        assert file["levels/0000"].attrs["status"] == "running"
    assert np.allclose(saved, np.loadtxt(table, delimiter=",", skiprows=1, usecols=2))
    assert left_behind(tmp_path, began + AFTER) == []
