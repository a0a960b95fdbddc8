"""Provenance of results: command, machine, and every input file."""

from __future__ import annotations

import os
import socket
import time
from typing import TYPE_CHECKING

from ..messages.errors import CaseError
from ..observe.log import command_line
from ..parallel.agree import on_root
from ..results.origin import InputFile, Origin
from ..scene.inputs import named_files
from ..scene.schema import Scene
from .input_files import fingerprint, input_files

if TYPE_CHECKING:
    from mpi4py import MPI

_VARIABLES = (
    "OPENBLAS_CORETYPE",
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "PETSC_OPTIONS",
)


def origin_of(scene: Scene, comm: MPI.Comm) -> Origin:
    """Return the provenance of the results of a run.  Collective on ``comm``; files are hashed on rank 0.

    A file that cannot be read any more has no hash; results are written nevertheless.
    """
    hosts = comm.allgather(socket.gethostname())
    started = comm.bcast(time.strftime("%Y-%m-%d %H:%M:%S %z"))
    return Origin(
        command=command_line(),
        started=started,
        scene_path=str(scene.path),
        settings=scene.settings,
        hosts=tuple(hosts),
        environment={name: os.environ[name] for name in _VARIABLES if name in os.environ},
        inputs=on_root(comm, _inputs, scene),
    )


def _inputs(scene: Scene) -> tuple[InputFile, ...]:
    """Return the files that a scene reads, with the hashes of those that can be read."""
    try:
        files = input_files(scene)
    except CaseError:
        files = tuple((key, scene.folder / stated) for key, stated in named_files(scene))
    hashed: list[InputFile] = []
    for key, path in files:
        try:
            hashed += fingerprint([(key, path)])
        except CaseError:
            hashed.append(InputFile(key, str(path), 0, ""))
    return tuple(hashed)
