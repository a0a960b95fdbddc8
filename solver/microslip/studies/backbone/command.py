"""The command `backbone`: build, follow a nonlinear mode, compare with statics and forced responses; tables and pictures."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ...library.backbone import Backbone, backbone
from ...library.build import build
from ...library.respond import Keys, respond
from ...library.response import Response
from ...messages.errors import ConvergenceError
from ...messages.words import counted
from ...observe.log import RunLog
from ...observe.stops import Stops, explaining_continuation
from ...parallel.agree import on_root
from ...points.branch import Point
from ...restart.cache import cache_of
from ...restart.folder import Restart
from ...results.measures import AMPLITUDE, counts
from ...scene.schema import Scene
from ...system.walltime import time_limit
from ..log import log_of
from .report import Forced, write_backbone

WIDTHS = 3.0  # half-power widths on each side of the mode, in which forced responses are computed


@dataclass(frozen=True)
class Request:
    """Options of the command line."""

    mode: int = 1
    farthest: float | None = None  # amplitude over that of first slip; None: to gross slip
    levels: tuple[float, ...] = ()  # N, levels of forced responses; empty: none
    fresh: bool = False  # whether checkpoints of an earlier study are left unused
    walltime: float | None = None  # s, time limit; None: from the scheduler


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, options: tuple[str, ...] = ()) -> None:
    """Compute a nonlinear mode of a scene, and at the requested levels the forced response, synthesised and computed.

    Collective on ``comm``.  The mode continues from the checkpoints of an earlier study in the folder.

    Raises
    ------
    CaseError, MeshError, ResourceError : on every rank
    ConvergenceError : the mode or a curve ended early, after all files were written; on every rank
    Interrupted : a signal or the time limit, with the points of the mode on the disk; on every rank
    """
    limit = on_root(comm, time_limit, request.walltime)
    restart = Restart.open(comm, folder, scene, options, request.fresh, cache_of(folder))
    with explaining_continuation(folder), log_of(comm, folder / "backbone.log", scene, options) as log:
        for note in restart.notes:
            log.note(note)
        prepared = restart.prepared(log, partial(build, scene, comm, log, keeps_reference=False))
        structure, checkpointer = prepared.structure, restart.checkpointer_of_mode(prepared, request.mode, request.farthest, log)
        stops = Stops(log, lambda: None, limit, "the next study continues from this point")  # which the checkpointer saved before
        with log.stage("nonlinear mode"):
            result = backbone(
                structure,
                request.mode,
                farthest=request.farthest,
                on_point=partial(on_root, comm, recorder(log, stops)),
                checkpointer=checkpointer,
            )
        for note in result.notes:
            log.note(note)
        forced: list[Forced] = []
        if request.levels and result.points:
            with log.stage("forced responses"):
                keys: Keys = {"levels": request.levels, "peaks": True, "error_bars": False}
                if (about := band(result, scene)) is not None:
                    keys["frequencies"] = about
                response = respond(structure, **keys)
                forced = [forced_response(result, response, level) for level in request.levels]
        log.note(on_root(comm, write_backbone, result, forced, scene, folder))
        restart.share_columns(log)
        restart.share_factor(prepared, log)
        log.note(f"results in {folder}")
        structure.close()
    restart.tidy()
    ends = f"backbone: mode {result.mode} ends after {counted(len(result.points), 'point')}"
    failed = [f"{ends}: {result.failure}"] if result.failure else []
    failed += [f"level {each.level:g}: {each.failure}" for each in forced if each.failure]
    if failed:
        raise ConvergenceError("\n".join(failed) + f"\nwhat was computed is in {folder}")


def recorder(log: RunLog, stops: Stops) -> Callable[[Point], None]:
    """Return a function that writes a line for a point of a mode to the log, and stops if a signal has arrived.  Rank 0."""
    numbers = count()

    def record(point: Point) -> None:
        _, omega, sigma = point.parameters
        size, (_, n_slip, n_open) = AMPLITUDE.of(point.response[0]), counts(point.state)
        if (i := next(numbers)) == 0:
            log.note(
                f"{'point':>7} {'frequency_Hz':>12} {'amplitude_m':>12} {'damping_ratio':>13} {'slip':>5} {'open':>5} "
                f"{'newton':>6} {'gmres':>5} {'seconds':>8}",
                on_screen=not log.screen.interactive,
                in_results=False,
            )
        log.note(
            f"{i:>7} {omega / 2.0 / np.pi:>12.8g} {size:>12.5e} {-sigma / 2.0 / omega:>13.5e} {n_slip:>5} {n_open:>5} "
            f"{point.newton:>6} {point.krylov:>5} {point.seconds:>8.4f}",
            on_screen=not log.screen.interactive,
            in_results=False,
        )
        stops.point(0, i, point)

    return record


def band(result: Backbone, scene: Scene) -> tuple[float, float] | None:
    """Return the range of the forced responses [Hz], about the mode; None where that of the scene is about this mode.  Local."""
    if scene.response.mode == result.mode and not result.counts_open:
        return None
    met, far = [result.linear_frequency, *result.frequency], WIDTHS * 2.0 * max(result.linear_damping, *result.damping)
    return min(met) / (1.0 + far), max(met) * (1.0 + far)


def forced_response(result: Backbone, response: Response, level: float) -> Forced:
    """Return the synthesised and the computed forced response at a level.  Local."""
    curve = response.level(level)
    return Forced(
        level,
        result.forced(level),
        curve.frequency,
        curve.response[:, :, 1] - 1j * curve.response[:, :, 2],
        curve.peaks or (),
        curve.failure,
    )
