"""Every bad input of the catalogue ends with its status and one message on all ranks, and does not change earlier results."""

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
LIMIT = 30.0  # s; on an idle machine they take hundredths


@pytest.fixture(scope="module")
def sound(comm, tmp_path_factory):
    """Return the folder of the sound files, the same on all ranks."""

    def write():
        folder = tmp_path_factory.mktemp("sound")
        write_sound(folder)
        return folder

    return on_root(comm, write)


@pytest.fixture(autouse=True)
def limit(capfd):
    """End all ranks with a traceback if a rank hangs, also inside a library."""
    with capfd.disabled():
        screen = os.dup(2)
    faulthandler.dump_traceback_later(3.0 * LIMIT, exit=True, file=screen)
    yield
    faulthandler.cancel_dump_traceback_later()
    os.close(screen)


@pytest.fixture
def place(comm, sound, tmp_path, monkeypatch):
    """Return a function that copies and spoils the files of a case, enters and returns their folder.  Collective.

    A run draws no pictures.
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
    """Set the PETSc options after ``--``, since PETSc reads a command line only once in a process."""
    words = line.partition(" -- ")[2].split()
    given = {name[1:]: value for name, value in zip(words[::2], words[1::2]) if name.startswith("-")}
    options = PETSc.Options()
    for name, value in given.items():
        options.setValue(name, value)
    yield
    for name in given:
        options.delValue(name)


ON_RANK_0 = ("scene", "command", "results")  # rank 0 refuses them before other ranks start work


def entry(number, sort, case):
    """Return a case as a parameter: on two ranks, or on one where rank 0 detects it; a sample also on other numbers.

    With CATALOGUE_SEED in the environment each case runs on any number of ranks.
    """
    if SEED:
        return pytest.param(case, id=case.name)
    ranks = (1,) if sort in ON_RANK_0 else (2,)
    others = (1, 2) * (number % 4 == 0) + (3,) * (number % 16 == 0)
    return pytest.param(case, id=case.name, marks=pytest.mark.ranks(*ranks, *others))


def entries():
    """Return all cases as parameters, shuffled with CATALOGUE_SEED."""
    entries = [entry(i, sort, case) for sort, cases in BY_SORT.items() for i, case in enumerate(cases)]
    if SEED:
        random.Random(SEED).shuffle(entries)
    return entries


@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning", "error::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("case", entries())
def test_a_bad_input_ends_with_its_status_and_one_message(comm, place, capfd, case):
    if case.not_by_root and os.geteuid() == 0:
        pytest.skip("permissions do not apply to root")
    folder = place(case)
    earlier = on_root(comm, fingerprint, folder / EARLIER)
    began = time.monotonic()
    with petsc_options(case.line):
        status = main(case.line.split())
    seconds = comm.allreduce(time.monotonic() - began) / comm.size
    stderr = "".join(comm.allgather(capfd.readouterr().err))
    assert set(comm.allgather(status)) == {case.status}, stderr
    later = on_root(comm, fingerprint, folder / EARLIER)
    assert not violations(Ended(status, stderr, seconds), case, earlier, later, LIMIT), stderr


def test_the_catalogue_has_at_least_400_distinct_bad_inputs():
    assert len({case.name for case in CASES}) == len(CASES) >= 400
