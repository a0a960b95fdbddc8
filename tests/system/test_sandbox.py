"""A call in a sandbox: limits, returned values, inherited state, and its end with its parent."""

import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import sandboxed
from mpi4py import MPI
from processes import LIMIT, environment, wait_for

from microslip.guards.lock import locked
from microslip.messages.errors import MeshError
from microslip.system.sandbox import LibraryError, SandboxError, call

MANY = {"seconds": 60, "memory": 2**28}
TESTS = Path(__file__).parents[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "function, arguments, message",
    [
        (sandboxed.abort, (), r"crashes on it \(SIGABRT\)"),
        (sandboxed.fill, (2**30,), "requests more than"),
        (sandboxed.sleep, (), "does not end within 1 s$"),
        (sandboxed.circle, (), "does not end within 1 s of the processor"),
        (sandboxed.leave, (), "status 0 and no answer"),
    ],
)
def test_a_call_that_crashes_or_exceeds_a_limit_is_named(function, arguments, message):
    with pytest.raises(SandboxError, match=message):
        call(function, *arguments, seconds=1 if message.endswith("$") else 60, memory=2**28, processor=1)


def test_the_result_of_a_call_is_returned():
    answer, expected = call(sandboxed.answer, **MANY, returns=(sandboxed.Answer,)), sandboxed.answer()
    assert answer.array.dtype == expected.array.dtype and answer.matrix.format == "csc"
    np.testing.assert_array_equal(answer.array, expected.array)
    np.testing.assert_array_equal(answer.matrix.toarray(), expected.matrix.toarray())
    assert answer.table[1, "a"] == [None, True, 2**70] and answer.table[3].shape == (0, 3)
    assert answer.rest[0] == 0.1 and np.isnan(answer.rest[1]) and answer.rest[2:] == ("\udcff", 0.5, 1j)


def test_an_error_of_a_call_is_raised_with_its_type_or_trace():
    with pytest.raises(MeshError, match="^a text$"):
        call(sandboxed.fault, "a text", **MANY)
    with pytest.raises(LibraryError, match="^KeyError: 'a word'$") as problem:
        call(sandboxed.defect, "a word", **MANY)
    assert "in defect" in str(problem.value.__cause__)
    with pytest.raises(LibraryError, match="TypeError: a value of the type object is not sent"):
        call(sandboxed.unsent, **MANY)


def test_a_dataclass_not_listed_by_the_caller_is_rejected():
    with pytest.raises(SandboxError, match="no answer .KeyError: 'Answer'"):
        call(sandboxed.answer, **MANY)


def test_no_descriptor_and_no_launcher_is_inherited(tmp_path, monkeypatch):
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "1")
    with open(tmp_path / "lock", "w") as file:
        os.set_inheritable(file.fileno(), True)
        fcntl.flock(file, fcntl.LOCK_EX)
        answer = call(sandboxed.descriptors, **MANY)
    assert not [one for one in answer if str(tmp_path) in one] and len(answer) <= 5
    assert call(sandboxed.variables, **MANY) == []


HOLDER = """
import sandboxed, sys
from pathlib import Path
from mpi4py import MPI
from microslip.messages.errors import Interrupted
from microslip.guards.lock import locked
from microslip.system.signals import obey_signals
from microslip.system.sandbox import call
obey_signals()
try:
    with locked(MPI.COMM_SELF, Path(sys.argv[1])):
        call(sandboxed.name_and_sleep, sys.argv[2], seconds=60, memory=2**28)
except Interrupted:
    sys.exit(5)
"""


@pytest.mark.slow
@pytest.mark.parametrize("number, status", [(signal.SIGKILL, -9), (signal.SIGTERM, 5)])
def test_a_sandbox_ends_with_its_parent_and_leaves_no_lock(tmp_path, number, status):
    variables = environment(1) | {"PYTHONPATH": f"{TESTS}:{os.environ.get('PYTHONPATH', '')}"}
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "out"), str(tmp_path / "number")]
    with subprocess.Popen(command, env=variables) as parent:
        child = int(wait_for(tmp_path / "number"))
        parent.send_signal(number)
        assert parent.wait(LIMIT) == status
    deadline = time.monotonic() + 30.0  # its sleep is longer
    while is_alive(child):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    with locked(MPI.COMM_SELF, tmp_path / "out") as notes:
        assert len(notes) == (number == signal.SIGKILL)


def is_alive(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False
