"""Sides of a joint that lie in each other in the mesh.  Local, rank 0."""

from __future__ import annotations

import numpy as np

from ..messages.errors import MeshError
from ..messages.words import place
from ..tables.joint import Joint
from .contact_points import ContactPoints
from .data import Mesh
from .projection import Projection
from .surface import Surface, face_size, surface_of

ROUNDING = 1e-6  # of the mesh's diagonal: what the mesh may penetrate at rest and count as touching
_STRAIGHT = 0.9  # of the way to the other side: nodes that lie in the other body, and not beside it
DRAWN = 0.05  # of the size of the larger faces: as deep as meshes of one curved surface lie in each other


def check_penetration(mesh: Mesh, joint: Joint, points: ContactPoints) -> str:
    """Say how far the sides of a joint penetrate; empty where they do not.

    Where the gap is that of the mesh nothing may penetrate.  Elsewhere what counts as touching may: within the tolerance that
    the joint states, or as deep as meshes that draw one surface differently.

    Raises
    ------
    MeshError : they penetrate more than that
    """
    deepest = int(np.argmin(points.distance)) if points.n_points else 0
    if not points.n_points or points.distance[deepest] >= -ROUNDING * mesh.diagonal:
        return ""
    depth = -float(points.distance[deepest])
    how = f"by {depth:.3g} m at {place(points.position[deepest])} m"
    where = f"{mesh.path}: joint {joint.name!r}: the sides penetrate at rest, {how}"
    if joint.has_gap_of_mesh:
        raise MeshError(f"{where}; move them apart, or state the gap as a number in place of the mesh's")
    allowed = np.inf if joint.node_pairs is not None else joint.tolerance  # pairs that a file lists have no faces
    if allowed is None:
        allowed = DRAWN * max(face_size(surface_of(mesh, group)) for group in joint.groups)
    if depth > allowed:
        raise MeshError(f"{where}, {_too_deep(joint, allowed, depth)}")
    return (
        f'joint {joint.name!r}: the sides penetrate in the mesh, {how}; without gap = "geometry" that does not count: they '
        "touch, or have the gap stated"
    )


def check_sunk(mesh: Mesh, joint: Joint, first: Surface, second: Surface, foot: Projection) -> None:
    """Raise MeshError where most nodes of the first surface lie in the other body, farther than surfaces may be apart.

    ``foot`` is that of each node of the first surface on the second.
    """
    points, depth = mesh.points[first.nodes], -foot.gap
    is_sunk = (depth > _STRAIGHT * foot.distance) & (np.einsum("pi,pi->p", first.normals, foot.normals) < 0.0)
    if joint.has_gap_of_mesh or np.mean(is_sunk) < 0.5:
        return
    deepest = int(np.argmax(np.where(is_sunk, depth, 0.0)))
    allowed = joint.tolerance if joint.tolerance is not None else DRAWN * max(face_size(first), face_size(second))
    how = f"by {depth[deepest]:.3g} m at {place(points[deepest])} m"
    raise MeshError(
        f"{mesh.path}: joint {joint.name!r}: the sides penetrate at rest, {how}, {_too_deep(joint, allowed, depth[deepest])}"
    )


def _too_deep(joint: Joint, allowed: float, depth: float) -> str:
    bound = f"{DRAWN:.0%} of the size of their faces" if joint.tolerance is None else "the joint's tolerance"
    return (
        f"more than {bound}, {allowed:.3g} m: move the bodies apart; where they are only drawn so, state "
        f"tolerance = {_rounded_up(depth):g} (m) in the joint, and they touch there, or have the gap stated"
    )


def _rounded_up(depth: float) -> float:
    """Return the next number of two digits above a length."""
    unit = 10.0 ** (np.floor(np.log10(depth)) - 1.0)
    return float(np.ceil(1.01 * depth / unit) * unit)
