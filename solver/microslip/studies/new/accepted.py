"""Candidates that a run accepts as joints, by the checks of the run."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ...mesh.data import FaceBlock, Mesh
from ...mesh.pairing import contact_points
from ...mesh.penetration import check_penetration
from ...mesh.skin import Skin
from ...mesh.touching import TURNED, Touching
from ...messages.errors import MeshError
from ...tables.joint import Joint
from .candidate import DISTANT, Candidate, bodies_of, plain

LEAST_SHARE = 0.9  # least fraction of the area of one surface on the other, and of the touching area on named surfaces


def covering(mesh: Mesh, skin: Skin, touching: Touching, named: list[Candidate], stated: Sequence[tuple[str, ...]]):
    """Return the named candidates that a run accepts and that cover the touching faces or are stated.  Local, rank 0."""
    usable = [candidate for candidate in named if not refusal(mesh, skin, candidate)]
    is_contact_face = np.zeros(skin.n_faces, dtype=bool)
    for candidate in usable:
        is_contact_face[np.concatenate(candidate.faces)] = True
    wanted = {frozenset(pair) for pair in stated}
    flush = np.abs(touching.gap) <= DISTANT * np.maximum(skin.size[touching.face], skin.size[touching.other])
    area = skin.area * touching.share
    passed = []
    for candidate in usable:
        pairs = bodies_of(skin, *candidate.faces)
        between = [np.isin(skin.body[touching.face], ends) & np.isin(skin.body[touching.other], ends) for ends in pairs]
        joint_faces = np.unique(touching.face[np.logical_or.reduce(between) & flush])
        joint_faces = joint_faces[_have_direction(skin, joint_faces, candidate.faces)]
        is_whole = area[joint_faces[is_contact_face[joint_faces]]].sum() >= LEAST_SHARE * area[joint_faces].sum()
        if is_whole or frozenset(candidate.surfaces) in wanted:
            passed.append(candidate)
    return passed


def _have_direction(skin: Skin, faces: np.ndarray, sides: Iterable[np.ndarray]) -> np.ndarray:
    """Return which faces have the direction of either of two sides, (n,) bool; all faces if a side is round."""
    has_direction = np.zeros(len(faces), dtype=bool)
    for side in sides:
        mean = (skin.area[side, None] * skin.normal[side]).sum(axis=0) / skin.area[side].sum()
        length = np.linalg.norm(mean)
        has_direction |= length < 0.5 or skin.normal[faces] @ mean >= np.cos(np.radians(TURNED)) * length
    return has_direction


def accepted(mesh: Mesh, skin: Skin, order: list[Candidate]) -> list[Candidate]:
    """Return the candidates; those that a run would refuse are marked unlikely, with the reason.  Local, rank 0."""
    taken = np.zeros(skin.n_faces, dtype=bool)
    checked = []
    for candidate in order:
        if candidate.is_likely and not candidate.is_distant and not candidate.is_of_bolt:
            twice = bool(taken[candidate.faces[0]].any())
            reason = "its faces are those of a joint above" if twice else refusal(mesh, skin, candidate)
            candidate = replace(candidate, is_likely=not reason, refused=reason)
            if not reason:
                taken[candidate.faces[0]] = True
        checked.append(candidate)
    return sorted(checked, key=lambda candidate: (candidate.is_distant, not candidate.is_likely))


def refusal(mesh: Mesh, skin: Skin, candidate: Candidate) -> str:
    """Return the reason why a run would refuse a candidate as a joint; "" if accepted.  Local, rank 0."""
    mesh = with_sides(mesh, skin, candidate)
    joint = Joint.of_file(name=candidate.name, surfaces=candidate.surfaces, friction=0.0)
    try:
        check_penetration(mesh, joint, contact_points(mesh, joint))
    except MeshError as problem:
        return _without_joint(problem)
    return ""


def with_sides(mesh: Mesh, skin: Skin, candidate: Candidate) -> Mesh:
    """Return the mesh with groups for both sides of a candidate without names in the file.  Local."""
    if not candidate.made:
        return mesh
    sides = dict(zip(candidate.surfaces, candidate.faces, strict=True))
    blocks = [FaceBlock(kind, name, nodes) for name, side in sides.items() for kind, nodes in skin.by_kind(side).items()]
    groups = mesh.node_groups | {name: skin.nodes_of(side) for name, side in sides.items()}
    return replace(mesh, faces=(*mesh.faces, *blocks), node_groups=groups, touching_faces=mesh.touching_faces | {*sides})


def with_gap(mesh: Mesh, skin: Skin, pair: tuple[str, ...], faces: Mapping[str, np.ndarray]) -> Candidate:
    """Return the candidate of separated surfaces that the file has in contact, with the reason if a run refuses the gap.

    Local, rank 0.
    """
    joint = Joint.of_file(name=" on ".join(pair), surfaces=(pair[0], pair[1]), friction=0.0, gap="geometry")
    first, second = (faces[name] for name in pair)
    sides = (skin.nodes_of(first), skin.nodes_of(second))
    try:
        points = contact_points(mesh, joint)
        check_penetration(mesh, joint, points)
        area, gap, reason = float(points.area.sum()), float(points.distance @ points.area / points.area.sum()), ""
    except MeshError as problem:
        distance, _ = cKDTree(skin.points[sides[1]]).query(skin.points[sides[0]])
        area, gap, reason = float(skin.area[first].sum()), float(distance.min()), _without_joint(problem)
    return Candidate(
        name=plain("_".join(pair)),
        surfaces=(pair[0], pair[1]),
        n_faces=(len(first), len(second)),
        area=area,
        gap=gap,
        size=float(max(skin.size[first].mean(), skin.size[second].mean())),
        matches=False,
        nodes=sides,
        faces=(first, second),
        in_contact_in_file=not reason,
        refused=reason,
        is_likely=not reason,
    )


def _without_joint(problem: MeshError) -> str:
    """Return a message on a joint without file and name.  Local."""
    return str(problem).partition(": joint ")[2].partition(": ")[2] or str(problem)
