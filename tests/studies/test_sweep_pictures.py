"""Pictures of sweeps: labels that fit, and of which designs percentiles are drawn."""

import numpy as np
import pytest

from microslip.library.design import Scatter, grid, one_by_one, scattered
from microslip.studies.sweep.pictures import _in_lines


@pytest.mark.parametrize(
    ("label", "lines"),
    [
        ("level [N]", ["level [N]"]),
        ("joints.slider.friction [× that of the scene]", ["joints.slider.friction", "[× that of the scene]"]),
        ("joints.slider.tangential_stiffness [GN/m³]", ["joints.slider.", "tangential_stiffness", "[GN/m³]"]),
    ],
)
def test_long_labels_are_broken_at_the_dot_and_the_unit(label, lines):
    assert _in_lines(label, 26).split("\n") == lines and _in_lines(label, 99) == label


def test_designed_samples_have_no_percentiles():
    values = {"level": np.array([1.0, 2.0])}
    assert not grid(values).is_random and not one_by_one(values, {"level": 1.5}).is_random
    assert scattered({"level": Scatter(1.0, 10.0, "normal")}, 4).is_random
