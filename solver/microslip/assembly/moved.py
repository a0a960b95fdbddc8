"""Supports that are moved before the vibration and fixed during it (docs/theory.md, eq. (12.12))."""

import numpy as np

from ..mesh.data import Mesh
from ..mesh.links import find_links
from ..mesh.locate import find_node
from ..messages.errors import MeshError
from ..messages.words import place
from ..parallel.agree import on_root
from ..tables.structure_tables import StructureTables
from .spin import stated_statics
from .system import System


def moved_supports(mesh: Mesh | None, tables: StructureTables, system: System) -> np.ndarray | None:
    """Return how far supports are moved, (n_nodes, 3) [m] of the nodes of the mesh, the same on every rank; None: they rest.

    Collective on ``system.comm``: one broadcast.  docs/theory.md, eq. (12.12): d.  ``mesh`` is that of rank 0.

    Raises
    ------
    MeshError : a direction that no support holds, or one that something else follows; on every rank
    """
    if not stated_statics(tables).displacements:
        return None
    return on_root(system.comm, _of_mesh, mesh, tables, system)


def _of_mesh(mesh: Mesh, tables: StructureTables, system: System) -> np.ndarray:
    """Return how far each node of ``Mesh.points`` is moved, (n_nodes, 3) [m].  Local, rank 0."""
    assert system.dof is not None, "a structure with a mesh"
    places = system.dof if system.constraints is None else system.constraints.dof
    is_fixed = places[: len(mesh.points)] < 0
    moved = np.zeros((len(mesh.points), 3))
    for i, support in enumerate(stated_statics(tables).displacements, 1):
        where = f"[[statics.displacements]] {i}"
        nodes = find_node(mesh, group=support.group, where=where)
        axes = np.flatnonzero(support.displacement)
        free = ~is_fixed[np.ix_(nodes, axes)]
        if free.any():
            row, column = np.argwhere(free)[0]
            node = nodes[row]
            raise MeshError(
                f'{mesh.path}: {where} group = "{support.group}": node {mesh.numbers[node]} at {place(mesh.points[node])} m '
                f"is held along {'xyz'[axes[column]]} by none of [[supports]]; a support is moved, hold it there"
            )
        moved[np.ix_(nodes, axes)] = np.array(support.displacement)[axes]
    _refuse_followed(mesh, tables, system, moved)
    return moved


def _refuse_followed(mesh: Mesh, tables: StructureTables, system: System, moved: np.ndarray) -> None:
    """Raise MeshError if ties, points or equations follow moved nodes, which would move them, too."""
    if system.constraints is None:
        return
    links = find_links(mesh, tables)
    leads = abs(links.weights).sum(axis=0).A1[: moved.size].reshape(moved.shape) > 0.0
    both = np.argwhere(leads & (moved != 0.0))
    if len(both):
        node = both[0][0]
        raise MeshError(
            f"{mesh.path}: [[statics.displacements]]: node {mesh.numbers[node]} at {place(mesh.points[node])} m is moved, and "
            "leads a tie, a point or an equation, which do not go with it here; move nodes that nothing follows"
        )
