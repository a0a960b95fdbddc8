"""Peaks of a few random structures beside those of a fine sweep, which tests/verification/sharp_peaks.py has written."""

import numpy as np
import pytest
from verification import sharp_peaks

pytestmark = pytest.mark.ranks(1)


def counts_of(number):
    """Return what is missing of the peaks of a system with 10 requested points."""
    ((few,),) = sharp_peaks.curves(7, number, [10], None, is_small=True)
    assert few.failure is None
    of = np.loadtxt(sharp_peaks.STORED, delimiter=",")
    of = of[of[:, 0] == number]
    return sharp_peaks.missing(few, [of[of[:, 1] == k, 2:] for k in (0, 1)])


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, pytest.param(1, marks=pytest.mark.study)])
def test_the_highest_maximum_is_located_from_few_points(number):
    """Not a lower one beside it, at a corner of the sampled law; also where the curve turns back at its top, and in wide steps."""
    n_peaks, _, below, not_located, lower = counts_of(number)
    assert n_peaks >= 5 and below > 0
    assert (not_located, lower) == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("number", [103, 114, 129, *(pytest.param(n, marks=pytest.mark.study) for n in (76, 108, 145, 155, 174))])
def test_no_peak_is_lost_where_a_search_ends_elsewhere(number):
    """At a lower maximum, at none, or beside a higher one; where no point is a maximum, the curve turns much or goes to a closed one."""
    n_peaks, *_, not_located, lower = counts_of(number)
    assert n_peaks >= 4 and (not_located, lower) == (0, 0)


@pytest.mark.slow
def test_no_peak_is_lost_where_planes_across_the_curve_lead_to_its_other_side():
    """The curve turns back twice about the top, and three parts of it have the same frequencies."""
    n_peaks, *_, not_located, _ = counts_of(91)
    assert n_peaks >= 10 and not_located == 0
