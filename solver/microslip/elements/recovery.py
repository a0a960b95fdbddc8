"""Stress and strain at the nodes of elements, as rows over their displacements (docs/theory.md, section 13)."""

from dataclasses import replace

import numpy as np

from .kinds import KINDS
from .quadrature import rules
from .solid import Solids
from .stress import strain, stress

_CORNERS = {"hex": "hex8", "tet": "tet4", "wedge": "wedge6", "pyramid": "pyramid5"}  # the kind whose functions are fitted


def nodal_stress(of: Solids) -> np.ndarray:
    """Return the stress at the nodes of one element, alone in ``of``, per displacement of each node, (n, 3, 3, n, 3) [Pa/m].

    Local.  The stress at the quadrature points of the stiffness, fitted by the functions of the corners: docs/theory.md,
    eq. (13.6).  Entry [a, i, j, b, k] is sigma_ij at node a for u_k of node b.
    """
    return _at_nodes(stress(*_under_unit_displacements(of)), of)


def nodal_strain(of: Solids) -> np.ndarray:
    """Return the strain at the nodes of one element per displacement of each node, (n, 3, 3, n, 3) [1/m].

    Local.  As the stress, docs/theory.md, eq. (13.6).
    """
    return _at_nodes(strain(*_under_unit_displacements(of)), of)


def _under_unit_displacements(of: Solids) -> tuple[Solids, np.ndarray]:
    """Return one element 3 n times, and for each a displacement of one node along one axis, (3 n, n, 3) [m]."""
    unit = np.eye(3 * of.n).reshape(3 * of.n, of.n, 3)
    return replace(of, points=np.broadcast_to(of.points, unit.shape)), unit


def _at_nodes(at_points: np.ndarray, of: Solids) -> np.ndarray:
    """Return tensors (3 n, n_q, 3, 3) of unit displacements, fitted to the nodes, (n, 3, 3, n, 3)."""
    return np.einsum("aq,uqij->aiju", fit(of.kind, of.integration), at_points).reshape(of.n, 3, 3, of.n, 3)


def fit(kind: str, integration: str = "full") -> np.ndarray:
    """Return the weights (n, n_q) that take values at the quadrature points of the stiffness to the nodes.  Local.

    Least squares by the linear or trilinear functions of the corners; of the smallest norm where they are more than the points,
    so that one point gives a constant.
    """
    corners, rule = KINDS[_CORNERS[kind.rstrip("0123456789")]], rules(kind, integration)[0]
    return corners.values(KINDS[kind].nodes) @ np.linalg.pinv(corners.values(rule.points))
