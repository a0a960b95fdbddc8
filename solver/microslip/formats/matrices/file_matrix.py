"""The common form of all readers of matrices, and their arguments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ...messages.errors import CaseError, ResourceError
from ...messages.words import shortened

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")  # 1 to 6 of DofMap
LARGEST = 2**53  # largest node number: larger ones are not exact as floats, and their keys overflow
_MOST_BYTES = 2**40  # more memory than any machine for this program has
_ROWS_OF_ANY_FILE = 10**7  # empty rows of less than a hundred megabytes

# Names of the matrices in other programs, in the order of preference.
NAMES = {
    "K": ("K", "KAA", "KAAX", "KGG", "KGGX", "KLL", "KXX", "STIFFNESS", "STIF"),
    "M": ("M", "MAA", "MAAX", "MGG", "MGGX", "MLL", "MXX", "MASS"),
    "C": ("C", "BAA", "BAAX", "BGG", "BGGX", "B", "BXX", "DAMPING", "DAMP"),
    "T": ("T", "RECOVERY"),
}


@dataclass(frozen=True)
class DofMap:
    """Node and direction of each row; node numbers of 0 or below are not nodes of the user's model."""

    nodes: np.ndarray  # (n,) numbers of the user's model
    directions: np.ndarray  # (n,) 1 to 6: x, y, z, rotations about them; 7: warping; 0: no axis

    def keys(self) -> np.ndarray:
        """Return a unique number for each DOF, (n,)."""
        return self.nodes.astype(np.int64) * 8 + self.directions

    def __getitem__(self, rows: np.ndarray) -> DofMap:
        return DofMap(self.nodes[rows], self.directions[rows])

    def name(self, row: int) -> str:
        """Return node and axis of a row, for messages.  Local."""
        direction = self.directions[row]
        axis = DIRECTIONS[direction - 1] if direction <= len(DIRECTIONS) else f"degree of freedom {direction}"
        return f"node {self.nodes[row]}" + (f" {axis}" if direction > 0 else "")


@dataclass(frozen=True)
class FileMatrix:
    """A matrix as read from a file."""

    matrix: sp.spmatrix | np.ndarray  # (n_rows, n_columns)
    dofs: DofMap | None = None  # DOFs of the rows; of a square matrix also of the columns
    is_triangle: bool = False  # only one triangle is stored
    skew: float = 0.0  # largest |A - A^T| as read, divided by the largest entry
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Wanted:
    """The selection of a matrix in a file, and its name in messages."""

    path: Path
    symbol: str  # K, M, C or T
    where: str = field(default="")  # file and key
    name: str | None = None  # stated by the user

    @property
    def size(self) -> int:
        """Bytes of the file."""
        return self.path.stat().st_size

    def error(self, text: str) -> CaseError:
        """Return the error of a faulty file."""
        return CaseError(f"{self.where} cannot be read as a matrix: {text}")

    def choose(self, names: Sequence[str]) -> str:
        """Return the selected name in a file: the stated name, the only name, or a usual name of this matrix.

        Raises
        ------
        CaseError : the file has none of these
        """
        known = shortened(", ".join(sorted(names))) or "none"
        if self.name is not None:
            if self.name not in names:
                raise CaseError(f"{self.where} has no matrix of this name; it has {known}")
            return self.name
        if len(names) == 1:
            return names[0]
        for usual in NAMES[self.symbol]:
            for name in (usual, usual.lower(), usual.capitalize()):
                if name in names:
                    return name
        raise CaseError(f"{self.where} needs a file with one variable, or with one named {self.symbol}; this one has {known}")

    def check_entries(self, n_entries: int, least_bytes: float) -> None:
        """Raise unless the file is large enough for the entries that its header states.

        Raises
        ------
        CaseError, ResourceError : the file is too small; ResourceError if no memory could suffice
        """
        if n_entries < 0:
            raise self.error(f"its header states {n_entries} entries")
        if n_entries * least_bytes > self.size:
            claim = f"its header states {n_entries} entries, and the file has {self.size} bytes"
            if 8 * n_entries > _MOST_BYTES:
                raise ResourceError(f"{self.where}: not enough memory to read it: {claim}")
            raise self.error(f"it is truncated: {claim}")

    def check_rows(self, n_rows: int) -> None:
        """Raise CaseError for a number of rows that a file of this size cannot fill."""
        if not 0 <= n_rows <= max(self.size, _ROWS_OF_ANY_FILE):
            raise self.error(f"its header states {n_rows} rows, and the file has {self.size} bytes")


def from_coordinates(
    rows: np.ndarray, columns: np.ndarray, values: np.ndarray, shape: tuple[int, int], wanted: Wanted
) -> sp.csr_matrix:
    """Return the matrix of entries, rows and columns from 0; repeated entries are added.  Local.

    Raises
    ------
    CaseError : a row or a column that the matrix does not have
    """
    for places, name, n in ((rows, "row", shape[0]), (columns, "column", shape[1])):
        if len(places) and (places.max() >= n or places.min() < 0):
            raise wanted.error(f"{name} index exceeds matrix dimensions ({places.max() + 1} of {n})")
    kind = np.int32 if max(*shape, len(values)) < 2**31 else np.int64
    return sp.csr_matrix((values, (rows.astype(kind), columns.astype(kind))), shape)


def checked(matrix: sp.spmatrix, wanted: Wanted) -> sp.spmatrix:
    """Return a matrix read by SciPy with its indices checked; SciPy's conversions crash on bad indices.  Local.

    Raises
    ------
    CaseError, ValueError : rows or columns that the matrix does not have, row pointers that decrease
    """
    wanted.check_rows(max(matrix.shape))
    if matrix.format not in ("csr", "csc", "bsr"):
        entries = matrix.tocoo()
        return from_coordinates(entries.row, entries.col, entries.data, entries.shape, wanted)
    if (np.diff(matrix.indptr) < 0).any():  # SciPy accepts this if the last pointer is 0
        raise wanted.error("its rows or columns do not have the stated number of entries")
    matrix.check_format(full_check=True)
    return matrix
