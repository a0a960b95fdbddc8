"""Signals that arrive during the imports of the program, before it can save anything, and after its end."""

import signal
from pathlib import Path

import pytest
from processes import python

SCENE = Path(__file__).parents[2] / "jobs" / "jenkins.toml"
# sends a signal to this process when mpi4py is imported
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
def test_a_stopping_signal_ends_the_program_with_status_5(tmp_path, number):
    done = begun(tmp_path, number)
    assert done.returncode == 5, done.stderr
    assert done.stderr == f"microslip: error: stopped by {number.name} before it had begun\n"


@pytest.mark.parametrize("module", ["numpy", "pydantic"])
def test_a_signal_is_not_reported_as_a_failed_import(tmp_path, module):
    """C code that imports NumPy reports any exception as a missing NumPy."""
    kill = f"            os.kill(os.getpid(), {int(signal.SIGTERM)})\n"
    swallowed = (
        "            try:\n    "
        + kill
        + '            except BaseException:\n                raise ImportError("failed to import")\n'
    )
    script = EARLY.format(number=int(signal.SIGTERM)).replace(kill, swallowed).replace('"mpi4py"', f'"{module}"')
    done = python("-c", script, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (5, "microslip: error: stopped by SIGTERM\n")


def test_a_signal_to_save_is_ignored_before_the_run(tmp_path):
    done = begun(tmp_path, signal.SIGUSR1)
    assert done.returncode == 2 and "nothing.toml" in done.stderr


@pytest.mark.parametrize("module", ["mpi4py", "pydantic"])
def test_a_signal_to_another_rank_is_reported_by_rank_0(tmp_path, module):
    """Rank 0 starts later; rank 1 waits until it can pass the signal on, before and after it handles signals itself."""
    script = EARLY.format(number=int(signal.SIGTERM)).replace('if name == "mpi4py"', f'if name == "{module}" and rank == "1"')
    script = script.replace("nothing.toml", str(SCENE))
    start = 'import os, time\nrank = os.environ["OMPI_COMM_WORLD_RANK"]\ntime.sleep(0.3 if rank == "0" else 0.0)\n'
    done = python("-c", start + script, ranks=2, cwd=tmp_path)
    assert done.returncode == 5, done.stderr
    assert done.stderr.count("microslip: error: stopped by SIGTERM") == done.stderr.count("microslip: error") == 1
    assert "computed" not in done.stderr, "rank 0 was notified before the run began"


LATE = """
import ctypes, os, signal
from microslip.parallel.petsc import initialise
from microslip.system.signals import ignore_signals

PETSc, _ = initialise()
ignore_signals()
ctypes.CDLL(PETSc.__file__).PetscFinalize()
for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGUSR1):
    os.kill(os.getpid(), number)
os._exit(0)
"""


def test_a_signal_after_the_end_of_petsc_does_not_change_the_status(tmp_path):
    assert python("-c", LATE, cwd=tmp_path).returncode == 0
