"""*NODE, *ELEMENT and their coordinate systems: numbers, coordinates and connectivity of one scope."""

from dataclasses import dataclass

import numpy as np

from ...messages.errors import MeshError
from ...messages.words import counted
from ..model import KINDS
from .cards import Card, values_of
from .types import is_solid, kind_of

_DAMAGED = "; the file is damaged or truncated"
_NODES_OF = {"MASS": 1, "ROTARYI": 1, "SPRING1": 1, "SPRING2": 2, "SPRINGA": 2, "DASHPOT1": 1, "DASHPOT2": 2, "DASHPOTA": 2}


@dataclass(frozen=True, eq=False)
class Elements:
    """The elements of one *ELEMENT card."""

    word: str  # TYPE
    kind: str | None  # kind of their cells
    numbers: np.ndarray  # (n,) element numbers of the file
    nodes: np.ndarray  # (n, n_nodes) node numbers of the file, padded with 0
    where: str
    named: tuple[tuple[int, int, str], ...] = ()  # row, column and word of nodes stated as "instance.number"


def read_nodes(card: Card) -> tuple[np.ndarray, np.ndarray, int]:
    """Return numbers (n,) and coordinates (n, 3) of a *NODE card in the axes of its *SYSTEM, and how many lines are short.

    Missing coordinates are 0, as in CalculiX; a line is short if others of its card have more coordinates.

    Raises
    ------
    MeshError : a line without a number, or with a number alone
    """
    values, counts = card.numbers()
    n_short = 0
    width = int(counts[0]) if len(counts) else 4
    if width < 4 or not (counts == width).all():
        table, n_short = _with_empty_fields(card)
    else:
        table = values.reshape(len(counts), width)[:, :4]
    numbers = table[:, 0]
    if not ((numbers >= 0) & (numbers <= 2**53) & (numbers == np.rint(numbers))).all():
        raise MeshError(f"{card.where}: *NODE: a node number is not a whole number{_DAMAGED}")
    return numbers.astype(np.int64), _cartesian(table[:, 1:], card), n_short


def _with_empty_fields(card: Card) -> tuple[np.ndarray, int]:
    """Return (n, 4) numbers of lines, with 0 for empty and missing fields, and how many lines have fewer fields than others."""
    rows, widths = [], []
    for words, where in card.lines():
        if len(words) < 2 or not words[0]:
            raise MeshError(f"{where}: *NODE: every line must hold a number and coordinates{_DAMAGED}")
        rows.append([float(word.replace("D", "E").replace("d", "e")) if word else 0.0 for word in (*words, "", "")[:4]])
        widths.append(min(len(words), 4))
    return np.array(rows).reshape(-1, 4), sum(width < max(widths) for width in widths)


def _cartesian(points: np.ndarray, card: Card) -> np.ndarray:
    """Return points, given in cylindrical or spherical coordinates, in Cartesian ones."""
    system = card.parameter("SYSTEM", "R")
    if system == "R":
        return points
    if system not in ("C", "S"):
        raise MeshError(f"{card.where}: *NODE, SYSTEM={system}: expected R, C or S")
    radius, angle, third = points[:, 0], np.deg2rad(points[:, 1]), points[:, 2]
    if system == "S":
        radius, third = radius * np.cos(np.deg2rad(third)), radius * np.sin(np.deg2rad(third))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), third])


def system_of(card: Card) -> tuple[np.ndarray, np.ndarray]:
    """Return axes (3, 3), rows x', y', z', and origin (3,) of a *SYSTEM card; the global system without data.

    Raises
    ------
    MeshError : points that do not define axes
    """
    rows = [values_of(",".join(words).encode()) for words, _ in card.lines()]
    values = np.concatenate([np.zeros(0), *(np.zeros(1) if row is None else row for row in rows)])
    if len(values) not in (0, 3, 6, 9) or not np.isfinite(values).all():
        raise MeshError(f"{card.where}: *SYSTEM: expected one, two or three points of three coordinates")
    points = values.reshape(-1, 3)
    if len(points) < 2:
        return np.eye(3), points[0] if len(points) else np.zeros(3)
    x = points[1] - points[0]
    if len(points) == 2:
        return axes_of(x, np.cross([0.0, 0.0, 1.0], x), card.where), points[0]
    return axes_of(x, points[2] - points[0], card.where), points[0]


def axes_of(x: np.ndarray, in_plane: np.ndarray, where: str) -> np.ndarray:
    """Return axes (3, 3), rows x', y', z': x' along ``x``, y' in the plane with ``in_plane``."""
    z = np.cross(x, in_plane)
    if not np.linalg.norm(z) > 1e-12 * np.linalg.norm(x) * np.linalg.norm(in_plane):
        raise MeshError(f"{where}: the points of its axes lie on one line")
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def read_elements(card: Card) -> Elements:
    """Return the elements of an *ELEMENT card.

    An element takes lines until it has all nodes; extra numbers on its last line are ignored, as in CalculiX. If an earlier line
    does not end in a comma, nodes are missing, and the last line belongs to another element. Elements of types with an unknown
    number of nodes take one line, and the next one after a trailing comma.

    Raises
    ------
    MeshError : nodes are missing, or an entry is not a whole number
    """
    word = card.parameter("TYPE")
    kind = kind_of(word)
    if is_solid(word) and kind not in KINDS:
        raise MeshError(f"{card.where}: *ELEMENT, TYPE={word} is not read; known solids: C3D4, C3D6, C3D8, C3D10, C3D15, C3D20")
    n_nodes = KINDS[kind][1] if kind else _NODES_OF.get(word, 0)
    if word in _NODES_OF and any(b"." in piece.text for piece in card.pieces):
        return _with_names(card, word, n_nodes)
    rows = _rows(card, word, n_nodes) if n_nodes else _unknown_rows(card)
    if kind == "line2" and word.startswith("B"):
        rows = rows[:, :3]  # the third node of a beam states its direction
    return Elements(word, kind, rows[:, 0], rows[:, 1:], card.where)


def _rows(card: Card, word: str, n_nodes: int) -> np.ndarray:
    """Return (n, 1 + n_nodes): numbers of elements and of their nodes."""
    values, counts = card.numbers()
    width = 1 + n_nodes
    if not np.isfinite(values).all() or (abs(values) > 2**53).any():
        raise MeshError(f"{card.where}: *ELEMENT, TYPE={word} holds entries that are not whole numbers{_DAMAGED}")
    if (counts == width).all():
        return values.astype(np.int64).reshape(-1, width)
    begins = np.cumsum(counts) - counts  # begins of lines, in values
    first, last = _lines_of(counts, width).T
    starts, what = begins[first], f"{card.where}: *ELEMENT, TYPE={word}"
    lengths = begins[last] + counts[last] - starts
    beyond = np.flatnonzero((lengths > width) & (last > first))
    continues = card.continues() if len(beyond) else np.zeros(0, dtype=bool)
    for i in beyond:
        ends_in_comma = continues[first[i] : last[i]]
        if not ends_in_comma.all():
            n = begins[first[i] + np.argmin(ends_in_comma) + 1] - starts[i] - 1
            raise MeshError(f"{what}: element {values[starts[i]]:.0f} has {n} nodes, and {n_nodes} are expected{_DAMAGED}")
    if len(lengths) and lengths[-1] < width:
        raise MeshError(
            f"{what}: the {len(values)} numbers do not make elements of a number and {n_nodes} nodes: the last has "
            f"{lengths[-1] - 1} nodes{_DAMAGED}"
        )
    return values.astype(np.int64)[starts[:, None] + np.arange(width)]


def _lines_of(counts: np.ndarray, width: int) -> np.ndarray:
    """Return the first and last line (n, 2) of each element, which takes lines up to ``width`` numbers."""
    lines, first, n_read = [], 0, 0
    for i, count in enumerate(counts.tolist()):
        n_read += count
        if n_read >= width or i + 1 == len(counts):
            lines.append((first, i))
            first, n_read = i + 1, 0
    return np.array(lines, dtype=np.int64).reshape(-1, 2)


def _with_names(card: Card, word: str, n_nodes: int) -> Elements:
    """Return masses and springs of the assembly, with nodes of instances: "bolt-1.17"."""
    rows: list[list[int]] = []
    named: list[tuple[int, int, str]] = []
    for words, where in card.lines():
        words = words[:-1] if not words[-1] else words
        if len(words) != 1 + n_nodes or not words[0].isdigit():
            raise MeshError(f"{where}: *ELEMENT, TYPE={word}: expected a number and {counted(n_nodes, 'node')}{_DAMAGED}")
        named += [(len(rows), i, node) for i, node in enumerate(words[1:]) if not node.isdigit()]
        rows.append([int(node) if node.isdigit() else 0 for node in words])
    table = np.array(rows, dtype=np.int64).reshape(-1, 1 + n_nodes)
    return Elements(word, None, table[:, 0], table[:, 1:], card.where, tuple(named))


def _unknown_rows(card: Card) -> np.ndarray:
    """Return (n, 1 + most nodes) numbers of elements of an unknown type, padded with 0."""
    rows: list[list[int]] = []
    continues = False
    for words, where in card.lines():
        if not continues:
            rows.append([])
        if not all(word.isdigit() for word in words if word):
            raise MeshError(f"{where}: *ELEMENT holds {','.join(words)[:60]!r} where numbers are expected")
        rows[-1] += [int(word) for word in words if word]
        continues = not words[-1]
    width = max((len(row) for row in rows), default=1)
    return np.array([row + [0] * (width - len(row)) for row in rows], dtype=np.int64).reshape(-1, width)
