"""The command `search`: build, search at a frequency, continue if requested; table, search.csv, curves.csv, search.png."""

from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from ...library.build import build
from ...library.search import STARTS, refuse_what_has_one, search
from ...parallel.agree import on_root
from ...scene.schema import Scene
from ..log import log_of
from .report import write_search


@dataclass(frozen=True)
class Request:
    """The command's arguments in addition to the scene."""

    frequency: float  # Hz
    level: float | None = None  # N; None: the highest of the scene
    starts: int = STARTS
    follow: bool = False  # whether the curve through each other solution is followed


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, options: tuple[str, ...] = ()) -> None:
    """Search for solutions of a scene at a frequency; write and draw those found.

    Collective on ``comm``.

    Raises
    ------
    CaseError, ConvergenceError, MeshError, ResourceError : on every rank
    """
    refuse_what_has_one(scene)
    with log_of(comm, folder / "search.log", scene, options) as log:
        structure = build(scene, comm, log, keeps_reference=False)
        with log.stage("search"):
            result = search(structure, request.frequency, level=request.level, starts=request.starts, follow=request.follow)
        log.note(on_root(comm, write_search, result, scene, folder))
        log.note(f"results in {folder}")
        structure.close()
