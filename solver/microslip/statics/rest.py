"""The state of rest: the pairs that vibrate about it, and what a run says of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..assembly.system import System
from ..contact.laws import ELASTIC_COULOMB, about_rest, are_springs, friction_limit
from ..mesh.connected import connected_parts
from ..mesh.data import ContactPairs, Mesh
from ..parallel.agree import on_root
from ..parallel.errors import CaseError
from ..parallel.words import listed
from .equilibrium import Rest
from .loaded import Loaded


def at_rest(pairs: ContactPairs, rest: Rest) -> ContactPairs:
    """Return the pairs as they vibrate about their rest: preload or gap, friction force, and no springs where they are open.

    Local.  docs/theory.md, eq. (12.4) and eq. (12.10).

    Raises
    ------
    CaseError : pairs have come apart whose law knows no rest without pressure
    """
    try:
        changed = about_rest(pairs.laws, pairs.columns, rest.du, rest.memory)
    except ValueError as problem:
        raise CaseError(
            f'[statics]: {problem} of a joint with law = "rough" at rest: its stiffness there is none, and no slider says where '
            "it would touch again; state more preload, less of what pulls, or what may open: a power of the approach, or law = "
            '"elastic-coulomb"'
        ) from problem
    N0, apart = (changed.get(name, getattr(pairs, name)) for name in ("N0", "apart"))
    T0 = np.where(apart[:, None], 0.0, rest.force[:, :2])
    k_t, k_n, w0 = (changed.get(name, getattr(pairs, name)) for name in ("k_t", "k_n", "w0"))
    own = {name: changed.get(name, values) for name, values in pairs.own.items()}
    return replace(pairs, N0=N0, k_t=k_t, k_n=k_n, w0=w0, T0=T0, apart=apart, own=own)


def of_larger_area(pairs: ContactPairs, ratio: np.ndarray) -> ContactPairs:
    """Return pairs whose areas are ``ratio`` (n_pairs,) times as large, in a deformed shape.  Local.

    Springs, preloads and gaps of elastic-Coulomb friction go with it; other laws keep what they have.
    """
    ratio = np.where(pairs.laws == ELASTIC_COULOMB, ratio, 1.0)
    return replace(pairs, area=pairs.area * ratio, k_t=pairs.k_t * ratio, k_n=pairs.k_n * ratio, N0=pairs.N0 * ratio)


def touches_from_none(pairs: ContactPairs) -> np.ndarray:
    """Return which pairs follow a power of the approach from no pressure on, (n_pairs,) bool.  Local."""
    reference = pairs.own.get("reference", np.full(pairs.n_pairs, np.nan))
    return (reference > 0.0) & (pairs.N0 <= 0.0)


def referred_to(pairs: ContactPairs, N: np.ndarray) -> ContactPairs:
    """Return pairs of the same law, with the springs and asperities of about the pressure that forces N (n_pairs,) [N] make.

    Local.  docs/theory.md, section 12: of pairs that touch from none on, joint by joint, at the largest pressure there.
    """
    k_t, k_n, reference = pairs.k_t.copy(), pairs.k_n.copy(), pairs.own["reference"].copy()
    joint, touches = np.array(pairs.joint), touches_from_none(pairs)
    for name in dict.fromkeys(joint[touches]):
        own = touches & (joint == name)
        level = (N[own] / reference[own]).max()
        if level > 0.0:
            stiffer = level ** (1.0 - 1.0 / pairs.own["exponent"][own])
            k_t[own], k_n[own], reference[own] = k_t[own] * stiffer, k_n[own] * stiffer, reference[own] * level
    return replace(pairs, k_t=k_t, k_n=k_n, own={**pairs.own, "reference": reference})


@dataclass(frozen=True)
class Resultant:
    """Forces on a part [N], and their moments about the middle of the points [N m]."""

    force: np.ndarray  # (3,)
    moment: np.ndarray  # (3,)
    size: float  # N, the sum of the magnitudes of what was added


def in_words(loaded: Loaded, rest: Rest) -> list[str]:
    """Return a line for each joint, and one for each body that nothing but joints holds: do its forces balance?  Collective."""
    forces = loaded.system.comm.gather(loaded.forces_owned)

    def lines() -> list[str]:
        assert forces is not None, "called on rank 0"
        return _of_joints(loaded.pairs, rest) + _of_bolts(rest) + _of_bodies(loaded, rest, np.concatenate(forces))

    return on_root(loaded.system.comm, lines)


def _of_joints(pairs: ContactPairs, rest: Rest) -> list[str]:
    """Return a line for each joint: what is closed, what slid, what it carries."""
    names, limit = np.array(pairs.joint), friction_limit(pairs.laws, pairs.columns, rest.N)
    lines = [f"rest found in {rest.steps} load steps, {rest.iterations} Newton iterations"]
    for name in dict.fromkeys(pairs.joint):
        own = names == name
        N, T = rest.N[own], np.hypot(*rest.force[own, :2].T)
        closed = (N > 0.0) | np.isnan(pairs.N0[own])
        slid = closed & (T >= (1.0 - 1e-9) * limit[own])
        pressure = N / pairs.area[own]
        from_gap = are_springs(pairs.laws[own]) | (pairs.N0[own] <= 0.0)
        gap = np.where(from_gap, np.maximum(rest.du[own, 2] - pairs.N0[own] / pairs.k_n[own], 0.0), 0.0)
        lines.append(
            f"  {name}: {closed.sum()} of {own.sum()} pairs closed, {slid.sum()} slid to their limit; "
            f"normal force {N.sum():.6g} N, friction {T.sum():.4g} N, pressure up to {pressure.max():.4g} Pa, "
            f"gap up to {gap.max():.3g} m"
        )
    return lines


def _of_bolts(rest: Rest) -> list[str]:
    """Return a line for each bolt: its force when it was tightened and at rest."""
    bolts = rest.bolts
    if bolts is None:
        return []
    return [
        f"  bolt {name!r}: {tightened:.6g} N when tightened, {force:.6g} N at rest, {force / area:.4g} Pa in its cut; "
        f"shortened by {delta:.6g} m"
        for name, tightened, force, delta, area in zip(bolts.names, bolts.tightened, bolts.force, bolts.shortening, bolts.area)
    ]


def _of_bodies(loaded: Loaded, rest: Rest, forces: np.ndarray) -> list[str]:
    """Return a line for each part without a support: loads and contact forces on it, and what is left over."""
    system, mesh = loaded.system, loaded.mesh
    assert mesh is not None, "a scene with a mesh"
    carried = rest.force.copy()
    carried[:, 2] += np.maximum(np.nan_to_num(loaded.pairs.N0), 0.0)  # what a stated preload presses with balances itself
    contact = -(system.R.T @ carried.ravel())
    part, part_names = connected_parts(mesh, loaded.body_of)
    lines = []
    for own in loose_parts(system, part, len(part_names)):
        nodes = np.flatnonzero(np.isin(part, own))
        applied, pressed = (_resultant(system, mesh, nodes, values) for values in (forces, contact))
        size = max(applied.size, pressed.size) or 1.0
        reach = float(np.abs(mesh.points[nodes] - mesh.points[nodes].mean(axis=0)).max())
        left = np.linalg.norm(applied.force + pressed.force) / size
        turned = np.linalg.norm(applied.moment + pressed.moment) / (size * reach)
        shown = ", ".join(f"{value:.6g}" for value in applied.force)
        lines.append(
            f"  {listed([part_names[i] for i in own])}: loads of ({shown}) N, carried by its joints; what is left over is "
            f"{left:.1e} of the forces, {turned:.1e} of their moments"
        )
    return lines


def loose_parts(system: System, part: np.ndarray, n_parts: int) -> tuple[np.ndarray, ...]:
    """Return the connected parts that nothing but joints holds, those that are tied together in one array.  Local, rank 0.

    ``part`` (n_nodes,) is that of each node.
    """
    assert system.dof is not None, "a structure with a mesh"
    if system.constraints is not None:
        return system.constraints.loose
    held = np.unique(part[(system.dof < 0).any(axis=1)])
    return tuple(np.array([i]) for i in range(n_parts) if i not in held)


def _resultant(system: System, mesh: Mesh, nodes: np.ndarray, values: np.ndarray) -> Resultant:
    """Return the resultant of forces on the system's rows, (n_dof,), over ``nodes`` and the points connected to them.  Local.

    What a dependent node bears acts on what it follows, with the same resultant.
    """
    assert system.dof is not None, "a structure with a mesh"
    values = np.append(values, 0.0)  # row -1: fixed or dependent
    points, forces = mesh.points[nodes], values[system.dof[nodes]]
    constraints = system.constraints
    own = () if constraints is None else [i for i, node in enumerate(constraints.group_nodes) if node in nodes]
    if constraints is None or not own:
        return resultant(points, forces)
    at = np.array([constraints.points[i].position for i in own])
    of_points = values[constraints.free[len(mesh.points) :]].reshape(-1, 6)[list(own)]
    found = resultant(np.concatenate([points, at]), np.concatenate([forces, of_points[:, :3]]))
    return replace(found, moment=found.moment + of_points[:, 3:].sum(axis=0))


def resultant(points: np.ndarray, forces: np.ndarray) -> Resultant:
    """Return the sum of forces (n, 3) [N] at points (n, 3) [m].  Local."""
    moments = np.cross(points - points.mean(axis=0), forces)
    return Resultant(forces.sum(axis=0), moments.sum(axis=0), float(np.linalg.norm(forces, axis=1).sum()))
