"""Find the nodes of loads and outputs by position, number or group."""

from pathlib import Path

import numpy as np

from ..formats.model import index_of
from ..messages.errors import CaseError, MeshError
from ..messages.words import place
from ..tables.structure_tables import StructureTables
from .data import Mesh

SAME = 1e-9  # of the mesh's diagonal: distance of nodes at the same place
FAR = 0.1  # of the mesh's diagonal: largest accepted distance of a position from the nearest node


def find_node(mesh: Mesh, *, position=None, node: int | None = None, group: str | None = None, where: str = "") -> np.ndarray:
    """Return the indices in ``mesh.points`` of the nodes of a load or an output, (n,).  Local, rank 0.

    Parameters
    ----------
    position : three coordinates [m]: the nearest node of the mesh
    node : the user's node number
    group : name of a group: all its nodes
    where : table of the scene for messages, for example "[[loads]] 1"

    Raises
    ------
    MeshError : the node or group does not exist, or no node is near the position
    """
    if position is not None:
        nearest, distance = nearest_node(mesh, position)
        if distance > FAR * mesh.diagonal:
            raise MeshError(
                f"{mesh.path}: {where} position = {place(position)} m is {distance:.3g} m from the nearest node "
                f"({mesh.numbers[nearest]} at {place(mesh.points[nearest])} m), more than {FAR:.0%} of the mesh's "
                "diagonal; positions are in metres, after [model] scale"
            )
        return np.array([nearest])
    if node is not None:
        index = np.flatnonzero(mesh.numbers == node)
        if len(index) == 0:
            raise MeshError(
                f"{mesh.path}: {where} node = {node}: no element of a body has a node of this number; "
                f"node numbers run from {mesh.numbers.min()} to {mesh.numbers.max()}"
            )
        return index
    if group is not None:
        return mesh.node_groups[group]
    raise CaseError(f"{where} needs a position, a node or a group; dof is for scenes given as matrices")


def notes_on_positions(mesh: Mesh, tables: StructureTables) -> tuple[str, ...]:
    """Return notes on positions at which several nodes lie, as on both sides of a joint: which one is used.  Local, rank 0."""
    positions = [(f"[[loads]] {i}", load.position) for i, load in enumerate(tables.loads, 1)]
    if tables.statics is not None:
        positions += [(f"[[statics.forces]] {i}", force.position) for i, force in enumerate(tables.statics.forces, 1)]
    notes = []
    for where, position in (*positions, *((f"output {output.name!r}", output.position) for output in tables.outputs)):
        if position is None:
            continue
        used, _ = nearest_node(mesh, position)
        same = np.flatnonzero(np.linalg.norm(mesh.points - mesh.points[used], axis=1) <= SAME * mesh.diagonal)
        if len(same) > 1:
            at = [f"node {mesh.numbers[n]} of {_body_of(mesh, n)!r}" for n in (used, *same[same != used])]
            notes.append(f"{where}: {at[0]} is used; at the same place: {', '.join(at[1:])}, for which state node")
    return tuple(notes)


def _body_of(mesh: Mesh, node: int) -> str:
    return next(block.group for block in mesh.elements if (block.nodes == node).any())


def nodes_numbered(numbers: np.ndarray, named: np.ndarray, lines: list[int], path: Path) -> np.ndarray:
    """Return the nodes (n,) named by the lines of a file, as indices into the user's ``numbers`` (n_nodes,).  Local.

    Raises
    ------
    CaseError : a node outside all bodies, with the number of its line
    """
    index, unknown = index_of(numbers, named)
    if len(unknown):
        first = int(np.argmax(np.isin(named, unknown)))
        raise CaseError(
            f"{path}, line {lines[first]}: node = {named[first]:g}: no element of a body has a node of this number; "
            f"node numbers run from {numbers.min()} to {numbers.max()}"
        )
    return index


def nearest_node(mesh: Mesh, position) -> tuple[int, float]:
    """Return the index of the node nearest to ``position`` and its distance [m].  Local, rank 0."""
    distances = np.linalg.norm(mesh.points - np.asarray(position, dtype=float), axis=1)
    nearest = int(np.argmin(distances))
    return nearest, float(distances[nearest])
