"""The program with a fault: on one rank, at one moment, it raises, exits, is killed or hangs.

    python tests/faults.py MOMENT FAULT RANK microslip's arguments ...

MOMENT is ``stage:NAME``, the start of a stage of the log whose name begins with NAME; ``point:N``, within point N (from 0), on any
level; ``written:N``, after file N (from 0) is written and before it is moved to its place; ``start``, before MPI.  Tests call
:func:`microslip_with`, which also returns the time.
"""

import ctypes
import errno
import os
import signal
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from processes import python

MARK = "FAULT_AT"  # environment variable: a file for the time of the fault


def _raise(problem):
    raise problem


def _hang():
    while True:
        time.sleep(1.0)


def _case_error():
    from microslip.messages.errors import CaseError

    raise CaseError("met by one rank alone")


def _petsc(number):
    from petsc4py import PETSc

    raise PETSc.Error(number)


FAULTS = {
    "defect": lambda: _raise(ZeroDivisionError("a mistake")),
    "case": _case_error,
    "exit0": lambda: sys.exit(0),
    "exit3": lambda: sys.exit(3),
    "exit-text": lambda: sys.exit("a library gave up"),
    "_exit0": lambda: os._exit(0),
    "_exit1": lambda: os._exit(1),
    "kill": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "segfault": lambda: ctypes.string_at(0),
    "abort": os.abort,
    "memory": lambda: bytearray(10**16),
    "petsc-memory": lambda: _petsc(55),
    "petsc-error": lambda: _petsc(73),
    "recursion": lambda: (lambda f: f(f))(lambda f: f(f)),
    "disk": lambda: _raise(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "frf.csv")),
    "keyboard": lambda: _raise(KeyboardInterrupt()),
    "term": lambda: os.kill(os.getpid(), signal.SIGTERM),
    "int": lambda: os.kill(os.getpid(), signal.SIGINT),
    "hup": lambda: os.kill(os.getpid(), signal.SIGHUP),
    "term-twice": lambda: [signal.raise_signal(signal.SIGTERM) for _ in range(2)],
    "usr1": lambda: os.kill(os.getpid(), signal.SIGUSR1),
    "usr2": lambda: os.kill(os.getpid(), signal.SIGUSR2),
    "hang": _hang,
    "slow": lambda: time.sleep(0.3),
}


@dataclass
class Ended:
    """The end of the program."""

    status: int
    out: str
    err: str
    seconds: float  # total
    after: float | None  # after the fault; None: it did not occur


def microslip_with(moment, fault, rank, *arguments, ranks=1, cwd=None, **variables) -> Ended:
    """Run the program with a fault on some ranks, with additional environment ``variables``; a hang of 180 s is an error."""
    began = time.time()
    with tempfile.TemporaryDirectory() as folder:
        mark = Path(folder) / "at"
        environment_of_fault = variables | {MARK: mark}
        done = python(__file__, moment, fault, rank, *arguments, ranks=ranks, cwd=cwd, variables=environment_of_fault)
        ended = time.time()
        after = ended - float(mark.read_text()) if mark.exists() else None
    return Ended(done.returncode, done.stdout, done.stderr, ended - began, after)


class Fault:
    """A fault that occurs once, at its moment, if this is its rank ("all": any)."""

    def __init__(self, name: str, rank: str):
        self._do, self._rank, self._left = FAULTS[name], rank, True

    def at(self, comm_rank: int) -> None:
        if self._left and self._rank in ("all", str(comm_rank)):
            self._left = False
            if MARK in os.environ:
                Path(os.environ[MARK]).write_text(f"{time.time()}")
            self._do()


def install(moment: str, fault: Fault) -> None:
    """Patch the program so that the fault occurs at its moment."""
    kind, _, what = moment.partition(":")
    {"start": _at_start, "stage": _in_stage, "point": _in_point, "written": _while_writing}[kind](what, fault)


def _world_rank() -> int:
    from mpi4py import MPI

    return MPI.COMM_WORLD.rank


def _at_start(_, fault: Fault) -> None:
    from microslip.system.start import launcher_rank

    fault.at(launcher_rank())


def _in_stage(name: str, fault: Fault) -> None:
    from microslip.observe.log import RunLog

    stage = RunLog.stage

    @contextmanager
    def with_fault(self, of):
        with stage(self, of):
            if of.startswith(name):
                fault.at(_world_rank())
            yield

    RunLog.stage = with_fault


def _in_point(number: str, fault: Fault) -> None:
    from microslip.observe.log import RunLog

    begin, n = RunLog.__init__, iter(range(10**9))

    def with_points(*arguments, **named):  # PETSc has been started by now
        from microslip.continuation import acceptance, levels

        record = acceptance.point_record

        def with_fault(*arguments, **named):
            if next(n) == int(number):
                fault.at(_world_rank())
            return record(*arguments, **named)

        acceptance.point_record = levels.point_record = with_fault
        begin(*arguments, **named)

    RunLog.__init__ = with_points


def _while_writing(number: str, fault: Fault) -> None:
    from microslip.system import files

    replace, n = os.replace, iter(range(10**9))

    def with_fault(beside, path):
        if next(n) == int(number):
            fault.at(_world_rank())
        replace(beside, path)

    files.os = type("os", (), {**vars(os), "replace": staticmethod(with_fault)})


def main() -> None:
    moment, name, rank, *arguments = sys.argv[1:]
    sys.argv = ["microslip", *arguments]
    sys.path = [entry for entry in sys.path if entry != str(Path(__file__).parent)]
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    install(moment, Fault(name, rank))
    from microslip.__main__ import console

    console()


if __name__ == "__main__":
    main()
