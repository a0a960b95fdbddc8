"""What a log says before the levels are followed."""

import numpy as np
import pytest

from microslip.library.follow_response import _in_words


@pytest.mark.parametrize(
    "first, half, says",
    [
        (np.inf, np.inf, "no pair slips at any level"),
        (2.0, 5.0, "pairs slip from about 2 N on, half of them from 5 N"),
        (20.0, np.inf, "pairs slip from about 20 N on; the highest level is 10 N, where nothing does"),
        (-1.15e9, 14.0, "some pairs slip or are open at any level, half of them from 14 N"),
        (0.0, 1.5e-16, "half of the pairs and more slip or are open at any level"),
    ],
)
def test_from_which_levels_pairs_slip(first, half, says):
    assert _in_words(first, half, 10.0) == f"by the linear peak, {says}"
