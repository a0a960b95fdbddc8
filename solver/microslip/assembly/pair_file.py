"""Read contact pairs between DOFs from a CSV file.  Local; NumPy only."""

from pathlib import Path

import numpy as np

from ..contact.laws import ELASTIC_COULOMB, LAWS
from ..formats.csv_table import read_table
from ..messages.errors import CaseError

COLUMNS = ("x1", "y1", "z1", "x2", "y2", "z2", "mu", "n0", "g0", "kt", "kn")
GROUND = -1


def read_pairs(path: Path, n_dof: int, law: str = ELASTIC_COULOMB) -> np.ndarray:
    """Return the table of a pairs file, (n_pairs, 11) in the order of ``COLUMNS``, of pairs with this law.

    Local.  The file's first line names the columns, in any order; empty lines and lines that begin with # count for nothing.

    Raises
    ------
    CaseError : names the line at fault
    """
    columns, lines = read_table(path, COLUMNS, what="pair")
    table = np.column_stack([columns[name] for name in COLUMNS])
    for line, row in zip(lines, table):
        _check_pair(dict(zip(COLUMNS, row)), n_dof, f"{path}, line {line}")
        _check_law(dict(zip(COLUMNS, row)), law, f"{path}, line {line}")
    return table


def _check_pair(pair: dict[str, float], n_dof: int, where: str) -> None:
    """Raise CaseError unless the pair joins existing DOFs, by a contact that can carry a force."""
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


def _check_law(pair: dict[str, float], law: str, where: str) -> None:
    """Raise CaseError unless the pair has the required values of its law."""
    for name in LAWS[law].above_0:
        if pair[name] <= 0.0:
            raise CaseError(f'{where}: {name} = {pair[name]:g}; with law = "{law}" it must be above 0')


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
