"""Anisotropic materials in input files of Abaqus and CalculiX: constants, expansions, *ORIENTATION."""

import numpy as np
import pytest
from plain_model import CUBE

from microslip.formats.read import read_model
from microslip.library.complete import complete
from microslip.messages.errors import CaseError, MeshError
from microslip.scene.read import scene_of

ORTHO = "*ELASTIC, TYPE=ORTHO\n11., 12., 22., 13., 23., 33., 44., 55.,\n66.\n"
CONSTANTS = "*ELASTIC, TYPE=ENGINEERING CONSTANTS\n140., 10., 20., .28, .31, .4, 5., 6.\n3.5, 20.\n"
ANISO = "*ELASTIC, TYPE=ANISO\n11., 12., 22., 13., 23., 33., 14., 24.,\n34., 44., 15., 25., 35., 45., 55., 16.,\n26., 36., 46., 56., 66.\n"
AXES = "*ORIENTATION, NAME=Fibres\n1., 1., 0., -1., 1., 0.\n"
SECTION = "*SOLID SECTION, ELSET=CUBE, MATERIAL=PLY, ORIENTATION=FIBRES\n"


def read(folder, elastic, axes=AXES, section=SECTION, more=""):
    text = CUBE + f"*MATERIAL, NAME=Ply\n{elastic}*DENSITY\n1.6\n" + axes + section + more + "*STEP\n*FREQUENCY\n2\n*END STEP\n"
    (folder / "job.inp").write_text(text)
    return read_model(folder / "job.inp")


def changes(model):
    return [(finding.word, finding.effect) for finding in model.findings if finding.changes]


def scene(folder, **model):
    tables = {
        "model": {"mesh": "job.inp", **model},
        "loads": ({"position": (0.0, 0.0, 0.0), "direction": (0.0, 0.0, 1.0)},),
        "outputs": ({"name": "tip", "position": (0.0, 0.0, 0.0), "direction": (0.0, 0.0, 1.0)},),
        "damping": {"ratio": 0.01},
        "response": {"levels": (1.0,), "frequencies": (1.0, 2.0)},
    }
    return scene_of(tables, folder / "scene.toml")


@pytest.mark.parametrize("elastic", [ORTHO, ANISO])
def test_elasticities_follow_the_order_of_the_card(tmp_path, elastic):
    C = np.array(read(tmp_path, elastic).materials["Ply"].elasticity)
    expected = np.array([[10.0 * min(i, j) + max(i, j) for i in range(1, 7)] for j in range(1, 7)])
    if elastic is ORTHO:
        expected[3:, :3] = expected[:3, 3:] = 0.0
        expected[3:, 3:] = np.diag([44.0, 55.0, 66.0])
    np.testing.assert_array_equal(C, expected)


def test_engineering_constants_and_their_axes_reach_the_scene(tmp_path):
    model = read(tmp_path, CONSTANTS + "*EXPANSION, TYPE=ORTHO\n-1e-6, 3e-5, 2e-5\n")
    assert changes(model) == []
    completed, _ = complete(scene(tmp_path, units="mm-t-s"), model)
    body = completed.sections["CUBE"]
    C = np.array(body.material.elasticity)
    compliance = np.linalg.inv(C)
    assert 1.0 / np.diag(compliance) == pytest.approx(1e6 * np.array([140.0, 10.0, 20.0, 5.0, 6.0, 3.5]))
    assert -compliance[[0, 0, 1], [1, 2, 2]] * 1e6 * [140.0, 140.0, 10.0] == pytest.approx([0.28, 0.31, 0.4])
    assert body.material.expansion == (-1e-6, 3e-5, 2e-5) and body.density == pytest.approx(1.6e12)
    half = np.sqrt(0.5)
    assert body.material.axes.at(np.zeros(3)) == pytest.approx(np.array([[half, half, 0.0], [-half, half, 0.0], [0.0, 0.0, 1.0]]))


TURNS = {
    "about an origin": ("*ORIENTATION, NAME=FIBRES\n3., 2., 1., 2., 9., 1., 2., 2., 1.\n", np.eye(3)),
    "turned further": (
        "*ORIENTATION, NAME=FIBRES\n1., 0., 0., 0., 1., 0.\n3, 90.\n",
        np.array([[0, 1.0, 0], [-1, 0, 0], [0, 0, 1]]),
    ),
    "about the first axis": (
        "*ORIENTATION, NAME=FIBRES\n1., 0., 0., 0., 1., 0.\n, 90.\n",
        np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    ),
}


@pytest.mark.parametrize("name", TURNS)
def test_rectangular_axes(tmp_path, name):
    text, expected = TURNS[name]
    x, y = read(tmp_path, ORTHO, text).orientations["FIBRES"].directions
    assert np.array([x, y, np.cross(x, y)]) == pytest.approx(expected, abs=1e-15)


def test_the_point_of_cylindrical_axes_is_converted_from_the_units_of_the_file(tmp_path):
    model = read(tmp_path, CONSTANTS, "*ORIENTATION, NAME=FIBRES, SYSTEM=CYLINDRICAL\n1., 2., 3., 1., 2., 5.\n")
    assert model.bodies["CUBE"].orientation == "FIBRES" and changes(model) == []
    completed, _ = complete(scene(tmp_path, units="mm-t-s"), model)
    axes = completed.sections["CUBE"].material.axes
    assert (axes.axis, axes.point) == ((0.0, 0.0, 2.0), pytest.approx((1e-3, 2e-3, 3e-3)))


def test_an_isotropic_material_needs_axes_only_for_anisotropic_expansion(tmp_path):
    model = read(tmp_path, "*ELASTIC\n210., .25\n*EXPANSION, TYPE=ORTHO\n1e-5, 1e-5, 1e-5\n")
    assert (model.materials["Ply"].expansion, model.bodies["CUBE"].orientation, model.orientations) == (1e-5, None, {})
    assert [finding.word for finding in model.findings if finding.word == "*ORIENTATION"] == ["*ORIENTATION"] and changes(
        model
    ) == []
    model = read(tmp_path, "*ELASTIC\n210., .25\n*EXPANSION, TYPE=ORTHO\n1e-5, 1e-5, 2e-5\n")
    material = model.materials["Ply"]
    assert (material.young, material.poisson, material.shear) == ((210.0,) * 3, (0.25,) * 3, (84.0,) * 3)
    assert (material.expansion, model.bodies["CUBE"].orientation) == ((1e-5, 1e-5, 2e-5), "Fibres")


def test_constants_are_interpolated_between_temperatures(tmp_path):
    rows = "*ELASTIC, TYPE=ORTHO\n0., 0., 0., 0., 0., 0., 0., 0.,\n0., 0.\n11., 12., 22., 13., 23., 33., 44., 55.,\n66., 1000.\n"
    model = read(tmp_path, rows, more="*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 250.\n")
    C = np.array(model.materials["Ply"].elasticity)
    assert np.diag(C) == pytest.approx(0.25 * np.array([11.0, 22.0, 33.0, 44.0, 55.0, 66.0])) and C[0, 1] == pytest.approx(3.0)
    assert changes(model) == []


def test_rotated_instances_rotate_their_axes(tmp_path):
    part = CUBE + AXES + SECTION
    text = (
        f"*PART, NAME=P\n{part}*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=P\n0., 0., 5.\n0., 0., 0., 0., 0., 1., 45.\n"
    )
    text += f"*END INSTANCE\n*END ASSEMBLY\n*MATERIAL, NAME=PLY\n{ORTHO}*DENSITY\n1.\n"
    (tmp_path / "job.inp").write_text(text)
    model = read_model(tmp_path / "job.inp")
    x, _ = model.orientations["I.Fibres"].directions
    assert x == pytest.approx((0.0, 1.0, 0.0)) and changes(model) == []
    (tmp_path / "job.inp").write_text(text.replace(", ORIENTATION=FIBRES", ""))
    ((word, effect),) = changes(read_model(tmp_path / "job.inp"))
    assert word == "*SOLID SECTION" and "instance I, which is turned" in effect


@pytest.mark.parametrize(
    "axes",
    [
        "*ORIENTATION, NAME=FIBRES, SYSTEM=SPHERICAL\n0., 0., 0., 0., 0., 1.\n",
        "*ORIENTATION, NAME=FIBRES, DEFINITION=NODES\n1, 2, 3\n",
        "*ORIENTATION, NAME=FIBRES, SYSTEM=CYLINDRICAL\n0., 0., 0., 0., 0., 1.\n3, 20.\n",
        "*ORIENTATION, NAME=FIBRES\nTHEIRS\n",
    ],
)
def test_unsupported_axes_are_findings(tmp_path, axes):
    model = read(tmp_path, ORTHO, axes)
    assert [(finding.word, finding.changes) for finding in model.findings if finding.word == "*ORIENTATION"] == [
        ("*ORIENTATION", True)
    ]


@pytest.mark.parametrize(
    "elastic, axes, message",
    [
        (ORTHO, "", "there is no \\*ORIENTATION 'FIBRES'"),
        (ORTHO, "*ORIENTATION, NAME=FIBRES\n1., 0., 0., 2., 0., 0.\n", "lie on one line"),
        (ORTHO, "*ORIENTATION, NAME=FIBRES\n1., 0., 0., 0., 1., 0.\n4, 10.\n", "about axis 4"),
        (ORTHO, "*ORIENTATION, NAME=FIBRES, SYSTEM=CYLINDRICAL\n1., 0., 0., 1., 0., 0.\n", "coincide"),
        (ORTHO.replace("\n66.", ""), AXES, "1 line where sets of 2 are expected"),
    ],
)
def test_damaged_cards_give_one_message(tmp_path, elastic, axes, message):
    with pytest.raises(MeshError, match=message):
        read(tmp_path, elastic, axes)


@pytest.mark.parametrize(
    "elastic, message", [(CONSTANTS.replace(".28", "4.9"), "check nu_ij"), (ORTHO.replace("44.", "-44."), "the eigenvalue -44")]
)
def test_materials_with_negative_energy_are_refused(tmp_path, elastic, message):
    model = read(tmp_path, elastic)
    with pytest.raises(CaseError, match=rf"\[materials.Ply\]: there is no such material; .*{message}"):
        complete(scene(tmp_path), model)
