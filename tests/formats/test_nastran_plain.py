"""Plain cards in fixed fields are read in bulk, with the same result as pyNastran."""

import numpy as np
import pytest
from plain_model import bdf, plain

pytest.importorskip("pyNastran")

from microslip.formats.nastran import read
from microslip.formats.nastran.plain import in_fixed_fields, none_plain, take_plain
from microslip.formats.read import read_model
from microslip.messages.errors import MeshError

KINDS = ("hex8", "hex20", "wedge15", "pyramid5", "tet10")


def fixed(text: str, width: int) -> str:
    """Return bulk data with its grid points and solids in fixed fields of 8 or 16 characters."""
    lines, cards = [], text.replace("\n*,", ",,,,").replace("\n,", ",").split("\n")
    for line in cards:
        word, *fields = line.split(",")
        if word == "GRID*":
            number, _, x, y, *_, z = fields
            fields = [number, "", *(_real(value, width) for value in (x, y, z))]
        elif not word.startswith(("CHEXA", "CPENTA", "CTETRA", "CPYRAM")):
            lines.append(line)
            continue
        per_line, star = 64 // width, "*" if width == 16 else ""
        rows = [fields[k : k + per_line] for k in range(0, len(fields), per_line)]
        heads = [word.rstrip("*") + star, *[star or "+"] * (len(rows) - 1)]
        lines += [head.ljust(8) + "".join(value.rjust(width) for value in row) for head, row in zip(heads, rows)]
    return "\n".join(lines)


def _real(value: str, width: int) -> str:
    """Return a number in the short form of Nastran: 2.5-2."""
    mantissa, _, exponent = value.partition("E")
    return f"{float(mantissa):.{width - 6}f}"[: width - 3] + f"{int(exponent):+d}" if width == 8 else value.replace("E", "D")


def both(path, monkeypatch):
    model = read_model(path)
    with monkeypatch.context() as patch:
        patch.setattr(read, "take_plain", none_plain)
        return model, read_model(path)


def compare(computed, expected):
    np.testing.assert_array_equal(computed.numbers, expected.numbers)
    np.testing.assert_array_equal(computed.points, expected.points)
    assert [cells.kind for cells in computed.cells] == [cells.kind for cells in expected.cells]
    for cells, other in zip(computed.cells, expected.cells):
        order = np.argsort(cells.numbers)
        np.testing.assert_array_equal(cells.numbers[order], other.numbers)
        np.testing.assert_array_equal(cells.nodes[order], other.nodes)
    assert (
        computed.bodies == expected.bodies and computed.supports == expected.supports and computed.findings == expected.findings
    )


@pytest.mark.parametrize("width", [8, 16])
@pytest.mark.parametrize("kind", KINDS)
def test_cards_in_fixed_fields_are_read_in_bulk(tmp_path, monkeypatch, kind, width):
    model, path = plain(kind), tmp_path / "model.bdf"
    path.write_text(fixed(bdf(model), width))
    taken = take_plain(path.read_bytes())
    assert len(taken.numbers) == len(model.points) and "GRID" not in taken.rest
    assert sum(len(block.numbers) for block in taken.solids) == sum(map(len, model.elements))
    assert "MAT1" in taken.rest and "SPC1" in taken.rest
    compare(*both(path, monkeypatch))


@pytest.mark.parametrize("kind", KINDS)
def test_cards_in_free_fields_are_read_in_bulk(tmp_path, monkeypatch, kind):
    text = bdf(plain(kind)).replace("\n*,", ",,,,")  # GRID*,n,,x,y with its second line
    lines = [_free(line) if line.startswith("GRID*") else line for line in text.split("\n")]
    (tmp_path / "m.bdf").write_text("\n".join(lines))
    assert len(take_plain((tmp_path / "m.bdf").read_bytes()).numbers) == len(plain(kind).points)
    compare(*both(tmp_path / "m.bdf", monkeypatch))


def _free(line: str) -> str:
    """Return a grid point in one line of free fields, from the fields that plain_model writes."""
    _, number, _, x, y, *_, z = line.split(",")
    return f"GRID, {number} ,,{float(x)!r},{float(y)!r}, {float(z)!r},\r"


@pytest.mark.parametrize(
    "card, fixed",
    [
        (b"GRID,101,,0.1,2.,.5", b"GRID         101             0.1      2.      .5"),
        (
            b"GRID,101,,0.123456789,2.,.5,7",
            b"GRID*   %16b%16b%16b%16b\n*       %16b%16b" % (b"101", b"", b"0.123456789", b"2.", b".5", b"7"),
        ),
        (
            b"CHEXA,1,2,3,4,5,6,7,8\n,9,10",
            b"CHEXA   " + b"".join(b"%8d" % n for n in range(1, 9)) + b"\n+       " + b"       9      10",
        ),
        (b"CHEXA,1,2,3,4,5,6,7,8,+A\n+A,9,10", None),
        (b"GRID,101,,0.1,2.,.5 $ here", None),
        (b"GRID,101,,0.12345678901234567,2.,.5", None),
        (b"SET 1 = 1,2,3,\n4,5", None),
    ],
)
def test_cards_are_converted_to_fixed_fields_where_they_fit(card, fixed):
    assert in_fixed_fields(b"BEGIN BULK\n" + card + b"\nENDDATA") == b"BEGIN BULK\n" + (fixed or card) + b"\nENDDATA"


def test_cards_with_further_fields_are_left_to_pynastran(tmp_path, monkeypatch):
    lines, path = fixed(bdf(plain("wedge15")), 8).replace("\n", "\r\n").split("\n"), tmp_path / "model.bdf"
    grid = next(i for i, line in enumerate(lines) if line.startswith("GRID"))
    lines[grid] = lines[grid].rstrip("\r").ljust(48) + "       7"  # rotated axes of its displacements
    lines[grid + 1] = lines[grid + 1].rstrip("\r").ljust(56) + "     123"  # supported
    lines[grid + 2] = "GRID," + ",".join(lines[grid + 2][k : k + 8].strip() for k in range(8, 48, 8))
    wedge = next(i for i, line in enumerate(lines) if line.startswith("CPENTA"))
    lines[wedge + 1 : wedge + 1] = ["$ a remark between its lines", ""]
    lines[wedge - 1 : wedge - 1] = ["CORD2R,7,,0.,0.,0.,0.,0.,1.", ",0.,1.,0."]
    path.write_text("\n".join(lines))
    taken = take_plain(path.read_bytes())
    assert taken.rest.count("GRID") == 2 and "CPENTA" not in taken.rest
    compare(*both(path, monkeypatch))


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda line: line[:8] + "     1x1" + line[16:], "cannot be read as Nastran bulk data"),
        (lambda line: line[:24] + "  1.2.3 " + line[32:], "cannot be read as Nastran bulk data"),
        (lambda line: line[:24] + "       1" + line[32:], "cannot be read as Nastran bulk data"),
        (lambda line: line + "\n" + line[:24] + "    9.99" + line[32:], "cannot be read as Nastran bulk data"),
        (lambda line: line[:8] + "   99999" + line[16:], "names grid point"),
    ],
)
def test_damaged_cards_in_fixed_fields_are_refused(tmp_path, change, message):
    lines, path = fixed(bdf(plain()), 8).split("\n"), tmp_path / "model.bdf"
    i = next(i for i, line in enumerate(lines) if line.startswith("GRID"))
    lines[i] = change(lines[i])
    path.write_text("\n".join(lines))
    with pytest.raises(MeshError, match=f"model.bdf: .*{message}"):
        read_model(path)


@pytest.mark.parametrize("more", ["GRDSET,,,,,,,123", "CORD1R,7,101,102,103"])
def test_cards_that_change_the_meaning_of_grid_points_leave_all_to_pynastran(more):
    assert len(take_plain(fixed(bdf(plain(), (more,)), 8).encode()).numbers) == 0
