"""Ansys' .full: assembled stiffness, mass and damping, with node and direction of each equation."""

import numpy as np

from ...messages.errors import CaseError
from ...messages.words import counted
from .ansys_records import Records
from .file_matrix import DofMap, FileMatrix, Wanted, from_coordinates

_POINTERS = {"K": 18, "M": 26, "C": 28, "DOF": 35}  # positions of the low words in the header
_LUMPED, _UNSYMMETRIC = 10, 13
_EXPORT = "write the matrices with APDL: *SMAT,K,D,IMPORT,FULL,file.full,STIFF and *EXPORT,K,MMF,K.mtx, and the same for MASS"


def read_full(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file without constrained equations.  Local.

    Raises
    ------
    CaseError : the file is faulty or of an unsupported kind
    """
    name = wanted.choose(["K", "M", "C"]) if wanted.name is not None else wanted.symbol
    if name not in ("K", "M", "C"):
        raise CaseError(f"{wanted.where}: a .full holds K, M and C")
    records = Records.of(wanted, _EXPORT)
    head = records.integers(records.follow(0))
    if len(head) < 40 or head[0] != -4:
        raise wanted.error(f"it is not of symbolic assembly; {_EXPORT}")
    if head[_UNSYMMETRIC]:
        raise wanted.error("its matrices are not symmetric")
    if name == "M" and head[_LUMPED]:
        raise wanted.error(f"its mass is lumped, in a form that is not read; {_EXPORT}")
    starts = {key: int(head[at]) & 0xFFFFFFFF | int(head[at + 1]) << 32 for key, at in _POINTERS.items()}
    if not starts[name]:
        raise CaseError(f"{wanted.where}: the file holds no {name}")
    n = int(head[1])
    wanted.check_entries(n, 8.0)
    dofs, is_free = _dofs(records, starts["DOF"], n, wanted)
    rows, columns, values = _block(records, starts[name], n, wanted)
    matrix = from_coordinates(rows, columns, values, (n, n), wanted)
    free = np.flatnonzero(is_free)
    note = f"{wanted.path.name}: {n - len(free)} of {counted(n, 'equation')} are constrained and left out"
    return FileMatrix(
        matrix[free][:, free], dofs[free] if dofs is not None else None, is_triangle=True, notes=(note,) * (len(free) < n)
    )


def _dofs(records: Records, start: int, n: int, wanted: Wanted) -> tuple[DofMap | None, np.ndarray]:
    """Return node and direction of the equations, if all nodes have the same directions, and the free equations."""
    labels_at = records.follow(records.follow(0))
    labels = records.integers(labels_at)
    nodes = records.integers(records.follow(labels_at))
    counts = records.integers(start)
    note = records.integers(records.follow(start))
    if len(counts) != len(nodes) or counts.sum() != n or len(note) != n:
        raise wanted.error("its table of degrees of freedom does not fit its equations")
    is_free = note >= 0
    if ((counts != 0) & (counts != len(labels))).any() or labels.max(initial=1) > 6 or labels.min(initial=1) < 1:
        return None, is_free
    has = counts != 0
    return DofMap(np.repeat(nodes[has], len(labels)).astype(np.int64), np.tile(labels, has.sum()).astype(np.int64)), is_free


def _block(records: Records, start: int, n: int, wanted: Wanted) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and values of one triangle: each equation has a record of columns and a record of values."""
    columns, values = [], []
    at = start
    for _ in range(n):
        columns.append(records.integers(at))
        at = records.follow(at)
        values.append(records.numbers(at))
        at = records.follow(at)
        if len(columns[-1]) != len(values[-1]):
            raise wanted.error(f"equation {len(columns)} has {len(columns[-1])} columns and {len(values[-1])} values")
    rows = np.repeat(np.arange(n), [len(column) for column in columns])
    return rows, np.concatenate(columns).astype(np.int64) - 1, np.concatenate(values)
