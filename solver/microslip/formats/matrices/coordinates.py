"""CalculiX, *FREQUENCY, SOLVER=MATRIXSTORAGE: one triangle in job.sti and job.mas, the rows' DOFs in job.dof."""

import numpy as np

from ...messages.errors import CaseError
from .file_matrix import DofMap, FileMatrix, Wanted
from .text import square_of, table_of


def read_calculix(wanted: Wanted) -> FileMatrix:
    """Return the matrix from lines row, column, value, counted from 1, with nodes and directions if a .dof exists.

    Local.

    Raises
    ------
    CaseError : a file is faulty
    """
    with open(wanted.path, "rb") as file:
        table = table_of(file, 3, wanted, has_no_count=True)
    dofs = _dofs(wanted)
    if dofs is not None and len(table) and table[:, :2].max() > len(dofs.nodes):
        n = table[:, :2].max()
        raise CaseError(f"{wanted.path.with_suffix('.dof')} names {len(dofs.nodes)} rows; {wanted.where} has {n:.0f}")
    matrix = square_of(table, wanted, None if dofs is None else len(dofs.nodes))
    note = () if dofs is not None else (f"{wanted.path.name}: no {wanted.path.stem}.dof in its folder; rows without nodes",)
    return FileMatrix(matrix, dofs, is_triangle=True, notes=note)


def _dofs(wanted: Wanted) -> DofMap | None:
    """Return node and direction of each row, from lines such as 12.3; None without the file."""
    path = wanted.path.with_suffix(".dof")
    if not path.is_file():
        return None
    words = path.read_bytes().split()
    parts = [word.partition(b".") for word in words]
    if not all(node.isdigit() and direction.isdigit() and len(direction) == 1 for node, _, direction in parts):
        wrong = next(word for word in words if not all(part.isdigit() for part in word.split(b".")) or word.count(b".") != 1)
        raise CaseError(f"{path}: '{wrong[:20].decode('latin-1')}' is not a node and its direction, as 12.3")
    if max((len(node) for node, _, _ in parts), default=0) > 15:
        raise CaseError(f"{path}: a node number of more than 15 digits")
    nodes, directions = (np.array([int(part[i]) for part in parts], dtype=np.int64) for i in (0, 2))
    return DofMap(nodes, directions)
