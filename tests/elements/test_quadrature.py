"""Quadrature rules integrate polynomials up to their degree."""

from itertools import product
from math import factorial

import numpy as np
import pytest

from microslip.elements import INTEGRATIONS, KINDS, quadrature


def on_simplex(exponent):
    return np.prod([factorial(e) for e in exponent]) / factorial(sum(exponent) + len(exponent))


def on_cube(exponent):
    return np.prod([0.0 if e % 2 else 2.0 / (e + 1) for e in exponent])


def on_wedge(exponent):
    return on_simplex(exponent[:2]) * on_cube(exponent[2:])


def on_pyramid(exponent):
    """Return the integral over a pyramid, whose section shrinks as 1 - z."""
    a, b, c = exponent
    return on_cube((a, b)) * factorial(c) * factorial(a + b + 2) / factorial(a + b + c + 3)


RULES = {
    "triangle 1": (quadrature.triangle(1), 1, on_simplex),
    "triangle 3": (quadrature.triangle(3), 2, on_simplex),
    "triangle 6": (quadrature.triangle(6), 4, on_simplex),
    "tetrahedron 1": (quadrature.tetrahedron(1), 1, on_simplex),
    "tetrahedron 4": (quadrature.tetrahedron(4), 2, on_simplex),
    "tetrahedron 14": (quadrature.tetrahedron(14), 5, on_simplex),
    "Irons 14": (quadrature.irons14(), 5, on_cube),
    "cube 2": (quadrature.cube(2), 3, on_cube),
    "cube 3": (quadrature.cube(3), 5, on_cube),
    "square 3": (quadrature.square(3), 5, on_cube),
    "pyramid 2": (quadrature.pyramid(2), 3, on_pyramid),
    "pyramid 3": (quadrature.pyramid(3), 5, on_pyramid),
    "wedge 18": (quadrature.tensor(quadrature.triangle(6), quadrature.gauss_line(3)), 4, on_wedge),
}


@pytest.mark.parametrize("name", RULES)
def test_a_rule_is_exact_only_up_to_its_degree(name):
    rule, degree, exact = RULES[name]
    assert (rule.weights > 0.0).all()
    errors = np.zeros(degree + 2)
    for exponent in product(range(degree + 2), repeat=rule.points.shape[1]):
        if sum(exponent) <= degree + 1:
            error = abs(rule.weights @ np.prod(rule.points**exponent, axis=1) - exact(exponent))
            errors[sum(exponent)] = max(errors[sum(exponent)], error)
    assert errors[:-1].max() < 1e-14
    assert errors[-1] > 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_rules_for_every_integration(kind):
    volume = {"hex": 8.0, "tet": 1.0 / 6.0, "wedge": 1.0, "pyramid": 4.0 / 3.0}[kind.rstrip("0123456789")]
    for integration in INTEGRATIONS:
        for rule in quadrature.rules(kind, integration):
            assert rule.weights.sum() == pytest.approx(volume, rel=1e-14)


@pytest.mark.parametrize("kind, integration", [("hex27", "full"), ("hex8", "selective")])
def test_unknown_names_are_refused_with_the_known_ones(kind, integration):
    with pytest.raises(ValueError, match="pyramid13 and full, reduced, reduced-both"):
        quadrature.rules(kind, integration)
