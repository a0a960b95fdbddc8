"""Subdomains of strongly coupled pairs, from the receptance, without coordinates of the pairs."""

from __future__ import annotations

import numpy as np

from .columns import ReceptanceColumns

_LEAST = 1e-30  # lower bound of a coupling, relative to the pair's own motion


def bisected(G: ReceptanceColumns, subdomains: list[np.ndarray], most: int) -> list[np.ndarray]:
    """Return ``subdomains`` of active pairs, bisected until none has more than ``most``.  Collective: three gathers a bisection.

    Subdomains are ascending numbers (k,) among the active pairs, the same on every rank.
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
    """Return two halves of a subdomain, each with the pairs more strongly coupled to one of its two ends.  Collective.

    The ends are the pair most weakly coupled to an arbitrary pair, and the pair most weakly coupled to this one.
    """
    first = subdomain[np.argmin(coupling(G, int(subdomain[0]), subdomain))]
    to_first = coupling(G, int(first), subdomain)
    last = subdomain[np.argmin(to_first)]
    order = np.argsort(to_first / coupling(G, int(last), subdomain), kind="stable")
    middle = len(subdomain) // 2
    return [np.sort(subdomain[order[middle:]]), np.sort(subdomain[order[:middle]])]


def coupling(G: ReceptanceColumns, pair: int, among: np.ndarray) -> np.ndarray:
    """Return the static motion of some active pairs under forces on one ``pair`` of them, relative to its motion, (m,).

    Collective: one gather.  ``among`` (m,) are ascending numbers among the active pairs.
    """
    size = G.static_coupling(pair, among)
    return np.maximum(size / (size[np.searchsorted(among, pair)] or 1.0), _LEAST)
