"""Pressures with varying phase, and forces from files, against closed-form integrals; on one rank and on several."""

import numpy as np
import pytest
from bar_loads import reduced_model, scene_with
from box_meshes import KINDS, box, mesh_of
from matrix_scenes import write_matrix_scene
from oracles import scenes

import microslip
from microslip.assembly.nodal_forces import angle_about, nodal_forces
from microslip.fourier.amplitudes import to_complex
from microslip.library.build import build
from microslip.messages.errors import CaseError
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.receptance.motions import output_motion
from microslip.tables.structure import Model
from microslip.tables.vibration import Load

SIZE = np.array([0.3, 0.2, 0.1])


MODEL = Model(mesh="box.msh", axis=(0.0, 0.0, 2.0), axis_point=(0.0, 0.0, 7.0))


def box_mesh(kind, n=(3, 2, 1), turn=((1, 0, 0), (0, 1, 0), (0, 0, 1)), origin=(0.0, 0.0, 0.0)):
    """Return a box, rotated about the origin; its group "top" has the nodes of its upper side."""
    points, elements = box(kind, n, SIZE, origin)
    is_top = np.isclose(points[:, 2], SIZE[2] + origin[2])
    return mesh_of(("box", kind, points @ np.array(turn).T, elements), groups={"top": lambda all_points: is_top})


def complex_forces(mesh, **load):
    """Return the complex force of a load on every node, (n_nodes, 3)."""
    forces = nodal_forces(mesh, Load(**load), MODEL, "[[loads]] 1")
    total = np.zeros((len(mesh.points), 3), dtype=complex)
    for factor, shape in zip((1.0, 1j), forces.shapes):
        np.add.at(total, forces.nodes, factor * shape)
    return total


@pytest.mark.parametrize("kind", KINDS)
def test_a_pressure_has_the_exact_resultant_and_moment(kind):
    mesh = box_mesh(kind)
    forces = complex_forces(mesh, group="top", pressure=3.0)
    np.testing.assert_allclose(forces.sum(axis=0), [0.0, 0.0, -3.0 * SIZE[0] * SIZE[1]], atol=1e-14)
    moment = np.cross(mesh.points, forces.real).sum(axis=0)
    np.testing.assert_allclose(moment, np.cross(SIZE * [0.5, 0.5, 1.0], forces.real.sum(axis=0)), atol=1e-14)


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10"])
def test_a_travelling_pressure_has_the_exact_resultant(kind):
    """The resultant of p e^(i k x) over a rectangle is p A e^(i k x_middle) times two functions sin(x) / x."""
    k = np.array([4.0, -3.0, 2.0])
    forces = complex_forces(box_mesh(kind, (12, 8, 1)), group="top", pressure=2.0, travelling=tuple(k)).sum(axis=0)
    exact = (
        -2.0 * SIZE[0] * SIZE[1] * np.exp(1j * k @ (SIZE * [0.5, 0.5, 1.0])) * np.sinc(k[:2] * SIZE[:2] / (2.0 * np.pi)).prod()
    )
    np.testing.assert_allclose(forces, [0.0, 0.0, exact], rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("order", [1, 5, -3])
def test_an_engine_order_rotates_with_the_structure(order):
    """On a structure rotated by 70 degrees about the axis the forces are rotated, and shifted by ``order`` times 70 degrees."""
    angle = np.radians(70.0)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    common = {"group": "top", "pressure": 2.0, "engine_order": order}
    f, f_turned = (complex_forces(box_mesh("hex20", turn=Q, origin=(-1.0, 0.1, 0.0)), **common) for Q in (np.eye(3), turn))
    np.testing.assert_allclose(f_turned, f @ turn.T * np.exp(1j * order * angle), atol=1e-13)


def test_angles_are_measured_from_the_next_coordinate_axis():
    units = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(angle_about(units[[0, 1]], (0.0, 0.0, 1.0), np.zeros(3)), [0.0, np.pi / 2], atol=1e-15)
    np.testing.assert_allclose(angle_about(units[[1, 2]], (3.0, 0.0, 0.0), np.zeros(3)), [0.0, np.pi / 2], atol=1e-15)
    np.testing.assert_allclose(angle_about(units[[2, 0]], (0.0, 1.0, 0.0), np.zeros(3)), [0.0, np.pi / 2], atol=1e-15)
    np.testing.assert_allclose(angle_about(units[[0, 1]], (0.0, 0.0, -1.0), np.zeros(3)), [0.0, -np.pi / 2], atol=1e-15)


FORCE = "[[loads]]\nnode = {node}\ndirection = {direction}\nharmonic = 2\nphase = {phase}\n"


def test_forces_of_a_file_equal_loads_with_phases(comm, shared_path):
    """Complex forces at two nodes, for the first node on two lines, cause the same motion as loads with phases."""
    lines = "fx, node, fy, fz, fz_im\n1.0, 20, 0.5, 0, 0.25\n# remark\n\n0, 25, -2.0, 0, 0\n0, 20, 0.5, 0, 0\n"
    file = scene_with(
        comm,
        shared_path,
        loads='[[loads]]\nforces = "f.csv"\nharmonic = 2\nphase = 0.3\n',
        files={"f.csv": lines},
        modes=12,
        name="a",
    )
    tables = scene_with(
        comm,
        shared_path,
        loads=FORCE.format(node=20, direction=[1.0, 1.0, 0.0], phase=0.3)
        + FORCE.format(node=20, direction=[0.0, 0.0, 0.25], phase=0.3 + np.pi / 2)
        + FORCE.format(node=25, direction=[0.0, -2.0, 0.0], phase=0.3),
        modes=12,
        name="b",
    )
    values = []
    for scene in (file, tables):
        with microslip.build(scene, comm) as structure:
            model = reduced_model(structure)
            values.append(output_motion(model, 1.0, 2e4, np.zeros((3 * model.n_pairs, model.N_H))))
    assert np.abs(values[1][:, 3:5]).max() > 0.0
    np.testing.assert_allclose(values[0], values[1], atol=1e-12 * np.abs(values[1]).max())


def test_forces_on_dofs_may_be_complex(comm, shared_path):
    """The motion of the chain under a complex force vector equals dense algebra."""
    system, omega = scenes.chain(), 560.0
    n = len(system["M"])
    values = np.random.default_rng(3).standard_normal((n, 2))

    def write():
        path = write_matrix_scene(shared_path, system, [1.0], (540.0, 580.0))
        rows = [f"{dof},{re!r},{im!r}" for dof, (re, im) in enumerate(values.tolist())]
        (shared_path / "f.csv").write_text("\n".join(["dof,value,imag", *rows]) + "\n")
        text = path.read_text()
        path.write_text(text[: text.index("[[loads]]")] + '[[loads]]\nforces = "f.csv"\n' + text[text.index("[[outputs]]") :])
        return path

    scene = microslip.read(on_root(comm, write))
    with build(scene, comm, RunLog(comm, screen=False)) as structure:
        model = reduced_model(structure)
        amplitudes = to_complex(output_motion(model, 1.0, omega, np.zeros((3 * model.n_pairs, model.N_H))))
    Z = scenes.stuck_stiffness(system) - omega**2 * system["M"] + 1j * omega * scenes.damping_matrix(system)
    exact = np.linalg.solve(Z, values @ [1.0, 1j])
    np.testing.assert_allclose(amplitudes[:, 1], exact, atol=1e-9 * np.abs(exact).max())


PRESSURE = '[[loads]]\ngroup = "bar_top"\npressure = 1.0\n'
MISTAKES = {
    "unknown group": (PRESSURE.replace("bar_top", "bar_topp"), {}, r"\[\[loads\]\] 1 group = 'bar_topp'.*nearest is 'bar_top'"),
    "no group": ("[[loads]]\npressure = 1.0\n", {}, "exactly one of group is needed"),
    "a direction": (PRESSURE + "direction = [1.0, 0.0, 0.0]\n", {}, "direction does not go with a pressure"),
    "zero": (PRESSURE.replace("1.0", "0.0"), {}, r"\[\[loads\]\] 1 pressure = 0.0: expected"),
    "two phases": (PRESSURE + "travelling = [1.0, 0.0, 0.0]\nengine_order = 2\n", {}, "may vary the phase, found both"),
    "no axis": (PRESSURE + "engine_order = 2\n", {}, r"\[\[loads\]\] 1 engine_order: \[model\] axis is missing"),
    "phase of a force": (
        '[[loads]]\ngroup = "bar_top"\ndirection = [1.0, 0.0, 0.0]\nengine_order = 2\n',
        {},
        "belongs to a pressure",
    ),
    "no file": ('[[loads]]\nforces = "g.csv"\n', {}, r'\[\[loads\]\] 1 forces = "g.csv": there is no such file'),
    "a place": ('[[loads]]\nforces = "f.csv"\nnode = 3\n', {"f.csv": ""}, "node does not go with forces"),
    "empty": ('[[loads]]\nforces = "f.csv"\n', {"f.csv": ""}, "f.csv: the file is empty"),
    "column": (
        '[[loads]]\nforces = "f.csv"\n',
        {"f.csv": "node,fx,fy,fz,fx_imag\n"},
        'line 1: .*"fx_imag" is unknown, nearest is "fx_im"',
    ),
    "number": ('[[loads]]\nforces = "f.csv"\n', {"f.csv": "node,fx,fy,fz\n20,a,0,0\n"}, 'line 2: fx = "a" is not a number'),
    "infinite": ('[[loads]]\nforces = "f.csv"\n', {"f.csv": "node,fx,fy,fz\n20,inf,0,0\n"}, "not a finite number"),
    "node": (
        '[[loads]]\nforces = "f.csv"\n',
        {"f.csv": "node,fx,fy,fz\n2.5,1,0,0\n"},
        "line 2: node = 2.5: no element of a body",
    ),
    "nothing": ('[[loads]]\nforces = "f.csv"\n', {"f.csv": "node,fx,fy,fz\n20,0,0,0\n"}, "every force is 0"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_bad_loads_are_refused_with_a_message(comm, shared_path, name):
    loads, files, message = MISTAKES[name]
    with pytest.raises(CaseError, match=message):
        microslip.build(scene_with(comm, shared_path, loads=loads, files=files, name=name.replace(" ", "_")), comm)
