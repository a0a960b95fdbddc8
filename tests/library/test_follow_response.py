"""The log before the levels are followed."""

import numpy as np
import pytest

from microslip.library.follow_response import _in_words


@pytest.mark.parametrize(
    "levels, text",
    [
        ([np.inf, np.inf], "no pair slips at any level"),
        ([2.0, 5.0, 7.0], "pairs slip from about 2 N on, half of all from 5 N"),
        ([3.0, 1032.0, 2.5e4], "pairs slip from about 3 N on, half of all from 1030 N"),
        ([20.0, np.inf, np.inf], "pairs slip from about 20 N on; the highest level is 10 N, where nothing does"),
        ([-1.15e9, 3.0, 14.0, 15.0, 16.0], "pairs that slip or are open at any level: 1 of 5; the next slips from about 3 N on, half of all from 14 N"),
        ([0.0, 1.5e-16, 4.0], "pairs that slip or are open at any level: 2 of 3; the next slips from about 4 N on"),
        ([0.0, np.inf], "pairs that slip or are open at any level: 1 of 2"),
    ],
)  # fmt: skip
def test_the_log_states_the_levels_at_which_pairs_begin_to_slip(levels, text):
    assert _in_words(np.array(levels), 10.0) == f"by the linear peak, {text}"
