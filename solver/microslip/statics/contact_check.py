"""Contact check: bodies that only contact holds must be in contact at rest (docs/theory.md, section 12)."""

from collections.abc import Iterable

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..mesh.connected import connected_parts, on_parts
from ..mesh.data import ContactPairs
from ..messages.errors import CaseError
from ..messages.words import listed, rounded
from ..parallel.agree import on_root
from .equilibrium import Rest
from .loaded import Loaded
from .rest import loose_parts

RESOLVED = 1e-10  # normal force over the sum of all loads; a hundred times the tolerance of the equilibrium


def check_contact(loaded: Loaded, rest: Rest) -> None:
    """Raise CaseError on every rank for a body that only contact holds and on which no contact force acts.

    Collective on ``loaded.system.comm``.  If the loads on a body balance each other, its contact forces are rounding: a pair or
    two then count as closed, and hold the vibrating body.
    """
    system, mesh, pairs = loaded.system, loaded.mesh, loaded.pairs
    gathered = system.comm.gather(loaded.forces_owned)

    def check() -> None:
        assert mesh is not None and gathered is not None, "called on rank 0 of a scene with a mesh"
        size = _size(np.concatenate(gathered), pairs, rest)
        part, names = connected_parts(mesh, loaded.body_of)
        loose = loose_parts(system, part, len(names))
        group_of, is_fixed = _groups(part, len(names), loose)
        first, second = (_on_groups(on_parts(side, part, len(names)), group_of) for side in pairs.sides(len(part)))
        if len(loose) and group_of.all() and first.all() and second.all():  # without supports one body is taken as held
            is_fixed[1] = True
        free = _not_pressed(first, second, np.where(np.isnan(pairs.N0), np.inf, rest.N), is_fixed, RESOLVED * size)
        if len(free):
            bodies = [names[i] for i in np.flatnonzero(np.isin(group_of, free))]
            of_joint = np.isin(first, free) | np.isin(second, free)
            joints = dict.fromkeys(np.array(pairs.joint)[of_joint])
            raise CaseError(_in_words(bodies, joints, rest.N[of_joint].max(), size, loaded.where))

    on_root(system.comm, check)


def _size(forces: np.ndarray, pairs: ContactPairs, rest: Rest) -> float:
    """Return the sum of all loads [N]: forces, bolts and preloads."""
    bolts = 0.0 if rest.bolts is None else np.abs(rest.bolts.force).sum()
    return float(np.abs(forces).sum() + bolts + np.nansum(np.maximum(pairs.N0, 0.0)))


def _groups(part: np.ndarray, n_parts: int, loose: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the group of each part, (n_parts,), and which groups are held, (n_groups,) bool.

    All held parts form the first group; each set of tied ``loose`` parts forms another.
    """
    group_of = np.zeros(n_parts, dtype=int)
    for i, parts in enumerate(loose, 1):
        group_of[parts] = i
    return group_of, np.arange(len(loose) + 1) == 0


def _on_groups(counts: sp.csr_matrix, group_of: np.ndarray) -> np.ndarray:
    """Return the group of one side of each contact point, (n_pairs,); ground belongs to the held group."""
    has_part = np.diff(counts.indptr) > 0
    groups = np.zeros(counts.shape[0], dtype=int)
    groups[has_part] = group_of[counts.indices[counts.indptr[:-1][has_part]]]
    return groups


def _not_pressed(first: np.ndarray, second: np.ndarray, N: np.ndarray, is_fixed: np.ndarray, least: float) -> np.ndarray:
    """Return the groups that no chain of joints, each with a force of at least ``least`` [N], connects to a held group."""
    carried = sp.coo_matrix((np.maximum(N, 0.0), (first, second)), (len(is_fixed), len(is_fixed))).tocsr()
    carried.data[~(carried.data > least)] = 0.0
    carried.eliminate_zeros()
    component = connected_components(carried, directed=False)[1]
    return np.flatnonzero(~np.isin(component, component[is_fixed]))


def _in_words(bodies: list[str], joints: Iterable[str], largest: float, size: float, where: str) -> str:
    most = f"at most {largest:.1g} N a pair" if largest > 0.0 else "zero in every pair"
    return (
        f"{where}{': ' if where else ''}[statics]: nothing presses on {listed(bodies)} at rest: the contact force of "
        f"{listed([repr(joint) for joint in joints])} is {most} under loads of {rounded(size)} N in all, and contact alone "
        "would hold it; let a load press on it, state a preload, or hold it by [[supports]]"
    )
