"""Rigid-body check: bodies that contact and friction cannot hold, and their motion (docs/theory.md, section 12)."""

from dataclasses import dataclass, replace

import numpy as np

from ..assembly.system import System
from ..contact.laws import friction_limit
from ..mesh.connected import connected_parts
from ..mesh.data import ContactPairs
from ..messages.words import place
from ..parallel.agree import on_root
from .loaded import Loaded

_BALANCED = 1e-6  # imbalance over the loads, below which rigid bodies are in equilibrium
_TAKES_PART = 0.3  # of the largest motion: bodies with smaller motions are not named
_TIMES = tuple(2.0**k for k in range(1, 8))  # factors of the stated friction in the search for a sufficient one
_HALVINGS = 6  # of that search, to 1 or 2 %
_ROUNDS = 40  # rounds that add edges to the cones, opposite to the motion of the last round


@dataclass(frozen=True)
class _Rigid:
    """Rigid motions of each part: 3 translations and 3 rotations about its middle [m, and m per radian over its reach]."""

    names: tuple[str, ...]
    middle: np.ndarray  # (n_parts, 3) m
    reach: np.ndarray  # (n_parts,) m
    motions: np.ndarray  # (n_nodes, 3, 6) motion of each node with its part
    part: np.ndarray  # (n_nodes,) number of the part; tied parts are one


def freely_moved_bodies(loaded: Loaded) -> str:
    """Return a text on the bodies that contact and friction cannot hold, their motions, and remedies.

    "" if contact and friction can hold all rigid bodies.

    Collective on ``loaded.system.comm``.

    Notes
    -----
    docs/theory.md, eq. (12.9), with rigid bodies.  The loads are projected on the forces of supports and of contact within
    its friction cones; the remainder is the motion.
    """
    system = loaded.system
    gathered = system.comm.gather(loaded.forces_owned)

    def words() -> str:
        assert gathered is not None, "called on rank 0"
        rigid, forces = _rigid_motions(loaded), np.concatenate(gathered)
        q = _motions(system, rigid, loaded.pairs, forces)
        size = np.linalg.norm(q, axis=1)
        order = [i for i in np.argsort(-size, kind="stable") if size[i] > _TAKES_PART * size.max()]
        moving = "; ".join(_in_words(rigid.names[i], q[i], rigid.middle[i]) for i in order)
        return f"{moving}: {_what_holds(system, rigid, loaded.pairs, forces)}" if moving else ""

    return on_root(system.comm, words)


def _rigid_motions(loaded: Loaded) -> _Rigid:
    system, mesh = loaded.system, loaded.mesh
    assert mesh is not None, "a scene with a mesh"
    part, names = connected_parts(mesh, loaded.body_of)
    if system.constraints is not None:
        tied = system.constraints.tied_bodies
        part, names = tied[part], tuple(" with ".join(names[i] for i in np.flatnonzero(tied == j)) for j in np.unique(tied))
    nodes = [np.flatnonzero(part == i) for i in range(len(names))]
    middle = np.array([mesh.points[of_part].mean(axis=0) for of_part in nodes])
    reach = np.array([np.abs(mesh.points[of_part] - part_middle).max() for of_part, part_middle in zip(nodes, middle)])
    arm = (mesh.points - middle[part]) / reach[part, None]
    turns = np.cross(np.eye(3)[None], arm[:, None])  # (n_nodes, 3 turns, 3)
    motions = np.concatenate([np.broadcast_to(np.eye(3), (len(arm), 3, 3)), turns.swapaxes(1, 2)], axis=2)
    return _Rigid(names, middle, reach, motions, part)


def _motions(system: System, rigid: _Rigid, pairs: ContactPairs, forces: np.ndarray) -> np.ndarray:
    """Return the motion of each part, (n_parts, 6); zero if all are held.  Local, rank 0."""
    from scipy.optimize import nnls  # slow import, seldom needed

    if friction_limit(pairs.laws, pairs.columns, np.zeros(pairs.n_pairs)).any():  # a law with friction without pressure
        return np.zeros((len(rigid.names), 6))
    T = _by_row(system, rigid)
    B = np.asarray(system.R @ T).reshape(pairs.n_pairs, 3, T.shape[1])
    Z = _allowed(system, rigid)
    load = forces @ T - np.einsum("p,pa->a", np.maximum(pairs.N0, 0.0), B[:, 2])
    g = load @ Z
    cones, q, size = _edges(pairs, B, Z), g, np.inf
    for _ in range(_ROUNDS):
        try:
            multipliers, left = nnls(-cones.T, g)
        except RuntimeError:  # without convergence the open pairs are reported nevertheless
            return np.zeros((len(rigid.names), 6))
        if not left > _BALANCED * float(np.linalg.norm(load)):
            return np.zeros((len(rigid.names), 6))
        q = g + multipliers @ cones
        if left > (1.0 - 1e-6) * size:
            break
        cones, size = np.concatenate([cones, _against(pairs, B, Z, q)]), left
    q = Z @ q
    return _without_lift(q, Z, B, _per_newton(pairs)).reshape(-1, 6)


def _what_holds(system: System, rigid: _Rigid, pairs: ContactPairs, forces: np.ndarray) -> str:
    """Return a text on the friction coefficient that would hold the bodies, if one exists.  Local, rank 0."""

    def resists(times: float) -> bool:
        return not _motions(system, rigid, replace(pairs, mu=times * pairs.mu), forces).any()

    enough = next((times for times in _TIMES if resists(times)), None)
    if enough is None:
        return (
            "no friction would hold it there: turn the loads or the axis round if they should press it on, hold it against that "
            "motion by [[supports]], or let a load, a bolt or a stated preload press its joints"
        )
    least, stated = 0.5 * enough, pairs.mu[pairs.mu > 0.0]
    for _ in range(_HALVINGS):
        middle = 0.5 * (least + enough)
        least, enough = (least, middle) if resists(middle) else (middle, enough)
    if np.ptp(stated) == 0.0:
        needed = f"a friction of {np.ceil(100.0 * enough * stated[0]) / 100.0:g} would (stated: {stated[0]:g})"
    else:
        needed = f"{np.ceil(10.0 * enough) / 10.0:g} times the friction would"
    return f"it slides where friction cannot hold it, and {needed}; or hold it by [[supports]], or press its joints more"


def _by_row(system: System, rigid: _Rigid) -> np.ndarray:
    """Return the rigid motions of all parts at the free DOFs, (n_dof, 6 n_parts)."""
    assert system.dof is not None, "a structure with a mesh"
    node, axis = np.nonzero(system.dof >= 0)
    T = np.zeros((system.n_dof, len(rigid.names), 6))
    T[system.dof[node, axis], rigid.part[node]] = rigid.motions[node, axis]
    for rows, _, part, motions in _points(system, rigid):
        T[rows[rows >= 0], part] = motions[rows >= 0]
    return T.reshape(system.n_dof, -1)


def _points(system: System, rigid: _Rigid) -> list[tuple[np.ndarray, np.ndarray, int, np.ndarray]]:
    """Return for each point its rows (6,), fixed rows (6,), part, and rigid motions (6, 6)."""
    constraints, points = system.constraints, []
    if constraints is None:
        return []
    n_nodes = len(rigid.part)
    for i, (point, node) in enumerate(zip(constraints.points, constraints.group_nodes, strict=True)):
        part, places = rigid.part[node], slice(n_nodes + 2 * i, n_nodes + 2 * i + 2)
        arm = (np.array(point.position) - rigid.middle[part]) / rigid.reach[part]
        motions = np.zeros((6, 6))
        motions[:3] = np.hstack([np.eye(3), np.cross(np.eye(3), arm).T])
        motions[3:, 3:] = np.eye(3) / rigid.reach[part]
        is_fixed = (constraints.dof[places].ravel() < 0) | (np.array(point.springs) > 0.0)
        points.append((constraints.free[places].ravel(), is_fixed, int(part), motions))
    return points


def _allowed(system: System, rigid: _Rigid) -> np.ndarray:
    """Return a basis of the rigid motions that no support hinders, (6 n_parts, n)."""
    assert system.dof is not None, "a structure with a mesh"
    constraints = system.constraints
    node, axis = np.nonzero((system.dof if constraints is None else constraints.dof[: len(rigid.part)]) < 0)
    normal = np.zeros((len(rigid.names), 6, 6))  # normal matrix of the fixed rows of each part
    np.add.at(normal, rigid.part[node], np.einsum("na,nb->nab", *2 * [rigid.motions[node, axis]]))
    for _, is_fixed, part, motions in _points(system, rigid):
        normal[part] += motions[is_fixed].T @ motions[is_fixed]
    Z = []
    for i, matrix in enumerate(normal):
        values, vectors = np.linalg.eigh(matrix)
        for vector in vectors.T[values <= 1e-9 * max(values.max(), 1e-300)]:
            Z.append(np.zeros((len(normal), 6)))
            Z[-1][i] = vector
    return np.array(Z).reshape(len(Z), -1).T


def _edges(pairs: ContactPairs, B: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """Return edges of the cones of the contact forces as forces on the parts, (8 n_pairs, n)."""
    angle = np.pi / 4.0 * np.arange(8)
    across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([_cone(pairs, B, Z, np.broadcast_to(direction, (pairs.n_pairs, 2))) for direction in across])


def _against(pairs: ContactPairs, B: np.ndarray, Z: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the edges opposite to a motion, (n_pairs, n)."""
    slip = B[:, :2] @ (Z @ q)
    return _cone(pairs, B, Z, -slip / np.maximum(np.linalg.norm(slip, axis=1, keepdims=True), 1e-300))


def _per_newton(pairs: ContactPairs) -> np.ndarray:
    """Return the friction limit per newton of normal force, (n_pairs,)."""
    return friction_limit(pairs.laws, pairs.columns, np.ones(pairs.n_pairs))


def _cone(pairs: ContactPairs, B: np.ndarray, Z: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Return a unit normal force and friction at its limit along ``across`` (n_pairs, 2), unit, of each pair, (n_pairs, n)."""
    largest = np.abs(across).max(axis=1, initial=1e-300)
    reach = np.where(pairs.separate, 1.0 / largest, 1.0)  # to a square of limits, or a circle
    return (B[:, 2] + np.einsum("p,pi,pia->pa", _per_newton(pairs) * reach, across, B[:, :2])) @ Z


def _without_lift(q: np.ndarray, Z: np.ndarray, B: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """Return the motion with sliding pairs closed: projected on a cone, they would lift by mu times their slip."""
    moved = B @ q
    slides = moved[:, 2] <= 1.1 * mu * np.linalg.norm(moved[:, :2], axis=1) + 1e-9 * np.abs(moved).max(initial=0.0)
    closed = B[slides, 2] @ Z
    y = np.linalg.lstsq(Z, q, rcond=None)[0]
    flat = Z @ (y - np.linalg.lstsq(closed, closed @ y, rcond=1e-9)[0]) if len(closed) else q
    return flat if np.linalg.norm(flat) > 0.3 * np.linalg.norm(q) else q


def _in_words(name: str, q: np.ndarray, middle: np.ndarray) -> str:
    """Return a text on the motion of a part: along a direction, or about an axis through its middle."""
    shift, turn = q[:3], q[3:]
    along, about = np.linalg.norm(shift), np.linalg.norm(turn)
    motion = f"along {_direction(shift)}" if along >= 0.5 * about else ""
    if about > 0.5 * along:
        motion += (" and turns" if motion else "turns") + f" about {_direction(turn)} through {place(middle)} m"
    return f"{name} moves {motion}" if motion.startswith("along") else f"{name} {motion}"


def _direction(vector: np.ndarray) -> str:
    unit = np.round(vector / np.linalg.norm(vector), 2) + 0.0
    return "(" + ", ".join(f"{value:g}" for value in unit) + ")"
