"""The theory of tangential loading is consistent, and a coarse roller on a base of another mesh is within 5 % of it."""

import numpy as np
import pytest
from cattaneo import MU, YOUNG, Case, Rings
from scipy.integrate import quad
from tangential_loading import at_rest, by_march, fitted_radius, over_theory

SPHERE, ROLLER = Case(), Case(Rings(shape="roller", rings=8, base_rings=11), "mortar")


@pytest.mark.parametrize("case", [SPHERE, ROLLER], ids=["sphere", "roller"])
@pytest.mark.parametrize("share", [0.2, 0.8])
def test_tractions_balance_the_load_and_determine_the_stick_radius(case, share):
    a, c = case.mesh.contact, case.stick_radius(share)
    around = (lambda r: 2.0) if case.is_roller else (lambda r: 2.0 * np.pi * r)
    load = quad(lambda r: case.traction(r, share) * around(r), 0.0, a, points=[c])[0]
    assert load == pytest.approx(share * MU * case.force, rel=1e-6)
    r = np.linspace(0.0, 0.99 * c, 20)
    assert fitted_radius(a, r, case.traction(r, share) / (MU * case.pressure(r))) == pytest.approx(c, rel=1e-12)


@pytest.mark.parametrize("share", [0.2, 0.8])
def test_integrated_losses_are_those_of_the_curve_of_first_loading(share):
    """For a sphere, by Masing's rule on Mindlin's displacement of the whole body."""

    def displacement(s):
        shear = 0.5 * YOUNG / (1.0 + SPHERE.poisson)
        compliance = 3.0 * (2.0 - SPHERE.poisson) / (8.0 * shear * SPHERE.mesh.contact)
        return compliance * MU * SPHERE.force * (1.0 - (1.0 - s) ** (2.0 / 3.0))

    enclosed = quad(displacement, 0.0, share)[0] - 0.5 * share * displacement(share)
    assert SPHERE.loss(share) == pytest.approx(-8.0 * MU * SPHERE.force * enclosed, rel=1e-5)


def test_a_coarse_roller_on_another_mesh_agrees_with_cattaneo(tmp_path):
    shares = (0.5, 0.8)
    contact, pushed = by_march(ROLLER, shares, tmp_path)
    assert at_rest(ROLLER, contact) == (pytest.approx(1.0, abs=0.03), pytest.approx(1.0, abs=0.03))
    for share, one in zip(shares, pushed):
        computed = over_theory(ROLLER, share, contact, one)
        assert computed.balance == pytest.approx(1.0, abs=1e-3)
        assert (computed.stick, computed.fitted) == (pytest.approx(1.0, abs=0.05), pytest.approx(1.0, abs=0.05))
        assert computed.loss == pytest.approx(1.0, abs=0.05)
        assert computed.traction < 0.05
