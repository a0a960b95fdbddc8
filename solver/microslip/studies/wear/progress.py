"""The jumps of cycles of a wear study on disk: a killed study continues after its last one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ...library.jumps import WornState
from ...library.wear import WearCycle, wear_of
from ...messages.words import counted
from ...parallel.agree import on_root
from ...restart.branch_files import of_point, to_point
from ...restart.identity import identity_of
from ...restart.records import Arrays, Journal, checked_read, length_of, read_records, unpack
from ...scene.schema import Scene
from ...system.files import make_folder

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
