"""The same scene on one rank, on all ranks and in groups of ranks: the same curves, by every method (docs/reliability.md)."""

import numpy as np
import pytest
from bar_scene import write_bar
from mpi4py import MPI

import microslip
from microslip.contact.law import SLIP
from microslip.parallel.agree import on_root
from microslip.reduction.methods import METHODS
from microslip.scene.read import changed
from microslip.studies.diff.command import Difference, compared
from microslip.studies.diff.report import text_of

pytestmark = pytest.mark.ranks(2, 3)

TOLERANCE = 1e-9  # relative to the peak, with a residual of 1e-10; differences are 1e-12
OF_MODES = 1e-10  # relative to a natural frequency
AT = (4610.0, 4650.0, 4720.0)  # Hz: points of every curve at which pairs slip
ON_TWO = ("receptance", "adaptive", "full", "rubin")  # test_mpi_methods.py compares all of them with full on one and two ranks


@pytest.fixture(scope="module")
def structures(comm, tmp_path_factory):
    """Return the bar with one joint, on this rank and on all ranks."""
    folder = comm.bcast(tmp_path_factory.mktemp("reproducible"))
    path = on_root(comm, lambda: write_bar(folder, modes=12, harmonics=3, samples=64, tolerance=1e-10))
    scene = changed(microslip.read(path), {"response": {"levels": (38.0,), "points": 5, "at": AT}})
    with microslip.build(scene, MPI.COMM_SELF) as on_one, microslip.build(scene, comm) as on_all:
        yield on_one, on_all


def assert_same(comm, computed: Difference) -> None:
    """Check on every rank, whose result is that of all ranks.

    Rounding may decide whether a step is repeated: then the other points have other positions on the same curve.
    """
    differences = text_of(computed)
    assert not any(computed.only) and all(level.is_whole for level in computed.levels), differences
    assert (
        computed.structure.same_pairs
        and computed.structure.modes < OF_MODES
        and computed.structure.n_modes[0] == computed.structure.n_modes[1]
    )
    for level in computed.levels:
        has_same_points = level.n_points[0] == level.n_points[1]
        largest = level.difference if has_same_points else level.beyond
        assert all(comm.allgather(bool(largest <= TOLERANCE))) and min(level.n_points) > 4 and level.slip[0] == level.slip[1], (
            differences
        )
        assert level.friction[1] == pytest.approx(level.friction[0], rel=1e-5), differences
        assert_same_at(*computed.of_level(level))


def assert_same_at(a, b) -> None:
    """Check two curves at their common points."""
    (at_a, at_b), peak = (level.response[np.flatnonzero(level.requested), 0] for level in (a, b)), np.abs(a.response[:, 0]).max()
    assert len(at_a) == len(at_b) == len(AT)
    assert np.abs(at_b - at_a).max() <= TOLERANCE * peak


@pytest.mark.parametrize("method", [one if one in ON_TWO else pytest.param(one, marks=pytest.mark.ranks(3)) for one in METHODS])
def test_one_rank_and_several_give_the_same_curves(comm, structures, method):
    on_one, on_all = (microslip.respond(structure, method=method, error_bars=False) for structure in structures)
    comparison = compared(on_one.results, on_all.results, TOLERANCE)
    assert_same(comm, comparison)
    assert any((level.state == SLIP).any() for level in on_all.results.levels), "nothing slips"
    assert comparison.keys == []


def test_groups_of_ranks_give_the_same_curves(comm, structures):
    without_groups, in_groups = (
        microslip.respond(structures[1], levels=(30.0, 38.0), error_bars=False, n_groups=n) for n in (1, 2)
    )
    assert_same(comm, compared(without_groups.results, in_groups.results, TOLERANCE))
