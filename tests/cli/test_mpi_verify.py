"""`microslip verify`, from the scene to table and picture, on any number of ranks."""

import csv

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.__main__ import main
from microslip.messages.errors import ConvergenceError
from microslip.parallel.agree import on_root
from microslip.studies.verify import command as verify
from microslip.transient.march import March

pytestmark = pytest.mark.ranks(1, 2)


@pytest.fixture
def program(comm, shared_path, program):
    """Return a function of the arguments after the scene's that returns status and messages of all ranks.  Collective."""

    def run(*arguments, system=scenes.chain, levels=(0.5, 20.0), frequencies=(390.0, 590.0), **own):
        own = own or {"points": 24, "harmonics": 5, "samples": 64}
        path = on_root(
            comm,
            lambda: write_matrix_scene(
                shared_path,
                system(),
                levels,
                frequencies,
                outputs=[len(system()["M"]) - 3 if len(system()["M"]) > 3 else 0],
                **own,
            ),
        )
        return program("verify", path, "--out", shared_path / "out", "--steps", "64", *arguments)

    return run


def rows(folder):
    with open(folder / "out" / "verify.csv", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.ranks(2, 3)
@pytest.mark.pictures
def test_two_pairs_on_any_number_of_ranks(program, shared_path):
    """With two pairs, one of three ranks has none."""
    status, out, err = program()
    assert (status, err) == (0, "")
    table = rows(shared_path)
    assert [float(row["level_N"]) for row in table] == [0.5] * 5 + [20.0] * 5
    assert [row["peak"] for row in table].count("peak") == 2
    assert all(float(row["difference_with_phase"]) < 2e-3 for row in table[:5])  # nothing slips
    for row in table[5:]:
        assert float(row["difference_with_phase"]) < 4e-3 + 2.0 * float(row["own_error"])
        assert float(row["distance"]) <= verify.TOLERANCE and float(row["change"]) <= 10.0 * verify.TOLERANCE
        assert abs(float(row["energy_closure"])) < 1e-2 and float(row["higher_harmonics"]) > 1e-4
        assert float(row["harmonic_balance_m"]) - float(row["time_integration_m"]) == pytest.approx(
            float(row["difference"]) * max(float(one["harmonic_balance_m"]) for one in table[5:]), rel=1e-5, abs=1e-12
        )
    assert {"verify.png", "verify.log", "verify.csv"} <= {path.name for path in (shared_path / "out").iterdir()}
    assert out.count("time integration's own error is about") == 1 and "largest difference" in out


@pytest.mark.ranks(1)
def test_curves_of_a_scene_with_accuracy_have_the_requested_accuracy(program, shared_path):
    """Harmonics, samples and points follow from the error bars, in verify as in run."""
    difference = {}
    for accuracy in (0.1, 1e-2):
        status, out, err = program("--levels", "20", "--at", "66,68", "--steps", "64", points=16, accuracy=accuracy)
        assert (status, err) == (0, "") and f"accuracy {accuracy:g}" in out
        table = rows(shared_path)
        assert [float(row["frequency_Hz"]) for row in table] == pytest.approx([66.0, 68.0])
        difference[accuracy] = max(float(row["difference_with_phase"]) for row in table)
        assert difference[accuracy] < accuracy + 2.0 * max(float(row["own_error"]) for row in table)
    assert difference[1e-2] < difference[0.1]


@pytest.mark.ranks(1)
def test_harmonics_and_frequencies_can_be_requested(program, shared_path):
    status, _, _ = program("--at", "66", "--levels", "20", "--harmonics", "1", "--samples", "64")
    assert status == 0
    few = rows(shared_path)
    assert [float(row["frequency_Hz"]) for row in few] == pytest.approx([66.0])
    assert [row["peak"] for row in few] == [""]  # a point of the flank
    program("--at", "66", "--levels", "20", "--harmonics", "5", "--samples", "64")
    many = rows(shared_path)
    for of_few, of_many in zip(few, many):
        assert float(of_many["time_integration_m"]) == pytest.approx(float(of_few["time_integration_m"]), rel=2e-3)
    assert max(float(row["difference_with_phase"]) for row in many) < 0.5 * max(
        float(row["difference_with_phase"]) for row in few
    )


def test_options_that_contradict_the_scene_are_rejected_with_one_message(program):
    for arguments, message in (
        (("--at", "3"), "/scene.toml: [response]: at holds 3 Hz, outside frequencies = [62.0704, 93.9014]; choose one there"),
        (
            ("--harmonics", "5", "--samples", "10"),
            "/scene.toml: [solver]: samples = 10 do not resolve harmonics = 5; at least 11 are needed",
        ),
    ):
        status, _, err = program(*arguments)
        options = " ".join(argument for argument in arguments if argument.startswith("--"))
        assert status == 2 and err.count(message) == 1 and f"error: {options}: " in err


@pytest.mark.ranks(1)
@pytest.mark.pictures
def test_a_point_without_steady_state_is_reported_and_the_others_are_written(program, shared_path, monkeypatch):
    monkeypatch.setattr(verify, "MOST_PERIODS", 1)
    monkeypatch.setattr(verify, "ACCEPTED", 1e-9)
    status, _, err = program("--levels", "20")
    assert status == 3 and err.count("20 N, ") == 5 and "no steady state after 2 periods" in err
    assert len(rows(shared_path)) == 5 and (shared_path / "out" / "verify.png").exists()


@pytest.mark.ranks(1)
def test_time_integration_from_rest_has_the_same_steady_state(program, shared_path):
    """One mass on a Jenkins element that slips in every cycle."""
    of_jenkins = {"system": scenes.jenkins_mass, "levels": (0.8,), "frequencies": (1.1, 1.4)}
    values = []
    for arguments in ((), ("--from-rest",)):
        system = {**scenes.jenkins_mass(), "C": np.array([[0.1]])}
        status, _, _ = program(*arguments, "--at", "0.2", **{**of_jenkins, "system": lambda system=system: system})
        assert status == 0
        values += rows(shared_path)
    assert float(values[1]["time_integration_m"]) == pytest.approx(float(values[0]["time_integration_m"]), rel=1e-4)
    assert int(values[1]["periods"]) > int(values[0]["periods"])


@pytest.mark.study
@pytest.mark.pictures
@pytest.mark.ranks(1)  # one pair: a second rank would only wait
def test_growth_of_small_disturbances_agrees_with_the_multipliers(program, shared_path):
    """A mass with a stop between its two folds: two stable states and an unstable one, the middle one."""
    mass = {"system": scenes.gap_mass, "levels": (0.2,), "frequencies": (1.05, 1.4), "points": 12, "harmonics": 9, "samples": 256}
    status, out, _ = program("--disturbed", "--at", f"{1.25 / (2.0 * np.pi)!r}", "--steps", "256", **mass)
    assert status == 0 and "agree with the Floquet multipliers at 3 of 3 points" in out
    table = rows(shared_path)
    multipliers, factors = ([float(row[name]) for row in table] for name in ("largest_multiplier", "growth"))
    assert sorted(factor > 1.0 for factor in factors) == [False, False, True]
    assert factors == pytest.approx(multipliers, rel=0.04) and max(factors) == pytest.approx(max(multipliers), rel=0.02)


@pytest.mark.ranks(1)
def test_a_structure_without_contact_is_run_and_verified(comm, shared_path, capfd):
    def write():
        for name, matrix in (("K", [[2e4, -1e4], [-1e4, 1e4]]), ("M", np.eye(2))):
            scipy.io.mmwrite(shared_path / f"{name}.mtx", sp.csr_matrix(np.array(matrix)))
        path = shared_path / "free.toml"
        path.write_text(
            '[model]\nstiffness = "K.mtx"\nmass = "M.mtx"\n[[loads]]\ndof = 1\nscale = 1.0\n[[outputs]]\nname = "a"\ndof = 0\n'
            "[damping]\nratio = 0.01\n[response]\nlevels = [1.0]\nfrequencies = [5.0, 15.0]\npoints = 30\n"
        )
        return path

    path = on_root(comm, write)
    assert main(["run", str(path), "--out", str(shared_path / "run")]) == 0
    assert main(["verify", str(path), "--steps", "64", "--out", str(shared_path / "out")]) == 0
    capfd.readouterr()
    assert all(float(row["difference_with_phase"]) < 1e-5 for row in rows(shared_path)) and len(rows(shared_path)) == 5


@pytest.mark.ranks(2)
def test_a_step_without_solution_fails_only_its_point(program, shared_path, monkeypatch):
    """Where the batch fails, points are marched one by one."""
    period = March.period

    def stops(march, *arguments):
        if np.any(np.abs(march.omega - 66.0 * 2.0 * np.pi) < 1e-3):
            raise ConvergenceError("contact forces of a time step not found")
        return period(march, *arguments)

    monkeypatch.setattr(March, "period", stops)
    status, _, err = program("--at", "66,68", "--levels", "20")
    assert status == 3 and err.count("20 N, 66 Hz: contact forces of a time step not found") == 1
    assert [bool(row["failure"]) for row in rows(shared_path)] == [True, False]
