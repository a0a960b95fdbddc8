"""Modal and structural damping compared with direct complex solutions, by every method; on one rank and on several."""

from dataclasses import replace

import numpy as np
import pytest
from bar_loads import dense, reduced_model, scene_with
from bar_scene import COARSE, COARSE_DOF, COARSE_PAIRS, EVERY_METHOD, by
from matrix_scenes import write_matrix_scene

import microslip
from microslip.fourier.amplitudes import to_complex
from microslip.library.settings import reduction_settings
from microslip.messages.errors import CaseError
from microslip.modes.eigen import first_of
from microslip.parallel.agree import on_root
from microslip.receptance.motions import output_motion
from microslip.reduction.truncation import truncation_bound

ETA = 0.03
KINDS = {
    "ratios": "ratios = [0.02, 0.001, 0.05]",
    "ratios and others": "ratios = [0.02, 0.001, 0.05]\nratio = 0.3",
    "modes": "ratio = 0.01\nmodes = [[3, 0.2], [1, 0.0]]",
    "structural": f"structural = {ETA}",
    "structural and ratio": f"structural = {ETA}\nratio = 0.01",
    "structural and rayleigh": f"structural = {ETA}\nrayleigh = [100.0, 1e-6]",
}


def ratios(kind: str) -> np.ndarray:
    """Return the ratios of the kinds above, mode by mode, as stated in the guide."""
    computed = {
        "ratios": np.full(COARSE_DOF, 0.05),
        "ratios and others": np.full(COARSE_DOF, 0.3),
        "modes": np.full(COARSE_DOF, 0.01),
    }.get(kind)
    if computed is None:
        return np.full(COARSE_DOF, 0.01 if kind == "structural and ratio" else 0.0)
    if kind == "modes":
        computed[[2, 0]] = 0.2, 0.0
    else:
        computed[:3] = 0.02, 0.001, 0.05
    return computed


def dynamic_stiffness(structure, kind: str, omega: float, n: int) -> np.ndarray:
    """Return Z_n of the stuck structure, (n_dof, n_dof), without structural damping of the joints' springs.  Collective."""
    K, M, K_J = dense(structure)
    R = structure.linearised.system.R.toarray()
    K_L = K + R.T @ K_J @ R
    omega_n, phi_owned = structure.modes.omega_n, structure.modes.phi_owned
    phi = np.concatenate(structure.comm.allgather(phi_owned))
    C = M @ phi * (2.0 * ratios(kind) * omega_n) @ phi.T @ M
    if "rayleigh" in kind:
        C = 100.0 * M + 1e-6 * K_L
    eta = ETA if "structural" in kind and n > 0 else 0.0
    return K_L - (n * omega) ** 2 * M + 1j * n * omega * C + 1j * eta * K


@pytest.mark.parametrize("kind", KINDS)
def test_every_method_meets_a_direct_solution(comm, shared_path, kind):
    scene = scene_with(comm, shared_path, damping=KINDS[kind], harmonics=2, **COARSE)
    with microslip.build(scene, comm) as structure:
        system, omega = structure.linearised.system, 1.003 * structure.modes.omega_n[0]
        p = np.random.default_rng(7).standard_normal((3 * COARSE_PAIRS, 5))
        f = np.zeros((COARSE_DOF, 5))
        f[:, 1] = system.loads.toarray()[:, 0]
        forces = to_complex(f - system.R.T @ p)
        exact = np.column_stack([np.linalg.solve(dynamic_stiffness(structure, kind, omega, n), forces[:, n]) for n in range(3)])
        exact = system.outputs @ exact
        for method, keys in EVERY_METHOD.items():
            amplitudes = to_complex(output_motion(reduced_model(structure, by(scene, method, **keys)), 1.0, omega, p))
            np.testing.assert_allclose(amplitudes, exact, rtol=0.0, atol=1e-8 * np.abs(exact).max(), err_msg=method)


def test_one_mass_on_a_lossy_spring(comm, shared_path):
    """Amplitude F / |k (1 + i eta) - m omega^2| and loss pi eta k a^2 per cycle, at any frequency."""
    k, m, eta, level = 100.0, 4.0, 0.1, 2.0
    system = {
        "K": np.array([[k]]),
        "M": np.array([[m]]),
        "zeta": 0.0,
        "pair_dofs": np.array([[0, -1, -1, -1, -1, -1]]),
        "mu": np.array([1.0]),
        "N0": np.array([1e9]),
        "k_t": np.array([0.0]),
        "k_n": np.array([0.0]),
        "separate": np.array([True]),
        "loads": [{"vector": np.array([1.0]), "harmonic": 1}],
    }

    def write():
        path = write_matrix_scene(shared_path, system, [level], (2.0, 8.0), at=(5.0,))
        path.write_text(path.read_text().replace("ratio = 0.0", f"structural = {eta}"))
        return path

    scene = microslip.read(on_root(comm, write))
    with microslip.build(scene, comm) as structure:
        response = microslip.respond(structure)
    result = response.level(level)
    omega = 2.0 * np.pi * result.frequency
    exact = level / (k * (1.0 + 1j * eta) - m * omega**2)
    np.testing.assert_allclose(response["0"].harmonic(1)[0], exact, atol=1e-12 * np.abs(exact).max())
    np.testing.assert_allclose(result.damping, np.pi * eta * k * np.abs(exact) ** 2, rtol=1e-11)
    np.testing.assert_allclose(result.input, result.damping, rtol=1e-10)
    assert np.flatnonzero(result.requested).size == 1 and np.abs(exact).max() == pytest.approx(level / (eta * k), rel=1e-3)


@pytest.mark.study
@pytest.mark.ranks(1)
def test_methods_agree_where_pairs_slip_and_the_energy_balances(comm, shared_path):
    damping = "structural = 0.004\nmodes = [[2, 0.01]]\nratio = 0.002"
    scene = scene_with(comm, shared_path, damping=damping, samples=64, tolerance=1e-10, points=4, **COARSE)
    curves = {}
    with microslip.build(scene, comm) as structure:
        frequencies = [float(structure.modes.frequency[0] * share) for share in (0.99, 1.0)]
        for method in ("receptance", "full", "rubin"):
            response = microslip.respond(
                structure, method=method, frequencies=(frequencies[0], frequencies[-1]), at=frequencies, error_bars=False
            )
            (level,) = response.results.levels
            chosen = np.flatnonzero(level.requested)
            curves[method] = level.response[chosen]
            assert (level.state[chosen] == 1).any()
            np.testing.assert_allclose(level.input, level.damping + level.friction, rtol=1e-6)
    largest = np.abs(curves["full"]).max()
    for method, each in curves.items():
        np.testing.assert_allclose(each, curves["full"], atol=1e-8 * largest, err_msg=method)


@pytest.mark.parametrize("n_modes", [4, 10])
@pytest.mark.ranks(1)
def test_the_bound_covers_the_effect_of_truncated_modes(comm, shared_path, n_modes):
    """The static part of the truncated modes has no structural damping, and the springs of the joint couple them to the others."""
    scene = scene_with(comm, shared_path, damping="structural = 0.05", **COARSE)
    with microslip.build(scene, comm) as structure:
        bound = truncation_bound(structure, reduction_settings(scene)).total[n_modes - 1]
        omegas, p = structure.modes.omega_n[0] * np.linspace(0.9, 1.1, 11), np.zeros((3 * COARSE_PAIRS, 7))
        few = replace(structure.with_modes(first_of(structure.modes, n_modes)), results={})
        exact, computed = (
            np.array([to_complex(output_motion(model, 1.0, omega, p))[0, 1] for omega in omegas])
            for model in (reduced_model(structure), reduced_model(few))
        )
    assert 0.0 < np.abs(computed - exact).max() <= bound * np.abs(exact).max()


@pytest.mark.slow
@pytest.mark.parametrize("n_modes", [6, pytest.param(12, marks=pytest.mark.ranks(1))])
def test_error_bars_include_truncated_modes_with_structural_damping(comm, shared_path, n_modes):
    """Near the resonance, where all pairs stick: the truncation error lies within the error bar, and not far within."""
    few, every = (
        scene_with(comm, shared_path, damping="structural = 0.05", **(COARSE | {"modes": m}), name=f"{m}")
        for m in (n_modes, COARSE_DOF)
    )
    values = []
    for scene in (few, every):
        with microslip.build(scene, comm) as structure:
            if not values:
                at = [float(share * structure.modes.frequency[0]) for share in (0.95, 1.0, 1.05)]
            values.append(microslip.respond(structure, levels=[1e-3], at=at, points=3))
    a, b = (response["corner"] for response in values)
    chosen = np.flatnonzero(values[0].results.levels[0].requested)
    exact = np.flatnonzero(values[1].results.levels[0].requested)
    missed = np.abs(a.harmonic(1)[0, chosen] - b.harmonic(1)[0, exact])
    assert (missed > 0.0).all() and (missed <= a.error[0, chosen]).all()
    assert (a.error[0, chosen] <= 0.1 * a.amplitude.max()).all()


MISTAKES = {
    "ratios = []": r"\[damping\] ratios = .*expected the ratios of modes",
    "ratios = [0.1, 1.5]": r"\[damping\] ratios = ",
    "modes = [[1, 0.1]]": r"\[damping\]: ratio is missing",
    "ratio = 0.1\nmodes = [[0, 0.1]]": r"\[damping\] modes = ",
    "ratio = 0.1\nmodes = [[1, 0.1], [1, 0.2]]": r"\[damping\] modes = ",
    "ratios = [0.1]\nratio = 0.1\nmodes = [[1, 0.1]]": "exactly one of ratios, modes",
    "rayleigh = [1.0, 0.0]\nratios = [0.1]": "ratios goes with ratio",
    "rayleigh = [1.0, 0.0]\nratio = 0.1": "exactly one of ratio, rayleigh is needed, found ratio and rayleigh",
    "": "exactly one of ratio, rayleigh is needed, found none",
    "structural = -0.1": r"\[damping\] structural = -0.1",
}


@pytest.mark.parametrize("damping", MISTAKES)
def test_bad_input(comm, shared_path, damping):
    with pytest.raises(CaseError, match=MISTAKES[damping]):
        scene_with(comm, shared_path, damping=damping)


@pytest.mark.ranks(1)
def test_structural_damping_has_no_equivalent_in_time(program, comm, shared_path):
    scene = scene_with(comm, shared_path, damping="structural = 0.01")
    status, _, messages = program("verify", scene.path, "--out", shared_path / "out")
    assert status == 2 and "[damping] structural: a loss factor is defined for steady vibration alone" in messages
