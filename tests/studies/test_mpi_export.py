"""The model written by `microslip export` is that of the program: compared by dense linear algebra and a separate AFT."""

import os
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg
from bar_scene import bar, by
from blocks import stacked
from matrix_scenes import write_matrix_scene
from msh import write_msh
from oracles import scenes
from rest_scene import HEIGHT, LENGTH, WIDTH, force, scene_of

from microslip.continuation.grid import at_frequencies
from microslip.library.build import build
from microslip.library.prepare import prepare
from microslip.linear.joint_springs import joint_stiffness
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.receptance.motions import linear_motion, output_motion
from microslip.scene.read import read_scene
from microslip.studies.export import command
from microslip.studies.export.interface_model import independent_rows, interface_model

pytestmark = pytest.mark.ranks(1, 2)
HZ = 2.0 * np.pi


def exported(scene, comm, folder, **options):
    command.study(scene, comm, folder, command.Request(**options))
    comm.barrier()
    return dict(np.load(folder / "model.npz"))


def stuck(model):
    return model["K"] + model["R"].T @ (model["K_J"][:, None] * model["R"])


@pytest.mark.parametrize("method", ["craig-bampton", "rubin", "trial-vectors"])
def test_matrices_have_the_linear_response_and_the_frequencies_of_the_reduction(comm, shared_path, method):
    scene, structure = bar(comm, shared_path, modes=8)
    prepared = prepare(structure, by(scene, method), has_bars=False)
    reduced, K_J = prepared.model, joint_stiffness(structure.pairs)
    own = interface_model(reduced.receptance_of(1).modes, K_J)
    K_L = own.K + own.R.T @ (K_J[:, None] * own.R)
    omega_n = np.sqrt(scipy.linalg.eigh(K_L, own.M, eigvals_only=True))
    assert omega_n[:20] == pytest.approx(reduced.omega_n[:20], rel=1e-8)
    peak = abs(output_motion(reduced, 1.0, omega_n[0], np.zeros((len(K_J), reduced.N_H)))[0, 1:3]).max()
    for omega in (0.3 * omega_n[0], 1.01 * omega_n[0], 1.7 * omega_n[2]):
        q = np.linalg.solve(K_L - omega**2 * own.M + 1j * omega * own.C, own.F[:, 0])
        y = output_motion(reduced, 1.0, omega, np.zeros((len(K_J), reduced.N_H)))
        assert abs(own.outputs[0] @ q - (y[0, 1] - 1j * y[0, 2])) <= 1e-9 * peak
        du = linear_motion(reduced, 1.0, omega, slice(None))
        assert own.R @ q == pytest.approx(du[:, 1] - 1j * du[:, 2], abs=1e-9 * np.abs(du).max())
    structure.close()


def test_the_recovery_matrix_gives_full_fields(comm, shared_path):
    scene, structure = bar(comm, shared_path, modes=8)
    model = exported(by(scene, "craig-bampton"), comm, shared_path / "out", recovery=True)
    u = np.load(shared_path / "out" / "recovery.npz")
    corner = np.flatnonzero(np.all(np.isclose(u["points"], (0.0, 0.0, 0.02)), axis=1))
    assert u["recovery"][corner[0], 0] == pytest.approx(model["outputs"][0], abs=1e-10 * np.abs(model["outputs"]).max())
    node = structure.pairs.node1, structure.pairs.node2
    relative = u["recovery"][node[0]] - u["recovery"][node[1]]
    along = np.einsum("pij,pjn->pin", model["frame"], relative).reshape(-1, relative.shape[2])
    assert along == pytest.approx(model["R"], abs=1e-8)
    structure.close()


def test_all_files_have_the_same_contents_without_objects(comm, shared_path):
    scene, structure = bar(comm, shared_path, modes=8)
    structure.close()
    model = exported(scene, comm, shared_path / "out")
    in_mat = scipy.io.loadmat(shared_path / "out" / "model.mat")
    assert all(np.array_equal(in_mat[name], model[name]) for name in ("M", "C", "K", "R"))
    assert in_mat["law"][0, 0][0] == "elastic-coulomb" and all(values.dtype.kind in "fiU" for values in model.values())
    text = (shared_path / "out" / "README.txt").read_text()
    assert all(f"\n{name} " in text for name in model) and "return-map" in text and "friction in each direction" in text
    files = {"nlvib_residual.m", "run_nlvib.m", "run_tmdsimpy.py", "run_pyharm.py", "exported_model.py"}
    assert files <= set(os.listdir(shared_path / "out"))
    for name in files:
        if name.endswith(".py"):
            compile((shared_path / "out" / name).read_text(), name, "exec")


@pytest.mark.ranks(2)
def test_exported_matrices_do_not_depend_on_the_ranks(comm, shared_path):
    from mpi4py import MPI

    scene, structure = bar(comm, shared_path, modes=8)
    structure.close()
    on_all = exported(by(scene, "rubin", condensed=True), comm, shared_path / "two")
    if comm.rank == 0:
        on_one = exported(by(scene, "rubin", condensed=True), MPI.COMM_SELF, shared_path / "one")
        for name in ("M", "C", "K", "R", "load", "outputs"):
            assert on_all[name] == pytest.approx(on_one[name], abs=1e-7 * np.abs(on_one[name]).max()), name


# -- an AFT that is independent of the program ----------------------------------------------------------------------


def forces(model, du, periods=2):
    """Return f_nl at samples (n_t, 3 n_pairs) by the return map along each direction, in the second of two periods."""
    mu, k_t, k_n, N0 = (model[name] for name in ("mu", "k_t", "k_n", "N0"))
    N = np.maximum(N0 - k_n * du[:, 2::3], 0.0)
    f = np.empty_like(du)
    f[:, 2::3] = np.maximum(N0, 0.0) - N
    for axis in (0, 1):
        u, w = du[:, axis::3], np.zeros(len(mu))
        for _ in range(periods):
            for t in range(len(u)):
                T = np.clip(k_t * (u[t] - w), -mu * N[t], mu * N[t])
                w = u[t] - T / k_t
                f[t, axis::3] = T
    return f


def own_response(model, level, omega):
    """Return the coefficients of q, (n, 2 H + 1), by finite differences and Newton's method."""
    H, n_t, n = int(model["harmonics"]), int(model["samples"]), len(model["M"])
    tau = np.arange(n_t) * HZ / n_t
    basis = np.stack([np.ones(n_t)] + [part(k * tau) for k in range(1, H + 1) for part in (np.cos, np.sin)])
    to_coefficients = basis.T / n_t * np.r_[1.0, np.full(2 * H, 2.0)]
    load = level * model["load"]

    def residual(x):
        q = x.reshape(n, -1)
        k = np.repeat(np.arange(H + 1), [1] + [2] * H)
        rate = np.zeros_like(q)
        rate[:, 1::2], rate[:, 2::2] = q[:, 2::2], -q[:, 1::2]
        inner = model["K"] @ q - model["M"] @ q * (k * omega) ** 2 + model["C"] @ rate * (k * omega)
        f = forces(model, (model["R"] @ q @ basis).T)
        return (inner + model["R"].T @ (f.T @ to_coefficients) - load).ravel()

    x = np.zeros(load.size)
    start = np.linalg.solve(stuck(model) - omega**2 * model["M"] + 1j * omega * model["C"], load[:, 1] - 1j * load[:, 2])
    x.reshape(n, -1)[:, 1], x.reshape(n, -1)[:, 2] = start.real, -start.imag
    for _ in range(40):
        r = residual(x)
        if np.linalg.norm(r) < 1e-11 * np.linalg.norm(load):
            return x.reshape(n, -1)
        h = 1e-6 * np.abs(x).max()
        J = np.stack([(residual(x + h * one) - residual(x - h * one)) / (2.0 * h) for one in np.eye(len(x))], axis=1)
        step, share = np.linalg.solve(J, r), 1.0
        while np.linalg.norm(residual(x - share * step)) > np.linalg.norm(r) and share > 1e-2:
            share /= 2.0
        x = x - share * step
    raise AssertionError("no solution")


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_another_program_on_the_export_has_the_same_response(comm, tmp_path):
    """The response of microslip and that of the equations of README.txt agree to 1e-6 of the peak."""
    path = write_matrix_scene(
        tmp_path,
        scenes.spatial_mass(),
        (0.3,),
        (0.9, 2.2),
        outputs=[0, 2],
        harmonics=2,
        samples=32,
        method="craig-bampton",
        between_samples="return-map",
        tolerance=1e-10,
    )
    path.write_text(path.read_text().replace('friction_limit = "circle"', 'friction_limit = "separate"'))
    scene = read_scene(path)
    model = exported(scene, comm, tmp_path / "out")
    assert model["separate"].all() and (model["N0"] > 0.0).all()
    with build(scene, comm) as structure:
        response = prepare(structure, has_bars=False).response
        branch = at_frequencies(response.at_level(0.3), response.selection, [1.2, 1.5], tolerance=1e-10)
    assert not branch.failure and any(point.friction > 0.0 for point in branch.points)
    for point in branch.points:
        own = model["outputs"] @ own_response(model, 0.3, point.omega)
        assert own == pytest.approx(point.response, abs=1e-6 * np.abs(point.response).max())


# -- the same for parallel sliders, from README.txt only -----------------------------------------------------------------


def forces_of_sliders(model, du, w0, periods=4):
    """Return f_nl at samples (n_t, 3 n_pairs) of pairs of parallel sliders that start at ``w0``, in the last of some periods."""
    k, limit, rate = (np.nan_to_num(model[f"slider_{name}"]) for name in ("k_t", "limit", "rate"))
    N0, k_n, x, y, z = model["N0"], model["k_n"], du[:, 0::3], du[:, 1::3], du[:, 2::3]
    m = model.get("law_exponent", np.full(len(k), np.nan))
    f = np.empty_like(du)
    with np.errstate(invalid="ignore"):
        power = N0 * np.maximum(0.0, 1.0 - k_n * z / (m * N0)) ** m
        N = np.where(np.isinf(m), N0 * np.exp(-k_n * z / N0), power)
    f[:, 2::3] = np.where(model["law"] == "iwan", k_n * z, N0 - N)
    largest = np.maximum(0.0, limit - rate * z[:, :, None])
    for axis, u in enumerate((x, y)):
        w = w0[:, :, axis].copy()
        for _ in range(periods):
            for t in range(len(u)):
                T = np.clip(k * (u[t][:, None] - w), -largest[t], largest[t])
                w = u[t][:, None] - np.divide(T, k, out=np.zeros_like(T), where=k > 0.0)
                f[t, axis::3] = (T + k * w0[:, :, axis]).sum(axis=1)
    return f


def answered(model, level, omega, du, w0):
    """Return the coefficients of q under the forces of the motion ``du`` (3 n_pairs, 2 H + 1)."""
    H, n_t = int(model["harmonics"]), int(model["samples"])
    tau = np.arange(n_t) * HZ / n_t
    basis = np.stack([np.ones(n_t)] + [part(k * tau) for k in range(1, H + 1) for part in (np.cos, np.sin)])
    f = forces_of_sliders(model, (du @ basis).T, w0).T @ (basis.T / n_t * np.r_[1.0, np.full(2 * H, 2.0)])
    right = level * model["load"] - model["R"].T @ (f - model["K_J"][:, None] * du)
    q = np.empty_like(right)
    q[:, 0] = np.linalg.solve(stuck(model), right[:, 0])
    for n in range(1, H + 1):
        dynamic = stuck(model) - (n * omega) ** 2 * model["M"] + 1j * n * omega * model["C"]
        amplitude = np.linalg.solve(dynamic, right[:, 2 * n - 1] - 1j * right[:, 2 * n])
        q[:, 2 * n - 1], q[:, 2 * n] = amplitude.real, -amplitude.imag
    return q


ELASTIC = 'friction = 0.3\ntangential_stiffness = 1.0e12\nnormal_stiffness = 2.0e12\npreload = "static"\n'
LAWS_AT_REST = {
    "rough": 'law = "rough"\nfriction = 0.3\npreload = 1e6\nroughness_height = 2e-6\nsliders = 6\nfriction_limit = "separate"\n',
    "iwan": 'law = "iwan"\nslip_force = 400.0\ntangential_stiffness = 1e12\nnormal_stiffness = 2e12\nchi = -0.5\nbeta = 0.3\n',
}


@pytest.mark.study
@pytest.mark.ranks(1)
@pytest.mark.parametrize("law", LAWS_AT_REST)
def test_exported_sliders_have_the_motion_of_the_program(comm, tmp_path, law):
    """The motion of microslip is the response of the exported equations to its forces, with the same start of the sliders."""
    write_msh(str(tmp_path / "bar.msh"), stacked("hex8", (LENGTH, WIDTH, HEIGHT), (4, 2, 1), 0.005))
    changes = (
        (ELASTIC, LAWS_AT_REST[law]),
        ("modes = 8", 'modes = 8\nmethod = "craig-bampton"\nbetween_samples = "return-map"\ntolerance = 1e-11'),
        ("[response]\nlevels = [5.0]", "[response]\nlevels = [40.0]"),
    )
    scene = scene_of(comm, tmp_path, force(150.0, 50.0, -700.0), *changes)
    model = exported(scene, comm, tmp_path / "out")
    with build(scene, comm) as structure:
        response, omega_1 = prepare(structure, has_bars=False).response, structure.modes.omega_n[0]
        branch = at_frequencies(response.at_level(40.0), response.selection, [0.98 * omega_1, 1.003 * omega_1], tolerance=1e-11)
        assert np.allclose(model["slider_w0"], structure.pairs.w0, equal_nan=True) or structure.pairs.w0.size == 0
    assert not branch.failure and all(point.friction > 0.0 for point in branch.points)
    for point in branch.points:
        du = point.U.reshape(-1, point.U.shape[-1])
        own = answered(model, 40.0, point.omega, du, model["slider_w0"])
        assert model["R"] @ own == pytest.approx(du, abs=1e-7 * np.abs(du).max())
        assert model["outputs"] @ own == pytest.approx(point.response, abs=1e-7 * np.abs(point.response).max())
        without = answered(model, 40.0, point.omega, du, np.zeros_like(model["slider_w0"]))
        assert np.abs(model["outputs"] @ (without - own)).max() > 1e-4 * np.abs(point.response).max()
    text = (tmp_path / "out" / "README.txt").read_text()
    assert (
        all(f"\nslider_{name} " in text for name in ("k_t", "limit", "rate", "w0"))
        and f"no script can run pairs of the law {law}" in text
    )


@pytest.mark.ranks(1)
def test_dependent_relative_displacements_follow_from_the_others():
    B = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 2.0], [2.0, 0.0, 4.0], [0.0, 1e-9, 0.0], [1.0, 1e-9, 2.0]])
    assert independent_rows(B).tolist() == [1, 3]


@pytest.mark.ranks(1)
@pytest.mark.parametrize(
    "method, message", [("receptance", "exact static response"), ("rubbin", "nearest is rubin"), ("x", "unknown method 'x'")]
)
def test_a_method_without_finite_matrices_is_rejected(comm, tmp_path, method, message):
    with pytest.raises(CaseError, match=f"--method: .*{message}"):
        command.study(None, comm, tmp_path, command.Request(method))
    assert not list(tmp_path.iterdir())


def test_command(program, comm, shared_path):
    path = on_root(comm, lambda: write_matrix_scene(shared_path, scenes.chain(), (0.5,), (390.0, 590.0), outputs=[0]))
    status, messages, _ = program("export", path, "--out", shared_path / "out", "--recovery")
    assert status == 0 and "relative displacements of 2 pairs" in messages
    model, full = np.load(shared_path / "out" / "model.npz"), scenes.chain()
    recovery = np.load(shared_path / "out" / "recovery.npz")["recovery"]
    assert recovery[0] == pytest.approx(model["outputs"][0], abs=1e-12)
    M = np.asarray(full["M"].todense() if hasattr(full["M"], "todense") else full["M"])
    assert recovery.T @ M @ recovery == pytest.approx(model["M"], abs=1e-9 * np.abs(model["M"]).max())


def test_scripts_follow_a_softening_spring_and_write_its_response(comm, shared_path):
    """One coordinate with stiffness 1 + x / 10: the shared Newton's method converges to the root at each frequency."""
    if comm.rank:
        return
    place = shared_path / "scripts"
    place.mkdir()
    code = Path(command.__file__).parent / "scripts" / "exported_model.py"
    names = {}
    exec(compile(code.read_text(), str(code), "exec"), names)
    model = {"frequency": np.array([0.1, 0.05]), "outputs": np.ones((1, 1)), "output_order": np.array([1.0]), "harmonics": 1}
    model |= {"output_p": np.zeros((1, 3)), "output_base": np.zeros((1, 3)), "output_name": np.array(["v"])}

    def evaluate(x, omega):
        stiffness = 1.0 + 0.1 * x - omega**2
        return stiffness * x - 1.0, np.array([stiffness[0] + 0.1 * x[0]]).reshape(1, 1)

    rows = names["follow"](model, 2.0, evaluate, np.zeros(1), 1.0, lambda x: np.array([[0.0, x[0], 0.0]]))
    for _, frequency, _, mean, cos, sin in rows:
        omega = 2.0 * np.pi * frequency
        c = 1.0 - omega**2
        assert (mean, cos) == (0.0, 0.0) and -sin / omega == pytest.approx((-c + np.sqrt(c**2 + 0.4)) / 0.2, rel=1e-9)
    names["write"](model, place / "x.csv", rows)
    assert (place / "x.csv").read_text().splitlines()[0] == "level_N,frequency_Hz,seconds,v mean,v cos 1,v sin 1"
