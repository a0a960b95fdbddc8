"""A joint at rest whose surfaces are worn: the depth is a gap, and the structure redistributes the preload (section 18)."""

from dataclasses import replace

import numpy as np

from ..mesh.data import ContactPairs
from .equilibrium import Flexibility, equilibrium
from .rest import at_rest

STEPS = 4  # in which the depth is removed


def with_gaps(pairs: ContactPairs, depth: np.ndarray) -> tuple[ContactPairs, np.ndarray]:
    """Return pairs that have lost ``depth`` (n_pairs,) [m], and the preload that this takes from each, (n_pairs,) [N].

    Local.  docs/theory.md, eq. (18.3): where no surface moves.
    """
    N0 = np.where(depth > 0.0, pairs.N0 - pairs.k_n * depth, pairs.N0)  # NaN of a law without a normal force
    return replace(pairs, N0=N0), np.where(depth > 0.0, np.maximum(pairs.N0, 0.0) - np.maximum(N0, 0.0), 0.0)


def worn_at_rest(G: Flexibility, pairs: ContactPairs, depth: np.ndarray) -> ContactPairs:
    """Return pairs with a stated preload that have lost ``depth`` (n_pairs,) [m], at rest in their structure.

    Collective.  docs/theory.md, eq. (18.4): the lost preload acts on the structure, whose springs of all pairs are those of
    ``G``; pairs that open keep them, as those with a gap do, so that no stiffness changes.

    Raises
    ------
    ConvergenceError, ResourceError : no equilibrium, or more pairs that open or slip than a dense solve allows; on every rank
    """
    changed, lost = with_gaps(pairs, depth)
    if not lost.any():
        return changed
    forces_owned = -(G.system.R[2::3, G.system.rows].T @ lost)
    rest = equilibrium(G, changed, forces_owned, STEPS)
    return replace(at_rest(changed, rest), open_at_rest=pairs.open_at_rest)
