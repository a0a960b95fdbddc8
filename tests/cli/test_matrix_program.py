"""Scenes given as matrices, as started by a user."""

import csv
from pathlib import Path

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.results.draw import draw_share

JOBS = Path(__file__).parents[2] / "jobs"


@pytest.mark.parametrize(
    "name, messages",
    [
        (
            "jenkins",
            [
                "matrices   1 DOF; entries: stiffness 1, mass 1, damping 1",
                "slider: 1 pair, normal preload 2 N in all",
                "method     receptance: harmonics 0 to 15",
                "modes      all",
            ],
        ),
        (
            "spatial",
            [
                "matrices   3 DOF; entries: stiffness 9, mass 3",
                "load 5     DOF 2, scale -0.1, harmonic 0",
                "output     z: DOF 2",
                "modes      all",
            ],
        ),
    ],
)
def test_matrix_scenes_of_jobs_pass_the_check(program, name, messages):
    status, out, err = program("check", JOBS / f"{name}.toml")
    assert (status, err) == (0, "")
    assert all(text in out for text in messages)


def test_a_run_with_matrices_writes_curves_and_pictures_but_no_fields(tmp_path, program, monkeypatch):
    monkeypatch.setattr("microslip.results.draw.draw_share", draw_share)
    write_matrix_scene(tmp_path, scenes.spatial_mass(), [0.02, 0.1], (1.0, 1.6), outputs=[0, 2], points=6)
    status, _, err = program("run", tmp_path / "scene.toml", "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    written = {path.name for path in (tmp_path / "out").iterdir() if path.is_file()}
    assert written == {
        "frf.csv",
        "results.h5",
        "run.log",
        "response.png",
        "states.png",
        "slip_map.png",
        "rom_size.png",
        "energy.png",
        "energy_map.png",
        "error.png",
    }
    rows = (tmp_path / "out" / "frf.csv").read_text().splitlines()
    assert len(rows) > 2 * 2 * 6 // 2 and not any("nan" in row for row in rows)


def test_statics_run_from_scene_to_pictures(tmp_path, program):
    system = scenes.spatial_mass()
    system["loads"] = [{**load, "harmonic": 0, "phase": 0.0} for load in system["loads"]]
    write_matrix_scene(tmp_path, system, [0.02, 4.0], (1.0, 1.6), outputs=[0, 2], points=4, harmonics=0)
    status, _, err = program("run", tmp_path / "scene.toml", "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    with open(tmp_path / "out" / "frf.csv", newline="", encoding="utf-8") as table:
        rows = list(csv.DictReader(table))
    log = (tmp_path / "out" / "run.log").read_text()
    u_lin = np.linalg.solve(scenes.stuck_stiffness(system), sum(np.asarray(load["vector"]) for load in system["loads"]))
    for level in (0.02, 4.0):
        of_level = [row for row in rows if float(row["level_N"]) == level and row["output"] == "0"]
        assert [row["amplitude_m"] for row in of_level] == ["0"], "one point stands for all frequencies"
        mean = float(of_level[0]["mean_m"])
        stays = mean == pytest.approx(level * u_lin[0], rel=1e-8)
        assert stays == (of_level[0]["sticking"] == "1") == (level == 0.02)
        messages = log[log.index(f": {level:g} N, ") :]
        messages = messages[: messages.index("m/N")]
        assert f"{mean:.5e}" in messages and f"displacement {mean:.4e} m" in messages and "1 point in " in messages
        assert "mean_m" in messages and "amplitude_m" not in messages
    assert "further points of [response]: harmonics = 0, constant loads have the same response at every frequency" in log
    assert "error bars: they estimate harmonic 1, and harmonics = 0" in log
    assert program("plot", tmp_path / "out" / "results.h5")[0] == 0
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"response.png", "states.png", "slip_map.png"}
