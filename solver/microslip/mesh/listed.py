"""Contact of pairs of nodes listed in a file, with normals and areas: nodes of a mesh or of matrices."""

from pathlib import Path

import numpy as np

from ..formats.csv_table import read_table
from ..formats.model import index_of
from ..messages.errors import CaseError
from ..messages.words import counted
from ..tables.joint import Joint
from .contact_points import ContactPoints
from .data import Mesh, on_nodes

COLUMNS = ("node1", "node2", "nx", "ny", "nz", "area")
GROUND = -1


def listed_nodes(mesh: Mesh, joint: Joint) -> ContactPoints:
    """Return a point for each line of a joint's file.  Local, rank 0.

    The normal points from body 2 into body 1; it need not be of unit length.

    Raises
    ------
    CaseError : with the number of the faulty line
    """
    path = joint.file_of("node_pairs")
    if path is None:
        raise ValueError(f"joint {joint.name!r} lists no pairs of nodes")
    columns, lines = read_table(path, COLUMNS, what="pair")
    table = np.column_stack([columns[name] for name in COLUMNS])
    _check(table, lines, path)
    node1, node2 = (_indices(mesh, table[:, i], lines, COLUMNS[i], path) for i in (0, 1))
    normals = table[:, 2:5] / abs(table[:, 2:5]).max(axis=1, keepdims=True)  # scaled: squares of large components overflow
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    near = np.where(node2 == GROUND, node1, node2)
    offset = mesh.points[node1] - mesh.points[near]
    return ContactPoints(
        side1=on_nodes(node1, len(mesh.points)),
        side2=on_nodes(node2, len(mesh.points)),
        z=normals,
        area=table[:, 5],
        position=(mesh.points[node1] + mesh.points[near]) / 2.0,
        distance=np.einsum("pi,pi->p", normals, offset),
        note=_farthest(joint, offset, table),
    )


def _check(table: np.ndarray, lines: list[int], path: Path) -> None:
    """Raise CaseError for a normal without length, an area that is not positive, a node paired with itself."""
    faults = (
        (~table[:, 2:5].any(axis=1), "the normal nx, ny, nz is zero"),
        (table[:, 5] <= 0.0, "area must be above 0"),
        (table[:, 0] == table[:, 1], "node1 and node2 are the same node"),
    )
    for wrong, text in faults:
        if wrong.any():
            raise CaseError(f"{path}, line {lines[int(np.argmax(wrong))]}: {text}")


def _indices(mesh: Mesh, numbers: np.ndarray, lines: list[int], column: str, path: Path) -> np.ndarray:
    """Return the nodes of ``numbers``, index into ``mesh.points``; -1: ground, allowed only for body 2."""
    is_ground = (numbers == GROUND) & (column == "node2")
    index, unknown = index_of(mesh.numbers, numbers[~is_ground])
    if len(unknown):
        line = lines[int(np.argmax(np.isin(numbers, unknown) & ~is_ground))]
        raise CaseError(
            f"{path}, line {line}: {column} = {unknown[0]:g}: there is no such node; node numbers run from "
            f"{mesh.numbers.min()} to {mesh.numbers.max()}, and node2 = -1 is ground"
        )
    places = np.full(len(numbers), GROUND, dtype=np.int64)
    places[~is_ground] = index
    return places


def _farthest(joint: Joint, offset: np.ndarray, table: np.ndarray) -> str:
    """Return a note with the largest distance of the nodes of a pair, if known."""
    distance = np.linalg.norm(offset, axis=1)
    if not np.isfinite(distance).all():
        return ""
    worst = int(np.argmax(distance))
    note = f"joint {joint.name!r}: {counted(len(table), 'pair')} of nodes from a file"
    return note + (f", at most {distance[worst]:.3g} m apart (node {table[worst, 0]:.0f})" if distance[worst] > 0.0 else "")
