"""The results folder: the output folder while earlier results exist, and their replacement by new results.  Rank 0."""

import os
import re
from contextlib import suppress
from pathlib import Path

from ..messages.errors import CaseError
from ..system.files import BESIDE, file_errors, make_folder
from ..system.signals import unbroken

UNFINISHED, EARLIER = "unfinished", "earlier"
RESULTS, TABLE = "results.h5", "frf.csv"
WRITTEN = (RESULTS, TABLE, "run.log")  # files of every run
_PICTURES = "response|peaks|peaks_over|multipliers|states|slip_map|rom_size|energy|energy_map|sensitivity_map|error|sectors|rest"
# files of run and plot, and of report and convert; other files in a folder belong to the user
_OF_RUN = re.compile(
    r"results\.h5|(frf|peaks_over|sectors|sensitivities)\.csv|run\.log|(modes|peak_response)\.vtkhdf"
    rf"|({_PICTURES})(_?\d+)?\.png"
)
_OF_OTHERS = re.compile(r"results\.(unv|mat)|report\.html|(mode_shapes|rest|joint|(joint_)?motion_\d+)\.vtkhdf")
_PART = re.compile(r"(setup|level|over|mode)-[0-9a-f]{24}")


def is_checkpoint(path: Path) -> bool:
    """Return whether a path has the name of a stored set-up, level, curve of peaks or nonlinear mode.  Local."""
    return _PART.fullmatch(path.name) is not None and path.is_dir()


def is_results_file(name: str) -> bool:
    """Return whether this program writes files of this name into a folder of results.  Local."""
    return _OF_RUN.fullmatch(name) is not None or _OF_OTHERS.fullmatch(name) is not None


def output_folder(folder: Path) -> Path:
    """Return the folder for output: ``unfinished/`` if there are earlier results in the folder, otherwise the folder itself.

    Incomplete files of a killed run are removed from both, and so are its pictures, which may be of another scene.  Files that
    this program does not write are left alone.

    Raises
    ------
    CaseError : a folder has the name of an output file
    """
    output = folder / UNFINISHED if any((folder / name).is_file() for name in (RESULTS, TABLE)) else folder
    for path in (within / name for within in {folder, output} for name in WRITTEN):
        if path.is_dir():
            raise CaseError(f"{path}: cannot be written: Is a directory; choose another folder with --out")
    half_written = [path for within in {folder, output} for path in within.glob(f"*{BESIDE}") if is_results_file(path.stem)]
    drawn = [path for path in _files_of(output) if path.name not in WRITTEN] if output != folder else []
    for path in (*half_written, *drawn):
        with suppress(OSError):  # if it cannot be removed, writing raises a clear error
            path.unlink()
    return output


def move_results(folder: Path, output: Path, keeps_earlier: bool = False) -> None:
    """Move the files of ``output`` to ``folder``; with ``keeps_earlier`` earlier files move to ``earlier-N/`` first.

    Tables, fields, pictures, reports and conversions of an earlier run that this one does not have are removed.

    Raises
    ------
    CaseError, ResourceError : they cannot be moved
    """
    if output == folder:
        return
    with unbroken(), file_errors(str(folder)):
        if keeps_earlier:
            _move(folder, _next_of(folder / EARLIER))
        for path in _files_of(folder):
            if path.name not in WRITTEN and not (output / path.name).exists():
                path.unlink()
        _move(output, folder)
        with suppress(OSError):  # it contains files of the user
            output.rmdir()


def note_on_replaced(folder: Path, output: Path, keeps_earlier: bool) -> str:
    """Return a note on reports and conversions of earlier results, which :func:`move_results` removes; "" without any."""
    names = sorted(path.name for path in _files_of(folder) if _OF_OTHERS.fullmatch(path.name))
    if output == folder or keeps_earlier or not names:
        return ""
    return f"removed with the earlier results: {', '.join(names)} (microslip report and convert write these again)"


def _move(source: Path, target: Path) -> None:
    """Move the files of this program from one folder to another, the results first."""
    make_folder(str(target))
    for path in sorted(_files_of(source), key=lambda path: path.name != RESULTS):
        os.replace(path, target / path.name)


def _files_of(folder: Path) -> list[Path]:
    """Return the files of this program in a folder; none if there is no folder."""
    return [path for path in folder.glob("*") if path.is_file() and is_results_file(path.name)]


def _next_of(path: Path) -> Path:
    """Return the first of path-1, path-2, ... that does not exist."""
    number = 1
    while (free := path.with_name(f"{path.name}-{number}")).exists():
        number += 1
    return free
