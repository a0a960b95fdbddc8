"""Plain grid points and solids of bulk data, nearly all lines of a large file, read in blocks.

A card is plain if it is in fixed fields of 8 or 16 characters, or in free fields that fit into these, is in the axes of the
model and has only its numbers.  The lines of plain cards are removed from the text; pyNastran reads the remaining cards.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

_SOLIDS = {b"CTETRA": (4, 10), b"CPENTA": (6, 15), b"CHEXA": (8, 20), b"CPYRAM": (5, 13)}
_WIDTH = 72  # characters of a line without its continuation mark
_LONGEST = 6  # lines of a plain card
_CARD = re.compile(rb"(GRID|CTETRA|CPENTA|CHEXA|CPYRAM)(\*?) *")
_FREE_CARD = re.compile(rb"^(GRID|CTETRA|CPENTA|CHEXA|CPYRAM) *,([^\n$]*)((?:\n[+ ]?,[^\n$]*)*)$", re.MULTILINE)
_PER_LINE, _NARROW, _WIDE = 8, 8, 16  # fields of a line after the name, and their widths
# with one of these words, grid points have defaults, or the file has further models
_WITH_DEFAULTS = (b"GRDSET", b"CORD1", b"SUPER")
_AT_A_TIME = 100_000  # cards per block


@dataclass(frozen=True)
class Solids:
    """Plain solids of one kind of card and one number of nodes."""

    card: str  # CHEXA, ...
    numbers: np.ndarray  # (n,)
    properties: np.ndarray  # (n,)
    nodes: np.ndarray  # (n, n_nodes) numbers of grid points, in Nastran's order


@dataclass(frozen=True)
class Plain:
    """The plain cards of a file, and the text without them."""

    rest: str
    numbers: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (n,) numbers of grid points
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3)
    solids: tuple[Solids, ...] = ()

    @property
    def elements(self) -> np.ndarray:
        """Numbers of all solids."""
        return np.concatenate([np.zeros(0, dtype=np.int64), *(block.numbers for block in self.solids)])

    def meets(self, grid_points: Iterable[int], elements: Iterable[int]) -> bool:
        """Return whether the plain cards also have one of these numbers."""
        return bool(np.isin(self.numbers, list(grid_points)).any() or np.isin(self.elements, list(elements)).any())


def none_plain(text: bytes) -> Plain:
    """Return the whole text, for pyNastran.  Local."""
    return Plain(text.decode("utf-8", errors="replace"))


def take_plain(text: bytes) -> Plain:
    """Return the plain cards of bulk data.  Local."""
    upper = text.upper()
    if any(word in upper for word in _WITH_DEFAULTS):
        return none_plain(text)
    original, text = text, in_fixed_fields(text)
    upper = text.upper() if text is not original else upper
    stop = upper.find(b"\nENDDATA")
    start, end = _lines(text if stop < 0 else text[:stop])
    characters = np.frombuffer(text + b" " * _WIDTH, dtype=np.uint8)
    is_taken, parts = np.zeros(len(start), dtype=bool), dict[tuple[bytes, int], list[np.ndarray]]()
    for word, lines, values in _plain_cards(characters, start, end):
        is_taken[lines.ravel()] = True
        parts.setdefault((word, values.shape[1]), []).append(values)
    rows = {key: np.concatenate(blocks) for key, blocks in parts.items()}
    grid = rows.pop((b"GRID", 4), np.zeros((0, 4)))
    plain = Plain(
        rest=_other_cards(text, start, end, is_taken).decode("utf-8", errors="replace"),
        numbers=grid[:, 0].astype(np.int64),
        points=grid[:, 1:],
        solids=tuple(
            Solids(word.decode(), blocks[:, 0], blocks[:, 1], blocks[:, 2:]) for (word, _), blocks in rows.items() if len(blocks)
        ),
    )
    is_twice = any(len(np.unique(numbers)) < len(numbers) for numbers in (plain.numbers, plain.elements))
    return none_plain(original) if is_twice else plain  # pyNastran reports the repeated number


def _plain_cards(characters: np.ndarray, start: np.ndarray, end: np.ndarray) -> Iterator[tuple[bytes, np.ndarray, np.ndarray]]:
    """Yield plain cards: name, their lines (n, n_lines), their numbers (n, n_numbers)."""
    for word, width, lines in _alike(characters, start, end):
        for part in np.array_split(lines, len(lines) // _AT_A_TIME + 1):
            fields = _fields(characters, start[part], end[part], width)
            try:
                is_plain, values = _grid_points(fields) if word == b"GRID" else _nodes(fields, _SOLIDS[word])
            except ValueError:  # pyNastran reports the fault
                continue
            yield word, part[is_plain], values


def _lines(text: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return the begin and the end of every line."""
    breaks = np.flatnonzero(np.frombuffer(text, dtype=np.uint8) == ord("\n"))
    return np.concatenate([[0], breaks + 1]), np.concatenate([breaks, [len(text)]])


def _alike(characters: np.ndarray, start: np.ndarray, end: np.ndarray) -> Iterator[tuple[bytes, int, np.ndarray]]:
    """Yield cards of one name, width of fields and number of lines: name, width, lines (n, n_lines)."""
    heads = _first(characters, start, end, 8)
    is_written = (heads[:, 0] != ord("$")) & ((heads != ord(" ")).any(axis=1) | (end - start > 8))
    written = np.flatnonzero(is_written)
    is_more = np.isin(heads[written, 0], list(b" +*"))
    first = np.flatnonzero(~is_more)
    n_lines = np.diff(np.concatenate([first, [len(written)]]))
    words = heads[written[first]].view("S8").ravel()
    for word in np.unique(words):
        name = _CARD.fullmatch(word)
        if not name:
            continue
        for n in range(1, _LONGEST + 1):
            heads_of_cards = first[(words == word) & (n_lines == n)]
            lines = written[heads_of_cards[:, None] + np.arange(n)]
            mark = np.isin(heads[lines[:, 1:], 0], list(b"*" if name[2] else b" +")).all(axis=1)
            if mark.any():
                yield name[1], 16 if name[2] else 8, lines[mark]


def _first(characters: np.ndarray, start: np.ndarray, end: np.ndarray, width: int) -> np.ndarray:
    """Return the first characters of some lines, (n, width), padded with blanks."""
    text = sliding_window_view(characters, width)[start]
    text[(np.arange(width) >= (end - start)[:, None]) | (text == ord("\r"))] = ord(" ")
    return text


def _fields(characters: np.ndarray, start: np.ndarray, end: np.ndarray, width: int) -> np.ndarray:
    """Return the fields of cards after their names, (n_cards, n_fields, width) characters."""
    lines = _first(characters, start.ravel(), end.ravel(), _WIDTH)[:, 8:]
    return lines.reshape(len(start), -1, width)


def _grid_points(fields: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which cards are plain grid points, and their number and coordinates (n, 4).

    Raises
    ------
    ValueError : a field that looks like a number is not a number
    """
    if fields.shape[1] != 8:  # ID, CP, three coordinates, CD, PS, SEID
        return np.zeros(len(fields), dtype=bool), np.zeros((0, 4))
    is_plain = _are_whole(fields[:, [0]]) & _are_real(fields[:, 2:5]) & _are_blank(fields[:, [1, 5, 6, 7]])
    chosen = fields[is_plain]
    return is_plain, np.column_stack([_text(chosen[:, 0]).astype(np.int64), _decimals(chosen[:, 2:5])])


def _nodes(fields: np.ndarray, counts: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return which cards are plain solids, and their number, property and nodes (n, 2 + n_nodes).

    Raises
    ------
    ValueError : a field that looks like a number is not a number
    """
    for n in counts:
        stated, unstated = fields[:, : 2 + n], fields[:, 2 + n :]
        is_plain = _are_whole(stated) & _are_blank(unstated)
        if stated.shape[1] == 2 + n and is_plain.any():
            return is_plain, _text(stated[is_plain]).astype(np.int64)
    return np.zeros(len(fields), dtype=bool), np.zeros((0, 2), dtype=np.int64)


def _are_blank(fields: np.ndarray) -> np.ndarray:
    return (fields == ord(" ")).all(axis=(1, 2))


def _are_whole(fields: np.ndarray) -> np.ndarray:
    """Return for each card whether its fields (n, n_fields, width) consist of digits."""
    return _made_of(fields, b"0123456789")


def _are_real(fields: np.ndarray) -> np.ndarray:
    """Return for each card whether its fields consist of the characters of a decimal number."""
    return _made_of(fields, b"0123456789+-.EeDd") & ((fields == ord(".")).sum(axis=2) == 1).all(axis=1)


def _made_of(fields: np.ndarray, characters: bytes) -> np.ndarray:
    is_known = np.zeros(256, dtype=bool)
    is_known[list(characters + b" ")] = True
    return is_known[fields].all(axis=(1, 2)) & (fields != ord(" ")).any(axis=2).all(axis=1)


def _decimals(fields: np.ndarray) -> np.ndarray:
    """Return numbers (n, 3) from their characters (n, 3, width)."""
    try:
        return _text(fields).astype(float)
    except ValueError:
        return _text(_with_letter(fields)).astype(float)


def _with_letter(fields: np.ndarray) -> np.ndarray:
    """Return numbers with the letter E before their exponents, (n, 3, width + 1); Nastran omits it or writes D."""
    letters = np.where(np.isin(fields, list(b"eDd")), np.uint8(ord("E")), fields)
    letters = np.pad(letters, ((0, 0), (0, 0), (0, 1)), constant_values=ord(" "))
    lacks = np.isin(letters, list(b"+-"))
    lacks[..., 1:] &= ~np.isin(letters[..., :-1], list(b" E"))
    lacks[..., 0] = False
    at = np.where(lacks.any(axis=2), lacks.argmax(axis=2), letters.shape[2])[..., None]
    place = np.arange(letters.shape[2])
    moved = np.take_along_axis(letters, np.maximum(place - (place > at), 0), axis=2)
    return np.where(place == at, np.uint8(ord("E")), moved)


def _text(fields: np.ndarray) -> np.ndarray:
    """Return fields as strings of bytes, without their axis of characters."""
    return np.ascontiguousarray(fields).view(f"S{fields.shape[-1]}")[..., 0]


def _other_cards(text: bytes, start: np.ndarray, end: np.ndarray, is_taken: np.ndarray) -> bytes:
    """Return the lines that are not taken."""
    bounds = np.concatenate([start, end[-1:] + 1])
    change = np.flatnonzero(np.diff(np.concatenate([[True], is_taken, [True]]).astype(np.int8)))
    parts = [text[bounds[first] : bounds[last]] for first, last in zip(change[::2], change[1::2], strict=True)]
    return b"".join([*parts, text[bounds[-1] :]])


def in_fixed_fields(text: bytes) -> bytes:
    """Return bulk data with grid points and solids in free fields converted to fixed fields.  Local.

    A card with a number or a continuation mark that does not fit remains unchanged.
    """
    return _FREE_CARD.sub(_in_fixed, text) if b"," in text else text


def _in_fixed(card: re.Match[bytes]) -> bytes:
    """Return one card in fields of 8 characters, a grid point in fields of 16."""
    lines = [card[2].split(b","), *(line.partition(b",")[2].split(b",") for line in card[3].split(b"\n")[1:])]
    lines = [[field.strip() for field in line] for line in lines]
    if any(len(line) > _PER_LINE for line in lines):
        return card[0]
    longest = max(len(field) for line in lines for field in line)
    if longest <= _NARROW:
        rows = [b"".join(field.rjust(_NARROW) for field in line) for line in lines]
        return b"\n+       ".join([card[1].ljust(8) + rows[0], *rows[1:]])
    if card[1] != b"GRID" or longest > _WIDE or len(lines) > 1:
        return card[0]
    rows = [b"".join(field.rjust(_WIDE) for field in lines[0][k : k + 4]) for k in (0, 4)]
    return b"GRID*   " + rows[0] + b"\n*       " + rows[1]
