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
    loads: list[NodalForces], settings: StructureTables, dmesh: DistributedMesh, links: Links
) -> list[NodalForces]:
    """Return the loads with those of a base that accelerates, -M r a of eq. (13.4), on the masses of points too.

    Collective on ``dmesh.comm`` where there is one: one gather.
    """
    if not any(load.base_acceleration is not None for load in settings.loads):
        return loads
    mass = np.concatenate([nodal_masses(dmesh, settings), [point.mass for point in links.points]])
    at = np.concatenate([np.arange(links.n_nodes), [links.place_of(point.name) for point in links.points]]).astype(int)
    found = []
    for load, own in zip(loads, settings.loads):
        if own.base_acceleration is None:
            found.append(load)
            continue
        nodes, forces = at, -np.outer(mass, own.base_acceleration)
        if links.attached is not None:
            acceleration = np.tile(own.base_acceleration, (len(links.attached.mass), 1))
            nodes = np.concatenate([at, np.arange(links.n_places)])
            forces = np.concatenate([forces, -links.attached.forces(acceleration)])
        found.append(replace(load, nodes=nodes, shapes=(forces,)))
    return found


def nodal_masses(dmesh: DistributedMesh, settings: StructureTables) -> np.ndarray:
    """Return the integral of rho N_a of every node of Mesh.points, (n_nodes,) [kg]: its row of M, over fixed nodes too.

    Collective on ``dmesh.comm``: one gather.  At corners of quadratic elements it may be negative.
    """
    first, last = dmesh.node_ranges[dmesh.comm.rank :][:2]
    mass = np.zeros(last - first)
    for block in dmesh.blocks:
        body = settings.sections[block.body]
        for chunk in element_chunks(block):
            of_elements = elements.mass(block.kind, block.points[chunk], body.density, body.integration).sum(axis=-1)
            rows = block.nodes[chunk] - first
            own = (rows >= 0) & (rows < len(mass))
            np.add.at(mass, rows[own], of_elements[own])
    return np.concatenate(dmesh.comm.allgather(mass))[dmesh.rank_order]
