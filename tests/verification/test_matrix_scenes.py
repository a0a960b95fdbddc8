"""Scenes given as matrices, from their files to the branch, compared with direct time integration, each other, and a mesh."""

import numpy as np
import pytest
import scipy.sparse as sp
from blocks import stacked
from matrix_scenes import branches_of, requested, write_matrix_scene
from mpi4py import MPI
from msh import write_msh
from oracles import scenes, time_integration
from scene_text import driven, joint, response, steel, support, table

from microslip.library.build import build
from microslip.observe.log import RunLog
from microslip.scene.read import read_scene

HERE = MPI.COMM_SELF
H, N_SAMPLES = 15, 512  # the sampled law has an error of 4e-3 of the peak at 512 samples where the direction of slip rotates
# band [rad/s] in which the branch is followed, steps a period of the march
CASES = {"jenkins": ((1.0, 1.4), 512), "spatial": ((0.8, 1.6), 256), "chain": ((500.0, 700.0), 256), "gap": ((0.7, 1.35), 256)}


def solved(folder, system, band, regimes, **solver):
    """Return the points of the branches at the frequency of each regime; several points where the branch folds."""
    levels, at = ({regime[i] for regime in regimes} for i in (0, 1))
    path = write_matrix_scene(
        folder,
        system,
        sorted(levels),
        band,
        at=sorted(at),
        points=16,
        harmonics=H,
        samples=N_SAMPLES,
        **{"method": "receptance", **solver},
    )
    branches = {branch.level: branch for branch in branches_of(path, HERE)}
    return [
        [point for point in requested(branches[level]) if point.omega == pytest.approx(omega)] for level, omega, *_ in regimes
    ]


def difference(point, march):
    """Return the largest difference of any DOF over the period, relative to the largest displacement."""
    wave = (point.response @ scenes.harmonic_basis(H, len(march.u))).T
    return np.abs(wave - march.u).max() / np.abs(march.u).max()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name == "chain" else pytest.mark.study) for name in CASES]
)
def test_stuck_slip_and_lift_off_agree_with_time_integration_from_rest(tmp_path, name):
    system, (band, n_steps) = scenes.SCENES[name](), CASES[name]
    regimes = list(system["levels"].values())
    for (level, omega, states), points in zip(regimes, solved(tmp_path, system, band, regimes)):
        march = time_integration.steady_state(
            system, omega, level, n_steps=n_steps, harmonics=H, tolerance=3e-5, scheme="explicit"
        )
        point = min(points, key=lambda point: difference(point, march))  # of several solutions, that reached from rest
        assert difference(point, march) < 5e-3
        assert tuple(point.state) == tuple(march.state) == states
        assert point.energy == pytest.approx(march.friction, abs=1e-2 * march.input)


def test_the_solution_beyond_the_fold_is_steady_in_time_integration(tmp_path):
    """The highest of three solutions: time integration from it remains there."""
    system = scenes.gap_mass()
    regime = system["levels"]["two states"]
    (points,) = solved(tmp_path, system, CASES["gap"][0], [regime])
    assert len(points) == 3
    point = max(points, key=lambda point: np.abs(point.response).max())
    assert np.hypot(*point.response[2, 1:3]) == pytest.approx(2.3222, rel=1e-3)
    n = np.arange(1, H + 1)
    u, v = point.response[:, 0] + point.response[:, 1::2].sum(axis=1), point.omega * point.response[:, 2::2] @ n
    T = system["k_t"][:, None] * u[None, :2] + point.p[:, :2, 0] + point.p[:, :2, 1::2].sum(axis=2)
    march = time_integration.steady_state(
        system, regime[1], regime[0], n_steps=256, harmonics=H, tolerance=3e-5, scheme="explicit", start=(u, v, T)
    )
    assert difference(point, march) < 5e-3


def test_dampers_between_masses_agree_with_time_integration(tmp_path):
    """A damping matrix that couples the modes: dampers from the first mass to the ground and between the others."""
    system = scenes.chain()
    del system["zeta"]
    link = np.kron([[0.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, -1.0, 1.0]], np.diag([40.0, 15.0, 30.0]))
    system["C"] = link + np.kron(np.diag([1.0, 0.0, 0.0]), np.diag([16.0, 24.0, 12.0]))
    regimes = [system["levels"]["gross"]]
    ((point,),) = solved(tmp_path, system, (520.0, 600.0), regimes)
    march = time_integration.steady_state(system, 560.0, 100.0, n_steps=256, harmonics=H, tolerance=3e-5, scheme="explicit")
    assert tuple(point.state) == tuple(march.state) == (1, 1)
    assert difference(point, march) < 5e-3
    assert point.damping == pytest.approx(march.viscous, rel=1e-2)


def test_every_method_has_the_same_points(tmp_path):
    system = scenes.chain()
    regimes = [system["levels"]["micro"]]
    ((exact,),) = solved(tmp_path, system, (520.0, 600.0), regimes)
    peak = np.abs(exact.response).max()
    for method, solver, bound in (
        ("adaptive", {"in_point_check": True}, 1e-7),
        ("adaptive", {}, 5e-3),
        ("adaptive-energy", {"in_point_check": True}, 1e-7),
    ):
        ((point,),) = solved(tmp_path, system, (520.0, 600.0), regimes, method=method, **solver)
        assert np.abs(point.response - exact.response).max() < bound * peak


MESH_SCENE = (
    table("model", mesh="bar.msh")
    + steel("bar", "ground")
    + support("ground_base")
    + joint("bar_bottom", "ground_top", friction=0.05, preload=2.0e7)
    + driven([[0.1, 0.01, 0.012]], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], "corner")
    + response(100.0, 300.0, points=40)
    + table("solver", method="receptance", modes=12)
)


def exported(structure) -> dict:
    """Return K, M, pairs and loads of a mesh as another program would write them: contact nodes in the axes of the pairs."""
    system, pairs = structure.linearised.system, structure.pairs
    K, M = (sp.csr_matrix(A.getValuesCSR()[::-1], A.getSize()) for A in (system.K, system.M))
    turn = sp.lil_matrix(sp.identity(system.n_dof))
    for nodes in (pairs.node1, pairs.node2):
        for node, frame in zip(nodes, pairs.frame):
            turn[np.ix_(system.dof[node], system.dof[node])] = frame
    turn = turn.tocsr()
    R = (system.R @ turn.T).toarray().round(12)
    pair_dofs = np.stack(
        [np.where((R == sign).any(axis=1), np.argmax(R == sign, axis=1), -1).reshape(-1, 3) for sign in (1, -1)], 1
    )
    load = (turn @ system.loads).toarray().ravel()
    return {
        "name": "exported",
        "K": turn @ K @ turn.T,
        "M": turn @ M @ turn.T,
        "pair_dofs": pair_dofs.reshape(-1, 6),
        "zeta": 0.01,
        "mu": pairs.mu,
        "N0": pairs.N0,
        "k_t": pairs.k_t,
        "k_n": pairs.k_n,
        "separate": pairs.separate,
        "loads": [{"vector": load, "harmonic": 1}],
    }


@pytest.mark.study
def test_matrices_of_a_mesh_give_its_curve(tmp_path):
    """A bar on a plate, with its matrices written to files; one pair per contact node."""
    write_msh(str(tmp_path / "bar.msh"), stacked("hex20", (0.1, 0.01, 0.01), (8, 2, 1), ground_height=0.002))
    path = tmp_path / "mesh.toml"
    path.write_text(MESH_SCENE)
    structure = build(read_scene(path), HERE, RunLog(HERE, screen=False))
    system, (row,) = exported(structure), structure.linearised.system.outputs.indices
    omega_1 = structure.modes.omega_n[0]
    of_matrices = write_matrix_scene(
        tmp_path, system, [100.0, 300.0], (0.9 * omega_1, 1.1 * omega_1), outputs=[row], points=40, method="receptance", modes=12
    )
    for mesh, matrices in zip(branches_of(path, HERE), branches_of(of_matrices, HERE)):
        assert len(mesh.points) == len(matrices.points)
        peak = max(np.abs(point.response).max() for point in mesh.points)
        for a, b in zip(mesh.points, matrices.points):
            assert a.omega == pytest.approx(b.omega, rel=1e-9)
            assert np.abs(a.response - b.response).max() < 1e-8 * peak
            assert np.array_equal(a.state, b.state)
    assert {0, 1} <= set(np.concatenate([point.state for point in mesh.points]))
