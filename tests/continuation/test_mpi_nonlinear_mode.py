"""Nonlinear modes compared with closed forms of one mass; every test runs on any number of ranks."""

import numpy as np
import pytest
import scipy.linalg
from dense_model import reduced
from exact_jenkins import ExactJenkins
from mpi4py import MPI
from oracles import harmonic_balance, scenes

from microslip.continuation import nonlinear_mode
from microslip.continuation.corrector import BorderedSystem
from microslip.continuation.nonlinear_mode import NonlinearMode, follow_mode
from microslip.harmonic.balance import HarmonicBalance
from microslip.points.sweep import Sweep

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM = MPI.COMM_WORLD
EXACT = {  # X: omega, xi; m 1, c 0.01, k 1, k_t 0.25, limit 0.2, one harmonic
    0.8: (1.118033988750, 0.01),
    1.0: (1.102000625007, 0.056215565249),
    1.6: (1.060660171780, 0.085026359680),
    10.0: (1.004673824503, 0.033318620483),
    100.0: (1.000151466260, 0.012525724695),
}


def one_mass(**changes):
    """Return one mass on a spring and a Jenkins element: m 1, c 0.01, k 1, k_t 0.25, limit 0.2."""
    return scenes.make_system(
        "one mass",
        [[1.0]],
        [[1.0]],
        [[0, -1, -1, -1, -1, -1]],
        mu=1.0,
        N0=0.2,
        k_t=0.25,
        k_n=0.0,
        C=np.array([[0.01]]),
        loads=[{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}],
        output=[1.0],
        omega=(0.5, 2.0),
        levels={},
        **changes,
    )


def mode(system, H, n_samples, amplitudes, j=0, stop=None, tolerance=1e-11, law_of=lambda law: law):
    """Return the problem and its branch through modal amplitudes, by rising amplitude."""
    model, law = reduced(system, COMM, H)
    problem = NonlinearMode.of(HarmonicBalance.of_all(model, law_of(law), n_samples), j)
    at = tuple(np.log(amplitudes))
    return problem, follow_mode(problem, Sweep(at[0] - 0.01, np.log(stop or 1.01 * amplitudes[-1]), at), tolerance)


@pytest.mark.parametrize("n_samples", (128, pytest.param(512, marks=pytest.mark.ranks(1))))
def test_mode_of_one_mass_converges_to_the_closed_form_with_samples(n_samples):
    problem, branch = mode(one_mass(), 1, n_samples, list(EXACT))
    assert branch.failure is None
    points = [point for point in branch.points if point.requested]
    for point, (X, (omega, xi)) in zip(points, EXACT.items(), strict=True):
        assert point.parameters[0] == np.log(X)
        assert np.hypot(*point.response[0, 1:3]) == pytest.approx(X, rel=1e-9)
        assert point.omega == pytest.approx(omega, rel=1.0 / n_samples**2)
        assert -point.parameters[2] == pytest.approx(xi, rel=20.0 / n_samples**2)
    assert points[0].state.max() == 0


def test_an_amplitude_that_underflows_or_overflows_is_not_allowed():
    """A step of Newton's method may lead to any ln q; exp(-800) underflows to 0, exp(800) overflows."""
    model, law = reduced(one_mass(), COMM, 1)
    problem = NonlinearMode.of(HarmonicBalance.of_all(model, law, 64), 0)
    with np.errstate(over="ignore"):
        assert [problem.allows((log_q, 1.0, 0.0)) for log_q in (-800.0, 0.0, 800.0)] == [False, True, False]


def test_mode_of_one_mass_with_exact_coefficients_is_the_closed_form():
    _, branch = mode(one_mass(), 1, 128, list(EXACT), law_of=ExactJenkins.of)
    assert branch.failure is None
    points = [point for point in branch.points if point.requested]
    errors = [(p.omega / omega - 1.0, -p.parameters[2] / xi - 1.0) for p, (omega, xi) in zip(points, EXACT.values(), strict=True)]
    print(f"frequency and damping off by {np.abs(errors).max(axis=0)}")
    assert np.abs(errors).max() < 1e-9


def residual(system, point, n_samples, H):
    """Return |Z u + R^T f_nl| / |R^T f_nl| of a point in physical coordinates, with C + sigma M and no load; and u (n, N_H)."""
    _, omega, sigma = point.parameters
    excited = {key: value for key, value in system.items() if key != "zeta"}
    excited["C"] = scenes.damping_matrix(system) + sigma * system["M"]
    U = COMM.bcast(point.U)[..., : 2 * H + 1]
    f = harmonic_balance.contact_harmonics(U, system, n_samples)[0]
    forces = system["R"].T @ f.reshape(-1, 2 * H + 1)
    u = np.linalg.solve(harmonic_balance.dynamic_stiffness(excited, system["K"], omega, H), -forces.ravel()).reshape(forces.shape)
    return np.linalg.norm((system["R"] @ u).ravel() - U.ravel()) / np.linalg.norm(U), u


def coupled_chain():
    """The chain with one damper, whose matrix couples the modes."""
    system = {key: value for key, value in scenes.chain().items() if key != "zeta"}
    return system | {"C": np.diag([8.0] + 8 * [0.5])}


@pytest.mark.parametrize("chain, j", ((scenes.chain, 1), (coupled_chain, 2)))
def test_modes_of_a_chain_satisfy_the_equations_in_physical_coordinates(chain, j):
    """Damping with and without coupling of the modes; slip and separation; three harmonics."""
    system, H = chain() | {"sampled": True}, 3
    _, branch = mode(system, H, 128, [5e-5, 4e-4], j=j, tolerance=1e-10)
    assert branch.failure is None
    assert branch.points[0].state.max() == 0 < branch.points[-1].state.max()
    phi = scipy.linalg.eigh(scenes.stuck_stiffness(system), system["M"])[1][:, j]
    for point in branch.points[::4]:
        q = np.exp(point.parameters[0])
        unbalanced, u = residual(system, point, 128, H)
        assert unbalanced < 1e-6
        assert np.abs(phi @ system["M"] @ u[:, 1:3] / q) == pytest.approx([1.0, 0.0], abs=1e-6)


def test_real_and_imaginary_rows_share_the_derivatives_of_the_modal_coordinate(monkeypatch):
    evaluated, places, linearise, gradient = [], [], BorderedSystem.linearise, nonlinear_mode._modal_gradient
    monkeypatch.setattr(nonlinear_mode, "_modal_gradient", lambda *of: evaluated.append(of) or gradient(*of))
    monkeypatch.setattr(BorderedSystem, "linearise", lambda *of: places.append(of) or linearise(*of))
    _, branch = mode(one_mass(), 1, 128, [1.0, 1.6])
    assert branch.failure is None
    assert len(evaluated) == len(places) > 0
