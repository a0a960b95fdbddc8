"""Positions of the nodes of a model given as matrices: from a table of coordinates, or from a mesh file."""

from pathlib import Path

import numpy as np

from ..formats.csv_table import read_table
from ..messages.errors import CaseError
from .data import Mesh
from .read import read_whole

_LARGEST = 2.0**53  # largest integer that a float represents exactly


def read_nodes(path: Path) -> Mesh:
    """Return the nodes of a file: a table node,x,y,z in metres without elements, or a mesh with all solids and groups.

    Local.

    Raises
    ------
    CaseError, MeshError : the file is faulty
    """
    if path.suffix.lower() != ".csv":
        return read_whole(path)
    columns, lines = read_table(path, ("node", "x", "y", "z"), what="node")
    if (columns["node"] % 1.0).any() or columns["node"].min() < 1 or columns["node"].max() > _LARGEST:
        raise CaseError(f"{path}: node numbers must be whole and above 0")
    numbers = columns["node"].astype(np.int64)
    order = np.argsort(numbers, kind="stable")
    twice = np.flatnonzero(np.diff(numbers[order]) == 0)
    if len(twice):
        raise CaseError(f"{path}, line {lines[order[twice[0] + 1]]}: node {numbers[order][twice[0]]} appears twice")
    return Mesh(str(path), np.column_stack([columns[axis] for axis in "xyz"]), numbers, (), (), {})


def nodes_alone(path: Path, numbers: np.ndarray) -> Mesh:
    """Return nodes (n,) with unknown positions.  Local."""
    return Mesh(str(path), np.full((len(numbers), 3), np.nan), np.asarray(numbers), (), (), {})
