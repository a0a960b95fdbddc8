"""Rows in the order of the user's nodes, independent of the partition: for signs of modes, and for modes stored in files."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..assembly.system import System
    from ..linear.joint_springs import Linearised


def user_order(linearised: Linearised) -> np.ndarray:
    """Return (n_owned,) the position of each owned row in an order that is independent of the partition.  Local."""
    maps = linearised.maps
    row_start, row_end = linearised.M.getOwnershipRange()
    if maps is not linearised.system:  # real and imaginary parts alternate
        number = _places(maps, maps.rows.start, maps.rows.stop)
        return (2 * number[:, None] + np.arange(2)).ravel()
    return _places(maps, row_start, row_end)


def _places(system: System, row_start: int, row_end: int) -> np.ndarray:
    """Return the position of each row of a system from ``row_start`` to ``row_end`` - 1."""
    if system.dof is None:
        return np.arange(row_start, row_end)
    constraints = getattr(system, "constraints", None)
    number = np.empty(row_end - row_start, dtype=np.int64)
    rows = system.dof.ravel() if constraints is None else constraints.free.ravel()
    is_owned = (rows >= row_start) & (rows < row_end)
    number[rows[is_owned] - row_start] = np.flatnonzero(is_owned)
    return number


def in_user_order(linearised: Linearised, owned: np.ndarray) -> np.ndarray | None:
    """Return rows (n_owned, m) of all ranks as one array (n_dof, m) on rank 0, None elsewhere.  Collective: two gathers."""
    comm = linearised.system.comm
    places, rows = comm.gather(user_order(linearised)), comm.gather(owned)
    if places is None or rows is None:
        return None
    return np.concatenate(rows)[np.argsort(np.concatenate(places))]


def from_user_order(linearised: Linearised, fields: np.ndarray | None) -> np.ndarray:
    """Return this rank's rows (n_owned, m) of the array (n_dof, m) that rank 0 passes.  Collective: a gather, a scatter."""
    comm = linearised.system.comm
    places = comm.gather(user_order(linearised))
    shares: list[np.ndarray] = []
    if places is not None and fields is not None:
        rank_of = np.argsort(np.argsort(np.concatenate(places)))  # global position of each row in rank order
        shares = np.split(fields[rank_of], np.cumsum([len(place) for place in places])[:-1])
    return np.asfortranarray(comm.scatter(shares))
