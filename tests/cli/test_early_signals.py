"""Signals that come while the program imports what it needs, before it can save anything."""

import signal

import pytest
from processes import python

# sends a signal to itself where mpi4py is looked for
EARLY = """
import os, runpy, signal, sys

signal.signal({number}, signal.SIG_DFL)  # where the shell ignores it

class Asked:
    def find_spec(self, name, *_):
        if name == "mpi4py":
            os.kill(os.getpid(), {number})

sys.meta_path.insert(0, Asked())
sys.argv = ["microslip", "run", "nothing.toml"]
runpy.run_module("microslip", run_name="__main__")
"""


def begun(tmp_path, number):
    return python("-c", EARLY.format(number=int(number)), cwd=tmp_path)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_one_that_stops_ends_the_program_with_its_own_status(tmp_path, number):
    done = begun(tmp_path, number)
    assert done.returncode == 5, done.stderr
    assert done.stderr == f"microslip: error: stopped by {number.name} before it had begun\n"


def test_one_that_asks_to_save_passes(tmp_path):
    done = begun(tmp_path, signal.SIGUSR1)
    assert done.returncode == 2 and "nothing.toml" in done.stderr
