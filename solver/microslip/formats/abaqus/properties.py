"""Materials and sections of solids, and the quadrature of their elements."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...messages.errors import MeshError
from ...messages.words import counted
from ...tables.structure import Body, Material, Orientation
from ...tables.table import Vector
from ..draft import vector
from .cards import Card, number
from .input_model import InputModel, Table
from .scopes import Scope, rotation_about
from .types import OF_DISCRETE, Integration, integration_of, is_solid, kind_of, note_on

_A_LINE = 8  # numbers on a full line of a material card


def take_materials(model: InputModel) -> None:
    """Take linear elastic materials; temperature-dependent ones with their tables (temperatures.py).

    Raises
    ------
    MeshError : a value that is not a number
    """
    for first, *cards in _of_each_material(model):
        name = _spelled(model, first.parameters.get("NAME", ""))
        known, tables = model.materials.get(name), model.tables.pop(name, [])
        model.materials[name] = Material.of_file()
        _take_properties(model, name, cards)
        if known is not None:  # the first statement is used, as in CalculiX; a different second one is reported
            differs = (known, tables) != (model.materials[name], model.tables.pop(name, []))
            model.findings.add("*MATERIAL", first.where, f"{name!r} again: as first stated is taken", differs, "materials")
            model.materials[name] = known
        if tables:
            model.tables[name] = tables


def _of_each_material(model: InputModel) -> list[list[Card]]:
    """Return the cards of each *MATERIAL with a name, the *MATERIAL card first."""
    groups: list[list[Card]] = []
    for _, card in model.cards:
        if card.keyword == "MATERIAL":
            groups.append([card])
        elif groups and card.keyword in ("ELASTIC", "DENSITY", "EXPANSION"):
            groups[-1].append(card)
    return [cards for cards in groups if cards[0].parameters.get("NAME")]


def _take_properties(model: InputModel, name: str, cards: list[Card]) -> None:
    stated: dict[str, str] = {}  # places of the properties
    for card in cards:
        known, model.materials[name] = model.materials[name], _with(model, model.materials[name], name, card)
        if card.keyword in stated:
            effect = f"of material {name!r} again, after {stated[card.keyword]}: the last is taken"
            model.findings.add(f"*{card.keyword}", card.where, effect, known != model.materials[name], "materials")
        stated[card.keyword] = card.where


def _spelled(model: InputModel, name: str) -> str:
    return next((known for known in model.materials if known.upper() == name.upper()), name)


def _with(model: InputModel, material: Material, name: str, card: Card) -> Material:
    """Return a material with the values of one card."""
    kind = kind_of_material(card)
    if kind is None:
        stated = card.parameter("TYPE")
        effect = f"material {name!r} is of a type ({stated}) that this program does not have"
        model.findings.add(f"*{card.keyword}, TYPE={stated}", card.where, effect, True, "materials")
        return material
    n = VALUES[card.keyword, kind]
    records = _records(card, n)
    rows = [_row(words, where, card, n) for words, where in records]
    if not rows:
        raise MeshError(f"{card.where}: *{card.keyword} of material {name!r} holds no numbers")
    other = [where for row, (_, where) in zip(rows, records, strict=True) if row != rows[0]]
    if other or "USER" in card.parameters:
        where = (other or [card.where])[0]
        model.tables.setdefault(name, []).append(_table(card, records, kind, where))
    return material.with_keys(**keys_of(card.keyword, kind, rows[0]))


def _records(card: Card, n: int) -> list[tuple[list[str], str]]:
    """Return the fields of each set of ``n`` values with temperature and field variables, and the place of its begin.

    Raises
    ------
    MeshError : lines that belong to a set are missing
    """
    lines = list(card.lines())
    n_fields = max(int(number(card.parameters.get("DEPENDENCIES", "0")) or 0), 0)
    n_lines = -(-(n + 1 + n_fields) // _A_LINE)
    if len(lines) % n_lines:
        raise MeshError(f"{card.where}: *{card.keyword} holds {counted(len(lines), 'line')} where sets of {n_lines} are expected")
    starts = range(0, len(lines), n_lines)
    if n_lines == 1:
        return lines
    padded = [(words + [""] * _A_LINE)[:_A_LINE] for words, _ in lines]
    return [(sum(padded[i : i + n_lines], []), lines[i][1]) for i in starts]


def _table(card: Card, records: list[tuple[list[str], str]], kind: str, where: str) -> Table:
    """Return values over the temperature, the last number of each row."""
    n = VALUES[card.keyword, kind]
    rows = np.array([_row(words, at, card, n + 1) for words, at in records])
    has_fields = any(word for words, _ in records for word in words[n + 1 :])
    is_plain = not has_fields and not {"USER", "DEPENDENCIES"} & set(card.parameters)
    zero = number(card.parameters.get("ZERO", "0")) or 0.0
    return Table(card.keyword, where, kind, rows, zero, is_plain)


def _row(words: list[str], where: str, card: Card, n: int) -> tuple[float, ...]:
    """Return the first ``n`` numbers of a data line; 0 for empty fields."""
    values = [number(word) if word else 0.0 for word in (words + [""] * n)[:n]]
    if any(value is None for value in values):
        raise MeshError(f"{where}: *{card.keyword} holds {','.join(words)[:60]!r} where numbers are expected")
    return tuple(value for value in values if value is not None)


def take_sections(model: InputModel) -> None:
    """Make bodies from the sections: one for each integration of the elements.

    Raises
    ------
    MeshError : a section of a set that does not exist
    """
    has_section = np.zeros(len(model.grouped.block_of), dtype=bool)
    words = _words(model)
    for scope, card in model.cards:
        if card.keyword == "SOLID SECTION":
            elements = model.mesh.elements(scope, card.parameter("ELSET"), card.where)
            has_section[elements] = True
            _take_section(model, scope, card, elements, words)
    _find_without_section(model, has_section)
    for _, card in model.cards:
        if card.keyword == "ORIENTATION" and card not in model.axes_of_materials:
            model.findings.add("*ORIENTATION", card.where, "no anisotropic material uses it", False, "bodies")


def _words(model: InputModel) -> np.ndarray:
    """Return for each element the position of its card among the blocks, (n_elements,)."""
    return np.repeat(np.arange(len(model.mesh.blocks)), [len(nodes) for _, _, nodes in model.mesh.blocks])


def _take_section(model: InputModel, scope: Scope, card: Card, elements: np.ndarray, words: np.ndarray) -> None:
    if "COMPOSITE" in card.parameters:
        model.findings.add("*SOLID SECTION, COMPOSITE", card.where, "layers of several materials", True, "bodies")
        return
    material = _spelled(model, card.parameters.get("MATERIAL", ""))
    orientation = _orientation(model, scope, card, model.materials.get(material, Material.of_file()))
    parts: dict[Integration, list[int]] = {}
    for i in np.unique(words[elements]):
        word = model.mesh.blocks[i][1].word
        how = integration_of(word)
        if how is not None:
            parts.setdefault(how, []).append(int(i))
    named = model.mesh.name_of(scope, card.parameters.get("ELSET", ""))
    for how, blocks in parts.items():
        members = elements[np.isin(words[elements], blocks)]
        types = dict.fromkeys(model.mesh.blocks[i][1].word for i in blocks)
        group = model.grouped.body_group(named if len(parts) == 1 else f"{named} {' '.join(types)}", members)
        if group in model.bodies:
            continue
        model.bodies[group] = Body.of_file(
            group=group,
            material=material,
            orientation=orientation,
            integration=how.integration,
            incompatible_modes=how.incompatible_modes,
        )


def _orientation(model: InputModel, scope: Scope, section: Card, material: Material) -> str | None:
    """Return the name of the axes of a section's material, and add them; None for model axes or isotropic materials.

    Raises
    ------
    MeshError : the section names axes that do not exist
    """
    if not material.has_axes and not isinstance(material.expansion, tuple):
        return None
    wanted = section.parameters.get("ORIENTATION", "")
    if not wanted:
        if (scope.rotation != np.eye(3)).any():
            effect = f"an anisotropic material in instance {scope.name}, which is turned, without *ORIENTATION"
            model.findings.add("*SOLID SECTION", section.where, effect, True, "bodies")
        return None
    for owner, card in model.cards:
        if card.keyword == "ORIENTATION" and owner is scope and card.parameter("NAME") == wanted.upper():
            model.axes_of_materials.add(card)
            orientation = orientation_of(scope, card)
            if orientation is None:
                effect = "axes of a material that are not stated by coordinates, rectangular or cylindrical"
                model.findings.add("*ORIENTATION", card.where, effect, True, "bodies")
                return None
            name = scope.named(card.parameters["NAME"])
            model.orientations[name] = orientation
            return name
    raise MeshError(f"{section.where}: *SOLID SECTION: there is no *ORIENTATION {wanted!r}")


def _find_without_section(model: InputModel, has_section: np.ndarray) -> None:
    """Add findings of solids without a section, of variants of solids, and of elements that are not solids."""
    for first, block, nodes in model.mesh.blocks:
        n = len(nodes)
        if is_solid(block.word):
            bare = n - np.count_nonzero(has_section[first : first + n])
            if integration_of(block.word) is None:
                effect = f"{counted(n, 'element')} of a type that this program does not have"
                model.findings.add(f"*ELEMENT, TYPE={block.word}", block.where, effect, True, "bodies")
            elif bare:
                effect = f"{bare} {block.word} elements have no *SOLID SECTION"
                model.findings.add("*ELEMENT", block.where, effect, True, "bodies")
            if note_on(block.word):
                word, effect = f"*ELEMENT, TYPE={block.word}", note_on(block.word)
                model.findings.add(word, block.where, effect, False, "bodies", is_taken=True)
        elif block.word.startswith("SFM3D"):
            model.findings.add(f"*ELEMENT, TYPE={block.word}", block.where, "surfaces without stiffness", False)
        elif not _has_own_card(block.word):
            known = "not solids" if kind_of(block.word) or block.word else "of no type"
            effect = f"{counted(n, 'element')}, {known}: their stiffness and mass are not modelled"
            model.findings.add(f"*ELEMENT, TYPE={block.word}", block.where, effect, True)


def _has_own_card(word: str) -> bool:
    return word in (*OF_DISCRETE, "DCOUP3D") or word.startswith("R3D")


# numbers of a material card, by the distinguishing part of its TYPE
VALUES = {
    ("DENSITY", "ISO"): 1,
    ("ELASTIC", "ISO"): 2,
    ("ELASTIC", "ORTHO"): 9,
    ("ELASTIC", "ENGINEERING"): 9,
    ("ELASTIC", "ANISO"): 21,
    ("EXPANSION", "ISO"): 1,
    ("EXPANSION", "ORTHO"): 3,
}
_ORTHO = (0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2), (3, 3), (4, 4), (5, 5)  # entries of the (6, 6), in the card's order
_ANISO = tuple((row, column) for column in range(6) for row in range(column + 1))


def kind_of_material(card: Card) -> str | None:
    """Return the key in VALUES of a material card, or None.  Local."""
    stated = "".join(card.parameter("TYPE", "ISO").split()) if card.keyword != "DENSITY" else "ISO"
    return next((kind for keyword, kind in VALUES if keyword == card.keyword and stated.startswith(kind)), None)


def keys_of(keyword: str, kind: str, values: Sequence[float]) -> dict[str, Any]:
    """Return the numbers of a material card as keys of a ``Material``.  Local."""
    if keyword == "DENSITY":
        return {"density": values[0]}
    if keyword == "EXPANSION":
        return {"expansion": values[0] if len(set(values)) == 1 else tuple(values)}
    if kind == "ISO":
        return {"young": values[0], "poisson": values[1]}
    if kind == "ENGINEERING":
        return {"young": tuple(values[:3]), "poisson": tuple(values[3:6]), "shear": tuple(values[6:])}
    six = np.zeros((6, 6))
    for (i, j), value in zip(_ORTHO if kind == "ORTHO" else _ANISO, values, strict=True):
        six[i, j] = six[j, i] = value
    return {"elasticity": tuple(map(tuple, six.tolist()))}


def orientation_of(scope: Scope, card: Card) -> Orientation | None:
    """Return the axes that an *ORIENTATION states by coordinates, in axes of the model; None for other definitions.  Local.

    Raises
    ------
    MeshError : data lines that do not define axes
    """
    system, definition = card.parameter("SYSTEM", "RECTANGULAR"), card.parameter("DEFINITION", "COORDINATES")
    if system not in ("RECTANGULAR", "CYLINDRICAL") or definition != "COORDINATES":
        return None
    lines = [[number(word) if word else 0.0 for word in words] for words, _ in card.lines()]
    if not lines or len(lines) > 2 or len(lines[0]) < 6 or any(value is None for line in lines for value in line):
        return None
    points = np.array([*lines[0], 0.0, 0.0, 0.0][:9], dtype=float).reshape(3, 3)
    turn, angle = _further_turn(lines[1] if len(lines) > 1 else [], card)
    if system == "CYLINDRICAL":
        points = scope.placed(points)
        axis = points[1] - points[0]
        if not axis.any():
            raise MeshError(f"{card.where}: *ORIENTATION: the two points of its axis coincide")
        return Orientation.of_file(axis=vector(axis), axis_point=vector(points[0])) if angle == 0.0 else None
    x, y = points[0] - points[2], points[1] - points[2]
    if not np.cross(x, y).any():
        raise MeshError(f"{card.where}: *ORIENTATION: its points lie on one line and span no plane")
    return Orientation.of_file(directions=_turned(x, y, turn, np.deg2rad(angle), scope, card))


def _further_turn(words: list, card: Card) -> tuple[int, float]:
    """Return the axis, from 0, and the angle [degrees] of the second data line."""
    axis, angle = (*words, *(0.0, 0.0)[len(words) :])[:2]
    if axis not in (0.0, 1.0, 2.0, 3.0):
        raise MeshError(f"{card.where}: *ORIENTATION turns about axis {axis:g}; expected 1, 2 or 3")
    return max(int(axis) - 1, 0), angle


def _turned(x: np.ndarray, y: np.ndarray, k: int, angle: float, scope: Scope, card: Card) -> tuple[Vector, Vector]:
    """Return the first two axes from x and y in their plane, turned about axis ``k`` and with the instance."""
    third = np.cross(x, y)
    axes = np.stack([x, np.cross(third, x), third])
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    axes = axes @ (scope.rotation @ rotation_about(axes[k], angle, card.where)).T
    return vector(axes[0]), vector(axes[1])
