"""Supports and equations of bulk data, in the axes of the grid points."""

from typing import Any

import numpy as np

from ..draft import Term
from .content import Content


def take_supports(content: Content) -> None:
    """Take the supports of SPC, SPC1 and the grid points.  Local."""
    fixed = np.zeros((len(content.numbers), 6), dtype=bool)
    defaults = getattr(content.cards.grdset, "ps", None) or ""
    for number, node in content.cards.nodes.items():
        _hold(fixed, content, [number], str(node.ps or defaults), "GRID")
    for card in _chosen(content, "SPC", "supports", content.cards.spcs, content.cards.spcadds):
        if card.type == "SPC1":
            _hold(fixed, content, _without_gaps(content, card), card.components, "SPC1")
        elif card.type == "SPC":
            for node, components, value in zip(card.nodes, card.components, card.enforced, strict=True):
                if value:
                    content.left_out("SPC", int(node), f"a displacement of {value} other than 0", "supports")
                else:
                    _hold(fixed, content, [node], components, "SPC")
        else:
            content.left_out(card.type, int(card.conid), "a support of a kind that is not read", "supports")
    content.hold("SPC", fixed)


def _without_gaps(content: Content, card: Any) -> list[int]:
    """Return the grid points of an SPC1; those of "first THRU last" that the file does not hold are ignored, as by Nastran.

    pyNastran lists the numbers of a range: consecutive numbers of a card are those of a range.
    """
    numbers = [int(node) for node in card.nodes]
    stated, held = set(numbers), set(content.numbers.tolist())
    absent = {n for n in stated - held if n - 1 in stated or n + 1 in stated}
    if not absent or absent == stated:
        return numbers
    count = f"{len(absent)} of its {len(stated)} grid points, as {min(absent)}"
    content.taken_over(
        "SPC1", int(card.conid), f"{count}, are not in the file; Nastran ignores such points of ranges", "supports"
    )
    return [n for n in numbers if n not in absent]


def _hold(fixed: np.ndarray, content: Content, nodes: Any, components: str, where: str) -> None:
    digits = [int(c) - 1 for c in str(components) if c in "123456"]
    if digits:
        fixed[content.find(map(int, nodes), where)[:, None], digits] = True


def _chosen(content: Content, word: str, part: str, sets: dict, added: dict) -> list[Any]:
    """Return the cards of the set named by the case control.

    Where it names a set of the other kind (SPC, MPC) alone, none, as Nastran; where it names neither, those of the only set.
    """
    deck, everything = content.cards.case_control_deck, {*sets, *added}
    subcases = [] if deck is None else [subcase.params for subcase in deck.subcases.values()]
    wanted = {int(params[word][0]) for params in subcases if word in params}
    if not wanted and any(kind in params for params in subcases for kind in ("SPC", "MPC")):
        for number in sorted(everything):
            effect = f"the case control names no {word} set, and Nastran leaves set {number} out, too"
            content.left_out(word, number, effect, part, changes=False)
        return []
    if len(wanted) > 1:
        effect = f"the case control names several sets; the first, {min(wanted)}, is taken"
        content.left_out(word, min(wanted), effect, part)
    if not wanted and len(everything) > 1:
        content.left_out(word, min(everything), "several sets and no case control that names one", part)
    number = min(wanted or everything or {0})
    if not wanted and len(everything) == 1 and deck is not None:
        effect = f"the case control names no set: Nastran would leave out set {number}, the only one; it is taken over here"
        content.taken_over(word, number, effect, part)
    members = [member for card in added.get(number, ()) for member in card.sets] if number in added else [number]
    return [card for member in members for card in sets.get(member, ())]


def take_equations(content: Content) -> None:
    """Take the equations of MPC.  Local."""
    for card in _chosen(content, "MPC", "equations", content.cards.mpcs, content.cards.mpcadds):
        if any(str(component) not in "123456" for component in card.components):
            content.left_out("MPC", int(card.conid), "an equation with a scalar point", "equations")
            continue
        nodes = content.find(map(int, card.nodes), "MPC").tolist()
        terms: list[Term] = [
            (node, int(component) - 1, float(value))
            for node, component, value in zip(nodes, card.components, card.coefficients, strict=True)
        ]
        content.add_equation("MPC", f"MPC {card.conid}", terms)
