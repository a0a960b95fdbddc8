"""Contact pairs whose both sides supports fix: they never move, and a joint of such pairs alone is a mistake in the scene."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..mesh.data import ContactPairs
from ..messages.errors import CaseError

FEW = 0.1  # share of a joint's pairs up to which they are the edge of a clamped body, and no warning


def fixed_by_nodes(pairs: ContactPairs, is_fixed: np.ndarray) -> np.ndarray:
    """Return which pairs have no free DOF on either side, (n_pairs,) bool.  Local.

    ``is_fixed`` is (n_nodes, 3), of the nodes of ``Mesh.points``.
    """
    is_free = (~is_fixed.all(axis=1)).astype(float)
    first, second = (abs(side) @ is_free for side in pairs.sides(len(is_fixed)))
    return (first == 0.0) & (second == 0.0)


def fixed_by_rows(R: sp.csr_matrix) -> np.ndarray:
    """Return which pairs have no entry in their three rows of R, (n_pairs,) bool.  Local."""
    return np.diff(R.indptr).reshape(-1, 3).sum(axis=1) == 0


def notes_on_fixed(pairs: ContactPairs, is_fixed: np.ndarray, source: str) -> tuple[str, ...]:
    """Return one note for each joint of which some pairs are fixed on both sides, ``is_fixed`` (n_pairs,) bool.  Local.

    Raises
    ------
    CaseError : all pairs of a joint are fixed on both sides
    """
    notes = []
    for name in dict.fromkeys(pairs.joint):
        of_joint = np.array([joint == name for joint in pairs.joint])
        n, n_fixed = int(of_joint.sum()), int((is_fixed & of_joint).sum())
        if n_fixed == n:
            raise CaseError(
                f"{source}: joint {name!r}: [[supports]] fix both sides of all its {n} pairs, so that none of them can move; "
                "a joint needs a free side: take its surfaces out of the supports (of supports from the model file: state "
                "[[supports]] in the scene, they replace those of the file)"
            )
        if n_fixed:
            warning = "WARNING: " if n_fixed > FEW * n else ""
            notes.append(
                f"{warning}joint {name!r}: supports fix both sides of {n_fixed} of its {n} pairs ({100 * n_fixed / n:.0f} %); "
                "these pairs never slip or separate"
            )
    return tuple(notes)
