"""Results for other programs, from results.h5 alone: files for ParaView, universal files, MATLAB files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ..messages.errors import CaseError
from ..messages.words import hint, listed
from ..system.files import make_folder
from .fields import Fields, read_fields
from .joint_mesh import joint_mesh
from .mat import write_mat
from .paraview import write_series
from .read import read_results
from .record import ResultFile
from .scene_back import write_scene
from .universal_file import write_unv

STEPS = 32  # of a period


def _paraview(results: ResultFile, fields: Fields | None, folder: Path, steps: int) -> list[Path]:
    return write_series(results, fields, folder, steps)


def _unv(results: ResultFile, fields: Fields | None, folder: Path, steps: int) -> list[Path]:
    write_unv(str(folder / "results.unv"), results, fields)
    return [folder / "results.unv"]


def _mat(results: ResultFile, fields: Fields | None, folder: Path, steps: int) -> list[Path]:
    write_mat(str(folder / "results.mat"), results, fields)
    return [folder / "results.mat"]


def _scene(results: ResultFile, fields: Fields | None, folder: Path, steps: int) -> list[Path]:
    return [write_scene(results, folder)]


FORMATS: dict[str, Callable[[ResultFile, Fields | None, Path, int], list[Path]]] = {
    "vtkhdf": _paraview,
    "unv": _unv,
    "mat": _mat,
    "scene": _scene,
}


def convert(path: str, folder: Path, formats: Sequence[str], steps: int = STEPS) -> list[Path]:
    """Write a result file in other formats into a folder and return the files.  Local; no MPI, no PETSc.

    Without ``formats`` those of other programs that there is something for: of a scene given as matrices nothing is shown in
    space.

    Raises
    ------
    CaseError : an unknown format; results that cannot be read, or hold nothing for a format; a place that cannot be written to
    ResourceError : the disk is full
    """
    for name in formats:
        if name not in FORMATS:
            raise CaseError(f"unknown format {name!r}{hint(name, FORMATS, str)}; formats are {listed(FORMATS)}")
    results, fields = read_results(path), read_fields(path)
    make_folder(str(folder))
    if not formats:
        formats = [
            name
            for name in FORMATS
            if name != "scene"
            if FORMATS[name] is not _paraview or fields is not None or len(joint_mesh(results.joint).sizes)
        ]
    return [file for name in formats for file in FORMATS[name](results, fields, folder, steps)]
