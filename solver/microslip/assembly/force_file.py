"""Read forces on nodes or DOFs, real or complex, from a CSV file.  Local; NumPy only."""

from pathlib import Path

import numpy as np

from ..formats.csv_table import read_table
from ..mesh.locate import nodes_numbered
from ..messages.errors import CaseError

ON_NODES = ("node", "fx", "fy", "fz"), ("fx_im", "fy_im", "fz_im")  # columns that are needed, and that may be there
ON_DOFS = ("dof", "value"), ("imag",)


def forces_on_nodes(path: Path, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (n,), as indices into ``numbers`` (n_nodes,) of the user's file, and their forces (n, 3), complex [N].  Local.

    Raises
    ------
    CaseError : names the line at fault
    """
    lines, table = _read(path, *ON_NODES)
    return nodes_numbered(numbers, table[:, 0], lines, path), table[:, 1:4] + 1j * table[:, 4:7]


def forces_on_dofs(path: Path, n_dof: int) -> tuple[np.ndarray, np.ndarray]:
    """Return DOFs (n,) and the forces on them (n,), complex [N].  Local.  Raises CaseError: names the line at fault."""
    lines, table = _read(path, *ON_DOFS)
    dof = table[:, 0]
    wrong = np.flatnonzero((dof != np.floor(dof)) | (dof < 0) | (dof >= n_dof))
    if len(wrong):
        raise CaseError(
            f"{path}, line {lines[wrong[0]]}: dof = {dof[wrong[0]]:g} is not a DOF number; "
            f"the matrices have DOFs 0 to {n_dof - 1}"
        )
    return dof.astype(int), table[:, 1] + 1j * table[:, 2]


def _read(path: Path, needed: tuple[str, ...], further: tuple[str, ...]) -> tuple[list[int], np.ndarray]:
    """Return the line numbers and the values (n, m) of all columns, those needed first; 0 in columns that are not there."""
    columns, lines = read_table(path, needed, further, what="force")
    nothing = np.zeros(len(lines))
    table = np.column_stack([columns.get(name, nothing) for name in (*needed, *further)])
    if not table[:, 1:].any():
        raise CaseError(f"{path}: every force is 0; it moves nothing")
    return lines, table
