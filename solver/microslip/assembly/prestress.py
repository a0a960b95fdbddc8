"""Constant loads before the vibration, and the stiffness due to stress and spin (docs/theory.md, section 12)."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from .. import elements
from ..mesh.data import DistributedMesh, LocalBlock, Mesh
from ..mesh.locate import find_node
from ..mesh.reference_points import forces_of_moment
from ..mesh.surface import outward_faces
from ..parallel.agree import on_root
from ..tables.constant_loads import Statics
from ..tables.structure_tables import StructureTables
from .assemble import petsc_matrix
from .constraints import Constraints, reduced
from .node_blocks import BlockSum, NodePattern, element_chunks, expand, node_pattern
from .sectors import Sectors
from .spin import outward, spin_of, stated_statics
from .system import System

Seen = Callable[[LocalBlock, int, slice], np.ndarray]


def constant_forces(dmesh: DistributedMesh, mesh: Mesh | None, tables: StructureTables, system: System) -> np.ndarray:
    """Return this rank's rows of the forces of ``tables.statics``, eq. (12.1) and eq. (12.2), (n_dof_owned,) [N].

    Collective on ``dmesh.comm``: one broadcast.  ``mesh`` is that of rank 0.  Moved supports act as well, eq. (12.12).  With
    large displacements the forces of temperatures and moved supports are no constants, and left out.

    Raises
    ------
    MeshError : a group that is no surface, or a place without a node; on every rank
    """
    statics = stated_statics(tables)
    total = nodal_loads(dmesh, mesh, tables)
    moved = None if statics.large_displacements else moved_at_nodes(dmesh, system)
    if moved is not None:
        total += _of_moved(dmesh, tables, moved)
    if system.constraints is None:
        return on_rows(dmesh, system, total)
    on_points, on_places = place_loads(system.constraints, tables)
    f_owned = on_rows(dmesh, system, total, on_points)
    return f_owned if system.constraints.attached is None else f_owned + system.constraints.of_places(dmesh.comm, on_places)


def nodal_loads(dmesh: DistributedMesh, mesh: Mesh | None, tables: StructureTables) -> np.ndarray:
    """Return the constant loads on this rank's nodes, those that supports hold too, (n_owned_nodes, 3) [N].

    Collective on ``dmesh.comm``: one broadcast.  Those of points and of masses at nodes are in ``place_loads``.

    Raises
    ------
    MeshError : a group that is no surface, or a place without a node; on every rank
    """
    statics = stated_statics(tables)
    first, last = owned_nodes(dmesh)
    nodes, values = on_root(dmesh.comm, _forces_on_nodes, mesh, statics)
    total = np.zeros((last - first, 3))
    add_to_nodes(total, dmesh.rank_order[nodes] - first, values)
    for block in dmesh.blocks:
        for chunk in element_chunks(block):
            add_to_nodes(total, block.nodes[chunk] - first, element_forces(block, chunk, tables))
    return total


def place_loads(constraints: Constraints, tables: StructureTables) -> tuple[np.ndarray, np.ndarray]:
    """Return constant forces and moments on the points, (n_points, 6) [N, N m], and those of masses on places, (n_places, 3) [N].

    Local; the same on every rank.
    """
    on_points, attached = _on_points(constraints, tables), constraints.attached
    if attached is None:
        return on_points, np.zeros((len(constraints.dof), 3))
    return on_points, attached.forces(outward(tables, attached.points))


def on_rows(dmesh: DistributedMesh, system: System, nodal: np.ndarray, on_points: np.ndarray | None = None) -> np.ndarray:
    """Return this rank's rows (n_dof_owned,) of forces on its nodes, (n_owned_nodes, 3) [N], and T^T of them where some follow.

    Collective.  ``on_points`` (n_points, 6) are forces and moments on the points of the constraints, none by default.
    """
    first, last = owned_nodes(dmesh)
    constraints = system.constraints
    if constraints is None:
        return nodal[by_rank(dmesh, system)[first:last] >= 0]
    of_nodes = constraints.dof[: len(dmesh.rank_order)][np.argsort(dmesh.rank_order)][first:last]
    f_owned = constraints.transposed(dmesh.comm, nodal[of_nodes >= 0])
    return f_owned if on_points is None else f_owned + constraints.of_points(dmesh.comm, on_points.ravel())


def _on_points(constraints: Constraints, tables: StructureTables) -> np.ndarray:
    """Return the constant forces and moments on the points, (n_points, 6) [N, N m].  Local."""
    names = [point.name for point in constraints.points]
    on_points = np.zeros((len(names), 6))
    for force in () if tables.statics is None else tables.statics.forces:
        if force.point is not None:
            on_points[names.index(force.point)] += [*(force.force or (0.0,) * 3), *(force.moment or (0.0,) * 3)]
    for row, point in zip(on_points, constraints.points, strict=True):
        row[:3] += point.mass * outward(tables, np.array(point.position))
    return on_points


def _forces_on_nodes(mesh: Mesh, statics: Statics) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (n,) and the forces and pressures on them, (n, 3) [N].  Local, rank 0."""
    nodes, values = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    for i, force in enumerate(statics.forces, 1):
        if force.point is not None:
            continue
        where = f"[[statics.forces]] {i}"
        loaded = find_node(mesh, position=force.position, node=force.node, group=force.group, where=where)
        nodes.append(loaded)
        if force.moment is not None:
            values.append(forces_of_moment(mesh, force.group or "", force.moment, f"{mesh.path}: {where}"))
        else:
            values.append(np.tile(np.array(force.force) / len(loaded), (len(loaded), 1)))
    for load in statics.pressures:
        for kind, faces in outward_faces(mesh, load.group).items():
            nodes.append(faces.ravel())
            values.append(load.pressure * elements.pressure_forces(kind, mesh.points[faces]).reshape(-1, 3))
    return np.concatenate(nodes), np.concatenate(values)


def element_forces(block: LocalBlock, chunk: slice | np.ndarray, tables: StructureTables) -> np.ndarray:
    """Return the centrifugal and thermal forces of some elements, (n_elements, n, 3) [N].  Local."""
    statics, body, points = stated_statics(tables), tables.sections[block.body], block.points[chunk]
    total = np.zeros(points.shape)
    if statics.rotation_speed > 0.0:
        total += elements.mass(block.kind, points, body.density, body.integration) @ outward(tables, points)
    temperature_rise = block.rise_of(chunk)
    if np.any(temperature_rise) and body.material.expands and not statics.large_displacements:
        total += elements.thermal_forces(body.solids(block.kind, points, temperature_rise))
    return total


def _of_moved(dmesh: DistributedMesh, tables: StructureTables, moved: np.ndarray) -> np.ndarray:
    """Return the forces -K d of supports moved by d (n_nodes, 3) [m], rank-ordered, on this rank's nodes, eq. (12.12).  Local."""
    first, last = owned_nodes(dmesh)
    total = np.zeros((last - first, 3))
    for block in dmesh.blocks:
        body, at_moved = tables.sections[block.body], np.flatnonzero(moved[block.nodes].any(axis=(1, 2)))
        for chunk in element_chunks(block):
            nodes = block.nodes[at_moved[chunk]]
            if not len(nodes):
                break
            K = elements.stiffness(body.solids(block.kind, block.points[at_moved[chunk]]))
            add_to_nodes(total, nodes - first, -(K @ moved[nodes].reshape(len(K), -1, 1)).reshape(nodes.shape + (3,)))
    return total


def stiffness_at_rest(
    dmesh: DistributedMesh, tables: StructureTables, system: System, u_owned: np.ndarray, above_cuts: Seen | None = None
) -> System:
    """Return the system with K + K_sigma - Omega^2 K_spin, eq. (12.5), about the displacement ``u_owned`` (n_dof_owned,) [m].

    Collective on ``dmesh.comm``: every rank gathers the displacement.  K_F takes the place of K where the deformed shape counts.
    ``above_cuts`` gives the displacement of some elements in addition to that of their nodes (above
    the cuts of bolts), from a block, its number and rows: (n_elements, n, 3) [m].
    """
    moved = moved_at_nodes(dmesh, system)
    u = displacement_at_nodes(dmesh, system, u_owned) + (0.0 if moved is None else moved)
    pattern = node_pattern(dmesh)
    total = BlockSum(pattern, 3)
    for i, block in enumerate(dmesh.blocks):
        for chunk in element_chunks(block):
            is_owned, positions = pattern.positions(block.nodes[chunk])
            seen_there = u[block.nodes[chunk]] if above_cuts is None else u[block.nodes[chunk]] + above_cuts(block, i, chunk)
            change = _stiffening(block, chunk, tables, seen_there)
            total.add(is_owned, positions, change)
    return with_change(dmesh, system, spin_of(tables), pattern, total)


def displacement_at_nodes(dmesh: DistributedMesh, system: System, u_owned: np.ndarray) -> np.ndarray:
    """Return the displacement of all nodes, rank-ordered, (n_nodes, 3) [m], from this rank's rows; supports rest.  Collective."""
    return system.at_nodes(np.concatenate(dmesh.comm.allgather(u_owned)))[np.argsort(dmesh.rank_order)]


def moved_at_nodes(dmesh: DistributedMesh, system: System) -> np.ndarray | None:
    """Return how far supports are moved, of all nodes, rank-ordered, (n_nodes, 3) [m]; None: they rest.  Local."""
    return None if system.moved is None else system.moved[np.argsort(dmesh.rank_order)]


def with_change(dmesh: DistributedMesh, system: System, spin: np.ndarray, pattern: NodePattern, total: BlockSum) -> System:
    """Return the system with K plus a sum of changes of element matrices; of a disc with those of all nodal diameters changed.

    Collective.  ``spin`` (3, 3) softens what is attached to nodes.
    """
    constraints, structure = system.constraints, PETSc.Mat.Structure.SAME_NONZERO_PATTERN
    of_points = of_masses = None
    if constraints is not None:
        of_points, structure = of_point_masses(constraints, -spin), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        of_masses = None if constraints.attached is None else -constraints.attached.weighted(spin)
    change = on_rows_of(dmesh, system, pattern, total, of_points, of_masses)
    if isinstance(system.sectors, Sectors):
        about = system.sectors.about(system, change)
    else:
        about = replace(system, K=system.K.duplicate(copy=True))
        about.K.axpy(1.0, change, structure=structure)
    change.destroy()
    return about


def on_rows_of(
    dmesh: DistributedMesh,
    system: System,
    pattern: NodePattern,
    total: BlockSum,
    of_points: np.ndarray | None = None,
    of_masses: sp.csr_matrix | None = None,
) -> PETSc.Mat:
    """Return a sum of element matrices on the rows of the system, of a disc on those of its sector with both faces.

    Collective.  ``of_points`` (n_points, 6, 6) and ``of_masses`` (3 n_places, 3 n_places) are added where the system has
    constraints.
    """
    constraints = system.constraints
    dof = by_rank(dmesh, system) if constraints is None else constraints.dof[np.argsort(dmesh.rank_order)]
    first, last = system.K.getOwnershipRange()
    n_owned = last - first if constraints is None else int(np.diff(constraints.nodal_ranges)[dmesh.comm.rank])
    matrix = petsc_matrix(dmesh.comm, n_owned, expand(pattern, total, dof, PETSc.IntType))
    if constraints is None:
        return matrix
    of_rows = system.sectors.with_both_faces if isinstance(system.sectors, Sectors) else constraints
    assert of_points is not None, "with constraints"
    return reduced(matrix, of_rows, of_points, of_masses)


def of_point_masses(constraints: Constraints, A: np.ndarray) -> np.ndarray:
    """Return mass times A (3, 3) of the points, (n_points, 6, 6), for their spin and Coriolis forces.  Local."""
    blocks = np.zeros((len(constraints.points), 6, 6))
    for block, point in zip(blocks, constraints.points, strict=True):
        block[:3, :3] = point.mass * A
    return blocks


def _stiffening(block: LocalBlock, chunk: slice, tables: StructureTables, u: np.ndarray) -> np.ndarray:
    """Return K_sigma + K_F - K - Omega^2 K_spin of some elements, (n_elements, n, 3, n, 3) [N/m]; K_F on request."""
    body, points = tables.sections[block.body], block.points[chunk]
    of = body.solids(block.kind, points, block.rise_of(chunk))
    sigma = elements.stress_stiffness(of, elements.stress(of, u))
    mass = elements.mass(block.kind, points, body.density, body.integration)
    change = np.einsum("eab,ij->eaibj", sigma, np.eye(3)) - np.einsum("eab,ij->eaibj", mass, spin_of(tables))
    if stated_statics(tables).deformed_shape:
        turned = elements.deformed_stiffness(of, u) - elements.stiffness(of)
        change += turned.reshape(change.shape)
    return change


def owned_nodes(dmesh: DistributedMesh) -> tuple[int, int]:
    """Return the first of this rank's nodes and the one after its last.  Local."""
    first, last = dmesh.node_ranges[dmesh.comm.rank :][:2]
    return int(first), int(last)


def by_rank(dmesh: DistributedMesh, system: System) -> np.ndarray:
    """Return the rows of the rank-ordered nodes, (n_nodes, 3), -1 where fixed.  Local."""
    assert system.dof is not None, "a structure with a mesh"
    return system.dof[np.argsort(dmesh.rank_order)]


def add_to_nodes(total: np.ndarray, nodes: np.ndarray, values: np.ndarray) -> None:
    """Add values (..., 3) to the rows ``nodes`` (...) that exist."""
    mine = (nodes >= 0) & (nodes < len(total))
    np.add.at(total, nodes[mine], values[mine])
