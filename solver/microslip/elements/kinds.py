"""Element and face kinds: nodes, shape functions and faces.

Node order is the one that VTK, meshio and Abaqus share. Shape functions are polynomials, in pyramids divided by powers of the
distance from the apex: each kind lists the monomials that span them, and the condition N_a(x_b) = delta_ab at the nodes gives
the coefficients.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np


@dataclass(frozen=True, eq=False)
class Kind:
    """Shape functions N_a of one kind of element (or face) in reference coordinates xi, and its faces."""

    name: str
    nodes: np.ndarray  # (n_nodes, n_dim) reference coordinates of the nodes
    exponents: np.ndarray  # (n_nodes, n_dim) monomials that span the shape functions
    n_corners: int
    faces: tuple[tuple[str, np.ndarray], ...] = ()  # (face kind, local nodes); corners turn left seen from outside
    coefficients: np.ndarray = field(init=False)  # (n_nodes, n_nodes) N_a = sum_k monomial_k coefficients[k, a]

    def __post_init__(self):
        vandermonde = self._monomials(self.nodes)
        # All coefficients are multiples of 1/8: rounding to them takes the inversion's round-off away.
        object.__setattr__(self, "coefficients", np.round(8.0 * np.linalg.inv(vandermonde)) / 8.0)

    @property
    def n_nodes(self) -> int:
        """The number of nodes of an element."""
        return len(self.nodes)

    def values(self, xi: np.ndarray) -> np.ndarray:
        """Return N_a at the points xi (n_points, n_dim): (n_points, n_nodes)."""
        return self._monomials(xi) @ self.coefficients

    def _monomials(self, xi: np.ndarray) -> np.ndarray:
        return _monomials_at(xi, self.exponents)

    def derivatives(self, xi: np.ndarray) -> np.ndarray:
        """Return dN_a / dxi_r at the points xi (n_points, n_dim): (n_points, n_dim, n_nodes)."""
        slopes = []
        for r, exponent in enumerate(self.exponents.T):
            lowered = self.exponents.copy()
            lowered[:, r] = np.maximum(exponent - 1, 0)
            slopes.append((exponent * _monomials_at(xi, lowered)) @ self.coefficients)
        return np.stack(slopes, axis=1)

    def second_derivatives(self, xi: np.ndarray) -> np.ndarray:
        """Return d2N_a / dxi_r dxi_s at the points xi (n_points, n_dim): (n_points, n_dim, n_dim, n_nodes)."""
        n_dim = self.nodes.shape[1]
        curved = np.zeros((len(xi), n_dim, n_dim, self.n_nodes))
        for r, s in product(range(n_dim), repeat=2):
            factor, lowered = np.ones(self.n_nodes), self.exponents.copy()
            for axis in (r, s):
                factor = factor * lowered[:, axis]
                lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
            if factor.any():
                curved[:, r, s] = (factor * _monomials_at(xi, lowered)) @ self.coefficients
        return curved


@dataclass(frozen=True, eq=False)
class Pyramid(Kind):
    """Shape functions spanned by monomials over powers of 1 - zeta, on the pyramid of base [-1, 1]^2 and apex (0, 0, 1).

    On each face they are those of the face's kind, so that pyramids fit to hexahedra, wedges and tetrahedra (Bedrosian 1992).
    At the apex the derivatives are those on the axis.
    """

    poles: tuple[int, ...] = ()  # (n_nodes,) powers of 1 / (1 - zeta)

    def _monomials(self, xi: np.ndarray) -> np.ndarray:
        return _monomials_at(xi, self.exponents) * _from_apex(xi) ** -np.array(self.poles, dtype=float)

    def derivatives(self, xi: np.ndarray) -> np.ndarray:
        """Return dN_a / dxi_r at the points xi (n_points, 3): (n_points, 3, n_nodes)."""
        pole, distance, slopes = np.array(self.poles, dtype=float), _from_apex(xi), []
        for r, exponent in enumerate(self.exponents.T):
            lowered = self.exponents.copy()
            lowered[:, r] = np.maximum(exponent - 1, 0)
            slope = exponent * _monomials_at(xi, lowered) * distance**-pole
            if r == 2:
                slope = slope + pole * _monomials_at(xi, self.exponents) * distance ** -(pole + 1.0)
            slopes.append(slope @ self.coefficients)
        return np.stack(slopes, axis=1)


def _from_apex(xi: np.ndarray) -> np.ndarray:
    """Return 1 - zeta, (n_points, 1), a little more than 0 at the apex, where it divides zeros."""
    return np.maximum(1.0 - xi[:, 2:], 1e-100)


def _monomials_at(xi: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """Return the monomials of exponents 0 to 2 at the points xi (n_points, n_dim): (n_points, n_monomials)."""
    powers = np.stack([np.ones_like(xi), xi, xi * xi])
    values = powers[exponents[:, 0], :, 0]
    for axis in range(1, exponents.shape[1]):
        values = values * powers[exponents[:, axis], :, axis]
    return values.T


def _with_mid_sides(corners, edges) -> np.ndarray:
    """Return corners and the middles of the edges as one (n_nodes, n_dim) array."""
    corners = np.array(corners, dtype=float)
    middles = corners[np.array(edges, dtype=int).reshape(-1, 2)].mean(axis=1)
    return np.concatenate([corners, middles])


def _monomials(n_dim: int, accepts) -> np.ndarray:
    """Return the exponents from {0, 1, 2} ^ n_dim for which ``accepts`` returns True."""
    return np.array([exponent for exponent in product(range(3), repeat=n_dim) if accepts(*exponent)])


def _serendipity(*exponent) -> bool:
    """Return whether a monomial's degree, linear factors not counted, is at most 2 (hex20, quad8)."""
    return sum(e for e in exponent if e > 1) <= 2


def _multilinear(*exponent) -> bool:
    return max(exponent) <= 1


def _faces(corners: Sequence[tuple[int, ...]], n_corners: int = 0, edges: Sequence = ()) -> tuple[tuple[str, np.ndarray], ...]:
    """Return kind and local nodes of each face from its corners; with the edges of the cell also their mid-side nodes."""
    middle_of = {frozenset(edge): n_corners + i for i, edge in enumerate(edges)}
    faces = [(*face, *(middle_of[frozenset(side)] for side in zip(face, face[1:] + face[:1]) if edges)) for face in corners]
    return tuple((_FACE_OF[len(face)], np.array(face)) for face in faces)


_FACE_OF = {3: "tri3", 4: "quad4", 6: "tri6", 8: "quad8"}  # kind by the number of nodes
_SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
_SQUARE_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0)]
_TRIANGLE = [(0, 0), (1, 0), (0, 1)]
_TRIANGLE_EDGES = [(0, 1), (1, 2), (2, 0)]
_HEXAHEDRON = [(x, y, z) for z in (-1, 1) for x, y in _SQUARE]
_HEXAHEDRON_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
_HEXAHEDRON_FACES = [(0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)]
_TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
_TETRAHEDRON_EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
_TETRAHEDRON_FACES = [(0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)]
_PYRAMID = [*((x, y, 0) for x, y in _SQUARE), (0, 0, 1)]
_PYRAMID_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)]
_PYRAMID_FACES = [(0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
_WEDGE = [(x, y, z) for z in (-1, 1) for x, y in _TRIANGLE]
_WEDGE_EDGES = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]
_WEDGE_FACES = [(0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)]

FACE_KINDS = {
    kind.name: kind
    for kind in (
        Kind("quad4", _with_mid_sides(_SQUARE, []), _monomials(2, _multilinear), 4),
        Kind("quad8", _with_mid_sides(_SQUARE, _SQUARE_EDGES), _monomials(2, _serendipity), 4),
        Kind("tri3", _with_mid_sides(_TRIANGLE, []), _monomials(2, lambda x, y: x + y <= 1), 3),
        Kind("tri6", _with_mid_sides(_TRIANGLE, _TRIANGLE_EDGES), _monomials(2, lambda x, y: x + y <= 2), 3),
    )
}

KINDS = {
    kind.name: kind
    for kind in (
        Kind("hex8", _with_mid_sides(_HEXAHEDRON, []), _monomials(3, _multilinear), 8, _faces(_HEXAHEDRON_FACES)),
        Kind(
            "hex20",
            _with_mid_sides(_HEXAHEDRON, _HEXAHEDRON_EDGES),
            _monomials(3, _serendipity),
            8,
            _faces(_HEXAHEDRON_FACES, 8, _HEXAHEDRON_EDGES),
        ),
        Kind(
            "tet4",
            _with_mid_sides(_TETRAHEDRON, []),
            _monomials(3, lambda x, y, z: x + y + z <= 1),
            4,
            _faces(_TETRAHEDRON_FACES),
        ),
        Kind(
            "tet10",
            _with_mid_sides(_TETRAHEDRON, _TETRAHEDRON_EDGES),
            _monomials(3, lambda x, y, z: x + y + z <= 2),
            4,
            _faces(_TETRAHEDRON_FACES, 4, _TETRAHEDRON_EDGES),
        ),
        # Nodes 3, 4, 5 lie on the side that the right-hand rule gives 0, 1, 2, as in Abaqus and meshio files (VTK's
        # documentation states the opposite, its shape functions agree).
        Kind(
            "wedge6", _with_mid_sides(_WEDGE, []), _monomials(3, lambda x, y, z: x + y <= 1 and z <= 1), 6, _faces(_WEDGE_FACES)
        ),
        Kind(
            "wedge15",
            _with_mid_sides(_WEDGE, _WEDGE_EDGES),
            _monomials(3, lambda x, y, z: x + y + max(z - 1, 0) <= 2),
            6,
            _faces(_WEDGE_FACES, 6, _WEDGE_EDGES),
        ),
        Pyramid(
            "pyramid5",
            _with_mid_sides(_PYRAMID, []),
            np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)]),
            5,
            _faces(_PYRAMID_FACES),
            poles=(0, 0, 0, 0, 1),
        ),
        Pyramid(
            "pyramid13",
            _with_mid_sides(_PYRAMID, _PYRAMID_EDGES),
            np.array([*_monomials(3, lambda x, y, z: x + y + z <= 2), (1, 1, 0), (2, 1, 0), (1, 2, 0)]),
            5,
            _faces(_PYRAMID_FACES, 5, _PYRAMID_EDGES),
            poles=(0,) * 10 + (1, 1, 1),
        ),
    )
}
