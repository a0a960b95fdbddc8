"""Scenes with rough surfaces and with an Iwan joint, from their files to the branch, compared with populations marched in time."""

import numpy as np
import pytest
from matrix_scenes import branches_of, requested, write_matrix_scene
from mpi4py import MPI
from oracles import populations, scenes

import microslip
from microslip.points.error_parts import PARTS, total

HERE = MPI.COMM_SELF
H = 9
LAWS = {
    "exponential": ('law = "rough"', lambda mu, N0, k_t, k_n: populations.rough(mu, N0, k_t, k_n, np.inf)),
    "power": ('law = "rough"\nexponent = 2.0', lambda mu, N0, k_t, k_n: populations.rough(mu, N0, k_t, k_n, 2.0)),
    "iwan": ('law = "iwan"\nchi = -0.5\nbeta = 0.4', lambda mu, N0, k_t, k_n: populations.iwan(mu * N0, k_t, k_n, -0.5, 0.4)),
}

MORE = (("exponential", 0.25), ("power", 0.8))


def parameters_of_laws(name):
    """Return the laws as parameters; `make studies` runs the others, which differ only in the weights of their sliders."""
    return [pytest.param(law, marks=() if law == name else pytest.mark.study) for law in LAWS]


def damped_mass():
    """Return the spatial mass with a plain damping matrix, so that a march needs few periods."""
    system = {key: value for key, value in scenes.spatial_mass().items() if key not in ("zeta", "rayleigh")}
    return system | {"C": 0.25 * np.eye(3)}


def load(system, level):
    """Return the load (3,) as a function of the phase of the excitation."""

    def at(t):
        return level * sum(
            np.array(entry["vector"]) * np.cos(entry["harmonic"] * t + entry.get("phase", 0.0)) for entry in system["loads"]
        )

    return at


@pytest.mark.parametrize(
    "name, level", [("exponential", 0.8), ("iwan", 0.8), *(pytest.param(*of, marks=pytest.mark.study) for of in MORE)]
)
def test_a_branch_agrees_with_the_march_in_time(tmp_path, name, level):
    system, omega = damped_mass(), 1.2
    settings, population = LAWS[name]
    path = write_matrix_scene(tmp_path, system, [level], (0.9, 1.5), at=[omega], points=20, harmonics=H, samples=128)
    path.write_text(path.read_text().replace('friction_limit = "circle"', settings))
    (branch,) = branches_of(path, HERE)
    (point,) = requested(branch)
    mu, N0, k_t, k_n = (float(system[key][0]) for key in ("mu", "N0", "k_t", "k_n"))
    march = populations.steady_state(
        system["M"], system["C"], system["K"], load(system, level), omega, population(mu, N0, k_t, k_n), 600, 14
    )
    wave = (point.response @ scenes.harmonic_basis(H, len(march))).T
    assert np.abs(wave - march).max() < 8e-3 * np.abs(march).max()
    assert point.energy[0] > 0.0


def two_masses():
    """Return two masses of three DOFs on three rough pairs, the second of which has a small pressure at rest."""
    rng, soft = np.random.default_rng(4), np.diag([0.6, 0.8, 0.5] * 2)
    link = 0.4 * np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(3))
    tilt = 0.05 * rng.standard_normal((6, 6))
    return scenes.make_system(
        "two masses",
        np.diag([1.0, 1.2, 0.9, 0.8, 1.1, 1.0]),
        soft + link + tilt + tilt.T,
        [[0, 1, 2, -1, -1, -1], [3, 4, 5, -1, -1, -1], [0, 1, 2, 3, 4, 5]],
        mu=[0.4, 0.5, 0.3],
        N0=[1.0, 0.01, 0.3],
        k_t=[1.5, 0.15, 0.8],
        k_n=[2.0, 0.2, 1.1],
        C=0.25 * np.eye(6),
        loads=[
            {"vector": [0.6, 0.0, 0.2, 0.0, 0.5, 0.5], "harmonic": 1},
            {"vector": [0.0, 0.5, 0.0, 0.4, 0.0, -0.2], "harmonic": 1, "phase": np.pi / 3},
            {"vector": [0.0, 0.0, 0.0, 0.0, 0.0, -0.2], "harmonic": 0},
        ],
        output=np.eye(6)[3],
        omega=(0.7, 1.3),
        levels={},
    )


@pytest.mark.study
def test_pairs_pressed_to_many_times_their_preload_agree_with_the_march_in_time(tmp_path):
    """6 DOF, 3 pairs, power 2, one pressed to more than 100 times its preload.  Error bars are valid, mostly due to the sliders."""
    system, omega, level = two_masses(), 1.0, 1.5
    path = write_matrix_scene(
        tmp_path, system, [level], (0.8, 1.2), at=[omega], outputs=[3, 5], points=10, harmonics=15, samples=256
    )
    path.write_text(path.read_text().replace('friction_limit = "circle"', LAWS["power"][0]))
    with microslip.build(microslip.read(path), HERE) as structure:
        (computed,) = microslip.respond(structure).results.levels
    ((response,), (bar,)) = computed.response[computed.requested > 0], total(computed.error[computed.requested > 0])
    of_pairs = zip(*(system[key].tolist() for key in ("mu", "N0", "k_t", "k_n")), (600, 1200, 600), (12.0, 60.0, 20.0))
    law = populations.on_pairs(system["R"], [populations.rough(*four, 2.0, n, most) for *four, n, most in of_pairs])
    march = populations.steady_state(system["M"], system["C"], system["K"], load(system, level), omega, law, 600, 16)
    approach = -(march @ system["R"].T).reshape(-1, 3, 3)[:, :, 2].min(axis=0)
    pressed = (1.0 + approach * system["k_n"] / 2.0 / system["N0"]) ** 2
    assert 100.0 < pressed[1] < 900.0 and pressed[0] < 49.0 and pressed[2] < 121.0, pressed
    wave = (response @ scenes.harmonic_basis(15, len(march))).T
    assert np.abs(wave - march[:, [3, 5]]).max() < 8e-3 * np.abs(march[:, [3, 5]]).max()
    first = march[:, [3, 5]].T @ np.exp(-2j * np.pi * np.arange(len(march)) / len(march)) * 2.0 / len(march)
    assert np.all(np.abs(response[:, 1] - 1j * response[:, 2] - first) < bar + 5e-4 * np.abs(first))


@pytest.mark.slow
@pytest.mark.parametrize("name", parameters_of_laws("power"))
def test_error_bars_bound_the_effect_of_harmonics_and_samples(tmp_path, name):
    """The sum of the parts is close to the error; both with the elements that represent a population in the scene."""
    at = [1.0, 1.15, 1.3, 1.5]
    path = write_matrix_scene(
        tmp_path, damped_mass(), [0.8], (0.95, 1.55), at=at, points=10, harmonics=3, samples=64, outputs=[0, 2]
    )
    path.write_text(path.read_text().replace('friction_limit = "circle"', LAWS[name][0]))
    with microslip.build(microslip.read(path), HERE) as structure:
        coarse = microslip.respond(structure).results.levels[0]
        fine = microslip.respond(structure, harmonics=11, samples=256, error_bars=False).results.levels[0]
    (U, bars), (exact, _) = (
        ((level.response[..., 1] - 1j * level.response[..., 2])[level.requested > 0], level.error) for level in (coarse, fine)
    )
    true, parts = np.abs(U - exact), bars[coarse.requested > 0]
    assert len(U) == len(exact) == len(at)
    assert np.all(true < total(parts)) and 0.5 < np.median(true / parts.sum(axis=-1)) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("name", parameters_of_laws("iwan"))
def test_error_bars_include_the_number_of_sliders(tmp_path, name):
    """That part is close to the change by many more elements."""
    at = [1.0, 1.15, 1.3, 1.5]
    path = write_matrix_scene(
        tmp_path, damped_mass(), [0.8], (0.95, 1.55), at=at, points=10, harmonics=5, samples=64, outputs=[0, 2]
    )
    text, computed = path.read_text(), []
    for sliders in (8, 96):
        path.write_text(text.replace('friction_limit = "circle"', f"{LAWS[name][0]}\nsliders = {sliders}"))
        with microslip.build(microslip.read(path), HERE) as structure:
            (level,) = microslip.respond(structure).results.levels
        computed.append([values[level.requested > 0] for values in (level.response, level.error)])
    (coarse, parts), (fine, _) = computed
    true = np.abs((coarse - fine)[..., 1] - 1j * (coarse - fine)[..., 2])
    part = parts[..., PARTS.index("sliders")]
    assert np.all(true < total(parts)) and 0.5 < np.median(part / true) < 2.0, part / true
    assert np.median(true) > 1e-4 * np.abs(fine).max()


@pytest.mark.parametrize("name, law", [("iwan", "chi = -0.5\nbeta = 0.4\nsliders = 400"), ("rough", "sliders = 300")])
def test_a_constant_load_has_the_closed_form_displacement(tmp_path, name, law):
    """K u + T(u) = f along x, K u + f_z(u) = f along z: one step of loading from rest."""
    mu, N0, k_t, k_n = 0.4, 1.0, 1.5, 2.5
    along_x, along_z = {"vector": [0.5, 0.0, 0.0], "harmonic": 0}, {"vector": [0.0, 0.0, 0.6], "harmonic": 0}
    system = damped_mass() | {"K": np.diag([1.0, 1.0, 0.7])}
    for load_case, dof in ((along_x, 0), (along_z, 2)):
        path = write_matrix_scene(
            tmp_path, system | {"loads": [load_case]}, [1.0], (0.8, 1.6), outputs=[dof], points=4, harmonics=0, samples=64
        )
        path.write_text(path.read_text().replace('friction_limit = "circle"', f'law = "{name}"\n{law}'))
        (branch,) = branches_of(path, HERE)
        u, force = branch.points[0].response[0, 0], load_case["vector"][dof]
        if dof == 2:
            carried = k_n * u if name == "iwan" else N0 - N0 * np.exp(-k_n * u / N0)
        elif name == "rough":
            carried = mu * N0 * (1.0 - np.exp(-k_t * u / (mu * N0)))
        else:
            phi_max = mu * N0 * 1.4 / (k_t * (0.4 + 0.5 / 1.5))
            carried = k_t * u - k_t / 1.4 * 0.5 / phi_max**0.5 * u**1.5 / (0.5 * 1.5)
            assert 0.0 < u < phi_max
        assert system["K"][dof, dof] * u + carried == pytest.approx(force, rel=1e-4 if dof == 0 else 1e-7)
