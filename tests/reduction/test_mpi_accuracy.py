"""`accuracy`: the bound of the effect of truncated modes, and the modes selected by it."""

import numpy as np
import pytest
import scipy.sparse as sp
from matrix_scenes import branches_of, requested, write_matrix_scene
from mpi4py import MPI

from microslip.fourier.harmonics import Harmonics
from microslip.library.build import build, from_matrices
from microslip.library.settings import reduction_settings
from microslip.linear.joint_springs import linearise
from microslip.messages.errors import CaseError
from microslip.modes.eigen import lowest_modes
from microslip.modes.limits import most_modes, refuse_too_many
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.receptance.damping import Damping
from microslip.receptance.modes import DampedModes
from microslip.reduction import choose_modes
from microslip.reduction.modal_structure import stuck_receptance
from microslip.reduction.stuck import StuckStructure, static_response
from microslip.reduction.truncation import Norms, gains, truncation_bound
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)

comm = MPI.COMM_WORLD


def chain(n, damping=None):
    """Return n unit masses in a row on springs of 1e6 N/m, with a slider at its end and three along it."""
    K = sp.diags([np.r_[np.full(n - 1, 2.0), 1.0], -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1], format="csc") * 1e6
    end, dofs = n - 1, -np.ones((4, 6), dtype=int)
    dofs[:, 0], dofs[1, 3], dofs[3, 3] = [end, n // 2, 3 * n // 4, n // 4], n // 2 + 1, n // 4 + 1
    load = np.zeros(n)
    load[end] = 1.0
    system = {
        "K": K,
        "M": sp.identity(n, format="csc"),
        "pair_dofs": dofs,
        "mu": np.full(4, 0.3),
        "k_n": np.full(4, 1e6),
        "N0": np.array([20.0, 400.0, 10.0, 400.0]),
        "k_t": np.array([2e3, 1e6, 1e3, 1e6]) * 200 / n,
        "separate": np.zeros(4, dtype=bool),
        "loads": [{"vector": load, "harmonic": 1}],
    }
    if damping is None:
        return system | {"zeta": 0.01}
    C = (damping * K).tolil()
    C[n // 2, n // 2] += 3.0
    return system | {"C": C.tocsc()}


def written(folder, system, **solver):
    """Write a scene around the first mode of a chain.  Collective: rank 0 writes."""
    n = system["K"].shape[0]
    omega = 2e3 * np.sin(np.pi / (4 * n + 2))
    keys = {"outputs": [n - 1, n // 3], "points": 30, "harmonics": 3, **solver}
    sweep = {"levels": [0.5, 4.0, 12.0], "frequencies": [0.9 * omega, 1.15 * omega]}
    at = list(np.linspace(0.95, 1.12, 8) * omega)
    on_root(comm, lambda: write_matrix_scene(folder, system | {"M": system["M"].tocsc()}, at=at, **sweep, **keys), share=False)
    return folder / "scene.toml"


def structure_of(path):
    lines = []
    log = RunLog(comm, screen=False)
    log.note = lines.append
    return build(read_scene(path), comm, log), lines[-1]


def all_modes(path):
    """Return scene and stuck structure with all of its modes."""
    scene = read_scene(path)
    _, rest = from_matrices(scene, comm, RunLog(comm, screen=False))
    system, pairs = rest.system, rest.pairs
    linearised = linearise(system, pairs)
    return scene, StuckStructure.of(linearised, pairs, static_response(linearised), lowest_modes(linearised, system.n_dof))


def test_gains_bound_every_truncated_mode():
    omega_n, zeta = np.array([10.0, 12.0, 30.0, 31.0, 80.0]), np.array([0.01, 0.2, 0.01, 0.3, 0.05])
    family = DampedModes(omega_n, Damping(2.0 * zeta * omega_n), *np.zeros((3, 0, 0)))
    for omega in np.linspace(0.1, 60.0, 400):
        c = np.abs(family.flexibility(Harmonics((1,)), omega).c[:, 0]) * omega_n**2
        exact = np.array([c[m:].max() for m in range(1, 5)])
        assert np.all(gains(family, omega)[:4] >= (1.0 - 1e-12) * exact)


@pytest.mark.ranks(1, 2, 3)
def test_residual_norms_are_sums_over_the_truncated_modes(shared_path):
    scene, stuck = all_modes(written(shared_path, chain(40)))
    x = np.random.default_rng(1).standard_normal((40, 2)) @ np.array([[1.0, 0.3j, 1.0], [0.5j, 1.0, 0.0]])
    first, last = stuck.linearised.M.getOwnershipRange()
    phi = np.concatenate(comm.allgather(stuck.modes.phi_owned))
    share = np.abs(phi.T @ x / stuck.modes.omega_n[:, None]) ** 2
    exact = [share[m:].sum(axis=0) for m in range(1, 41)]
    settings = reduction_settings(scene)
    norms = Norms(stuck, stuck_receptance(stuck, settings.damping), settings)
    computed = norms.of_forces(x[first:last]) ** 2
    np.testing.assert_allclose(computed, exact, rtol=1e-9, atol=1e-12 * share.sum())
    p = np.random.default_rng(2).standard_normal((12, 2)) @ np.array([[1.0, 0.5j], [0.0, 1.0 - 1.0j]])
    solved = norms.of_pairs(p)  # by solves
    stuck.statics.G_static.require(np.arange(4))
    np.testing.assert_allclose(norms.of_pairs(p) ** 2, solved**2, rtol=1e-9, atol=1e-12 * solved.max() ** 2)  # by static columns
    stuck.linearised.destroy()


@pytest.mark.slow
@pytest.mark.parametrize(
    "n, damping, asked_for",
    [(40, None, (1e-1, 1e-3)), pytest.param(40, 1e-4, (1e-1, 1e-2), marks=pytest.mark.ranks(1))],
    ids=["modal", "full"],
)
def test_the_true_error_is_within_the_requested_accuracy(shared_path, n, damping, asked_for):
    def curves(**solver):
        path = written(shared_path, chain(n, damping), points=8, **solver)
        return comm.bcast(np.array([[point.response for point in requested(branch)] for branch in branches_of(path, comm)]))

    reference = curves(modes=n)
    peak = np.abs(reference).max(axis=(1, 3))[:, None, :, None]  # below the linear peak
    values = []
    for accuracy in asked_for:
        structure, line = structure_of(written(shared_path, chain(n, damping), accuracy=accuracy))
        structure.linearised.destroy()
        values.append(len(structure.modes.omega_n))
        assert line.startswith(f"modes: {values[-1]}, picked for accuracy {accuracy:g}: those left out, from ")
        assert (np.abs(curves(modes=values[-1]) - reference) / peak).max() <= accuracy
    assert sorted(set(values)) == values and values[-1] < n


def test_batches_grow_until_the_bound_is_met_without_missing_modes(shared_path):
    """450 DOFs: SLEPc computes 16, 32, ... modes, and a count verifies the selected modes."""
    structure, line = structure_of(written(shared_path, chain(450), accuracy=1e-5))
    n_modes = len(structure.modes.omega_n)
    assert 16 < n_modes < 64 and not structure.modes.info["complete"] and "modes below" in structure.modes.info["proof"]
    structure.linearised.destroy()
    scene, stuck = all_modes(written(shared_path, chain(450)))
    bound = truncation_bound(stuck, reduction_settings(scene)).total
    assert int(np.argmax(bound <= 1e-5)) + 1 == n_modes  # the same from all modes
    stuck.linearised.destroy()
    stated, line = structure_of(written(shared_path, chain(450), accuracy=1e-5, modes=7))
    assert len(stated.modes.omega_n) == 7 and line == "modes: 7, stated by [solver] modes"
    stated.linearised.destroy()


@pytest.mark.study
def test_an_accuracy_out_of_reach(shared_path, monkeypatch):
    monkeypatch.setattr(choose_modes, "_MOST", 32)
    with pytest.raises(
        CaseError,
        match=r"scene.toml: \[solver\] accuracy = 1e-06: 31 modes reach about .*, and the program chooses no more; state",
    ):
        structure_of(written(shared_path, chain(450), accuracy=1e-6))
    monkeypatch.setattr("microslip.library.settings.ACCURACY_OF_MODES", 1e-6)
    structure, line = structure_of(written(shared_path, chain(450)))
    assert len(structure.modes.omega_n) == 31 and "which misses the default accuracy 1e-06" in line
    structure.linearised.destroy()


@pytest.mark.filterwarnings("error")
@pytest.mark.ranks(1)
def test_a_resonance_without_damping_gives_no_warnings(shared_path):
    """Permitted without a stated accuracy: friction may limit a motion that damping does not."""
    system = chain(450) | {"zeta": 0.0, "M": sp.identity(450, format="csc")}
    on_root(comm, lambda: write_matrix_scene(shared_path, system, [1.0], [3.0, 5.0], outputs=[449], points=30), share=False)
    structure, line = structure_of(shared_path / "scene.toml")
    assert len(structure.modes.omega_n) == 450 and "leaving any out would cost the accuracy" in line
    assert "nothing damps a resonance in the range, and its linear peak" in line
    structure.linearised.destroy()


@pytest.mark.ranks(1, 2)
def test_an_accuracy_of_a_resonance_without_damping_is_rejected(shared_path):
    """Its linear peak is infinite, so that no number of modes has a bound."""
    system = chain(450) | {"zeta": 0.0, "M": sp.identity(450, format="csc")}
    on_root(
        comm,
        lambda: write_matrix_scene(shared_path, system, [1.0], [3.0, 5.0], outputs=[449], points=30, accuracy=1e-3),
        share=False,
    )
    with pytest.raises(CaseError, match=r"scene.toml: \[solver\] accuracy = 0.001: .*a resonance without damping in the range"):
        structure_of(shared_path / "scene.toml")


@pytest.mark.ranks(1, 2, 3)
def test_a_small_structure_has_all_of_its_modes(shared_path):
    structure, line = structure_of(written(shared_path, chain(20)))
    assert len(structure.modes.omega_n) == 20 and line == "modes: all 20 there are"
    structure.linearised.destroy()


def test_too_many_modes_are_rejected_with_file_and_key():
    for n_modes, n_dof in ((None, 5), (5, 5), (4000, 4000), (1333, 4001)):
        refuse_too_many(n_modes, n_dof, "fan.toml")
    assert [most_modes(n) for n in (7, 4000, 4001, 30_000)] == [7, 4000, 1333, 10_000]
    with pytest.raises(CaseError, match=r"fan.toml: \[solver\] modes = 8: the structure has only 7 degrees of freedom"):
        refuse_too_many(8, 7, "fan.toml")
    with pytest.raises(CaseError, match=r"fan.toml: \[solver\] modes = 10001: more than a third of the 30000.*at most 10000"):
        refuse_too_many(10_001, 30_000, "fan.toml")
