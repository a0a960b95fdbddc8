"""The order in which a factorisation eliminates: nested dissection by METIS, with a joint last.

The columns of G_static then pass the top of the elimination tree alone: docs/theory.md, section 4.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..assembly._rows import groups
from ..parallel.agree import on_root
from ..parallel.metis import nested_dissection
from .bridge import within_int32


@dataclass(frozen=True, eq=False)
class Order:
    """An order of elimination.  On rank 0; both arrays are empty elsewhere."""

    places: np.ndarray  # (n,) of every row, from 1
    starts: np.ndarray  # (n_groups + 1,) first rows, from 1, of groups of one pattern, which stay together; and n + 1


@dataclass(frozen=True, eq=False)
class Elimination:
    """The elimination order of a symmetric matrix, before it is factored."""

    last: np.ndarray | None = None  # (m,) rows that come last: those of a joint
    order: Order | None = None  # the whole order, from a factor of a matrix with the same pattern


def elimination_order(A: PETSc.Mat, last: np.ndarray, is_bounded: bool = True) -> Order:
    """Return the order of elimination of a symmetric matrix.

    Collective on A's communicator: one gather of a third of the pattern.

    Parameters
    ----------
    last : (m,) global rows that come after all others, unless they are so many that the front of them would be larger than
        those of a solid, n^(2/3), and ``is_bounded``
    """
    comm = A.comm.tompi4py()
    gathered = comm.gather((A.getLocalSize()[0], *groups(A)))

    def order() -> Order:
        assert gathered is not None, "rank 0 has it"
        n_rows, first_of, counts, columns = zip(*gathered)
        offsets = np.concatenate([[0], np.cumsum(n_rows)])
        n = within_int32(int(offsets[-1]), "unknowns")
        firsts = np.concatenate([first + offset for first, offset in zip(first_of, offsets)])
        group = np.repeat(np.arange(len(firsts)), np.diff(np.append(firsts, n)))
        graph = _graph_of_groups(group, np.concatenate(counts), np.concatenate(columns))
        is_last = np.zeros(len(firsts), dtype=bool)
        is_last[group[last if len(last) <= n ** (2.0 / 3.0) or not is_bounded else []]] = True
        place = np.empty(len(firsts), dtype=np.int64)
        place[np.concatenate([_dissected(graph, np.flatnonzero(~is_last)), np.flatnonzero(is_last)])] = np.arange(len(firsts))
        positions = np.empty(n, dtype=np.int32)
        positions[np.argsort(place[group], kind="stable")] = np.arange(1, n + 1)
        return Order(positions, np.append(firsts, n).astype(np.int32) + 1)

    nothing = np.empty(0, dtype=np.int32)
    return on_root(comm, order, share=False) or Order(nothing, nothing)


def last_of_all(order: Order, rows: np.ndarray) -> Order:
    """Return the order with some rows at its end, in the order of ``rows`` (m,); without groups.  Local."""
    n = len(order.places)
    if n == 0:
        return order
    sequence = np.argsort(order.places)
    is_last: np.ndarray = np.zeros(n, dtype=bool)
    is_last[rows] = True
    places = np.empty(n, dtype=np.int32)
    places[np.concatenate([sequence[~is_last[sequence]], rows])] = np.arange(1, n + 1)
    return Order(places, np.empty(0, dtype=np.int32))


def _graph_of_groups(group: np.ndarray, lengths: np.ndarray, columns: np.ndarray) -> sp.csr_matrix:
    """Return the coupling of groups, (n_groups, n_groups), from the number of columns of each, and these, rising.  Local."""
    row = np.repeat(np.arange(len(lengths), dtype=np.int32), lengths)
    column = group[columns].astype(np.int32)
    is_new = np.append(True, (np.diff(column) != 0) | (np.diff(row) != 0))[: len(row)] & (row != column)
    starts = np.concatenate([[0], np.cumsum(np.bincount(row[is_new], minlength=len(lengths)))])
    within_int32(int(starts[-1]), "couplings in the graph of a matrix")
    return sp.csr_matrix((np.ones(int(starts[-1]), dtype=np.int8), column[is_new], starts), (len(lengths), len(lengths)))


def _dissected(graph: sp.csr_matrix, members: np.ndarray) -> np.ndarray:
    """Return the members of a graph, (m,), in the order of nested dissection.  Local."""
    if len(members) <= 1:
        return members
    subgraph = graph if len(members) == graph.shape[0] else graph[members][:, members]
    return members[nested_dissection(subgraph)]
