"""Structures given as matrices against dense algebra, on any number of ranks; with one DOF most ranks own no row."""

import copy

import numpy as np
import pytest
import scipy.linalg
from matrix_scenes import branches_of, requested, write_matrix_scene
from mpi4py import MPI
from oracles import exact, scenes

from microslip.fourier.amplitudes import to_complex, to_real
from microslip.library.build import build
from microslip.library.settings import reduction_settings
from microslip.messages.errors import CaseError
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.receptance.motions import linear_motion, linear_motion_rate, output_motion
from microslip.receptance.reduced_model import ReducedModel
from microslip.reduction.modal_structure import reduce_structure
from microslip.scene.read import read_scene

COMM = MPI.COMM_WORLD
OMEGA = {"jenkins": 1.3, "spatial": 1.5, "chain": 560.0, "gap": 1.1}


def with_damping(system, C):
    """Return the system with a damping matrix instead of its damping ratio."""
    return {**{key: value for key, value in system.items() if key != "zeta"}, "C": np.asarray(C, dtype=float)}


def full_damping(n, size=1.0):
    """Return a damping matrix (n, n) that is not proportional to mass and stiffness."""
    X = np.random.default_rng(n).standard_normal((n, n))
    return size * (X @ X.T / n + np.eye(n))


def reduced(folder, system, **solver):
    """Return the structure and the reduced model of a system, written to files and read.  Collective."""
    frequencies = (0.9 * OMEGA[system["name"].split()[0]], 1.1 * OMEGA[system["name"].split()[0]])
    path = on_root(COMM, lambda: write_matrix_scene(folder, system, [1.0], frequencies, **solver))
    scene = on_root(COMM, read_scene, path)
    structure, settings = build(scene, COMM, RunLog(COMM, screen=False)), reduction_settings(scene)
    return structure, ReducedModel.of(reduce_structure(structure, settings.damping), settings.excitation)


def gathered(A):
    """Return a distributed matrix as an array.  Collective."""
    row_start, row_end = A.getOwnershipRange()
    rows = A.getDenseArray() if A.getType().endswith("dense") else A.getValues(range(row_start, row_end), range(A.getSize()[1]))
    return np.concatenate(COMM.allgather(rows.reshape(-1, A.getSize()[1])))


def exact_motion(system, omega, p):
    """Return the harmonics of u, (n, N_H), under the loads at unit level and contact forces ``p`` beyond the stuck springs."""
    H = p.shape[1] // 2
    f = to_complex(scenes.force_coefficients(system, 1.0, H) - system["R"].T @ p)
    K_L, C, M = scenes.stuck_stiffness(system), scenes.damping_matrix(system), system["M"]
    Z = [K_L - (n * omega) ** 2 * M + 1j * n * omega * C for n in range(H + 1)]
    return to_real(np.stack([np.linalg.solve(Z[n], f[:, n]) for n in range(H + 1)], axis=1), p.shape[1])


def assert_receptance(system, model, omega):
    """Compare motion of outputs and pairs, and its derivative by frequency, with dense algebra."""
    p = np.random.default_rng(5).standard_normal((3 * model.n_pairs, model.N_H))
    p[~system["R"].any(axis=1)] = 0.0  # directions that do not move have no forces
    u, no_forces = exact_motion(system, omega, p), np.zeros_like(p)
    motion = output_motion(model, 1.0, omega, p)
    np.testing.assert_allclose(motion, u, atol=1e-10 * np.abs(u).max())
    U_lin, dU_lin = linear_motion(model, 1.0, omega), linear_motion_rate(model, 1.0, omega)
    du, h = (system["R"] @ exact_motion(system, omega, no_forces))[model.owned_rows], 1e-6 * omega
    np.testing.assert_allclose(U_lin, du, atol=1e-10 * np.abs(u).max())
    ahead, back = (linear_motion(model, 1.0, omega + step) for step in (h, -h))
    np.testing.assert_allclose(dU_lin, (ahead - back) / (2.0 * h), atol=1e-6 * np.abs(u).max() / omega)


@pytest.mark.parametrize("name", ["jenkins", "spatial", "chain", "gap"])
def test_matrices_and_maps_are_those_of_the_files(shared_path, name):
    system = scenes.SCENES[name]()
    structure, model = reduced(shared_path, system)
    given = structure.linearised.system
    np.testing.assert_array_equal(gathered(given.K), system["K"])
    np.testing.assert_array_equal(gathered(given.M), system["M"])
    np.testing.assert_array_equal(given.R.toarray(), system["R"])
    np.testing.assert_allclose(gathered(structure.linearised.K_L), scenes.stuck_stiffness(system), rtol=1e-14)
    np.testing.assert_array_equal(given.outputs.toarray(), np.eye(len(system["K"])))
    np.testing.assert_allclose(given.loads.toarray() @ model.f, scenes.force_coefficients(system, 1.0, 3), atol=1e-15)
    for key in ("mu", "k_t", "k_n", "N0"):
        np.testing.assert_allclose(getattr(structure.pairs, key), system[key], rtol=1e-15)
    np.testing.assert_allclose(model.omega_n, scenes.stuck_frequencies(system), rtol=1e-12)  # all modes by default
    structure.linearised.destroy()


@pytest.mark.parametrize("name", ["jenkins", "spatial", "chain", "gap"])
def test_receptance_equals_dense_algebra(shared_path, name):
    system = scenes.SCENES[name]()
    structure, model = reduced(shared_path, system)
    assert_receptance(system, model, OMEGA[name])
    structure.linearised.destroy()


@pytest.mark.parametrize("name, size", [("spatial", 0.1), ("chain", 20.0)])
def test_a_damping_matrix_may_couple_the_modes(shared_path, name, size):
    plain = scenes.SCENES[name]()
    system = with_damping(plain, full_damping(len(plain["M"]), size))
    structure, model = reduced(shared_path, system)
    assert model.receptance_of(1).modes.damping.couples_modes
    assert_receptance(system, model, OMEGA[name])
    structure.linearised.destroy()


def test_a_proportional_damping_matrix_is_diagonal_in_modes(shared_path):
    plain = scenes.chain()
    system = with_damping(plain, 3.0 * plain["M"] + 1e-5 * scenes.stuck_stiffness(plain))
    structure, model = reduced(shared_path, system)
    damping = model.receptance_of(1).modes.damping
    assert not damping.couples_modes
    np.testing.assert_allclose(damping.diagonal, 3.0 + 1e-5 * model.omega_n**2, rtol=1e-10)
    assert_receptance(system, model, OMEGA["chain"])
    structure.linearised.destroy()


def test_massless_dofs_follow_their_springs(shared_path):
    """The last node of the chain, which has a pair, is massless and undamped in two directions."""
    system = copy.deepcopy(scenes.chain())
    system["M"][[6, 7], [6, 7]] = 0.0
    C = full_damping(9, 20.0)
    C[6:8], C[:, 6:8] = 0.0, 0.0
    structure, model = reduced(shared_path, with_damping(system, C))
    theta = scipy.linalg.eigh(system["M"], scenes.stuck_stiffness(system), eigvals_only=True)[:1:-1]
    np.testing.assert_allclose(model.omega_n, theta**-0.5, rtol=1e-10)
    assert_receptance(with_damping(system, C), model, OMEGA["chain"])
    structure.linearised.destroy()


@pytest.mark.ranks(1, 2)
def test_one_mass_has_the_exact_amplitude_also_with_ranks_without_rows(shared_path):
    """One harmonic, 4096 samples (docs/validation.md); the sampled hysteresis loop converges as N_t^-2."""
    data = {"m": 1.0, "c": 0.02, "k": 1.0, "k_t": 1.0, "muN": 1.0}
    at = exact.jenkins_frequencies(1.5, 0.8, **data)
    path = on_root(
        COMM,
        lambda: write_matrix_scene(
            shared_path,
            scenes.jenkins_mass(),
            [0.8],
            (1.05, 1.55),
            at=at,
            points=10,
            harmonics=1,
            samples=4096,
            method="receptance",
        ),
    )
    (branch,) = branches_of(path, COMM)
    assert [np.hypot(*point.response[0, 1:3]) for point in requested(branch)] == pytest.approx([1.5, 1.5], rel=4e-6)


def faulty(**changes):
    """Return the spatial system with other values of some keys."""
    system = copy.deepcopy(scenes.spatial_mass())
    system.update(changes)
    return system


@pytest.mark.parametrize(
    "system, expected",
    [
        (faulty(M=np.eye(2)), r"M.mtx: \[model\] mass is 2 x 2, but the stiffness 3 x 3"),
        (faulty(M=np.diag([1.0, -2.0, 1.0])), r"\[model\] mass of DOF 1 is -2 kg; a mass must not be negative"),
        (faulty(M=np.zeros((3, 3))), "zero on the whole diagonal; without any mass nothing vibrates"),
        (
            faulty(M=[[1.0, 0.1, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 1.0]]),
            r"mass of DOF 1 is 0, yet mass couples it to others \(1 DOF of",
        ),
        (faulty(M=[[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "the mass matrix is indefinite"),
        (with_damping(faulty(M=np.diag([1.0, 0.0, 0.0])), np.eye(3)), r"mass of DOF 1 is 0, yet damping acts on it \(2 DOFs"),
        (with_damping(faulty(), np.diag([1.0, -0.5, 1.0])), r"\[model\] damping: z\^T C z = -0.41.* feeds energy in"),
        (faulty(K=-9.0 * np.eye(3)), "K_L is not positive definite: 3 of 3 degrees of freedom have no positive stiffness"),
        (
            faulty(K=np.diag([1.0, 1.0, 0.0]), pair_dofs=np.array([[0, 1, -1, -1, -1, -1]])),
            "no positive stiffness .* the first is DOF 2",
        ),
        (
            faulty(pair_dofs=np.array([[0, 1, 3, -1, -1, -1]])),
            "pairs.csv, line 2: z1 = 3 is not a DOF number; they go from 0 to 2",
        ),
        (
            faulty(loads=[{"vector": np.array([0.0, 0.0, 0.0, 1.0]), "harmonic": 1}]),
            r"scene.toml: \[\[loads\]\] 1 dof = 3: the matrices have",
        ),
    ],
)
def test_a_mistake_is_raised_on_every_rank(shared_path, system, expected):
    with pytest.raises(CaseError, match=expected):
        reduced(shared_path, system)


def test_outputs_and_modes_beyond_the_matrices_are_refused(shared_path):
    with pytest.raises(CaseError, match=r"\[\[outputs\]\] 1 dof = 3: the matrices have DOFs 0 to 2"):
        reduced(shared_path, scenes.spatial_mass(), outputs=[3])
    with pytest.raises(CaseError, match=r"scene.toml: \[solver\] modes = 4: the structure has only 3 degrees of freedom"):
        reduced(shared_path, scenes.spatial_mass(), modes=4)


def test_an_unsupported_part_is_named(shared_path):
    system = scenes.spatial_mass()
    K = scipy.linalg.block_diag(system["K"], [[5.0, -5.0], [-5.0, 5.0]])
    system.update(K=K, M=np.eye(5), loads=[{"vector": np.eye(5)[0], "harmonic": 1}])
    with pytest.raises(CaseError, match="the part of 2 DOFs with DOF 3 moves freely.*in the stiffness matrix, or by .*joint"):
        reduced(shared_path, system)
