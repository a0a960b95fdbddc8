"""`microslip compare`, from the scene to the table, on any number of ranks."""

import csv

import numpy as np
import pytest
from bar_scene import write_bar
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.parallel.agree import on_root
from microslip.reduction.methods import METHODS, full
from microslip.studies.compare import command as compare

pytestmark = pytest.mark.ranks(1, 2)


@pytest.fixture
def program(comm, shared_path, program):
    """Return a function of the arguments after the scene's that returns status and messages of all ranks.  Collective."""

    def run(*arguments, write=lambda folder: write_bar(folder, modes=30)):
        path = on_root(comm, write, shared_path)
        return program("compare", path, "--out", shared_path / "out", *arguments)

    return run


def rows(folder):
    with open(folder / "out" / "compare.csv", newline="") as file:
        return {entry["method"]: entry for entry in csv.DictReader(file)}


@pytest.mark.ranks(2, 3)
@pytest.mark.pictures
def test_all_methods_in_one_command(program, shared_path):
    status, out, err = program()
    assert (status, err) == (0, "")
    table = rows(shared_path)
    assert set(table) == set(METHODS) and next(iter(table)) == "full"
    assert len({entry["points"] for entry in table.values()}) == 1
    assert float(table["full"]["difference_percent"]) == 0.0
    for method in ("receptance", "rubin", "craig-bampton"):
        assert float(table[method]["difference_percent"]) < 0.1
    assert (shared_path / "out" / "compare.png").exists() and "differences from full" in out


@pytest.mark.ranks(1)
def test_receptance_is_the_reference_where_full_exceeds_the_memory(program, shared_path, monkeypatch):
    monkeypatch.setattr(compare, "LARGEST_REFERENCE", 100)
    status, _, _ = program("--methods", "adaptive")
    assert status == 0
    assert list(rows(shared_path)) == ["receptance", "adaptive"]
    monkeypatch.setattr(full, "memory_left", lambda comm: 1e5)
    status, _, err = program("--methods", "full,adaptive")
    assert status == 2 and '[solver] method = "full" needs about' in err


@pytest.mark.ranks(1, 2)
def test_too_few_modes_for_one_method_are_rejected_before_any_run(program):
    status, out, err = program("--methods", "receptance,rubin", write=lambda folder: write_bar(folder, modes=4))
    assert status == 2 and "[solver] modes = 4: without their joint the bodies have 6 rigid-body modes" in err
    assert "\nfactor of the stuck structure" in out and "\nreduction" not in out and "\nresponse" not in out


def test_an_unknown_method_is_named_once(program):
    status, _, err = program("--methods", "rubin,adaptiv")
    assert status == 2
    assert err.count("--methods: unknown method 'adaptiv'; nearest is adaptive; known: receptance, ") == 1


@pytest.mark.ranks(1)
def test_displacements_of_statics_are_compared(program, shared_path):
    system = scenes.spatial_mass()
    system["loads"] = [{**load, "harmonic": 0, "phase": 0.0} for load in system["loads"]]

    def still(folder):
        return write_matrix_scene(folder, system, [0.02], (1.0, 1.6), points=4, harmonics=0)

    status, out, err = program(write=still)
    assert (status, err) == (0, "") and "adaptive-energy is left out: " in out and "adaptive-energy" not in rows(shared_path)
    status, _, err = program("--methods", "adaptive-energy", write=still)
    assert status == 2 and "with harmonics = 0 no pair dissipates" in err
    status, _, err = program("--methods", "receptance", write=still)
    assert (status, err) == (0, "")
    u_lin = np.linalg.solve(scenes.stuck_stiffness(system), sum(np.asarray(load["vector"]) for load in system["loads"]))
    for entry in rows(shared_path).values():
        assert float(entry["peak_m"]) == pytest.approx(0.02 * u_lin[0], rel=1e-6) and float(entry["peak_m"]) != 0.0
