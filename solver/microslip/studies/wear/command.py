"""The command `wear`: build, then cycles and jumps in turn; curves of the new and the worn joint; table, files, pictures."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ...library.build import build
from ...library.follow_response import follow
from ...library.prepare import Prepared
from ...library.result_files import head_of, writer_of
from ...library.wear import WearingJoint, wear_of
from ...library.worn_joints import history_of
from ...messages.errors import ConvergenceError
from ...observe.log import RunLog
from ...observe.stops import explaining_continuation
from ...parallel.agree import on_root
from ...scene.schema import Scene
from ..log import log_of
from .progress import Progress, State
from .report import write_wear


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
