"""The list in run.log of quantities that were not computed, as read by a user.  The first test on one and two ranks."""

from itertools import takewhile
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.fourier.harmonics import Harmonics
from microslip.library.result_files import Shapes, notes_on_size
from microslip.observe.not_computed import Extent, changes
from microslip.observe.not_computed import not_computed as not_computed_of
from microslip.parallel.agree import on_root
from microslip.points.error_parts import PARTS, SAFETY
from microslip.results.draw import draw_share
from microslip.results.fields import Motion

pytestmark = pytest.mark.ranks(1)
SCALED = "no pair leaves sticking anywhere on its linear curve: scaled, not solved"


def run(program, scene, *options):
    """Run a scene into the folder `out` next to it.  Collective."""
    status, _, err = program("run", scene, "--out", scene.with_name("out"), *options)
    assert (status, err) == (0, "")


def not_computed(path) -> list[str]:
    lines = path.read_text().splitlines()
    start = lines.index("not computed, and why, or what it would change:") + 1
    return [line.strip() for line in takewhile(lambda line: line.startswith("  "), lines[start:])]


@pytest.mark.ranks(1, 2)
def test_a_sticking_level_is_scaled_and_another_is_solved(comm, shared_path, program):
    def write():
        return write_matrix_scene(shared_path, scenes.spatial_mass(), [0.02, 0.4], (1.0, 1.6), outputs=[0], points=8)

    run(program, on_root(comm, write), "--groups", comm.size)
    log = (shared_path / "out" / "run.log").read_text()
    assert log.count(SCALED) == 1
    assert "level 1 of 2: 0.02 N" in log[: log.index(SCALED)].splitlines()[-2]
    table = np.genfromtxt(shared_path / "out" / "frf.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    low, high = (table[table["level_N"] == level] for level in (0.02, 0.4))
    assert not low["newton"].any() and high["newton"].any()
    omissions = not_computed(shared_path / "out" / "run.log")
    assert "Newton iterations at 0.02 N: no pair leaves sticking, the linear response is scaled" in omissions
    assert "damping matrix: [damping] states the damping of each mode" in omissions
    assert "fields for ParaView: the scene has no mesh" in omissions
    assert not any(line.startswith(("static columns", "error bars", "even harmonics")) for line in omissions)


@pytest.mark.parametrize(("bar", "is_estimate"), [(0.1, True), (30.0, False)])
def test_an_error_bar_above_the_amplitude_is_no_estimate(bar, is_estimate):
    error = np.full((1, len(PARTS)), bar / SAFETY)
    points = [SimpleNamespace(response=np.array([[0.0, 1.0, 0.0]]), error=error)]
    expected = changes([SimpleNamespace(points=points, level=2.0)], "harmonics")
    assert expected.startswith(f"effect by the error bars up to {100.0 * bar:.3g} % of the peak, at 2 N")
    assert ("no estimate" in expected) != is_estimate


@pytest.mark.parametrize("turns", [True, False])
def test_coriolis_forces_of_a_turning_structure_are_left_out_of_the_response(turns):
    extent = Extent("receptance", "", np.ones(2), 2, Harmonics.up_to(1), None, True, True, False, turns=turns)
    assert any(line.startswith("Coriolis forces of the rotation") for line in not_computed_of(extent, [], None)) == turns


def test_without_slip_no_static_column_is_computed(tmp_path, program):
    write_matrix_scene(tmp_path, scenes.spatial_mass(), [0.01, 0.02], (1.0, 1.6), outputs=[0], points=8, accuracy=1e-3)
    run(program, tmp_path / "scene.toml")
    omissions = not_computed(tmp_path / "out" / "run.log")
    assert "static columns of 1 of 1 pair: these pairs were always stuck" in omissions
    assert "Newton iterations at 0.01, 0.02 N: no pair leaves sticking, the linear response is scaled" in omissions


def test_a_scene_without_joint_has_no_contact(tmp_path, program):
    for name, matrix in (("K", [[2e4, -1e4], [-1e4, 1e4]]), ("M", np.eye(2))):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", sp.csr_matrix(np.array(matrix)))
    (tmp_path / "free.toml").write_text(
        '[model]\nstiffness = "K.mtx"\nmass = "M.mtx"\n[[loads]]\ndof = 1\nscale = 1.0\n[[outputs]]\nname = "a"\ndof = 0\n'
        "[damping]\nratio = 0.01\n[response]\nlevels = [1.0]\nfrequencies = [5.0, 15.0]\npoints = 9\n[solver]\nerror_bars = false\n"
    )
    run(program, tmp_path / "free.toml")
    omissions = not_computed(tmp_path / "out" / "run.log")
    assert "contact forces and static columns: the scene has no pair, the response is linear" in omissions
    assert "error bars: off in [solver]" in omissions
    assert not any("Newton" in line for line in omissions)


@pytest.mark.parametrize("direction, begins", [("up", 5.0), ("down", 15.0)])
def test_statics_without_a_joint_have_one_point_per_level(tmp_path, program, monkeypatch, direction, begins):
    monkeypatch.setattr("microslip.results.draw.draw_share", draw_share)
    for name, matrix in (("K", [[2e4, -1e4], [-1e4, 1e4]]), ("M", np.eye(2))):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", sp.csr_matrix(np.array(matrix)))
    (tmp_path / "static.toml").write_text(
        '[model]\nstiffness = "K.mtx"\nmass = "M.mtx"\n[[loads]]\ndof = 1\nscale = 1.0\nharmonic = 0\n[[outputs]]\nname = "a"\ndof = 0\n'
        "[damping]\nratio = 0.01\n[response]\nlevels = [1.0, 2.0]\nfrequencies = [5.0, 15.0]\nat = [7.0]\npoints = 9\n"
        f'direction = "{direction}"\n[solver]\nharmonics = 0\n'
    )
    run(program, tmp_path / "static.toml")
    table = np.genfromtxt(tmp_path / "out" / "frf.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert table["mean_m"] == pytest.approx([1e-4, 2e-4], rel=1e-12) and not table["amplitude_m"].any()
    assert table["frequency_Hz"] == pytest.approx([begins, begins])
    omissions = not_computed(tmp_path / "out" / "run.log")
    assert "further points of [response]: harmonics = 0, constant loads have the same response at every frequency" in omissions
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"response.png"}


@pytest.mark.parametrize("asks", [True, False])
def test_the_effect_of_omitted_harmonics_is_estimated_by_the_error_bars(tmp_path, program, asks):
    write_matrix_scene(
        tmp_path, scenes.chain(), [0.3, 100.0], (500.0, 600.0), outputs=[6], points=8, harmonics=1, error_bars=asks
    )
    run(program, tmp_path / "scene.toml")
    omissions = not_computed(tmp_path / "out" / "run.log")
    line = next(line for line in omissions if line.startswith("solution in harmonics above 1: "))
    table = np.genfromtxt(tmp_path / "out" / "frf.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    high = table[table["level_N"] == 100.0]
    if asks:
        percent = 300.0 * high["error_harmonics_m"].max() / high["amplitude_m"].max()
        assert percent > 0.1, "the scene must lose something by one harmonic"
        assert line.endswith(f"by the error bars up to {percent:.3g} % of the peak, at 100 N")
    else:
        assert line.endswith("the effect is unknown without error bars")
        assert "error bars: off in [solver]" in omissions


def test_harmonics_omitted_from_a_list_are_named(tmp_path, program):
    write_matrix_scene(
        tmp_path, scenes.chain(), [100.0], (500.0, 600.0), outputs=[6], points=8, harmonics=[1, 3], error_bars=False
    )
    run(program, tmp_path / "scene.toml")
    omissions = not_computed(tmp_path / "out" / "run.log")
    assert "solution in harmonics 0, 2 and above 3: the effect is unknown without error bars" in omissions


def test_a_linear_response_has_no_truncated_harmonics(tmp_path, program):
    write_matrix_scene(tmp_path, scenes.chain(), [0.3], (500.0, 600.0), outputs=[6], points=8, harmonics=3)
    run(program, tmp_path / "scene.toml")
    omissions = not_computed(tmp_path / "out" / "run.log")
    assert "solution in harmonics above 3: no load acts in them, and the response is linear" in omissions


@pytest.mark.parametrize(
    "method, own, lost",
    [
        ("adaptive-energy", {"energy_tolerance": 10.0}, "slip and opening of the pairs that method adaptive-energy holds stuck"),
        ("rubin", {}, "response outside the basis of method rubin"),
    ],
)
def test_quantities_omitted_by_a_method_are_listed(tmp_path, program, method, own, lost):
    write_matrix_scene(tmp_path, scenes.chain(), [10.0], (500.0, 600.0), outputs=[6], points=8, method=method, modes=4, **own)
    run(program, tmp_path / "scene.toml")
    line = next(line for line in not_computed(tmp_path / "out" / "run.log") if line.startswith(lost))
    assert "by the error bars up to" in line


@pytest.mark.parametrize(
    "size, expected", [(100.0, []), (10.0, ["up to 3 m at level 2, more than 0.1 of the size of its mesh, 10 m"])]
)
def test_a_motion_as_large_as_the_structure_is_noted(size, expected):
    u = np.zeros((4, 3, 3))  # nodes, directions; mean, cosine and sine
    u[1, :, 1], u[1, 0, 2], u[:, 2, 0] = (2.0, 1.0, 0.0), 2.0, 9.0
    shapes = Shapes(np.zeros((4, 3, 0)), None, {0: Motion(0, u / 10.0), 1: Motion(0, u)})
    prepared = SimpleNamespace(structure=SimpleNamespace(mesh=SimpleNamespace(diagonal=size)))
    notes = notes_on_size(prepared, [SimpleNamespace(level=0.2), SimpleNamespace(level=2.0)], shapes)
    assert len(notes) == len(expected) and all(part in note for note, part in zip(notes, expected))
