"""Parts, instances and the assembly: the scope of the numbers and names of each card."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ...messages.errors import MeshError
from .cards import Card, values_of


@dataclass(eq=False)
class Scope:
    """A scope of unique numbers and names: the model with its assembly, or one instance of a part."""

    name: str  # "" for the model
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def placed(self, points: np.ndarray) -> np.ndarray:
        """Return points (n, 3) of the part at their positions in the instance."""
        if not self.name:
            return points
        return points @ self.rotation.T + self.translation

    def named(self, name: str) -> str:
        """Return the name in the assembly, as Abaqus writes it: "instance.set"."""
        return f"{self.name}.{name}" if self.name else name


def in_scopes(cards: list[Card]) -> list[tuple[Scope, Card]]:
    """Return every card with its scope, cards of a part once per instance.

    Without instances a single part is the model itself.

    Raises
    ------
    MeshError : instances of parts that do not exist; parts, instances or an assembly that do not end
    """
    model = Scope("")
    parts, rest = _parts(cards)
    if not any(card.keyword == "INSTANCE" for card in rest):
        if len(parts) > 1:
            first = next(iter(parts.values()))[0]
            raise MeshError(f"{first.where}: {len(parts)} parts and no *INSTANCE of any part: there is nothing to read")
        of_parts = [card for part in parts.values() for card in part[1:]]
        return [(model, card) for card in of_parts + rest]
    return list(_in_instances(parts, rest, model))


def _parts(cards: list[Card]) -> tuple[dict[str, list[Card]], list[Card]]:
    """Return the cards of each part, its *PART first, by its name in upper case, and all others."""
    parts: dict[str, list[Card]] = {}
    rest: list[Card] = []
    inside: list[Card] | None = None
    for card in cards:
        if card.keyword == "PART":
            name = card.parameter("NAME")
            if inside is not None or name in parts:
                raise MeshError(f"{card.where}: *PART {name} " + ("again" if name in parts else "within another part"))
            inside = parts.setdefault(name, [card])
        elif card.keyword == "END PART":
            inside = None
        else:
            (rest if inside is None else inside).append(card)
    if inside is not None:
        raise MeshError(f"{inside[0].where}: *PART has no *END PART; the file is truncated")
    opened = [card for card in rest if card.keyword == "ASSEMBLY"]
    if len(opened) > sum(card.keyword == "END ASSEMBLY" for card in rest):
        raise MeshError(f"{opened[-1].where}: *ASSEMBLY has no *END ASSEMBLY; the file is truncated")
    return parts, rest


def _in_instances(parts: dict[str, list[Card]], rest: list[Card], model: Scope) -> Iterator[tuple[Scope, Card]]:
    """Yield the cards of a model with instances: those of a part in the place of each of its instances.

    Raises
    ------
    MeshError : an instance without a name, repeated, within another, of an unknown part, or without end
    """
    scope, names = model, set()
    for card in rest:
        if card.keyword == "INSTANCE":
            name, part = card.parameters.get("NAME", ""), card.parameter("PART")
            if scope is not model or not name or name.upper() in names:
                raise MeshError(f"{card.where}: *INSTANCE {name or 'without a name'}: within another, or twice")
            if "INSTANCE" in card.parameters or (part and part not in parts):
                known = f"it has: {', '.join(cards[0].parameters.get('NAME', '') for cards in parts.values())}"
                raise MeshError(f"{card.where}: *INSTANCE {name}: there is no part {card.parameters.get('PART', '')!r}; {known}")
            names.add(name.upper())
            scope = _placed_scope(name, card)
            for of_part in parts[part][1:] if part else ():
                yield scope, of_part
        elif card.keyword == "END INSTANCE":
            scope = model
        else:
            yield scope, card
    if scope is not model:
        raise MeshError(f"*INSTANCE {scope.name} has no *END INSTANCE; the file is truncated")


def _placed_scope(name: str, card: Card) -> Scope:
    """Return the scope of an instance, with the translation and rotation of its data lines."""
    rows: list[np.ndarray] = []
    for words, where in card.lines():
        row = values_of(",".join(words).encode())
        if row is None or not np.isfinite(row).all() or len(row) != (3, 7)[min(len(rows), 1)] or len(rows) > 1:
            raise MeshError(
                f"{where}: *INSTANCE {name}: expected a line of 3 numbers, its translation, and one of 7, its rotation"
            )
        rows.append(row)
    translation = rows[0] if rows else np.zeros(3)
    if len(rows) < 2:
        return Scope(name, np.eye(3), translation)
    first, second, angle = rows[1][:3], rows[1][3:6], np.deg2rad(rows[1][6])
    turn = rotation_about(second - first, angle, f"{card.where}: *INSTANCE {name}")
    return Scope(name, turn, turn @ (translation - first) + first)


def rotation_about(axis: np.ndarray, angle: float, where: str) -> np.ndarray:
    """Return the matrix (3, 3) of a rotation [rad] about an axis (Rodrigues' formula)."""
    length = np.linalg.norm(axis)
    if not length > 0.0:
        raise MeshError(f"{where}: the two points of its axis of rotation coincide")
    x, y, z = axis / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
