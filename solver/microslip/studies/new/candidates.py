"""Candidates for joints: touching surfaces of different bodies, with names of the file or new names."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from ...formats.model import FileModel
from ...mesh.data import FaceBlock, Mesh
from ...mesh.matching import TOLERANCE
from ...mesh.skin import Skin, faces_of_group, groups_of_bodies, skin_of_mesh
from ...mesh.surface import surface_of
from ...mesh.touching import NEAR, TURNED, Touching, find_touching
from ...messages.errors import MeshError
from ...tables.structure import Surface
from ...tables.structure_tables import StructureTables
from .accepted import LEAST_SHARE, accepted, covering, with_gap
from .bolts import Shank, find_bolts
from .candidate import DISTANT, Candidate, bodies_of, plain

_FAR = 0.5  # of the size of the faces: largest distance of candidates


def candidates_and_bolts(mesh: Mesh, file: FileModel, settings: StructureTables) -> tuple[list[Candidate], list[Shank]]:
    """Return the candidates, and the bolts of the mesh.

    Local, rank 0.  First come candidates with names of the file, last those of connected bodies or with a gap.  Surfaces tied by
    the file are not candidates.  Likely joints pass the checks of a run.
    """
    skin = skin_of_mesh(mesh)
    touching = find_touching(skin)
    bodies = set(settings.body_of)
    faces = {
        name: faces_of_group(mesh, skin, name) for name, nodes in mesh.node_groups.items() if name not in bodies and len(nodes)
    }
    faces = {name: of_group for name, of_group in faces.items() if len(of_group)}
    tied = [(faces[a], faces[b]) for a, b in (ty.surfaces for ty in file.ties) if a in faces and b in faces]
    stated = [finding.surfaces for finding in file.findings if len(finding.surfaces) == 2]
    untied = _without(touching, skin, tied)
    named = covering(mesh, skin, untied, _named(skin, untied, faces, stated), stated)
    of_named = [(faces[a], faces[b]) for a, b in (candidate.surfaces for candidate in named)]
    rest = _without(untied, skin, of_named)
    names = [settings.body_of[group] for group in groups_of_bodies(mesh)]
    joined = {frozenset(names[i] for i in pair) for sides in (*tied, *of_named) for pair in bodies_of(skin, *sides)}
    has_gap = np.abs(rest.gap) > DISTANT * np.maximum(skin.size[rest.face], skin.size[rest.other])
    names_in_use = set(mesh.node_groups)
    distant = _near_pairs(_without(find_touching(skin, near=_FAR), skin, tied), touching, _chosen(rest, has_gap))
    unnamed = [
        replace(candidate, is_likely=frozenset(candidate.made[0].bodies) not in joined)
        for pairs, is_distant in ((_chosen(rest, ~has_gap), False), (distant, True))
        for candidate in _unnamed(mesh, skin, pairs, names, names_in_use, not is_distant)
    ]
    bolts = find_bolts(mesh, skin, touching, settings.body_of, set(mesh.node_groups) - {*faces})
    offered = {frozenset(candidate.surfaces) for candidate in named}
    distant_pairs = [pair for pair in dict.fromkeys(stated) if frozenset(pair) not in offered and {*pair} <= faces.keys()]
    of_file = [with_gap(mesh, skin, pair, faces) for pair in distant_pairs]
    order = sorted(
        [_of_bolts(skin, candidate, bolts) for candidate in (*named, *of_file, *unnamed)],
        key=lambda candidate: (candidate.is_distant, not candidate.is_likely, bool(candidate.made), -candidate.area),
    )
    order = [
        replace(candidate, name=name)
        for candidate, name in zip(order, _distinct([candidate.name for candidate in order]), strict=True)
    ]
    return accepted(mesh, skin, order), bolts


def _near_pairs(far: Touching, near: Touching, separated: Touching) -> Touching:
    """Return pairs of near faces that do not touch: ``separated``, and pairs of ``far`` whose faces touch nothing."""
    alone = ~np.isin(far.face, near.face) & ~np.isin(far.other, near.face)
    face, other, gap = (
        np.concatenate([values[alone], more])
        for values, more in ((far.face, separated.face), (far.other, separated.other), (far.gap, separated.gap))
    )
    return Touching(face, other, gap, np.maximum(far.share, separated.share))


def _of_bolts(skin: Skin, candidate: Candidate, bolts: Sequence[Shank]) -> Candidate:
    """Return a candidate, marked if one side belongs to a bolt, nut or washer."""
    hardware = [number for bolt in bolts for number in (bolt.part, *bolt.rings)]
    return replace(candidate, is_of_bolt=any(bool(np.isin(skin.part[side], hardware).all()) for side in candidate.faces))


def _chosen(touching: Touching, chosen: np.ndarray) -> Touching:
    """Return the chosen pairs of faces; ``chosen``: (n,) bool."""
    return replace(touching, face=touching.face[chosen], other=touching.other[chosen], gap=touching.gap[chosen])


def _without(touching: Touching, skin: Skin, pairs: Iterable[tuple[np.ndarray, np.ndarray]]) -> Touching:
    """Return the pairs of faces except those between the two sets of faces of any of ``pairs``."""
    chosen = np.ones(len(touching.face), dtype=bool)
    for first, second in pairs:
        chosen &= ~_between(touching, skin, first, second)
    return _chosen(touching, chosen)


def _between(touching: Touching, skin: Skin, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return which pairs are between two sets of faces, in either order."""
    is_first, is_second = np.zeros((2, skin.n_faces), dtype=bool)
    is_first[first], is_second[second] = True, True
    face, other = touching.face, touching.other
    return (is_first[face] & is_second[other]) | (is_second[face] & is_first[other])


def _named(skin: Skin, touching: Touching, faces: dict[str, np.ndarray], stated: Sequence[tuple[str, ...]]) -> list[Candidate]:
    """Return the candidates with names in the file.

    Of several groups of the same faces the ones in contact in the file are taken, then the first.
    """
    names = list(faces)
    at = np.repeat(np.arange(len(names)), [len(face) for face in faces.values()])
    members = sp.csr_matrix(
        (np.ones(len(at)), (at, np.concatenate([*faces.values(), np.zeros(0, dtype=np.int64)]))), (len(names), skin.n_faces)
    )
    pairs = sp.csr_matrix((np.ones(len(touching.face)), (touching.face, touching.other)), (skin.n_faces, skin.n_faces))
    meets = (pairs @ members.T).astype(bool).astype(float)  # (n_faces, n_groups)
    area = members @ sp.diags(skin.area)
    share = sp.diags(1.0 / np.maximum(np.asarray(area.sum(axis=1)).ravel(), 1e-300)) @ (area @ meets)
    overlap = sp.coo_matrix(share)
    mutual = {(i, j): (value, share[j, i]) for i, j, value in zip(overlap.row, overlap.col, overlap.data) if i < j}
    wanted = {frozenset(pair) for pair in stated}

    def rank(pair: tuple[int, int]) -> tuple:
        is_wanted = frozenset((names[pair[0]], names[pair[1]])) in wanted
        return (not is_wanted, -round(mutual[pair][0] * mutual[pair][1], 6), pair)

    candidates = []
    for i, j in sorted(mutual, key=rank):
        is_wanted = frozenset((names[i], names[j])) in wanted
        if max(mutual[i, j]) < LEAST_SHARE and not is_wanted:
            continue
        inside = _between(touching, skin, faces[names[i]], faces[names[j]])
        if not inside.any():
            continue  # in an earlier candidate
        first, second = _in_order(skin, (i, mutual[i, j][0]), (j, mutual[i, j][1]), [faces[name] for name in names])
        candidates.append(_candidate(skin, touching, (names[first], names[second]), faces[names[first]], faces[names[second]]))
        touching = _without(touching, skin, [(faces[names[i]], faces[names[j]])])
    return candidates


def _in_order(skin: Skin, first: tuple[int, float], other: tuple[int, float], faces: list[np.ndarray]) -> tuple[int, int]:
    """Return the order of two surfaces: first the one entirely on the other; if both are, the finer one."""
    if min(first[1], other[1]) > 0.98:
        finer = skin.area[faces[first[0]]].mean() <= 1.001 * skin.area[faces[other[0]]].mean()
        return (first[0], other[0]) if finer else (other[0], first[0])
    return (first[0], other[0]) if first[1] >= other[1] else (other[0], first[0])


def _candidate(skin: Skin, touching: Touching, surfaces, first: np.ndarray, second: np.ndarray, made=()) -> Candidate:
    """Return the candidate of two surfaces of a skin."""
    inside = _between(touching, skin, first, second) & np.isin(touching.face, first)
    touched, on = np.unique(touching.face[inside]), np.unique(touching.other[inside])
    weight = skin.area[touching.face[inside]]
    return Candidate(
        name=plain(f"{surfaces[0]}_{surfaces[1]}" if not made else surfaces[0]),
        surfaces=surfaces,
        made=made,
        n_faces=(len(touched), len(on)),
        area=float((skin.area * touching.share)[touched].sum()),
        gap=float(touching.gap[inside] @ weight / weight.sum()),
        size=float(max(skin.size[touched].mean(), skin.size[on].mean())),
        matches=_match(skin, first, second),
        nodes=(skin.nodes_of(touched), skin.nodes_of(on)),
        faces=(first, second),
    )


def _match(skin: Skin, first: np.ndarray, second: np.ndarray) -> bool:
    """Return whether the nodes of two sets of faces coincide one to one."""
    nodes, others = skin.nodes_of(first), skin.nodes_of(second)
    if len(nodes) != len(others):
        return False
    distance, partner = cKDTree(skin.points[others]).query(skin.points[nodes])
    diagonal = np.linalg.norm(np.ptp(skin.points, axis=0))
    return bool((distance <= TOLERANCE * diagonal).all() and len(np.unique(partner)) == len(nodes))


def _unnamed(
    mesh: Mesh, skin: Skin, touching: Touching, names: list[str], names_in_use: set[str], splits: bool
) -> list[Candidate]:
    """Return a candidate for each two bodies that touch outside groups, several if they touch around an edge.

    ``names``: names of the bodies; ``names_in_use``: names of existing surfaces.
    """
    candidates = []
    pairs = np.unique(np.sort(np.stack([skin.body[touching.face], skin.body[touching.other]], axis=1), axis=1), axis=0)
    for a, b in pairs.tolist():
        first = np.unique(touching.face[(skin.body[touching.face] == a) & (skin.body[touching.other] == b)])
        second = np.unique(touching.face[(skin.body[touching.face] == b) & (skin.body[touching.other] == a)])
        if skin.area[second].mean() < 0.999 * skin.area[first].mean() and a != b:
            (a, first), (b, second) = (b, second), (a, first)  # finer side first
        for normal, side, other in _sides(mesh, skin, first, second, a == b, splits):
            stems = (f"{names[a]}_on_{names[b]}", f"{names[b]}_on_{names[a]}")
            surfaces = _new_names(stems if a != b else (f"{names[a]}_one_side", f"{names[a]}_other_side"), names_in_use)
            back = None if normal is None else (-normal[0] + 0.0, -normal[1] + 0.0, -normal[2] + 0.0)
            reach = _tolerance(skin, touching, side, other)
            made = (
                Surface.of_file(name=surfaces[0], bodies=(names[a], names[b]), normal=normal, tolerance=reach),
                Surface.of_file(name=surfaces[1], bodies=(names[b], names[a]), normal=back, tolerance=reach),
            )
            candidates.append(_candidate(skin, touching, surfaces, side, other, made))
    return candidates


def _tolerance(skin: Skin, touching: Touching, first: np.ndarray, second: np.ndarray) -> float | None:
    """Return the distance of the faces of two sides, rounded up [m]; None if the default tolerance finds them."""
    inside = _between(touching, skin, first, second)
    gap, size = np.abs(touching.gap[inside]), np.maximum(skin.size[touching.face], skin.size[touching.other])[inside]
    if not (gap > 0.9 * NEAR * size).any():
        return None
    return float(f"{1.1 * gap.max():.2g}")


def _sides(mesh: Mesh, skin: Skin, first: np.ndarray, second: np.ndarray, is_same_body: bool, splits: bool):
    """Yield (normal, faces, faces of the other side): once without a normal, or by normals of parts between sharp edges."""
    if not is_same_body and (not splits or (_is_smooth(mesh, skin, first) and _is_smooth(mesh, skin, second))):
        yield None, first, second
        return
    left = first
    while len(left):
        largest = skin.normal[left[np.argmax(skin.area[left])]]
        side = left[skin.normal[left] @ largest >= np.cos(np.radians(TURNED))]
        mean = (skin.area[side, None] * skin.normal[side]).sum(axis=0)
        normal = np.round(mean / np.linalg.norm(mean), 3) + 0.0
        side = left[skin.normal[left] @ normal >= np.cos(np.radians(TURNED)) * np.linalg.norm(normal)]
        other = second[-(skin.normal[second] @ normal) >= np.cos(np.radians(TURNED)) * np.linalg.norm(normal)]
        if len(side) == 0 or len(other) == 0:
            return
        yield (float(normal[0]), float(normal[1]), float(normal[2])), side, other
        left = np.setdiff1d(left, np.concatenate([side, other]) if is_same_body else side)


def _is_smooth(mesh: Mesh, skin: Skin, faces: np.ndarray) -> bool:
    """Return whether a joint may have these faces as one surface."""
    name = "faces that touch"
    blocks = tuple(FaceBlock(kind, name, nodes) for kind, nodes in skin.by_kind(faces).items())
    try:
        surface_of(replace(mesh, faces=blocks, node_groups={name: skin.nodes_of(faces)}), name)
    except MeshError:
        return False
    return True


def _new_names(stems: tuple[str, str], names_in_use: set[str]) -> tuple[str, str]:
    """Return two unused names, and mark them as used."""
    number = 1
    first, second = names = (plain(stems[0]), plain(stems[1]))
    while first in names_in_use or second in names_in_use or first == second:
        number += 1
        first, second = (f"{name}_{number}" for name in names)
    names_in_use.update((first, second))
    return first, second


def _distinct(names: list[str]) -> list[str]:
    """Return distinct names: repeated ones get a number."""
    distinct: list[str] = []
    for name in names:
        number = 1 + sum(other == name or other.startswith(f"{name} ") for other in distinct)
        distinct.append(name if number == 1 else f"{name} {number}")
    return distinct
