"""Nastran's DMIG entries, of bulk data or a punch file: matrices by grid points and components, read by pyNastran."""

import re

import numpy as np

from ...messages.errors import CaseError, MeshError
from ..nastran.read import cards_of
from .file_matrix import LARGEST, DofMap, FileMatrix, Wanted, from_coordinates

_ENTRY = re.compile(r"^DMIG[ *,](?!\s*UACCEL\b).*\n(?:(?:[+* ].*|,.*|[ \t]*)\n)*", re.MULTILINE | re.IGNORECASE)


def read_dmig(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file, or the wanted one of several, with grid point and component of each row.  Local.

    Raises
    ------
    CaseError : the file is faulty, or pyNastran is missing
    """
    text = wanted.path.read_text(encoding="latin-1")
    entries = _ENTRY.findall(f"{text}\n")
    if not entries:
        raise CaseError(f"{wanted.where} holds no DMIG entries")
    if not text.endswith("\n"):
        last = text[text.rfind("\n") + 1 :][:60].strip()
        raise wanted.error(f"its last line, '{last}', does not end; the file is truncated")
    try:
        matrices = cards_of("".join(entries)).dmig
    except MeshError as problem:
        raise wanted.error(str(problem)) from None
    name = wanted.choose(list(matrices))
    dmig = matrices[name]
    if dmig.is_complex:
        raise wanted.error(f"{name} is complex; microslip takes real matrices")
    if dmig.matrix_form not in (1, 2, 6, 9):
        raise wanted.error(f"{name} is of the form {dmig.matrix_form}; 1, 2, 6 and 9 are known")
    row_keys, column_keys = (_keys(places, wanted) for places in (dmig.GCi, dmig.GCj))
    values = np.asarray(dmig.Real, dtype=float)
    if dmig.matrix_form in (1, 6):
        keys, at = np.unique(np.concatenate([row_keys, column_keys]), return_inverse=True)
        rows, columns, n_columns = at[: len(values)], at[len(values) :], len(keys)
    else:
        (keys, rows), (column_places, columns) = (np.unique(places, return_inverse=True) for places in (row_keys, column_keys))
        n_columns = len(column_places)
    matrix = from_coordinates(rows, columns, values, (len(keys), n_columns), wanted)
    return FileMatrix(matrix, DofMap(keys // 8, keys % 8), is_triangle=dmig.matrix_form == 6)


def _keys(places: np.ndarray, wanted: Wanted) -> np.ndarray:
    """Return a key for each grid point and component (n, 2); CaseError for impossible values."""
    whole = np.asarray(places, dtype=np.int64).reshape(-1, 2)
    if len(whole) and abs(whole[:, 0]).max() >= LARGEST:
        raise wanted.error(f"it has a grid point of the number {abs(whole[:, 0]).max()}")
    if len(whole) and not 0 <= whole[:, 1].min() <= whole[:, 1].max() <= 6:
        raise wanted.error("a component of a DMIG entry is not 0 to 6")
    return 8 * whole[:, 0] + whole[:, 1]
