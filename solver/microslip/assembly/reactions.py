"""Forces on nodes and points at rest other than contact: loads, and the resistance of the elements at supports."""

from dataclasses import dataclass

import numpy as np

from .. import elements
from ..mesh.data import DistributedMesh, Mesh
from ..tables.structure_tables import StructureTables
from .constraints import Constraints
from .node_blocks import element_chunks
from .prestress import Seen, add_to_nodes, nodal_loads, owned_nodes, place_loads
from .spin import spin_of, stated_statics
from .system import System


@dataclass(frozen=True, eq=False)
class Acting:
    """Forces at rest on all nodes, in the order of ``Mesh.points``, and on the points connected to them."""

    loads: np.ndarray  # (n_nodes, 3) N, of [statics]
    on_points: np.ndarray  # (n_points, 6) N, N m
    resisted: np.ndarray  # (n_nodes, 3) N, how elements resist where something holds; 0 elsewhere
    is_restrained: np.ndarray  # (n_nodes, 3) bool: supports, springs, ties, points or equations act there
    places: np.ndarray  # (n_nodes, 3) m, where forces act: in the deformed shape with large displacements
    points: np.ndarray  # (n_points, 3) m, the same of points


def acting_at_rest(
    dmesh: DistributedMesh,
    mesh: Mesh | None,
    tables: StructureTables,
    system: System,
    u_owned: np.ndarray,
    above_cuts: Seen | None = None,
) -> Acting | None:
    """Return the forces at rest other than contact, on rank 0; None elsewhere.

    Collective on ``dmesh.comm``: every rank gathers the displacement ``u_owned`` (n_dof_owned,) [m], rank 0 the forces.  Only
    elements at nodes that something holds are gone through.  docs/theory.md, eq. (12.15).

    Parameters
    ----------
    mesh : the whole mesh on rank 0, None elsewhere
    above_cuts : displacements of elements above cuts of bolts beyond those of their nodes, as in ``stiffness_at_rest``
    """
    comm, constraints = dmesh.comm, system.constraints
    is_large = stated_statics(tables).large_displacements
    whole = np.concatenate(comm.allgather(u_owned))
    u = system.at_nodes(whole) + (0.0 if system.moved is None else system.moved)
    to_mesh, is_restrained = np.argsort(dmesh.rank_order), restrained_places(system)
    loads = nodal_loads(dmesh, mesh, tables)
    resisted = _resisted(dmesh, tables, u[to_mesh], is_restrained[to_mesh].any(axis=1), above_cuts)
    if is_large:
        loads += _farther_out(dmesh, tables, u[to_mesh])
    gathered = comm.gather((loads, resisted))
    if gathered is None:
        return None
    assert mesh is not None, "rank 0 has the mesh"
    loads, resisted = (np.concatenate(parts)[dmesh.rank_order] for parts in zip(*gathered))
    if constraints is None:
        loads_and_places = loads, np.zeros((0, 6)), np.zeros((0, 3))
    else:
        loads_and_places = _with_places(loads, constraints, tables, whole)
    loads, on_points, points = loads_and_places
    places = mesh.points + u if is_large else mesh.points
    return Acting(loads, on_points, np.where(is_restrained, resisted, 0.0), is_restrained, places, points)


def restrained_places(system: System) -> np.ndarray:
    """Return the DOFs with constraint forces, (n_nodes, 3) bool: fixed, following or leading ones.  Local."""
    assert system.dof is not None, "a structure with a mesh"
    constraints = system.constraints
    if constraints is None:
        return system.dof < 0
    n_nodes = len(system.dof)
    is_led = np.diff(constraints.T.tocsc().indptr) > 1  # columns that move more than one row
    free = constraints.free[:n_nodes]
    is_restrained = (free < 0) | np.append(is_led, False)[free]
    if constraints.attached is not None:
        sprung = np.unique(constraints.attached.stretch.indices)
        is_restrained.ravel()[sprung[sprung < is_restrained.size]] = True
    return is_restrained


def _resisted(
    dmesh: DistributedMesh, tables: StructureTables, u: np.ndarray, is_restrained: np.ndarray, above_cuts: Seen | None
) -> np.ndarray:
    """Return K u, or f_int(u), of elements at held nodes on this rank's nodes, (n_owned_nodes, 3) [N]; all rank-ordered."""
    first, last = owned_nodes(dmesh)
    total = np.zeros((last - first, 3))
    for i, block in enumerate(dmesh.blocks):
        body, restrained = tables.sections[block.body], np.flatnonzero(is_restrained[block.nodes].any(axis=1))
        for chunk in element_chunks(block):
            rows = restrained[chunk]
            if not len(rows):
                break
            by = u[block.nodes[rows]] if above_cuts is None else u[block.nodes[rows]] + above_cuts(block, i, rows)
            of = body.solids(block.kind, block.points[rows], block.rise_of(rows))
            if stated_statics(tables).large_displacements:
                forces, _ = elements.large_displacements(of, by)
            else:
                K = elements.stiffness(of)
                forces = (K @ by.reshape(len(K), -1, 1)).reshape(by.shape)
            add_to_nodes(total, block.nodes[rows] - first, forces)
    return total


def _farther_out(dmesh: DistributedMesh, tables: StructureTables, u: np.ndarray) -> np.ndarray:
    """Return the centrifugal forces of a displacement, M S u, on this rank's nodes, (n_owned_nodes, 3) [N]."""
    first, last = owned_nodes(dmesh)
    total = np.zeros((last - first, 3))
    for block in dmesh.blocks:
        body = tables.sections[block.body]
        for chunk in element_chunks(block):
            mass = elements.mass(block.kind, block.points[chunk], body.density, body.integration)
            add_to_nodes(total, block.nodes[chunk] - first, mass @ u[block.nodes[chunk]] @ spin_of(tables))
    return total


def _with_places(
    loads: np.ndarray, constraints: Constraints, tables: StructureTables, whole: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return loads on nodes with those of masses there, forces and moments on points, where points are.  Local, rank 0."""
    n_nodes, positions = len(loads), np.array([point.position for point in constraints.points]).reshape(-1, 3)
    of_points, of_places = place_loads(constraints, tables)
    if stated_statics(tables).large_displacements:
        spin = spin_of(tables)
        u_points = (constraints.T[constraints.n_nodal :] @ whole).reshape(-1, 6)[:, :3]
        mass = np.array([point.mass for point in constraints.points]).reshape(-1, 1)
        of_points[:, :3] += mass * u_points @ spin
        positions = positions + u_points
        if constraints.attached is not None:
            moved = (constraints.attached.motion @ constraints.at_places @ whole).reshape(-1, 3)
            of_places = of_places + constraints.attached.forces(moved @ spin)
    return loads + of_places[:n_nodes], of_points + of_places[n_nodes:].reshape(-1, 6), positions
