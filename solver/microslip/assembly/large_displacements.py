"""The structure about a large displacement: tangent stiffness and out-of-balance loads (docs/theory.md, section 12)."""

from dataclasses import replace

import numpy as np

from .. import elements
from ..mesh.data import DistributedMesh, LocalBlock
from ..tables.structure_tables import StructureTables
from .node_blocks import BlockSum, element_chunks, node_pattern
from .prestress import add_to_nodes, displacement_at_nodes, moved_at_nodes, on_rows, owned_nodes, with_change
from .spin import spin_of
from .system import System


def tangent_about(
    dmesh: DistributedMesh, tables: StructureTables, system: System, u_owned: np.ndarray, share: float, is_stressed: bool = True
) -> tuple[System, np.ndarray]:
    """Return the system with the stiffness K_T about a displacement, and the additional forces (the brackets of the equation).

    Collective on ``dmesh.comm``: every rank gathers the displacement.  docs/theory.md, eq. (12.14).

    Parameters
    ----------
    u_owned : (n_dof_owned,) m, this rank's rows
    share : of the spin, of temperatures and of the way of moved supports that there is
    is_stressed : whether K_T has the stress and the spin in it; at the start of a share, where the stress is not yet that of an
        equilibrium, it does without

    Returns
    -------
    system : with K_T (n_dof, n_dof) [N/m], spin softening in it
    forces_owned : (n_dof_owned,) N, this rank's rows
    """
    spin, moved = spin_of(tables, share), moved_at_nodes(dmesh, system)
    free = displacement_at_nodes(dmesh, system, u_owned)
    held = np.zeros_like(free) if moved is None else share * moved
    pattern, (first, last) = node_pattern(dmesh), owned_nodes(dmesh)
    total, forces = BlockSum(pattern, 3), np.zeros((last - first, 3))
    for whole in dmesh.blocks:
        block = replace(whole, temperature_rise=share * whole.temperature_rise)
        for chunk in element_chunks(block):
            nodes = block.nodes[chunk]
            change, left = _about(block, chunk, tables, spin, free[nodes], held[nodes], is_stressed)
            total.add(*pattern.positions(nodes), change)
            add_to_nodes(forces, nodes - first, left)
    return with_change(dmesh, system, spin if is_stressed else np.zeros((3, 3)), pattern, total), on_rows(dmesh, system, forces)


def _about(
    block: LocalBlock,
    chunk: slice,
    tables: StructureTables,
    spin: np.ndarray,
    free: np.ndarray,
    held: np.ndarray,
    is_stressed: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Return K_T - K (n_elements, n, 3, n, 3) [N/m] and (K_F + K_sigma) u - f_int + M S d (n_elements, n, 3) [N].  Local.

    ``free`` and ``held`` (n_elements, n, 3) [m] are the displacements of what is free and of supports that are moved.
    """
    body, points = tables.sections[block.body], block.points[chunk]
    of, moved = body.solids(block.kind, points, block.rise_of(chunk)), free + held
    resisted, K_T = elements.large_displacements(of, moved, is_stressed)
    K = elements.stiffness(of)
    softening = np.einsum("eab,ij->eaibj", elements.mass(block.kind, points, body.density, body.integration), spin)
    moving = held if is_stressed else held + free
    left = (K_T @ free.reshape(len(K_T), -1, 1)).reshape(free.shape) - resisted + np.einsum("eaibj,ebj->eai", softening, moving)
    return (K_T - K).reshape(softening.shape) - softening * is_stressed, left
