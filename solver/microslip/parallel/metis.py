"""METIS, and a correction of its signal handling: METIS handles SIGTERM itself, and afterwards signals do not interrupt calls.

A rank that waits in a system call, for example a write to a terminal or to mpirun, would then not react to a signal.
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
    """Return the part of every node of a graph, (n,), with parts of equal weight and few cut edges.  Local.

    Raises CaseError if METIS is missing, Interrupted if a signal ended it.
    """
    metis = _metis("several ranks need METIS")
    with _at_work():
        _, part = metis.part_graph(n_parts, adjacency=_adjacency(metis, graph), vweights=weights.astype(np.int32))
    return np.asarray(part, dtype=np.int64)


def nested_dissection(graph: sp.csr_matrix) -> np.ndarray:
    """Return a fill-reducing order of the nodes of a graph, (n,).  Local; raises as `partition`."""
    metis = _metis("a factor's order needs METIS")
    with _at_work():
        order, _ = metis.nested_dissection(adjacency=_adjacency(metis, graph))
    return np.asarray(order, dtype=np.int64)


def _metis(needed: str):
    """Return the Python module of METIS."""
    try:
        import pymetis
    except ImportError:
        raise CaseError(f"{needed}; install it: pip install pymetis") from None
    return pymetis


def _adjacency(metis, graph: sp.csr_matrix):
    """Return the edges of a graph in the format of METIS."""
    return metis.CSRAdjacency(graph.indptr.astype(np.int32), graph.indices.astype(np.int32))


@contextmanager
def _at_work() -> Iterator[None]:
    """Restore the signal settings after the block, and raise Interrupted if a signal ended METIS."""
    try:
        yield
    except RuntimeError as problem:  # pymetis gives no cause
        raise Interrupted("stopped by SIGTERM, or for lack of memory, while METIS was processing the mesh") from problem
    finally:
        for number in STOPPING:
            signal.siginterrupt(number, True)
