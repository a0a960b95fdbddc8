"""Where a run makes its files while earlier ones are in its folder, and how they take their places.  Rank 0."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path

from ..messages.errors import CaseError
from ..system.files import BESIDE, make_folder, said_of
from ..system.signals import unbroken

UNFINISHED, EARLIER = "unfinished", "earlier"
RESULTS, TABLE = "results.h5", "frf.csv"
WRITTEN = (RESULTS, TABLE, "run.log")  # again by every run
OPTIONAL = ("modes.vtkhdf", "peak_response.vtkhdf")  # fields, by every run that wants them
# by runs and by plot, report and convert; whatever else is in a folder is its owner's
_OURS = re.compile(
    r"results\.(h5|unv|mat)|frf\.csv|run\.log|report\.html"
    r"|(response\d*|peaks\d*|states|slip_map|rom_size|energy|energy_map|error|rest)\.png"
    r"|(modes|peak_response|mode_shapes|rest|joint|(joint_)?motion_\d+)\.vtkhdf"
)
_PART = re.compile(r"(setup|level)-[0-9a-f]{24}")


def is_part(path: Path) -> bool:
    """Return whether a path is that of a set-up or a level that this program keeps, by its name.  Local."""
    return _PART.fullmatch(path.name) is not None and path.is_dir()


def is_ours(name: str) -> bool:
    """Return whether a file of this name in a folder for results is one that this program writes there.  Local."""
    return _OURS.fullmatch(name) is not None


def place_of(folder: Path) -> Path:
    """Return where files are made: in ``unfinished/`` while earlier results are in the folder, else in the folder itself.

    What a run that was killed had half written is removed from both, and its pictures: they may be of another scene.  Files that
    this program does not write stay where they are.

    Raises
    ------
    CaseError : a folder has the name of a file
    """
    place = folder / UNFINISHED if any((folder / name).is_file() for name in (RESULTS, TABLE)) else folder
    for path in (within / name for within in {folder, place} for name in WRITTEN):
        if path.is_dir():
            raise CaseError(f"{path}: cannot be written: Is a directory; choose another folder with --out")
    half_written = [path for within in {folder, place} for path in within.glob(f"*{BESIDE}") if is_ours(path.stem)]
    drawn = [path for path in _files_of(place) if path.name not in WRITTEN] if place != folder else []
    for path in (*half_written, *drawn):
        with suppress(OSError):  # also a place that is taken, of which writing will tell
            path.unlink()
    return place


def settle(folder: Path, place: Path, keeps_earlier: bool = False) -> None:
    """Move the files of ``place`` to their folder, those of the earlier run before them to ``earlier-N/`` if they stay.

    Raises
    ------
    CaseError, ResourceError : they cannot be moved
    """
    if place == folder:
        return
    with unbroken(), said_of(str(folder)):
        if keeps_earlier:
            _move(folder, _next_of(folder / EARLIER))
        for name in OPTIONAL:
            if not (place / name).exists():
                (folder / name).unlink(missing_ok=True)
        _move(place, folder)
        with suppress(OSError):  # something of its owner is in it
            place.rmdir()


def _move(source: Path, target: Path) -> None:
    """Move the files that this program writes from one folder to another, the results first."""
    make_folder(str(target))
    for path in sorted(_files_of(source), key=lambda path: path.name != RESULTS):
        os.replace(path, target / path.name)


def _files_of(folder: Path) -> list[Path]:
    """Return the files in a folder that this program writes there; none where there is no folder."""
    return [path for path in folder.glob("*") if path.is_file() and is_ours(path.name)]


def _next_of(path: Path) -> Path:
    """Return the first of path-1, path-2, ... that is not there."""
    number = 1
    while (found := path.with_name(f"{path.name}-{number}")).exists():
        number += 1
    return found
