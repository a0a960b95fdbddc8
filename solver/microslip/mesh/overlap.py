"""Contact of two surfaces of any meshes: a point for each cell of the first, both sides averaged over the overlap.

A face of the first surface has a few cells.  The interpolated motions of both meshes are averaged over the intersections of a
cell with facets of the second surface.  Both averages reproduce rigid and linear motions, and a uniform pressure gives consistent
nodal forces on each face: a flat joint of any two meshes transmits it unchanged.  With mortars a completely covered face has
moments in place of means, which also resolve variations within a cell.
"""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from ..messages.errors import MeshError
from ..messages.words import counted, place
from ..tables.joint import Joint
from .cells import Cells, cells_of, face_of
from .contact_points import MOST_TILT, ContactPoints, check_opposite
from .data import Mesh
from .penetration import check_sunk
from .projection import project_on_surface
from .shared_parts import Shared, joined, shared_parts
from .surface import Surface, face_size, on_mesh

NEAR = 0.1  # of the size of the larger faces: default tolerance of the distance of the surfaces of a joint
MORTAR = "mortar"  # the pairing of moments over faces
FAR = 0.1  # of the mesh's diagonal: the same for a gap from the mesh
WHOLE = 0.9  # covered fraction of each cell of a face with moments
COVERED = 0.98  # fraction of the first surface that must have a partner
LEAST = 0.01  # the same with a gap from the mesh: the rest of the surface stays free, as in a contact pair of other programs
MANY = 0.5  # fraction of the first surface without a partner that causes a warning
LAYERS = 1.05  # covered fraction of a cell above which the second surface has a second layer
_LEAST = 1e-6  # covered fraction of a cell below which it has no partner


def overlapping_faces(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> ContactPoints:
    """Return a point for each cell of the first surface that the second surface covers at least partly.  Local, rank 0.

    docs/theory.md, eq. (2.3); eq. (2.11) for mortars.

    Raises
    ------
    MeshError : sides too far apart or facing away, several layers, or a part of the first surface without a partner
    """
    reach = reach_of(mesh, joint, first, second)
    cells = [cells_of(mesh, kind, faces) for kind, faces in first.faces.items()]
    by_moments = joint.pairing == MORTAR
    of_kinds = [shared_parts(mesh, of_kind, second, reach, by_moments) for of_kind in cells]
    means, moments = (joined([both[k] for both in of_kinds]) for k in (0, 1))
    area, corners = (np.concatenate([getattr(of_kind, name) for of_kind in cells]) for name in ("area", "corners"))
    share = means.covered / means.cell_areas
    _check_covered(mesh, joint, first, second, cells, share)
    area_shared = np.minimum(share, 1.0) * area
    face = face_of(cells)
    has_moments = by_moments & _is_whole(face, share, moments.covered)
    shared, area_shared = _with_moments(face, has_moments, means, moments, area_shared)
    used = np.flatnonzero(share > _LEAST)
    if joint.has_gap_of_mesh:
        used = used[_face_each_other(mesh, first, second, shared, used)]
    side1, side2 = (sp.diags(1.0 / shared.covered[used]) @ side[used] for side in (shared.side1, shared.side2))
    n1, n2 = side1 @ on_mesh(mesh, first), side2 @ on_mesh(mesh, second)
    n1, n2 = (n / np.linalg.norm(n, axis=1, keepdims=True) for n in (n1, n2))
    x1, x2 = side1 @ mesh.points, side2 @ mesh.points
    check_opposite(mesh, joint, n1, n2, x1)
    z = (n2 - n1) / np.linalg.norm(n2 - n1, axis=1, keepdims=True)
    distance = np.einsum("pi,pi->p", z, x1 - x2)
    is_covered = area_shared[used].sum() / area.sum()
    warning = "WARNING: " if joint.has_gap_of_mesh and 1.0 - is_covered > MANY else ""
    rest = "; the rest has no partner and stays free" if joint.has_gap_of_mesh and is_covered < COVERED else ""
    return ContactPoints(
        side1=side1.tocsr(),
        side2=side2.tocsr(),
        z=z,
        area=area_shared[used],
        position=(x1 + x2) / 2,
        distance=distance,
        cells=corners[used],
        note=f"{warning}joint {joint.name!r}: {counted(len(used), 'contact point')}, "
        f"{_in_words(first, by_moments, has_moments[used])}; "
        f"{second.group!r} covers {is_covered:.2%} of them, {distance.min():.3g} to {distance.max():.3g} m away "
        f"(at most {reach:.3g} m){rest}",
    )


def _face_each_other(mesh: Mesh, first: Surface, second: Surface, shared: Shared, used: np.ndarray) -> np.ndarray:
    """Return which of the points ``used`` lie where the surfaces, which may be curved, face each other, (n,) bool.

    Raises no error where none does: :func:`check_opposite` then states the angle.
    """
    normals = (side[used] @ on_mesh(mesh, of_side) for side, of_side in ((shared.side1, first), (shared.side2, second)))
    n1, n2 = (n / np.linalg.norm(n, axis=1, keepdims=True) for n in normals)
    facing = -np.einsum("pi,pi->p", n1, n2) >= np.cos(np.radians(MOST_TILT))
    return facing if facing.any() else np.ones(len(used), dtype=bool)


def _in_words(first: Surface, by_moments: bool, has_moments: np.ndarray) -> str:
    """Return a text on the points of a joint; ``has_moments`` (n,) marks points with moments."""
    if not by_moments:
        return f"in cells of {first.group!r}"
    n_means = np.count_nonzero(~has_moments)
    means = f" ({n_means} of them means over cells, in faces that are not covered wholly)" if n_means else ""
    return f"mortars on faces of {first.group!r}{means}"


def reach_of(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> float:
    """Return the largest accepted distance of the surfaces [m].  Local."""
    if joint.tolerance is not None:
        return joint.tolerance
    if joint.has_gap_of_mesh:
        return FAR * mesh.diagonal
    return NEAR * max(face_size(side) for side in (first, second))


def _is_whole(face: np.ndarray, share: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Return which of n cells belong to completely covered faces with positive moments of the covered area."""
    is_whole = np.ones(face.max(initial=-1) + 1, dtype=bool)
    np.logical_and.at(is_whole, face, (share >= WHOLE) & (moments > 0.0))
    return is_whole[face]


def _with_moments(
    face: np.ndarray, has_moments: np.ndarray, means: Shared, moments: Shared, area: np.ndarray
) -> tuple[Shared, np.ndarray]:
    """Return the moments of cells with moments, the means of the others, and the areas (n,) [m2].  Local."""
    chosen, without_moments = sp.diags(has_moments.astype(float)), sp.diags((~has_moments).astype(float))
    both = Shared(
        (chosen @ moments.side1 + without_moments @ means.side1).tocsr(),
        (chosen @ moments.side2 + without_moments @ means.side2).tocsr(),
        np.where(has_moments, moments.covered, means.covered),
        means.cell_areas,
    )
    per_covered = np.bincount(face, area) / np.maximum(np.bincount(face, moments.covered), 1e-300)
    return both, np.where(has_moments, moments.covered * per_covered[face], area)


def _check_covered(mesh: Mesh, joint: Joint, first: Surface, second: Surface, cells: Sequence[Cells], share: np.ndarray) -> None:
    """Raise MeshError if too much of the first surface has no or several partners; ``share`` (n,): covered part of cells."""
    where = f"{mesh.path}: joint {joint.name!r}"
    centre, area = (np.concatenate([getattr(of_kind, name) for of_kind in cells]) for name in ("centre", "area"))
    if share.max(initial=0.0) > LAYERS:
        raise MeshError(
            f"{where}: {second.group!r} covers {first.group!r} more than once at {place(centre[np.argmax(share)])} m; "
            "restrict the group to the faces that touch, or state a smaller tolerance in the joint"
        )
    covered = np.minimum(share, 1.0) @ area / area.sum()
    enough = _LEAST if first.group in mesh.touching_faces else LEAST if joint.has_gap_of_mesh else COVERED
    if covered >= enough:
        return
    foot = project_on_surface(mesh.points, second.faces, mesh.points[first.nodes])
    worst, reach = int(np.argmax(foot.distance)), reach_of(mesh, joint, first, second)
    near = foot.distance <= reach
    if covered <= _LEAST and not near.any():
        check_sunk(mesh, joint, first, second, foot)
    if covered <= _LEAST and near.any():  # the surfaces coincide, but their normals are wrong
        normals2 = np.einsum("pk,pki->pi", foot.weights, on_mesh(mesh, second)[foot.nodes])
        normals2 /= np.linalg.norm(normals2, axis=1, keepdims=True)
        check_opposite(mesh, joint, first.normals[near], normals2[near], mesh.points[first.nodes[near]])
    part = f"{1.0 - covered:.1%} of the area of {first.group!r}" if covered > _LEAST else "no contact point found: all its faces"
    advice = "name the smaller surface first, restrict the first group to what touches, or state a larger tolerance"
    if covered <= _LEAST:
        gap_advice = "" if joint.has_gap_of_mesh else ' (gap = "geometry" where they are apart at rest)'
        advice = f"bring the surfaces together, or state a larger tolerance{gap_advice}"
    raise MeshError(
        f"{where}: {part} have no partner within {reach:.3g} m on {second.group!r}; the worst is node "
        f"{mesh.numbers[first.nodes[worst]]} of {first.group!r} at {place(mesh.points[first.nodes[worst]])} m, "
        f"{foot.distance[worst]:.3g} m from the other side; {advice}"
    )
