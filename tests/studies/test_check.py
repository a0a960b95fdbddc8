"""The output of `check` on a model file: its list, its picture, and suspected units."""

from types import SimpleNamespace

import numpy as np
import pytest
from box_meshes import box, joint, mesh_of, settings
from matplotlib.image import imread
from plain_model import bdf, cdb, exodus, inp, plain, unv
from sources import ROOT

from microslip.formats.model import Finding
from microslip.mesh.skin import skin_of_mesh
from microslip.scene.read import read_scene
from microslip.studies.check import model_content as content
from microslip.studies.check import picture
from microslip.studies.check.marks import marks_of_scene
from microslip.studies.check.model_file import _lines
from microslip.studies.check.picture import draw
from microslip.studies.check.plausible import better_units, suspicion
from microslip.studies.check.report import _solution
from microslip.tables.structure import Material
from microslip.tables.units import UNITS

VOLUME, MASS = 0.05 * 0.01 * 0.025, 0.05 * 0.01 * 0.025 * 7800.0
STEEL = {
    "m-kg-s": Material.of_file(young=2.1e11, density=7800.0),
    "mm-t-s": Material.of_file(young=2.1e5, density=7.8e-9),
    "mm-kg-s": Material.of_file(young=2.1e8, density=7.8e-6),
    "mm-kg-ms": Material.of_file(young=210.0, density=7.8e-6),
    "in-lbf-s": Material.of_file(young=3.05e7, density=7.3e-4),
}


def printed(path, out=None):
    return "\n".join(_lines(str(path), out))


def test_all_entries_of_a_file_are_listed(tmp_path):
    (tmp_path / "m.inp").write_text(inp(plain(), ("*Gap, elset=D", "0.1")))
    text = printed(tmp_path / "m.inp")
    for words in (
        "32 nodes, 6 hex8; 2 connected parts",
        "from (0, 0, 0) to (0.05, 0.01, 0.025) m, if it is in metres",
        "BAR-1.ALL: 3 hex8, 1e-05 m3, 0.078 kg",
        f"{VOLUME:.6g} m3, {MASS:.6g} kg in all",
        "Steel: young 2.1e+11 Pa, poisson 0.3, density 7800 kg/m3",
        "PLATE_TOP: 8 nodes, 3 outer faces of 0.0005 m2",
        "supports   PLATE_BASE: x, y, z",
        "to answer  line ",
        ": *GAP: ",
    ):
        assert words in text
    assert "units suspected" not in text and "picture" not in text


def test_loads_at_rest_that_a_scene_takes_over_are_not_to_be_answered(tmp_path):
    steps = ("*Step, name=Press", "*Static", "*Cload", "PLATE_TOP, 3, -2.0", "*End Step")
    vibration = ("*Step, perturbation", "*Frequency", "4,", "*End Step")
    (tmp_path / "m.inp").write_text(inp(plain(), (*steps, *vibration)))
    text = printed(tmp_path / "m.inp")
    assert "at rest    1 force of step 1, in a scene [statics]" in text and "to answer" not in text


def test_materials_with_axes_are_listed(tmp_path):
    """The first instance is rotated by a right angle, and its axes with it."""
    elastic = "*Elastic\n210000000000.0, 0.3\n"
    section = "*Solid Section, elset=ALL, material=Steel"
    text = inp(plain())
    assert elastic in text and section in text
    text = text.replace(elastic, "*Elastic, type=engineering constants\n1.4e11, 1e10, 2e10, .28, .31, .4, 5e9, 6e9\n3.5e9\n")
    axes = "*Orientation, name=layup\n1., 0., 0., 0., 1., 0.\n"
    (tmp_path / "m.inp").write_text(text.replace(section, f"{axes}{section}, orientation=layup", 1))
    text = printed(tmp_path / "m.inp")
    assert "Steel: young 1.4e+11 1e+10 2e+10 Pa, poisson 0.28 0.31 0.4, shear 5e+09 6e+09 3.5e+09 Pa, density" in text
    assert "axes       BAR-1.layup: 1 along (" in text and ", of BAR-1.ALL" in text


@pytest.mark.parametrize("ending", [".cdb", ".bdf", ".unv", ".exo"])
def test_every_format_is_listed(tmp_path, ending):
    model, path = plain("hex20"), tmp_path / f"m{ending}"
    if ending == ".exo":
        exodus(model, path)
    else:
        path.write_text({".cdb": cdb, ".bdf": bdf, ".unv": unv}[ending](model))
    text = printed(path)
    assert "6 hex20; 2 connected parts" in text and f"{VOLUME:.6g} m3" in text and "18 nodes, 3 outer faces of 0.0005 m2" in text


@pytest.mark.parametrize("units", UNITS)
def test_implausible_units_are_suspected(units):
    size = 0.7 / UNITS[units].length
    assert suspicion(size, {"STEEL": STEEL[units]}, UNITS[units]) == ""
    text = suspicion(size, {"STEEL": STEEL[units]}, UNITS["m-kg-s"], 7.8e6)
    if units == "m-kg-s":
        assert text == ""
    else:
        assert text.startswith("units suspected: 'STEEL' has ") and "and weighs 7.8e+06 kg" in text
        assert text.endswith(f'units = "{units}"') and "0.7 m across" in text


def test_a_mesh_in_millimetres_is_suspected_by_its_mass():
    text = suspicion(1000.0, {"steel": STEEL["m-kg-s"]}, UNITS["m-kg-s"], 7.8e6)
    assert text == (
        "units suspected: the mesh measures 1000 m across and weighs 7.8e+06 kg; if it is in millimetres, state scale = 0.001"
    )
    assert "materials of a scene are in Pa" in suspicion(1.0, {"s": STEEL["mm-t-s"]}, UNITS["m-kg-s"], by_scene=True)
    assert suspicion(1.0, {}, UNITS["m-kg-s"]) == ""


def test_repeated_findings_are_listed_once_and_long_lists_end():
    findings = [Finding(word="CBAR", where=f"CBAR {i}", effect="a bar", changes=True) for i in range(50)]
    findings += [Finding(word="PLOTEL", where="PLOTEL 1", effect="a line that is drawn", changes=False)]
    assert content.passed_over(SimpleNamespace(findings=tuple(findings), statics=None)) == [
        "to answer  CBAR 0: CBAR: a bar (50 times)",
        "left out   PLOTEL 1: PLOTEL: a line that is drawn",
    ]
    assert content.table("x", [str(i) for i in range(50)], 2) == [
        "x          0",
        "           1",
        "           ... and 48 more (50 in all)",
    ]


def is_colour(image, colour):
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return np.abs(image[:, :, :3] - rgb).max(axis=2) < 0.12


@pytest.mark.slow
def test_the_picture_shows_bodies_joint_and_support(tmp_path, monkeypatch):
    lower, upper = box("hex20", (4, 2, 1), (4.0, 2.0, 1.0)), box("tet4", (4, 2, 1), (4.0, 2.0, 1.0), (0.0, 0.0, 1.0))
    groups = {
        "top": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) < len(lower[0])),
        "bottom": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) >= len(lower[0])),
        "base": lambda x: x[:, 2] == 0.0,
    }
    mesh = mesh_of(("lower", "hex20", *lower), ("upper", "tet4", *upper), groups=groups)
    own = settings(
        {"lower": "lower", "upper": "upper"},
        [("base", "xyz")],
        [joint(surfaces=("top", "bottom"))],
        [{"position": (4.0, 2.0, 2.0), "direction": (0.0, 0.0, 1.0)}],
        [{"name": "tip", "position": (0.0, 0.0, 2.0), "direction": (0.0, 0.0, 1.0)}],
    )
    marks = marks_of_scene(mesh, own)
    assert [mark.label for mark in marks] == ["joint joint", "held: base", "load 1", "output tip"]
    for most in (picture.MOST_FACES, 40):  # unchanged, and with nodes merged
        monkeypatch.setattr(picture, "MOST_FACES", most)
        (line,) = draw(tmp_path / str(most), mesh, marks, "two boxes")
        image = imread(line.removeprefix("picture    "))
        assert all(is_colour(image, colour).sum() > 2000 for colour in picture.BODY_COLOURS[:2])
        assert is_colour(image, picture.SET_COLOURS[1]).sum() > 200
    coarse, body = picture._coarse(skin_of_mesh(mesh))
    assert len(coarse) < skin_of_mesh(mesh).n_faces and set(body) == {0, 1}


def test_the_guide_shows_the_output_of_check_on_the_demos_method():
    guide = (ROOT / "docs" / "guide.md").read_text(encoding="utf-8")
    assert "\n".join(f"    {line}" for line in _solution(read_scene(ROOT / "jobs" / "fan_small.toml"), 9693, 46)) in guide


@pytest.mark.parametrize(
    ("young", "size", "units"), [(2.0e5, 17.3, "mm-t-s"), (2.9e7, 17.3, "in-lbf-s"), (2.0e3, 300.0, "mm-t-s")]
)
def test_units_plausible_for_metals_come_first(young, size, units):
    assert better_units(size, [Material.of_file(young=young)])[0] == units
