"""Redistribution of rows to the ranks that own them, and back."""

import numpy as np
from mpi4py import MPI


class ToOwners:
    """Sends rows of a block to their owners, or fetches them; the plan is made once.

    Parameters
    ----------
    comm : on which making and sending are collective
    ranges : (size + 1,) rows of the ranks
    rows : (n_here,) global rows that lie here; of :meth:`send` each on one rank
    """

    def __init__(self, comm: MPI.Comm, ranges: np.ndarray, rows: np.ndarray):
        self.comm, self.n_owned = comm, int(ranges[comm.rank + 1] - ranges[comm.rank])
        owner = np.searchsorted(ranges, rows, side="right") - 1
        self._order = np.argsort(owner, kind="stable")
        self._sent = np.bincount(owner, minlength=comm.size).astype(np.int64)
        self._received = np.empty_like(self._sent)
        comm.Alltoall(self._sent, self._received)
        places = self._exchange(np.ascontiguousarray(rows[self._order, None], dtype=np.int64))
        self._places = places[:, 0] - ranges[comm.rank]

    def send(self, X_here: np.ndarray) -> np.ndarray:
        """Return this rank's rows, (n_owned, m), column-major, from those that lie here, (n_here, m).  Collective."""
        X_owned = np.zeros((self.n_owned, X_here.shape[1]), order="F")
        X_owned[self._places] = self._exchange(np.ascontiguousarray(X_here[self._order]))
        return X_owned

    def fetch(self, X_owned: np.ndarray) -> np.ndarray:
        """Return the rows that lie here, (n_here, m), from their owners' (n_owned, m).  Collective."""
        m = X_owned.shape[1]
        received = np.empty((len(self._order), m))
        self.comm.Alltoallv((np.ascontiguousarray(X_owned[self._places]), self._received * m), (received, self._sent * m))
        X_here = np.empty_like(received)
        X_here[self._order] = received
        return X_here

    def _exchange(self, rows: np.ndarray) -> np.ndarray:
        m = rows.shape[1]
        received = np.empty((int(self._received.sum()), m), dtype=rows.dtype)
        self.comm.Alltoallv((rows, self._sent * m), (received, self._received * m))
        return received
