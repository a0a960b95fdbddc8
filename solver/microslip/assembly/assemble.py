"""Assemble K and M of the free DOFs on every rank's own rows, and the maps from them to pairs, loads and outputs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from .. import elements
from ..guards.memory import refuse_beyond
from ..mesh.connected import check_fixed, connected_parts, loose_bodies
from ..mesh.data import ContactPairs, DistributedMesh, LocalBlock, Mesh
from ..mesh.links import Links, find_links, fixed_places
from ..mesh.locate import notes_on_positions
from ..messages.errors import CaseError, ResourceError
from ..parallel.agree import on_root, raise_together
from ..tables.cyclic import Cyclic
from ..tables.structure_tables import StructureTables
from .check import check_elements
from .constrained import constrained
from .constraints import Constraints, check_supports, constrain, number_dofs
from .fixed_pairs import notes_on_pairs
from .maps import OutputRow, base_map, load_map, next_pair_map, orders_of, output_map, output_row, pair_map
from .nodal_forces import NodalForces, nodal_forces
from .node_blocks import BlockSum, NodePattern, element_chunks, expand, node_pattern
from .rigid_motions import free_combinations, rigid_motions
from .sectors import Sectors
from .system import System

FREE = "no [[supports]]: the structure is free, and its rigid-body motion is part of the response"
ASSEMBLED = 30.0  # bytes an entry of K held at once: sums of element matrices, rows expanded, PETSc's copy of them


def assemble(
    dmesh: DistributedMesh, mesh: Mesh | None, pairs: ContactPairs, tables: StructureTables, explicit: bool = True
) -> System:
    """Return K, M, R, loads and outputs on the free DOFs; of a disc those of nodal diameter 0, and its ``sectors``.

    Collective on ``dmesh.comm``.

    Parameters
    ----------
    mesh : the whole mesh on rank 0, None elsewhere
    pairs : the contact pairs, on every rank
    explicit : whether K and M of nodal diameter 0 have entries

    Raises
    ------
    MeshError, CaseError : inverted elements, a part that nothing holds, a load that moves nothing; on every rank
    ResourceError : not enough memory, or a rank's matrix has more entries than PETSc's integers count; on every rank
    """
    check_elements(dmesh, tables)
    whole = on_root(dmesh.comm, read_off, mesh, pairs, tables)
    links, to_mesh = whole.links, np.argsort(dmesh.rank_order)
    loads = with_base_motion(whole.loads, tables, dmesh, links)
    dof, row_ranges = number_dofs(dmesh, whole.is_fixed[: len(to_mesh)][to_mesh])
    if row_ranges[-1] == 0:
        raise CaseError("[[supports]] fix every degree of freedom; nothing can move")
    constraints = constrain(dmesh, links, whole.is_fixed, *whole.loose) if not links.is_empty else None
    K, M = _matrices(dmesh, dof, row_ranges, tables.sections)
    dof_of_mesh, n_dof = dof[dmesh.rank_order], int(row_ranges[-1])
    if constraints is not None:
        dof_of_mesh, n_dof = constraints.dof, constraints.T.shape[0]
    first, last = dmesh.node_ranges[dmesh.comm.rank : dmesh.comm.rank + 2]
    system = System(
        comm=dmesh.comm,
        K=K,
        M=M,
        C=None,
        R=pair_map(pairs, dof_of_mesh, n_dof),
        loads=load_map(loads, dof_of_mesh, n_dof),
        outputs=output_map(whole.outputs, dof_of_mesh, n_dof),
        dof=dof_of_mesh,
        parts=np.repeat(whole.part[to_mesh[first:last]], 3)[(dof[first:last] >= 0).ravel()],
        part_names=whole.part_names,
        split_by=dmesh.split_by,
        notes=whole.notes,
        output_orders=orders_of(tables.outputs),
        output_base=base_map(tables.outputs, tables.loads) if any(output.absolute for output in tables.outputs) else None,
    )
    if tables.cyclic is not None:
        sectors = _sectors_of(system, pairs, tables.cyclic, links, whole.part, constraints)
        if tables.cyclic.differs:
            blades = _of_bodies(dmesh, tables.cyclic.blades)
            sectors = replace(sectors, blades=_matrices(blades, dof, row_ranges, tables.sections))
        return sectors.system(0, explicit)
    if constraints is not None:
        system = constrained(system, constraints, whole.part)
    return replace(system, rigid_owned=rigid_motions(dmesh, constraints, dof, whole.free))


def _sectors_of(
    system: System, pairs: ContactPairs, cyclic: Cyclic, links: Links, part: np.ndarray, constraints: Constraints | None
) -> Sectors:
    """Return the sectors of a disc from the system of one; ``part`` (n_nodes,) is that of each node.  Local."""
    assert constraints is not None and links.cyclic is not None and system.dof is not None, "a disc of a mesh"
    n_dof = system.R.shape[1]
    R_next = next_pair_map(pairs, links.cyclic.turn, system.dof, n_dof)
    of_sector = replace(system, rigid_owned=np.zeros((n_dof, 0)))  # no nodal diameter's motion is that of a free body
    return Sectors.of(cyclic.sectors, cyclic.wave_number, of_sector, R_next, constraints, part, links.cyclic.high)


@dataclass(frozen=True, eq=False)
class WholeMesh:
    """What only the whole mesh shows.  Places are its nodes, then points (``mesh/ties.py``)."""

    is_fixed: np.ndarray  # (n_places, 3) bool
    part: np.ndarray  # (n_nodes,) connected part of each node
    part_names: tuple[str, ...]
    loads: list[NodalForces]
    outputs: list[OutputRow]
    links: Links  # dependences by ties, points and equations
    loose: tuple[np.ndarray, tuple[np.ndarray, ...]]  # tied parts by number, and those held by joints alone
    notes: tuple[str, ...]  # on a structure without supports, on pairs whose sides cannot move relative to each other
    free: np.ndarray  # (6, n) combinations of rigid-body motions that nothing holds


def read_off(mesh: Mesh, pairs: ContactPairs, tables: StructureTables) -> WholeMesh:
    """Return the data that need the whole mesh.  Local, rank 0.

    Raises
    ------
    MeshError, CaseError : a part that nothing holds, supports, loads or outputs without a node, a joint whose sides cannot move
    """
    links = find_links(mesh, tables)
    is_fixed = fixed_places(mesh, tables, links)
    check_supports(mesh, links, is_fixed)
    part, part_names = connected_parts(mesh, tables.body_of)
    # the motions of most nodal diameters strain a disc that nothing holds
    is_supported = links.cyclic is not None or check_fixed(part, part_names, mesh, tables.supports, pairs, links)
    free = np.eye(6)
    if is_supported or mesh.equations is not None:
        may_be_free = links.cyclic is None and not (pairs.node2 < 0).any()
        free = free_combinations(mesh, links, is_fixed) if may_be_free else np.zeros((6, 0))
    outputs = [output_row(mesh, output, tables, links) for output in tables.outputs]
    still = [
        f"WARNING: output {output.name!r} is on degrees of freedom that a support fixes; it does not move"
        for output, row in zip(tables.outputs, outputs)
        if row.at >= 0 and not output.absolute and not row.values[~is_fixed[row.nodes]].any()
    ]
    return WholeMesh(
        is_fixed=is_fixed,
        part=part,
        part_names=part_names,
        loads=[nodal_forces(mesh, load, tables.model, f"[[loads]] {i}", links) for i, load in enumerate(tables.loads, 1)],
        outputs=outputs,
        links=links,
        loose=loose_bodies(part, len(part_names), mesh, tables.supports, links),
        notes=(
            *notes_on_positions(mesh, tables),
            *still,
            *((FREE,) if free.shape[1] == 6 else ()),
            *notes_on_pairs(pairs, links, is_fixed, str(tables.path)),
            *left_free(free),
        ),
        free=free,
    )


def left_free(free: np.ndarray) -> tuple[str, ...]:
    """Return a message on the rigid-body motions that supports, springs and equations leave free, if not all.  Local."""
    if free.shape[1] in (0, 6):
        return ()
    n_turns = int(np.any(free[3:] != 0.0, axis=0).sum())
    counts = ((free.shape[1] - n_turns, "translation"), (n_turns, "turning motion"))
    words = " and ".join(f"{n} {word}{'s' * (n > 1)}" for n, word in counts if n)
    return (f"WARNING: supports, springs and equations leave {words} of the structure free: part of the response",)


def _matrices(dmesh: DistributedMesh, dof: np.ndarray, row_ranges: np.ndarray, bodies: Mapping[str, elements.SolidSection]):
    """Return K and M as PETSc matrices.  Collective on ``dmesh.comm``.

    M couples equal directions only: its pattern is a third of K's, and part of it.
    """
    pattern = node_pattern(dmesh)
    comm = dmesh.comm
    n_entries = 9 * len(pattern.indices)
    too_many = n_entries > np.iinfo(PETSc.IntType).max
    raise_together(
        comm,
        f"a rank's stiffness matrix has {n_entries} entries, more than the {PETSc.IntType.__name__} numbers of this "
        "PETSc count; use more ranks, or a PETSc built with 64-bit indices"
        if too_many
        else None,
        ResourceError,
    )
    refuse_beyond(comm, ASSEMBLED * n_entries, "assembly of the matrices", "use more ranks on more machines, or a coarser mesh")
    n_owned = int(row_ranges[comm.rank + 1] - row_ranges[comm.rank])
    sums = _sums(dmesh, bodies, pattern)
    K = petsc_matrix(comm, n_owned, expand(pattern, sums.pop(0), dof, PETSc.IntType))
    M = petsc_matrix(comm, n_owned, expand(pattern, sums.pop(0), dof, PETSc.IntType))
    M.setOption(PETSc.Mat.Option.SPD, True)
    return K, M


def _of_bodies(dmesh: DistributedMesh, names: tuple[str, ...] | None) -> DistributedMesh:
    """Return the mesh of some bodies, of all where none is named.  Local."""
    return dmesh if names is None else replace(dmesh, blocks=tuple(block for block in dmesh.blocks if block.body in names))


def _sums(dmesh: DistributedMesh, bodies: Mapping[str, elements.SolidSection], pattern: NodePattern) -> list[BlockSum]:
    """Return the sums of the element matrices, K and M.  Local."""
    sums = [BlockSum(pattern, 3), BlockSum(pattern, 1)]
    for block in dmesh.blocks:
        _add_elements(block, bodies[block.body], pattern, *sums)
    return sums


def _add_elements(block: LocalBlock, body: elements.SolidSection, pattern: NodePattern, K_sum: BlockSum, M_sum: BlockSum) -> None:
    """Add a block's element matrices, a bounded number of elements at a time."""
    n_nodes = block.nodes.shape[1]
    for chunk in element_chunks(block):
        points = block.points[chunk]
        is_owned, positions = pattern.positions(block.nodes[chunk])
        K = elements.stiffness(body.solids(block.kind, points))
        K_sum.add(is_owned, positions, K.reshape(-1, n_nodes, 3, n_nodes, 3))
        M = elements.mass(block.kind, points, body.density, body.integration)
        M_sum.add(is_owned, positions, M.reshape(-1, n_nodes, 1, n_nodes, 1))


def petsc_matrix(comm: MPI.Comm, n_owned: int, csr: tuple[np.ndarray, ...]):
    """Return a symmetric AIJ matrix from this rank's rows, (indptr, columns, values), on one rank without a copy of them.

    Collective on ``comm``.
    """
    size = ((n_owned, None), (n_owned, None))
    matrix = PETSc.Mat().createAIJWithArrays(size, csr, comm=comm)
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    matrix.setOption(PETSc.Mat.Option.SYMMETRY_ETERNAL, True)
    return matrix


def with_base_motion(
    loads: list[NodalForces], tables: StructureTables, dmesh: DistributedMesh, links: Links
) -> list[NodalForces]:
    """Return the loads with those of a base that accelerates, -M r a of eq. (13.4), on the masses of points too.

    Collective on ``dmesh.comm`` where there is one: one gather.
    """
    if not any(load.base_acceleration is not None for load in tables.loads):
        return loads
    mass = np.concatenate([nodal_masses(dmesh, tables), [point.mass for point in links.points]])
    at = np.concatenate([np.arange(links.n_nodes), [links.place_of(point.name) for point in links.points]]).astype(int)
    shaped = []
    for load, stated in zip(loads, tables.loads):
        if stated.base_acceleration is None:
            shaped.append(load)
            continue
        nodes, forces = at, -np.outer(mass, stated.base_acceleration)
        if links.attached is not None:
            acceleration = np.tile(stated.base_acceleration, (len(links.attached.mass), 1))
            nodes = np.concatenate([at, np.arange(links.n_places)])
            forces = np.concatenate([forces, -links.attached.forces(acceleration)])
        shaped.append(replace(load, nodes=nodes, shapes=(forces,)))
    return shaped


def nodal_masses(dmesh: DistributedMesh, tables: StructureTables) -> np.ndarray:
    """Return the integral of rho N_a of every node of Mesh.points, (n_nodes,) [kg]: its row of M, over fixed nodes too.

    Collective on ``dmesh.comm``: one gather.  At corners of quadratic elements it may be negative.
    """
    first, last = dmesh.node_ranges[dmesh.comm.rank :][:2]
    mass = np.zeros(last - first)
    for block in dmesh.blocks:
        body = tables.sections[block.body]
        for chunk in element_chunks(block):
            of_elements = elements.mass(block.kind, block.points[chunk], body.density, body.integration).sum(axis=-1)
            rows = block.nodes[chunk] - first
            is_here = (rows >= 0) & (rows < len(mass))
            np.add.at(mass, rows[is_here], of_elements[is_here])
    return np.concatenate(dmesh.comm.allgather(mass))[dmesh.rank_order]
