"""The program in separate processes, on one or several ranks, as started by a user."""

import os
import shutil
import subprocess
import sys
import time

LIMIT = 180.0  # s: longer is a hang, even if the cores are shared with other processes
MPIRUN = shutil.which(os.environ.get("MPIRUN", "mpirun")) or "mpirun"  # full path: a test may change PATH


def environment(ranks: int = 2) -> dict[str, str]:
    """Return this process's environment without the variables of MPI, which would disturb another mpirun.

    A single rank does not yield its core in each call of MPI.
    """
    variables = {name: value for name, value in os.environ.items() if not name.startswith(("OMPI_", "PMIX_", "PMI_", "ORTE_"))}
    return {
        **variables,
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_mpi_yield_when_idle": str(int(ranks > 1)),
        "OPENBLAS_NUM_THREADS": "1",
    }


def python(*arguments, ranks: int = 1, cwd=None, variables=None) -> subprocess.CompletedProcess:
    """Run Python with ``arguments`` on some ranks and return its output; a hang is an error."""
    env = environment(ranks) | {name: str(value) for name, value in (variables or {}).items()}
    launcher = [MPIRUN, "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []
    command = [*launcher, sys.executable, *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, timeout=LIMIT, check=False)


def microslip(*arguments, ranks: int = 1, cwd=None) -> subprocess.CompletedProcess:
    """Run the program; see :func:`python`."""
    return python("-m", "microslip", *arguments, ranks=ranks, cwd=cwd)


def wait_for(path) -> str:
    """Return the text of a file as soon as another process has written it."""
    deadline = time.monotonic() + LIMIT
    while not (path.exists() and path.read_text().endswith("\n")):
        assert time.monotonic() < deadline, f"{path} was not written"
        time.sleep(0.02)
    return path.read_text()
