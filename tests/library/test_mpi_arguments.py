"""Invalid arguments of the library's functions: each one message with the function and the argument, on every rank."""

import math

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import scenes

import microslip
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root


@pytest.fixture
def structure(comm, shared_path):
    """Return one mass on a Jenkins element."""
    more = {"points": 10, "harmonics": 1, "samples": 64, "tolerance": 1e-9, "error_bars": False}
    path = on_root(comm, lambda: write_matrix_scene(shared_path, scenes.jenkins_mass(), [0.8], (0.5, 2.5), **more))
    with microslip.build(microslip.read(path), comm) as built:
        yield built


@pytest.mark.parametrize("value", [None, "scene.toml", 3])
@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("respond", ()),
        ("backbone", ()),
        ("search", (1.0,)),
        ("peaks", ({"level": (0.1, 1.0)},)),
        ("sweep", ({"level": [1.0]},)),
        ("identify", ("measured.csv", {})),
    ],
)
def test_an_argument_that_is_no_structure_is_rejected(name, more, value):
    with pytest.raises(CaseError, match=rf"{name}: expected a structure, as microslip.build.*, found {type(value).__name__}"):
        getattr(microslip, name)(value, *more)


def test_a_scene_in_place_of_a_structure_and_a_path_in_place_of_a_scene_are_rejected(structure):
    with pytest.raises(CaseError, match="respond: expected a structure, .* found Scene"):
        microslip.respond(structure.scene)
    with pytest.raises(CaseError, match="build: expected a scene, as microslip.read.*, found str"):
        microslip.build("scene.toml")


def test_paths_and_tables_of_another_type_are_rejected():
    for function, message in (
        (microslip.read, "read: expected the path of a scene, found None"),
        (microslip.scene_of, "scene_of: expected the tables of a scene by name, found NoneType"),
        (microslip.read_results, "read_results: expected the path of a result file, found None"),
    ):
        with pytest.raises(CaseError, match=message):
            function(None)


CASES = {
    "mode 0": (lambda s: microslip.backbone(s, 0), "backbone: mode = 0: expected a whole number of at least 1"),
    "mode True": (lambda s: microslip.backbone(s, True), "backbone: mode = True: expected a whole number"),
    "mode of text": (lambda s: microslip.backbone(s, "a"), "backbone: mode = 'a': expected a whole number"),
    "mode 1.5": (lambda s: microslip.backbone(s, 1.5), "backbone: mode = 1.5: expected a whole number"),
    "ends below first slip": (lambda s: microslip.backbone(s, farthest=0.5), "farthest = 0.5: expected a number above 1"),
    "ends nowhere": (lambda s: microslip.backbone(s, farthest=math.nan), "farthest = nan: expected a number above 1"),
    "frequency of text": (lambda s: microslip.search(s, "x"), "search: at = 'x': expected a number above 0"),
    "level of text": (lambda s: microslip.search(s, 1.0, level="x"), "search: level = 'x': expected a number above 0"),
    "no starts": (lambda s: microslip.search(s, 1.0, starts=0), "search: starts = 0: expected a whole number of at least 1"),
    "half a start": (lambda s: microslip.search(s, 1.0, starts=1.5), "search: starts = 1.5: expected a whole number"),
    "negative seed": (lambda s: microslip.search(s, 1.0, seed=-1), "search: seed = -1: expected a whole number of at least 0"),
    "no number": (lambda s: microslip.peaks(s, {}), "peaks: over = {}: expected a mapping of keys to two ends"),
    "range of text": (lambda s: microslip.peaks(s, {"level": (0.1, "x")}), "expected a mapping of keys to two ends"),
    "values of text": (
        lambda s: microslip.peaks(s, {"level": (0.1, 1.0)}, values="x"),
        "values = 'x': expected a list of numbers",
    ),
    "one value": (lambda s: microslip.peaks(s, {"level": (0.1, 1.0)}, values=0.3), "values = 0.3: expected a list of numbers"),
    "level not a number": (lambda s: microslip.peaks(s, {"level": (0.1, 1.0)}, level=math.nan), "level = nan: expected a number"),
    "sweep of a list": (
        lambda s: microslip.sweep(s, [("level", [1.0])]),
        "sweep: values = .*: expected a mapping of keys to lists",
    ),
    "output 3": (lambda s: microslip.sweep(s, {"level": [1.0]}, output=3), "there is no output 3"),
    "friction of text": (
        lambda s: microslip.respond(s, friction={"joint": "x"}),
        "friction of joint 'joint': expected numbers, found 'x'",
    ),
    "values of lists": (
        lambda s: microslip.peaks(s, {"level": (0.1, 1.0)}, values=[0.2, [0.3]]),
        "values = .*: expected a list of numbers",
    ),
    "frequency beyond floats": (lambda s: microslip.search(s, 10**400), "search: at = 10*: expected a number above 0"),
    "no groups": (lambda s: microslip.respond(s, n_groups=0), "respond: n_groups = 0: expected a whole number of at least 1"),
    "complex level": (lambda s: microslip.respond(s, levels=1j), "1j is no value of a scene"),
}


@pytest.mark.parametrize("case", CASES)
def test_an_invalid_argument_is_rejected(structure, case):
    call, message = CASES[case]
    with pytest.raises(CaseError, match=message):
        call(structure)


@pytest.mark.parametrize("level", [0.0, -1.0, math.nan, math.inf, "x", None, [0.1]])
def test_a_mode_is_synthesised_at_levels_above_0_alone(structure, level):
    mode = microslip.backbone(structure, farthest=1.2, quasi_static=False, error_bars=False)
    with pytest.raises(CaseError, match="forced: level = .*: expected a number above 0"):
        mode.forced(level)


def test_a_level_of_text_is_no_level_of_a_response(structure):
    with pytest.raises(CaseError, match="there is no level 'x'; there are 0.8"):
        microslip.respond(structure).level("x")
    with pytest.raises(CaseError, match="there is no level array"):
        microslip.respond(structure).level(np.array([0.8, 0.9]))


def test_numbers_without_axes_and_tables_of_columns_are_valid(structure):
    class Table:
        """The interface of a table of pandas."""

        def items(self):
            return (("level", [0.8]),)

    assert microslip.respond(structure, n_groups=np.array(1)).level(0.8).failure == ""
    assert microslip.backbone(structure, farthest=np.array(1.1), quasi_static=False, error_bars=False).failure is None
    assert len(microslip.sweep(structure, Table(), paired=True).samples) == 1
