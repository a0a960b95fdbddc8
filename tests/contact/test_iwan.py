"""The four-parameter Iwan element compared with Segalman's closed forms: backbone, stiffness, slip force, loss."""

import numpy as np
import pytest

from microslip.contact.energy import pair_energy
from microslip.contact.iwan import Iwan, on_area
from microslip.contact.law import SLIP, STICK

F_S, K_T, K_N, CHI, BETA = 2.0, 5.0, 7.0, -0.6, 0.4


def law(n=1, **own):
    parameters = {"F_S": F_S, "K_T": K_T, "k_n": K_N, "chi": CHI, "beta": BETA} | own
    n_sliders = parameters.pop("n_sliders", 50)
    return Iwan(**{name: np.full(n, value) for name, value in parameters.items()}, n_sliders=n_sliders)


def backbone(u, of):
    """Return the force under increasing displacement: K_T u - R u^(chi + 2) / ((chi + 1)(chi + 2)), F_S from phi_max on."""
    chi, beta, phi_max = of.chi[0], of.beta[0], of.phi_max[0]
    R = K_T / (1.0 + beta) * (chi + 1.0) / phi_max ** (chi + 1.0)
    return np.where(u < phi_max, K_T * u - R * u ** (chi + 2.0) / ((chi + 1.0) * (chi + 2.0)), F_S)


def pushed(of, u):
    """Return the force (n,) at displacements ``u`` along x and y, applied one after the other from rest."""
    forces, before = [], np.zeros((1, 3 + of.n_memory))
    for at in u:
        before, _, state = of.step(np.array([[at, -at, 0.0]]), before)
        forces.append(before[0, :2] + K_T * np.array([at, -at]))
    return np.array(forces), state


@pytest.mark.slow
@pytest.mark.parametrize("beta", [0.0, BETA, 3.0])
@pytest.mark.parametrize("chi", [-0.9, CHI, 0.0])
def test_backbone_stiffness_and_slip_force(chi, beta):
    of = law(chi=chi, beta=beta)
    ends = of.phi_max[0] * np.concatenate([1e-3 ** np.linspace(1.0, 0.0, 50), [1.5]])
    forces, state = pushed(of, ends)
    assert np.allclose(forces[:, 0], backbone(ends, of), rtol=1e-11)  # exact at the ends of the intervals
    assert np.allclose(forces[:, 1], -forces[:, 0], rtol=1e-12)  # the directions are independent
    assert forces[-1, 0] == pytest.approx(F_S, rel=1e-12) and state[0] == SLIP
    between = of.phi_max[0] * np.linspace(0.0, 1.2, 400)
    widest = of.phi_max[0] * (1.0 - 1e-3 ** (1.0 / 49.0))
    density = K_T / (1.0 + beta) * (chi + 1.0) / of.phi_max[0] * (1.0 - widest / of.phi_max[0]) ** chi
    assert np.abs(pushed(of, between)[0][:, 0] - backbone(between, of)).max() < density * widest**2 / 8.0
    tiny = 1e-5 * of.phi_max[0]
    assert pushed(of, [tiny])[0][0, 0] == pytest.approx(K_T * tiny, rel=1e-12)


def test_loss_per_cycle_is_a_power_of_the_amplitude():
    """4 R u^(chi + 3) / ((chi + 2)(chi + 3)) below macro-slip: slope 3 + chi; the error falls as the square of the sliders."""
    errors = []
    for n_sliders in (50, 99):
        of = law(n=3, n_sliders=n_sliders)
        u = of.phi_max[0] * 1e-3 ** (np.array([7.0, 14.0, 28.0]) / 49.0)  # ends of intervals of both
        U = np.zeros((3, 3, 3))
        U[:, 0, 1] = u
        cycle = of.cycle(U, 2048, tangents=False)
        R = K_T / (1.0 + BETA) * (CHI + 1.0) / of.phi_max[0] ** (CHI + 1.0)
        exact = 4.0 * R * u ** (CHI + 3.0) / ((CHI + 2.0) * (CHI + 3.0))
        errors.append(np.abs(pair_energy(U, cycle.p) / exact - 1.0))
        assert cycle.state.tolist() == [STICK] * 3 and cycle.active.tolist() == [0, 1, 2]
    assert np.all(errors[0] < 4e-3) and np.all(errors[1] < 1.2e-3)
    slope = np.diff(np.log(pair_energy(U, cycle.p))) / np.diff(np.log(u))
    assert np.allclose(slope, 3.0 + CHI, atol=2e-3)


def test_loss_per_cycle_in_gross_slip_grows_with_the_slip_force():
    of = law(n=2)
    U = np.zeros((2, 3, 3))
    U[:, 1, 2] = of.phi_max[0] * np.array([2.0, 3.0])
    loss = pair_energy(U, of.cycle(U, 512).p)
    assert np.diff(loss)[0] == pytest.approx(4.0 * F_S * of.phi_max[0], rel=1e-3)
    assert of.cycle(U, 64).state.tolist() == [SLIP, SLIP]


def test_the_normal_direction_is_a_linear_spring():
    rng = np.random.default_rng(3)
    U = np.zeros((4, 3, 7))
    U[:, 2] = 100.0 * rng.standard_normal((4, 7))
    cycle = law(n=4).cycle(U, 32)
    assert len(cycle.active) == 0 and not cycle.p.any()
    assert np.isinf(law(n=4).slip_safety(np.abs(U).sum(axis=2))).all()
    U[:, 0] = 0.3 * rng.standard_normal((4, 7))
    cycle = law(n=4).cycle(U, 32)
    assert len(cycle.active) == 4 and not cycle.p[:, 2].any()
    assert not cycle.P[:, 14:].any() and not cycle.P[:, :, 14:].any()


def test_an_iwan_element_sticks_until_its_weakest_slider_slips():
    of = law()
    safety = of.slip_safety(np.array([[0.0, 2.0, 9.0]]))[0]
    U = np.zeros((2, 3, 3))
    U[:, 1, 1] = 2.0 * safety * np.array([0.999, 1.001])
    assert law(n=2).cycle(U, 64).active.tolist() == [1]


def test_the_slip_force_of_a_joint_is_distributed_by_area():
    area = np.array([1e-4, 3e-4])
    keys = {"slip_force": 80.0, "tangential_stiffness": 1e12, "normal_stiffness": 2e12}
    columns = on_area(keys, area)
    assert np.allclose(columns["slip_force"], [20.0, 60.0]) and np.allclose(columns["k_t"], [1e8, 3e8])


def test_iwan_parameters_out_of_range_are_rejected():
    with pytest.raises(ValueError, match="chi of pair 0 is -1, too small"):
        law(chi=-1.0)


def test_a_march_continues_unchanged_about_another_reference_state():
    of, rng = law(10), np.random.default_rng(3)
    path, before = np.cumsum(0.1 * rng.standard_normal((30, 10, 3)), axis=0), np.zeros((10, 3 + law().n_memory))
    for du in path[:15]:
        before, _, _ = of.step(du, before)
    rest, p_rest = path[14], before[:, :3]
    about_rest, after = of.about(rest, before[:, 3:]), np.zeros_like(before)
    T0 = p_rest[:, :2] + K_T * rest[:, :2]
    assert (
        about_rest.bundle.held_at_rest == pytest.approx(np.hypot(*T0.T), rel=1e-12)
        and not about_rest.keeps_half_wave_symmetry(path[0]).any()
    )
    for du in path[15:]:
        before, _, _ = of.step(du, before)
        after, _, _ = about_rest.step(du - rest, after)
        assert after[:, :3] == pytest.approx(before[:, :3] - p_rest, abs=1e-13)


def test_slip_safety_about_another_reference_state():
    of = law(2)
    before, _, _ = of.step(np.array([[0.2, 0.0, 0.0], [0.0, 0.0, 0.0]]), np.zeros((2, 3 + of.n_memory)))
    about_rest, small = of.about(np.array([[0.2, 0.0, 0.0], [0.0, 0.0, 0.0]]), before[:, 3:]), np.array([[1e-3, 0.0, 0.0]] * 2)
    assert (
        about_rest.utilisation(small)[0] > 1.1 * about_rest.utilisation(small)[1]
        and about_rest.utilisation(small)[1] == of.utilisation(small)[1]
    )
    assert about_rest.slip_safety(small)[0] < about_rest.slip_safety(small)[1] == pytest.approx(of.slip_safety(small)[1])
    assert about_rest.take([0]).w0.shape == (1, 51, 2)
