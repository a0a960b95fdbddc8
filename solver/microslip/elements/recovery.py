"""Stress and strain at the nodes of elements, as rows over their displacements (docs/theory.md, section 13)."""

from __future__ import annotations

import numpy as np

from .kinds import KINDS
from .materials import Material
from .prestress import strain, stress
from .quadrature import rules

_CORNERS = {"hex": "hex8", "tet": "tet4", "wedge": "wedge6", "pyramid": "pyramid5"}  # the kind whose functions are fitted


def nodal_stress(
    kind: str, points: np.ndarray, material: Material, integration: str = "full", incompatible_modes: bool = True
) -> np.ndarray:
    """Return the stress at the nodes of one element per displacement of each node, (n, 3, 3, n, 3) [Pa/m].

    Local.  The stress at the quadrature points of the stiffness, fitted by the functions of the corners: docs/theory.md,
    eq. (13.6).  Entry [a, i, j, b, k] is sigma_ij at node a for u_k of node b.

    Parameters
    ----------
    points : (n, 3) nodes of the element [m]
    others : as in :func:`microslip.elements.stiffness`
    """
    unit = _unit_displacements(len(points))
    found = stress(kind, np.broadcast_to(points, unit.shape), unit, material, 0.0, integration, incompatible_modes)
    return _at_nodes(found, kind, integration)


def nodal_strain(
    kind: str, points: np.ndarray, material: Material, integration: str = "full", incompatible_modes: bool = True
) -> np.ndarray:
    """Return the strain at the nodes of one element per displacement of each node, (n, 3, 3, n, 3) [1/m].

    Local.  As the stress, docs/theory.md, eq. (13.6).
    """
    unit = _unit_displacements(len(points))
    found = strain(kind, np.broadcast_to(points, unit.shape), unit, material, integration, incompatible_modes)
    return _at_nodes(found, kind, integration)


def _unit_displacements(n: int) -> np.ndarray:
    """Return a displacement of one node along one axis, for each, (3 n, n, 3) [m]."""
    return np.eye(3 * n).reshape(3 * n, n, 3)


def _at_nodes(at_points: np.ndarray, kind: str, integration: str) -> np.ndarray:
    """Return tensors (3 n, n_q, 3, 3) of unit displacements, fitted to the nodes, (n, 3, 3, n, 3)."""
    n = len(at_points) // 3
    return np.einsum("aq,uqij->aiju", fit(kind, integration), at_points).reshape(n, 3, 3, n, 3)


def fit(kind: str, integration: str = "full") -> np.ndarray:
    """Return the weights (n, n_q) that take values at the quadrature points of the stiffness to the nodes.  Local.

    Least squares by the linear or trilinear functions of the corners; of the smallest norm where they are more than the points,
    so that one point gives a constant.
    """
    corners, rule = KINDS[_CORNERS[kind.rstrip("0123456789")]], rules(kind, integration)[0]
    return corners.values(KINDS[kind].nodes) @ np.linalg.pinv(corners.values(rule.points))
