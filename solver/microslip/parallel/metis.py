"""METIS, which must not receive SIGTERM: its own handler leaves the call by longjmp, also out of malloc.

The process then waits for ever for a lock of malloc, or crashes.  The signal waits until METIS returns; a graph that takes METIS
seconds is divided by another process, which ends when a signal stops this one.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import scipy.sparse as sp

from ..messages.errors import CaseError, ResourceError
from ..system import sandbox
from ..system.memory import bounded_by_machine
from ..system.signals import STOPPING, raise_stop

NAME = "METIS"
LARGE = 4_000_000  # entries and ten times the nodes of a graph, for which METIS takes 2 s: mpirun kills as long after its signal
_LONGEST = 86_400  # s
_MEMORY = 2**30, 400  # bytes, and per entry, that another process may take: ten times what METIS needs


def partition(graph: sp.csr_matrix, n_parts: int, weights: np.ndarray) -> np.ndarray:
    """Return the part of every node of a graph, (n,), with parts of equal weight and few cut edges.  Local.

    Raises CaseError if METIS is missing, ResourceError if it needs more memory than there is.
    """
    _metis("several ranks need METIS")
    return _divided(_partition, graph, n_parts, weights.astype(np.int32))


def nested_dissection(graph: sp.csr_matrix) -> np.ndarray:
    """Return a fill-reducing order of the nodes of a graph, (n,).  Local; raises as `partition`."""
    _metis("a factor's order needs METIS")
    return _divided(_order, graph)


def _divided(function: Callable[..., np.ndarray], graph: sp.csr_matrix, *arguments) -> np.ndarray:
    """Return the result of a function of METIS for a graph, here or from another process."""
    edges = graph.indptr.astype(np.int32), graph.indices.astype(np.int32)
    try:
        if graph.nnz + 10 * graph.shape[0] <= LARGE:
            with _undisturbed():
                result = function(*edges, *arguments)
        else:
            memory = bounded_by_machine(_MEMORY[0] + _MEMORY[1] * graph.nnz)
            result = sandbox.call(function, *edges, *arguments, seconds=_LONGEST, memory=memory)
    except (RuntimeError, sandbox.LibraryError, sandbox.SandboxError) as problem:  # pymetis gives no cause
        raise_stop()
        raise ResourceError(
            f"METIS did not divide a graph of {graph.shape[0]} nodes, probably for lack of memory ({problem})"
        ) from problem
    return np.asarray(result, dtype=np.int64)


def _partition(indptr: np.ndarray, indices: np.ndarray, n_parts: int, weights: np.ndarray) -> np.ndarray:
    import pymetis

    return np.asarray(pymetis.part_graph(n_parts, adjacency=pymetis.CSRAdjacency(indptr, indices), vweights=weights)[1])


def _order(indptr: np.ndarray, indices: np.ndarray) -> np.ndarray:
    import pymetis

    return np.asarray(pymetis.nested_dissection(adjacency=pymetis.CSRAdjacency(indptr, indices))[0])


def _metis(needed: str) -> None:
    """Raise CaseError if METIS is missing."""
    try:
        import pymetis  # noqa: F401  for its presence
    except ImportError:
        raise CaseError(f"{needed}; install it: pip install pymetis") from None


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Let SIGTERM wait until the end of the block, and restore that signals interrupt calls, which METIS changes.

    A rank that waits in a system call, for example a write to a terminal or to mpirun, would not react to a signal otherwise.
    Other threads must not receive it instead: those of this program do not.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
    try:
        yield
    finally:
        for number in STOPPING:
            signal.siginterrupt(number, True)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
