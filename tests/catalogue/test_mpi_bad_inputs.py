"""Every bad input of the catalogue ends with its status and one message on all ranks, and leaves earlier results alone."""

import faulthandler
import os
import random
import shutil
import signal
import time
from contextlib import contextmanager

import pytest
from petsc4py import PETSc

from catalogue.bad_inputs import BY_SORT, CASES
from catalogue.judge import Ended, violations
from catalogue.sound import EARLIER, fingerprint, write_sound
from microslip.__main__ import main
from microslip.parallel.agree import on_root

SEED = os.environ.get("CATALOGUE_SEED")
LIMIT = 30.0  # s: these take hundredths, on a machine that others do not keep busy


@pytest.fixture(scope="module")
def sound(comm, tmp_path_factory):
    """The folder of the sound files, the same on all ranks."""

    def write():
        folder = tmp_path_factory.mktemp("sound")
        write_sound(folder)
        return folder

    return on_root(comm, write)


@pytest.fixture(autouse=True)
def limit(capfd):
    """End all ranks where one hangs, also inside a library, and say where."""
    with capfd.disabled():
        screen = os.dup(2)
    faulthandler.dump_traceback_later(3.0 * LIMIT, exit=True, file=screen)
    yield
    faulthandler.cancel_dump_traceback_later()
    os.close(screen)


@pytest.fixture
def place(comm, sound, tmp_path, monkeypatch):
    """Return what to call with a case: the folder where its files lie, spoiled, and where all ranks are then.  Collective.

    A run that gets as far draws no pictures.
    """
    monkeypatch.setattr("microslip.results.draw.draw_share", lambda *share: None)
    folder = comm.bcast(tmp_path) / "here"
    handler = signal.getsignal(signal.SIGTERM)

    def enter(case):
        def write():
            shutil.copytree(sound, folder)
            if case.spoil is not None:
                case.spoil(folder)

        on_root(comm, write)
        monkeypatch.chdir(folder)
        return folder

    yield enter
    signal.signal(signal.SIGTERM, handler)


@contextmanager
def petsc_options(line):
    """Give PETSc what follows ``--``: it takes a command line only once, and this process has had its own."""
    words = line.partition(" -- ")[2].split()
    given = {name[1:]: value for name, value in zip(words[::2], words[1::2]) if name.startswith("-")}
    options = PETSc.Options()
    for name, value in given.items():
        options.setValue(name, value)
    yield
    for name in given:
        options.delValue(name)


ON_RANK_0 = ("scene", "command", "results")  # are refused by rank 0 before the others do anything of their own


def entry(number, sort, case):
    """Return a case as a parameter: on two ranks, or on one where rank 0 alone finds it; a sample of either on the others.

    With CATALOGUE_SEED in the environment on any number of ranks.
    """
    if SEED:
        return pytest.param(case, id=case.name)
    ranks = (1,) if sort in ON_RANK_0 else (2,)
    others = (1, 2) * (number % 4 == 0) + (3,) * (number % 16 == 0)
    return pytest.param(case, id=case.name, marks=pytest.mark.ranks(*ranks, *others))


def entries():
    """Return all cases as parameters, in an order that CATALOGUE_SEED shuffles."""
    entries = [entry(i, sort, case) for sort, cases in BY_SORT.items() for i, case in enumerate(cases)]
    if SEED:
        random.Random(SEED).shuffle(entries)
    return entries


@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning", "error::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("case", entries())
def test_a_bad_input(comm, place, capfd, case):
    if case.not_by_root and os.geteuid() == 0:
        pytest.skip("no permission stops root")
    folder = place(case)
    earlier = on_root(comm, fingerprint, folder / EARLIER)
    began = time.monotonic()
    with petsc_options(case.line):
        status = main(case.line.split())
    seconds = comm.allreduce(time.monotonic() - began) / comm.size
    said = "".join(comm.allgather(capfd.readouterr().err))
    assert set(comm.allgather(status)) == {case.status}, said
    computed = on_root(comm, fingerprint, folder / EARLIER)
    assert not violations(Ended(status, said, seconds), case, earlier, computed, LIMIT), said


def test_the_catalogue_is_as_large_as_it_says():
    assert len({case.name for case in CASES}) == len(CASES) >= 400
