"""What all tests share: PETSc and MPI started first, one rank that reports, and no rank left waiting for a failed one."""

import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ["MPLBACKEND"] = "Agg"

from microslip.parallel.petsc import initialise

initialise()

import hypothesis
import pytest
from mpi4py import MPI

COMM = MPI.COMM_WORLD

# the same examples on every machine, rank and day, and few enough for every push
hypothesis.settings.register_profile("steady", derandomize=True, database=None, deadline=None, max_examples=25)
hypothesis.settings.load_profile("steady")


@pytest.fixture(scope="session")
def comm():
    """All ranks of the test run; one, two or three."""
    return COMM


@pytest.fixture
def shared_path(tmp_path):
    """A new empty folder, the same one on all ranks.  Collective."""
    return COMM.bcast(tmp_path)


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if COMM.rank > 0 and reporter is not None:
        config.pluginmanager.unregister(reporter)


@pytest.hookimpl(trylast=True)
def pytest_runtest_logreport(report):
    _end_job_after(report)


@pytest.hookimpl(trylast=True)
def pytest_collectreport(report):
    _end_job_after(report)


def _end_job_after(report):
    """End all ranks after a failure on this one: the others may wait for it in a collective call."""
    if report.failed and COMM.size > 1:
        sys.stderr.write(f"\nrank {COMM.rank} of {COMM.size}: {report.nodeid} failed\n{report.longreprtext}\n")
        sys.stderr.flush()
        COMM.Abort(1)
