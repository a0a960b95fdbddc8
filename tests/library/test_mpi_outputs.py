"""Velocity, acceleration, stress, strain, contact force and a moving base: closed forms, dense algebra, every method."""

import csv

import h5py
import numpy as np
import pytest
import small_fe
from bar_loads import LOADS, dense, reduced_model, scene_with
from bar_scene import COARSE, COARSE_DOF, COARSE_PAIRS, EVERY_METHOD, by
from blocks import box
from msh import write_msh
from scene_text import steel, support, table

import microslip
from microslip.fourier.amplitudes import to_complex
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.receptance.motions import output_motion

PLACE = "position = [0.05, 0.01, 0.0]\n"
ALONG = PLACE + "direction = [1.0, 0.5, 0.2]\n"


def output(name, lines):
    return f'[[outputs]]\nname = "{name}"\n{lines}'


OUTPUTS = "".join(
    [
        output("u", ALONG),
        output("v", ALONG + 'quantity = "velocity"\n'),
        output("a", ALONG + 'quantity = "acceleration"\n'),
        output("sigma", PLACE + 'quantity = "stress"\ncomponent = "xx"\n'),
        output("tau", PLACE + 'quantity = "stress"\ncomponent = "zx"\n'),
        output("gamma", PLACE + 'quantity = "strain"\ncomponent = "zx"\n'),
        output("force", 'quantity = "contact_force"\njoint = "joint"\ndirection = [1.0, 0.5, 0.2]\n'),
        output("normal", 'quantity = "contact_force"\njoint = "joint"\ncomponent = "normal"\n'),
    ]
)
BASE = "[[loads]]\nbase_acceleration = [1.0, 0.5, 0.0]\nphase = 0.4\n"
ABSOLUTE = "".join(
    output(quantity, ALONG + f'quantity = "{quantity}"\nabsolute = true\n')
    for quantity in ("displacement", "velocity", "acceleration")
)


def stuck_stiffness(structure):
    K, M, K_J = dense(structure)
    R = structure.linearised.system.R.toarray()
    return K + R.T @ K_J @ R, M, K_J, R


def test_every_method_meets_a_direct_solution(comm, shared_path):
    """Under a load and any contact forces, in every harmonic."""
    scene = scene_with(comm, shared_path, outputs=OUTPUTS, damping="rayleigh = [200.0, 1e-6]", harmonics=2, **COARSE)
    with microslip.build(scene, comm) as structure:
        system, omega = structure.linearised.system, 1.003 * structure.modes.omega_n[0]
        K_L, M, K_J, R = stuck_stiffness(structure)
        C = 200.0 * M + 1e-6 * K_L
        p = np.random.default_rng(7).standard_normal((3 * COARSE_PAIRS, 5))
        f = np.zeros((COARSE_DOF, 5))
        f[:, 1] = system.loads.toarray()[:, 0]
        forces, p_n = to_complex(f - R.T @ p), to_complex(p)
        u = np.column_stack([np.linalg.solve(K_L - (n * omega) ** 2 * M + 1j * n * omega * C, forces[:, n]) for n in range(3)])
        exact = system.outputs @ u
        i_omega = 1j * omega * np.arange(3)
        exact[1], exact[2] = i_omega * exact[0], i_omega**2 * exact[0]
        f_nl = (K_J @ R @ u + p_n).reshape(COARSE_PAIRS, 3, 3)  # pair, direction, harmonic
        on_body_1 = -np.einsum("pia,pin->an", structure.pairs.frame, f_nl)
        exact[6], exact[7] = np.array([1.0, 0.5, 0.2]) @ on_body_1, -f_nl[:, 2].sum(axis=0)
        np.testing.assert_allclose(exact[5] * 2.0 * 2.1e11 / 2.6, exact[4], rtol=1e-9)
        scale = np.abs(exact).max(axis=1, keepdims=True)
        for method, keys in EVERY_METHOD.items():
            amplitudes = to_complex(output_motion(reduced_model(structure, by(scene, method, **keys)), 1.0, omega, p))
            np.testing.assert_allclose(amplitudes / scale, exact / scale, rtol=0.0, atol=1e-8, err_msg=method)


@pytest.mark.ranks(1)
@pytest.mark.slow
def test_contact_forces_and_loads_accelerate_the_bar(comm, shared_path):
    """Newton's law of the bar, supported only by its joint, while pairs slip: without damping, in every harmonic."""
    forces = "".join(
        output(axis, f'quantity = "contact_force"\njoint = "joint"\ndirection = {direction}\n')
        for axis, direction in zip("xyz", np.eye(3).tolist())
    )
    scene = scene_with(comm, shared_path, outputs=forces, damping="ratio = 0.0", samples=64, tolerance=1e-11, points=3, **COARSE)
    with microslip.build(scene, comm) as structure:
        low = float(0.97 * structure.modes.frequency[0])
        response = microslip.respond(structure, levels=[60.0], frequencies=(low, 1.015 * low), error_bars=False)
        (level,) = response.results.levels
        i = int(np.argmax((level.state > 0).sum(axis=1)))
        frequency, u = response.fields(60.0, level.frequency[i])
        if comm.rank == 0:
            mesh = structure.mesh
            ((kind, nodes),) = [(block.kind, block.nodes) for block in mesh.elements if block.group == "bar"]
            _, M = small_fe.assemble(kind, mesh.points, nodes, 2.1e11, 0.3, 7800.0)
            M.resize((mesh.points.size, mesh.points.size))
            total = (M @ u.reshape(M.shape[0], -1)).reshape(u.shape).sum(axis=0)  # (3, N_H)
            n = np.array([0, 1, 1, 2, 2, 3, 3])
            inertia = -((2.0 * np.pi * frequency * n) ** 2) * total
            load = np.zeros((3, 7))
            load[:, 1] = 60.0 * np.array([1.0, 0.3, 0.2])
            np.testing.assert_allclose(level.response[i] + load, inertia, atol=1e-6 * np.abs(inertia).max())
    assert (level.state[i] == 1).any()


def test_a_moving_base_is_a_moving_support(comm, shared_path):
    """Absolute motion with the fixed nodes driven by -a / omega^2, and the relative motion; without damping."""
    outputs = ABSOLUTE + output("relative", ALONG)
    scene = scene_with(comm, shared_path, loads=BASE, outputs=outputs, damping="ratio = 0.0", **COARSE)
    with microslip.build(scene, comm) as structure:
        K_L, M, _, _ = stuck_stiffness(structure)
        omega, system = 0.97 * structure.modes.omega_n[0], structure.linearised.system
        level, a = 3.0, 3.0 * np.exp(0.4j) * np.array([1.0, 0.5, 0.0])
        exact = None
        if comm.rank == 0:
            mesh, Z = structure.mesh, 0.0
            for block in mesh.elements:
                K_all, M_all = small_fe.assemble(block.kind, mesh.points, block.nodes, 2.1e11, 0.3, 7800.0)
                K_all.resize((mesh.points.size, mesh.points.size))
                M_all.resize((mesh.points.size, mesh.points.size))
                Z = Z + (K_all - omega**2 * M_all)
            rows = system.dof.ravel()
            base = np.tile(-a / omega**2, len(mesh.points))
            driven = -(Z @ np.where(rows < 0, base, 0.0))
            f = np.zeros(COARSE_DOF, dtype=complex)
            f[rows[rows >= 0]] = driven[rows >= 0]
            u = np.linalg.solve(K_L - omega**2 * M, f)
            along = system.outputs.toarray()[3]
            of_base = np.array([1.0, 0.5, 0.2]) @ (-a / omega**2)
            exact = along @ u * np.array([1.0, 1j * omega, -(omega**2), 1.0]) - [0.0, 0.0, 0.0, of_base]
        exact = comm.bcast(exact)
        p = np.zeros((3 * COARSE_PAIRS, 7))
        for method, keys in EVERY_METHOD.items():
            amplitudes = to_complex(output_motion(reduced_model(structure, by(scene, method, **keys)), level, omega, p))
            np.testing.assert_allclose(amplitudes[:, 1] / exact, 1.0, rtol=1e-8, err_msg=method)
            assert not np.abs(amplitudes[:, [0, 2, 3]]).max()


YOUNG, DENSITY, LENGTH, SIDE = 2.0e11, 8000.0, 1.0, 0.05
ROD = (
    table("model", mesh="rod.msh")
    + steel("rod", young=YOUNG, poisson=0.0, density=DENSITY)
    + support("root")
    + "LOADS\n"
    + table("damping", ratio=0.0)
    + table("response", levels=[1.0], frequencies=[500.0, 4000.0])
    + table("solver", modes=80)
)


def rod(comm, folder, tables):
    def write():
        body = box("hex20", (LENGTH, SIDE, SIDE), (24, 1, 1), (0.0, 0.0, 0.0), {"x0": "root", "x1": "tip"})
        write_msh(str(folder / "rod.msh"), {"rod": body})
        (folder / "rod.toml").write_text(ROD.replace("LOADS", tables))
        return folder / "rod.toml"

    return microslip.read(on_root(comm, write))


@pytest.mark.slow
@pytest.mark.ranks(1, 2)
def test_a_rod_under_pressure_and_on_a_moving_base(comm, shared_path):
    """Longitudinal waves, c^2 = E / rho: stress p cos(k x) / cos(k L) under a pressure p at the tip, tip / base = 1 / cos(k L)."""
    root = "position = [0.0, 0.0, 0.0]\n"
    tables = [
        '[[loads]]\ngroup = "tip"\npressure = 5.0\n' + output("stress", root + 'quantity = "stress"\ncomponent = "xx"\n'),
        "[[loads]]\nbase_acceleration = [2.0, 0.0, 0.0]\n"
        + output("tip", f"position = [{LENGTH}, 0.0, 0.0]\ndirection = [1.0, 0.0, 0.0]\nabsolute = true\n")
        + output("strain", root + 'quantity = "strain"\ncomponent = "xx"\n'),
    ]
    for frequency in (700.0, 3000.0):
        omega, values = 2.0 * np.pi * frequency, []
        k = omega * np.sqrt(DENSITY / YOUNG)
        for text in tables:
            with microslip.build(rod(comm, shared_path, text), comm) as structure:
                model = reduced_model(structure)
                values.append(to_complex(output_motion(model, 1.0, omega, np.zeros((0, model.N_H))))[:, 1].real)
        assert values[0][0] == pytest.approx(-5.0 / np.cos(k * LENGTH), rel=3e-3)  # the fit is linear within an element
        base = -2.0 / omega**2
        assert values[1][0] == pytest.approx(base / np.cos(k * LENGTH), rel=1e-4)
        assert values[1][1] == pytest.approx(base * k * np.tan(k * LENGTH), rel=2e-3)


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_error_bars_are_valid_for_every_output(comm, shared_path):
    """Three harmonics compared with thirteen, with slip; error bars of a velocity are omega times those of the displacement."""
    scene = scene_with(comm, shared_path, outputs=OUTPUTS, samples=64, points=3, **COARSE)
    with microslip.build(scene, comm) as structure:
        top = float(structure.modes.frequency[0])
        keys = {"levels": [40.0], "frequencies": (0.98 * top, top), "at": [0.985 * top, 0.995 * top]}
        coarse, fine = (
            microslip.respond(structure, **keys, **more) for more in ({}, {"harmonics": 13, "samples": 512, "error_bars": False})
        )
        few = microslip.respond(structure, modes=10, **keys)
    chosen, exact = (np.flatnonzero(one.results.levels[0].requested) for one in (coarse, fine))
    assert (coarse.results.levels[0].state[chosen] == 1).any()
    for name in coarse.outputs:
        a, b = coarse[name], fine[name]
        missed = np.abs(a.harmonic(1)[0, chosen] - b.harmonic(1)[0, exact])
        assert (missed <= a.error[0, chosen] + 1e-12 * a.amplitude.max()).all(), name
        assert (a.error[0, chosen] <= 0.15 * a.amplitude.max()).all(), name
    for response in (coarse, few):
        omega = 2.0 * np.pi * response["u"].frequency[0]
        assert response["v"].error[0] == pytest.approx(omega * response["u"].error[0], rel=1e-2)
        assert response["a"].error[0] == pytest.approx(omega**2 * response["u"].error[0], rel=1e-2)
        assert response["tau"].error[0] == pytest.approx(2.0 * 2.1e11 / 2.6 * response["gamma"].error[0], rel=1e-2)


@pytest.mark.slow
@pytest.mark.ranks(2)
def test_files_state_the_units(comm, shared_path, monkeypatch):
    monkeypatch.setattr("microslip.results.plots.draw_all", lambda *files: [])
    scene = scene_with(comm, shared_path, loads=BASE, outputs=ABSOLUTE + OUTPUTS, points=3, samples=64, **COARSE)
    with microslip.build(scene, comm) as structure:
        response = microslip.respond(structure, error_bars=False, levels=[3.0])
        response.save(shared_path / "out")
        response.plot(shared_path / "response.png")
    units = ("m", "m/s", "m/s2", "m", "m/s", "m/s2", "Pa", "Pa", "1", "N", "N")
    if comm.rank == 0:
        with open(shared_path / "out" / "frf.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        assert {row["output"]: row["unit"] for row in rows} == dict(zip(response.outputs, units))
        results = microslip.read_results(shared_path / "out" / "results.h5")
        assert results.units == units and results.level_unit == "m/s2" and results.levels[0].unit == "m/s2"
        with h5py.File(shared_path / "out" / "results.h5") as file:
            assert file["levels/0000/response"].attrs["unit"] == "that of outputs/unit"
        assert (shared_path / "response.png").stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_time_integration_has_all_outputs(program, comm, shared_path):
    """The first output is an absolute velocity or a contact force; pairs slip."""
    for lines in (
        ALONG + 'quantity = "velocity"\nabsolute = true\n',
        'quantity = "contact_force"\njoint = "joint"\ndirection = [1.0, 0.0, 0.0]\n',
    ):
        scene = scene_with(
            comm, shared_path, loads=BASE + LOADS, outputs=output("first", lines), points=4, samples=128, harmonics=5, **COARSE
        )
        status, _, messages = program("verify", scene.path, "--out", shared_path / "out", "--steps", "256", "--levels", "40")
        assert status == 0, messages
        with open(shared_path / "out" / "verify.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        assert rows and all(abs(float(row["difference_with_phase"])) < 1e-3 + float(row["own_error"]) for row in rows)


MISTAKES = {
    "stress without a component": (output("s", PLACE + 'quantity = "stress"\n'), LOADS, 'component is missing: expected "xx"'),
    "stress along": (output("s", ALONG + 'quantity = "stress"\ncomponent = "xx"\n'), LOADS, "direction does not go with"),
    "a component": (output("s", PLACE + 'quantity = "stress"\ncomponent = "xz"\n'), LOADS, 'component = "xz": expected "xx"'),
    "no such body": (
        output("s", PLACE + 'quantity = "stress"\ncomponent = "xx"\nbody = "br"\n'),
        LOADS,
        'body = "br": there is no such body; nearest is "bar"',
    ),
    "another body": (
        output("s", 'position = [0.05, 0.01, 0.02]\nquantity = "stress"\ncomponent = "xx"\nbody = "ground"\n'),
        LOADS,
        "is not one of its nodes",
    ),
    "no such quantity": (output("s", ALONG + 'quantity = "speed"\n'), LOADS, 'quantity = "speed": expected "displacement"'),
    "component of a displacement": (output("s", ALONG + 'component = "xx"\n'), LOADS, "component does not go with"),
    "force without a joint": (output("s", 'quantity = "contact_force"\ncomponent = "normal"\n'), LOADS, "joint is missing"),
    "force of no joint": (
        output("s", 'quantity = "contact_force"\njoint = "jint"\ncomponent = "normal"\n'),
        LOADS,
        'joint = "jint": there is no such joint; nearest is "joint"',
    ),
    "force at a node": (
        output("s", 'node = 1\nquantity = "contact_force"\njoint = "joint"\ncomponent = "normal"\n'),
        LOADS,
        "node does not go with",
    ),
    "force of both": (
        output("s", 'quantity = "contact_force"\njoint = "joint"\ncomponent = "normal"\ndirection = [1.0, 0.0, 0.0]\n'),
        LOADS,
        "exactly one of direction, component",
    ),
    "absolute at rest": (output("s", ALONG + "absolute = true\n"), LOADS, "absolute: no load has a base_acceleration"),
    "absolute without end": (output("s", ALONG + "absolute = true\n"), BASE + "harmonic = 0\n", "grows without end"),
    "base and place": (output("s", ALONG), BASE + "node = 3\n", "node does not go with base_acceleration"),
    "base of zero": (output("s", ALONG), "[[loads]]\nbase_acceleration = [0.0, 0.0, 0.0]\n", "base_acceleration = "),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_bad_input(comm, shared_path, name):
    outputs, loads, message = MISTAKES[name]
    with pytest.raises(CaseError, match=message.replace("[", r"\[")):
        microslip.build(scene_with(comm, shared_path, outputs=outputs, loads=loads, name=name.replace(" ", "_")), comm)


def test_a_joint_carries_the_mass_that_its_base_accelerates(comm, shared_path):
    """Under a constant acceleration of the plate the joint carries the bar and the mass of a point tied to it."""
    force = output("force", 'quantity = "contact_force"\njoint = "joint"\ndirection = [1.0, 0.0, 0.0]\n')
    point = '[[points]]\nname = "rider"\nposition = [0.02, 0.005, 0.04]\ngroup = "bar_end"\nmass = 0.5\n'
    loads = "[[loads]]\nbase_acceleration = [2.0, 0.0, 0.0]\nharmonic = 0\n"
    for more, mass in (("", 0.0), (point, 0.5)):
        scene = scene_with(comm, shared_path, loads=loads + more, outputs=force, divisions=(2, 1, 1), modes=12)
        with microslip.build(scene, comm) as structure:
            model = reduced_model(structure)
            motion = output_motion(model, 3.0, 1000.0, np.zeros((3 * COARSE_PAIRS, model.N_H)))
        assert motion[0, 0] == pytest.approx(6.0 * (7800.0 * 0.05 * 0.01 * 0.02 + mass), rel=1e-9)
