"""Where a run makes its files while earlier ones are in its folder, and how they take their places.  Rank 0."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from ..parallel.files import BESIDE, make_folder, said_of
from ..parallel.signals import unbroken

UNFINISHED, EARLIER = "unfinished", "earlier"
RESULTS = "results.h5"
WRITTEN = (RESULTS, "frf.csv", "run.log")  # again by every run
OPTIONAL = ("modes.vtkhdf", "peak_response.vtkhdf")  # fields, by every run that wants them


def place_of(folder: Path) -> Path:
    """Return where files are made: beside the results of an earlier run until all are there, or in the folder itself.

    What a run that was killed had half written is removed from both, and what it had drawn beside: it may be of another scene.
    """
    place = folder / UNFINISHED if (folder / RESULTS).exists() else folder
    drawn = [path for path in place.glob("*") if path.name not in WRITTEN] if place != folder else []
    for half in (*folder.glob(f"*{BESIDE}"), *drawn):
        with suppress(OSError):  # also a place that is taken, of which writing will tell
            half.unlink()
    return place


def settle(folder: Path, place: Path, keeps_earlier: bool = False) -> None:
    """Move the files of ``place`` to their folder, those of the earlier run before them to one of their own if they stay.

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
        place.rmdir()


def _move(source: Path, target: Path) -> None:
    """Move the files of one folder to another, the results first."""
    make_folder(str(target))
    files = [path for path in source.iterdir() if path.is_file() and not path.name.startswith(".")]
    for path in sorted(files, key=lambda path: path.name != RESULTS):
        os.replace(path, target / path.name)


def _next_of(path: Path) -> Path:
    """Return the first of path-1, path-2, ... that is not there."""
    number = 1
    while (found := path.with_name(f"{path.name}-{number}")).exists():
        number += 1
    return found
