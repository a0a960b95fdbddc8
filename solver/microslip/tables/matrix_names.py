"""Names of matrices in a scene: a file, or a matrix in a file, "model.mat:K"."""

from pathlib import Path

KEYS = ("stiffness", "mass", "damping", "recovery")


def split_name(stated: str, folder: Path) -> tuple[str, str | None]:
    """Return file and name of a matrix; the name is what follows the last colon, unless a file is called so.  Local."""
    path, colon, name = stated.rpartition(":")
    try:
        is_file = (folder / stated).is_file()
    except (OSError, ValueError):
        return stated, None
    return (stated, None) if is_file or not colon or not path or not name else (path, name)
