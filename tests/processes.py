"""The program in processes of its own, on one or several ranks, as a user starts it."""

import os
import shutil
import subprocess
import sys
import time

LIMIT = 180.0  # s: longer is a hang, also where the cores are shared with others
MPIRUN = shutil.which(os.environ.get("MPIRUN", "mpirun")) or "mpirun"  # the path: a test may put its own in PATH


def environment(ranks: int = 2) -> dict[str, str]:
    """Return this process's environment without what MPI put into it: it would confuse another mpirun.

    One rank waits for nobody, and shall not yield its core to other tests in each call of MPI.
    """
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("OMPI_", "PMIX_", "PMI_", "ORTE_"))}
    return {
        **kept,
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_mpi_yield_when_idle": str(int(ranks > 1)),
        "OPENBLAS_NUM_THREADS": "1",
    }


def python(*arguments, ranks: int = 1, cwd=None, variables=None) -> subprocess.CompletedProcess:
    """Run Python with ``arguments`` on some ranks and return what came out; a hang is an error."""
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
