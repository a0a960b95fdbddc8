"""Pair the nodes of contact surfaces that lie on each other, and give every pair its frame, area and parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ..parallel.errors import MeshError
from .data import ContactPairs, Mesh, place
from .settings import Joint
from .surface import Surface, surface_of

TOLERANCE = 1e-6  # of the mesh's diagonal, where the joint states none
MOST_TILT = 20.0  # degrees between the normals of the two sides
_ALONG = 0.99  # |cosine| above which a normal has no useful projection of an axis


def pair_contacts(mesh: Mesh, joints: Sequence[Joint]) -> ContactPairs:
    """Return the contact pairs of all joints, by joint and then by node number of the first surface.  Local, rank 0.

    Raises
    ------
    MeshError : nodes without a partner or with several, shared nodes, sides that do not face each other
    """
    if not joints:
        return _no_pairs()
    parts, faces, n_pairs = [], [], 0
    for joint in joints:
        part, own_faces = _pair_joint(mesh, joint)
        faces += [own + n_pairs for own in own_faces]
        n_pairs += len(part["node1"])
        parts.append(part)
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0] if name != "joint"}
    names = tuple(name for part in parts for name in part["joint"])
    return ContactPairs(joint=names, faces=tuple(faces), **joined)


def _no_pairs() -> ContactPairs:
    none, nodes = np.zeros(0), np.zeros(0, dtype=np.int64)
    return ContactPairs(
        (), nodes, nodes, np.zeros((0, 3)), np.zeros((0, 3, 3)), none, none, none, none, none, np.zeros(0, dtype=bool), ()
    )


def _pair_joint(mesh: Mesh, joint: Joint) -> tuple[dict, list[np.ndarray]]:
    """Return the columns of ContactPairs of one joint, and its faces as indices of its own pairs."""
    first, second = (surface_of(mesh, group) for group in joint.surfaces)
    _check_shared(mesh, joint, first, second)
    i1, i2 = _match(mesh, joint, first, second)
    order = np.argsort(mesh.numbers[first.nodes[i1]], kind="stable")
    i1, i2 = i1[order], i2[order]
    _check_opposite(mesh, joint, first, second, i1, i2)
    z = second.normals[i2] - first.normals[i1]  # out of body 2 into body 1, the mean of both sides
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    node1, node2 = first.nodes[i1], second.nodes[i2]
    area = (first.areas[i1] + second.areas[i2]) / 2
    position = (mesh.points[node1] + mesh.points[node2]) / 2
    pair_of = np.full(len(mesh.points), -1)
    pair_of[node2] = np.arange(len(node2))
    k_n = joint.normal_stiffness * area
    columns = {
        "joint": (joint.name,) * len(area),
        "node1": node1,
        "node2": node2,
        "position": position,
        "frame": contact_frames(z),
        "area": area,
        "mu": np.full(len(area), float(joint.friction)),
        "N0": -joint.gap * k_n if joint.gap > 0.0 else joint.preload * area,
        "k_t": joint.tangential_stiffness * area,
        "k_n": k_n,
        "separate": np.full(len(area), joint.separate),
    }
    return columns, [pair_of[own] for own in second.faces]


def contact_frames(z: np.ndarray) -> np.ndarray:
    """Return frames (n, 3, 3) with rows x, y, z for unit normals ``z`` (n, 3).  Local.

    x is the projection of one model axis for all pairs, so that it varies continuously over a smooth surface:
    the axis to which the normals come least close, of equals the first.  Where a normal nearly points along it
    (a closed surface has such places), the next axis in turn serves.  y = z cross x.
    """
    closest = np.round(np.abs(z).max(axis=0, initial=0.0), 6)
    axis = np.full(len(z), int(np.argmin(closest)))
    along = np.abs(z[np.arange(len(z)), axis]) > _ALONG
    axis[along] = (axis[along] + 1) % 3
    reference = np.eye(3)[axis]
    x = reference - np.einsum("pi,pi->p", reference, z)[:, None] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _match(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Return positions in ``first.nodes`` and ``second.nodes`` of the nodes that lie on each other, one to one."""
    tolerance = TOLERANCE * mesh.diagonal if joint.tolerance is None else joint.tolerance
    points1, points2 = mesh.points[first.nodes], mesh.points[second.nodes]
    distance1, partner = cKDTree(points2).query(points1)
    distance2, partner2 = cKDTree(points1).query(points2)
    lonely1, lonely2 = distance1 > tolerance, distance2 > tolerance
    if lonely1.any() or lonely2.any():
        side, distance = (first, distance1) if distance1.max() >= distance2.max() else (second, distance2)
        worst = side.nodes[np.argmax(distance)]
        raise MeshError(
            f"{mesh.path}: joint {joint.name!r}: {np.count_nonzero(lonely1)} of {len(points1)} nodes of "
            f"{first.group!r} and {np.count_nonzero(lonely2)} of {len(points2)} nodes of {second.group!r} have no "
            f"partner within {tolerance:.3g} m; the worst is node {mesh.numbers[worst]} of {side.group!r} at "
            f"{place(mesh.points[worst])} m, {distance.max():.3g} m from the nearest node of the other side; "
            "mesh the two surfaces alike, or state a larger tolerance in the joint"
        )
    for side, other, chosen in ((first, second, partner), (second, first, partner2)):
        nodes, count = np.unique(chosen, return_counts=True)
        if (count > 1).any():
            node = nodes[np.argmax(count)]
            rivals = mesh.numbers[side.nodes[chosen == node]]
            raise MeshError(
                f"{mesh.path}: joint {joint.name!r}: nodes {rivals[0]} and {rivals[1]} of {side.group!r} both lie "
                f"within {tolerance:.3g} m of node {mesh.numbers[other.nodes[node]]} of {other.group!r}; "
                "state a smaller tolerance, or remove the double node"
            )
    return np.arange(len(points1)), partner


def _check_shared(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> None:
    """Raise MeshError where the two surfaces have nodes in common."""
    shared = np.intersect1d(first.nodes, second.nodes)
    if len(shared):
        raise MeshError(
            f"{mesh.path}: joint {joint.name!r}: {first.group!r} and {second.group!r} share {len(shared)} nodes (the "
            f"first is node {mesh.numbers[shared].min()}), so the bodies are merged there and cannot slip; "
            "give each body nodes of its own (mesh the bodies apart, without merging coincident nodes)"
        )


def _check_opposite(mesh: Mesh, joint: Joint, first: Surface, second: Surface, i1: np.ndarray, i2: np.ndarray) -> None:
    """Raise MeshError where the outward normals of the two sides are not opposite."""
    cosine = -np.einsum("pi,pi->p", first.normals[i1], second.normals[i2])
    tilt = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    if len(tilt) and tilt.max() > MOST_TILT:
        worst = first.nodes[i1[np.argmax(tilt)]]
        raise MeshError(
            f"{mesh.path}: joint {joint.name!r}: the sides do not face each other at "
            f"{np.count_nonzero(tilt > MOST_TILT)} of {len(tilt)} pairs: at node {mesh.numbers[worst]}, "
            f"{place(mesh.points[worst])} m, the outward normals are {tilt.max():.0f} degrees from opposite "
            f"(bound {MOST_TILT:.0f}); do the bodies overlap, or do the two groups cover different faces?"
        )
