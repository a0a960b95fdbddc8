"""METIS, and what it does to signals: it answers SIGTERM itself while it works, and leaves it so that system calls go on.

A rank that then waits in a write, to a terminal or to mpirun, would never hear that it is to stop.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import scipy.sparse as sp

from ..messages.errors import CaseError, Interrupted
from ..system.signals import STOPPING

NAME = "METIS"


def partition(graph: sp.csr_matrix, n_parts: int, weights: np.ndarray) -> np.ndarray:
    """Return the part of every node of a graph, (n,), parts alike in weight and with few edges between them.  Local.

    Raises CaseError where METIS is missing, Interrupted where a signal ended it.
    """
    metis = _metis("several ranks need METIS")
    with _at_work():
        _, part = metis.part_graph(n_parts, adjacency=_adjacency(metis, graph), vweights=weights.astype(np.int32))
    return np.asarray(part, dtype=np.int64)


def nested_dissection(graph: sp.csr_matrix) -> np.ndarray:
    """Return the nodes of a graph, (n,), in an order in which its factor fills in little.  Local; raises as `partition`."""
    metis = _metis("a factor's order needs METIS")
    with _at_work():
        order, _ = metis.nested_dissection(adjacency=_adjacency(metis, graph))
    return np.asarray(order, dtype=np.int64)


def _metis(needed: str):
    """Return METIS as a module of Python."""
    try:
        import pymetis
    except ImportError:
        raise CaseError(f"{needed}; install it: pip install pymetis") from None
    return pymetis


def _adjacency(metis, graph: sp.csr_matrix):
    """Return the edges of a graph as METIS takes them."""
    return metis.CSRAdjacency(graph.indptr.astype(np.int32), graph.indices.astype(np.int32))


@contextmanager
def _at_work() -> Iterator[None]:
    """Take signals back from METIS after the block, and say of one that ended it."""
    try:
        yield
    except RuntimeError as problem:  # of which pymetis does not say more
        raise Interrupted("stopped by SIGTERM, or by want of memory, while METIS was at work on the mesh") from problem
    finally:
        for number in STOPPING:
            signal.siginterrupt(number, True)
