"""Proximity search for objects of very different sizes, with one tree per class of size."""

from itertools import chain

import numpy as np
from scipy.spatial import cKDTree


def trees_by_size(centre: np.ndarray, radius: np.ndarray) -> list[tuple[np.ndarray, cKDTree, float]]:
    """Return objects in classes of size, a factor of two each, with a tree of their centres and their largest radius.

    Local.  ``centre`` (n, 3) and ``radius`` (n,) m.  A large object then widens only the search in its class.
    """
    return [(members, cKDTree(centre[members]), float(radius[members].max())) for members in classes_of_size(radius)]


def classes_of_size(radius: np.ndarray) -> list[np.ndarray]:
    """Return the numbers of objects in classes of size, a factor of two each; ``radius`` (n,) m.  Local."""
    exponent = np.frexp(np.maximum(radius, 1e-300))[1]
    return [np.flatnonzero(exponent == e) for e in np.unique(exponent)]


def pairs_within(trees, queries: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (query, object), (m,) each, of all objects possibly within the reach of queries, class by class.

    Local.  ``queries`` (n, 3) and ``reach`` (n,) m; ``trees`` from ``trees_by_size``.
    """
    parts = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))]
    for members, tree, radius in trees:
        neighbours = tree.query_ball_point(queries, reach + radius, return_sorted=False)
        count = np.fromiter(map(len, neighbours), dtype=np.int64, count=len(neighbours))
        things = members[np.fromiter(chain.from_iterable(neighbours), dtype=np.int64, count=count.sum())]
        parts.append((np.repeat(np.arange(len(queries)), count), things))
    at, on = (np.concatenate(column) for column in zip(*parts, strict=True))
    return at, on
