"""Contact surfaces in the deformed shape: area ratios and rotations (docs/theory.md, section 12)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..tables.joint import Joint
from .data import ContactPairs, Mesh
from .surface import surface_of


def stretched(mesh: Mesh, joints: Sequence[Joint], pairs: ContactPairs, u: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
    """Return the areas of the pairs over their unloaded areas, (n_pairs,), and the largest rotation of each joint [rad].

    Local, rank 0.  Areas and normals are taken at the nodes of the first surface.  ``u`` (n_nodes, 3) [m] is the displacement
    of ``Mesh.points``.
    """
    weights = abs(pairs.sides(len(mesh.points))[0])
    ratio, turns = np.ones(pairs.n_pairs), {}
    deformed = replace(mesh, points=mesh.points + u)
    for joint in joints:
        before, now = (surface_of(state, joint.groups[0]) for state in (mesh, deformed))
        of_nodes = np.ones(len(mesh.points))
        of_nodes[before.nodes] = now.areas / before.areas
        of_joint = pairs.of_joint(joint.name)
        ratio[of_joint] = (weights[of_joint] @ of_nodes) / weights[of_joint].sum(axis=1).A1
        across = np.linalg.norm(np.cross(before.normals, now.normals), axis=1)
        turns[joint.name] = float(np.arcsin(np.minimum(across, 1.0)).max())
    return ratio, turns
