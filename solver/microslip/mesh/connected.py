"""Connected parts of the mesh (bodies with shared nodes), and whether they are supported."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..messages.errors import MeshError
from ..messages.words import place
from ..tables.structure import Support
from .components import components, parts_of
from .data import ContactPairs, Mesh

if TYPE_CHECKING:
    from .links import Links


def connected_parts(mesh: Mesh, body_of: Mapping[str, str]) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the part of every node, (n_nodes,), and the name of each part.  Local, rank 0.

    Nodes of one element belong to one part; joints do not connect parts.  ``body_of`` names the body of each group.
    """
    n_parts, part = parts_of([block.nodes for block in mesh.elements], len(mesh.points))
    bodies: list[list[str]] = [[] for _ in range(n_parts)]
    for block in mesh.elements:
        for i in np.unique(part[block.nodes[:, 0]]):
            if body_of[block.group] not in bodies[i]:
                bodies[i].append(body_of[block.group])
    plain = [("body " if len(names) == 1 else "bodies ") + " and ".join(map(repr, names)) for names in bodies]
    return part, tuple(
        name if plain.count(name) == 1 else f"{name} (a separate piece around {_centre(mesh, part == i)})"
        for i, name in enumerate(plain)
    )


def tied_bodies(part: np.ndarray, n_parts: int, links: Links | None) -> np.ndarray:
    """Return the tied bodies: the number of the group of parts connected by ties and points, (n_parts,).  Local, rank 0."""
    joined = (*links.joined, *links.more_joined) if links is not None else ()
    first, second = np.concatenate([np.zeros((2, 0), dtype=np.int64), *joined], axis=1)
    return components(part[first], part[second], n_parts)[1]


def fixed_parts(
    part: np.ndarray, n_parts: int, mesh: Mesh, supports: Iterable[Support], links: Links | None = None
) -> np.ndarray:
    """Return which parts have a support or a spring to ground, (n_parts,) bool.  Local, rank 0."""
    fixed = np.zeros(n_parts, dtype=bool)
    for support in supports:
        if support.group is not None:
            fixed[part[mesh.node_groups[support.group]]] = True
        elif links is not None and support.point is not None:
            fixed[part[links.node_of(support.point)]] = True
    if links is not None:
        fixed[part[links.grounded]] = True
    return fixed


def loose_bodies(
    part: np.ndarray, n_parts: int, mesh: Mesh, supports: Iterable[Support], links: Links
) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return the tied bodies of each part, and the parts without support and spring to ground.  Local, rank 0."""
    tied, fixed = tied_bodies(part, n_parts, links), fixed_parts(part, n_parts, mesh, supports, links)
    return tied, tuple(np.flatnonzero(tied == i) for i in np.unique(tied) if not fixed[tied == i].any())


def check_fixed(
    part: np.ndarray,
    names: tuple[str, ...],
    mesh: Mesh,
    supports: Iterable[Support],
    pairs: ContactPairs,
    links: Links | None = None,
) -> bool:
    """Return whether supports hold the structure; a structure connected by joints and ties may be free.  Local, rank 0.

    Raises
    ------
    MeshError : a part has no support and no connection to a supported part or, in a free structure, to the others
    """
    n_parts = len(names)
    fixed = fixed_parts(part, n_parts, mesh, supports, links)
    first, second = (on_parts(side, part, n_parts) for side in pairs.sides(len(part)))
    part1, part2 = (first.T @ second).nonzero()
    tied = tied_bodies(part, n_parts, links)
    _, component = components(np.r_[part1, np.arange(n_parts)], np.r_[part2, n_parts + tied], 2 * n_parts)
    component = component[:n_parts]
    for side, other in ((first, second), (second, first)):
        fixed[side[np.diff(other.indptr) == 0].indices] = True
    if not fixed.any() and len(np.unique(component)) == 1:
        return False
    is_fixed = np.isin(component, component[fixed])
    if not is_fixed.all():
        free = [names[i] for i in np.flatnonzero(~is_fixed)]
        shown = "; ".join(free[:5]) + (" and others" if len(free) > 5 else "")
        raise MeshError(
            f"{mesh.path}: nothing holds {shown}: no support, and no joint to a part that has one, so it can move freely; "
            "add [[supports]] or a joint, or merge the nodes where bodies touch"
        )
    return True


def on_parts(weights: sp.csr_matrix, part: np.ndarray, n_parts: int) -> sp.csr_matrix:
    """Return the number of nodes of each part that move each contact point, (n_pairs, n_parts), from their weights.  Local."""
    ones = np.ones(len(weights.indices))
    return sp.csr_matrix((ones, part[weights.indices], weights.indptr), (weights.shape[0], n_parts))


def _centre(mesh: Mesh, is_member: np.ndarray) -> str:
    return f"{place(mesh.points[is_member].mean(axis=0))} m"
