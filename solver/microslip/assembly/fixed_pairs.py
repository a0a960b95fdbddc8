"""Contact pairs whose sides cannot move relative to each other; a joint of such pairs alone is an error in the scene."""

import numpy as np
import scipy.sparse as sp

from ..mesh.data import ContactPairs
from ..mesh.links import Links
from ..messages.errors import CaseError
from ..messages.words import counted
from .maps import next_pair_map, pair_map

FEW = 0.1  # share of a joint's pairs up to which they are the edge of a clamped body, and no warning
_NOTHING = 1e-12  # largest entry of a row of R that vanishes, relative to the largest one of its two sides
_CAUSES = "supports, couplings or equations"


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


def fixed_directions(pairs: ContactPairs, links: Links, is_fixed: np.ndarray) -> np.ndarray:
    """Return along which axes of its frame a pair has no relative displacement, (n_pairs, 3) bool.  Local.

    These are the rows of R T that vanish, T of eq. (2.5) with supports, couplings and equations.  ``is_fixed`` is (n_places, 3).
    The displacement of a second side in the next sector of a disc counts as independent of the first side.
    """
    n_dof, dof = 3 * links.n_places, np.arange(3 * links.n_nodes).reshape(-1, 3)
    leads = ~is_fixed.ravel()
    leads[links.dependent] = False
    m = len(links.dependent)
    follows = sp.csr_matrix((np.ones(m), (links.dependent, np.arange(m))), (n_dof, m))
    T = ((sp.identity(n_dof) + follows @ links.weights) @ sp.diags(leads.astype(float))).tocsr()
    maps = [pair_map(pairs, dof, n_dof)]
    if links.cyclic is not None:
        maps.append(next_pair_map(pairs, links.cyclic.turn, dof, n_dof))
    size = np.sum([_largest(R @ T) for R in maps], axis=0)
    scale = np.sum([_largest(abs(R) @ abs(T)) for R in maps], axis=0)
    return (size <= _NOTHING * scale).reshape(-1, 3) | on_one_point(pairs, links)[:, None]


def on_one_point(pairs: ContactPairs, links: Links) -> np.ndarray:
    """Return which pairs have both sides on nodes that follow one point as a rigid body, (n_pairs,) bool.  Local.

    Across a gap a rotation of the point moves one side relative to the other in R u, which is no motion of the joint.
    """
    sides, is_rigid = pairs.sides(links.n_nodes), np.zeros(pairs.n_pairs, dtype=bool)
    n_terms, axis, columns = np.diff(links.weights.indptr), links.dependent % 3, links.weights.tocsc()
    for i in range(len(links.points)):
        first = 3 * (links.n_nodes + 2 * i)
        weights = columns[:, first : first + 6].tocsr()
        moves = np.asarray(weights[np.arange(len(axis)), axis]).ravel() == 1.0
        followers = links.dependent[moves & (np.diff(weights.indptr) == n_terms)] // 3
        others = (np.bincount(followers, minlength=links.n_places)[: links.n_nodes] < 3).astype(float)
        is_rigid |= np.all([(abs(side) @ others == 0.0) & (np.diff(side.indptr) > 0) for side in sides], axis=0)
    return is_rigid & ~pairs.next_sector


def _largest(matrix: sp.csr_matrix) -> np.ndarray:
    """Return the largest magnitude of each row.  Local."""
    return abs(matrix).max(axis=1).toarray().ravel()


def notes_on_pairs(pairs: ContactPairs, links: Links, is_fixed: np.ndarray, source: str) -> tuple[str, ...]:
    """Return the notes on pairs of a mesh that cannot move, open or slip; ``is_fixed`` is (n_places, 3) bool.  Local, rank 0.

    Raises
    ------
    CaseError : no pair of a joint can move
    """
    if not pairs.n_pairs:
        return ()
    directions, by_supports = fixed_directions(pairs, links, is_fixed), fixed_by_nodes(pairs, is_fixed[: links.n_nodes])
    notes = notes_on_fixed(pairs, directions.all(axis=1) | by_supports, source, by_supports)
    return (*notes, *notes_on_directions(pairs, directions))


def notes_on_fixed(
    pairs: ContactPairs, is_fixed: np.ndarray, source: str, by_supports: np.ndarray | None = None
) -> tuple[str, ...]:
    """Return one note for each joint of which some pairs cannot move, ``is_fixed`` (n_pairs,) bool.  Local.

    ``by_supports`` (n_pairs,) bool are those without a free DOF on either side, by default all that are fixed.

    Raises
    ------
    CaseError : no pair of a joint can move
    """
    notes = []
    for name, of_joint in pairs.by_joint().items():
        n, n_fixed = len(of_joint), np.count_nonzero(is_fixed[of_joint])
        is_plain = by_supports is None or not (is_fixed & ~by_supports)[of_joint].any()
        if n_fixed == n:
            raise CaseError(f"{source}: joint {name!r}: {_refusal(n) if is_plain else _refusal_of_links(n)}")
        if n_fixed:
            warning = "WARNING: " if n_fixed > FEW * n else ""
            counts = f"{n_fixed} of its {counted(n, 'pair')}"
            share = f"({100 * n_fixed / n:.0f} %); these pairs never slip or separate"
            held = (
                f"supports fix both sides of {counts}"
                if is_plain
                else f"the two sides of {counts} cannot move relative to each other"
            )
            notes.append(f"{warning}joint {name!r}: {held} {share}" + ("" if is_plain else f" ({_CAUSES})"))
    return tuple(notes)


def notes_on_directions(pairs: ContactPairs, is_fixed: np.ndarray) -> tuple[str, ...]:
    """Return a note for each joint of which more than a few pairs cannot open, or cannot slip.  Local.

    ``is_fixed`` is (n_pairs, 3) bool, along x, y and z of the frames; pairs that cannot move at all are not counted.
    """
    x, y, z = is_fixed.T
    notes = []
    for name, of_joint in pairs.by_joint().items():
        n = len(of_joint)
        for which, verb, motion in ((z & ~(x & y), "open", "normal"), (x & y & ~z, "slip", "tangential")):
            count = np.count_nonzero(which[of_joint])
            if count > FEW * n:
                notes.append(
                    f"joint {name!r}: {count} of its {counted(n, 'pair')} cannot {verb}: {_CAUSES} fix their {motion} "
                    "relative motion"
                )
    return tuple(notes)


def _refusal(n: int) -> str:
    return (
        f"[[supports]] fix both sides of all its {counted(n, 'pair')}, so that none of them can move; a joint needs a "
        "free side: take its "
        "surfaces out of the supports (of supports from the model file: state [[supports]] in the scene, they replace those of "
        "the file)"
    )


def _refusal_of_links(n: int) -> str:
    return (
        f"the two sides of all its {counted(n, 'pair')} cannot move relative to each other: {_CAUSES} (of the scene or "
        "of the model file) "
        "hold both sides, or make one follow the other; a joint needs a side that moves: take its surfaces out of them, or leave "
        "the joint out"
    )
