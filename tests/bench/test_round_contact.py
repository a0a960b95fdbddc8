"""A coarse roller and a coarse sphere come near to Hertz, on a plane and on a base of another mesh."""

import pytest
from round_contact import Case, at_rest


@pytest.mark.parametrize(
    "case, radius, pressure",
    [(Case("roller"), 0.04, 0.02), (Case("roller", "points", 11), 0.02, 0.04), (Case("sphere"), 0.03, 0.03)],
    ids=lambda value: f"{value.shape} {value.pairing}" if isinstance(value, Case) else "",
)
def test_radius_and_pressure_are_those_of_hertz(tmp_path, case, radius, pressure):
    _, force, found_radius, found_pressure = at_rest(case, 10, tmp_path)
    assert force == pytest.approx(1.0, abs=1e-4)
    assert found_radius == pytest.approx(1.0, abs=radius)
    assert found_pressure == pytest.approx(1.0, abs=pressure)
