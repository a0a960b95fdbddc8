"""A branch on disk: its points in a journal, the state after the last of them, and at last how it ended."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from ..continuation.checkpoint import Part, from_arrays, own_arrays, parts_of
from ..continuation.keeper import Begun, Shorter
from ..messages.errors import MicroslipError
from ..parallel.agree import on_root
from ..points.branch import NOTHING, Branch, Point
from ..system.files import make_folder
from .kept_points import of_point, to_point
from .records import Arrays, Disk, Journal, Latest, as_written, length_of, note_record, pack, read_record, read_records, unpack

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..continuation.point_solver import Workspace
    from ..continuation.state import BranchState
    from ..continuation.task import BranchTask
    from ..points.sweep import Sweep

SELDOM = 300.0  # times as long as writing takes: two steps that come in less are written together
SHORT = 0.1  # s; but if they take longer, each is written at once
_SAID = ("failure", "is_linear", "closes_to", "odd", "solver")  # of a branch that ended


@dataclass(frozen=True, eq=False)
class Step:
    """What a step on along a branch leaves to keep: its points and the state after them, if there is one."""

    points: tuple[Point, ...]
    arrays: Arrays | None = None  # the state's own
    parts: dict[str, Part] = field(default_factory=dict)

    def then(self, other: Step) -> Step:
        """Return this step and the one after it as one.  Local."""
        return replace(other, points=self.points + other.points)


class KeptBranch:
    """A :class:`~microslip.continuation.keeper.Keeper` in a folder, one for a segment of a level.

    Collective on ``comm`` but for ``let_go``.

    The files are those of rank 0.  What was left by more ranks or fewer is read just as well.  ``others`` are folders of the same
    branch over other ranges.

    A step is written at once where it takes long.  Where steps are so short that writing each would be felt, two are written
    together: whatever ends the process, one of those that had converged is lost at most.

    Raises
    ------
    CaseError, ResourceError : of every method, on every rank, where the files cannot be written
    """

    def __init__(
        self,
        comm: MPI.Comm,
        folder: Path,
        segment: int,
        say: Callable[[str], None] = lambda text: None,
        others: Callable[[], list[tuple[Path, Sweep]]] = list,
        disk: Disk | None = None,
    ):
        self.comm, self._folder, self._say, self._others = comm, folder, say, others
        self._points, self._state, self._end = (folder / f"{name}.{segment}" for name in ("points", "state", "end"))
        self._journal: Journal | None = None  # on rank 0
        self._latest: Latest | None = None  # on rank 0
        self._n_points, self._disk = 0, disk or Disk()
        self._parts: dict[object, Part] = {}  # of the last state, gathered, by what they are made of
        self._records: dict[
            object, bytes
        ] = {}  # the same packed, of the last state that was written; on rank 0, as the next ones
        self._put_off: Step | None = None
        self._may_put_off, self._written_at = False, -math.inf

    def ended(self) -> Branch | None:
        return self._shared(on_root(self.comm, as_written, self._folder, self._read_end, share=False))

    def _read_end(self) -> Branch | None:
        """Return the branch that has ended; None where it has not, or files are damaged."""
        found = read_record(self._end)
        if found is None:
            return None
        _, said = found
        points, _ = self._read_points(said["n_points"])
        if len(points) < said["n_points"]:
            return None
        self._say(f"  its {len(points)} points are there from an earlier run")
        return Branch(said["level"], points, **{name: said[name] for name in _SAID})

    def begun(self, task: BranchTask, workspace: Workspace) -> Begun | None:
        found = on_root(self.comm, as_written, self._folder, self._open, share=False)
        arrays = self.comm.bcast(found[0] if found else None)
        if arrays is None:
            return None
        branch = self._shared(Branch(0.0, found[1]) if found else None)
        assert branch is not None, "rank 0 has read its points"
        return as_written(self._folder, from_arrays, task, arrays, workspace), branch.points

    def _open(self) -> tuple[Arrays, list[Point]] | None:
        """Open the files for what comes, after the latest state that is there and the points before it."""
        make_folder(str(self._folder))
        self._end.unlink(missing_ok=True)
        self._latest = Latest(self._state, self._disk)
        for arrays, _ in self._latest.read():
            n_points = int(arrays["n_points"])
            points, length = self._read_points(n_points)
            if len(points) == n_points:
                self._journal, self._n_points = Journal(self._points, length, self._disk), len(points)
                self._say(f"  goes on after {len(points)} points of an earlier run")
                return arrays, points
        self._journal, self._n_points = Journal(self._points, 0, self._disk), 0
        return None

    def shorter(self, task: BranchTask, workspace: Workspace) -> Shorter | None:
        found = on_root(self.comm, as_written, self._folder.parent, self._read_shorter, task.sweep, share=False)
        known = self.comm.bcast(found and (found[0], found[1]))
        if known is None:
            return None
        sweep, arrays = known
        branch = self._shared(Branch(0.0, found[2]) if found else None)
        assert branch is not None, "rank 0 has read its points"
        return sweep, as_written(self._folder.parent, from_arrays, task, arrays, workspace), branch.points

    def _read_shorter(self, wider: Sweep) -> tuple[Sweep, Arrays, list[Point]] | None:
        """Return the widest range within another over which the branch came to its end, its last state and its points."""
        for folder, sweep in sorted(self._others(), key=lambda other: -other[1].scale):
            other = KeptBranch(self.comm, folder, 0)
            ended, states = read_record(other._end), Latest(other._state).read()
            if not ended or ended[1]["failure"] is not None or not states or not wider.contains(sweep):
                continue
            points, _ = other._read_points(ended[1]["n_points"])
            if len(points) == ended[1]["n_points"] == states[0][0]["n_points"]:
                self._say(f"  {len(points)} of its points are there from a shorter range")
                return sweep, states[0][0], points
        return None

    def _read_points(self, n_points: int) -> tuple[list[Point], int]:
        """Return the first points of the journal and how many bytes they take there."""
        records = read_records(self._points)[:n_points]
        return [to_point(*unpack(record)) for record in records], length_of(records)

    def keep(self, task: BranchTask, state: BranchState | None, points: Sequence[Point]) -> None:
        step = Step(tuple(points)) if state is None else Step(tuple(points), own_arrays(state), self._gathered(task, state))
        if self._may_put_off and self._put_off is None and state is not None and not state.is_done:
            self._put_off = step
            return
        put_off, self._put_off = self._put_off, None
        steps = [step] if put_off is None else [put_off, step] if state is None else [put_off.then(step)]
        self._may_put_off = on_root(self.comm, self._write, steps)

    def _gathered(self, task: BranchTask, state: BranchState) -> dict[str, Part]:
        """Return the parts of a state, whose arrays rank 0 can make alone; those of the last state are gathered.  Collective."""
        parts = parts_of(task, state)
        if self.comm.size == 1:
            return parts
        self._parts = {part.of: self._parts[part.of] if part.of in self._parts else part.gathered() for part in parts.values()}
        return {name: self._parts[part.of] for name, part in parts.items()}

    def let_go(self) -> None:
        step, self._put_off = self._put_off, None
        if step is not None and self.comm.rank == 0:
            with suppress(MicroslipError):
                self._write([step])

    def _write(self, steps: Sequence[Step]) -> bool:
        """Append the points of steps and write the state after them; return whether the next step may be put off."""
        began = perf_counter()
        if self._journal is None:
            self._open()
        assert self._journal is not None and self._latest is not None, "they are open now"
        for step in steps:
            self._journal.append_packed([pack(*of_point(point)) for point in step.points])
            self._n_points += len(step.points)
            if step.arrays is not None:
                self._latest.write({**step.arrays, "n_points": np.array(self._n_points)}, parts=self._packed(step.parts))
        since, self._written_at = began - self._written_at, perf_counter()
        return since < min(SELDOM * (self._written_at - began), SHORT)

    def _packed(self, parts: dict[str, Part]) -> dict[str, bytes]:
        """Return the parts of a state as records; those of the state written before are there."""
        before = self._records
        self._records = {part.of: before[part.of] if part.of in before else pack(part.arrays()) for part in parts.values()}
        return {name: self._records[part.of] for name, part in parts.items()}

    def end(self, branch: Branch) -> None:
        said = {"level": branch.level, "n_points": len(branch.points), **{name: getattr(branch, name) for name in _SAID}}
        put_off, self._put_off = self._put_off, None
        on_root(self.comm, self._write_end, said, [] if put_off is None else [put_off], share=False)

    def _write_end(self, said: dict, put_off: Sequence[Step]) -> None:
        if put_off:
            self._write(put_off)
        for file in (self._journal, self._latest):
            if file is not None:
                file.close()
        note_record(self._end, {}, said)

    def _shared(self, branch: Branch | None) -> Branch | None:
        """Return a branch of rank 0 on every rank, without the motion of its points on the others."""
        light = branch and replace(branch, points=[replace(point, U=NOTHING, p=NOTHING) for point in branch.points])
        shared = self.comm.bcast(light)
        return branch if self.comm.rank == 0 else shared
