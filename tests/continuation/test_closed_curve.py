"""Detection of a branch that follows a closed curve, and of one that only folds."""

from types import SimpleNamespace

import numpy as np
import pytest

from microslip.continuation.closed_curve import AGAIN, ROUNDS, goes_round


def points(omega, size):
    """Return points of one pair whose mean drifts."""
    U = np.zeros((len(omega), 1, 3, 3))
    U[:, 0, 0, 0], U[:, 0, 0, 1] = np.arange(len(omega)), size
    return [SimpleNamespace(omega=w, parameters=(), U=u) for w, u in zip(omega, U)]


@pytest.mark.parametrize("step", (0.3, -0.37))
@pytest.mark.parametrize("more", (0, 4))
def test_a_circle_is_detected_after_some_rounds(step, more):
    """The rounds have different points, and every other point has ``more`` additional coefficients."""
    angle = step * np.arange(150)
    curve = points(1.0 + 0.1 * np.cos(angle), 2.0 + np.sin(angle))
    for point in curve[::2]:
        point.U = np.pad(point.U, [(0, 0), (0, 0), (0, more)])
    ends = [n for n in range(len(curve)) if goes_round(curve[: n + 1])]
    rounds = ROUNDS * 2.0 * np.pi
    assert rounds < abs(angle[ends[0]]) < rounds + abs(step) * 4 * AGAIN


def test_a_curve_with_folds_is_not_detected_as_closed():
    """Even where its upper part is close to its lower part."""
    t = np.linspace(0.0, 1.0, 80)
    omega = t + 0.3 * np.sin(2.0 * np.pi * t)
    assert np.diff(omega).min() < 0.0
    curve = points(omega, 0.4 * t)
    assert not any(goes_round(curve[: n + 1]) for n in range(len(curve)))
