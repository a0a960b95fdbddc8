"""Clusters of pairs that feel each other, found from the receptance itself: no positions, whatever the pairs follow."""

from __future__ import annotations

import numpy as np

from .columns import ReceptanceColumns

_LEAST = 1e-30  # share of a pair's own compliance below which another one feels nothing of it


def halved(G: ReceptanceColumns, clusters: list[np.ndarray], most: int) -> list[np.ndarray]:
    """Return ``clusters`` of active pairs halved until none has more than ``most``.  Collective: three gathers a halving.

    Clusters are numbers (k,) among the active pairs, rising; the same on every rank.
    """
    found, waiting = [], clusters[::-1]
    while waiting:
        cluster = waiting.pop()
        if len(cluster) <= most:
            found.append(cluster)
        else:
            waiting += _halves(G, cluster)[::-1]
    return found


def _halves(G: ReceptanceColumns, cluster: np.ndarray) -> list[np.ndarray]:
    """Return the half of a cluster nearer to one end of it, and the half nearer to the other.  Collective.

    The ends are a pair that feels least of some pair, and one that feels least of that; near is who feels more.
    """
    one = cluster[np.argmin(felt(G, int(cluster[0]))[cluster])]
    of_one = felt(G, int(one))[cluster]
    other = cluster[np.argmin(of_one)]
    order = np.argsort(of_one / felt(G, int(other))[cluster], kind="stable")
    middle = len(cluster) // 2
    return [np.sort(cluster[order[middle:]]), np.sort(cluster[order[:middle]])]


def felt(G: ReceptanceColumns, pair: int) -> np.ndarray:
    """Return how much each active pair feels statically of one of them, (n_active,), over what that feels itself.

    Collective: one gather.
    """
    own = G.static_coupling(pair)
    size = own if G.model.comm.size == 1 else np.concatenate(G.model.comm.allgather(own))  # rank order is row order
    return np.maximum(size / (size[pair] or 1.0), _LEAST)
