"""Subdomains of pairs that are coupled strongly, from the receptance itself: no positions are needed."""

from __future__ import annotations

import numpy as np

from .columns import ReceptanceColumns

_LEAST = 1e-30  # of a pair's own compliance: a coupling is taken to be no weaker


def bisected(G: ReceptanceColumns, subdomains: list[np.ndarray], most: int) -> list[np.ndarray]:
    """Return ``subdomains`` of active pairs halved until none has more than ``most``.  Collective: three gathers a halving.

    Subdomains are numbers (k,) among the active pairs, rising; the same on every rank.
    """
    small, waiting = [], subdomains[::-1]
    while waiting:
        subdomain = waiting.pop()
        if len(subdomain) <= most:
            small.append(subdomain)
        else:
            waiting += _halves(G, subdomain)[::-1]
    return small


def _halves(G: ReceptanceColumns, subdomain: np.ndarray) -> list[np.ndarray]:
    """Return the half of a subdomain nearer to one end of it, and the half nearer to the other.  Collective.

    The ends are a pair that is coupled least to some pair, and one that is coupled least to that; near means coupled more.
    """
    first = subdomain[np.argmin(coupling(G, int(subdomain[0]))[subdomain])]
    to_first = coupling(G, int(first))[subdomain]
    last = subdomain[np.argmin(to_first)]
    order = np.argsort(to_first / coupling(G, int(last))[subdomain], kind="stable")
    middle = len(subdomain) // 2
    return [np.sort(subdomain[order[middle:]]), np.sort(subdomain[order[:middle]])]


def coupling(G: ReceptanceColumns, pair: int) -> np.ndarray:
    """Return the static motion of each active pair under forces on one of them, (n_active,), over that pair's own motion.

    Collective: one gather.
    """
    owned = G.static_coupling(pair)
    size = owned if G.model.comm.size == 1 else np.concatenate(G.model.comm.allgather(owned))  # rank order is row order
    return np.maximum(size / (size[pair] or 1.0), _LEAST)
