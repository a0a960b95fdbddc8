"""Counts and points in messages."""

import numpy as np
import pytest

from microslip.messages.words import counted, place, rounded, verb


@pytest.mark.parametrize(
    ("n", "noun", "expected"),
    [(1, "face", "1 face"), (2, "face", "2 faces"), (0, "body", "0 bodies"), (3, "batch", "3 batches"), (1, "body", "1 body")],
)
def test_counts(n, noun, expected):
    assert counted(n, noun) == expected


def test_a_point_has_no_rounding_errors_of_zero():
    assert place((1.1e-16, -0.0, -0.025)) == "(0, 0, -0.025)"
    assert place(np.array([1e-9, 0.0, 0.0])) == "(1e-09, 0, 0)"
    assert place((np.inf, 1.0, np.nan)) == "(inf, 1, nan)"


@pytest.mark.parametrize(
    ("n", "plural", "expected"),
    [
        (1, "are", "is"),
        (0, "are", "are"),
        (1, "have", "has"),
        (1, "were", "was"),
        (1, "follow", "follows"),
        (2, "belong", "belong"),
    ],
)
def test_verbs_after_counts(n, plural, expected):
    assert verb(n, plural) == expected


@pytest.mark.parametrize(
    ("value", "text"), [(1032.0, "1030"), (0.40912, "0.409"), (-5.0, "-5"), (2.5e6, "2.5e+06"), (float("inf"), "inf")]
)
def test_forces_have_three_digits_and_no_power_of_ten_below_a_million(value, text):
    assert rounded(value) == text
