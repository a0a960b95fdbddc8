"""The log of a run: run.log, and what the screen shows meanwhile.  Rank 0 writes; every rank may call.

Every call is local except where it says *Collective*: opening, the end of a stage and the closing table reduce times
and memory over the ranks.  None of them is entered when an exception passes through, so that an error of one rank
cannot leave the others waiting here.  What is shown changes no result.
"""

from __future__ import annotations

import os
import resource
import shlex
import socket
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from .. import __version__
from ..parallel.agree import on_root
from ..parallel.files import make_folder, said_of
from .screen import Screen

_KIB = 1024.0 if sys.platform == "darwin" else 1.0  # ru_maxrss counts bytes there
_HEAD = (
    f"{'point':>7} {'frequency_Hz':>12} {'amplitude_m':>12} {'slip':>5} {'open':>5} {'unknowns':>8} "
    f"{'newton':>6} {'gmres':>5} {'seconds':>8}"
)


@dataclass(frozen=True)
class Stage:
    """What a finished stage took."""

    name: str
    depth: int  # stages it lies in
    seconds: float  # wall time, the slowest rank
    memory: float  # peak resident memory until its end, sum over ranks [MiB]
    memory_largest: float  # the same of the largest rank [MiB]


class RunLog:
    """Lines of run.log and of the screen, stage by stage and point by point.

    Collective on ``comm`` (opening).  ``path`` None writes no file.  ``interactive`` None asks whether standard error is
    a terminal: then the screen shows a bar, otherwise one plain line a point.  ``screen`` False shows nothing at all.
    ``facts`` are further lines of the header: versions, method, PETSc options.  The header is written on entry.

    Used as a context manager it closes itself, and says so when an exception ends the run.

    Raises
    ------
    CaseError, ResourceError : on every rank, if the file cannot be written
    """

    def __init__(
        self,
        comm,
        path: str | None = None,
        interactive: bool | None = None,
        *,
        screen: bool = True,
        command: str | None = None,
        facts: Mapping[str, str] | None = None,
    ):
        self.comm = comm
        self.stages: list[Stage] = []
        self._began = time.perf_counter()
        self._depth = 0
        self._unfinished = ""  # a line of the file and the screen that waits for its numbers
        self._closed = False
        self._names: dict[float, str] = {}  # of the levels begun, by level
        self._is_static = False  # what is shown of a point is its mean
        self._side_by_side = False  # levels come mixed: the line of a point says whose it is
        self._file = on_root(comm, _open, path, share=False) if path is not None else None
        hosts = comm.gather(socket.gethostname())
        self._screen = Screen(interactive if screen and comm.rank == 0 else False, silent=not screen or comm.rank > 0)
        if comm.rank == 0:
            self._header(hosts, command, facts or {})

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, kind, problem, trace) -> None:
        self.close("" if problem is None else f"{kind.__name__}: {problem}" if str(problem) else kind.__name__)

    # -- lines -------------------------------------------------------------------------------------------------

    def note(self, text: str) -> None:
        """Write plain lines.  Local; rank 0 writes."""
        self._line(text)

    def _line(self, text: str, *, on_screen: bool = True) -> None:
        self._write(("\n" if self._unfinished else "") + text + "\n")
        if on_screen:
            self._screen.line(text)
        self._unfinished = ""

    def _write(self, text: str) -> None:
        """Append to the file; if the disk refuses, say so once and go on without: a lost log loses no result."""
        if self._file is None:
            return
        try:
            self._file.write(text)
            self._file.flush()
        except OSError as problem:
            name, self._file = self._file.name, None
            self._screen.line(f"{name}: no longer written: {problem.strerror}")

    def _header(self, hosts: list[str], command: str | None, facts: Mapping[str, str]) -> None:
        names = sorted(set(hosts))
        ranks = f"{len(hosts)} rank{'s' if len(hosts) > 1 else ''} on " + ", ".join(
            f"{name} ({hosts.count(name)})" if len(names) > 1 else name for name in names
        )
        lines = {
            "date": time.strftime("%Y-%m-%d %H:%M:%S %z"),
            "command": command or _command(),
            "ranks": ranks,
            "python": sys.version.split()[0],
            "numpy": np.__version__,
            **facts,
        }
        width = max(len(name) for name in lines)
        self._line("\n".join([f"microslip {__version__}", *(f"{name:<{width}}  {text}" for name, text in lines.items()), ""]))

    # -- stages ------------------------------------------------------------------------------------------------

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time a stage and record the peak memory so far.  Collective on ``comm`` at its end, unless it raises.

        Stages may lie in each other.
        """
        depth, began = self._depth, time.perf_counter()
        self._depth += 1
        self._begin_line("  " * depth + name)
        try:
            yield
        except BaseException as problem:
            self._screen.clear()
            self._line(f"{'  ' * depth}{name} ended after {time.perf_counter() - began:.3g} s by {type(problem).__name__}")
            raise
        finally:
            self._depth = depth
        memory, largest, seconds = self._measure(time.perf_counter() - began)
        self.stages.append(Stage(name, depth, seconds, memory, largest))
        self._screen.clear()
        self._end_line("  " * depth + name, f"{seconds:>10.3f} s {memory:>8.0f} MiB")

    def _measure(self, seconds: float) -> tuple[float, float, float]:
        """Return peak memory summed and of the largest rank [MiB], and the time of the slowest rank.  Collective."""
        own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _KIB / 1024.0
        memory, times = zip(*self.comm.allgather((own, seconds)))
        return sum(memory), max(memory), max(times)

    def _begin_line(self, name: str) -> None:
        self._write(("\n" if self._unfinished else "") + name)
        self._unfinished = name
        self._screen.begin(name)

    def _end_line(self, name: str, numbers: str) -> None:
        whole = f"{name:<40}{numbers}"
        self._write((whole[len(name) :] if self._unfinished == name else whole) + "\n")
        self._unfinished = ""
        self._screen.line(whole)

    # -- levels and points -------------------------------------------------------------------------------------

    def level_started(
        self,
        level: float,
        omega_start: float,
        omega_stop: float,
        index: int = 0,
        n_levels: int = 1,
        where: str = "",
        is_static: bool = False,
    ) -> None:
        """Announce a level [N] and its range [rad/s], the ``index``-th of ``n_levels`` from 0.  Local.

        ``where`` names the ranks at work on it, if others are at work on other levels.  One point of statics
        stands for the range.
        """
        start, stop = omega_start / 2.0 / np.pi, omega_stop / 2.0 / np.pi
        name = self._names[level] = f"level {index + 1} of {n_levels}: {level:g} N"
        self._side_by_side, self._is_static = bool(where), is_static
        columns = _HEAD.replace("amplitude_m", "     mean_m") if is_static else _HEAD
        head = f"{name}, {start:.6g} to {stop:.6g} Hz" + (f", on {where}" if where else "")
        self._line(f"{head}\n{self._of('level_N')}{columns}", on_screen=not self._screen.interactive)
        self._screen.bar(name, start, stop)

    def _of(self, level: str) -> str:
        """Return the first column of a line where levels come mixed."""
        return f"{level:>10} " if self._side_by_side else ""

    def point(self, level: float, i: int, point) -> None:
        """Report the ``i``-th converged point of a level, a :class:`~microslip.continuation.branch.Point`.  Local.

        The amplitude is that of harmonic 1 of the first output; in statics its mean is shown instead.
        """
        if self.comm.rank > 0:
            return
        frequency, amplitude = point.omega / 2.0 / np.pi, _shown(point, self._is_static)
        n_slip, n_open = np.count_nonzero(point.state == 1), np.count_nonzero(point.state == 2)
        line = (
            f"{self._of(f'{level:.6g}')}{i:>7} {frequency:>12.8g} {amplitude:>12.5e} {n_slip:>5} {n_open:>5} "
            f"{point.unknowns:>8} {point.newton:>6} {point.krylov:>5} {point.seconds:>8.4f}"
        )
        self._line(line, on_screen=not self._screen.interactive)
        self._screen.advance(self._name(level), frequency, amplitude, n_slip + n_open, i + 1)

    def level_finished(self, level: float, branch) -> None:
        """Sum up a level, a :class:`~microslip.continuation.branch.Branch`: its peak, or why it ended early.  Local."""
        self._screen.end_bar(self._name(level))
        if self.comm.rank > 0:
            return
        self._line(f"{self._name(level)}: {_summary(level, branch.points, self._is_static)}")
        for note, points in _noted(branch.points).items():
            low, high = (f(point.omega for point in points) / 2.0 / np.pi for f in (min, max))
            self._line(f"  {note}: {len(points)} of {len(branch.points)} points, {low:.6g} to {high:.6g} Hz")
        if branch.scaled:
            self._line("  no pair leaves sticking anywhere on its linear curve: scaled, not solved")
        if branch.broken:
            both = (
                "in two segments: followed from the other end of the range as well"
                if branch.points[0].segment == 0
                else "followed from the other end of the range"
            )
            self._line(f"  {both}, since {branch.broken}")
        if branch.failure:
            self._line(f"  stopped early: {branch.failure}")

    def _name(self, level: float) -> str:
        return self._names.get(level, f"{level:g} N")

    # -- the end -----------------------------------------------------------------------------------------------

    def close(self, failure: str = "") -> None:
        """Write the table of stages and close the file.  Collective on ``comm`` without ``failure``, local with it.

        A second call does nothing.
        """
        if self._closed:
            return
        self._closed = True
        self._screen.clear()
        seconds = time.perf_counter() - self._began
        if not failure:
            memory, largest, seconds = self._measure(seconds)
            self.stages.append(Stage("total", 0, seconds, memory, largest))
        if self.stages:
            self._line("\n" + self.table(seconds))
        self._line(f"ended by {failure}" if failure else "done", on_screen=not failure)  # the end of the program says it
        if self._file is not None:
            self._file.close()
            self._file = None

    def table(self, seconds: float) -> str:
        """Return the stages as a table; shares are of ``seconds``.  Local."""
        rows = [f"{'stage':<40}{'seconds':>10}{'share':>7}{'peak memory, MiB: all ranks':>29}{'largest':>9}"]
        for stage in self.stages:
            rows.append(
                f"{'  ' * stage.depth + stage.name:<40}{stage.seconds:>10.3f}{stage.seconds / max(seconds, 1e-9):>7.1%}"
                f"{stage.memory:>29.0f}{stage.memory_largest:>9.0f}"
            )
        return "\n".join(rows)


def _shown(point, is_static: bool) -> float:
    """Return the amplitude of harmonic 1 of the first output [m], or its mean."""
    return float(point.response[0, 0] if is_static else np.hypot(*point.response[0, 1:3]))


def _summary(level: float, points, is_static: bool) -> str:
    """Return the essential numbers of a level's points."""
    if not points:
        return "no point converged"
    top = max(points, key=lambda point: abs(_shown(point, is_static)))
    largest = _shown(top, is_static)
    n_slip, n_open = np.count_nonzero(top.state == 1), np.count_nonzero(top.state == 2)
    per_newton = f" ({largest / level:.4e} m/N)" if level else ""
    number = "one point" if is_static else f"{len(points)} points"
    what, where = ("displacement", "at every frequency") if is_static else ("peak", f"at {top.omega / 2.0 / np.pi:.7g} Hz")
    return (
        f"{number} in {sum(point.seconds for point in points):.3g} s; {what} {largest:.4e} m{per_newton} "
        f"{where}, {n_slip} of {len(top.state)} pairs slip, {n_open} open"
    )


def _noted(points) -> dict[str, list]:
    """Return the points that carry a note, by note."""
    found: dict[str, list] = {}
    for point in points:
        for note in point.notes:
            found.setdefault(note, []).append(point)
    return found


def _open(path: str):
    """Create the log file and its folder."""
    make_folder(os.path.dirname(path) or ".")
    with said_of(path):
        return open(path, "w", encoding="utf-8", errors="replace")


def _command() -> str:
    program = os.path.basename(sys.argv[0] or "python")
    return shlex.join(["microslip" if program == "__main__.py" else program, *sys.argv[1:]])
