"""The pictures of a run, shared among its ranks."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..parallel.agree import on_each

if TYPE_CHECKING:
    from mpi4py import MPI


def draw(comm: MPI.Comm, folder: Path, write: Callable[[], None] | None = None) -> None:
    """Draw the pictures of the results in a folder, shared among the ranks.

    Collective on ``comm``.  Rank 0, which has the last share, begins with the files to ``write``.

    Raises
    ------
    CaseError, ResourceError : on every rank, if results cannot be read or a picture cannot be written
    """
    share = slice(comm.size - 1 - comm.rank, None, comm.size)
    on_each(comm, write_and_draw, write if comm.rank == 0 else None, folder, share)


def write_and_draw(write: Callable[[], None] | None, folder: Path, share: slice) -> None:
    """Write, and draw a share of the pictures of the results in a folder.  Local."""
    if write is not None:
        write()
    draw_share(folder, share)


def draw_share(folder: Path, share: slice) -> None:
    """Draw a share of the pictures of the results in a folder.  Local."""
    from matplotlib.artist import Artist

    hook = vars(Artist)["__init_subclass__"]
    Artist.__init_subclass__ = classmethod(lambda cls: None)  # documents each class's ``set``: a third of the import
    try:
        from .plots import draw_all  # not before: matplotlib takes a fifth of a second
    finally:
        Artist.__init_subclass__ = hook
    with fonts_in_memory():
        draw_all(str(folder / "results.h5"), str(folder), share)


@contextmanager
def fonts_in_memory() -> Iterator[None]:
    """Let matplotlib read fonts from memory: from a file it reads each letter again at every use, in pieces, for 0.1 s a run."""
    import matplotlib.ft2font

    of_file = matplotlib.ft2font.FT2Font

    def in_memory(path: str, *args, **kwargs):
        return of_file(io.BytesIO(Path(path).read_bytes()), *args, **kwargs)

    matplotlib.ft2font.FT2Font = in_memory
    try:
        yield
    finally:
        matplotlib.ft2font.FT2Font = of_file
