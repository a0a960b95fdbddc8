"""Stiffness and mass of solid elements, vectorised over elements (docs/theory.md, section 2)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from .kinds import KINDS, Kind
from .materials import Elastic, Material
from .quadrature import Rule, rules

_CHUNK_ENTRIES = 2**18  # of the largest intermediate array: 2 MiB stay in a core's cache, larger ones do not


@dataclass(frozen=True, eq=False)
class Solids:
    """Elements of one kind and material, with their temperature rise and the quadrature of their stiffness.  Local.

    Raises
    ------
    ValueError : unknown kind or integration; when they are used
    """

    kind: str  # a key of ``KINDS``
    points: np.ndarray  # (n_elements, n, 3) nodes of each element [m]
    material: Material
    integration: str = "full"  # a key of ``INTEGRATIONS``
    incompatible_modes: bool = True  # hex8 only: three condensed bubble modes a direction, without which it locks in bending
    temperature_rise: float | np.ndarray = 0.0  # K above the temperature without stress, uniform or (n_elements, n) at the nodes

    @property
    def n(self) -> int:
        """Nodes of an element."""
        return self.points.shape[1]

    @property
    def has_bubbles(self) -> bool:
        """Whether its elements have incompatible modes."""
        return self.incompatible_modes and self.kind == "hex8"

    @property
    def n_functions(self) -> int:
        """Shape functions of an element, with the bubbles."""
        return self.n + 3 if self.has_bubbles else self.n

    @property
    def rule(self) -> Rule:
        """The quadrature of the stiffness."""
        return rules(self.kind, self.integration)[0]

    def parts(self, n_entries: int) -> Iterator[tuple[slice, Solids]]:
        """Yield the elements in chunks that fit into the cache, each element taking ``n_entries`` numbers."""
        for chunk in _chunks(len(self.points), n_entries):
            temperature_rise = (
                self.temperature_rise[chunk] if isinstance(self.temperature_rise, np.ndarray) else self.temperature_rise
            )
            yield chunk, replace(self, points=self.points[chunk], temperature_rise=temperature_rise)

    def elastic(self) -> Elastic:
        """Return the law of the material at the quadrature points, in model axes."""
        return self.material.at(KINDS[self.kind].values(self.rule.points) @ self.points)

    def rise_at_points(self) -> float | np.ndarray:
        """Return the temperature rise at the quadrature points, (n_elements, n_q) [K], like displacements; or the uniform one."""
        return (
            self.temperature_rise @ KINDS[self.kind].values(self.rule.points).T
            if isinstance(self.temperature_rise, np.ndarray)
            else self.temperature_rise
        )

    def gradients(self) -> tuple[np.ndarray, np.ndarray]:
        """Return dN_a / dx_i at the quadrature points, (n_elements, n_q, 3, n), and w det J, (n_elements, n_q)."""
        return _gradients(KINDS[self.kind], self.points, self.rule)

    def functions(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the same with the gradients of the bubbles appended, (n_elements, n_q, 3, n_functions)."""
        dN, volumes = self.gradients()
        if self.has_bubbles:
            dN = np.concatenate([dN, _incompatible_gradients(KINDS[self.kind], self.points, self.rule, volumes)], axis=-1)
        return dN, volumes


@dataclass(frozen=True, kw_only=True)
class SolidSection:
    """Material, density and quadrature of the elements of a body."""

    material: Material
    density: float  # kg/m3
    integration: str = "full"  # a key of ``INTEGRATIONS``
    incompatible_modes: bool = True  # hex8 only

    def solids(self, kind: str, points: np.ndarray, temperature_rise: float | np.ndarray = 0.0) -> Solids:
        """Return elements whose nodes are at ``points`` (n_elements, n, 3) [m], with a temperature rise [K].  Local."""
        return Solids(kind, points, self.material, self.integration, self.incompatible_modes, temperature_rise)


def stiffness(of: Solids) -> np.ndarray:
    """Return the stiffness matrices of elements.

    Local.

    Returns
    -------
    K : (n_elements, 3 n, 3 n) [N/m], DOF order x, y, z of node 0, then of node 1, ...

    Raises
    ------
    ValueError : an element with det J <= 0 (``jacobian_minimum`` finds them first)

    Notes
    -----
    docs/theory.md, eq. (2.1): with Lame's constants and G_ai,bj = integral of dN_a/dx_i dN_b/dx_j,
    ``K_ai,bj = lam G_ai,bj + mu G_aj,bi + mu delta_ij G_ak,bk``; of anisotropic materials eq. (2.12).
    """
    K = np.empty((len(of.points), 3 * of.n, 3 * of.n))
    for chunk, part in of.parts(9 * of.n_functions**2):
        dN, volumes = part.functions()
        K[chunk] = condensed(part.elastic().stiffness(dN, volumes), 3 * of.n)
    return K


def mass(kind: str, points: np.ndarray, density: float, integration: str = "full") -> np.ndarray:
    """Return the consistent mass matrices of elements of one kind: entry a, b couples u_x of a and b, u_y, u_z alike.

    Local.  M_ai,bj = delta_ij M_ab; incompatible modes carry no mass.

    Parameters
    ----------
    kind, points, integration : as of ``Solids``
    density : [kg/m3]

    Returns
    -------
    M : (n_elements, n, n) [kg]
    """
    rule = rules(kind, integration)[1]
    N = KINDS[kind].values(rule.points)
    products = (N[:, :, None] * N[:, None, :]).reshape(len(N), -1)
    n_elements, n = points.shape[:2]
    M = np.empty((n_elements, n, n))
    for chunk in _chunks(n_elements, 9 * len(N)):
        _, det = _jacobians(KINDS[kind], points[chunk], rule.points)
        M[chunk] = (density * _volumes(det, rule) @ products).reshape(-1, n, n)
    return M


def jacobian_minimum(kind: str, points: np.ndarray, integration: str = "full") -> np.ndarray:
    """Return the smallest det J of each element over its quadrature points and nodes, (n_elements,) [m3].

    Local.  Not positive where an element is inverted, degenerate or bent too far.
    """
    places = np.concatenate([KINDS[kind].nodes, *(rule.points for rule in rules(kind, integration))])
    minimum = np.empty(len(points))
    for chunk in _chunks(len(points), 9 * len(places)):
        minimum[chunk] = _jacobians(KINDS[kind], points[chunk], places)[1].min(axis=1)
    return minimum


def volumes(kind: str, points: np.ndarray) -> np.ndarray:
    """Return the volumes of elements of one kind, (n_elements,) [m3].

    Local.  ``points`` is (n_elements, n, 3) [m].  Below 0 where an element is turned inside out.
    """
    rule = rules(kind, "full")[1]
    total = np.empty(len(points))
    for chunk in _chunks(len(points), 9 * len(rule.weights)):
        total[chunk] = _jacobians(KINDS[kind], points[chunk], rule.points)[1] @ rule.weights
    return total


def _chunks(n_elements: int, n_entries: int):
    """Yield slices of elements that need at most ``_CHUNK_ENTRIES`` at ``n_entries`` an element."""
    n_chunk = max(1, _CHUNK_ENTRIES // n_entries)
    for start in range(0, n_elements, n_chunk):
        yield slice(start, start + n_chunk)


def _jacobians(kind: Kind, points: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return J_ri = dx_i / dxi_r, (3, 3, n_elements, n_xi), and det J, (n_elements, n_xi)."""
    slopes = kind.derivatives(xi)
    J = np.tensordot(slopes, points, axes=(2, 1)).transpose(1, 3, 2, 0)
    J = np.ascontiguousarray(J)
    return J, sum(J[0, i] * _cofactor(J, 0, i) for i in range(3))


def _cofactor(J: np.ndarray, r: int, i: int) -> np.ndarray:
    r1, r2, i1, i2 = (r + 1) % 3, (r + 2) % 3, (i + 1) % 3, (i + 2) % 3
    return J[r1, i1] * J[r2, i2] - J[r1, i2] * J[r2, i1]


def _volumes(det: np.ndarray, rule: Rule) -> np.ndarray:
    """Return the volumes w det J of the quadrature points, (n_elements, n_q) [m3]."""
    n_bad = np.count_nonzero((det <= 0.0).any(axis=1))
    if n_bad:
        raise ValueError(f"{n_bad} of {len(det)} elements have det J <= 0, the least {det.min():.3e} m3")
    return rule.weights * det


def _gradients(kind: Kind, points: np.ndarray, rule: Rule) -> tuple[np.ndarray, np.ndarray]:
    """Return dN_a / dx_i at the quadrature points, (n_elements, n_q, 3, n), and w det J, (n_elements, n_q)."""
    J, det = _jacobians(kind, points, rule.points)
    volumes = _volumes(det, rule)
    return _transform(J, det, kind.derivatives(rule.points)), volumes


def _transform(J: np.ndarray, det: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Return (n_elements, n_q, 3, m): derivatives by x from those by xi, (n_q, 3, m), through J^-1."""
    inverse = np.empty((*det.shape, 3, 3))
    for r in range(3):
        for i in range(3):
            inverse[..., i, r] = _cofactor(J, r, i) / det
    return inverse @ slopes


def _incompatible_gradients(kind: Kind, points: np.ndarray, rule: Rule, volumes: np.ndarray) -> np.ndarray:
    """Return the gradients of the bubbles 1 - xi_k^2, (n_elements, n_q, 3, 3).

    With J of the centre, times det J_centre / det J, their integral vanishes on any hexahedron, so that constant strain
    does not excite them: the patch test holds (Taylor, Beresford and Wilson 1976).
    """
    J, det = _jacobians(kind, points, np.zeros((1, 3)))
    slopes = -2.0 * rule.points[:, :, None] * np.eye(3)
    at_centre = _transform(np.repeat(J, len(rule.weights), axis=-1), np.repeat(det, len(rule.weights), axis=1), slopes)
    return at_centre * (det * rule.weights / volumes)[:, :, None, None]


def condensed(K: np.ndarray, n_retained: int) -> np.ndarray:
    """Return the static condensation of K to its first ``n_retained`` DOFs; the others, bubbles, carry no force.  Local."""
    if K.shape[-1] == n_retained:
        return K
    a, b = slice(0, n_retained), slice(n_retained, None)
    return K[:, a, a] - K[:, a, b] @ np.linalg.solve(K[:, b, b], K[:, b, a])
