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


FORMATS: dict[str, Callable[[ResultFile, Fields | None, Path, int], list[Path]]] = {
    "vtkhdf": write_series,
    "unv": lambda results, fields, folder, _: [write_unv(folder / "results.unv", results, fields)],
    "mat": lambda results, fields, folder, _: [write_mat(folder / "results.mat", results, fields)],
    "scene": lambda results, fields, folder, _: [write_scene(results, folder)],
}


def convert(path: str, folder: Path, formats: Sequence[str], steps: int = STEPS) -> list[Path]:
    """Write a result file in other formats into a folder and return the files.  Local; no MPI, no PETSc.

    Without ``formats``: all formats of other programs, vtkhdf only if there is a mesh or pairs with positions.

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
            if name != "vtkhdf" or fields is not None or len(joint_mesh(results.joint).sizes)
        ]
    return [file for name in formats for file in FORMATS[name](results, fields, folder, steps)]
