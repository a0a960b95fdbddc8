"""Scene files: every key is read, and every mistake gives one message that names it."""

import pickle

import pytest
from scene_files import GOOD, write_scene

from microslip.library.settings import reduction_settings, response_settings
from microslip.messages.errors import CaseError
from microslip.scene.read import changed, read_scene
from microslip.tables.table import Table


def message(folder, old, new):
    """Return the message for the scene with ``old`` replaced by ``new``, without the name of the file."""
    path = write_scene(folder, old, new)
    with pytest.raises(CaseError) as caught:
        read_scene(path)
    assert caught.value.exit_status == 2
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    return text.removeprefix(f"{path}: ")


def test_every_key_is_read(tmp_path):
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


def test_the_scene_has_path_name_and_text_of_its_file(tmp_path, monkeypatch):
    write_scene(tmp_path)
    monkeypatch.chdir(tmp_path)
    scene = read_scene("fan.toml")
    assert (scene.path, scene.folder, scene.name, scene.text) == (tmp_path / "fan.toml", tmp_path, "fan", GOOD)


def test_a_scene_can_be_pickled_and_is_immutable(tmp_path):
    scene = read_scene(write_scene(tmp_path))
    copy = pickle.loads(pickle.dumps(scene))
    assert copy == scene
    assert (copy.path, copy.text) == (scene.path, scene.text)
    with pytest.raises(ValueError, match="frozen"):
        scene.solver.modes = 3


def test_optional_keys_have_the_documented_default(tmp_path):
    scene = read_scene(write_scene(tmp_path, GOOD[GOOD.index("[solver]") :], ""))
    assert (scene.solver.method, scene.solver.modes, scene.solver.harmonics, scene.solver.samples) == ("receptance", None, 3, 128)
    assert (scene.solver.tolerance, scene.solver.verify_modes, scene.solver.in_point_check) == (1e-8, True, False)
    assert (scene.response.direction, scene.continuation, scene.model.scale) == ("up", None, 1.0)
    assert scene.bodies["blade"].incompatible_modes is True


@pytest.mark.parametrize(
    ("solver", "accuracy", "is_chosen"),
    [
        ({}, 1e-2, True),
        ({"samples": 256}, 1e-2, True),
        ({"accuracy": 1e-4}, 1e-4, True),
        ({"accuracy": 1e-4, "harmonics": 5}, 1e-4, False),
        ({"harmonics": 3}, None, False),
        ({"error_bars": False}, None, False),
    ],
)
def test_a_scene_without_harmonics_and_accuracy_has_an_accuracy_of_a_hundredth(solver, accuracy, is_chosen, tmp_path):
    scene = changed(read_scene(write_scene(tmp_path, GOOD[GOOD.index("[solver]") :], "")), {"solver": solver})
    assert (scene.accuracy, scene.chooses("harmonics")) == (accuracy, is_chosen)
    assert response_settings(scene).accuracy == accuracy and reduction_settings(scene).accuracy == (accuracy or 1e-3)


def test_windows_files_are_read(tmp_path):
    path = write_scene(tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert read_scene(path).title == "Fan-blade sector, first flap mode"


@pytest.mark.parametrize(
    "old, new, expected",
    [
        # unknown words
        ("[[supports]]", "[[support]]", "[[support]]: unknown table; nearest is [[supports]]"),
        ("[materials.", "[material.", "[material]: unknown table; nearest is [materials.NAME]"),
        ("title", "titel", 'titel: unknown key; nearest is "title"'),
        ("title", "density = 1\ntitle", "density: unknown key; [materials.NAME] has a key of this name"),
        ("[damping]", "[zzz]", "[zzz]: unknown table; known: [model], [materials.NAME], [bodies.NAME], [[supports]], [[joints]]"),
        (
            "points = 98",
            "tolerance = 1e-8",
            "[response] tolerance: unknown key; [[joints]], [[ties]], [[surfaces]], [cyclic], [solver] or [wear] has a key of this name",
        ),
        ("points = 98", "zzz = 1", "[response] zzz: unknown key; known: levels, frequencies, mode, span, points, at, direction"),
        # wrong types
        ("4430.0", "true", "[materials.titanium] density = true: expected the density in kg/m3, a number above 0"),
        ("modes = 20", "modes = 20.0", "[solver] modes = 20.0: expected the number of modes, a whole number of at least 1"),
        (
            "[1.0, 3.0, 5.0, 8.0]",
            "1.0",
            "[response] levels = 1.0: expected a list of load levels in N, numbers above 0 and at most 1e100, each once",
        ),
        ("title = ", "title = 3 # ", "title = 3: expected a text in quotes"),
        ("[damping]", "[[damping]]", "[damping] = a list of tables: expected a table [damping]"),
        ("[damping]", "[bodies]\nskin = 3\n[damping]", "[bodies.skin] = 3: expected a table with group, material, integration"),
        # numbers out of range
        ("ratio = 1e-3", "rayleigh = [1.0]", "[damping] rayleigh = [1.0]: expected [alpha, beta]"),
        # missing and redundant keys
        (
            "ratio = 1e-3",
            "ratio = 1e-3\nrayleigh = [1.0, 0.0]",
            "[damping]: exactly one of ratio, rayleigh is needed, found ratio and rayleigh",
        ),
        ("points = 98", "span = [0.9, 1.1]", "[response]: span belongs to mode"),
        ("preload = 5.0e7", "", '[[joints]] 1 ("dovetail"): preload is missing: expected the contact pressure at rest in Pa'),
        (
            'mesh = "fan_sector.msh"',
            'mesh = "fan_sector.msh"\nmass = "M.mtx"',
            "[model]: mass belongs to a model given as matrices",
        ),
        # contradictions
        ("harmonics = 3", "accuracy = 1e-3\nerror_bars = false", "[solver] error_bars = false: accuracy chooses"),
        # keys of matrices
        ("position = [0.0, 0.0, 0.26]\ndirection = [1.0, 0.0, 0.0]", "dof = 3", '[[outputs]] 1 ("mid_blade") dof: belongs to'),
        (
            GOOD[GOOD.index("surfaces") : GOOD.index("friction_limit")],
            'pairs = "fan_sector.msh"\n',
            '[[joints]] 1 ("dovetail") pairs: belongs to a model given as matrices; with a mesh, name two surfaces',
        ),
        # anisotropic materials
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
        # TOML itself
    ],
)
def test_a_mistake_gives_one_message(tmp_path, old, new, expected):
    text = message(tmp_path, old, new)
    assert expected in text
    assert "\n" not in text


def test_error_bars_are_optional_if_accuracy_chooses_only_modes(tmp_path):
    scene = read_scene(write_scene(tmp_path, "harmonics = 3", "harmonics = 3\naccuracy = 1e-3\nerror_bars = false"))
    assert not scene.solver.error_bars and not scene.chooses("harmonics") and not scene.chooses("samples")


def test_a_static_balance_requires_constant_loads_and_a_suitable_method(tmp_path):
    lines = message(tmp_path, "harmonics = 3", "harmonics = 0").splitlines()
    assert lines[0] == "2 mistakes"
    assert (
        "[[loads]] 1 harmonic = 1: [solver] harmonics = 0 is a static balance, in which nothing vibrates; state at least 1"
        in lines[1]
    )
    assert '[solver] method = "adaptive-energy": with harmonics = 0 no pair dissipates' in lines[2]
    constant = GOOD.replace("harmonic = 1", "harmonic = 0").replace("harmonics = 3", "harmonics = 0")
    assert GOOD.count("modes = 20") == 1
    for method, text in {
        "rubin": 'modes is missing: with harmonics = 0 the modes of method = "rubin" carry the load',
        "craig-bampton": "modes is missing",
    }.items():
        changed = constant.replace('"adaptive-energy"', f'"{method}"').replace("modes = 20", "")
        assert text in message(tmp_path, GOOD, changed)


def test_several_mistakes_are_in_one_message(tmp_path):
    lines = message(tmp_path, GOOD[GOOD.index("[damping]") :], '[[loads]]\nnod = 3\n[damping]\nrato = "1e-3"\n').splitlines()
    assert lines[0] == "3 mistakes"
    assert [line.strip().split(": ")[0] for line in lines[1:]] == ["[[loads]] 2 nod", "[damping] rato", "[response] is missing"]


@pytest.mark.parametrize("table", Table.__subclasses__())
def test_every_key_has_a_description(table):
    assert all(field.description for field in table.model_fields.values())
