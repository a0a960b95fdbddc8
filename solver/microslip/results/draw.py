"""The pictures of a run, shared among its ranks and the processes that draw in addition to them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..parallel.agree import on_each
from .beside import Drawers

if TYPE_CHECKING:
    from mpi4py import MPI


def draw(comm: MPI.Comm, folder: Path, drawers: Drawers, write: Callable[[], None] | None = None) -> None:
    """Draw the pictures of the results in a folder, shared among the ranks and the processes beside them.

    Collective.  Rank 0, which has the least to draw, begins with what there is to ``write``.
    """
    on_each(comm, draw_shares, folder, drawers, write if comm.rank == 0 else None)


def draw_shares(folder: Path, drawers: Drawers, write: Callable[[], None] | None) -> None:
    """Write, and draw the rank's own share of the pictures and what the processes beside it have not drawn.  Local."""
    if write is not None:
        write()
    draw_share(folder, drawers.own)
    for share in drawers.left():
        draw_share(folder, share)


def draw_share(folder: Path, share: slice) -> None:
    """Draw a share of the pictures of the results in a folder.  Local."""
    from .plots import draw_all  # not before: matplotlib takes a fifth of a second

    draw_all(str(folder / "results.h5"), str(folder), share)
