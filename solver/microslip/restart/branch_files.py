"""A branch on disk: its points in a journal, the state after the last point, and the outcome once the branch has ended."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from time import perf_counter
from typing import Any, get_type_hints

import numpy as np

from ..continuation.checkpoint import Part, from_arrays, parts_of, state_arrays
from ..continuation.checkpointer import Narrower, Restored, T
from ..messages.errors import MicroslipError
from ..parallel.agree import on_root
from ..points.bifurcation import Bifurcation
from ..points.branch import NOTHING, Branch, Point
from ..points.peak import Peak
from ..system.files import make_folder
from .records import (
    Arrays,
    Disk,
    Journal,
    Latest,
    checked_read,
    length_of,
    pack,
    read_record,
    read_records,
    unpack,
    write_unsynced,
)

_KINDS = get_type_hints(Point)
_NUMBERS = {name: kind for name, kind in _KINDS.items() if kind in (float, int, bool)}  # all exact as doubles: counts are small
_ARRAYS = tuple(name for name in _KINDS if name not in _NUMBERS and name != "notes")
_numbers = attrgetter(*_NUMBERS)


def of_point(point: Point) -> tuple[Arrays, dict[str, Any]]:
    """Return the arrays and texts of a point."""
    arrays = {name: value for name in _ARRAYS if (value := getattr(point, name)) is not None}
    arrays["numbers"] = np.array(_numbers(point), dtype=float)
    return arrays, {"notes": list(point.notes)} if point.notes else {}


def to_point(arrays: Arrays, texts: dict[str, Any]) -> Point:
    """Return the point that arrays and texts describe."""
    doubles = arrays["numbers"].astype(float, casting="safe")  # refuses complex numbers
    numbers = {name: kind(value) for (name, kind), value in zip(_NUMBERS.items(), doubles, strict=True)}
    values: dict[str, Any] = {name: value for name, value in arrays.items() if name != "numbers"}
    values["parameters"] = tuple(map(float, arrays["parameters"]))
    return Point(**numbers, **values, notes=tuple(texts.get("notes", ())))


def _of_values(values: Sequence[Peak | Bifurcation]) -> tuple[Arrays, dict[str, Any]]:
    """Return the arrays and texts of peaks or bifurcations."""
    numbered = [(f"{i}/{name}", entry) for i, value in enumerate(values) for name, entry in vars(value).items()]
    texts = {name: entry for name, entry in numbered if entry is None or isinstance(entry, str)}
    return {name: np.asarray(entry) for name, entry in numbered if name not in texts}, {"n": len(values), **texts}


def _values(path: Path, kind: type[T]) -> list[T] | None:
    """Return the peaks or bifurcations in a file; None if it is missing or damaged."""
    record = read_record(path)
    if record is None:
        return None
    arrays, texts = record
    entries = texts | {name: array if array.ndim else array.item() for name, array in arrays.items()}
    return [kind(**{name: entries[f"{i}/{name}"] for name in kind.__dataclass_fields__}) for i in range(texts["n"])]


from mpi4py import MPI

from ..continuation.point_solver import Workspace
from ..continuation.state import BranchState
from ..continuation.task import BranchTask
from ..messages.words import counted
from ..points.sweep import Sweep

SELDOM = 300.0  # times the duration of a write: two steps within this interval are written together
SHORT = 0.1  # s; longer steps are always written immediately
_OUTCOME = ("failure", "is_linear", "closes_to", "odd", "solver")  # fields of a finished branch


@dataclass(frozen=True, eq=False)
class Step:
    """The saved data of a continuation step: its points and the state after them, if there is one."""

    points: tuple[Point, ...]
    arrays: Arrays | None = None  # arrays of the state
    parts: dict[str, Part] = field(default_factory=dict)

    def then(self, other: Step) -> Step:
        """Return this step and the next one, combined.  Local."""
        return replace(other, points=self.points + other.points)


class BranchFiles:
    """A :class:`~microslip.continuation.checkpointer.Checkpointer` in a folder, one for each segment of a level.

    Collective on ``comm`` except ``flush``.

    Rank 0 reads and writes the files, which do not depend on the number of ranks.  ``other_ranges`` are folders of the same
    branch over other ranges.

    A long step is written immediately.  Short steps are written in pairs, so that writing does not slow the continuation:
    if the process ends, at most one converged step is lost.

    Raises
    ------
    CaseError, ResourceError : of every method, on every rank, where the files cannot be written
    """

    def __init__(
        self,
        comm: MPI.Comm,
        folder: Path,
        segment: int,
        note: Callable[[str], None] = lambda text: None,
        other_ranges: Callable[[], list[tuple[Path, Sweep]]] = list,
        disk: Disk | None = None,
    ):
        self.comm, self._folder, self._note, self._other_ranges = comm, folder, note, other_ranges
        self._points, self._state, self._end = (folder / f"{name}.{segment}" for name in ("points", "state", "end"))
        self._journal: Journal | None = None  # on rank 0
        self._latest: Latest | None = None  # on rank 0
        self._n_points, self._disk = 0, disk or Disk()
        self._parts: dict[object, Part] = {}  # gathered parts of the last state, by the object that they describe
        self._records: dict[object, bytes] = {}  # the same parts as packed records of the last written state; on rank 0
        self._postponed: Step | None = None
        self._may_postpone, self._written_at = False, -math.inf

    def finished(self) -> Branch | None:
        """Return the finished branch, None if there is none.  Collective."""
        return self._shared(on_root(self.comm, checked_read, self._folder, self._read_end, share=False))

    def _read_end(self) -> Branch | None:
        """Return the branch if it has ended; None if it has not, or if files are damaged."""
        record = read_record(self._end)
        if record is None:
            return None
        _, outcome = record
        points, _ = self._read_points(outcome["n_points"])
        if len(points) < outcome["n_points"]:
            return None
        self._note(f"  its {counted(len(points), 'point')} are from an earlier run")
        return Branch(outcome["level"], points, **{name: outcome[name] for name in _OUTCOME})

    def restored(self, task: BranchTask, workspace: Workspace) -> Restored | None:
        """Return the stored state of an interrupted branch, None if there is none.  Collective."""
        stored = on_root(self.comm, checked_read, self._folder, self._open, share=False)
        arrays = self.comm.bcast(stored[0] if stored else None)
        if arrays is None:
            return None
        branch = self._shared(Branch(0.0, stored[1]) if stored else None)
        return checked_read(self._folder, from_arrays, task, arrays, workspace), branch.points

    def _open(self) -> tuple[Arrays, list[Point]] | None:
        """Open the files for further steps; return the latest stored state and the points before it, None if there is none."""
        make_folder(str(self._folder))
        for path in (self._end, *(self._folder / kind.__name__.lower() for kind in (Peak, Bifurcation))):
            path.unlink(missing_ok=True)
        self._latest = Latest(self._state, self._disk)
        for arrays, _ in self._latest.read():
            n_points = int(arrays["n_points"])
            points, length = self._read_points(n_points)
            if len(points) == n_points:
                self._journal, self._n_points = Journal(self._points, length, self._disk), len(points)
                self._note(f"  continues after {counted(len(points), 'point')} of an earlier run")
                return arrays, points
        self._journal, self._n_points = Journal(self._points, 0, self._disk), 0
        return None

    def narrower(self, task: BranchTask, workspace: Workspace) -> Narrower | None:
        """Return the branch of an earlier run over a narrower range, None if there is none.  Collective."""
        stored = on_root(self.comm, checked_read, self._folder.parent, self._read_narrower, task.sweep, share=False)
        state = self.comm.bcast(stored and (stored[0], stored[1]))
        if state is None:
            return None
        sweep, arrays = state
        branch = self._shared(Branch(0.0, stored[2]) if stored else None)
        return sweep, checked_read(self._folder.parent, from_arrays, task, arrays, workspace), branch.points

    def _read_narrower(self, wider: Sweep) -> tuple[Sweep, Arrays, list[Point]] | None:
        """Return the widest narrower range that the branch has completed, its last state and its points."""
        for folder, sweep in sorted(self._other_ranges(), key=lambda other: -other[1].scale):
            other = BranchFiles(self.comm, folder, 0)
            finished, states = read_record(other._end), Latest(other._state).read()
            if not finished or finished[1]["failure"] is not None or not states or not wider.contains(sweep):
                continue
            points, _ = other._read_points(finished[1]["n_points"])
            if len(points) == finished[1]["n_points"] == states[0][0]["n_points"]:
                self._note(f"  {len(points)} of its points are from a narrower range")
                return sweep, states[0][0], points
        return None

    def _read_points(self, n_points: int) -> tuple[list[Point], int]:
        """Return the first points of the journal and their length in bytes."""
        records = read_records(self._points)[:n_points]
        return [to_point(*unpack(record)) for record in records], length_of(records)

    def save(self, task: BranchTask, state: BranchState | None, points: Sequence[Point]) -> None:
        """Write the state after a step, and its points.  Collective."""
        step = Step(tuple(points)) if state is None else Step(tuple(points), state_arrays(state), self._gathered(task, state))
        if self._may_postpone and self._postponed is None and state is not None and not state.is_done:
            self._postponed = step
            return
        postponed, self._postponed = self._postponed, None
        steps = [step] if postponed is None else [postponed, step] if state is None else [postponed.then(step)]
        self._may_postpone = on_root(self.comm, self._write, steps)

    def _gathered(self, task: BranchTask, state: BranchState) -> dict[str, Part]:
        """Return the parts of a state, gathered for rank 0 to write; those of the last state are reused.  Collective."""
        parts = parts_of(task, state)
        if self.comm.size == 1:
            return parts
        self._parts = {part.of: self._parts[part.of] if part.of in self._parts else part.gathered() for part in parts.values()}
        return {name: self._parts[part.of] for name, part in parts.items()}

    def flush(self) -> None:
        """Write a postponed state, if files can be written.  Local."""
        step, self._postponed = self._postponed, None
        if step is not None and self.comm.rank == 0:
            with suppress(MicroslipError):
                self._write([step])

    def _write(self, steps: Sequence[Step]) -> bool:
        """Append the points of steps and write the state after them; return whether the next step may be postponed."""
        began = perf_counter()
        if self._journal is None:
            self._open()
        for step in steps:
            self._journal.append_packed([pack(*of_point(point)) for point in step.points])
            self._n_points += len(step.points)
            if step.arrays is not None:
                self._latest.write({**step.arrays, "n_points": np.array(self._n_points)}, parts=self._packed(step.parts))
        since, self._written_at = began - self._written_at, perf_counter()
        return since < min(SELDOM * (self._written_at - began), SHORT)

    def _packed(self, parts: dict[str, Part]) -> dict[str, bytes]:
        """Return the parts of a state as packed records; those of the last written state are reused."""
        before = self._records
        self._records = {part.of: before[part.of] if part.of in before else pack(part.arrays()) for part in parts.values()}
        return {name: self._records[part.of] for name, part in parts.items()}

    def finish(self, branch: Branch) -> None:
        """Write that the branch is finished, and how.  Collective."""
        outcome = {"level": branch.level, "n_points": len(branch.points), **{name: getattr(branch, name) for name in _OUTCOME}}
        postponed, self._postponed = self._postponed, None
        on_root(self.comm, self._write_end, outcome, [] if postponed is None else [postponed], share=False)

    def _write_end(self, outcome: dict, postponed: Sequence[Step]) -> None:
        if postponed:
            self._write(postponed)
        for file in (self._journal, self._latest):
            if file is not None:
                file.close()
        write_unsynced(self._end, {}, outcome)

    def solved_for(self, kind: type[T], solve: Callable[[], list[T]]) -> list[T]:
        """Return the peaks or the bifurcations of the finished branch: the saved ones, or by ``solve``, saved.  Collective."""
        path = self._folder / kind.__name__.lower()
        values: list[T] | None = on_root(self.comm, checked_read, path, _values, path, kind)
        if values is None:
            values = solve()
            on_root(self.comm, write_unsynced, path, *_of_values(values))
        return values

    def _shared(self, branch: Branch | None) -> Branch | None:
        """Return a branch of rank 0 on every rank, without the motion of its points on the others."""
        light = branch and replace(branch, points=[replace(point, U=NOTHING, p=NOTHING) for point in branch.points])
        shared = self.comm.bcast(light)
        return branch if self.comm.rank == 0 else shared
