"""Every reduction method compared with the unreduced structure, on any number of ranks."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from bar_scene import N_DOF, N_PAIRS, bar, by, stuck
from dense_model import forced
from matrix_scenes import write_matrix_scene
from oracles import harmonic_balance, scenes

import microslip
from microslip.continuation.grid import at_frequencies
from microslip.library.settings import excitation, reduction_settings
from microslip.linear.dense import gram, multiply
from microslip.messages.errors import CaseError
from microslip.modes.lapack import gathered
from microslip.parallel.agree import on_root
from microslip.receptance.motions import ActingForces, linear_motion
from microslip.receptance.reduced_model import ReducedModel
from microslip.reduction.expand import displacements
from microslip.reduction.facts import Counts
from microslip.reduction.free_interface import free_bodies, residual_attachment_modes
from microslip.reduction.methods import METHODS, full, reduce_by_method

BASES = {
    "rubin": {},
    "rubin, condensed": {"condensed": True},
    "craig-bampton": {},
    "joint-interface-modes": {},
    "trial-vectors": {},
}
SAMPLES = 64  # of both codes, which agree at any number


def reduced(scene, structure, method, **solver):
    scene = by(scene, method.split(",")[0], **solver)
    return reduce_by_method(structure, reduction_settings(scene))


def model_of(scene, reduction):
    return ReducedModel.of(reduction.structure, excitation(scene))


def matrices(structure):
    """Return K_L and M as arrays on every rank."""
    return tuple(structure.linearised.system.comm.bcast(gathered(A)) for A in (structure.linearised.K_L, structure.linearised.M))


@pytest.fixture(scope="module")
def whole(comm, tmp_path_factory):
    """Return the bar with every mode computed."""
    scene, structure = bar(comm, comm.bcast(tmp_path_factory.mktemp("bar")), modes=N_DOF, method="full")
    yield scene, structure
    structure.linearised.destroy()


def curve(scene, structure, reduction, omegas, level=30.0):
    pairs = structure.pairs
    law = replace(pairs.law, sampled=scene.solver.between_samples == "return-map")
    problem = forced(model_of(scene, reduction), law, SAMPLES, level)
    solution = at_frequencies(problem, reduction.selection, omegas, tolerance=1e-10)
    assert solution.failure is None
    return solution.points


@pytest.fixture(scope="module")
def reference(whole):
    scene, structure = whole
    omegas = structure.modes.omega_n[0] * np.linspace(0.97, 1.03, 9)
    reduction = reduced(scene, structure, "full")
    return omegas, reduction, curve(scene, structure, reduction, omegas)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["receptance", *BASES])
def test_every_method_with_all_modes_agrees_with_full(whole, reference, method):
    scene, structure = whole
    omegas, _, exact = reference
    reduction = reduced(scene, structure, method, **BASES.get(method, {}), interface_modes=3 * N_PAIRS)
    points = curve(scene, structure, reduction, omegas)
    assert set(np.concatenate([point.state for point in exact])) >= {0, 1}
    peak = max(np.abs(point.response).max() for point in exact)
    loss = max(point.friction for point in exact)
    for a, b in zip(points, exact):
        assert a.response == pytest.approx(b.response, abs=1e-8 * peak)
        assert a.friction == pytest.approx(b.friction, abs=1e-7 * loss)
        assert a.input == pytest.approx(a.damping + a.friction, rel=1e-6)


@pytest.fixture(scope="module")
def oracle():
    return harmonic_balance.solve(scenes.chain(), 560.0, 10.0, H=3, n_samples=SAMPLES, tolerance=1e-12).u_hat


@pytest.mark.slow
@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize("method", METHODS)
def test_every_method_agrees_with_dense_harmonic_balance_of_the_chain(comm, shared_path, oracle, method):
    system, (level, omega) = scenes.chain(), (10.0, 560.0)
    scene, structure = stuck(
        comm,
        on_root(
            comm,
            lambda: write_matrix_scene(
                shared_path,
                system,
                [level],
                (540.0, 580.0),
                harmonics=3,
                method=method,
                in_point_check=True,
                between_samples="return-map",  # as the oracle
            ),
        ),
    )
    _, point = curve(scene, structure, reduced(scene, structure, method), [555.0, omega], level)
    structure.linearised.destroy()
    assert point.response == pytest.approx(oracle, abs=1e-8 * np.abs(oracle).max())


def with_dampers():
    """Return the chain with dampers from the first mass to the ground and between the others: they couple the modes."""
    system = scenes.chain()
    del system["zeta"]
    link = np.kron([[0.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, -1.0, 1.0]], np.diag([40.0, 15.0, 30.0]))
    return {**system, "C": link + np.kron(np.diag([1.0, 0.0, 0.0]), np.diag([16.0, 24.0, 12.0]))}


def without_some_mass():
    """Return the chain with a massless direction of the second mass and one of the third."""
    system = scenes.chain()
    del system["zeta"]
    mass = np.diag(system["M"]).copy()
    mass[[4, 8]] = 0.0
    return {**system, "M": np.diag(mass), "C": np.diag(30.0 * mass)}


@pytest.mark.slow
@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize(
    "system", [pytest.param(with_dampers(), marks=pytest.mark.ranks(1)), without_some_mass()], ids=["dampers", "massless"]
)
def test_a_damping_matrix_and_motions_without_mass(comm, shared_path, system):
    keys = {"method": "full", "between_samples": "return-map"}  # as the oracle
    path = on_root(comm, lambda: write_matrix_scene(shared_path, system, [10.0], (540.0, 580.0), **keys))
    scene, structure = stuck(comm, path)
    exact = harmonic_balance.solve(system, 560.0, 10.0, H=3, n_samples=SAMPLES, tolerance=1e-12).u_hat
    for method in ("receptance", "full", *BASES):
        reduction = reduced(scene, structure, method, **BASES.get(method, {}))
        _, point = curve(scene, structure, reduction, [555.0, 560.0], 10.0)
        assert point.response == pytest.approx(exact, abs=1e-8 * np.abs(exact).max())
    structure.linearised.destroy()


def test_unknowns_are_counted_before_condensation(whole):
    scene, structure = whole
    for method, n in {"full": N_DOF, "rubin": N_DOF + 6 * N_PAIRS + 1, "rubin, condensed": N_DOF + 3 * N_PAIRS + 1}.items():
        reduction = reduced(scene, structure, method, **BASES.get(method, {}))
        n_modes, every_pair = model_of(scene, reduction).n_modes, np.ones(N_PAIRS, bool)
        assert reduction.selection.unknowns(every_pair, every_pair, n_modes, 7) == 7 * n
        solver = by(scene, method, **BASES.get(method, {})).solver
        assert METHODS[method.split(",")[0]].FACTS.coordinates(solver, Counts(N_DOF, N_DOF, N_PAIRS, 1)) == n


# -- the reference itself ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping, bound", [("rayleigh = [30.0, 1e-7]", 1e-11), ("ratio = 0.01", 3e-7)])
def test_full_by_its_krylov_space_is_the_inverse_of_the_dynamic_stiffness(comm, shared_path, monkeypatch, damping, bound):
    """Exact for Rayleigh damping; for a ratio accurate to the Ritz vectors that represent the truncated modes."""
    monkeypatch.setattr(full, "ALL_MODES", 0)
    scene, structure = bar(comm, shared_path, damping, divisions=(5, 2, 4), method="full", modes=20, harmonics=1)
    K_L, M = matrices(structure)
    if damping.startswith("ratio"):
        squares, phi = scipy.linalg.eigh(K_L, M)
        C = M @ phi @ np.diag(0.02 * np.sqrt(squares)) @ phi.T @ M
    else:
        C = 30.0 * M + 1e-7 * K_L
    system, model = structure.linearised.system, model_of(scene, reduced(scene, structure, "full"))
    assert len(structure.modes.omega_n) + 56 < len(model.receptance_of(1).modes.omega_n) < system.n_dof == 324
    R, F, O = system.R.toarray(), system.loads.toarray(), system.outputs.toarray()
    for omega in structure.modes.omega_n[0] * np.array([0.7, 0.95, 1.1]):
        for n in range(2):
            exact = np.linalg.inv(K_L + 1j * n * omega * C - (n * omega) ** 2 * M)
            modes, (c,) = model.receptance_of(1).modes, model.flexibilities(omega)
            G = modes.R_phi @ c.whole(modes.R_phi.T, n)
            assert np.abs(G - R @ exact @ R.T).max() < bound * np.abs(G).max()
            out = model.receptance_of(1).static.out_static + c.between(modes.o, n, modes.b.T)
            assert np.abs(out - O @ exact @ F).max() < bound * np.abs(out).max()
    structure.linearised.destroy()


def test_full_expands_to_the_same_field_as_receptance(whole, reference):
    scene, structure = whole
    omegas, of_full, points = reference
    model = model_of(scene, reduced(scene, structure, "receptance"))
    p = model.comm.bcast(points[4].p).reshape(-1, model.N_H)
    (u,) = of_full.displacements(model_of(scene, of_full), [ActingForces(30.0, omegas[4], p)])
    assert u == pytest.approx(
        displacements(structure, model, [ActingForces(30.0, omegas[4], p)])[0], abs=1e-9 * np.abs(u).max(initial=1e-9)
    )


def test_full_beyond_the_memory_is_rejected_with_the_estimate(comm, shared_path, monkeypatch):
    monkeypatch.setattr(full, "memory_left", lambda comm: 1e5)
    with pytest.raises(CaseError, match=r'bar\.toml: \[solver\] method = "full" needs about .* GB for .* columns of 135 DOF'):
        bar(comm, shared_path, method="full")


def test_blocks_of_the_krylov_space_follow_from_the_range():
    assert full.n_blocks_for(1e-4) == 2
    assert full.n_blocks_for(0.25) == 11
    assert 0.25 ** (2 * full.n_blocks_for(0.25)) < full.ACCURACY


# -- bases ----------------------------------------------------------------------------------------------------------


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
def test_frequencies_converge_from_above(comm, shared_path, method):
    scene, structure = bar(comm, shared_path, method=method, modes=6)
    exact = np.sqrt(scipy.linalg.eigvalsh(*matrices(structure)))[:6]
    errors = []
    for n_modes in (6, 15, 30):
        modes = type(structure.modes)(structure.modes.omega_n[0] * np.ones(n_modes), structure.modes.phi_owned)
        model = reduce_by_method(structure.with_modes(modes), reduction_settings(by(scene, method))).structure
        omega_n = model.receptance_of(1).modes.omega_n
        assert (omega_n[:6] > exact * (1.0 - 1e-10)).all()
        errors.append(np.max(omega_n[:6] / exact - 1.0))
    assert errors[0] > 2.0 * errors[1] > 2.0 * errors[2] > 0.0
    structure.linearised.destroy()


def test_a_floating_body_has_six_rigid_body_modes_and_attachment_modes_orthogonal_to_them(comm, shared_path):
    scene, structure = bar(comm, shared_path, method="rubin", modes=12)
    free = free_bodies(structure, reduction_settings(scene))
    system = structure.linearised.system
    assert np.abs(free.omega_2[:6]).max() < 1e-6 * free.omega_2[6]
    Z = residual_attachment_modes(free, system.R.T.tocsc())
    M_Z = multiply(system.M, Z)
    sizes = np.sqrt(np.diag(gram(comm, Z, M_Z)))
    assert np.abs(gram(comm, free.phi_owned, M_Z)).max() < 1e-10 * sizes.max()
    first, last = system.K.getOwnershipRange()  # K Z is the load less its part on the modes
    balanced = system.R.T.toarray()[first:last] - multiply(system.M, free.phi_owned) @ gram(
        comm, free.phi_owned, system.R.T.toarray()[first:last]
    )
    assert multiply(system.K, Z) == pytest.approx(balanced, abs=1e-7)
    free.destroy()
    structure.linearised.destroy()


def test_fewer_modes_than_rigid_body_modes_are_rejected(comm, shared_path):
    scene, structure = bar(comm, shared_path, method="rubin", modes=4)
    for method in ("rubin", "rubin, condensed"):
        with pytest.raises(CaseError, match=r"bar\.toml: \[solver\] modes = 4: .* 6 rigid-body modes, .* state 6 modes at least"):
            reduced(scene, structure, method, **BASES[method])
    structure.linearised.destroy()


@pytest.mark.parametrize("method", list(METHODS))
def test_every_method_has_the_linear_response_of_a_structure_without_joints(comm, shared_path, method):
    def without_joint():
        loads = [{"vector": np.array([0.0, 1.0]), "harmonic": 1}]
        system = scenes.make_system(
            "two masses", np.eye(2), [[3.0, -1.0], [-1.0, 2.0]], [[0, -1, -1, -1, -1, -1]], mu=1.0, N0=1.0, k_t=1.0, k_n=0.0,
            C=0.02 * np.eye(2), loads=loads, output=[0.0, 1.0], omega=(0.5, 2.0), levels={},
        )  # fmt: skip
        more = {"points": 20, "modes": 2, "harmonics": 1, "error_bars": False}
        path = write_matrix_scene(shared_path, system, [1.0], (0.5, 2.0), method=method, **more)
        text = path.read_text()
        path.write_text(text[: text.index("[[joints]]")] + text[text.index("[[loads]]") :])
        return path

    with microslip.build(microslip.read(on_root(comm, without_joint)), comm) as structure:
        curve = microslip.respond(structure)["1"]
    omega = 2.0 * np.pi * curve.frequency[0]
    exact = [np.linalg.solve([[3.0 - w**2 + 0.02j * w, -1.0], [-1.0, 2.0 - w**2 + 0.02j * w]], [0.0, 1.0])[1] for w in omega]
    assert curve.amplitude[0] == pytest.approx(np.abs(exact), rel=1e-8)


@pytest.mark.ranks(1, 2)
def test_more_shapes_of_the_joint_improve_a_small_model(whole, reference):
    scene, structure = whole
    omegas, of_full, _ = reference
    best = model_of(scene, of_full)
    exact = linear_motion(best, 1.0, omegas[0], slice(None))
    few = type(structure.modes)(structure.modes.omega_n[:8], structure.modes.phi_owned[:, :8])
    for method in ("joint-interface-modes", "trial-vectors"):
        errors = []
        for n in (5, 20, 45):
            settings = reduction_settings(by(scene, method, interface_modes=n))
            model = model_of(scene, reduce_by_method(structure.with_modes(few), settings))
            assert model.n_modes == 8 + 1 + n
            trace, exact_trace = (
                np.sum(m.receptance_of(1).modes.R_phi ** 2 / m.omega_n**2) for m in (model, best)
            )  # of G_static
            errors.append(1.0 - trace / exact_trace)
            motion = linear_motion(model, 1.0, omegas[0], slice(None))
            assert np.abs(motion - exact).max() < 1e-3 * np.abs(exact).max()
        assert 1.0 > errors[0] > errors[1] > errors[2] > -1e-10
        assert errors[2] < 1e-10  # with all shapes the static columns are exact
