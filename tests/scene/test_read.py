"""Scenes as the user writes them: every key arrives, and every mistake gives one message that names it."""

import pickle

import pytest
from scene_files import GOOD, write_scene

from microslip.messages.errors import CaseError
from microslip.scene.read import read_scene
from microslip.scene.schema import Table


def message(folder, old, new):
    """Return the message for the scene with ``old`` replaced by ``new``, without the file's name."""
    path = write_scene(folder, old, new)
    with pytest.raises(CaseError) as found:
        read_scene(path)
    assert found.value.exit_status == 2
    text = str(found.value)
    assert text.startswith(f"{path}: ")
    return text.removeprefix(f"{path}: ")


def test_every_key_arrives(tmp_path):
    scene = read_scene(write_scene(tmp_path))
    assert scene.materials["titanium"].model_dump(exclude_none=True) == {"young": 114e9, "poisson": 0.33, "density": 4430.0}
    assert [(name, body.group, body.integration) for name, body in scene.bodies.items()] == [
        ("blade", "blade", "full"),
        ("disc", "disc", "reduced"),
    ]
    assert scene.supports[0].fix == ("x", "y", "z")
    assert scene.joints[0].surfaces == ("blade_root", "disc_slot")
    assert (scene.joints[0].preload, scene.joints[0].tolerance) == (5e7, None)
    assert (scene.loads[0].position, scene.loads[0].node, scene.loads[0].harmonic) == ((0.0, 0.02, 0.1), None, 1)
    assert scene.outputs[0].direction == (1.0, 0.0, 0.0)
    assert (scene.damping.ratio, scene.damping.rayleigh) == (1e-3, None)
    assert (scene.response.levels, scene.response.at) == ((1.0, 3.0, 5.0, 8.0), (99.5, 100.0))
    assert (scene.solver.method, scene.solver.modes) == ("adaptive-energy", 20)


def test_the_scene_knows_its_file(tmp_path, monkeypatch):
    write_scene(tmp_path)
    monkeypatch.chdir(tmp_path)
    scene = read_scene("fan.toml")
    assert (scene.path, scene.folder, scene.name, scene.text) == (tmp_path / "fan.toml", tmp_path, "fan", GOOD)


def test_a_scene_survives_a_broadcast_and_stays_as_it_is(tmp_path):
    scene = read_scene(write_scene(tmp_path))
    copy = pickle.loads(pickle.dumps(scene))
    assert copy == scene
    assert (copy.path, copy.text) == (scene.path, scene.text)
    with pytest.raises(ValueError, match="frozen"):
        scene.solver.modes = 3


def test_what_may_be_left_out_has_the_documented_default(tmp_path):
    scene = read_scene(write_scene(tmp_path, GOOD[GOOD.index("[solver]") :], ""))
    assert (scene.solver.method, scene.solver.modes, scene.solver.harmonics, scene.solver.samples) == ("receptance", None, 3, 128)
    assert (scene.solver.tolerance, scene.solver.verify_modes, scene.solver.in_point_check) == (1e-8, True, False)
    assert (scene.response.direction, scene.continuation, scene.model.scale) == ("up", None, 1.0)
    assert scene.bodies["blade"].incompatible_modes is True


def test_windows_files_are_read(tmp_path):
    path = write_scene(tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert read_scene(path).title == "Fan-blade sector, first flap mode"


@pytest.mark.parametrize(
    "old, new, expected",
    [
        # words that nobody knows
        ("young", "yung", '[materials.titanium] yung: unknown key; nearest is "young"'),
        ("friction =", "friktion =", '[[joints]] 1 ("dovetail") friktion: unknown key; nearest is "friction"'),
        ("position =", "pos =", '[[loads]] 1 pos: unknown key; nearest is "position"'),
        ("[damping]", "[dampng]", "[dampng]: unknown table; nearest is [damping]"),
        ("[[supports]]", "[[support]]", "[[support]]: unknown table; nearest is [[supports]]"),
        ("[materials.", "[material.", "[material]: unknown table; nearest is [materials.NAME]"),
        ("title", "titel", 'titel: unknown key; nearest is "title"'),
        ("title", "density = 1\ntitle", "density: unknown key; [materials.NAME] has a key of this name"),
        ("[damping]", "[zzz]", "[zzz]: unknown table; known: [model], [materials.NAME], [bodies.NAME], [[supports]], [[joints]]"),
        (
            "points = 98",
            "tolerance = 1e-8",
            "[response] tolerance: unknown key; [[joints]], [[ties]], [[surfaces]] or [solver] has a key of this name",
        ),
        ("points = 98", "zzz = 1", "[response] zzz: unknown key; known: levels, frequencies, mode, span, points, at, direction"),
        (
            '"adaptive-energy"',
            '"adaptive_energi"',
            '[solver] method = "adaptive_energi": expected a method\'s name; nearest is '
            '"adaptive-energy"; known: adaptive, adaptive-energy, receptance',
        ),
        (
            '"circle"',
            '"circel"',
            '[[joints]] 1 ("dovetail") friction_limit = "circel": expected "circle" or "separate"; nearest is "circle"',
        ),
        (
            '"titanium"',
            '"titanum"',
            '[bodies.blade] material = "titanum": there is no such material; nearest is "titanium"; known: titanium',
        ),
        # wrong types
        (
            "114e9",
            '"114e9"',
            '[materials.titanium] young = "114e9": expected Young\'s modulus in Pa, a number above 0, or three along the axes of the material; without quotes',
        ),
        ("4430.0", "true", "[materials.titanium] density = true: expected the density in kg/m3, a number above 0"),
        ("modes = 20", "modes = 20.0", "[solver] modes = 20.0: expected the number of modes, a whole number of at least 1"),
        (
            "[1.0, 3.0, 5.0, 8.0]",
            "1.0",
            "[response] levels = 1.0: expected a list of load levels in N, numbers above 0, each once",
        ),
        ('["x", "y", "z"]', '"xyz"', '[[supports]] 1 fix = "xyz": expected the fixed directions'),
        ("title = ", "title = 3 # ", "title = 3: expected a text in quotes"),
        ("[damping]", "[[damping]]", "[damping] = a list of tables: expected a table [damping]"),
        ("[[loads]]", "[loads]", "[[loads]] = a table: expected at least one table headed [[loads]]"),
        ("[damping]", "[bodies]\nskin = 3\n[damping]", "[bodies.skin] = 3: expected a table with group, material, integration"),
        # numbers outside sense
        (
            "114e9",
            "nan",
            "[materials.titanium] young = nan: expected Young's modulus in Pa, a number above 0, or three along the axes of the material; nan and inf",
        ),
        ("0.26]", "inf]", '[[outputs]] 1 ("mid_blade") position = [0.0, 0.0, inf]: expected three coordinates'),
        ("114e9", "-114e9", "[materials.titanium] young = -1.14e+11: expected"),
        ("0.33", "0.5", "[materials.titanium] poisson = 0.5: expected Poisson's ratio, a number above -1 and below 0.5"),
        ("4430.0", "0.0", "[materials.titanium] density = 0.0: expected"),
        (
            "friction = 0.3",
            "friction = -0.3",
            '[[joints]] 1 ("dovetail") friction = -0.3: expected the friction coefficient, a number of at least 0',
        ),
        ("= 2.0e13", "= -2.0e13", '[[joints]] 1 ("dovetail") tangential_stiffness = -2e+13: expected'),
        (
            "[90.0, 110.0]",
            "[110.0, 90.0]",
            "[response] frequencies = [110.0, 90.0]: expected two frequencies in Hz, above 0 and at "
            "most 1e9, the lower one first",
        ),
        ("[90.0, 110.0]", "[0.0, 110.0]", "[response] frequencies = [0.0, 110.0]: expected"),
        ("[90.0, 110.0]", "[90.0, 2e9]", "[response] frequencies = [90.0, 2e+09]: expected"),
        ("points = 98", "points = 1", "[response] points = 1: expected"),
        ("[1.0, 3.0, 5.0, 8.0]", "[]", "[response] levels = []: expected"),
        ("[1.0, 3.0, 5.0, 8.0]", "[1.0, 0.0]", "[response] levels = [1.0, 0.0]: expected"),
        (
            "[1.0, 0.0, 0.0]",
            "[0.0, 0.0, 0.0]",
            "[[loads]] 1 direction = [0.0, 0.0, 0.0]: expected three numbers [x, y, z], not all 0",
        ),
        ("harmonics = 3", "harmonics = -1", "[solver] harmonics = -1: expected"),
        ("samples = 128", "samples = 6", "[solver]: samples = 6 do not resolve harmonics = 3; at least 7 are needed"),
        ("ratio = 1e-3", "ratio = 1.5", "[damping] ratio = 1.5: expected"),
        ("ratio = 1e-3", "rayleigh = [1.0]", "[damping] rayleigh = [1.0]: expected [alpha, beta]"),
        ("[solver]", "[continuation]\nds_min = 0.1\nds = 0.01\n[solver]", "[continuation]: ds_min = 0.1 is above ds = 0.01"),
        # what is missing, or too much
        ("density = 4430.0", "", "[materials.titanium] density is missing: expected the density in kg/m3"),
        ("[damping]\nratio = 1e-3", "", "[damping] is missing: expected a table [damping]"),
        ("ratio = 1e-3", "", "[damping]: exactly one of ratio, rayleigh is needed, found none"),
        (
            "ratio = 1e-3",
            "ratio = 1e-3\nrayleigh = [1.0, 0.0]",
            "[damping]: exactly one of ratio, rayleigh is needed, found ratio and rayleigh",
        ),
        (
            "harmonic = 1",
            "node = 12",
            "[[loads]] 1: exactly one of position, node, group, dof is needed, found position and node",
        ),
        ("direction = [1.0, 0.0, 0.0]", "", "[[loads]] 1: direction is missing: expected three numbers"),
        ("frequencies = [90.0, 110.0]", "mode = 1", "[response]: span is missing"),
        ("points = 98", "span = [0.9, 1.1]", "[response]: span belongs to mode"),
        ("preload = 5.0e7", "", '[[joints]] 1 ("dovetail"): preload is missing: expected the contact pressure at rest in Pa'),
        ("gap = 0.0", "gap = 1e-5", '[[joints]] 1 ("dovetail"): gap = 1e-05 with preload'),
        ('mesh = "fan_sector.msh"', 'mesh = "fan_sector.msh"\nstiffness = "K.mtx"', "[model]: exactly one of mesh, stiffness"),
        (
            'mesh = "fan_sector.msh"',
            'mesh = "fan_sector.msh"\nmass = "M.mtx"',
            "[model]: mass belongs to a model given as matrices",
        ),
        # what does not fit together
        (
            '["blade_root", "disc_slot"]',
            '["slot", "slot"]',
            '[[joints]] 1 ("dovetail") surfaces = ["slot", "slot"]: expected the names of two different groups',
        ),
        (
            "harmonics = 3\nsamples = 128",
            "accuracy = 1e-3\nerror_bars = false",
            "[solver] error_bars = false: accuracy chooses harmonics and samples by them; leave error_bars out, or state both",
        ),
        ("harmonics = 3", "accuracy = 1e-3\nerror_bars = false", "[solver] error_bars = false: accuracy chooses"),
        ("harmonic = 1", "harmonic = 4", "[[loads]] 1 harmonic = 4: [solver] harmonics = 3 leaves it out"),
        ("at = [99.5, 100.0]", "at = [99.5, 120.0]", "[response]: at holds 120 Hz, outside frequencies = [90, 110]"),
        ("frequencies = [90.0, 110.0]", "mode = 21\nspan = [0.9, 1.1]", "[response] mode = 21: only [solver] modes = 20"),
        ('group = "disc"', 'group = "blade"', '[bodies.disc] group = "blade": [bodies.blade] has it already'),
        (
            "[damping]",
            '[[outputs]]\nname = "mid_blade"\nnode = 3\ndirection = [0, 0, 1]\n[damping]',
            '[[outputs]] name = "mid_blade" is used 2 times',
        ),
        ('"mid_blade"', '"mid,blade"', '[[outputs]] 1 ("mid,blade") name = "mid,blade": expected a name'),
        # what belongs to matrices
        (
            "position = [0.0, 0.02, 0.10]\ndirection = [1.0, 0.0, 0.0]",
            "dof = 3",
            "[[loads]] 1 dof: belongs to a model given as matrices; with a mesh, name a position or a node",
        ),
        ("position = [0.0, 0.0, 0.26]\ndirection = [1.0, 0.0, 0.0]", "dof = 3", '[[outputs]] 1 ("mid_blade") dof: belongs to'),
        (
            GOOD[GOOD.index("surfaces") : GOOD.index("friction_limit")],
            'pairs = "fan_sector.msh"\n',
            '[[joints]] 1 ("dovetail") pairs: belongs to a model given as matrices; with a mesh, name two surfaces',
        ),
        ("[solver]", "[statics]\nrotation_speed = 100.0\n[solver]", "[statics] rotation_speed: [model] axis is missing"),
        ("preload = 5.0e7", 'preload = "static"', '[[joints]] 1 ("dovetail") preload = "static": there is no table [statics]'),
        (
            '"adaptive-energy"',
            '"rubbin"',
            'nearest is "rubin"; known: adaptive, adaptive-energy, receptance, full, craig-bampton, '
            "rubin, joint-interface-modes, trial-vectors",
        ),
        # materials with axes of their own
        ("young = 114e9\n", "", "[materials.titanium]: young is missing: expected Young's modulus in Pa"),
        ("114e9", "[1e11, 1e10, 1e10]", "[materials.titanium]: an orthotropic material has three numbers each of young, poisson"),
        (
            "114e9",
            "[1e11, 1e10]",
            "[materials.titanium] young = [1e+11, 1e+10]: expected Young's modulus in Pa, a number above 0, or",
        ),
        ("114e9", "114e9\nshear = [1e9, 1e9, 1e9]", "[materials.titanium]: an orthotropic material has three numbers each"),
        (
            "114e9",
            "114e9\nexpansion = [1e-5, 1e-5, 2e-5]",
            "[materials.titanium]: expansion holds three numbers, and the material is",
        ),
        (
            'group = "blade"\n',
            'group = "blade"\norientation = "fibres"\n',
            '[bodies.blade] orientation = "fibres": there is no such orientation; there is no table [orientations.NAME] at all',
        ),
        (
            "[damping]",
            "[orientations.a]\ndirections = [[1, 0, 0], [-2, 0, 0]]\n[damping]",
            "[orientations.a]: directions are parallel; they span no plane",
        ),
        (
            "[damping]",
            "[orientations.a]\ndirections = [[1, 0, 0], [0, 1, 0]]\naxis_point = [0, 0, 0]\n[damping]",
            "[orientations.a]: axis_point belongs to axis",
        ),
        ("[damping]", "[orientations.a]\n[damping]", "[orientations.a]: exactly one of directions, axis is needed, found none"),
        # files
        ('"fan_sector.msh"', '"fan_sctor.msh"', '[model] mesh = "fan_sctor.msh": there is no such file in '),
        ('"fan_sector.msh"', '"fan_sctor.msh"', '; nearest is "fan_sector.msh"'),
        ('"fan_sector.msh"', '"none/fan.msh"', '[model] mesh = "none/fan.msh": there is no folder '),
        ('"fan_sector.msh"', '"."', '[model] mesh = ".": that is a folder'),
        # TOML itself
        (
            "points = 98",
            "points 98",
            "not valid TOML: Expected '=' after a key in a key/value pair (at line 52, column 8): points 98",
        ),
        ("points = 98", "points = 98\npoints = 99", "not valid TOML: Cannot overwrite a value (at line 53"),
    ],
)
def test_a_mistake_gives_one_message(tmp_path, old, new, expected):
    found = message(tmp_path, old, new)
    assert expected in found
    assert "\n" not in found


def test_error_bars_may_be_left_out_where_accuracy_has_modes_alone_to_choose(tmp_path):
    scene = read_scene(write_scene(tmp_path, "harmonics = 3", "harmonics = 3\naccuracy = 1e-3\nerror_bars = false"))
    assert not scene.solver.error_bars and not scene.chooses("harmonics") and not scene.chooses("samples")


def test_statics_ask_for_constant_loads_and_a_method_that_bears_them(tmp_path):
    found = message(tmp_path, "harmonics = 3", "harmonics = 0").splitlines()
    assert found[0] == "2 mistakes"
    assert "[[loads]] 1 harmonic = 1: [solver] harmonics = 0 leaves it out; raise that, or lower the load's" in found[1]
    assert '[solver] method = "adaptive-energy": with harmonics = 0 no pair dissipates' in found[2]
    constant = GOOD.replace("harmonic = 1", "harmonic = 0").replace("harmonics = 3", "harmonics = 0")
    assert GOOD.count("modes = 20") == 1
    for method, text in {
        "rubin": 'modes is missing: with harmonics = 0 the modes of method = "rubin" bear the load',
        "craig-bampton": "modes is missing",
    }.items():
        changed = constant.replace('"adaptive-energy"', f'"{method}"').replace("modes = 20", "")
        assert text in message(tmp_path, GOOD, changed)


def test_several_mistakes_come_in_one_message_each_once(tmp_path):
    lines = message(tmp_path, GOOD[GOOD.index("[damping]") :], '[[loads]]\nnod = 3\n[damping]\nrato = "1e-3"\n').splitlines()
    assert lines[0] == "3 mistakes"
    assert [line.strip().split(": ")[0] for line in lines[1:]] == ["[[loads]] 2 nod", "[damping] rato", "[response] is missing"]


@pytest.mark.parametrize(
    "text, expected",
    [("", "[model] is missing"), ("a = " + 5000 * "[", "not a scene: lists or tables lie too deep"), ("\x00", "not valid TOML")],
)
def test_files_that_are_no_scenes_are_refused(tmp_path, text, expected):
    path = tmp_path / "fan.toml"
    path.write_text(text)
    with pytest.raises(CaseError, match=expected.replace("[", r"\[")):
        read_scene(path)


def test_a_missing_scene_a_folder_and_a_binary_file_are_named(tmp_path):
    path = write_scene(tmp_path)
    with pytest.raises(CaseError, match='fan.tml: there is no such file in .*; nearest is "fan.toml"'):
        read_scene(tmp_path / "fan.tml")
    with pytest.raises(CaseError, match="is a folder; a scene file is expected"):
        read_scene(tmp_path)
    path.write_bytes(b"\x89HDF\r\n")
    with pytest.raises(CaseError, match="not a text file in UTF-8"):
        read_scene(path)


@pytest.mark.parametrize("table", Table.__subclasses__())
def test_every_key_says_what_is_expected_of_it(table):
    assert all(field.description for field in table.model_fields.values())
