"""The first scene of a model file: complete except for the joint's parameters, with candidates, and never overwriting a file."""

import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from box_meshes import box
from plain_model import bdf, cdb, cdb_with_contact, exodus, inp, plain, unv

from microslip.formats.model import Cells, FileModel, Group
from microslip.formats.read import read_model
from microslip.library.complete import complete
from microslip.mesh.cut import cut_through, cuts_through
from microslip.mesh.links import find_links
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.read import read_mesh
from microslip.messages.errors import CaseError, MeshError
from microslip.scene.read import read_scene
from microslip.studies.check.model_file import _lines as check_model_lines
from microslip.studies.check.model_mesh import bodies_of, whole_mesh
from microslip.studies.new.candidates import candidates_and_bolts
from microslip.studies.new.command import _write
from microslip.studies.new.joint_text import _is_part
from microslip.tables.constant_loads import Bolt
from microslip.tables.joint import Joint
from microslip.tables.structure import Surface
from microslip.tables.units import UNITS

sys.path.insert(0, str(Path(__file__).parents[2] / "meshes"))

from bolted_lap import main as generate_lap
from brake_reuss import BrakeReuss, input_file

WRITERS = {".cdb": cdb, ".bdf": bdf, ".unv": unv, ".inp": inp}


def write(folder, ending=".inp", kind="hex8", **changes):
    model, path = replace(plain(kind), **changes), folder / f"m{ending}"
    if ending == ".exo":
        exodus(model, path)
    else:
        path.write_text(WRITERS[ending](model))
    return path


def filled(path):
    """Fill in the missing entries of the scene; return its new text."""
    text = re.sub(r"^#> ", "", path.read_text(), flags=re.MULTILINE)
    path.write_text(text)
    return text


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
@pytest.mark.parametrize("ending", [*WRITERS, ".exo"])
def test_the_scene_lacks_only_the_parameters_of_the_joint(tmp_path, ending, kind):
    model, out = write(tmp_path, ending, kind), tmp_path / "first.toml"
    report_text = "\n".join(_write(str(model), out, False))
    assert re.search(r"joints     \S+.*: 3 faces on 3, 0.0005 m2, touching, node to node", report_text)
    with pytest.raises(
        CaseError, match="friction is missing: expected .*; and tangential_stiffness, normal_stiffness and preload$"
    ):
        read_scene(out)
    filled(out)
    scene = read_scene(out)
    assert scene.joints[0].friction == 0.3 and scene.damping.ratio == 1e-3 and scene.response.mode == 1
    assert (len(scene.bodies), len(scene.supports)) == ((2, 1) if ending in (".unv", ".exo") else (0, 0))
    assert scene.loads[0].node == scene.outputs[0].node and scene.loads[0].direction == (0.0, 1.0, 1.0)


def test_candidates_without_names_are_named(tmp_path):
    """Without sets of the two sides the scene names them by the bodies in contact."""
    model = plain()
    path = write(tmp_path, sets={"PLATE_BASE": model.sets["PLATE_BASE"]})
    report_text = "\n".join(_write(str(path), tmp_path / "m.toml", False))
    assert "BAR-1.ALL_on_PLATE-1.ALL on PLATE-1.ALL_on_BAR-1.ALL: 3 faces on 3, 0.0005 m2, touching, node to node" in report_text
    filled(tmp_path / "m.toml")
    scene = read_scene(tmp_path / "m.toml")
    assert [one.bodies for one in scene.surfaces] == [("BAR-1.ALL", "PLATE-1.ALL"), ("PLATE-1.ALL", "BAR-1.ALL")]
    assert scene.joints[0].surfaces == tuple(one.name for one in scene.surfaces)


@pytest.mark.parametrize("behaviour", [5, 0])
def test_contacts_of_the_file_become_joints_or_ties(tmp_path, behaviour):
    (tmp_path / "m.cdb").write_text(cdb_with_contact(plain(), behaviour))
    report_text = "\n".join(_write(str(tmp_path / "m.cdb"), tmp_path / "m.toml", False))
    assert "to answer" not in report_text
    filled(tmp_path / "m.toml")
    scene, names = read_scene(tmp_path / "m.toml"), ("CONTA174 real 5", "TARGE170 real 5")
    assert [one.surfaces for one in scene.ties] == ([names] if behaviour == 5 else [])
    assert [frozenset(one.surfaces) for one in scene.joints] == ([] if behaviour == 5 else [frozenset(names)])


def test_parameters_of_a_contact_of_the_file_are_those_of_the_joint(tmp_path):
    path = write(tmp_path)
    contact = "*SURFACE, NAME=FEET, TYPE=NODE\nBAR_BOTTOM,\n*SURFACE, NAME=TOP, TYPE=NODE\nPLATE_TOP,\n"
    contact += "*CONTACT PAIR, INTERACTION=DRY\nFEET, TOP\n*SURFACE INTERACTION, NAME=DRY\n*FRICTION\n0.25\n"
    contact += "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n2e13\n"
    path.write_text(path.read_text() + contact)
    report_text = "\n".join(check_model_lines(str(path), None))
    assert "FEET_TOP: FEET on TOP, friction 0.25, no tangential stiffness, normal stiffness 2e+13 N/m3" in report_text
    _write(str(path), tmp_path / "m.toml", False)
    with pytest.raises(CaseError, match="tangential_stiffness is missing: expected [^;]*; and preload$"):
        read_scene(tmp_path / "m.toml")
    filled(tmp_path / "m.toml")
    (joint,) = read_scene(tmp_path / "m.toml").joints
    assert (joint.surfaces, joint.friction, joint.normal_stiffness) == (("FEET", "TOP"), 0.25, 2e13)


def with_static_step(path):
    """Replace the step of the vibration by a *STATIC with a force."""
    static = "*STEP\n*STATIC\n*CLOAD\nPLATE_TOP, 3, -1.0\n*END STEP\n"
    text = path.read_text()
    path.write_text(text[: text.index("*Step, perturbation")] + static)
    return path


def in_contact(path):
    contact = "*SURFACE, NAME=FEET, TYPE=NODE\nBAR_BOTTOM,\n*SURFACE, NAME=TOP, TYPE=NODE\nPLATE_TOP,\n"
    contact += "*CONTACT PAIR, INTERACTION=DRY\nFEET, TOP\n*SURFACE INTERACTION, NAME=DRY\n*FRICTION\n0.25\n"
    path.write_text(path.read_text() + contact)
    return path


def test_an_invalid_contact_of_the_file_is_named_with_its_reason(tmp_path):
    """The first surface extends beyond the end of the other, with 4 mm between them."""
    model = plain()
    points = model.points + (np.arange(len(model.points)) < 16)[:, None] * [0.06, 0.0, 4e-3]
    path = in_contact(write(tmp_path, points=points))
    report_text = "\n".join(_write(str(path), tmp_path / "m.toml", False))
    assert (
        "FEET on TOP: 3 faces on 3" in report_text
        and "refused: no contact point found: all its faces have no partner" in report_text
    )
    assert "#   FEET on TOP" in (tmp_path / "m.toml").read_text()


def test_a_contact_of_the_file_with_a_gap_is_a_joint(tmp_path):
    """As in FreeCAD's example of two solids: a tenth of the first surface faces the other, 4 mm away, and a *STATIC presses it."""
    model = plain()
    points = model.points + (np.arange(len(model.points)) < 16)[:, None] * [0.045, 0.0, 4e-3]
    path = in_contact(with_static_step(write(tmp_path, points=points)))
    report_text = "\n".join(_write(str(path), tmp_path / "m.toml", False))
    assert "joints     FEET_TOP: FEET on TOP: 3 faces on 3, 5e-05 m2, 0.004 m apart" in report_text
    assert "step = in the scene takes its loads, which act at rest and may close the gap" in report_text
    text = filled(tmp_path / "m.toml")
    assert 'gap = "geometry"' in text and "become [statics]: 1 force" in text and 'title = "m.inp, first mode"' in text
    scene = read_scene(tmp_path / "m.toml")
    assert scene.model.step == 1 and scene.joints[0].friction == 0.25
    file = read_model(str(path), 1)
    completed, notes = complete(scene, file)
    assert completed.statics.forces and any("[statics] with 1 force" in note for note in notes)
    mesh, _ = whole_mesh(str(path), file, UNITS["m-kg-s"])
    pairs = pair_contacts(mesh, completed.joints)
    assert pairs.area.sum() == pytest.approx(5e-5) and "WARNING: joint 'FEET_TOP'" in pairs.notes[0]
    assert "covers 10.00% of them" in pairs.notes[0] and pairs.notes[0].endswith("; the rest has no partner and stays free")


def test_unused_loads_of_a_static_step_are_named(tmp_path):
    path = with_static_step(write(tmp_path))
    report_text = "\n".join(_write(str(path), tmp_path / "m.toml", False))
    assert "without its loads, 1 *CLOAD" in report_text
    text = (tmp_path / "m.toml").read_text()
    assert "# Supports are those of step 1 of the file, *STATIC. Its loads, 1 *CLOAD, are not taken over." in text
    assert '# If they act at rest: step = 1, and preload = "static" in the joints they press.' in text


FIXED = (
    "*Step, name=Fixed, perturbation",
    "*Frequency",
    "4,",
    "*Boundary",
    "BAR_BOTTOM, ENCASTRE",
    "PLATE_TOP, 1, 3",
    "*End Step",
)


def test_supports_that_fix_both_sides_of_a_joint_are_omitted(tmp_path):
    """The first step is that of fixed-interface modes: its supports would fix every pair."""
    (tmp_path / "m.inp").write_text(inp(plain(), FIXED))
    report_text = "\n".join(_write(str(tmp_path / "m.inp"), tmp_path / "m.toml", False))
    assert 'conditions of step 1 of the file: *FREQUENCY, PERTURBATION "Fixed"' in report_text
    assert "left out: BAR_BOTTOM (xyz), PLATE_TOP (xyz), which fix both sides of a joint" in report_text
    text = filled(tmp_path / "m.toml")
    assert "# step = ... selects another step: 2 *FREQUENCY, PERTURBATION" in text
    scene = read_scene(tmp_path / "m.toml")
    assert (scene.model.step, [(one.group, one.fix) for one in scene.supports]) == (1, [("PLATE_BASE", ("x", "y", "z"))])
    whole, _ = complete(scene, read_model(tmp_path / "m.inp", scene.model.step))
    assert [one.group for one in whole.supports] == ["PLATE_BASE"] and len(whole.bodies) == 2


def test_a_support_next_to_a_joint_is_used(tmp_path):
    """The clamped side of a joint, or supports of its last nodes, fix no pair."""
    (tmp_path / "m.inp").write_text(inp(plain(), ("*Boundary", "PLATE_TOP, ENCASTRE")))
    report_text = "\n".join(_write(str(tmp_path / "m.inp"), tmp_path / "m.toml", False))
    assert "left out" not in report_text and "PLATE_TOP, by the file" in report_text
    assert "[[supports]]" not in (tmp_path / "m.toml").read_text() and "take = " not in (tmp_path / "m.toml").read_text()


def candidates_of(points, blocks, groups):
    """Return the candidates of a mesh of hex8: blocks are elements, groups nodes, by name."""
    cells = tuple(Cells("hex8", own, np.arange(1, len(own) + 1)) for own in blocks.values())
    named = {name: Group(cells={i: np.arange(len(own))}) for i, (name, own) in enumerate(blocks.items())}
    file = FileModel(
        points, np.arange(1, len(points) + 1), cells, named | {name: Group(nodes=own) for name, own in groups.items()}
    )
    mesh, settings = whole_mesh("m.inp", file, UNITS["m-kg-s"])
    return candidates_and_bolts(mesh, file, settings)[0]


def corner():
    """Return a block in the corner of two others: one is below, the other at its side, and these are one body."""
    points, elements = plain().points, plain().elements
    beside = points[np.unique(elements[0])] + [0.05, 0.0, 0.0]
    return np.concatenate([points, beside]), elements, elements[0] + len(points)


def test_surfaces_that_meet_at_an_edge_are_separate_joints():
    points, (bar, plate), beside = corner()
    candidates = candidates_of(points, {"bar": bar, "angle": np.concatenate([plate, beside])}, {})
    assert [(one.made[0].bodies, one.made[0].normal) for one in candidates] == [
        (("bar", "angle"), (0.0, 0.0, -1.0)),
        (("bar", "angle"), (1.0, 0.0, 0.0)),
    ]
    assert [one.area for one in candidates] == pytest.approx([5e-4, 2e-4]) and all(one.is_likely for one in candidates)
    assert len({one.name for one in candidates}) == 2


def test_named_surfaces_come_first_and_their_unions_are_omitted():
    points, (bar, plate), beside = corner()
    sets = plain().sets
    groups = {**sets, "EVERYTHING": np.arange(len(points)), "TWICE": sets["PLATE_TOP"]}
    candidates = candidates_of(points, {"bar": bar, "plate": plate, "beside": beside}, groups)
    assert candidates[0].surfaces == ("BAR_BOTTOM", "PLATE_TOP") and not candidates[0].made
    assert [one.made[0].bodies for one in candidates[1:]] == [("bar", "beside")]


def test_surfaces_with_a_gap_come_last_and_are_not_used():
    points, (bar, plate), beside = corner()
    points = points + 1e-3 * (np.arange(len(points)) < len(np.unique(bar)))[:, None] * [0.0, 0.0, 1.0]
    candidates = candidates_of(points, {"bar": bar, "plate": plate, "beside": beside}, {})
    assert [(one.is_distant, one.matches) for one in candidates] == [(False, False), (True, False)]
    assert candidates[1].gap == pytest.approx(1e-3, rel=1e-9) and "0.001 m apart" in candidates[1].text


def test_only_the_faces_in_contact_of_larger_surfaces_are_offered(tmp_path):
    """The file names whole surfaces of which a part is in contact: a run would reject them, and uses the faces in contact."""
    lower, upper = box("hex8", (10, 2, 1), (1.0, 0.2, 0.1)), box("hex8", (3, 2, 1), (0.3, 0.2, 0.1), (0.9, 0.0, 0.1))
    points = np.concatenate([lower[0], upper[0]])
    blocks = {"lower": lower[1], "upper": upper[1] + len(lower[0])}
    z, is_upper = points[:, 2], np.arange(len(points)) >= len(lower[0])
    groups = {"TOP": np.flatnonzero(np.isclose(z, 0.1) & ~is_upper), "FEET": np.flatnonzero(np.isclose(z, 0.1) & is_upper)}
    (one,) = candidates_of(points, blocks, groups)
    assert [surface.bodies for surface in one.made] == [("upper", "lower"), ("lower", "upper")] or one.made[0].bodies[
        0
    ] == "lower"
    assert one.area == pytest.approx(0.02) and one.is_likely and not one.refused
    mesh = SimpleNamespace(node_groups=groups)
    of_file = [Joint.of_file(surfaces=names, friction=0.4) for names in (("FEET", "TOP"), ("TOP", "FEET"), ("FEET", "FEET"))]
    assert [_is_part(one, joint, mesh) for joint in of_file] == [True, True, False]  # its friction is that of the file


def test_named_surfaces_with_an_edge_are_offered_by_their_normals():
    points, (bar, plate), beside = corner()
    angle = np.concatenate([plate, beside])
    touching = np.isclose(points[:, 2], 0.005) | np.isclose(points[:, 0], 0.05)
    of_bar = np.isin(np.arange(len(points)), bar)
    groups = {"INNER": np.flatnonzero(touching & ~of_bar), "OUTER": np.flatnonzero(touching & of_bar)}
    candidates = candidates_of(points, {"bar": bar, "angle": angle}, groups)
    assert [one.made[0].normal for one in candidates] == [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0)] and all(
        one.is_likely for one in candidates
    )


def test_surfaces_with_a_gap_are_comments_that_become_a_joint(tmp_path):
    """With 1 mm between them, a fifth of the size of their faces: offered with its tolerance, and accepted by a run."""
    model = plain()
    points = model.points + 4e-3 * (np.arange(len(model.points)) < 16)[:, None] * [0.0, 0.0, 1.0]
    path = write(tmp_path, points=points, sets={"PLATE_BASE": model.sets["PLATE_BASE"]})
    report_text = "\n".join(_write(str(path), tmp_path / "m.toml", False))
    assert (
        "or         BAR-1.ALL_on_PLATE-1.ALL on PLATE-1.ALL_on_BAR-1.ALL: 3 faces on 3, 0.0005 m2, 0.004 m apart" in report_text
    )
    text = (tmp_path / "m.toml").read_text()
    assert "# With a gap: BAR-1.ALL_on_PLATE-1.ALL" in text and read_scene(tmp_path / "m.toml").joints == ()
    (tmp_path / "m.toml").write_text(re.sub(r"^#\| ", "", text, flags=re.MULTILINE))
    scene = read_scene(tmp_path / "m.toml")
    assert scene.joints[0].gap == "geometry" and scene.surfaces[0].tolerance == pytest.approx(4.4e-3)
    whole, _ = complete(scene, read_model(path))
    pairs = pair_contacts(read_mesh(whole), whole.joints)
    assert pairs.area.sum() == pytest.approx(5e-4) and (-pairs.N0 / pairs.k_n) == pytest.approx(4e-3)


def bolted(path):
    """Write the bolted beam as one file without ties, contact, loads and cuts: only its mesh."""
    text = input_file(BrakeReuss())
    text = re.sub(r"^\*Surface,.*name=CUT\n(?:[^*].*\n)*", "", text, flags=re.MULTILINE | re.IGNORECASE)
    for keyword in ("Tie", "Contact Pair", "Pre-tension Section", "Surface Interaction", "Friction", "Surface Behavior", "Cload"):
        text = re.sub(rf"^\*{keyword}\b.*\n(?:[^*].*\n)*", "", text, flags=re.MULTILINE | re.IGNORECASE)
    path.write_text(text)


def test_bolts_are_recognised_cut_and_tied(tmp_path):
    bolted(tmp_path / "m.inp")
    report_text = "\n".join(_write(str(tmp_path / "m.inp"), tmp_path / "m.toml", False))
    assert len(re.findall(r"BOLT-\d.ALL: shank of \S+ mm, to be cut at", report_text)) == 3
    text = filled(tmp_path / "m.toml")
    scene = read_scene(tmp_path / "m.toml")
    assert scene.joints[0].surfaces == ("LAP_LOWER", "LAP_UPPER") and scene.joints[0].preload == "static"
    tied = {frozenset(name.partition(".")[0].rstrip("-0123456789") for name in one.surfaces) for one in scene.ties}
    assert {"BOLT", "NUT"} in tied and {"BOLT", "WASHER"} in tied and {"NUT", "WASHER"} in tied
    assert [one.through is not None for one in scene.surfaces if one.name.startswith("cut")] == 3 * [True]
    whole, _ = complete(scene, read_model(tmp_path / "m.inp"))
    mesh = read_mesh(whole)
    cuts = cuts_through(mesh, whole.statics.bolts)
    shank = float(re.search(r"shank of (\S+) mm", report_text)[1]) * 1e-3
    assert [cut.area for cut in cuts] == pytest.approx(3 * [np.pi * shank**2 / 4], rel=0.15)  # a polygon of eight sides
    links = find_links(mesh, whole)
    assert not any(note.startswith("WARNING") for note in links.notes)
    for force, stress in re.findall(r"force = (\S+) +# N, of the tightened bolt: here (\S+) MPa", text):
        assert float(stress) == pytest.approx(float(force) / (np.pi * (1e3 * shank) ** 2 / 4), rel=5e-3)
    assert text.count("force = ") == 3 and sum(line.startswith("#>") for line in text.splitlines()) == 0


def test_a_cut_of_the_file_is_used_and_a_tube_is_no_bolt(tmp_path):
    generate_lap(["--out", str(tmp_path / "m.msh")])
    report_text = "\n".join(_write(str(tmp_path / "m.msh"), tmp_path / "m.toml", False))
    assert re.findall(r"bolts: shank of 6 mm, cut by (\S+)", report_text) == ["cut_1", "cut_2", "cut_3"]
    filled(tmp_path / "m.toml")
    scene = read_scene(tmp_path / "m.toml")
    assert [one.group for one in scene.statics.bolts] == ["cut_1", "cut_2", "cut_3"]
    assert {one.surfaces for one in scene.ties} == {("heads", "top"), ("nuts", "bottom")}
    assert [one.surfaces for one in scene.joints] == [("lap_2", "lap_1")]


def test_a_plane_gives_the_cut_of_the_file(tmp_path):
    generate_lap(["--out", str(tmp_path / "m.msh")])
    _write(str(tmp_path / "m.msh"), tmp_path / "m.toml", False)
    filled(tmp_path / "m.toml")
    scene = read_scene(tmp_path / "m.toml")
    file = read_model(tmp_path / "m.msh")
    for name in ("cut_1", "cut_2", "cut_3"):
        at = tuple(file.points[all_nodes(file, name)].mean(axis=0).tolist())
        plane = Surface(name="mine", bodies=("bolts", "bolts"), through=at, normal=(0.0, 0.0, -1.0))
        mesh = read_mesh(scene.with_keys(surfaces=(plane,)), file)
        ours, theirs = (cut_through(mesh, Bolt(group=group, force=1.0)) for group in ("mine", name))
        np.testing.assert_array_equal(ours.nodes, theirs.nodes)
        assert ours.area == pytest.approx(theirs.area, rel=1e-12) and ours.normal == pytest.approx(theirs.normal, abs=1e-12)
        assert {key: value.tolist() for key, value in ours.numbers.items()} == {
            key: value.tolist() for key, value in theirs.numbers.items()
        }


def all_nodes(file, name):
    """Return the nodes of the cells of a group."""
    return np.unique(np.concatenate([file.cells[i].nodes[rows].ravel() for i, rows in file.groups[name].cells.items()]))


def test_nested_groups_assign_each_element_to_one_body():
    _, (bar, plate), _ = corner()
    cells = (Cells("hex8", np.concatenate([bar, plate]), np.arange(1, 7)),)
    rows = {"all": range(6), "bar": range(3), "plate": range(3, 6), "hot": range(2)}

    def bodies(*names):
        groups = {name: Group(cells={0: np.array(rows[name])}) for name in names}
        return list(bodies_of(FileModel(plain().points, np.arange(1, 33), cells, groups)))

    assert bodies("all", "bar", "plate") == ["bar", "plate"]
    assert bodies("bar", "hot", "plate") == ["bar", "plate"]
    assert bodies("all", "hot") == ["all"]


@pytest.mark.parametrize(
    "name, text, message",
    [
        ("none.inp", None, "there is no such file in"),
        ("m.imp", "", "the ending '.imp' is not known; nearest is .inp; known are .msh, .inp"),
        ("m.toml", "", "is a scene; new takes the model file"),
        ("m.inp", "*Node\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n*Element, type=S3, elset=A\n1, 1, 2, 3\n", "holds"),
    ],
)
def test_files_without_model_are_rejected(tmp_path, name, text, message):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises((CaseError, MeshError), match=message):
        _write(str(tmp_path / name), tmp_path / "first.toml", False)
    assert not (tmp_path / "first.toml").exists()


def test_a_scene_is_not_overwritten_unless_forced(tmp_path):
    model, out = write(tmp_path), tmp_path / "first.toml"
    out.write_text("mine")
    with pytest.raises(CaseError, match="exists and is not overwritten; choose another name with --out, or add --force"):
        _write(str(model), out, False)
    assert out.read_text() == "mine"
    _write(str(model), out, True)
    assert "[[joints]]" in out.read_text()
    with pytest.raises(CaseError, match="the name of a scene ends in .toml"):
        _write(str(model), tmp_path / "first.inp", True)


def test_bodies_without_contact_make_a_linear_scene(tmp_path):
    model = plain()
    points = model.points + 0.01 * (np.arange(len(model.points)) < 16)[:, None] * [0.0, 0.0, 1.0]
    path = write(tmp_path, points=points, sets={"PLATE_BASE": model.sets["PLATE_BASE"]})
    report = "\n".join(_write(str(path), tmp_path / "m.toml", False))
    assert "no touching surfaces of different bodies" in report
    assert re.search(
        r"^separate {3}body 'BAR-1.ALL': 0.01 m from the rest, and nothing connects it: add a joint, a tie or", report, re.M
    )
    assert read_scene(tmp_path / "m.toml").joints == ()


def test_a_file_without_supports_makes_a_free_scene(tmp_path):
    sets = plain().sets
    path = write(tmp_path, ".exo", sets={name: sets[name] for name in ("BAR_BOTTOM", "PLATE_TOP")})
    assert "none known: the structure is free" in "\n".join(_write(str(path), tmp_path / "m.toml", False))
    text = filled(tmp_path / "m.toml")
    assert read_scene(tmp_path / "m.toml").supports == () and "#| [[supports]]" in text


def test_groups_are_offered_as_support_except_bodies_and_surfaces_of_the_joint(tmp_path):
    plainly = plain()
    sets = {name: plainly.sets[name] for name in ("BAR_BOTTOM", "PLATE_TOP")}
    sets |= {"NALL": np.arange(len(plainly.points)), "HALF": sets["PLATE_TOP"][:4]}
    path = write(tmp_path, ".exo", sets=sets | {"UPPER": np.flatnonzero(np.isclose(plainly.points[:, 2], 0.025))})
    _write(str(path), tmp_path / "m.toml", False)
    assert "possible groups: UPPER\n" in (tmp_path / "m.toml").read_text()


def test_a_scene_without_missing_entries_can_be_checked_and_run(tmp_path):
    """A material without a density has steel's, as stated on the screen."""
    path = write(tmp_path)
    path.write_text(re.sub(r"(?m)^\*Density\n.*\n", "", path.read_text()))
    report_text = _write(str(path), tmp_path / "m.toml", False)
    assert (
        any(line.endswith("density of steel, not in the file") for line in report_text)
        and "fill in what begins with #>" in report_text[-1]
    )
    points = plain().points + 0.01 * (np.arange(len(plain().points)) < 16)[:, None] * [0.0, 0.0, 1.0]
    report_text = _write(str(write(tmp_path, points=points)), tmp_path / "m.toml", True)
    assert re.fullmatch(r"next       microslip check (\S+m.toml), then: microslip run \1", report_text[-1])
    assert "# Nothing has to be filled in: microslip check" in (tmp_path / "m.toml").read_text()


def test_the_scene_has_units_and_ignored_entries(tmp_path):
    model = plain()
    path = tmp_path / "m.inp"
    text = inp(replace(model, points=1e3 * model.points), ("*Gap, elset=D", "0.1"))
    text = re.sub(r"\*Density\n.*\n\*Elastic\n.*,", "*Density\n7.8e-9,\n*Elastic\n2.1e5,", text)
    path.write_text(text)
    report_text = "\n".join(_write(str(path), tmp_path / "m.toml", False))
    assert "(mm-t-s)" in report_text and "to answer  line " in report_text
    text = filled(tmp_path / "m.toml")
    scene = read_scene(tmp_path / "m.toml")
    assert scene.model.units == "mm-t-s" and scene.model.ignore == ("*GAP",) and ": *GAP: " in text
