"""Stress and strain at the nodes of elements, as rows over their displacements (docs/theory.md, section 13)."""

from __future__ import annotations

import numpy as np

from .kinds import KINDS
from .prestress import stress
from .quadrature import rules

_CORNERS = {"hex": "hex8", "tet": "tet4", "wedge": "wedge6", "pyramid": "pyramid5"}  # the kind whose functions are fitted


def nodal_stress(
    kind: str, points: np.ndarray, young: float, poisson: float, integration: str = "full", incompatible_modes: bool = True
) -> np.ndarray:
    """Return the stress at the nodes of one element per displacement of each node, (n, 3, 3, n, 3) [Pa/m].

    Local.  The stress at the quadrature points of the stiffness, fitted by the functions of the corners: docs/theory.md,
    eq. (13.6).  Entry [a, i, j, b, k] is sigma_ij at node a for u_k of node b.

    Parameters
    ----------
    points : (n, 3) nodes of the element [m]
    others : as in :func:`microslip.elements.stiffness`
    """
    n = len(points)
    unit = np.eye(3 * n).reshape(3 * n, n, 3)
    at_points = stress(kind, np.broadcast_to(points, unit.shape), unit, young, poisson, 0.0, integration, incompatible_modes)
    at_nodes = np.einsum("aq,uqij->aiju", fit(kind, integration), at_points)
    return at_nodes.reshape(n, 3, 3, n, 3)


def strain_of(sigma: np.ndarray, young: float, poisson: float) -> np.ndarray:
    """Return the strain tensor of a stress tensor [Pa], both (3, 3, ...): ((1 + nu) sigma - nu tr(sigma) 1) / E.  Local."""
    mean = np.multiply.outer(np.eye(3), np.trace(sigma))
    return ((1.0 + poisson) * sigma - poisson * mean) / young


def fit(kind: str, integration: str = "full") -> np.ndarray:
    """Return the weights (n, n_q) that take values at the quadrature points of the stiffness to the nodes.  Local.

    Least squares by the linear or trilinear functions of the corners; of the smallest norm where they are more than the points,
    so that one point gives a constant.
    """
    corners, rule = KINDS[_CORNERS[kind.rstrip("0123456789")]], rules(kind, integration)[0]
    return corners.values(KINDS[kind].nodes) @ np.linalg.pinv(corners.values(rule.points))
