"""Strain and stress in solids, stiffness about a state that has it, and the forces of warm ones (docs/theory.md, section 12)."""

from __future__ import annotations

import numpy as np

from .kinds import KINDS
from .materials import Elastic, Material
from .quadrature import Rule, rules
from .solid import _chunks, _condense, _gradients, _incompatible_gradients, _local


def stress(
    kind: str,
    points: np.ndarray,
    u: np.ndarray,
    material: Material,
    warmer: float | np.ndarray = 0.0,
    integration: str = "full",
    incompatible_modes: bool = True,
) -> np.ndarray:
    """Return the stress at the quadrature points of the stiffness, (n_elements, n_q, 3, 3) [Pa].

    Local.

    Parameters
    ----------
    u : (n_elements, n, 3) displacements of the nodes [m]
    warmer : temperature above that without stress [K], one or of nodes (n_elements, n), interpolated as displacements are
    others : as in :func:`microslip.elements.stiffness`

    Notes
    -----
    The elasticity times eps - alpha dT.  The bubbles of hex8 follow from the nodes, as in its stiffness.
    """
    found = strain(kind, points, u, material, integration, incompatible_modes, warmer)
    rule = rules(kind, integration)[0]
    for chunk in _chunks(len(points), 9 * (points.shape[1] + 3) ** 2):
        found[chunk] = _local(material, kind, points[chunk], rule).stress(found[chunk], _at_points(kind, rule, warmer, chunk))
    return found


def strain(
    kind: str,
    points: np.ndarray,
    u: np.ndarray,
    material: Material,
    integration: str = "full",
    incompatible_modes: bool = True,
    warmer: float | np.ndarray = 0.0,
) -> np.ndarray:
    """Return the strain at the quadrature points of the stiffness, (n_elements, n_q, 3, 3) [-].  Local; as :func:`stress`."""
    rule = rules(kind, integration)[0]
    found = np.empty((len(points), len(rule.weights), 3, 3))
    for chunk in _chunks(len(points), 9 * (points.shape[1] + 3) ** 2):
        dN, volumes = _functions(kind, points[chunk], rule, incompatible_modes)
        local, warm = _local(material, kind, points[chunk], rule), _at_points(kind, rule, warmer, chunk)
        amplitudes = _amplitudes(dN, volumes, u[chunk], local, warm)
        slopes = dN @ amplitudes[:, None]  # (n_elements, n_q, 3, 3): d u_j / d x_i
        found[chunk] = 0.5 * (slopes + slopes.swapaxes(-1, -2))
    return found


def _functions(kind: str, points: np.ndarray, rule: Rule, incompatible_modes: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradients of shape functions and, in hex8, of the bubbles behind them, and w det J."""
    dN, volumes = _gradients(KINDS[kind], points, rule)
    if incompatible_modes and kind == "hex8":
        dN = np.concatenate([dN, _incompatible_gradients(KINDS[kind], points, rule, volumes)], axis=-1)
    return dN, volumes


def _at_points(kind: str, rule: Rule, warmer: float | np.ndarray, chunk: slice) -> float | np.ndarray:
    """Return temperatures at the quadrature points, (n_elements, n_q), from those of the nodes; one alone stays what it is."""
    return warmer[chunk] @ KINDS[kind].values(rule.points).T if isinstance(warmer, np.ndarray) else warmer


def _amplitudes(dN: np.ndarray, volumes: np.ndarray, u: np.ndarray, local: Elastic, warm: float | np.ndarray = 0.0) -> np.ndarray:
    """Return the amplitudes of all functions, (n_elements, m, 3), under displacements of the nodes: no force acts on bubbles."""
    n = 3 * u.shape[1]
    if n == 3 * dN.shape[-1]:
        return u
    K = local.stiffness(dN, volumes)
    right = -K[:, n:, :n] @ u.reshape(len(u), n, 1)
    if isinstance(warm, np.ndarray):  # one temperature moves no bubble
        right += _held(dN, volumes, local, warm)[:, n // 3 :].reshape(len(u), -1, 1)
    return np.concatenate([u, np.linalg.solve(K[:, n:, n:], right).reshape(len(u), -1, 3)], axis=1)


def deformed_stiffness(
    kind: str,
    points: np.ndarray,
    u: np.ndarray,
    material: Material,
    integration: str = "full",
    incompatible_modes: bool = True,
    warmer: float | np.ndarray = 0.0,
) -> np.ndarray:
    """Return the stiffness of elements about a displaced state, without that of its stress, (n_elements, 3 n, 3 n) [N/m].

    Local.  docs/theory.md, eq. (12.11): with F = 1 + du/dx the strain of a small motion v is sym(F^T dv/dx).

    Parameters
    ----------
    u : (n_elements, n, 3) displacements of the nodes [m]
    others : as in :func:`stress`
    """
    rule = rules(kind, integration)[0]
    n = 3 * points.shape[1]
    K = np.empty((len(points), n, n))
    for chunk in _chunks(len(points), 9 * (points.shape[1] + 3) ** 2):
        dN, volumes = _functions(kind, points[chunk], rule, incompatible_modes)
        local = _local(material, kind, points[chunk], rule)
        slopes = dN @ _amplitudes(dN, volumes, u[chunk], local, _at_points(kind, rule, warmer, chunk))[:, None]
        whole = local.stiffness_about(dN, np.eye(3) + slopes.swapaxes(-1, -2), volumes)
        K[chunk] = _condense(whole, n) if whole.shape[-1] > n else whole
    return K


def stress_stiffness(kind: str, points: np.ndarray, stress: np.ndarray, integration: str = "full") -> np.ndarray:
    """Return what a stress (n_elements, n_q, 3, 3) [Pa] adds to the stiffness, (n_elements, n, n) [N/m].

    Local.  docs/theory.md, eq. (12.5): entry a, b couples u_x of a and b, u_y, u_z alike.  ``stress`` is that of :func:`stress`.
    """
    rule = rules(kind, integration)[0]
    found = np.empty((len(points), points.shape[1], points.shape[1]))
    for chunk in _chunks(len(points), 9 * points.shape[1] ** 2):
        dN, volumes = _gradients(KINDS[kind], points[chunk], rule)
        weighted = (stress[chunk] * volumes[..., None, None]) @ dN
        found[chunk] = (dN.swapaxes(-1, -2) @ weighted).sum(axis=1)
    return found


def thermal_forces(
    kind: str,
    points: np.ndarray,
    material: Material,
    warmer: float | np.ndarray,
    integration: str = "full",
    incompatible_modes: bool = True,
) -> np.ndarray:
    """Return the nodal forces of elements that are held while they are warm, turned round, (n_elements, n, 3) [N].

    Local.  docs/theory.md, eq. (12.2); ``warmer`` [K] than without stress, one or those of the nodes, (n_elements, n), as in
    :func:`stress`.  Bubbles of hex8 give way to it.
    """
    rule, n = rules(kind, integration)[0], points.shape[1]
    found = np.empty(points.shape)
    for chunk in _chunks(len(points), 9 * (n + 3) ** 2):
        local, warm = _local(material, kind, points[chunk], rule), _at_points(kind, rule, warmer, chunk)
        dN, volumes = _functions(kind, points[chunk], rule, incompatible_modes and isinstance(warm, np.ndarray))
        forces = _held(dN, volumes, local, warm)
        if dN.shape[-1] > n:
            K, on_bubbles = local.stiffness(dN, volumes), forces[:, n:].reshape(len(forces), -1, 1)
            K_kb, K_bb = K[:, : 3 * n, 3 * n :], K[:, 3 * n :, 3 * n :]
            forces = forces[:, :n] - (K_kb @ np.linalg.solve(K_bb, on_bubbles)).reshape(-1, n, 3)
        found[chunk] = forces
    return found


def _held(dN: np.ndarray, volumes: np.ndarray, local: Elastic, warm: float | np.ndarray) -> np.ndarray:
    """Return what expansion pushes with by each function of gradients (n_elements, n_q, 3, m), (n_elements, m, 3) [N]."""
    held = local.stress(np.zeros((3, 3)), warm)
    return -((volumes[..., None, None] * (held @ dN)).sum(axis=1)).swapaxes(-1, -2)
