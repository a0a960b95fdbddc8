"""The log of a study."""

from pathlib import Path

from mpi4py import MPI

from ..observe.log import RunLog
from ..scene.schema import Scene
from ..system.versions import versions


def log_of(comm: MPI.Comm, path: Path, scene: Scene, options: tuple[str, ...], **more: str) -> RunLog:
    """Return the log of a study, headed by scene, ``more``, PETSc options and versions.  Collective on ``comm``."""
    facts = {"scene": scene.source, **more, "PETSc options": " ".join(options) or "none", **versions()}
    return RunLog(comm, str(path), facts=facts)
