"""The contact pairs of all joints: positions, frames, and parameters of each pair."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ..contact.laws import columns_on_area
from ..contact.laws import joined as joined_columns
from ..messages.errors import Faults, MeshError
from ..messages.words import counted, place, verb
from ..tables.cyclic import Cyclic
from ..tables.joint import Joint
from .contact_points import ContactPoints, heaviest
from .cyclic import cyclic_faces, in_next_sector
from .data import ContactPairs, Mesh, stacked
from .ground import grounded
from .listed import listed_nodes
from .matching import NotMatching, matching_nodes
from .overlap import MORTAR, overlapping_faces
from .penetration import check_penetration
from .projected import projected_nodes
from .surface import Surface, face_keys, outward_faces, surface_of
from .values import Values, values_of

PAIRINGS = {"nodes": matching_nodes, "projected": projected_nodes, "points": overlapping_faces, MORTAR: overlapping_faces}
_ALONG = 0.99  # |cosine| above which a normal has no useful projection of an axis


def pair_contacts(mesh: Mesh, joints: Sequence[Joint], cyclic: Cyclic | None = None) -> ContactPairs:
    """Return the contact pairs of all joints, by joint and then by node number, or face, of the first surface.  Local, rank 0.

    For a joint to the next sector of a disc the second surface is taken at its position there, with the nodes of the mesh.

    Raises
    ------
    MeshError : surfaces that do not meet, face away, share nodes or penetrate, or belong to two joints; values for pairs that do
        not exist; one message for all joints
    CaseError : a file of values is faulty
    """
    if not joints:
        return _no_pairs()
    if cyclic is not None and any(joint.next_sector for joint in joints):
        cyclic_faces(mesh, cyclic)  # wrong faces imply a wrong position of the next sector
    parts, faces, notes, n_pairs, faults = [], [], [], 0, Faults()
    with faults.collected():
        _check_faces(mesh, joints)
    for joint in joints:
        with faults.collected():
            placed = in_next_sector(mesh, joint.groups[1], cyclic) if joint.next_sector and cyclic is not None else mesh
            if placed is mesh:
                points, penetration = _in_one_sector(mesh, joint, cyclic)
            else:
                points = _with_next_sector(placed, joint)
                penetration = check_penetration(placed, joint, points)
            parts.append(_columns(placed, joint, points))
            faces += [face + n_pairs for face in points.faces]
            notes += [note for note in (points.note, penetration) if note]
            n_pairs += points.n_points
    faults.refuse()
    joined = {name: stacked([part[name] for part in parts]) for name in parts[0] if name not in ("joint", "law_columns")}
    joined["law_columns"] = joined_columns([(len(part["area"]), part["law_columns"]) for part in parts])
    names = tuple(name for part in parts for name in part["joint"])
    return ContactPairs(joint=names, faces=tuple(faces), notes=tuple(notes), **joined)


def join_pairs(first: ContactPairs, second: ContactPairs) -> ContactPairs:
    """Return the pairs of both, pairs by DOFs first, without weights of nodes, which the maps already include.  Local."""
    if first.n_pairs == 0:
        return second
    shared = {"joint", "faces", "notes", "law_columns", "weights1", "weights2"}
    columns = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in ContactPairs.__dataclass_fields__
        if name not in shared
    }
    return ContactPairs(
        joint=first.joint + second.joint,
        faces=tuple(faces + first.n_pairs for faces in second.faces),
        notes=first.notes + second.notes,
        law_columns=joined_columns([(first.n_pairs, first.law_columns), (second.n_pairs, second.law_columns)]),
        **columns,
    )


def _no_pairs() -> ContactPairs:
    none, nodes = np.zeros(0), np.zeros(0, dtype=np.int64)
    return ContactPairs(
        (), nodes, nodes, np.zeros((0, 3)), np.zeros((0, 3, 3)), none, none, none, none, none, np.zeros(0, dtype=bool), ()
    )


def contact_points(mesh: Mesh, joint: Joint) -> ContactPoints:
    """Return the contact points of a joint.  Local, rank 0.

    Raises
    ------
    MeshError : surfaces that do not meet, face away or share nodes
    CaseError : a file of node pairs is faulty
    """
    if joint.node_pairs is not None:
        return listed_nodes(mesh, joint)
    first = surface_of(mesh, joint.groups[0])
    if len(joint.groups) == 1:
        return grounded(mesh, joint, first)
    second = surface_of(mesh, joint.groups[1])
    _check_shared(mesh, joint, first, second)
    if joint.pairing == "auto":
        try:
            return matching_nodes(mesh, joint, first, second)
        except NotMatching:
            return overlapping_faces(mesh, joint.with_keys(pairing=MORTAR), first, second)
    return PAIRINGS[joint.pairing](mesh, joint, first, second)


def _points(mesh: Mesh, joint: Joint) -> tuple[ContactPoints, str]:
    """Return the contact points of a joint and a note on penetration; MeshError.  Local, rank 0."""
    points = contact_points(mesh, joint)
    return points, check_penetration(mesh, joint, points)


def _in_one_sector(mesh: Mesh, joint: Joint, cyclic: Cyclic | None) -> tuple[ContactPoints, str]:
    """Return the same; MeshError with advice where the surfaces of a disc meet in the next sector.  Local, rank 0."""
    try:
        return _points(mesh, joint)
    except MeshError as fault:
        if cyclic is None or len(joint.groups) != 2:
            raise
        for first, second in (joint.groups, joint.groups[::-1]):
            try:
                _points(in_next_sector(mesh, second, cyclic), joint.with_keys(surfaces=(first, second)))
            except MeshError:
                continue
            raise MeshError(
                f"{mesh.path}: joint {joint.name!r}: {first!r} and {second!r} do not meet within a sector, but the first meets "
                f'the second of the next sector: state surfaces = ["{first}", "{second}"] and next_sector = true'
            ) from fault
        raise


def _with_next_sector(placed: Mesh, joint: Joint) -> ContactPoints:
    """Return the contact points of a joint to the next sector, with its surface at its position in ``placed``.  Local, rank 0."""
    try:
        return contact_points(placed, joint)
    except MeshError as fault:
        first, second = joint.groups
        raise MeshError(
            f"{fault}; {second!r} is taken from the next sector, turned in the positive sense about the axis of [cyclic]: "
            f"surfaces = [of this sector at its high side, of the next one], here perhaps [{second!r}, {first!r}]"
        ) from fault


def _check_faces(mesh: Mesh, joints: Sequence[Joint]) -> None:
    """Raise MeshError if contact points of two joints of one law lie on the same faces, which would be in contact twice.

    Several joints may share a second surface (two feet on one base); joints of different laws may act in parallel.
    """
    of_surfaces = [joint for joint in joints if joint.node_pairs is None]
    if len(of_surfaces) < 2:
        return
    sides = [(joint, [face_keys(outward_faces(mesh, group)) for group in joint.groups]) for joint in of_surfaces]
    for (first, of_first), (other, of_other) in combinations(sides, 2):
        both = of_first[0] & of_other[0]
        if not both and of_first[0] & of_other[-1]:
            both = of_first[-1] & of_other[0]  # the same two surfaces in the other order
        if both and first.law == other.law:
            raise MeshError(
                f"{mesh.path}: {counted(len(both), 'face')} {verb(len(both), 'belong')} to joint {first.name!r} and to "
                f"joint {other.name!r}, of "
                f"{first.groups[0]!r} and {other.groups[0]!r}: they would touch twice; take them out of one of the two, or "
                "state one joint"
            )


def _columns(mesh: Mesh, joint: Joint, points: ContactPoints) -> dict:
    """Return the columns of ContactPairs of one joint."""
    node1, node2 = heaviest(points.side1), heaviest(points.side2)
    values = values_of(mesh, joint, points)
    k_n = values.normal_stiffness * points.area
    columns = {
        "joint": (joint.name,) * points.n_points,
        "node1": node1,
        "node2": node2,
        "weights1": points.side1,
        "weights2": points.side2,
        "position": points.position,
        "frame": contact_frames(points.z, joint.tangent, f"{mesh.path}: joint {joint.name!r}"),
        "area": points.area,
        "mu": values.friction,
        "N0": _preload(joint, points, values, k_n),
        "k_t": values.tangential_stiffness * points.area,
        "k_n": k_n,
        "separate": np.full(points.n_points, joint.is_separate),
        "cells": points.cells,
        "laws": np.full(points.n_points, joint.law),
        "next_sector": np.full(points.n_points, joint.next_sector),
    }
    by_law = columns_on_area(joint.law, {**joint.values_of_law, **vars(values)}, points.area)
    return columns | {"law_columns": by_law} | {name: by_law.pop(name) for name in columns.keys() & by_law.keys()}


def _preload(joint: Joint, points: ContactPoints, values: Values, k_n: np.ndarray) -> np.ndarray:
    """Return N0 of each pair [N], negative for a gap."""
    if not joint.has_gap_of_mesh:
        return np.where(values.gap > 0.0, -values.gap * k_n, values.preload * points.area)
    return -np.maximum(points.distance, 0.0) * k_n


def contact_frames(z: np.ndarray, tangent=None, where: str = "") -> np.ndarray:
    """Return frames (n, 3, 3) with rows x, y, z for unit normals ``z`` (n, 3).  Local.

    x is the projection of ``tangent``, by default of one model axis for all pairs, so that x varies continuously over a smooth
    surface: the (first) axis farthest from all normals.  Where a normal is nearly parallel to this axis, as on closed surfaces,
    the next axis is used.  y = z cross x.

    Raises
    ------
    MeshError : ``tangent`` is normal to the surface at a point
    """
    if tangent is not None:
        return _frames(z, np.tile(_along(z, tangent, where), (len(z), 1)))
    closest = np.round(np.abs(z).max(axis=0, initial=0.0), 6)
    axis = np.full(len(z), int(np.argmin(closest)))
    along = np.abs(z[np.arange(len(z)), axis]) > _ALONG
    axis[along] = (axis[along] + 1) % 3
    return _frames(z, np.eye(3)[axis])


def _frames(z: np.ndarray, reference: np.ndarray) -> np.ndarray:
    x = reference - np.einsum("pi,pi->p", reference, z)[:, None] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _along(z: np.ndarray, tangent, where: str) -> np.ndarray:
    """Return the direction ``tangent`` as a unit vector; MeshError if it is parallel to a normal."""
    direction = np.array(tangent, dtype=float) / np.linalg.norm(tangent)
    if (np.abs(z @ direction) > _ALONG).any():
        raise MeshError(f"{where}: tangent = {place(tangent)} is normal to the surface and has no direction in it; state another")
    return direction


def _check_shared(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> None:
    """Raise MeshError if the two surfaces share nodes."""
    shared = np.intersect1d(first.nodes, second.nodes)
    if len(shared):
        raise MeshError(
            f"{mesh.path}: joint {joint.name!r}: {first.group!r} and {second.group!r} share {counted(len(shared), 'node')} (the "
            f"first is node {mesh.numbers[shared].min()}), so the bodies are merged there and cannot slip; "
            "give each body its own nodes (mesh the bodies separately, without merging coincident nodes)"
        )
