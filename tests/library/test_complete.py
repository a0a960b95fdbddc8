"""A scene completed by its model file: the scene has priority, and entries that change the result are never dropped silently."""

from dataclasses import replace

import numpy as np
import pytest

from microslip.formats.model import FileModel, Finding, LoadsAtRest
from microslip.library.complete import complete
from microslip.messages.errors import CaseError
from microslip.scene.read import changed, scene_of
from microslip.tables.constant_loads import Bolt, Force, MovedSupport, Pressure, Statics
from microslip.tables.joint import Joint
from microslip.tables.structure import Body, Material, Point, Support, Tie

STEEL = Material.of_file(young=210000.0, poisson=0.3, density=7.85e-9)
CONTACT = Finding(
    word="*CONTACT PAIR", where="line 7", effect="two surfaces in contact", changes=True, surfaces=("upper", "lower")
)
OUTPUT = Finding(word="*NODE PRINT", where="line 9", effect="output alone", changes=False)


def model(**more):
    """Return a model file with all tables, in mm, t and s."""
    stated = {
        "materials": {"STEEL": STEEL},
        "bodies": {"beam": Body.of_file(group="beam", material="STEEL", integration="reduced")},
        "supports": (Support.of_file(group="root", fix=("x", "y", "z")),),
        "ties": (Tie.of_file(surfaces=("pad", "beam_top"), tolerance=0.1),),
        "connected": (Point.of_file(name="ref", position=(1.0, 2.0, 3.0), group="tip", mass=2e-3, inertia=(4e-3, 5e-3, 6e-3)),),
    }
    return FileModel(np.zeros((0, 3)), np.zeros(0, dtype=int), (), {}, **{**stated, **more})


def scene(path, of_model=None, **more):
    """Return a scene that takes all tables from its model file."""
    path.mkdir(exist_ok=True)
    (path / "job.inp").write_text("")
    tables = {
        "model": {"mesh": "job.inp", "units": "mm-t-s", **(of_model or {})},
        "loads": ({"position": (0.0, 0.0, 0.0), "direction": (0.0, 0.0, 1.0)},),
        "outputs": ({"name": "tip", "position": (0.0, 0.0, 0.0), "direction": (0.0, 0.0, 1.0)},),
        "damping": {"ratio": 0.01},
        "response": {"levels": (1.0,), "frequencies": (1.0, 2.0)},
    }
    return scene_of({**tables, **more}, path / "scene.toml")


def test_all_tables_of_the_model_file_are_converted_to_si_units(tmp_path):
    completed, notes = complete(scene(tmp_path), model())
    assert completed.model.metres == 1e-3
    assert completed.materials["STEEL"].young == pytest.approx(2.1e11)
    assert completed.sections["beam"].density == pytest.approx(7850.0)
    assert (completed.bodies["beam"].integration, completed.supports[0].group) == ("reduced", "root")
    assert completed.ties[0].tolerance == pytest.approx(1e-4)
    point = completed.points[0]
    assert point.position == pytest.approx((1e-3, 2e-3, 3e-3))
    assert point.mass == pytest.approx(2.0) and point.inertia[:3] == pytest.approx((4e-6, 5e-6, 6e-6))
    assert "1 body taken over from job.inp: beam" in notes


def test_tables_of_the_scene_have_priority(tmp_path):
    own = {"young": 7e10, "poisson": 0.33, "density": 2700.0}
    stated = scene(
        tmp_path,
        materials={"STEEL": own, "unused": own},
        bodies={"half": {"group": "upper_half", "material": "STEEL"}},
        supports=({"group": "other_root", "fix": ("x",)},),
    )
    completed, _ = complete(stated, model())
    assert list(completed.bodies) == ["half"] and list(completed.materials) == ["STEEL"]
    assert completed.materials["STEEL"].young == 7e10
    assert [support.group for support in completed.supports] == ["other_root"]
    assert len(completed.ties) == 1


def test_take_adds_the_listed_tables_of_the_file_only(tmp_path):
    own = ({"group": "other_root", "fix": ("x",)},)
    completed, _ = complete(scene(tmp_path, {"take": ("materials", "bodies", "supports")}, supports=own), model())
    assert [support.group for support in completed.supports] == ["root", "other_root"]
    assert completed.ties == () and completed.points == ()


def test_a_joint_replaces_a_tie_or_a_contact_between_its_surfaces(tmp_path):
    keys = {"name": "j", "friction": 0.3, "tangential_stiffness": 1e12, "normal_stiffness": 1e12, "preload": 1e6}
    tied = scene(tmp_path, joints=({**keys, "surfaces": ("beam_top", "pad")},))
    assert complete(tied, model())[0].ties == ()
    in_contact = scene(tmp_path, joints=({**keys, "surfaces": ("lower", "upper")},))
    completed, notes = complete(in_contact, model(findings=(CONTACT,)))
    assert completed.joints
    assert "line 7: *CONTACT PAIR is replaced by a joint or tie of the scene between upper and lower" in notes
    assert not any("left out" in note for note in notes)


def test_entries_that_change_the_result_are_rejected_unless_ignored_by_name(tmp_path):
    with pytest.raises(CaseError, match=r"(?s)job.inp: 1 entry .*\[model\] ignore takes .\*CONTACT PAIR..*line 7.*in contact"):
        complete(scene(tmp_path), model(findings=(CONTACT, OUTPUT)))
    completed, notes = complete(scene(tmp_path, {"ignore": ("contact pair",)}), model(findings=(CONTACT, OUTPUT)))
    assert completed.ties and [note for note in notes if "left out" in note] == [
        "line 7: *CONTACT PAIR is left out: two surfaces in contact",
        "line 9: *NODE PRINT is left out: output alone",
    ]
    with pytest.raises(CaseError, match=r'holds no "\*CONTACT PAIRS" that is left out; nearest is "\*CONTACT PAIR"'):
        complete(scene(tmp_path, {"ignore": ("*CONTACT PAIRS",)}), model(findings=(CONTACT,)))


def test_entries_of_tables_that_are_not_used_have_no_effect(tmp_path):
    moved = Finding(word="*BOUNDARY", where="line 3", effect="a displacement other than 0", changes=True, part="supports")
    own = ({"group": "other_root", "fix": ("x",)},)
    complete(scene(tmp_path, supports=own), model(findings=(moved,)))
    with pytest.raises(CaseError, match="a displacement other than 0"):
        complete(scene(tmp_path), model(findings=(moved,)))


WORD = "*STEP, PERTURBATION"
LOADED = {
    "connected": (),
    "statics": LoadsAtRest(
        word=WORD,
        step=1,
        table=Statics.of_file(
            forces=(Force.of_file(group="tip", force=(1.0, 0.0, -2.0)),),
            pressures=(Pressure.of_file(group="pad", pressure=3.0),),
            bolts=(Bolt.of_file(name="bolt", group="cut", force=4.0),),
            rotation_speed=5.0,
        ),
        axis=(0.0, 0.0, 1.0),
        axis_point=(6.0, 0.0, 0.0),
    ),
    "findings": (Finding(word=WORD, where="line 9", effect="vibration about loads", changes=True, part="statics"), OUTPUT),
}
LARGE = Finding(word="*STEP, NLGEOM", where="line 7", effect="large displacements", changes=True, part="statics")
GRAVITY = Finding(word="*DLOAD, GRAV", where="line 8", effect="a load GRAV", changes=True, part="statics")


def test_loads_before_the_vibration_become_statics(tmp_path):
    completed, notes = complete(scene(tmp_path), model(**LOADED))
    statics = completed.statics
    assert statics.forces[0].force == (1.0, 0.0, -2.0) and (statics.pressures[0].group, statics.pressures[0].pressure) == (
        "pad",
        3e6,
    )
    assert (statics.bolts[0].group, statics.bolts[0].force) == ("cut", 4.0)
    assert (statics.rotation_speed, completed.model.axis, completed.model.axis_point) == (5.0, (0.0, 0.0, 1.0), (6e-3, 0.0, 0.0))
    assert (
        statics.deformed_shape
        and not any(WORD in note for note in notes)
        and "[statics] with 1 force, 1 pressure, 1 bolt and rotation of step 1 taken over from job.inp" in notes
    )


def test_loads_before_the_vibration_are_stated_used_or_ignored(tmp_path):
    pulled = {"forces": ({"group": "root", "force": (7.0, 0.0, 0.0)},)}
    completed, _ = complete(scene(tmp_path, statics=pulled), model(**LOADED))
    assert completed.statics.bolts == () and not completed.statics.deformed_shape and completed.model.axis is None
    completed, _ = complete(scene(tmp_path, {"take": ("bodies", "materials", "statics")}, statics=pulled), model(**LOADED))
    assert [force.group for force in completed.statics.forces] == ["tip", "root"] and len(completed.statics.bolts) == 1
    findings = (*LOADED["findings"], GRAVITY)
    assert complete(scene(tmp_path, {"ignore": (WORD,)}), model(**{**LOADED, "findings": findings}))[0].statics is None
    with pytest.raises(CaseError, match=r'1 entry .*takes "\*DLOAD, GRAV"'):
        complete(scene(tmp_path), model(**{**LOADED, "findings": findings}))
    completed, _ = complete(scene(tmp_path, {"ignore": ("*DLOAD, GRAV",)}), model(**{**LOADED, "findings": findings}))
    assert len(completed.statics.bolts) == 1
    with pytest.raises(CaseError, match=r'takes "\*STEP, PERTURBATION"'):
        complete(scene(tmp_path, {"take": ("bodies", "materials")}), model(**LOADED))


def test_large_displacements_and_moved_supports_of_the_file_are_used(tmp_path):
    moved = (MovedSupport.of_file(group="pad", displacement=(0.0, 0.0, -0.5)),)
    table = LOADED["statics"].table.with_keys(bolts=(), displacements=moved)
    held = replace(LOADED["statics"], table=table, large="*STEP, NLGEOM")
    whole = model(**{**LOADED, "statics": held, "findings": (*LOADED["findings"], LARGE)})
    completed, _ = complete(scene(tmp_path), whole)
    assert completed.statics.large_displacements and not completed.statics.deformed_shape
    assert completed.statics.displacements[0].displacement == (0.0, 0.0, -5e-4)
    completed, notes = complete(scene(tmp_path, {"ignore": ("*STEP, NLGEOM",)}), whole)
    assert completed.statics.deformed_shape and not completed.statics.large_displacements
    assert "line 7: *STEP, NLGEOM is left out: large displacements" in notes


def test_a_joint_may_depend_on_the_statics_of_the_file(tmp_path):
    keys = {"name": "j", "friction": 0.3, "tangential_stiffness": 1e12, "normal_stiffness": 1e12, "preload": "static"}
    tied = scene(tmp_path, joints=({**keys, "surfaces": ("a", "b")},))
    assert complete(tied, model(**LOADED))[0].statics.forces
    with pytest.raises(CaseError, match=r"there is no table \[statics\]"):
        complete(tied, model())


def test_incomplete_materials_and_unknown_units_are_rejected(tmp_path):
    light = model(materials={"STEEL": Material.of_file(young=1.0, poisson=0.3)})
    with pytest.raises(CaseError, match=r"material 'STEEL' of job.inp has no density; state \[materials.STEEL\]"):
        complete(scene(tmp_path), light)
    scaled = scene_of(
        {**scene(tmp_path).model_dump(exclude_unset=True), "model": {"mesh": "job.inp", "scale": 1e-3}}, tmp_path / "s"
    )
    with pytest.raises(CaseError, match="state units = 'm-kg-s'"):
        complete(scaled, model())
    without_materials = model(materials={}, connected=(), bodies={"beam": Body.of_file(group="beam", material="own")})
    stated = {"materials": {"own": {"young": 2.1e11, "poisson": 0.3, "density": 7850.0}}}
    (tie,) = complete(scene_of({**scaled.model_dump(exclude_unset=True), **stated}, tmp_path / "s"), without_materials)[0].ties
    assert tie.tolerance == pytest.approx(1e-4)  # a length, converted by scale


def test_a_completed_scene_is_not_completed_again(tmp_path):
    completed, _ = complete(scene(tmp_path), model())
    completed_again, notes = complete(changed(completed, {"solver": {"harmonics": 5}}), model())
    assert len(completed_again.ties) == 1 and notes == () and completed_again.solver.harmonics == 5


def test_missing_bodies_are_rejected(tmp_path):
    with pytest.raises(CaseError, match=r"\[bodies\] is missing"):
        complete(scene(tmp_path), model(bodies={}))


RUBBING = Joint.of_file(
    name="lap",
    surfaces=("upper", "lower"),
    pairing="points",
    friction=0.3,
    tangential_stiffness=2.0,
    normal_stiffness=3.0,
    preload="static",
    tolerance=0.5,
)
IN_CONTACT = {**LOADED, "joints": (RUBBING,), "findings": (*LOADED["findings"], CONTACT)}


def test_a_contact_of_the_file_becomes_a_joint_preloaded_by_its_loads(tmp_path):
    completed, notes = complete(scene(tmp_path), model(**IN_CONTACT))
    (joint,) = completed.joints
    assert (joint.name, joint.surfaces, joint.pairing, joint.friction) == ("lap", ("upper", "lower"), "points", 0.3)
    assert (joint.tangential_stiffness, joint.normal_stiffness) == pytest.approx((2e9, 3e9))
    assert (joint.preload, joint.gap, joint.tolerance) == ("static", 0.0, pytest.approx(5e-4))
    assert joint.stated_values["preload"] == 0.0
    assert "1 joint taken over from job.inp: lap" in notes and not any("CONTACT" in note for note in notes)
    far = {**IN_CONTACT, "joints": (RUBBING.with_keys(tolerance=None, gap="geometry"),)}
    joint = complete(scene(tmp_path), model(**far))[0].joints[0]
    assert (joint.gap, joint.tolerance) == ("geometry", None)


def test_a_joint_of_the_scene_has_priority_over_a_contact_of_the_file(tmp_path):
    keys = {"name": "j", "friction": 0.1, "tangential_stiffness": 1e12, "normal_stiffness": 1e12, "preload": 1e6}
    stated = scene(tmp_path, joints=({**keys, "surfaces": ("lower", "upper")},))
    assert [joint.name for joint in complete(stated, model(**IN_CONTACT))[0].joints] == ["j"]
    completed, notes = complete(scene(tmp_path, {"ignore": ("*CONTACT PAIR",)}), model(**IN_CONTACT))
    assert completed.joints == () and "line 7: *CONTACT PAIR is left out: two surfaces in contact" in notes
    lacking = {**IN_CONTACT, "joints": (RUBBING.with_keys(normal_stiffness=None),)}
    for own, of_file in (
        (scene(tmp_path), lacking),
        (scene(tmp_path, {"take": ("bodies", "materials", "statics")}), IN_CONTACT),
        (scene(tmp_path, {"ignore": (WORD,)}), IN_CONTACT),
    ):
        with pytest.raises(CaseError, match=r"1 entry .*takes .\*CONTACT PAIR"):
            complete(own, model(**of_file))
