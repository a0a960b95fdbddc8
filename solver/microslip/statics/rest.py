"""The state of rest: the pairs about it, and the lines for the log."""

from dataclasses import replace

import numpy as np

from ..assembly.system import System
from ..contact.laws import ELASTIC_COULOMB, about_rest, are_springs, friction_limit
from ..mesh.data import ContactPairs
from ..messages.errors import CaseError
from ..messages.words import counted
from .balance import Balance
from .balance import in_words as balance_in_words
from .equilibrium import Flexibility, Rest, equilibrium

_PRESSED = "; WARNING: it is pressed at rest, and a bolt only pulls: it would be loose"

_MUCH = 0.01  # of Young's modulus: a pressure that metals do not bear, and beyond small strains


def at_rest(pairs: ContactPairs, rest: Rest) -> ContactPairs:
    """Return the pairs at rest, about which they vibrate: preload or gap, friction force, no springs if open.

    Local.  docs/theory.md, eq. (12.4) and eq. (12.10).

    Raises
    ------
    CaseError : pairs with a law that needs pressure at rest are open at rest
    """
    try:
        changed = about_rest(pairs.laws, pairs.columns, rest.du, rest.memory)
    except ValueError as problem:
        raise CaseError(
            f'[statics]: {problem} of a joint with law = "rough" at rest: it has no stiffness there, and no slider defines '
            "where it would close; state more preload, smaller loads that open it, or a law that may open: a power law, or law = "
            '"elastic-coulomb"'
        ) from problem
    N0, open_at_rest = (changed.get(name, getattr(pairs, name)) for name in ("N0", "open_at_rest"))
    T0 = np.where(open_at_rest[:, None], 0.0, rest.force[:, :2])
    k_t, k_n, w0 = (changed.get(name, getattr(pairs, name)) for name in ("k_t", "k_n", "w0"))
    law_columns = {name: changed.get(name, values) for name, values in pairs.law_columns.items()}
    return replace(pairs, N0=N0, k_t=k_t, k_n=k_n, w0=w0, T0=T0, open_at_rest=open_at_rest, law_columns=law_columns)


def with_area_ratio(pairs: ContactPairs, ratio: np.ndarray) -> ContactPairs:
    """Return pairs whose areas are ``ratio`` (n_pairs,) times as large, in a deformed shape.  Local.

    Springs, preloads and gaps of elastic-Coulomb friction scale with the area; other laws do not change.
    """
    ratio = np.where(pairs.laws == ELASTIC_COULOMB, ratio, 1.0)
    return replace(pairs, area=pairs.area * ratio, k_t=pairs.k_t * ratio, k_n=pairs.k_n * ratio, N0=pairs.N0 * ratio)


def starts_unpressed(pairs: ContactPairs) -> np.ndarray:
    """Return which pairs follow a power of the approach starting from zero pressure, (n_pairs,) bool.  Local."""
    reference = pairs.law_columns.get("reference", np.full(pairs.n_pairs, np.nan))
    return (reference > 0.0) & (pairs.N0 <= 0.0)


def at_approximate_pressure(pairs: ContactPairs, N: np.ndarray) -> ContactPairs:
    """Return pairs of the same law, with springs and asperities for the approximate pressure of forces N (n_pairs,) [N].

    Local.  docs/theory.md, section 12: only pairs that start from zero pressure, at the largest pressure of each joint.
    """
    k_t, k_n, reference = pairs.k_t.copy(), pairs.k_n.copy(), pairs.law_columns["reference"].copy()
    touches = starts_unpressed(pairs)
    for of_joint in (numbers[touches[numbers]] for numbers in pairs.by_joint().values() if touches[numbers].any()):
        level = (N[of_joint] / reference[of_joint]).max()
        if level > 0.0:
            stiffer = level ** (1.0 - 1.0 / pairs.law_columns["exponent"][of_joint])
            k_t[of_joint], k_n[of_joint], reference[of_joint] = (
                k_t[of_joint] * stiffer,
                k_n[of_joint] * stiffer,
                reference[of_joint] * level,
            )
    return replace(pairs, k_t=k_t, k_n=k_n, law_columns={**pairs.law_columns, "reference": reference})


def in_words(pairs: ContactPairs, rest: Rest, balance: Balance, modulus: float | None) -> list[str]:
    """Return lines on each joint, each bolt and each body: closed and slid pairs, forces, equilibrium.  Local.

    ``modulus`` [Pa] is the least Young's modulus of the materials, None where they are not known.
    """
    return _of_joints(pairs, rest, modulus) + _of_bolts(rest) + balance_in_words(balance)


def _of_joints(pairs: ContactPairs, rest: Rest, modulus: float | None) -> list[str]:
    """Return a line for each joint: closed pairs, slid pairs, forces; a warning of a pressure that no metal bears."""
    limit = friction_limit(pairs.laws, pairs.columns, rest.N)
    lines = [f"rest found in {counted(rest.steps, 'load step')}, {rest.iterations} Newton iterations"]
    for name, of_joint in pairs.by_joint().items():
        N, T = rest.N[of_joint], np.hypot(*rest.force[of_joint, :2].T)
        closed = (N > 0.0) | np.isnan(pairs.N0[of_joint])
        slid = closed & (T >= (1.0 - 1e-9) * limit[of_joint])
        pressure = N / pairs.area[of_joint]
        from_gap = are_springs(pairs.laws[of_joint]) | (pairs.N0[of_joint] <= 0.0)
        gap = np.where(from_gap, np.maximum(rest.du[of_joint, 2] - pairs.N0[of_joint] / pairs.k_n[of_joint], 0.0), 0.0)
        share = pressure.max() / modulus if modulus else 0.0
        warning = f"; WARNING: {100.0 * share:.2g} % of Young's modulus; check loads, units and overlap" if share > _MUCH else ""
        lines.append(
            f"  {name}: {closed.sum()} of {counted(len(of_joint), 'pair')} closed, {slid.sum()} slid to their limit; "
            f"normal force {N.sum():.6g} N, friction {T.sum():.4g} N, pressure up to {pressure.max():.4g} Pa, "
            f"gap up to {gap.max():.3g} m{warning}"
        )
    return lines


def _of_bolts(rest: Rest) -> list[str]:
    """Return a line for each bolt: its force when it was tightened and at rest."""
    bolts = rest.bolts
    if bolts is None:
        return []
    return [
        f"  bolt {name!r}: {tightened:.6g} N when tightened, {force:.6g} N at rest, {force / area:.4g} Pa in its cut; "
        f"shortened by {delta:.6g} m{_PRESSED if force <= 0.0 else ''}"
        for name, tightened, force, delta, area in zip(bolts.names, bolts.tightened, bolts.force, bolts.shortening, bolts.area)
    ]


def loose_parts(system: System, part: np.ndarray, n_parts: int) -> tuple[np.ndarray, ...]:
    """Return the connected parts that only joints hold; tied parts are in one array.  Local, rank 0.

    ``part`` (n_nodes,): number of the part of each node.
    """
    assert system.dof is not None, "a structure with a mesh"
    if system.constraints is not None:
        return system.constraints.loose
    fixed = np.unique(part[(system.dof < 0).any(axis=1)])
    return tuple(np.array([i]) for i in range(n_parts) if i not in fixed)


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
