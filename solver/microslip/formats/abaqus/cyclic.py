"""*CYCLIC SYMMETRY MODEL and its *TIE of CalculiX: the sector, and the keys of [cyclic] that a scene needs."""

import numpy as np

from ...messages.errors import MeshError
from ..draft import vector
from ..model import FileSectors, Finding, sectors_in_words
from .cards import Card, number
from .findings import CYCLIC, PART
from .input_model import InputModel
from .scopes import Scope

WORD = "CYCLIC SYMMETRY MODEL"


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
    for scope, card in model.cards:
        if card.keyword != WORD:
            continue
        sectors = _sectors(model, scope, card, faces)
        if model.sectors is None:
            model.sectors, part = sectors, PART
            effect = f"{CYCLIC}; {sectors_in_words(sectors)}"
        else:
            first, other = (" and ".join(each.faces or ("LOW", "HIGH")) for each in (model.sectors, sectors))
            part = ""  # no key of [cyclic] replaces it
            effect = (
                f"a second cyclic symmetry, of {other}; [cyclic] has one pair of faces: state a single one in the file, with all "
                f"faces of both, as {first} are those of a part of the sector"
            )
        model.findings.take(Finding(word=f"*{WORD}", where=card.where, effect=effect, changes=True, part=part))


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
