"""Materials and sections: what the solids are made of, and how their elements are integrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...parallel.errors import MeshError
from ..model import FileBody, FileMaterial
from .cards import Card, number
from .gathered import Gathered, Table
from .scopes import Scope
from .types import OF_DISCRETE, Integration, integration_of, is_solid, kind_of, note_on


def take_materials(model: Gathered) -> None:
    """Take linear, isotropic materials; those whose values depend on the temperature with their tables (temperatures.py).

    Raises
    ------
    MeshError : a value that is no number
    """
    name = ""
    for _, card in model.cards:
        if card.keyword == "MATERIAL":
            name = _spelled(model, card.parameters.get("NAME", ""))
            model.materials[name] = FileMaterial()
        elif card.keyword in ("ELASTIC", "DENSITY", "EXPANSION") and name:
            model.materials[name] = _with(model, model.materials[name], name, card)


def _spelled(model: Gathered, name: str) -> str:
    return next((known for known in model.materials if known.upper() == name.upper()), name)


def _with(model: Gathered, material: FileMaterial, name: str, card: Card) -> FileMaterial:
    """Return a material with what one card says."""
    kind = card.parameter("TYPE", "ISO")
    if kind not in ("ISO", "ISOTROPIC") and card.keyword != "DENSITY":
        effect = f"material {name!r} is not isotropic ({kind})"
        model.findings.add(f"*{card.keyword}, TYPE={kind}", card.where, effect, True, "materials")
        return material
    keys = {"ELASTIC": ("young", "poisson"), "DENSITY": ("density",), "EXPANSION": ("expansion",)}[card.keyword]
    lines = list(card.lines())
    rows = [_row(words, where, card, len(keys)) for words, where in lines]
    if not rows:
        raise MeshError(f"{card.where}: *{card.keyword} of material {name!r} holds no numbers")
    other = [where for row, (_, where) in zip(rows, lines, strict=True) if row != rows[0]]
    if other or "USER" in card.parameters:
        where = (other or [card.where])[0]
        model.tables.setdefault(name, []).append(_table(card, lines, keys, where))
    return replace(material, **dict(zip(keys, rows[0], strict=True)))


def _table(card: Card, lines: list[tuple[list[str], str]], keys: tuple[str, ...], where: str) -> Table:
    """Return values over the temperature, the number behind them in each row."""
    n = len(keys)
    rows = np.array([_row(words, at, card, n + 1) for words, at in lines])
    has_fields = any(word for words, _ in lines for word in words[n + 1 :])
    is_plain = not has_fields and not {"USER", "DEPENDENCIES"} & set(card.parameters)
    zero = number(card.parameters.get("ZERO", "0")) or 0.0
    return Table(card.keyword, where, keys, rows, zero, is_plain)


def _row(words: list[str], where: str, card: Card, n: int) -> tuple[float, ...]:
    """Return the first ``n`` numbers of a data line, 0 where a field is empty."""
    found = [number(word) if word else 0.0 for word in (words + [""] * n)[:n]]
    if any(value is None for value in found):
        raise MeshError(f"{where}: *{card.keyword} holds {','.join(words)[:60]!r} where numbers are due")
    return tuple(value for value in found if value is not None)


def take_sections(model: Gathered) -> None:
    """Make bodies of the sections: one for each integration of its elements.

    Raises
    ------
    MeshError : a section of a set that there is not
    """
    has_section = np.zeros(len(model.grouped.block_of), dtype=bool)
    words = _words(model)
    for scope, card in model.cards:
        if card.keyword == "SOLID SECTION":
            elements = model.mesh.elements(scope, card.parameter("ELSET"), card.where)
            has_section[elements] = True
            _take_section(model, scope, card, elements, words)
    _find_without_section(model, has_section, words)


def _words(model: Gathered) -> np.ndarray:
    """Return which card, by its position among the blocks, each element is of, (n_elements,)."""
    return np.repeat(np.arange(len(model.mesh.blocks)), [len(nodes) for _, _, nodes in model.mesh.blocks])


def _take_section(model: Gathered, scope: Scope, card: Card, elements: np.ndarray, words: np.ndarray) -> None:
    if "COMPOSITE" in card.parameters:
        model.findings.add("*SOLID SECTION, COMPOSITE", card.where, "layers of several materials", True, "bodies")
        return
    material = _spelled(model, card.parameters.get("MATERIAL", ""))
    parts: dict[Integration, list[int]] = {}
    for i in np.unique(words[elements]):
        word = model.mesh.blocks[i][1].word
        how = integration_of(word)
        if how is not None:
            parts.setdefault(how, []).append(int(i))
    named = model.mesh.name_of(scope, card.parameters.get("ELSET", ""))
    for how, blocks in parts.items():
        own = elements[np.isin(words[elements], blocks)]
        types = dict.fromkeys(model.mesh.blocks[i][1].word for i in blocks)
        group = model.grouped.body_group(named if len(parts) == 1 else f"{named} {' '.join(types)}", own)
        if group in model.bodies:
            continue
        model.bodies[group] = FileBody(
            group=group, material=material, integration=how.integration, incompatible_modes=how.incompatible_modes
        )


def _find_without_section(model: Gathered, has_section: np.ndarray, words: np.ndarray) -> None:
    """Add what is to be said of solids without a section, of their variants, and of elements that are no solids."""
    for first, block, nodes in model.mesh.blocks:
        n = len(nodes)
        if is_solid(block.word):
            bare = n - np.count_nonzero(has_section[first : first + n])
            if integration_of(block.word) is None:
                effect = f"{n} elements of a type that this program does not have"
                model.findings.add(f"*ELEMENT, TYPE={block.word}", block.where, effect, True, "bodies")
            elif bare:
                effect = f"{bare} {block.word} elements have no *SOLID SECTION"
                model.findings.add("*ELEMENT", block.where, effect, True, "bodies")
            if note_on(block.word):
                model.findings.add(f"*ELEMENT, TYPE={block.word}", block.where, note_on(block.word), False, "bodies")
        elif block.word.startswith("SFM3D"):
            model.findings.add(f"*ELEMENT, TYPE={block.word}", block.where, "surfaces without stiffness", False)
        elif not _has_own_card(block.word):
            known = "not solids" if kind_of(block.word) or block.word else "of no type"
            effect = f"{n} elements, {known}: their stiffness and mass are not modelled"
            model.findings.add(f"*ELEMENT, TYPE={block.word}", block.where, effect, True)


def _has_own_card(word: str) -> bool:
    return word in (*OF_DISCRETE, "DCOUP3D") or word.startswith("R3D")
