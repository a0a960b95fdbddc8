"""microslip.search: from a scene to several solutions, files and messages; on any number of ranks."""

import csv

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import scenes

import microslip
from microslip.continuation.other_solutions import continued, curve_through, solutions_at
from microslip.library.prepare import prepare
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.points.multipliers import is_stable
from microslip.studies.search import story

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD


@pytest.fixture
def scene(shared_path):
    """Return what writes a scene of a mass before a stop and reads it.  Collective."""

    def write(**changes):
        system = scenes.gap_mass() | changes
        for load in system["loads"]:
            load.setdefault("phase", 0.0)
        solver = {"harmonics": 3, "samples": 64, "points": 12}
        return microslip.read(on_root(COMM, lambda: write_matrix_scene(shared_path, system, (0.2,), (1.05, 1.4), **solver)))

    return write


def test_three_solutions_of_which_one_is_unstable(scene):
    structure = microslip.build(scene(), COMM)
    found = microslip.search(structure, 1.25 / (2.0 * np.pi), starts=2)
    assert sorted(one.stable for one in found.solutions) == [False, True, True]
    sizes = [float(one.amplitude[0]) for one in found.solutions]
    assert sizes == sorted(sizes) and all(one.residual < 1e-8 for one in found.solutions)
    structure.close()


def test_one_solution_and_the_files(scene, shared_path):
    story.study(scene(), COMM, shared_path / "out", story.Request(1.06 / (2.0 * np.pi), starts=2, follow=True))
    if COMM.rank == 0:
        with open(shared_path / "out" / "search.csv") as file:
            (row,) = csv.DictReader(file)
        assert row["stable"] == "1" and row["found"] == "curve"
        assert (shared_path / "out" / "search.png").exists() and not (shared_path / "out" / "curves.csv").exists()


def test_a_frequency_outside_the_range(scene):
    structure = microslip.build(scene(), COMM)
    with pytest.raises(CaseError, match=r"search: --at = 3 Hz lies outside .* choose one there"):
        microslip.search(structure, 3.0)
    structure.close()


def test_the_curve_through_a_solution_is_followed_both_ways(scene):
    """From the unstable solution between two folds each way passes a fold and comes back to the frequency at another solution."""
    structure, omega = microslip.build(scene(), COMM), 1.25
    of = prepare(structure, has_bars=False).response
    found = solutions_at(of, curve_through(of, 0.2, omega), omega, starts=1, seed=1, has_stability=True)
    (unstable,) = [one for one in found if not is_stable(one.point.multipliers)]
    branch = continued(of, 0.2, unstable, has_stability=False)
    there = [point.response[0, 1:3] for point in branch.points if abs(point.omega - omega) < 1e-9]
    for one in found:
        assert min(np.linalg.norm(one.point.response[0, 1:3] - motion) for motion in there) < 1e-6
    assert {point.segment for point in branch.points} == {0, 1}
    structure.close()
