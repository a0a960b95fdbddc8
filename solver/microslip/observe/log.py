"""The log of a run: run.log and the screen.  Rank 0 writes; every rank may call.

Calls are local unless marked *Collective*: opening, the end of a stage and the closing table reduce times and memory over the
ranks.  They are skipped when an exception passes through, so that an error of one rank cannot leave the others waiting here.
The log changes no result.
"""

from __future__ import annotations

import os
import resource
import shlex
import socket
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TextIO

import numpy as np

from ..messages.errors import Interrupted
from ..parallel.agree import on_root
from ..system.files import file_errors, make_folder
from ..system.signals import raise_stop
from ..system.watchdog import moved
from ..version import __version__
from .screen import Screen

if TYPE_CHECKING:
    from mpi4py import MPI

_KIB = 1024.0 if sys.platform == "darwin" else 1.0  # ru_maxrss counts bytes there


@dataclass(frozen=True)
class Stage:
    """Time and memory of a finished stage."""

    name: str
    depth: int  # number of enclosing stages
    seconds: float  # wall time, the slowest rank
    memory: float  # peak resident memory until its end, sum over ranks [MiB]
    memory_largest: float  # the same of the largest rank [MiB]


class RunLog:
    """Lines of run.log and of the screen, stage by stage; LevelLog writes those of levels and points.

    Collective on ``comm`` (opening).  ``path`` None writes no file.  The screen shows a bar if ``interactive``, otherwise a plain
    line per point; None: whether standard error is a terminal.  ``screen`` False shows nothing.  ``facts`` are further lines of
    the header: versions, method, PETSc options.  The header is written on entry.

    A context manager, which closes the log and records an exception that ends the run.

    Raises
    ------
    CaseError, ResourceError : on every rank, if the file cannot be written
    """

    def __init__(
        self,
        comm: MPI.Comm,
        path: str | None = None,
        interactive: bool | None = None,
        *,
        screen: bool = True,
        command: str | None = None,
        facts: Mapping[str, str] | None = None,
    ):
        self.comm = comm
        self.stages: list[Stage] = []
        self.notes: list[str] = []  # all notes except lines of points; on every rank
        self._began = time.perf_counter()
        self._depth = 0
        self._unfinished = ""  # an incomplete line of file and screen
        self._closed = False
        self._file = on_root(comm, _open, path, share=False) if path is not None else None
        hosts = comm.gather(socket.gethostname())
        self.screen = Screen(interactive if screen and comm.rank == 0 else False, silent=not screen or comm.rank > 0)
        if comm.rank == 0:
            self._header(hosts or [], command, facts or {})

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, kind: object, problem: BaseException | None, trace: object) -> None:
        name = type(problem).__name__
        self.close("" if problem is None else f"{name}: {problem}" if str(problem) else name)

    # -- lines -------------------------------------------------------------------------------------------------

    def note(self, text: str, *, on_screen: bool = True, in_results: bool = True) -> None:
        """Write plain lines.  Local; rank 0 writes.  Without ``in_results`` they are not stored in results.h5."""
        if in_results:
            self.notes.append(text)
        self._write(("\n" if self._unfinished else "") + text + "\n")
        if on_screen:
            self.screen.line(text)
        self._unfinished = ""

    def _write(self, text: str) -> None:
        """Append to the file; after an error of the disk, report it once and continue without the log."""
        if self._file is None:
            return
        try:
            self._file.write(text)
            self._file.flush()
        except OSError as problem:
            name, self._file = self._file.name, None
            self.screen.line(f"{name}: no longer written: {problem.strerror}")

    def _header(self, hosts: list[str], command: str | None, facts: Mapping[str, str]) -> None:
        names = sorted(set(hosts))
        ranks = f"{len(hosts)} rank{'s' if len(hosts) > 1 else ''} on " + ", ".join(
            f"{name} ({hosts.count(name)})" if len(names) > 1 else name for name in names
        )
        lines = {
            "date": time.strftime("%Y-%m-%d %H:%M:%S %z"),
            "command": command or command_line(),
            "ranks": ranks,
            "python": sys.version.split()[0],
            "numpy": np.__version__,
            **facts,
        }
        width = max(len(name) for name in lines)
        self.note("\n".join([f"microslip {__version__}", *(f"{name:<{width}}  {text}" for name, text in lines.items()), ""]))

    # -- stages ------------------------------------------------------------------------------------------------

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time a stage and record the peak memory so far.  Collective on ``comm`` at its end, unless it raises.

        Stages may be nested.
        """
        moved()
        raise_stop()
        depth, began = self._depth, time.perf_counter()
        self._depth += 1
        self._begin_line("  " * depth + name)
        try:
            yield
        except BaseException as problem:
            self.screen.clear()
            self.note(f"{'  ' * depth}{name} ended after {time.perf_counter() - began:.3g} s by {type(problem).__name__}")
            if not isinstance(problem, Interrupted):
                raise_stop()  # a library may have converted a signal to this exception
            raise
        finally:
            self._depth = depth
        memory, largest, seconds = self._measure(time.perf_counter() - began)
        self.stages.append(Stage(name, depth, seconds, memory, largest))
        self.screen.clear()
        self._end_line("  " * depth + name, f"{seconds:>10.3f} s {memory:>8.0f} MiB")

    def _measure(self, seconds: float) -> tuple[float, float, float]:
        """Return peak memory summed and of the largest rank [MiB], and the time of the slowest rank.  Collective."""
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _KIB / 1024.0
        memory, times = zip(*self.comm.allgather((peak, seconds)))
        return sum(memory), max(memory), max(times)

    def _begin_line(self, name: str) -> None:
        self._write(("\n" if self._unfinished else "") + name)
        self._unfinished = name
        self.screen.begin(name)

    def _end_line(self, name: str, numbers: str) -> None:
        line = f"{name:<40}{numbers}"
        self._write((line[len(name) :] if self._unfinished == name else line) + "\n")
        self._unfinished = ""
        self.screen.line(line)

    # -- the end -----------------------------------------------------------------------------------------------

    def close(self, failure: str = "") -> None:
        """Write the table of stages and close the file.  Collective on ``comm`` without ``failure``, local with it.

        A second call does nothing.
        """
        if self._closed:
            return
        self._closed = True
        self.screen.clear()
        seconds = time.perf_counter() - self._began
        if not failure:
            memory, largest, seconds = self._measure(seconds)
            self.stages.append(Stage("total", 0, seconds, memory, largest))
        if self.stages:
            self.note("\n" + self.table(seconds))
        # the end of the program shows a failure on the screen
        self.note(f"ended by {failure}" if failure else "done", on_screen=not failure)
        if self._file is not None:
            self._file.close()
            self._file = None

    def summary(self) -> list[Stage]:
        """Return the finished stages, each before its parts, of which those of the same name are one.  Local."""
        return _summary(self.stages)

    def table(self, seconds: float) -> str:
        """Return the stages as a table; shares are of ``seconds``.  Local."""
        rows = [f"{'stage':<40}{'seconds':>10}{'share':>7}{'peak memory, MiB: all ranks':>29}{'largest':>9}"]
        for stage in self.summary():
            rows.append(
                f"{'  ' * stage.depth + stage.name:<40}{stage.seconds:>10.3f}{stage.seconds / max(seconds, 1e-9):>7.1%}"
                f"{stage.memory:>29.0f}{stage.memory_largest:>9.0f}"
            )
        return "\n".join(rows)


def _summary(stages: Sequence[Stage], merges: bool = False) -> list[Stage]:
    """Return finished stages, each before its parts; with ``merges`` those of the same name are one."""
    top, summary, parts = min((stage.depth for stage in stages), default=0), list[Stage](), list[Stage]()
    alike: dict[str | int, tuple[list[Stage], list[Stage]]] = {}  # stages of each name, and their parts
    for i, stage in enumerate(stages):
        if stage.depth > top:
            parts.append(stage)
            continue
        same, parts_of = alike.setdefault(stage.name if merges else i, ([], []))
        same.append(stage)
        parts_of += parts
        parts = []
    for same, parts_of in alike.values():
        name = same[0].name + (f", {len(same)} times" if len(same) > 1 else "")
        memory, largest = max(stage.memory for stage in same), max(stage.memory_largest for stage in same)
        summary += [Stage(name, top, sum(stage.seconds for stage in same), memory, largest), *_summary(parts_of, merges=True)]
    return summary + (_summary(parts, merges=True) if parts else [])  # parts of a stage that is not finished


def _open(path: str) -> TextIO:
    """Create the log file and its folder."""
    make_folder(os.path.dirname(path) or ".")
    with file_errors(path):
        return open(path, "w", encoding="utf-8", errors="replace")


def command_line() -> str:
    """Return the command line of this process.  Local."""
    program = os.path.basename(sys.argv[0] or "python")
    return shlex.join(["microslip" if program == "__main__.py" else program, *sys.argv[1:]])
