"""microslip.search: from a scene to several solutions, files and messages; on any number of ranks."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from discs import write_sector
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import scenes
from oracles.time_integration import steady_state

import microslip
from microslip.continuation import point_record
from microslip.continuation.other_solutions import continued, curve_through, solutions_at
from microslip.library.prepare import prepare
from microslip.library.search import FollowedCurve
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.points.multipliers import is_stable
from microslip.studies.search import command
from microslip.studies.search.report import returns

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD


@pytest.fixture
def scene(shared_path):
    """Return a function that writes a scene of a mass with a stop and reads it.  Collective."""

    def write(accuracy=None, **changes):
        system = scenes.gap_mass() | changes
        solver = {"samples": 64, "points": 12} | ({"harmonics": 3} if accuracy is None else {"accuracy": accuracy})
        return microslip.read(on_root(COMM, lambda: write_matrix_scene(shared_path, system, (0.2,), (1.05, 1.4), **solver)))

    return write


@pytest.mark.ranks(1)
def test_three_solutions_of_which_one_is_unstable(scene):
    structure = microslip.build(scene(), COMM)
    solutions = microslip.search(structure, 1.25 / (2.0 * np.pi), starts=2)
    assert sorted(each.stable for each in solutions.solutions) == [False, True, True]
    sizes = [float(each.amplitude[0]) for each in solutions.solutions]
    assert sizes == sorted(sizes) and all(each.residual < 1e-8 for each in solutions.solutions)
    assert solutions.curve.multipliers is not None and len(solutions.curve.multipliers) == len(solutions.curve.frequency)
    stable = np.array([is_stable(multipliers) for multipliers in solutions.curve.multipliers])
    way = np.diff(solutions.curve.frequency)[1:-1]  # the frequency falls between the folds
    np.testing.assert_array_equal(stable[1:-2][way < 0.0][1:-1], False)
    assert stable[0] and stable[-1] and np.count_nonzero(~stable) > 2
    structure.close()


@pytest.mark.ranks(1)
def test_stability_that_changes_with_more_harmonics_is_noted(scene, monkeypatch):
    """The motion with more harmonics comes from the error bars."""
    highest = []

    def multipliers_at(equation, at, U):
        highest.append(equation.harmonics.highest)
        largest = 1.2 if highest[-1] > min(highest) else 0.99
        return SimpleNamespace(largest=largest, is_doubtful=True, values=np.full(6, largest + 0j), n_neutral=0)

    monkeypatch.setattr(point_record, "multipliers_at", multipliers_at)
    with microslip.build(scene(accuracy=0.05), COMM) as structure:
        (solution,) = microslip.search(structure, 1.06 / (2.0 * np.pi), starts=1).solutions
    assert point_record.DOUBTFUL in solution.notes


def test_files_of_a_single_solution(scene, shared_path):
    if COMM.rank == 0:
        (shared_path / "out").mkdir()
        (shared_path / "out" / "curves.csv").touch()  # file of an earlier search
    command.study(scene(), COMM, shared_path / "out", command.Request(1.06 / (2.0 * np.pi), starts=2, follow=True))
    if COMM.rank == 0:
        with open(shared_path / "out" / "search.csv") as file:
            (row,) = csv.DictReader(file)
        assert row["stable"] == "1" and row["found"] == "curve"
        assert (shared_path / "out" / "search.png").exists() and not (shared_path / "out" / "curves.csv").exists()


END = """[damping]
ratio = 0.01
[response]
levels = [20.0]
frequencies = [1710.0, 1725.0]
at = [1715.0]
points = 4
[solver]
modes = {modes}
harmonics = 1
error_bars = false
samples = 64
"""


@pytest.mark.ranks(1)
def test_solutions_of_a_whole_disc_include_the_wave_of_one_sector(shared_path):
    """For all outputs; a single sector is rejected, because other solutions need not be waves."""
    how = {"friction": 0.05, "name": "one", "wave": {"engine_order": 1}}
    each = on_root(COMM, lambda: write_sector(shared_path, 3, END.format(modes=12), **how))
    how |= {"name": "whole", "wave": {"engine_order": 1, "whole": True}}
    whole = on_root(COMM, lambda: write_sector(shared_path, 3, END.format(modes=12), **how))
    with microslip.build(microslip.read(each), COMM) as of_one, microslip.build(microslip.read(whole), COMM) as of_all:
        with pytest.raises(CaseError, match="one sector represents only waves"):
            microslip.search(of_one, 1715.0)
        curve = microslip.respond(of_one).level(20.0)
        i = int(np.argmin(np.abs(curve.frequency - 1715.0)))
        solutions = microslip.search(of_all, 1715.0, starts=1)
        (solution,) = solutions.solutions
        assert solutions.outputs == ("tip 0", "tip 1", "tip 2") and len(solutions.units) == 3
        size = np.hypot(*curve.response[i, 0, 1:3])
        assert solution.amplitude == pytest.approx([size] * 3, rel=1e-6)
        assert np.diff(np.unwrap(solution.phase)) == pytest.approx([2.0 * np.pi / 3.0] * 2, abs=1e-6)
        assert solution.slipping == 3 * np.count_nonzero(curve.state[i] == 1) > 0 and solution.stable


def test_a_frequency_outside_the_range_is_rejected(scene):
    structure = microslip.build(scene(), COMM)
    with pytest.raises(CaseError, match=r"search: --at = 3 Hz lies outside .* choose one there, or widen"):
        microslip.search(structure, 3.0)
    structure.close()


@pytest.mark.ranks(1)
def test_the_curve_through_a_solution_is_followed_both_ways(scene):
    """In both directions from the unstable solution the curve passes a fold and returns to the frequency at another solution."""
    structure, omega = microslip.build(scene(), COMM), 1.25
    of = prepare(structure, has_bars=False).response
    computed = solutions_at(of, curve_through(of, 0.2, omega), omega, starts=1, seed=1, has_stability=True)
    (unstable,) = [each for each in computed if not is_stable(each.point.multipliers)]
    branch = continued(of, 0.2, unstable, has_stability=False)
    there = [point.response[0, 1:3] for point in branch.points if abs(point.omega - omega) < 1e-9]
    for each in computed:
        assert min(np.linalg.norm(each.point.response[0, 1:3] - motion) for motion in there) < 1e-6
    assert {point.segment for point in branch.points} == {0, 1}
    structure.close()


@pytest.mark.ranks(1)
def test_a_direction_that_ends_at_its_start_does_not_return():
    """The first direction has a single point; the second one returns."""
    response = np.arange(4.0).reshape(4, 1, 1)
    curve = FollowedCurve(np.array([0.2, 0.2, 0.3, 0.2]), response, np.array([0, 1, 1, 1]), None, None)
    assert [float(each) for each in returns(curve, 0.2)] == [3.0]


@pytest.mark.pictures
@pytest.mark.ranks(1)
def test_isolated_subharmonic_branches_of_a_mass_with_a_frictional_stop(shared_path, program, monkeypatch):
    """The loads have only harmonic 2, and the curve does not reach the stop; two closed branches strike it once per two periods.

    They are the same motion, shifted by half a period; its stable part is a steady state in time integration, too.
    """
    omega, level = 1.15, 1.2
    system = scenes.gap_mass() | {"loads": [{"vector": [0.4, 0.2, 1.0], "harmonic": 2, "phase": 0.0}]}
    path = write_matrix_scene(shared_path, system, (level,), (1.0, 1.5), harmonics=6, samples=128, points=12)
    out, values = shared_path / "out", []
    monkeypatch.setattr(command, "search", lambda *given, **keys: values.append(microslip.search(*given, **keys)) or values[0])
    status, printed, err = program(
        "search", path, "--at", repr(omega / 2.0 / np.pi), "--starts", "50", "--continue", "--out", out
    )
    assert (status, err) == (0, "")
    with open(out / "search.csv") as file:
        missed, *struck = csv.DictReader(file)
    assert missed["stable"] == "1" and float(missed["2_m"]) < 1e-12 and missed["found"] == "curve"
    assert {each["found"] for each in struck} == {"deflation"}
    unstable, stable = ([each for each in struck if each["stable"] == here] for here in "01")
    assert unstable and stable and len(struck) > 2
    for each in (unstable, stable):
        sizes, phases = ([float(row[name]) for row in each] for name in ("2_m", "2_phase_rad"))
        assert sizes == pytest.approx([sizes[0]] * len(each), rel=1e-6) and sizes[0] > 0.5
        assert [abs(phase - phases[0]) for phase in phases[1:]] == pytest.approx([np.pi] * (len(each) - 1), abs=1e-6)
    assert printed.count("the curve through it is closed and passes") == len(struck) and "ends within" not in printed
    curves = np.genfromtxt(out / "curves.csv", delimiter=",", names=True)
    frequency = curves["frequency_Hz"] * 2.0 * np.pi
    assert 1.0 < frequency.min() < 1.05 and 1.25 < frequency.max() < 1.3  # within the range: the curve does not lead to them
    response = values[0].solutions[-1].response
    n = np.arange(1, 7)
    start = response[:, 0] + response[:, 1::2].sum(axis=1), omega * response[:, 2::2] @ n, np.zeros((1, 2))
    marched = steady_state(system, omega, level, n_steps=256, harmonics=6, tolerance=1e-4, coarse=1, start=start)
    assert np.abs(marched.u_hat - response)[:, :3].max() < 1e-2 * np.abs(response[:, 1:3]).max()
