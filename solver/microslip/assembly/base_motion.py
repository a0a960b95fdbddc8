"""A base that accelerates: the inertial forces of the structure relative to it (docs/theory.md, section 13)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .. import elements
from ..mesh.data import DistributedMesh
from ..mesh.links import Links
from ..tables.structure_tables import StructureTables
from .nodal_forces import NodalForces
from .node_blocks import element_chunks


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
