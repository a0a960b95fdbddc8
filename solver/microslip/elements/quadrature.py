"""Quadrature rules on the reference elements, and which of them a kind uses for stiffness and for mass.

Reference domains: [-1, 1] in every direction of squares and hexahedra; the unit triangle and tetrahedron; wedges are
the unit triangle times [-1, 1]; pyramids have the base [-1, 1]^2 and the apex (0, 0, 1).
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.special import roots_jacobi


@dataclass(frozen=True, eq=False)
class Rule:
    """Points (n_q, n_dim) and weights (n_q,), which add up to the volume of the reference element."""

    points: np.ndarray
    weights: np.ndarray


def gauss_line(n: int) -> Rule:
    """Return Gauss's rule of n points on [-1, 1], exact to degree 2 n - 1."""
    points, weights = np.polynomial.legendre.leggauss(n)
    return Rule(points[:, None], weights)


def tensor(first: Rule, second: Rule) -> Rule:
    """Return the product rule on the product of two domains."""
    n1, n2 = len(first.weights), len(second.weights)
    points = np.hstack([np.repeat(first.points, n2, axis=0), np.tile(second.points, (n1, 1))])
    return Rule(points, np.outer(first.weights, second.weights).ravel())


def square(n: int) -> Rule:
    """Return the rule of n x n points on the square."""
    return tensor(gauss_line(n), gauss_line(n))


def cube(n: int) -> Rule:
    """Return the rule of n x n x n points on the cube."""
    return tensor(square(n), gauss_line(n))


def irons14() -> Rule:
    """Return Irons' 14 points on the cube, exact to degree 5 with all weights positive."""
    a, b = np.sqrt(19.0 / 30.0), np.sqrt(19.0 / 33.0)
    axes = np.concatenate([a * np.eye(3), -a * np.eye(3)])
    corners = b * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return Rule(np.concatenate([axes, corners]), np.repeat([320.0 / 361.0, 121.0 / 361.0], [6, 8]))


def simplex(n_dim: int, *orbits: tuple[float, tuple[float, ...]]) -> Rule:
    """Return a symmetric rule on the unit simplex from orbits (weight of a point, barycentric coordinates).

    Weights are fractions of the volume; every distinct permutation of the coordinates is a point.
    """
    points, weights = [], []
    for weight, barycentric in orbits:
        permuted = sorted(set(permutations(barycentric)))
        points += [coordinates[1:] for coordinates in permuted]
        weights += [weight] * len(permuted)
    volume = 1.0 / np.prod(np.arange(1, n_dim + 1))
    return Rule(np.array(points), volume * np.array(weights))


def triangle(n: int) -> Rule:
    """Return a rule of n points on the unit triangle: 1 (degree 1), 3 (degree 2, inner points) or 6 (degree 4)."""
    if n == 1:
        return simplex(2, (1.0, (1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0)))
    if n == 3:
        return simplex(2, (1.0 / 3.0, (1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0)))
    r = np.sqrt(10.0)
    s = np.sqrt(38.0 - 44.0 * np.sqrt(2.0 / 5.0))
    q = np.sqrt(213125.0 - 53320.0 * r)
    a, b = (8.0 - r + s) / 18.0, (8.0 - r - s) / 18.0
    return simplex(2, ((620.0 + q) / 3720.0, (a, a, 1.0 - 2.0 * a)), ((620.0 - q) / 3720.0, (b, b, 1.0 - 2.0 * b)))


def collapsed(n: int) -> Rule:
    """Return a rule of n^2 points on the unit triangle, exact to degree 2 n - 2: a square with one side drawn to a point."""
    (x, y), weights = (1.0 + square(n).points.T) / 2.0, square(n).weights / 4.0
    return Rule(np.column_stack([x, y * (1.0 - x)]), weights * (1.0 - x))


def tetrahedron(n: int) -> Rule:
    """Return a rule of n points on the unit tetrahedron: 1 (degree 1), 4 (degree 2) or 14 (degree 5)."""
    if n == 1:
        return simplex(3, (1.0, (0.25, 0.25, 0.25, 0.25)))
    if n == 4:
        a = (5.0 - np.sqrt(5.0)) / 20.0
        return simplex(3, (0.25, (a, a, a, 1.0 - 3.0 * a)))
    # Two orbits of 4 and one of 6 points; the digits solve the moment equations up to degree 5.
    a, b, c = 0.31088591926330060980, 0.09273525031089122640, 0.04550370412564964949
    return simplex(
        3,
        (0.11268792571801585080, (a, a, a, 1.0 - 3.0 * a)),
        (0.07349304311636194954, (b, b, b, 1.0 - 3.0 * b)),
        (0.04254602077708146644, (c, c, 0.5 - c, 0.5 - c)),
    )


def pyramid(n: int) -> Rule:
    """Return a rule of n^3 points on the pyramid: a cube with one face drawn to the apex, Gauss-Jacobi along the axis.

    Exact for monomials x^a y^b z^c / (1 - z)^d with d <= a + b, a and b to degree 2 n - 1 and a + b - d + c to it, too.
    """
    x, weights = roots_jacobi(n, 2.0, 0.0)
    z, across = (1.0 + x) / 2.0, square(n)
    points = np.column_stack([np.kron(1.0 - z, across.points[:, 0]), np.kron(1.0 - z, across.points[:, 1]), np.repeat(z, n * n)])
    return Rule(points, np.kron(weights / 8.0, across.weights))


INTEGRATIONS = {
    "full": "stiffness of full rank; mass positive definite, exact in straight tetrahedra, prisms and parallelepipeds",
    "reduced": "hex20: stiffness 2x2x2, mass by Irons' 14 points (Ansys SOLID186); other kinds as full",
    "reduced-both": "mass by the same few points as the stiffness (CalculiX C3D20R, C3D15, C3D10, C3D6, C3D4); hex8 as full",
}

_WEDGE2, _WEDGE6 = (tensor(triangle(n), gauss_line(2)) for n in (1, 3))
_WEDGE9 = tensor(triangle(3), gauss_line(3))
# kind: rules of stiffness and mass for each of INTEGRATIONS
_RULES = {
    "hex8": [(cube(2), cube(2))] * 3,
    "hex20": [(cube(3), cube(3)), (cube(2), irons14()), (cube(2), cube(2))],
    "tet4": [(tetrahedron(1), tetrahedron(4))] * 2 + [(tetrahedron(1), tetrahedron(1))],
    "tet10": [(tetrahedron(4), tetrahedron(14))] * 2 + [(tetrahedron(4), tetrahedron(4))],
    "wedge6": [(_WEDGE6, _WEDGE6)] * 2 + [(_WEDGE2, _WEDGE2)],
    "wedge15": [(_WEDGE9, tensor(triangle(6), gauss_line(3)))] * 2 + [(_WEDGE9, _WEDGE9)],
    "pyramid5": [(pyramid(2), pyramid(2))] * 3,
    "pyramid13": [(pyramid(3), pyramid(3))] * 3,
}


def rules(kind: str, integration: str = "full") -> tuple[Rule, Rule]:
    """Return the quadrature rules of a kind for stiffness and mass.  ValueError if either name is unknown."""
    if kind not in _RULES or integration not in INTEGRATIONS:
        raise ValueError(
            f"no element {kind!r} with integration {integration!r}; there are {', '.join(_RULES)} and {', '.join(INTEGRATIONS)}"
        )
    return _RULES[kind][list(INTEGRATIONS).index(integration)]
