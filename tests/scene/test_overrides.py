"""Keys of a scene that the command line sets: they have the effect of the file, and every mistake gives one message."""

import pytest
from scene_files import write_scene

from microslip.messages.errors import CaseError
from microslip.scene.overrides import overridden
from microslip.scene.read import read_scene


def message_of(folder, *settings):
    """Return the message for the scene with these keys, without the name of the file."""
    path = write_scene(folder)
    with pytest.raises(CaseError) as caught:
        read_scene(path, settings)
    return str(caught.value).removeprefix(f"{path} ")


def test_only_the_set_keys_change(tmp_path):
    path = write_scene(tmp_path)
    settings = (
        "joints.dovetail.friction=0.2",
        "response.levels=[5.0, 10.0]",
        "solver.method=receptance",
        "loads.1.phase = 0.5",
        'title="Fan, 0.2"',
        "materials.titanium.poisson=0.3",
        "solver.between_samples=return-map",
    )
    plain, scene = read_scene(path), read_scene(path, settings)
    assert (scene.joints[0].friction, scene.response.levels, scene.solver.method) == (0.2, (5.0, 10.0), "receptance")
    assert (scene.loads[0].phase, scene.title, scene.materials["titanium"].poisson) == (0.5, "Fan, 0.2", 0.3)
    assert scene.solver.between_samples == "return-map"
    back = (
        "joints.dovetail.friction=0.3",
        "response.levels=[1.0, 3.0, 5.0, 8.0]",
        "solver.method=adaptive-energy",
        "loads.1.phase=0.0",
        f'title="{plain.title}"',
        "materials.titanium.poisson=0.33",
        "solver.between_samples=path",
    )
    restored = read_scene(path, (*settings, *back)).model_dump()
    assert restored == {**plain.model_dump(), "solver": restored["solver"]}


@pytest.mark.parametrize("file", ["fine.msh", "../meshes/fine.msh", "./fine.msh", "../../fine.msh", "/of/all/fine.msh"])
def test_a_path_needs_no_quotes(file):
    assert overridden({}, (f"model.mesh={file}",)) == {"model": {"mesh": file}}


def test_a_missing_table_is_created(tmp_path):
    path = write_scene(tmp_path)
    assert read_scene(path).continuation is None
    assert read_scene(path, ("continuation.ds_min=1e-5",)).continuation.ds_min == 1e-5


def test_source_and_text_of_the_scene_include_the_set_keys(tmp_path):
    path = write_scene(tmp_path)
    scene = read_scene(path, ("joints.dovetail.friction=0.2", "solver.modes=8"))
    assert scene.source == f"{path} --set joints.dovetail.friction=0.2 --set solver.modes=8"
    assert read_scene(path).source == str(path)
    (tmp_path / "written.toml").write_text(scene.text)
    assert read_scene(tmp_path / "written.toml").model_dump() == scene.model_dump()


@pytest.mark.parametrize(
    "setting, message",
    [
        ("=3", "expected KEY=VALUE"),
        ("solver.modes=", "expected KEY=VALUE"),
        ("response.levels=[5.0", "expected KEY=VALUE"),
        ("solver.modes=8\nx=1", "expected KEY=VALUE"),
        ("solver.modes=0.5", "[solver] modes = 0.5: expected"),
        ("loads.2.phase=0.2", 'there is no [[loads]] "2"; there is 1'),
        ("title.length=3", "title is a key, not a table"),
        ("response.levels.1=3.0", "levels is a key, not a table"),
    ],
)
def test_a_mistake_is_reported_with_the_set_key(tmp_path, setting, message):
    text = message_of(tmp_path, setting)
    assert text.startswith(f"--set {setting}: ") and message in text
