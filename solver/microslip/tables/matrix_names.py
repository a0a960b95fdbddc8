"""How a scene names matrices: a file, or a matrix in a file, "model.mat:K"; and which files may tell the nodes of their rows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .structure import Model

KEYS = ("stiffness", "mass", "damping", "recovery")
_WITH_NODES = (".sti", ".mas", ".pch", ".dmig", ".bdf", ".full", ".sub")


def split_name(stated: str, folder: Path) -> tuple[str, str | None]:
    """Return file and name of a matrix; the name is what follows the last colon, unless a file is called so.  Local."""
    path, colon, name = stated.rpartition(":")
    try:
        is_file = (folder / stated).is_file()
    except (OSError, ValueError):
        return stated, None
    return (stated, None) if is_file or not colon or not path or not name else (path, name)


def may_know_nodes(model: Model, folder: Path) -> bool:
    """Tell whether nodes and directions may be known of the rows: stated, or by the format of a matrix.  Local."""
    if model.dofs is not None or model.recovery is not None:
        return True
    for key in ("stiffness", "mass"):
        stated = getattr(model, key)
        path = folder / split_name(stated, folder)[0] if stated is not None else Path()
        if path.suffix.lower() in _WITH_NODES or (path.suffix.lower() == ".mtx" and not _is_matrix_market(path)):
            return True
    return False


def _is_matrix_market(path: Path) -> bool:
    """Return whether a file begins as Matrix Market's do, or cannot be read; otherwise it may be one of Abaqus."""
    try:
        if not path.is_file():
            return True
        with open(path, "rb") as file:
            return file.read(2) in (b"%%", b"")
    except (OSError, ValueError):
        return True
