"""Provenance of results: command, machine, and every input file."""

from __future__ import annotations

import hashlib
import os
import socket
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from ..formats.includes import included_files
from ..messages.errors import CaseError
from ..observe.log import command_line
from ..parallel.agree import on_root
from ..results.origin import InputFile, Origin
from ..scene.inputs import named_files
from ..scene.schema import Scene

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


def input_files(scene: Scene) -> tuple[tuple[str, Path], ...]:
    """Return the key that names each file of a scene, and its absolute path.  Local, rank 0.

    The scene file is not included: its text counts (``Scene.text``).

    Raises
    ------
    CaseError : a file cannot be read
    """
    files: list[tuple[str, Path]] = []
    for key, stated in named_files(scene):
        path = scene.folder / stated
        files.append((key, path))
        try:
            files += [(f"included by {path.name}", inner) for inner in included_files(path)]
        except OSError as problem:
            raise CaseError(f"{path}: {problem.strerror}") from None
        rows = path.with_suffix(".dof")  # CalculiX writes the nodes of its matrices there
        if path.suffix.lower() in (".sti", ".mas") and rows.is_file():
            files.append((f"beside {path.name}", rows))
    return tuple(files)


def fingerprint(files: Iterable[tuple[str, Path]]) -> tuple[InputFile, ...]:
    """Return size and SHA-256 hash of files, each read once, a block at a time.  Local, rank 0.

    Raises
    ------
    CaseError : a file cannot be read
    """
    known: dict[Path, tuple[int, str]] = {}
    hashed = []
    for key, path in files:
        if path not in known:
            known[path] = _size_and_hash(path)
        hashed.append(InputFile(key, str(path), *known[path]))
    return tuple(hashed)


def _size_and_hash(path: Path) -> tuple[int, str]:
    try:
        with open(path, "rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            return file.tell(), digest
    except OSError as problem:
        raise CaseError(f"{path}: {problem.strerror}") from None
