"""The command `backbone`: build, follow a nonlinear mode, compare with statics and forced responses; tables and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...library.backbone import Backbone, backbone
from ...library.build import build
from ...library.respond import respond
from ...library.response import Response
from ...messages.errors import ConvergenceError
from ...observe.log import RunLog
from ...parallel.agree import on_root
from ...system.versions import versions
from .report import Forced, write_backbone

if TYPE_CHECKING:
    from mpi4py import MPI

    from ...scene.schema import Scene


@dataclass(frozen=True)
class Request:
    """Options of the command line."""

    mode: int = 1
    farthest: float | None = None  # amplitude over that of first slip; None: to gross slip
    levels: tuple[float, ...] = ()  # N, levels of forced responses; empty: none


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request = Request(), options: tuple[str, ...] = ()) -> None:  # noqa: B008  frozen
    """Compute a nonlinear mode of a scene, and at the requested levels the forced response, synthesised and computed.

    Collective on ``comm``.

    Raises
    ------
    CaseError, MeshError, ResourceError : on every rank
    ConvergenceError : the mode or a curve ended early, after all files were written; on every rank
    """
    facts = {"scene": scene.source, "PETSc options": " ".join(options) or "none", **versions()}
    with RunLog(comm, str(folder / "backbone.log"), facts=facts) as log:
        structure = build(scene, comm, log, keeps_reference=False)
        with log.stage("nonlinear mode"):
            result = backbone(structure, request.mode, farthest=request.farthest)
        for note in result.notes:
            log.note(note)
        forced: list[Forced] = []
        if request.levels and result.points:
            with log.stage("forced responses"):
                response = respond(structure, levels=request.levels, peaks=True, error_bars=False)
                forced = [beside(result, response, level) for level in request.levels]
        log.note(on_root(comm, write_backbone, result, forced, scene, folder))
        log.note(f"results in {folder}")
        structure.close()
    failed = [f"backbone: mode {result.mode} ends after {len(result.points)} points: {result.failure}"] if result.failure else []
    failed += [f"level {each.level:g}: {each.failure}" for each in forced if each.failure]
    if failed:
        raise ConvergenceError("\n".join(failed) + f"\nwhat was computed is in {folder}")


def beside(result: Backbone, response: Response, level: float) -> Forced:
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
