"""Structures without supports: rigid-body motion is part of the response, and exact."""

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from bar_loads import dense, scene_with
from bar_scene import N_DOF, by
from lattices import softly_held_truss
from matrix_scenes import branches_of, requested, write_matrix_scene
from mpi4py import MPI
from oracles.scenes import joint_stiffness, make_system
from scene_text import support

import microslip
from microslip.fourier.amplitudes import to_complex
from microslip.library.follow_response import follow
from microslip.library.prepare import prepare
from microslip.messages.errors import CaseError
from microslip.modes.lapack import gathered
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.receptance.motions import ActingForces

comm = MPI.COMM_WORLD
ON_ONE = pytest.mark.ranks(1)
ELASTIC = 2236.0  # rad/s, the lowest elastic mode of the truss
SUPPORT = support("ground_base")
FORCE = np.array([1.0, 0.3, 0.2]) / np.linalg.norm([1.0, 0.3, 0.2])


def free_bar(folder, *changes, name="free", **keys):
    """Return the scene of the bar on its plate without supports, with replaced texts.  Collective."""
    held = f"{name}_held"  # a separate file, because other ranks may still read the first
    scene_with(comm, folder, name=held, **keys)

    def write():
        text = (folder / f"{held}.toml").read_text()
        for old, new in ((SUPPORT, ""), *changes):
            assert old in text
            text = text.replace(old, new)
        path = folder / f"{name}.toml"
        path.write_text(text)
        return path

    return microslip.read(on_root(comm, write))


# -- two masses and a slider, in closed form -----------------------------------------------------------------------

M_1, M_2, K_T, MU_N = 0.8, 1.7, 4.0e5, 30.0


def sliding_stiffness(a):
    """Return f_1 / z_1 of a Jenkins element at amplitude a, complex: its describing function."""
    if a <= MU_N / K_T:
        return K_T + 0j
    theta = np.arccos(1.0 - 2.0 * MU_N / (K_T * a))
    return K_T / np.pi * (theta - np.sin(theta) * np.cos(theta)) + 4j * MU_N * (a - MU_N / K_T) / (np.pi * a**2)


def motions_of_masses(F, omega):
    """Return the amplitudes of both masses, complex: m_1 u_1'' + f = F cos, m_2 u_2'' - f = 0, f of the difference."""
    inverse = 1.0 / M_1 + 1.0 / M_2

    def excess(a):
        return abs(1.0 - sliding_stiffness(a) * inverse / omega**2) * a - F / (M_1 * omega**2)

    upper = 1e-9
    while excess(upper) < 0.0:
        upper *= 2.0
    a = scipy.optimize.brentq(excess, 0.0, upper, xtol=1e-16, rtol=1e-14)
    z = -F / (M_1 * omega**2) / (1.0 - sliding_stiffness(a) * inverse / omega**2)
    f = sliding_stiffness(a) * z
    return (f - F) / (M_1 * omega**2), -f / (M_2 * omega**2)


@pytest.mark.parametrize("level", [10.0, 400.0])
@pytest.mark.ranks(1)
def test_two_free_masses_with_a_slider(tmp_path, level):
    """One harmonic, stuck and slipping: the program agrees with the describing function within the error of samples."""
    resonance = np.sqrt(K_T * (1.0 / M_1 + 1.0 / M_2))
    omega = resonance * np.array([0.5, 0.7, 1.6])
    system = make_system(
        "two free masses",
        np.diag([M_1, M_2]),
        np.zeros((2, 2)),
        [[0, -1, -1, 1, -1, -1]],
        mu=1.0,
        N0=MU_N,
        k_t=K_T,
        k_n=1e6,
        loads=[{"harmonic": 1, "vector": np.array([1.0, 0.0])}],
        output=[1.0, 0.0],
        omega=(omega[0], omega[-1]),
        levels=[level],
        zeta=0.0,
    )
    folder = comm.bcast(tmp_path)
    options = {"at": omega, "harmonics": 1, "samples": 4096, "error_bars": False, "points": 20}
    path = on_root(comm, lambda: write_matrix_scene(folder, system, [level], system["omega"], **options))
    (branch,) = branches_of(path, comm)
    for point, w in zip(requested(branch), omega, strict=True):
        solved, exact = to_complex(point.response)[:, 1], np.array(motions_of_masses(level, w))
        np.testing.assert_allclose(solved, exact, rtol=0, atol=3e-6 * abs(exact).max())
    slips = [abs(np.subtract(*motions_of_masses(level, w))) > 2.0 * MU_N / K_T for w in omega]
    assert any(slips) == (level > 100.0)


# -- a bar on a plate, both free -----------------------------------------------------------------------------------


def exact_amplitudes(structure, omega, zeta, n_rigid=6):
    """Return the stuck motion of all DOFs under the load, complex (n_omega, n_dof), by all modes of dense matrices."""
    K, M, K_J = dense(structure)
    R, f = structure.linearised.system.R.toarray(), structure.linearised.system.loads.toarray()[:, 0]
    squares, phi = scipy.linalg.eigh(K + R.T @ K_J @ R, M)
    assert np.abs(squares[:n_rigid]).max() < 1e-6 * squares[n_rigid]
    omega_n = np.sqrt(np.where(np.arange(len(squares)) < n_rigid, 0.0, np.abs(squares)))
    D = omega_n**2 - omega[:, None] ** 2 + 2j * zeta * omega_n * omega[:, None]
    return (phi.T @ f / D) @ phi.T, omega_n[n_rigid:]


STICKS = (("preload = 2.0e7", "preload = 2.0e12"),)


@pytest.mark.parametrize("n_modes, limit", [(6, 2e-2), (None, 1e-3), (N_DOF + 45 - 6, 1e-8)])
def test_the_stuck_response_of_a_free_bar(tmp_path, n_modes, limit):
    """Modes, mode = 1 and the response in the whole range are those of dense matrices: exactly with all modes."""
    folder, keys = comm.bcast(tmp_path), {} if n_modes is None else {"modes": n_modes}
    scene = free_bar(folder, *STICKS, harmonics=1, **keys)
    with microslip.build(scene, comm) as structure:
        (level,) = microslip.respond(structure, error_bars=False).results.levels
        omega = 2.0 * np.pi * level.frequency
        exact, omega_n = exact_amplitudes(structure, omega, 0.01)
        outputs = exact @ structure.linearised.system.outputs.toarray().T
        np.testing.assert_allclose(structure.modes.omega_n[:5], omega_n[:5], rtol=1e-8)
        assert omega[0] < omega_n[0] < omega[-1]
    solved = level.response[:, :, 1] - 1j * level.response[:, :, 2]
    np.testing.assert_allclose(solved / 30.0, outputs, rtol=0, atol=limit * np.abs(outputs).max())


@pytest.mark.parametrize("fix, n_rigid, words", [("z", 3, "2 translations and 1 turning motion"), ("yz", 1, "1 translation")])
def test_supports_that_allow_rigid_body_motion(tmp_path, fix, n_rigid, words):
    """A plate supported across, or along two axes: elastic modes and the stuck response are those of dense matrices."""
    held = f"{support('ground_base', *fix)}\n[damping]"
    scene = free_bar(comm.bcast(tmp_path), *STICKS, ("[damping]", held), name=fix, harmonics=1, modes=12)
    with microslip.build(scene, comm) as structure:
        assert any(words in note for note in structure.linearised.system.notes)
        (level,) = microslip.respond(structure, error_bars=False).results.levels
        omega = 2.0 * np.pi * level.frequency
        exact, omega_n = exact_amplitudes(structure, omega, 0.01, n_rigid)
        outputs = exact @ structure.linearised.system.outputs.toarray().T
        np.testing.assert_allclose(structure.modes.omega_n[:5], omega_n[:5], rtol=1e-8)
    solved = level.response[:, :, 1] - 1j * level.response[:, :, 2]
    np.testing.assert_allclose(solved / 30.0, outputs, rtol=0, atol=1e-3 * np.abs(outputs).max())


def slipping_bar(folder):
    return free_bar(folder, ("levels = [30.0]", "levels = [2000.0]"), harmonics=1, samples=64)


def peak_of(branch):
    return max(np.abs(to_complex(point.response)[:, 1]).max() for point in branch.points)


@pytest.fixture(scope="module")
def peak_by_receptance(tmp_path_factory):
    with microslip.build(slipping_bar(comm.bcast(tmp_path_factory.mktemp("free"))), comm) as structure:
        return peak_of(microslip.respond(structure, method="receptance", error_bars=False).branches[0])


@pytest.mark.parametrize(
    "method", ["full", *(pytest.param(name, marks=ON_ONE) for name in ("rubin", "craig-bampton", "adaptive"))]
)
def test_methods_agree_and_momentum_is_balanced_with_slip(tmp_path, method, peak_by_receptance):
    """The mass times acceleration of all DOFs is the load, force and moment, at every point: contact forces cancel."""
    scene = by(slipping_bar(comm.bcast(tmp_path)), method)
    log = RunLog(comm, screen=False)
    structure = microslip.build(scene, comm)
    prepared = prepare(structure, has_bars=False)
    (branch,) = follow(prepared.response, log=log)
    assert peak_of(branch) == pytest.approx(peak_by_receptance, rel=5e-3)
    points = [(point.omega, comm.bcast(point.p)) for point in (branch.points[branch.peak], branch.points[0])]
    assert any(p.any() for _, p in points)
    acting = [ActingForces(branch.level, omega, p.reshape(-1, p.shape[-1])) for omega, p in points]
    fields = prepared.reduction.displacements(prepared.response.model, acting)
    M, motions_owned = structure.linearised.M, structure.linearised.system.rigid_owned
    M, motions = comm.bcast(gathered(M)), np.concatenate(comm.allgather(motions_owned))
    f = structure.linearised.system.loads.toarray()[:, 0]
    for (omega, _), owned in zip(points, fields):
        u = np.concatenate(comm.allgather(owned))
        forced = motions.T @ f * branch.level
        np.testing.assert_allclose(motions.T @ M @ u[:, 1] * omega**2, -forced, atol=1e-8 * np.abs(forced).max())
        assert np.abs(motions.T @ M @ u[:, 2:]).max() * omega**2 < 1e-8 * np.abs(forced).max()
    structure.close()


@pytest.mark.parametrize("held", [0.0, 1e-3])
@pytest.mark.ranks(1)
def test_soft_springs_approach_the_free_structure(tmp_path, held):
    """A truss of matrices, pairs stuck: springs at 1/1000 of the elastic frequencies change the curve by about 1e-6."""
    omega, zeta = ELASTIC * np.array([0.5, 0.9, 0.97, 1.03]), 0.01
    load, output, free, soft, system = softly_held_truss(held, ELASTIC, omega, rayleigh=(0.0, 2.0 * zeta / ELASTIC))
    system["pair_dofs"][0, 3:] = [33, 34, 35]
    folder = comm.bcast(tmp_path)
    options = {"at": omega, "outputs": [31], "harmonics": 1, "samples": 32, "modes": 36 if held else 32, "error_bars": False}
    path = on_root(comm, lambda: write_matrix_scene(folder, system, [1.0], system["omega"], **options))
    (branch,) = branches_of(path, comm)
    solved = np.array([to_complex(point.response)[0, 1] for point in requested(branch)])
    R = system["R"]
    stiffness = free.toarray() + R.T @ (joint_stiffness(system)[:, None] * R)
    exact = [
        output @ np.linalg.solve(stiffness * (1.0 + 2j * zeta * w / ELASTIC) - w**2 * np.eye(len(load)), load) for w in omega
    ]
    np.testing.assert_allclose(solved, exact, rtol=0, atol=(5e-5 if held else 1e-8) * np.abs(exact).max())


def test_error_bars_include_truncated_modes_of_a_free_structure(tmp_path):
    folder = comm.bcast(tmp_path)
    scene = free_bar(folder, modes=6, harmonics=1, samples=64)
    with microslip.build(scene, comm) as structure:
        (few,) = microslip.respond(structure).results.levels
    scene = free_bar(folder, ("points = 10", f"points = 10\nat = {few.frequency.tolist()}"), harmonics=1, samples=64)
    with microslip.build(scene, comm) as structure:
        (every,) = microslip.respond(structure, error_bars=False).results.levels
    at = np.searchsorted(every.frequency, few.frequency * (1.0 - 1e-9))
    off = np.abs(few.response[:, :, 1:3] - every.response[at][:, :, 1:3]).max()
    assert 1e-7 * np.abs(few.response).max() < off <= 1.5 * few.error.sum(axis=-1).max() < 0.1 * np.abs(few.response).max()


def test_constant_loads_must_be_in_balance(tmp_path):
    folder = comm.bcast(tmp_path)
    pushed = free_bar(
        folder,
        ("[[outputs]]", "[[loads]]\nposition = [0.05, 0.01, 0.02]\ndirection = [0.0, 0.0, 1.0]\nharmonic = 0\n[[outputs]]"),
    )
    with pytest.raises(CaseError, match="constant loads on a structure without supports are not in balance"):
        with microslip.build(pushed, comm) as structure:
            microslip.respond(structure)
