"""Set-up of all tests: PETSc and MPI are started first, one rank reports, and a failure on one rank ends all."""

import gc
import os
import signal
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ["MPLBACKEND"] = "Agg"
os.environ["MICROSLIP_CACHE"] = "off"  # structures are built, not cached; tests of the cache name a folder

from microslip.parallel.petsc import initialise
from microslip.system.signals import STOPPING

initialise()

import hypothesis
import pytest
from mpi4py import MPI
from petsc4py import PETSc

COMM = MPI.COMM_WORLD

# The same examples on every machine and rank, and few of them; without the constants of imported modules, which
# would change them with the sources, and for which every process would also read NumPy's and SciPy's, for seconds.  The name
# is not part of Hypothesis' interface: a version without it is only slower, or draws other examples.
providers = sys.modules.get("hypothesis.internal.conjecture.providers")
if hasattr(providers, "is_local_module_file"):
    providers.is_local_module_file = lambda path: False
hypothesis.settings.register_profile("steady", derandomize=True, database=None, deadline=None, max_examples=25)
hypothesis.settings.load_profile("steady")


@pytest.fixture(scope="session")
def comm():
    """Return the communicator of the test run, of one, two or three ranks."""
    return COMM


@pytest.fixture
def shared_path(tmp_path):
    """Return a new empty folder, the same on all ranks.  Collective."""
    return COMM.bcast(tmp_path)


@pytest.fixture
def options():
    """Set PETSc's options by name, and delete them after the test."""
    database, names = PETSc.Options(), []

    def set_to(**values):
        for name, value in values.items():
            names.append(name)
            database[name] = value

    yield set_to
    for name in names:
        database.delValue(name)


PICTURES = (
    "backbone.report.draw_backbone",
    "backbone.report.draw_forced",
    "compare.report.draw_comparison",
    "modes.campbell.draw_campbell",
    "modes.disc_at_speed.draw_interference",  # before that of `disc`, which it imports by name
    "modes.disc.draw_interference",
    "modes.report.draw_shapes",
    "search.report.draw",
    "sweep.report.draw_effects",
    "sweep.report.draw_grid",
    "sweep.report.draw_map",
    "sweep.report.draw_scatter",
    "trade.speed_plots.draw_trade",
    "verify.report.draw_verification",
    "wear.report.draw_pictures",
)


@pytest.fixture
def program(comm, capfd, monkeypatch, request):
    """Return a function of the program's arguments that returns status and messages of all ranks.  Collective.

    It runs in this process, and draws no pictures of a run, which have separate tests.  Those of the studies are drawn in tests
    that are marked ``pictures``.
    """
    from microslip.__main__ import main

    handlers = {number: signal.getsignal(number) for number in (*STOPPING, signal.SIGUSR1)}
    monkeypatch.setattr("microslip.results.draw.draw_share", lambda *share: None)
    for name in PICTURES if request.node.get_closest_marker("pictures") is None else ():
        monkeypatch.setattr(f"microslip.studies.{name}", lambda *drawn: None)

    def run(*arguments):
        status = main([str(argument) for argument in arguments])
        assert len(set(comm.allgather(status))) == 1
        messages = capfd.readouterr()
        return status, "".join(comm.allgather(messages.out)), "".join(comm.allgather(messages.err))

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


def pytest_addoption(parser):
    parser.addoption("--unless-on", type=int, metavar="N", help="deselect tests that also run on N ranks")
    parser.addoption(
        "--rooms", default="", help="folders of tests to which --unless-on applies, and `slow` for tests so marked; default: all"
    )


def pytest_collection_modifyitems(config, items):
    """Deselect tests that are not for this number of ranks: the mark ``ranks`` of a test or its file lists the numbers.

    Marks of a test have priority over those of its file; all marks of its parameters apply.
    """
    other, rooms = config.getoption("--unless-on"), config.getoption("--rooms").split()

    def runs_elsewhere(item):
        names = {item.path.parent.name, *(mark.name for mark in item.iter_markers("slow"))}
        is_in_rooms = not rooms or not names.isdisjoint(rooms)
        return other and _is_for_ranks(item) and _runs_on(item, other) and is_in_rooms

    here = {item: _runs_on(item, COMM.size) and not runs_elsewhere(item) for item in items}
    config.hook.pytest_deselected(items=[item for item in items if not here[item]])
    items[:] = [item for item in items if here[item]]


def _runs_on(item, n_ranks):
    return all(n_ranks in mark.args for mark in _marks_of_ranks(item))


def _is_for_ranks(item):
    return item.path.name.startswith("test_mpi_")


def _marks_of_ranks(item):
    of_test = [mark for mark in item.own_markers if mark.name == "ranks"]
    return of_test or list(item.iter_markers("ranks"))[:1]


def pytest_collection_finish(session):
    """Exclude tests and modules from garbage collections, which a new structure may start."""
    gc.freeze()


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
