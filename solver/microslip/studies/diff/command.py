"""The command `diff`: compare two result files, write files, return text and exit status."""

from pathlib import Path

from ...system.files import atomic_write, make_folder
from .picture import draw
from .report import json_of, text_of
from .story import diff

DIFFERENT = 1  # exit status, as in diff(1)


def compare_files(a: str, b: str, tolerance: float | None, bars: bool, out: Path | None, as_json: bool) -> tuple[str, int]:
    """Return the comparison of two result files, and the exit status: 0 equal, 1 different.  Local.

    With a folder ``out`` diff.png and diff.json are written there.

    Raises
    ------
    CaseError : a file cannot be read or written
    ResourceError : the disk is full
    """
    comparison = diff(a, b, tolerance, bars)
    if out is not None:
        make_folder(str(out))
        draw(comparison, str(out / "diff.png"))
        with atomic_write(str(out / "diff.json")) as beside:
            Path(beside).write_text(json_of(comparison) + "\n", encoding="utf-8")
    return (json_of(comparison) if as_json else text_of(comparison)), 0 if comparison.is_same else DIFFERENT
