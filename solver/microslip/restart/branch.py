"""A branch on disk: its points in a journal, the state after the last of them, and at last how it ended."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..continuation.branch import NOTHING, Branch, Point
from ..continuation.checkpoint import from_arrays, to_arrays
from ..continuation.keeper import Begun, Shorter
from ..parallel.agree import on_root
from ..parallel.files import make_folder
from .points import of_point, to_point
from .records import Arrays, Journal, Latest, length_of, read_record, read_records, unpack, write_record

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..continuation.point_solver import Workspace
    from ..continuation.state import BranchState
    from ..continuation.sweep import Sweep
    from ..continuation.task import BranchTask

_SAID = ("failure", "is_linear", "closes_to", "odd")  # of a branch that ended


class KeptBranch:
    """A :class:`~microslip.continuation.keeper.Keeper` in a folder, one for a segment of a level.  Collective on ``comm``.

    The files are those of rank 0.  What was left by more ranks or fewer is read just as well.  ``others`` are folders of the same
    branch over other ranges.

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
    ):
        self.comm, self._folder, self._say, self._others = comm, folder, say, others
        self._points, self._state, self._end = (folder / f"{name}.{segment}" for name in ("points", "state", "end"))
        self._journal: Journal | None = None  # on rank 0, as the next ones
        self._latest: Latest | None = None
        self._n_points = 0

    def ended(self) -> Branch | None:
        return self._shared(on_root(self.comm, self._read_end, share=False))

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
        found = on_root(self.comm, self._open, share=False)
        arrays = self.comm.bcast(found[0] if found else None)
        if arrays is None:
            return None
        branch = self._shared(Branch(0.0, found[1]) if found else None)
        assert branch is not None, "rank 0 has read its points"
        return from_arrays(task, arrays, workspace), branch.points

    def _open(self) -> tuple[Arrays, list[Point]] | None:
        """Open the files for what comes, after the latest state that is there and the points before it."""
        make_folder(str(self._folder))
        self._end.unlink(missing_ok=True)
        self._latest = Latest(self._state)
        for arrays, said in self._latest.read():
            points, length = self._read_points(said["n_points"])
            if len(points) == said["n_points"]:
                self._journal, self._n_points = Journal(self._points, keep=length), len(points)
                self._say(f"  goes on after {len(points)} points of an earlier run")
                return arrays, points
        self._journal, self._n_points = Journal(self._points), 0
        return None

    def shorter(self, task: BranchTask, workspace: Workspace) -> Shorter | None:
        found = on_root(self.comm, self._read_shorter, task.sweep, share=False)
        known = self.comm.bcast(found and (found[0], found[1]))
        if known is None:
            return None
        sweep, arrays = known
        branch = self._shared(Branch(0.0, found[2]) if found else None)
        assert branch is not None, "rank 0 has read its points"
        return sweep, from_arrays(task, arrays, workspace), branch.points

    def _read_shorter(self, wider: Sweep) -> tuple[Sweep, Arrays, list[Point]] | None:
        """Return the widest range within another over which the branch came to its end, its last state and its points."""
        for folder, sweep in sorted(self._others(), key=lambda other: -other[1].scale):
            other = KeptBranch(self.comm, folder, 0)
            ended, states = read_record(other._end), Latest(other._state).read()
            if not ended or ended[1]["failure"] is not None or not states or not wider.contains(sweep):
                continue
            points, _ = other._read_points(ended[1]["n_points"])
            if len(points) == ended[1]["n_points"] == states[0][1]["n_points"]:
                self._say(f"  {len(points)} of its points are there from a shorter range")
                return sweep, states[0][0], points
        return None

    def _read_points(self, n_points: int) -> tuple[list[Point], int]:
        """Return the first points of the journal and how many bytes they take there."""
        records = read_records(self._points)[:n_points]
        return [to_point(*unpack(record)) for record in records], length_of(records)

    def keep(self, task: BranchTask, state: BranchState | None, points: Sequence[Point]) -> None:
        arrays = None if state is None else to_arrays(task, state)
        on_root(self.comm, self._write, arrays, points, share=False)

    def _write(self, arrays: Arrays | None, points: Sequence[Point]) -> None:
        """Append points, then write the state after them."""
        if self._journal is None:
            self._open()
        assert self._journal is not None and self._latest is not None, "they are open now"
        for point in points:
            self._journal.append(*of_point(point))
        self._n_points += len(points)
        if arrays is not None:
            self._latest.write(arrays, {"n_points": self._n_points})

    def end(self, branch: Branch) -> None:
        said = {"level": branch.level, "n_points": len(branch.points), **{name: getattr(branch, name) for name in _SAID}}
        on_root(self.comm, self._write_end, said, share=False)

    def _write_end(self, said: dict) -> None:
        for file in (self._journal, self._latest):
            if file is not None:
                file.close()
        write_record(self._end, {}, said)

    def _shared(self, branch: Branch | None) -> Branch | None:
        """Return a branch of rank 0 on every rank, without the motion of its points on the others."""
        light = branch and replace(branch, points=[replace(point, U=NOTHING, p=NOTHING) for point in branch.points])
        shared = self.comm.bcast(light)
        return branch if self.comm.rank == 0 else shared
