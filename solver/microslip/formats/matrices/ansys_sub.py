"""Ansys' .sub: the reduced matrices of a superelement, with node and direction of each row.

The second record of the file is its header: number of rows, matrices present, positions of the other records. The matrices are
interleaved by rows: the first row of each, then the second. No file written by Ansys was available for tests, so other forms and
matrices that are not symmetric are refused.
"""

import numpy as np

from ...messages.errors import CaseError
from .ansys_records import Records
from .file_matrix import DofMap, FileMatrix, Wanted

_FULL = 8  # first number of the header of full matrices
_N_ROWS, _N_MATRICES, _N_DOFS, _UNSYMMETRIC, _N_MODES = 1, 2, 4, 9, 43  # positions in the header
_HAS = {"K": 10, "M": 11, "C": 12, "stress stiffening": 13}
_MATRICES, _LABELS, _ROWS = 21, 30, 31  # header positions of the starts of these records
_EXPORT = (
    "write its matrices with APDL: *DMAT,K,D,IMPORT,SUB,file.sub,STIFF and *EXPORT,K,MMF,K.mtx, the same for MASS, and the DOFs "
    "of its rows into a CSV file, [model] dofs"
)


def read_sub(wanted: Wanted) -> FileMatrix:
    """Return a matrix of a superelement; rows of its modes have no node.  Local.

    Raises
    ------
    CaseError : the file is faulty or of an unsupported form
    """
    name = wanted.choose(["K", "M", "C"]) if wanted.name is not None else wanted.symbol
    records = Records.of(wanted, _EXPORT)
    head = records.integers(records.follow(0))
    if len(head) <= _N_MODES or head[0] != _FULL:
        raise wanted.error(f"it is not of a superelement with full matrices; {_EXPORT}")
    available = [key for key, at in _HAS.items() if head[at] == 1]
    if head[_UNSYMMETRIC] or len(available) != head[_N_MATRICES]:
        raise wanted.error(f"it is of a form that is not read; {_EXPORT}")
    if name not in available or name not in ("K", "M", "C"):
        raise CaseError(f"{wanted.where}: the file holds no {name}")
    n = int(head[_N_ROWS])
    wanted.check_entries(n * n, 4.0)
    A, is_triangle = _matrix(records, int(head[_MATRICES]), n, available.index(name), len(available))
    return FileMatrix(A, _dofs(records, head, n, wanted), is_triangle=is_triangle)


def _matrix(records: Records, at: int, n: int, kind: int, n_matrices: int) -> tuple[np.ndarray, bool]:
    """Return one of the matrices (n, n), and whether the file has only its lower triangle."""
    A, lengths = np.zeros((n, n)), []
    for i in range(n):
        for k in range(n_matrices):
            if k == kind:
                row = records.numbers(at)
                if len(row) not in (n, i + 1):
                    raise records.wanted.error(f"row {i + 1} holds {len(row)} numbers where {n} are expected; {_EXPORT}")
                A[i, : len(row)] = row
                lengths.append(len(row))
            at = records.follow(at)
    return A, lengths == list(range(1, n + 1))


def _dofs(records: Records, head: np.ndarray, n: int, wanted: Wanted) -> DofMap | None:
    """Return node and direction of the rows, modes last; None if there are DOFs of other kinds."""
    labels, rows = records.integers(int(head[_LABELS])), records.integers(int(head[_ROWS])).astype(np.int64)
    n_modes = int(head[_N_MODES])
    if len(labels) != head[_N_DOFS] or len(rows) != n or not 0 <= n_modes <= n or (rows < 1).any():
        raise wanted.error(f"its table of degrees of freedom does not fit its {n} rows; {_EXPORT}")
    if labels.max(initial=1) > 6 or labels.min(initial=1) < 1:
        return None
    nodes, places = np.divmod(rows - 1, len(labels))
    is_mode = np.arange(n) >= n - n_modes
    return DofMap(np.where(is_mode, 0, nodes + 1), np.where(is_mode, 0, labels[places]))
