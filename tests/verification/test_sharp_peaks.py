"""Peaks of a few random structures compared with a fine sweep, written by tests/verification/sharp_peaks.py."""

import numpy as np
import pytest
from verification import sharp_peaks

pytestmark = pytest.mark.ranks(1)


def counts_of(number):
    """Return the counts of peaks missed in a system with 10 requested points."""
    ((few,),) = sharp_peaks.curves(7, number, [10], None, is_small=True)
    assert few.failure is None
    reference = np.loadtxt(sharp_peaks.STORED, delimiter=",")
    reference = reference[reference[:, 0] == number]
    return sharp_peaks.missing(few, [reference[reference[:, 1] == k, 2:] for k in (0, 1)])


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, pytest.param(1, marks=pytest.mark.study)])
def test_the_highest_maximum_is_located_from_few_points(number):
    """Lower maxima nearby at a corner of the sampled law are not reported; also with a fold at the top, and in wide steps."""
    n_peaks, _, below, not_located, lower = counts_of(number)
    assert n_peaks >= 5 and below > 0
    assert (not_located, lower) == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("number", [103, 114, 129, *(pytest.param(n, marks=pytest.mark.study) for n in (76, 108, 145, 155, 174))])
def test_no_peak_is_missed_where_a_search_ends_elsewhere(number):
    """The search ends at a lower maximum, at none, or near a higher one; or no point is a maximum and the curve folds."""
    n_peaks, *_, not_located, lower = counts_of(number)
    assert n_peaks >= 4 and (not_located, lower) == (0, 0)


@pytest.mark.slow
def test_no_peak_is_missed_where_planes_across_the_curve_lead_to_its_other_side():
    """The curve folds twice about the top, and three parts of it have the same frequencies."""
    n_peaks, *_, not_located, _ = counts_of(91)
    assert n_peaks >= 10 and not_located == 0


@pytest.mark.slow
@pytest.mark.parametrize("number", [154, pytest.param(36, marks=pytest.mark.study)])
def test_no_part_of_a_curve_is_passed_over_at_a_corner(number):
    """Where short steps fail at one, longer ones lead out of the range, or past a fold at first slip."""
    (few,), (dense,) = sharp_peaks.curves(7, number, [30], 150, is_small=True, samples=1024)
    assert few.failure is None and dense.failure is None
    n_peaks, *_, not_located, _ = sharp_peaks.missing(few, sharp_peaks.peaks_of_outputs(dense))
    assert n_peaks >= 8 and not_located == 0


@pytest.mark.slow
def test_a_narrow_maximum_at_a_corner_is_listed_for_both_outputs():
    """Next to a wider one, 1 % lower: the points of the curve show the narrow one for output 0 alone."""
    ((few,),) = sharp_peaks.curves(7, 3024, [30], None, is_small=True, samples=1024)
    at_corner = [peak for peak in few.peaks if abs(peak.omega - 2.8754645) < 1e-6]
    assert [peak.output for peak in at_corner] == [0, 1]
    assert [abs(peak.amplitude) for peak in at_corner] == pytest.approx([0.0086774, 0.0192432], rel=1e-5)
