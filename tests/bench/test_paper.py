"""The case study of the paper runs by one command, on a small scene with a mesh and on one without."""

import re
import sys
from itertools import combinations
from pathlib import Path

import lap_scene
import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import scenes

from microslip.contact.law import OPEN
from microslip.results.style import RC

sys.path.append(str(Path(__file__).parents[2] / "jobs" / "paper"))

import case_study
import claims_runs
import claims_tables
import page_tables
import paper_figures
import paper_runs
import paper_tables
from paper_runs import EQUAL
from prepared import prepare

NOT_A_NUMBER = re.compile(r"\b(nan|inf)\b")
FIGURES = {f"paper_fig{n:02d}.png" for n in (6, 7, 8, 9, 11, 12, 13, 14, 15)}
FIGURES |= {f"paper_{name}.png" for name in ("adaptive", "tolerance", "tolerance_error", "step")}


PAGE = Path(__file__).parents[2] / "docs" / "paper.md"


def names(page):
    """Return the names of a page's tables."""
    return [name for _, name, _ in page_tables.MARKED.findall(page)]


def run(monkeypatch, scene, out, *options):
    monkeypatch.setattr("sys.argv", ["case_study.py", str(scene), "--out", str(out), *options])
    case_study.main()
    return (out / "paper.md").read_text(encoding="utf-8")


def test_one_command_draws_all_figures_and_writes_the_page(tmp_path, monkeypatch, capsys):
    lap_scene.write_mesh(tmp_path / "lap.msh")
    scene = lap_scene.SCENE.replace("levels = [1.0]", "levels = [0.1, 0.3]").replace("[10.0, 1000.0]", "[90.0, 102.0]")
    (tmp_path / "scene.toml").write_text(scene)
    text = run(
        monkeypatch, tmp_path / "scene.toml", tmp_path / "out", "--points", "12", "--tolerances", "0", "1e-5", "--steps", "12"
    )
    assert {file.name for file in (tmp_path / "out" / "img").iterdir()} == FIGURES | {"paper_fig04.png"}
    assert not NOT_A_NUMBER.search(text)
    assert names(text) == names(PAGE.read_text(encoding="utf-8"))
    assert "paper.md" in capsys.readouterr().out


def chain_study(folder, levels, tolerances, steps, band=None):
    system = scenes.chain()
    path = write_matrix_scene(folder, system, levels, band or system["omega"], points=12, outputs=[6], harmonics=2, samples=32)
    clock = paper_runs.Clock(lambda line: None)
    return paper_runs.study(prepare(str(path), MPI.COMM_SELF), tolerances, steps, True, clock)


def test_a_scene_of_matrices_needs_no_mesh_and_no_rubin(tmp_path):
    study = chain_study(tmp_path, [1.0, 10.0], [0.0], [12], band=(530.0, 590.0))
    lines = paper_tables.tables(study)
    assert paper_figures.modes(study) is None and study.levels[0].rubin is None
    assert paper_tables.rubin_step(study) == study.lu_seconds(study.rubin_size)  # a lower bound
    assert not NOT_A_NUMBER.search(str(lines))


def test_dropped_pairs_are_counted(tmp_path):
    level = chain_study(tmp_path, [3.0], [0.0, 1e9], []).levels[0]
    all_dropped = level.energy[1e9]
    is_open = np.array([np.count_nonzero(point.state == OPEN) for point in all_dropped.points])
    assert (all_dropped.retained[1:] == is_open[:-1]).all() and all_dropped.dropped.max() > 0 and all_dropped.lost.max() > 0.0
    assert level.reference.dropped.max() == 0 and level.checked.dropped.max() == 0
    assert paper_runs.errors(all_dropped, level.reference).max() > 1e-3
    assert paper_runs.errors(level.checked, level.reference).max() < 1e-6


def test_no_axes_of_a_figure_overlap(tmp_path):
    study = chain_study(tmp_path, [1.0, 10.0], [0.0, 1e-3], [12], band=(530.0, 590.0))
    figures = ("adaptive", "retained", "losses", "tolerance_response", "tolerance_size", "tolerance_summary", "steps")
    for name in figures:
        with matplotlib.rc_context(RC):
            figure = getattr(paper_figures, name)(study).figure
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        boxes = [ax.get_tightbbox(canvas.get_renderer()) for ax in figure.axes]
        assert len(boxes) > 1 and all(0.0 <= box.x0 and box.x1 <= figure.bbox.x1 for box in boxes), name
        for one, other in combinations(boxes, 2):
            assert one.x1 <= other.x0 + 1 or other.x1 <= one.x0 + 1 or one.y1 <= other.y0 + 1 or other.y1 <= one.y0 + 1, name


def test_time_of_a_dense_step_is_interpolated():
    study = paper_runs.Study(None, [], [], 800, {100: 1e-3, 400: 1.6e-2})
    assert study.lu_seconds(np.array([50, 100, 200, 800])) == pytest.approx([1e-3, 1e-3, 4e-3, 0.128])


def test_format_of_numbers_on_the_page():
    shares, ratios, seconds = (0.022, 0.0, 3e-9), (12345.0, 98.0, 1.26), (7200.0, 600.0, 0.25, 0.0012)
    assert list(map(page_tables.percent, shares)) == ["2.2 %", "0 %", "3e-09"]
    assert list(map(page_tables.times, ratios)) == ["12,000x", "98x", "1.3x"]
    assert list(map(page_tables.duration, seconds)) == ["2 h", "10 min", "0.25 s", "1.2 ms"]


def runs_of(folder, level):
    """Return the runs of the chain at a level, without curves in each method's own steps."""
    system = scenes.chain()
    path = write_matrix_scene(folder, system, [level], system["omega"], points=12, outputs=[6], harmonics=2, samples=32)
    return claims_runs.Trials(prepare(str(path), MPI.COMM_SELF), level)


def test_the_tables_of_the_claims_are_those_of_the_page(tmp_path):
    chosen = claims_runs.Setting(12, EQUAL, again=True), claims_runs.Setting(12), claims_runs.Setting(12, slack=0.3)
    prepared = runs_of(tmp_path, 10.0).prepared
    trials, own = claims_runs.all_trials(prepared, [10.0], chosen, (6, 12), lambda line: None)
    claims_tables.draw(trials, prepared.scene).save(str(tmp_path / "claims.png"))
    made = claims_tables.tables(trials, own)
    assert list(made) == names(PAGE.with_name("paper_claims.md").read_text(encoding="utf-8"))
    assert all(setting.name in str(made["once"]) for setting in chosen) and not NOT_A_NUMBER.search(str(made))


def test_repeated_solutions_of_the_original_and_the_improved_method(tmp_path):
    trial = runs_of(tmp_path, 30.0).trial(claims_runs.Setting(30, EQUAL, again=True))
    assert trial.original_again.largest < 1e-6 < 1e-4 < trial.original.largest
    assert trial.improved_again.largest > 1e-4 and trial.better == claims_runs.ORIGINAL


def test_a_threshold_of_dp_drops_smaller_pairs(tmp_path):
    runs = runs_of(tmp_path, 10.0)
    plain, exact, none = (runs.trial(claims_runs.Setting(12, **slack)) for slack in ({}, {"slack": 1e-12}, {"slack": 1e9}))
    assert exact.original.error == pytest.approx(plain.original.error, abs=1e-9) and none.original.largest > 1e-2


def test_a_phase_of_the_load_shifts_the_motion(tmp_path):
    system = scenes.chain()
    path = write_matrix_scene(tmp_path, system, [1e-3], system["omega"], points=12, outputs=[6], harmonics=2, samples=64)
    prepared = prepare(str(path), MPI.COMM_SELF)
    runs = claims_runs.Trials(prepared, 1e-3)
    plain, turned = (
        runs.branch(claims_runs.REFERENCE, claims_runs.Setting(12, EQUAL, start=start)).points[5].response[0]
        for start in (0.0, 90.0)
    )
    # u = a cos(x + phase): 90 degrees further on, cos becomes -sin
    assert turned[1:3] == pytest.approx([plain[2], -plain[1]], abs=1e-9 * np.abs(plain).max())
