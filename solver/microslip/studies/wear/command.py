"""The command `wear`: build, then cycles and jumps in turn; curves of the new and the worn joint; table, files, pictures."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ...library.build import build
from ...library.follow_response import follow
from ...library.jumps import WornState
from ...library.prepare import Prepared
from ...library.result_files import head_of, writer_of
from ...library.wear import WearCycle, WearingJoint, wear_of
from ...library.worn_joints import history_of
from ...messages.errors import ConvergenceError
from ...messages.words import counted
from ...observe.log import RunLog
from ...observe.stops import explaining_continuation
from ...parallel.agree import on_root
from ...restart.branch_files import of_point, to_point
from ...restart.identity import identity_of
from ...restart.records import Arrays, Journal, checked_read, length_of, read_records, unpack
from ...scene.schema import Scene
from ...system.files import make_folder
from ..log import log_of
from .report import write_wear

NAME = "wear.jumps"
_POINT = "point/"
_OF_CYCLE = ("N0", "T0", "energy", "rate")

State = WornState[WearCycle]


class Progress:
    """The file of the jumps so far.  All methods are collective on ``comm``; rank 0 reads and writes.

    A study of more cycles, or of fewer, uses the jumps up to its end.

    Raises
    ------
    CaseError, ResourceError : the file cannot be read or written; on every rank
    """

    def __init__(self, comm: MPI.Comm, folder: Path, scene: Scene, options: tuple[str, ...], fresh: bool):
        self.comm, self._path = comm, folder / NAME
        self._journal: Journal | None = None
        self.states: list[State]
        self.states, self.note = on_root(comm, self._opened, scene, options, fresh)

    def _opened(self, scene: Scene, options: tuple[str, ...], fresh: bool) -> tuple[list[State], str]:
        make_folder(str(self._path.parent))
        end = wear_of(scene).cycles
        states, length, is_other = checked_read(self._path, _read, self._path, _key(scene, options), end)
        note = "the jumps of an earlier study of other inputs are not used" if is_other else ""
        if fresh and states:
            states, length, note = [], 0, ""
        elif states:
            note = (
                f"continues after {counted(len(states) - 1, 'jump')}, at {states[-1].cycles:.6g} cycles (--fresh recomputes them)"
            )
        self._journal = Journal(self._path, length)
        if not length:
            self._journal.append({}, {"key": _key(scene, options)})
        return states, note

    def append(self, state: State) -> None:
        """Add the joint after a jump."""
        on_root(self.comm, self._append, state, share=False)
        self.states.append(state)

    def _append(self, state: State) -> None:
        arrays, texts = of_point(state.cycle.point)
        numbers = [state.cycles, state.jump, state.error, state.number, state.cycle.damping]
        self._journal.append(
            {
                **{_POINT + name: values for name, values in arrays.items()},
                **{name: getattr(state.cycle, name) for name in _OF_CYCLE},
                "depth": state.depth,
                "total": state.energy,
                "state": np.array(numbers, dtype=float),
            },
            texts,
        )

    def close(self) -> None:
        """Close the file."""
        on_root(self.comm, self._close, share=False)

    def _close(self) -> None:
        if self._journal is not None:
            self._journal.close()


def _key(scene: Scene, options: tuple[str, ...]) -> str:
    """Return the key of all inputs but the number of cycles.  Local."""
    identity = identity_of(scene, options)
    wear = {key: value for key, value in identity.scene["wear"].items() if key != "cycles"}
    return replace(identity, scene={**identity.scene, "wear": wear}).whole


def _read(path: Path, key: str, end: float) -> tuple[list[State], int, bool]:
    """Return the states of a file of this key up to a number of cycles, their bytes, and whether it is of another key.  Local."""
    records = read_records(path)
    if not records or unpack(records[0])[1].get("key") != key:
        return [], 0, bool(records)
    states = [_state_of(*unpack(record)) for record in records[1:]]
    states = [state for state in states if state.cycles <= end]
    return states, length_of(records[: 1 + len(states)]), False


def _state_of(arrays: Arrays, texts: dict) -> State:
    of_point_alone = {name.removeprefix(_POINT): values for name, values in arrays.items() if name.startswith(_POINT)}
    cycles, jump, error, number, damping = arrays["state"].tolist()
    cycle = WearCycle(to_point(of_point_alone, texts), damping, **{name: arrays[name] for name in _OF_CYCLE})
    return WornState(cycles, arrays["depth"], arrays["total"], cycle, jump, error, int(number))


@dataclass(frozen=True)
class Request:
    """Options of the command line."""

    fresh: bool = False  # whether jumps of an earlier study are left unused


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, options: tuple[str, ...] = ()) -> None:
    """Compute the wear of the joints of a scene by its table [wear]; continue after the last jump of an earlier study.

    Collective on ``comm``.

    Raises
    ------
    CaseError, MeshError, ResourceError : on every rank
    ConvergenceError : wear or a curve ended early, after everything was written; on every rank
    """
    wear_of(scene)
    with explaining_continuation(folder), log_of(comm, folder / "wear.log", scene, options) as log:
        structure = build(scene, comm, log)
        wearing, failures = WearingJoint(structure), list[str]()
        progress = Progress(comm, folder, scene, options, request.fresh)
        try:
            if progress.note:
                log.note(progress.note)
            with log.stage("wear"):
                try:
                    follow_to_the_end(wearing, progress, log)
                except ConvergenceError as problem:
                    failures.append(str(problem))
        finally:
            progress.close()
        if progress.states:
            failures += write_study(wearing, progress.states, folder, options, log)
        structure.close()
    if failures:
        raise ConvergenceError("\n".join(failures) + f"\nwhat was computed is in {folder}")


def follow_to_the_end(wearing: WearingJoint, progress: Progress, log: RunLog) -> None:
    """Compute the jumps that are left, each on disk before the next.  Collective.

    Raises
    ------
    ConvergenceError, ResourceError : on every rank
    """
    if not progress.states:
        progress.append(wearing.start())
    for state in wearing.follow(progress.states[-1]):
        progress.append(state)
        log.note(_line(state), on_screen=False)


def _without_sliding(wearing: WearingJoint, last: State) -> str:
    """Return the message for a joint of which no pair slides."""
    where = f"at {wearing.level:g} {wearing.units.level}"
    if last.number == 0:
        return (
            f"no pair with a coefficient above 0 slides {where}: nothing wears; a higher level, or less friction, makes it slide"
        )
    return f"after {last.cycles:.6g} cycles no pair slides {where}: the cycles left change nothing"


def _line(state: State) -> str:
    point = state.cycle.point
    return (
        f"jump {state.number} to {state.cycles:.6g} cycles: depth up to {state.depth.max():.4g} m (error of the jump "
        f"{state.error:.1e} m), {point.omega / (2.0 * np.pi):.8g} Hz, friction loss {state.cycle.energy.sum():.5g} J"
    )


def write_study(wearing: WearingJoint, states: list[State], folder: Path, options: tuple[str, ...], log: RunLog) -> list[str]:
    """Compute the curves of the new and the worn joint, write and draw all; return why curves ended early.  Collective."""
    comm, last = wearing.structure.comm, states[-1]
    with log.stage("curves"):
        new = wearing.prepared(states[0].depth)
        joint = head_of(new).joint
        failures = _write_curve(new, folder, options)
        worn = folder / "worn" if last.depth.any() else None
        if worn is not None:
            failures += _write_curve(wearing.prepared(last.depth), worn, options)
    text = on_root(comm, lambda: write_wear(history_of(wearing, joint, states), folder, worn))
    log.note(text)
    if not last.cycle.rate.any():
        log.note(_without_sliding(wearing, last))
    log.note(f"results in {folder}")
    return failures


def _write_curve(prepared: Prepared, folder: Path, options: tuple[str, ...]) -> list[str]:
    """Write frf.csv and results.h5 of the level; return why its curve ended early.  Collective."""
    writer = writer_of(prepared, folder, options)
    try:
        (branch,) = follow(prepared.response, [writer], keeps_motion=False)
    finally:
        writer.close()
    return [f"curve in {folder}: level {branch.why_ended}"] if branch.failure else []
