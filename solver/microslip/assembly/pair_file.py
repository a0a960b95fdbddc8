"""Read contact pairs between DOFs from a CSV file.  Local; NumPy only."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ..parallel.errors import CaseError
from ..parallel.words import nearest

COLUMNS = ("x1", "y1", "z1", "x2", "y2", "z2", "mu", "n0", "g0", "kt", "kn")
GROUND = -1


def read_pairs(path: Path, n_dof: int) -> np.ndarray:
    """Return the table of a pairs file, (n_pairs, 11) in the order of ``COLUMNS``.

    Local.  The file's first line names the columns, in any order; empty lines and lines that begin with # count for nothing.

    Raises
    ------
    CaseError : names the line at fault
    """
    numbered = _rows(path)
    if not numbered:
        raise CaseError(f"{path}: the file is empty; its first line names the columns {','.join(COLUMNS)}")
    (line, header), *rest = numbered
    order = _order([cell.lower() for cell in header], f"{path}, line {line}")
    if not rest:
        raise CaseError(f"{path}: there is no pair after the header")
    table = [_numbers(row, order, f"{path}, line {line}") for line, row in rest]
    for (line, _), row in zip(rest, table):
        _check_pair(dict(zip(COLUMNS, row)), n_dof, f"{path}, line {line}")
    return np.array(table)


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return the lines that say something, with their numbers from 1."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (UnicodeDecodeError, csv.Error) as problem:
        raise CaseError(f"{path}: not a text file of comma-separated values: {problem}") from None
    except OSError as problem:
        raise CaseError(f"{path}: {problem.strerror}") from None
    return [(line, row) for line, row in rows if any(row) and not row[0].startswith("#")]


def _order(header: list[str], where: str) -> list[int]:
    """Return where each of ``COLUMNS`` stands in the header."""
    faults = [f"{name} is missing" for name in COLUMNS if name not in header]
    faults += [f"{name} stands there twice" for name in COLUMNS if header.count(name) > 1]
    for name in header:
        if name not in COLUMNS:
            near = nearest(name, COLUMNS)
            faults.append(f'"{name[:20]}" is unknown' + (f', nearest is "{near}"' if near else ""))
    if ";" in header[0]:
        faults = ["values are separated by semicolons, not by commas"]
    if faults:
        raise CaseError(f"{where}: the header must name the columns {','.join(COLUMNS)}: {'; '.join(faults[:3])}")
    return [header.index(name) for name in COLUMNS]


def _numbers(row: list[str], order: list[int], where: str) -> list[float]:
    if len(row) != len(COLUMNS):
        raise CaseError(f"{where}: {len(row)} values; {len(COLUMNS)} are needed: {','.join(COLUMNS)}")
    values = []
    for name, i in zip(COLUMNS, order):
        try:
            values.append(float(row[i]))
        except ValueError:
            raise CaseError(f'{where}: {name} = "{row[i][:20]}" is not a number') from None
        if not np.isfinite(values[-1]):
            raise CaseError(f"{where}: {name} = {row[i]} is not a finite number")
    return values


def _check_pair(pair: dict[str, float], n_dof: int, where: str) -> None:
    """Raise CaseError unless the pair joins DOFs that are there, by a contact that can carry something."""
    for name in COLUMNS[:6]:
        dof = pair[name]
        if dof != int(dof) or not GROUND <= dof < n_dof:
            raise CaseError(f"{where}: {name} = {dof:g} is not a DOF number; they go from 0 to {n_dof - 1}, and -1 is ground")
    for axis in "xyz":
        if pair[f"{axis}1"] == pair[f"{axis}2"] != GROUND:
            raise CaseError(f"{where}: {axis}1 and {axis}2 are both DOF {pair[f'{axis}1']:g}; the pair would join it to itself")
    if all(pair[name] == GROUND for name in COLUMNS[:6]):
        raise CaseError(f"{where}: all six DOFs are -1; the pair joins ground to ground")
    for name in ("mu", "g0", "kt", "kn"):
        if pair[name] < 0.0:
            raise CaseError(f"{where}: {name} = {pair[name]:g} must not be negative")
    _check_normal(pair, where)


def _check_normal(pair: dict[str, float], where: str) -> None:
    n0, g0 = pair["n0"], pair["g0"]
    if g0 > 0.0 and n0 != 0.0:
        raise CaseError(f"{where}: n0 = {n0:g} with g0 = {g0:g}: an open pair carries no preload; set one of them to 0")
    if g0 > 0.0 and pair["kn"] == 0.0:
        raise CaseError(f"{where}: a gap g0 = {g0:g} that closes on kn = 0; kn must be above 0")
    if pair["z1"] == pair["z2"] == GROUND and (g0 > 0.0 or n0 <= 0.0):
        raise CaseError(
            f"{where}: z1 and z2 are ground, so that the normal force stays at n0 = {n0:g} N: the pair never "
            "touches; n0 must be above 0"
        )
