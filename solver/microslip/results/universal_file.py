"""Universal files (UNV) for test engineers: nodes, elements, mode shapes and response functions.

Data sets 164 (units), 2411 (nodes), 2412 (elements), 55 (shapes) and 58 (functions), as text in fixed columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from ..mesh.data import Mesh
from ..system.files import atomic_write
from .fields import Fields
from .measures import segments
from .record import ResultFile

# Type of the element, and its nodes in the order of UNV: around the bottom with the mid-side nodes, mid-sides of the vertical
# edges, around the top.  UNV has no pyramids: they are written as bricks whose top nodes coincide.
ELEMENTS = {
    "tet4": (111, (0, 1, 2, 3)),
    "wedge6": (112, (0, 1, 2, 3, 4, 5)),
    "hex8": (115, (0, 1, 2, 3, 4, 5, 6, 7)),
    "tet10": (118, (0, 4, 1, 5, 2, 6, 7, 8, 9, 3)),
    "wedge15": (113, (0, 6, 1, 7, 2, 8, 12, 13, 14, 3, 9, 4, 10, 5, 11)),
    "pyramid5": (115, (0, 1, 2, 3, 4, 4, 4, 4)),
    "pyramid13": (116, (0, 5, 1, 6, 2, 7, 3, 8, 9, 10, 11, 12, *[4] * 8)),
    "hex20": (116, (0, 8, 1, 9, 2, 10, 3, 11, 16, 17, 18, 19, 4, 12, 5, 13, 6, 14, 7, 15)),
}
_DISPLACEMENT, _FORCE, _FREQUENCY = 8, 13, 18  # specific data types
_OF_UNIT = {"m": 8, "m/s": 11, "m/s2": 12, "N": 9, "Pa": 2, "1": 3}  # 0, unknown, for the others
_OF_LEVEL = {"N": _FORCE, "m/s2": 12}


def write_unv(path: Path, results: ResultFile, fields: Fields | None) -> Path:
    """Write modes and motions at the peaks, where there is a mesh, and all response functions; return the path.  Local.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    with atomic_write(str(path)) as temporary, open(temporary, "w", encoding="ascii", errors="replace") as file:
        for number, lines in _data_sets(results, fields):
            file.write(f"    -1\n{number:6d}\n")
            file.writelines(line + "\n" for line in lines)
            file.write("    -1\n")
    return path


def _data_sets(results: ResultFile, fields: Fields | None) -> Iterator[tuple[int, Iterable[str]]]:
    """Yield number and lines of every data set."""
    yield 164, _units()
    if fields is not None:
        yield 2411, _nodes(fields.mesh)
        yield 2412, _elements(fields.mesh)
        for i, (frequency, shape) in enumerate(zip(results.mode_frequency, fields.shapes), 1):
            yield 55, _shape(results, fields.mesh, f"mode {i}, all pairs stuck", (2, 4, 0, i), (frequency, 1.0, 0.0, 0.0), shape)
        for number, motion in fields.peaks.items():
            level = results.levels[number]
            first = motion.u[:, :, 1] - 1j * motion.u[:, :, 2]
            heading = f"harmonic 1 at the peak, level {level.text}"
            yield (
                55,
                _shape(
                    results, fields.mesh, heading, (2, 1, number + 1, motion.point + 1), (level.frequency[motion.point],), first
                ),
            )
    for number, level in enumerate(results.levels):
        for k in range(len(results.outputs)):
            for part in segments(level.segment) if len(level.frequency) else ():
                yield 58, _function(results, fields, number, k, part)


def _units() -> list[str]:
    return [f"{1:10d}{'SI: Metre (newton)':<20}{2:10d}", "".join(_double(1.0) for _ in range(3)), _double(273.15)]


def _nodes(mesh: Mesh) -> Iterator[str]:
    for number, point in zip(mesh.numbers, mesh.points):
        yield f"{number:10d}{1:10d}{1:10d}{11:10d}"
        yield "".join(map(_double, point))


def _elements(mesh: Mesh) -> Iterator[str]:
    for i, block in enumerate(mesh.elements, 1):
        kind, order = ELEMENTS[block.kind]
        for number, nodes in zip(block.numbers, mesh.numbers[block.nodes[:, list(order)]]):
            yield f"{number:10d}{kind:10d}{i:10d}{i:10d}{7:10d}{len(nodes):10d}"
            yield from _rows([f"{node:10d}" for node in nodes], 8)


def _shape(
    results: ResultFile, mesh: Mesh, heading: str, integers: tuple[int, ...], real: tuple[float, ...], u: np.ndarray
) -> Iterator[str]:
    """Yield a vector at every node: real of a mode, complex of a response.

    ``integers`` starts with the numbers of its further values and of the values in ``real``.
    """
    analysis, kind = (5, 5) if np.iscomplexobj(u) else (2, 2)
    yield from (_line(text) for text in (results.title, heading, "microslip", "", ""))
    yield "".join(f"{value:10d}" for value in (1, analysis, 2, _DISPLACEMENT, kind, 3))
    yield "".join(f"{value:10d}" for value in integers)
    yield "".join(map(_single, real))
    numbers = u.view(u.real.dtype).reshape(len(u), -1) if np.iscomplexobj(u) else u
    for node, values in zip(mesh.numbers, numbers):
        yield f"{node:10d}"
        yield "".join(map(_single, values))


def _function(results: ResultFile, fields: Fields | None, number: int, k: int, part: slice) -> Iterator[str]:
    """Yield the response of output k per unit of the level: complex, in double precision, at uneven frequencies."""
    level, name = results.levels[number], results.outputs[k]
    frequency = level.frequency[part]
    H = (level.response[part, k, 1] - 1j * level.response[part, k, 2]) / (level.level or 1.0)
    node, direction = _place(fields, k)
    unit = results.unit_of(k)
    yield from (_line(text) for text in (f"{name}, level {level.text}", results.title, "", "microslip, harmonic 1", "NONE"))
    yield f"{4:5d}{number + 1:10d}{0:5d}{number + 1:10d} {_line(name, 10):<10}{node:10d}{direction:4d} {'NONE':<10}{0:10d}{0:4d}"
    yield f"{6:10d}{len(H):10d}{0:10d}{_single(frequency[0])}{_single(0.0)}{_single(level.level)}"
    yield _axis(_FREQUENCY, "frequency", "Hz")
    yield _axis(_OF_UNIT.get(unit, 0), "response", unit)
    of_level = _axis(_OF_LEVEL.get(results.level_unit, 0), "level", results.level_unit)
    yield from (of_level, of_level)  # of the denominator, of the Z axis, whose value is the level
    for f, value in zip(frequency, H):
        yield f"{_digits(f)}{value.real:20.12E}{value.imag:20.12E}"


def _place(fields: Fields | None, k: int) -> tuple[int, int]:
    """Return node and direction of an output: 1, 2, 3 for x, y, z, below 0 against them; 0 for none, and for one between them."""
    if fields is None or fields.output_node[k] < 0:
        return 0, 0
    along = fields.output_direction[k]
    axes = np.flatnonzero(along)
    return fields.output_node[k], int(np.sign(along[axes[0]]) * (axes[0] + 1)) if len(axes) == 1 else 0


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:<20} {unit:<20}"


def _line(text: str, most: int = 80) -> str:
    """Return a text on one line of a record; ``NONE`` where there is none."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:most] or "NONE"


def _rows(items: list[str], n: int) -> list[str]:
    return ["".join(items[i : i + n]) for i in range(0, len(items), n)]


def _single(value: float) -> str:
    return f"{value:13.5E}"


def _double(value: float) -> str:
    return f"{value:25.16E}".replace("E", "D")


def _digits(value: float) -> str:
    """Return a frequency in 13 columns with as many digits as they hold: six, as in the format, do not resolve a sharp peak."""
    return next(text for digits in range(12, 4, -1) if len(text := f"{value:.{digits}g}") < 13).rjust(13)
