"""A base that accelerates: the inertial forces of the structure relative to it (docs/theory.md, section 13)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .. import elements
from ..mesh.data import DistributedMesh
from ..mesh.links import Links
from ..mesh.settings import MeshSettings
from .blocks import element_chunks
from .nodal_forces import NodalForces


def with_base_motion(loads: list[NodalForces], settings: MeshSettings, dmesh: DistributedMesh, links: Links) -> list[NodalForces]:
    """Return the loads with those of a base that accelerates, -M r a of eq. (13.4), on the masses of points too.

    Collective on ``dmesh.comm`` where there is one: one gather.
    """
    if not any(load.base_acceleration is not None for load in settings.loads):
        return loads
    mass = np.concatenate([nodal_masses(dmesh, settings), [point.mass for point in links.points]])
    forces = [None if load.base_acceleration is None else -np.outer(mass, load.base_acceleration) for load in settings.loads]
    n_nodes = len(mass) - len(links.points)
    nodes = np.concatenate([np.arange(n_nodes), [links.place_of(point.name) for point in links.points]]).astype(int)
    return [load if f is None else replace(load, nodes=nodes, shapes=(f,)) for load, f in zip(loads, forces)]


def nodal_masses(dmesh: DistributedMesh, settings: MeshSettings) -> np.ndarray:
    """Return the integral of rho N_a of every node of Mesh.points, (n_nodes,) [kg]: its row of M, over fixed nodes too.

    Collective on ``dmesh.comm``: one gather.  At corners of quadratic elements it may be negative.
    """
    first, last = dmesh.node_ranges[dmesh.comm.rank :][:2]
    mass = np.zeros(last - first)
    for block in dmesh.blocks:
        body = settings.bodies[block.body]
        for chunk in element_chunks(block):
            of_elements = elements.mass(block.kind, block.points[chunk], body.density, body.integration).sum(axis=-1)
            rows = block.nodes[chunk] - first
            own = (rows >= 0) & (rows < len(mass))
            np.add.at(mass, rows[own], of_elements[own])
    return np.concatenate(dmesh.comm.allgather(mass))[dmesh.rank_order]
