"""Dampers between nodes and to ground: their C compared with dense algebra, every method, and their work; on any ranks."""

import numpy as np
import pytest
from bar_loads import LOADS, dense, reduced_model, scene_with
from bar_scene import COARSE, COARSE_DOF, COARSE_PAIRS, EVERY_METHOD, by

import microslip
from microslip.fourier.amplitudes import to_complex
from microslip.library.settings import reduction_settings
from microslip.messages.errors import CaseError
from microslip.receptance.motions import output_motion
from microslip.reduction.modal_structure import stuck_receptance

CONSTANT, ALONG = 30.0, np.array([1.0, 2.0, 2.0]) / 3.0  # N s/m
DAMPERS = f'[[springs]]\ngroups = ["bar_end"]\ndirection = [1.0, 2.0, 2.0]\ndamping = {CONSTANT}\n'


def damped(comm, path, damping="rayleigh = [200.0, 1e-6]", **solver):
    return scene_with(comm, path, loads=DAMPERS + LOADS, damping=damping, **{**COARSE, **solver})


def of_dampers(comm, structure):
    """Return C of the dampers, the rows of the structure."""
    system = structure.linearised.system
    nodes = comm.bcast(structure.mesh.node_groups["bar_end"] if comm.rank == 0 else None)
    rows = np.zeros((len(nodes), system.n_dof))
    rows[np.arange(len(nodes))[:, None], system.dof[nodes]] = ALONG
    return CONSTANT * rows.T @ rows


@pytest.mark.parametrize("eta", [0.0, 0.03])
def test_every_method_meets_a_direct_solution(comm, shared_path, eta):
    """In addition to Rayleigh and structural damping, under a load and any contact forces, in every harmonic."""
    structural = f"structural = {eta}\n" if eta else ""
    scene = damped(comm, shared_path, damping=structural + "rayleigh = [200.0, 1e-6]", harmonics=2)
    with microslip.build(scene, comm) as structure:
        system, omega = structure.linearised.system, 1.003 * structure.modes.omega_n[0]
        K, M, K_J = dense(structure)
        R = system.R.toarray()
        K_L = K + R.T @ K_J @ R
        C = 200.0 * M + 1e-6 * K_L + of_dampers(comm, structure)
        p = np.random.default_rng(7).standard_normal((3 * COARSE_PAIRS, 5))
        f = np.zeros((COARSE_DOF, 5))
        f[:, 1] = system.loads.toarray()[:, 0]
        forces = to_complex(f - R.T @ p)
        Z = [K_L - (n * omega) ** 2 * M + 1j * n * omega * C + 1j * eta * (n > 0) * K for n in range(3)]
        u = np.column_stack([np.linalg.solve(Z[n], forces[:, n]) for n in range(3)])
        exact = system.outputs @ u
        for method, keys in EVERY_METHOD.items():
            amplitudes = to_complex(output_motion(reduced_model(structure, by(scene, method, **keys)), 1.0, omega, p))
            np.testing.assert_allclose(amplitudes, exact, rtol=0.0, atol=1e-8 * np.abs(exact).max(), err_msg=method)


def test_dampers_dissipate_the_work_of_the_load(comm, shared_path):
    """Without other damping, at an amplitude without slip: the work of the load is that of the dampers."""
    scene = damped(comm, shared_path, damping="ratio = 0.0", points=3, samples=64)
    with microslip.build(scene, comm) as structure:
        f1 = float(structure.modes.frequency[0])
        response = microslip.respond(structure, levels=[1e-3], frequencies=(0.99 * f1, 1.01 * f1), error_bars=False)
        (level,) = response.results.levels
        i = int(np.argmax(np.abs(level.response[:, 0, 1:3]).max(axis=1)))
        _, u = response.fields(1e-3, level.frequency[i])
        if comm.rank == 0:
            nodes, omega = structure.mesh.node_groups["bar_end"], 2.0 * np.pi * level.frequency[i]
            velocity = omega * (u[nodes].transpose(0, 2, 1) @ ALONG)[:, 1:3]  # of cos and sin, except for their order
            lost = np.pi / omega * CONSTANT * (velocity**2).sum()
            load = 1e-3 * structure.linearised.system.loads.toarray()[:, 0]
            rows = structure.linearised.system.dof
            sine = np.where(rows >= 0, u[:, :, 2], 0.0)
            given = np.pi * float(load[rows[rows >= 0]] @ sine[rows >= 0])
            assert lost > 0.0 and given == pytest.approx(lost, rel=1e-6)


def test_damping_of_fewer_modes_is_their_part_of_the_full_matrix(comm, shared_path):
    scene = damped(comm, shared_path)
    with microslip.build(scene, comm) as structure:
        damping = reduction_settings(scene).damping
        all_modes, first = (stuck_receptance(structure.using(n), damping).modes.damping.C for n in (COARSE_DOF, 10))
        assert all_modes.shape == (COARSE_DOF, COARSE_DOF)
        np.testing.assert_array_equal(first, all_modes[:10, :10])


def test_a_spring_without_stiffness_and_damping_is_rejected(comm, shared_path):
    with pytest.raises(CaseError, match=r"\[\[springs\]\] 1.*stiffness is missing: expected .*; or damping"):
        scene_with(comm, shared_path, loads='[[springs]]\ngroups = ["bar_end"]\ndirection = [1.0, 0.0, 0.0]\n' + LOADS)
