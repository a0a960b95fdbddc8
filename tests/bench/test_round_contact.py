"""A coarse roller and a coarse sphere are within 3 % of Hertz, on a plane and on a base of another mesh."""

import pytest
from round_contact import Case, at_rest


@pytest.mark.parametrize(
    "case, cells",
    [
        (Case("roller"), 14),
        (Case("roller", "mortar", 11), 10),
        (Case("roller", "points", 11), 10),
        (Case("sphere"), 10),
        (Case("sphere", "mortar", 11), 8),
    ],
    ids=lambda value: f"{value.shape} {value.pairing}" if isinstance(value, Case) else "",
)
def test_contact_radius_and_pressure_agree_with_hertz(tmp_path, case, cells):
    _, force, radius, pressure = at_rest(case, cells, tmp_path)
    assert force == pytest.approx(1.0, abs=1e-4)
    assert (radius, pressure) == (pytest.approx(1.0, abs=0.03), pytest.approx(1.0, abs=0.03))
