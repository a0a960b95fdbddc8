"""Grid points and solids in free fields, "GRID,101,,0.1,0.2,0.3", converted to fixed fields, which are read in blocks."""

from __future__ import annotations

import re

_PER_LINE, _NARROW, _WIDE = 8, 8, 16  # fields of a line after the name, and their widths
_CARD = re.compile(rb"^(GRID|CTETRA|CPENTA|CHEXA|CPYRAM) *,([^\n$]*)((?:\n[+ ]?,[^\n$]*)*)$", re.MULTILINE)


def in_fixed_fields(text: bytes) -> bytes:
    """Return bulk data with grid points and solids in free fields converted to fixed fields.  Local.

    A card with a number or a continuation mark that does not fit remains unchanged.
    """
    return _CARD.sub(_fixed, text) if b"," in text else text


def _fixed(card: re.Match[bytes]) -> bytes:
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
