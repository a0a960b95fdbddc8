"""What all tests share: PETSc and MPI started first, one rank that reports, and no rank left waiting for a failed one."""

import gc
import os
import signal
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ["MPLBACKEND"] = "Agg"
os.environ["MICROSLIP_CACHE"] = "off"  # a test that builds a structure shall build it; those of the cache name a folder

from microslip.parallel.petsc import initialise
from microslip.system.signals import STOPPING

initialise()

import hypothesis
import pytest
from mpi4py import MPI
from petsc4py import PETSc

COMM = MPI.COMM_WORLD

# The same examples on every machine, rank and day, and few enough for every push; without the constants of what is imported, which
# would change them with the sources, and for which every process would read those of NumPy and SciPy, too, for seconds.  The name
# is none that Hypothesis promises: a version without it is only slower, or draws others.
providers = sys.modules.get("hypothesis.internal.conjecture.providers")
if hasattr(providers, "is_local_module_file"):
    providers.is_local_module_file = lambda path: False
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


@pytest.fixture
def options():
    """Set PETSc's options by name, and take them away again."""
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
    """Return what to call with the program's arguments: status and what was said on all ranks.  Collective.

    It runs in this process, and draws no pictures of a run: they have tests of their own.  Those of the studies are drawn in tests
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
        said = capfd.readouterr()
        return status, "".join(comm.allgather(said.out)), "".join(comm.allgather(said.err))

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


def pytest_addoption(parser):
    parser.addoption("--unless-on", type=int, metavar="N", help="leave out what also runs on N ranks")
    parser.addoption(
        "--rooms", default="", help="folders of tests that --unless-on is for, and `slow` for tests so marked; default: all"
    )


def pytest_collection_modifyitems(config, items):
    """Leave out what shows nothing more on this number of ranks: the mark ``ranks`` of a test or its file names the numbers.

    A test's own marks count before its file's; those of its parameters all count.
    """
    other, rooms = config.getoption("--unless-on"), config.getoption("--rooms").split()

    def runs_elsewhere(item):
        names = {item.path.parent.name, *(mark.name for mark in item.iter_markers("slow"))}
        is_meant = not rooms or not names.isdisjoint(rooms)
        return other and _is_for_ranks(item) and _runs_on(item, other) and is_meant

    here = {item: _runs_on(item, COMM.size) and not runs_elsewhere(item) for item in items}
    config.hook.pytest_deselected(items=[item for item in items if not here[item]])
    items[:] = [item for item in items if here[item]]


def _runs_on(item, n_ranks):
    return all(n_ranks in mark.args for mark in _marks_of_ranks(item))


def _is_for_ranks(item):
    return item.path.name.startswith("test_mpi_")


def _marks_of_ranks(item):
    own = [mark for mark in item.own_markers if mark.name == "ranks"]
    return own or list(item.iter_markers("ranks"))[:1]


def pytest_collection_finish(session):
    """Take tests and modules out of what Python looks through for circles: a new structure may ask for that."""
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
