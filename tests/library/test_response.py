"""The package in a script: lazy imports, scenes built in Python, arrays with named axes."""

import subprocess
import sys
import tomllib

import numpy as np
import pytest
from bar_scene import write_bar
from lap_scene import SCENE, write_mesh
from scene_files import GOOD, write_scene

import microslip
from microslip.messages.errors import CaseError
from microslip.points.error_parts import total

WITHOUT = """
import sys, microslip
def started():
    return {"mpi4py", "petsc4py", "slepc4py", "numpy"} & set(sys.modules)
assert not started()
scene = microslip.read(sys.argv[1])
assert not started(), started()
assert scene.outputs[0].name == "mid_blade" and "build" in dir(microslip)
microslip.respond
assert {"mpi4py", "petsc4py"} <= started()
"""


@pytest.mark.slow
def test_importing_the_package_starts_nothing(tmp_path):
    subprocess.run([sys.executable, "-c", WITHOUT, write_scene(tmp_path)], check=True, timeout=120)
    with pytest.raises(AttributeError, match="no attribute 'biuld'"):
        microslip.biuld  # noqa: B018


def test_a_scene_built_in_python_equals_that_of_a_file(tmp_path):
    path = write_scene(tmp_path)
    of_file, tables = microslip.read(path), tomllib.loads(GOOD)
    tables["response"]["levels"] = np.array(tables["response"]["levels"])
    of_tables = microslip.scene_of(tables, path)
    assert of_tables.model_dump() == of_file.model_dump() and of_tables.name == "fan"
    assert tomllib.loads(of_tables.text) == tomllib.loads(GOOD)
    with pytest.raises(CaseError, match=r"\[solver\] harmonics = 3.5: expected the highest harmonic"):
        microslip.scene_of({**tables, "solver": {"harmonics": 3.5}}, path)


@pytest.mark.parametrize("title", ['"quotes" and \\', "tab\tand\nline", "\x7f\x01 é 漢", ""])
def test_texts_of_a_scene_are_preserved(tmp_path, title):
    path = write_scene(tmp_path)
    scene = microslip.scene_of({**tomllib.loads(GOOD), "title": title}, path)
    assert tomllib.loads(scene.text)["title"] == title == scene.title


@pytest.fixture(scope="module")
def response(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arrays")
    scene = microslip.read(write_bar(folder, modes=6))
    with microslip.build(scene) as structure:
        yield microslip.respond(structure, levels=[1e-3, 30.0], points=14, harmonics=2)


def test_peaks_of_statics_are_its_means(tmp_path):
    path = write_bar(tmp_path, modes=6, harmonics=0)
    path.write_text(path.read_text().replace("[[outputs]]", "harmonic = 0\n[[outputs]]"))
    with microslip.build(microslip.read(path)) as structure:
        curves = microslip.respond(structure, levels=[1.0, 2.0])["corner"]
    assert np.all(curves.mean[:, 0] != 0.0) and not curves.amplitude.any()
    assert np.array_equal(curves.peaks[1], curves.mean[:, 0])


def test_arrays_have_named_axes_units_and_the_length_of_the_longest_curve(response):
    n = [len(level.frequency) for level in response.results.levels]
    assert n[0] != n[1]  # the first level is linear
    du, frequency = response.array("du"), response.array("frequency")
    assert response.axes("du") == ("level", "point", "pairs", "directions", "coefficients") and response.unit("du") == "m"
    assert du.shape == (2, max(n), 15, 3, 5) and frequency.shape == du.shape[:2]
    assert np.isfinite(frequency).sum(axis=1).tolist() == n == np.isfinite(du[:, :, 0, 0, 0]).sum(axis=1).tolist()
    assert np.array_equal(frequency[1, : n[1]], response.level(30.0).frequency)
    assert repr(response) == f"<Response of bar: 2 levels, {sum(n)} points, outputs corner>"
    assert response.array("state").dtype == np.uint8 and response.levels.tolist() == [1e-3, 30.0] and response.failures == {}
    for ask, message in (
        (lambda: response.array("dv"), "there is no quantity 'dv'; there are frequency, response"),
        (lambda: response.level(2.0), "there is no level 2 N; there are 0.001, 30"),
        (lambda: response["tip"], "there is no output 'tip'; there are corner"),
    ):
        with pytest.raises(CaseError, match=message):
            ask()


def test_curves_are_amplitude_and_phase_of_the_motion(response):
    curves, level = response["corner"], response.level(30.0)
    n = len(level.frequency)
    assert np.array_equal(curves.coefficients[1, :n], level.response[:, 0])
    complex_amplitude = curves.harmonic(1)[1, :n]
    assert curves.amplitude[1, :n] == pytest.approx(np.abs(complex_amplitude))
    t = np.linspace(0.0, 2.0 * np.pi, 7)
    u = level.response[:, 0, 1:2] * np.cos(t) + level.response[:, 0, 2:3] * np.sin(t)
    assert curves.amplitude[1, :n, None] * np.cos(t + curves.phase[1, :n, None]) == pytest.approx(u)
    assert curves.harmonic(0)[1, :n] == pytest.approx(curves.mean[1, :n]) and curves.harmonic(2).shape == curves.amplitude.shape
    assert np.array_equal(curves.error[1, :n], total(level.error[:, 0])) and (curves.error[1, :n] > 0.0).all()


def test_results_convert_to_an_xarray_dataset(response):
    xarray = pytest.importorskip("xarray")
    computed = response.to_xarray()
    assert isinstance(computed, xarray.Dataset) and computed["du"].dims == response.axes("du") and computed["du"].units == "m"
    assert computed.response.sel(level=30.0, outputs="corner").shape == (computed.sizes["point"], 5)
    assert computed.frequency.dims == ("level", "point") and "frequency" in computed.coords
    assert computed.error.sel(parts="harmonics").shape == (2, computed.sizes["point"], 1)


def test_a_missing_xarray_is_reported(response, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(CaseError, match="pip install xarray"):
        response.to_xarray()


def test_constant_loads(tmp_path):
    write_mesh(tmp_path / "lap.msh")
    tables = tomllib.loads(SCENE)
    tables["loads"][0]["harmonic"] = 0
    tables["solver"] |= {"harmonics": 0, "method": "receptance"}
    with microslip.build(microslip.scene_of(tables, tmp_path / "static.toml")) as structure:
        static = microslip.respond(structure, levels=[1.0, 2.0])
        assert static["tip"].frequency.shape == (2, 1) and np.all(static["tip"].mean != 0.0)
        static.plot(tmp_path / "static.png")
