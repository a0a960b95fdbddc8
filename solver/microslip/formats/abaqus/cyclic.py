"""*CYCLIC SYMMETRY MODEL and its *TIE of CalculiX: the sector, and the keys of [cyclic] that a scene needs."""

from dataclasses import replace

import numpy as np

from ...messages.errors import MeshError
from ..draft import vector
from ..model import FileSectors, Finding, sectors_in_words
from .cards import Card, number
from .findings import CYCLIC, PART
from .input_model import InputModel
from .scopes import Scope

WORD = "CYCLIC SYMMETRY MODEL"
_SAME = 1e-9  # of directions and of the size of the model, by which the axes of two cards may differ


def take_cyclic(model: InputModel) -> None:
    """Add the cards of a cyclic sector to the findings, with the equivalent table of a scene.

    Raises
    ------
    MeshError : an invalid number of sectors or axis
    """
    faces = {
        card.parameters.get("NAME", ""): words[:2]
        for _, card in model.cards
        if card.keyword == "TIE" and "CYCLICSYMMETRY" in card.parameters
        for words, _ in card.lines()
    }
    disc, replaced = None, []
    for scope, card in model.cards:
        if card.keyword != WORD:
            continue
        sectors = _sectors(model, scope, card, faces)
        joined = sectors if disc is None else _joined(model, disc, sectors)
        if joined is not None:
            disc = joined
            replaced.append(card.where)
            continue
        pair = " and ".join(sectors.faces or ("LOW", "HIGH"))
        effect = f"another cyclic symmetry, of {pair}, with other sectors or axis; [cyclic] has one"
        model.findings.take(Finding(word=f"*{WORD}", where=card.where, effect=effect, changes=True))
    if disc is not None:
        model.sectors, effect = disc, f"{CYCLIC}; {sectors_in_words(disc)}"
        for where in replaced:
            model.findings.take(Finding(word=f"*{WORD}", where=where, effect=effect, changes=True, part=PART))


def _joined(model: InputModel, first: FileSectors, second: FileSectors) -> FileSectors | None:
    """Return the sector with the faces of both cards in one pair of groups; None where they are not of the same disc."""
    known = [*(first.faces or ()), *(second.faces or ())]
    if first.sectors != second.sectors or len(known) != 4 or not all(name in model.grouped.groups for name in known):
        return None
    axis, other = (np.array(each.axis, dtype=float) for each in (first, second))
    offset = np.array(second.axis_point, dtype=float) - np.array(first.axis_point, dtype=float)
    size = np.linalg.norm(axis) * np.ptp(model.mesh.points, axis=0).max()
    is_parallel = axis @ other > (1.0 - _SAME) * np.linalg.norm(axis) * np.linalg.norm(other)
    if not is_parallel or np.linalg.norm(np.cross(offset, axis)) > _SAME * size:
        return None
    names = [
        model.grouped.node_group(f"{a} and {b}", np.concatenate([model.grouped.nodes_of(a), model.grouped.nodes_of(b)]))
        for a, b in zip(known[:2], known[2:])
    ]
    return replace(first, faces=(names[0], names[1]))


def _sectors(model: InputModel, scope: Scope, card: Card, faces: dict[str, list[str]]) -> FileSectors:
    """Return the data of a card: sectors, axis, and the faces of its tie."""
    n_sectors = number(card.parameters.get("N", ""))
    if n_sectors is None or n_sectors < 2 or n_sectors != int(n_sectors):
        raise MeshError(
            f"{card.where}: *{card.keyword}: N={card.parameters.get('N', '')}: expected a number of sectors, at least 2"
        )
    ends = [number(word) for words, _ in card.lines() for word in words if word.strip()]
    names = faces.get(card.parameters.get("TIE", ""), next(iter(faces.values()), []))
    if not ends:
        return FileSectors(sectors=int(n_sectors))
    if len(ends) != 6 or None in ends:
        raise MeshError(f"{card.where}: *{card.keyword}: expected six coordinates of two points of the axis below it")
    first, last = np.array(ends[:3], dtype=float), np.array(ends[3:], dtype=float)
    if not np.linalg.norm(last - first) > 0.0:
        raise MeshError(f"{card.where}: *{card.keyword}: the two points of the axis coincide")
    low_high = _in_order(model, scope, names, first, last - first) if len(names) == 2 else None
    return FileSectors(sectors=int(n_sectors), axis=vector(last - first), axis_point=vector(first), faces=low_high)


def _in_order(model: InputModel, scope: Scope, names: list[str], point: np.ndarray, axis: np.ndarray) -> tuple[str, str]:
    """Return low and high face: the high one lies in the positive sense about the axis, by the shorter way."""
    known = [scope.named(name) if scope.named(name) in model.grouped.groups else name for name in names]
    if not all(name in model.grouped.groups for name in known):
        return known[0], known[1]
    unit = axis / np.linalg.norm(axis)
    a, b = (model.mesh.points[model.grouped.nodes_of(name)].mean(axis=0) - point for name in known)
    return (known[1], known[0]) if unit @ np.cross(a, b) < 0.0 else (known[0], known[1])
