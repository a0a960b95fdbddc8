"""Penetration of the sides of a joint in the mesh.  Local, rank 0."""

import numpy as np

from ..messages.errors import MeshError
from ..messages.words import place
from ..tables.joint import Joint
from .contact_points import ContactPoints
from .data import Mesh
from .projection import Projection
from .surface import Surface, face_size, surface_of

ROUNDING = 1e-6  # of the mesh's diagonal: penetration at rest that counts as contact
_STRAIGHT = 0.9  # normal part of the distance above which a node lies in the other body, not next to it
DRAWN = 0.05  # of the size of the larger faces: penetration of different meshes of one curved surface


def check_penetration(mesh: Mesh, joint: Joint, points: ContactPoints) -> str:
    """Return a note on the penetration of the sides of a joint; empty without penetration.

    With a gap from the mesh no penetration is accepted.  Otherwise it is accepted within the tolerance of the joint, or up to the
    difference of two meshes of one surface.

    Raises
    ------
    MeshError : a larger penetration
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
    """Raise MeshError if most nodes of the first surface lie in the other body, deeper than the accepted distance.

    ``foot``: projection of the nodes of the first surface on the second.
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
        f"more than {bound}, {allowed:.3g} m: move the bodies apart; where only the mesh penetrates, state "
        f"tolerance = {_rounded_up(depth):g} (m) in the joint: they then touch there, or have the stated gap"
    )


def _rounded_up(depth: float) -> float:
    """Return a length rounded up to two digits."""
    unit = 10.0 ** (np.floor(np.log10(depth)) - 1.0)
    return float(np.ceil(1.01 * depth / unit) * unit)
