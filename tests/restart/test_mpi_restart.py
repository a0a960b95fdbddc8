"""A stopped run continues at its last point: the same curve, without a point computed twice; on any number of ranks."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from bar_scene import write_bar
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import scenes

import microslip.run as whole_run
from microslip.continuation import levels
from microslip.library.follow_response import follow
from microslip.messages.errors import CaseError, ConvergenceError, Interrupted
from microslip.observe.log import RunLog
from microslip.observe.stops import Stops
from microslip.parallel.agree import on_root
from microslip.points.bifurcation import Bifurcation
from microslip.restart import identity
from microslip.restart.branch_files import BranchFiles
from microslip.restart.folder import NAME, Restart
from microslip.restart.records import pack
from microslip.results.read import read_results
from microslip.run import RunOptions, run
from microslip.scene.read import read_scene
from microslip.studies.backbone import command as backbone

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
METHODS = ("receptance", "adaptive-energy", "full", "craig-bampton")
ON_RANKS = ("craig-bampton",)  # those of them that are tried on several ranks, too; receptance there: test_mpi_cache.py


class StopsAfter:
    """An observer that ends the run at a point, as a signal would."""

    def __init__(self, n_points: int):
        self.left = n_points

    def level_started(self, number, level, where):
        pass

    def point(self, number, i, point):
        self.left -= 1
        if self.left < 0:
            raise Interrupted("stopped by a test")

    def level_finished(self, number, branch):
        pass


def scene_at(folder: Path, *settings: str, error_bars=False, **solver):
    path = on_root(COMM, partial(write_bar, folder, error_bars=error_bars, **solver))
    return read_scene(path, ("response.levels=[30.0]", "solver.harmonics=1", "solver.samples=32", *settings))


def followed(scene, folder, observers=(), fresh=False):
    """Return the branches of a scene, followed as by a run."""
    log = RunLog(COMM, screen=False)
    restart = Restart.open(COMM, folder, scene, (), fresh)
    prepared = restart.prepared(log, partial(whole_run.build, scene, COMM, log))
    try:
        return follow(prepared.response, observers, 1, log, restart.checkpointers_of(prepared, log))
    finally:
        prepared.close()


def assert_same(branches, others, bits=COMM.size == 1):
    """Compare branches bit for bit, or to rounding, as MUMPS adds contributions of several ranks in the order of arrival."""
    for one, other in zip(branches, others, strict=True):
        assert len(one.points) == len(other.points) and one.failure == other.failure and one.is_linear == other.is_linear
        for a, b in zip(one.points, other.points):
            peak = max(np.abs(point.response).max() for point in one.points)
            assert np.abs(a.response - b.response).max() <= (0.0 if bits else 1e-8) * peak
            assert a.notes == b.notes and a.requested == b.requested and a.segment == b.segment
            assert np.array_equal(a.error, b.error) or not bits
            if COMM.rank == 0 and bits:
                assert np.array_equal(a.U, b.U) and np.array_equal(a.p, b.p) and np.array_equal(a.state, b.state)


@pytest.mark.slow
@pytest.mark.parametrize("method", [pytest.param(one, marks=() if one in ON_RANKS else pytest.mark.ranks(1)) for one in METHODS])
def test_a_stored_set_up_gives_the_same_response_without_a_build(method, shared_path, built):
    scene = scene_at(shared_path, method=method, error_bars=method == "receptance")
    first = followed(scene, shared_path)
    on_root(COMM, lambda: [path.unlink() for path in (shared_path / NAME).glob("level-*/*")])
    second = followed(scene, shared_path)
    assert built == {"first": 1, "again": 0}
    assert_same(first, second)


@pytest.mark.slow
@pytest.mark.parametrize(
    "n_points, levels",
    [pytest.param(2, "[30.0]", marks=pytest.mark.ranks(2)), pytest.param(17, "[30.0, 50.0]", marks=pytest.mark.ranks(1))],
)
def test_a_run_continues_after_the_last_point_to_the_same_curve(n_points, levels, shared_path, built):
    scene = scene_at(shared_path, f"response.levels={levels}")
    whole = followed(scene, shared_path / "whole")
    assert n_points < sum(len(branch.points) for branch in whole)
    with pytest.raises(Interrupted):
        followed(scene, shared_path / "parts", [StopsAfter(n_points)])
    before = [point.seconds for branch in point_records(shared_path / "parts") for point in branch]
    assert len(before) == n_points + 1  # including the point at which it was stopped, postponed or not
    assert_same(whole, (rest := followed(scene, shared_path / "parts")))
    after = {point.seconds for branch in rest for point in branch.points}
    assert set(before) <= after
    assert built["first"] == 2  # built again if stopped before static columns were known
    assert built["again"] == 0 or n_points <= 2


@pytest.mark.slow
@pytest.mark.parametrize("n_points", [pytest.param(9, marks=pytest.mark.ranks(2)), pytest.param(10, marks=pytest.mark.ranks(1))])
def test_a_killed_run_loses_at_most_one_point_and_continues_to_the_same_curve(n_points, shared_path, monkeypatch):
    monkeypatch.setattr("microslip.restart.branch_files.SHORT", math.inf)  # every second step is postponed
    monkeypatch.setattr("microslip.restart.branch_files.SELDOM", math.inf)
    monkeypatch.setattr(BranchFiles, "flush", lambda kept: None)
    scene = scene_at(shared_path)
    whole = followed(scene, shared_path / "whole")
    with pytest.raises(Interrupted):
        followed(scene, shared_path / "parts", [StopsAfter(n_points)])  # while it notifies observers of the next point
    n_kept = sum(map(len, point_records(shared_path / "parts")))
    assert n_kept == n_points + n_points % 2  # pairs
    assert_same(whole, followed(scene, shared_path / "parts"))


def test_files_with_other_contents_are_rejected_on_all_ranks(shared_path):
    scene = scene_at(shared_path)
    followed(scene, shared_path)
    (end,) = (shared_path / NAME).glob("level-*/end.0")
    on_root(COMM, lambda: end.write_bytes(pack({}, {"of": "another program"})))
    with pytest.raises(CaseError, match="has contents that this program does not write .*'n_points'.* --fresh"):
        followed(scene, shared_path)
    followed(scene, shared_path, fresh=True)


def seconds_of(branch):
    """Return the times of the points on rank 0, which identify a computation of a point."""
    return COMM.bcast([point.seconds for point in branch.points])


def point_records(folder: Path):
    """Return the points in the journals of a folder."""
    from microslip.restart.branch_files import to_point
    from microslip.restart.records import read_records, unpack

    return [[to_point(*unpack(body)) for body in read_records(path)] for path in (folder / NAME).glob("level-*/points.*")]


@pytest.mark.ranks(2, 3)
def test_several_ranks_continue_the_run_of_one(shared_path):
    scene, alone = scene_at(shared_path), COMM.Split(COMM.rank, 0)
    if COMM.rank == 0:
        log = RunLog(alone, screen=False)
        restart = Restart.open(alone, shared_path / "parts", scene)
        prepared = restart.prepared(log, partial(whole_run.build, scene, alone, log))
        with pytest.raises(Interrupted):
            follow(prepared.response, [StopsAfter(7)], 1, log, restart.checkpointers_of(prepared, log))
        prepared.close()
    COMM.barrier()
    alone.Free()
    assert_same(followed(scene, shared_path / "whole"), followed(scene, shared_path / "parts"))


@pytest.mark.slow
def test_static_columns_that_were_not_stored_are_computed(shared_path, built):
    scene = scene_at(shared_path, "response.levels=[10.0]")
    followed(scene, shared_path)
    stronger = scene_at(shared_path, "response.levels=[10.0, 30.0]", "solver.modes=6")
    on_root(COMM, lambda: [path.write_bytes(b"") for path in (shared_path / NAME).glob("setup-*/columns")])
    first = followed(stronger, shared_path)  # other modes, and therefore another set-up
    on_root(COMM, lambda: [path.write_bytes(b"") for path in (shared_path / NAME).glob("setup-*/columns")])
    on_root(COMM, lambda: [path.unlink() for path in (shared_path / NAME).glob("level-*/*")])
    assert_same(first, followed(stronger, shared_path))
    assert built == {"first": 2, "again": 1}


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_more_levels_are_added_to_finished_levels(shared_path, built):
    two, three = (
        scene_at(shared_path, f"response.levels={levels}", "solver.modes=6") for levels in ([30.0, 50.0], [30.0, 40.0, 50.0])
    )
    first, second = followed(two, shared_path), followed(three, shared_path)
    assert built == {"first": 1, "again": 0}
    assert seconds_of(first[1]) == seconds_of(second[2])
    assert_same([first[0], first[1]], [second[0], second[2]])


@pytest.mark.slow
@pytest.mark.ranks(1)
@pytest.mark.parametrize("direction", ["up", "down"])
def test_a_wider_range_continues_a_finished_range(direction, shared_path, built):
    narrow, wide = (
        scene_at(shared_path, f"response.span={span}", f"response.direction='{direction}'", "solver.modes=6")
        for span in ("[0.95, 1.03]", "[0.9, 1.1]")
    )
    first, second = followed(narrow, shared_path), followed(wide, shared_path)
    wide_from_start = followed(wide, shared_path / "from_start")
    for one, two, three in zip(first, second, wide_from_start, strict=True):
        assert set(seconds_of(one)) <= set(seconds_of(two))
        omega = np.array([point.omega for point in two.points])
        assert [omega[0], omega[-1]] == [three.points[0].omega, three.points[-1].omega]
        assert len(set(omega)) == len(omega) > len(one.points)
        assert_on_one_curve(two, three)
    assert built == {"first": 3, "again": 0}  # the range is part of the set-up, which states whether the modes cover it


def assert_on_one_curve(branch, other):
    """Compare the amplitudes of two branches without folds, at frequencies between the points of the second."""
    one, two = (
        sorted((point.omega, float(np.hypot(*point.response[0, 1:3]))) for point in each.points) for each in (branch, other)
    )
    between = np.interp([w for w, _ in one], *np.array(two).T)
    assert np.abs(between - [a for _, a in one]).max() < 0.15 * max(a for _, a in two)  # some ten points each


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Return a folder with the scene and the checkpoints of a finished run; tests only read it."""
    folder = COMM.bcast(tmp_path_factory.mktemp("finished"))
    followed(scene_at(folder), folder)
    return folder


@pytest.mark.slow
@pytest.mark.ranks(1)
@pytest.mark.parametrize(
    ("setting", "setup", "level"),
    [
        ("title='another'", True, True),
        ("solver.tolerance=1e-7", True, False),
        ("response.points=20", True, False),
        ("joints.joint.friction=0.06", False, False),
        ("joints.joint.normal_stiffness=2.1e12", False, False),
        ("materials.steel.young=2e11", False, False),
        ("solver.method='adaptive'", False, False),
    ],
)
def test_changed_settings_are_noted_and_only_dependent_parts_are_computed(setting, setup, level, finished):
    one, two = (Restart.open(COMM, finished, scene_at(finished, *more)) for more in ((), (setting,)))
    assert (one.identity.setup == two.identity.setup) == setup
    assert (one.identity.level(30.0, 6) == two.identity.level(30.0, 6)) == level
    (note,) = two.notes
    key = setting.partition("=")[0].rpartition(".")[2]
    assert key in note and ("is stored here" if setup else "of other inputs") in note


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_a_changed_mesh_is_detected(shared_path):
    scene = scene_at(shared_path)
    followed(scene, shared_path)
    on_root(COMM, lambda: (shared_path / "bar.msh").open("a").write("\n"))
    (note,) = (restart := Restart.open(COMM, shared_path, scene)).notes
    assert "bar.msh: the file has changed" in note
    assert not list((shared_path / NAME).glob(f"setup-{restart.identity.setup}"))


@pytest.mark.ranks(1)
def test_files_of_the_same_name_in_two_folders_are_distinct(shared_path, monkeypatch):
    scene, files = scene_at(shared_path), [shared_path / folder / "nodes.inp" for folder in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        file.write_text("1")
    monkeypatch.setattr(identity, "input_files", lambda scene: tuple(("included by bar.inp", file) for file in files))
    seen = {identity.identity_of(scene).setup}
    for file in files:
        file.write_text("2")
        seen.add(identity.identity_of(scene).setup)
    assert len(seen) == 3


@pytest.mark.ranks(1)
def test_a_wider_range_beyond_the_modes_has_another_set_up(shared_path):
    narrow, wide = (scene_at(shared_path, f"response.span={span}", "solver.modes=3") for span in ("[0.95, 1.03]", "[0.9, 20.0]"))
    assert Restart.open(COMM, shared_path, narrow).identity.setup != Restart.open(COMM, shared_path, wide).identity.setup


# -- a whole run ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_earlier_results_remain_until_the_new_ones_are_complete(shared_path, monkeypatch):
    scene, other = scene_at(shared_path), scene_at(shared_path, "response.points=14")
    folder = shared_path / "out"
    run(scene, COMM, folder, RunOptions(screen=False))
    before = on_root(COMM, (folder / "results.h5").read_bytes)
    with monkeypatch.context() as patched:
        patched.setattr("microslip.run.draw", lambda *_: (_ for _ in ()).throw(Interrupted("stopped by a test")))
        with pytest.raises(Interrupted):
            run(other, COMM, folder, RunOptions(screen=False))
    assert on_root(COMM, (folder / "results.h5").read_bytes) == before
    run(other, COMM, folder, RunOptions(screen=False))
    COMM.barrier()
    assert "points = 14" in read_results(str(folder / "results.h5")).scene_text
    assert not (folder / "unfinished").exists()


@pytest.mark.slow
def test_a_finished_run_is_only_computed_again_with_fresh(shared_path, built):
    scene, folder = scene_at(shared_path), shared_path / "out"
    run(scene, COMM, folder, RunOptions(screen=False))
    once = on_root(COMM, (folder / "results.h5").read_bytes)
    run(scene, COMM, folder, RunOptions(screen=False))
    assert built == {"first": 1, "again": 0} and on_root(COMM, (folder / "results.h5").read_bytes) == once
    run(scene, COMM, folder, RunOptions(screen=False, fresh=True))
    assert built == {"first": 2, "again": 0}
    assert on_root(COMM, (folder / "earlier-1" / "results.h5").read_bytes) == once
    assert on_root(COMM, (folder / "results.h5").is_file)


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_a_deleted_table_is_written_again(shared_path, built):
    scene, folder = scene_at(shared_path), shared_path / "out"
    table = folder / "frf.csv"
    run(scene, COMM, folder, RunOptions(screen=False))
    once = on_root(COMM, table.read_bytes)
    on_root(COMM, table.unlink)
    run(scene, COMM, folder, RunOptions(screen=False))
    assert built["first"] == 1 and on_root(COMM, table.read_bytes) == once


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_fresh_preserves_other_files_of_its_folder(shared_path, built):
    mine = shared_path / "out" / "restart" / "level-of-water"
    on_root(COMM, lambda: mine.mkdir(parents=True))
    for fresh in (False, True):
        run(scene_at(shared_path), COMM, shared_path / "out", RunOptions(screen=False, fresh=fresh))
    assert built == {"first": 2, "again": 0} and on_root(COMM, mine.is_dir)


def test_a_level_that_ended_early_is_reported_but_not_followed_again(shared_path, built, monkeypatch):
    monkeypatch.setattr("microslip.continuation.levels.most_points", lambda points: 5)
    scene, folder, printed = scene_at(shared_path, "response.levels=[30.0, 50.0]"), shared_path / "out", []
    for _ in range(2):
        with pytest.raises(ConvergenceError) as problem:
            run(scene, COMM, folder, RunOptions(screen=False))
        printed.append(str(problem.value))
    assert printed[0] == printed[1] and printed[0].count("ends after 5 points") == 2
    assert built == {"first": 1, "again": 0}


@pytest.mark.ranks(1)
def test_incomplete_results_do_not_replace_complete_ones(shared_path, built, monkeypatch):
    complete, folder = scene_at(shared_path, "response.levels=[30.0]"), shared_path / "out"
    run(complete, COMM, folder, RunOptions(screen=False))
    once = (folder / "results.h5").read_bytes()

    def ends_early(setting):
        printed = []
        for _ in range(2):  # the second time nothing is computed
            with pytest.raises(
                ConvergenceError, match=f"what converged is in {folder}/unfinished; the complete results"
            ) as problem:
                run(scene_at(shared_path, setting), COMM, folder, RunOptions(screen=False))
            printed.append(str(problem.value))
        assert printed[0] == printed[1] and (folder / "results.h5").read_bytes() == once
        (*_, level) = read_results(str(folder / "unfinished" / "results.h5")).levels
        assert level.status == "failed"

    with monkeypatch.context() as patched:
        patched.setattr("microslip.continuation.levels.most_points", lambda points: 5)
        ends_early("response.levels=[30.0, 50.0]")
        ends_early("response.points=14")
        made = dict(built)
        ends_early("response.points=13")
    run(scene_at(shared_path, "response.points=14"), COMM, folder, RunOptions(screen=False))
    assert (folder / "results.h5").read_bytes() != once and not (folder / "unfinished").exists()
    assert built["first"] == made["first"]


def test_peaks_and_bifurcations_of_finished_levels_are_read(shared_path, monkeypatch):
    """Stopped at the second level: peaks and bifurcations of the first level are read, not computed again."""
    mass = scenes.jenkins_mass() | {"C": np.array([[0.02]])}
    of_mass = partial(
        write_matrix_scene, shared_path, mass, [0.4, 0.5], (0.5, 2.0), points=6, harmonics=1, samples=32, error_bars=False
    )
    scene = read_scene(on_root(COMM, of_mass), ("response.peaks=true", "response.stability=true"))
    fold = Bifurcation("fold", 1.2, np.array([0.3]), 1.0 + 0.1j, 1e-9, 5)
    monkeypatch.setattr(levels, "bifurcations_of", lambda problem, branch, tolerance: [fold])
    whole = followed(scene, shared_path / "whole")
    n_first = len(whole[0].points)
    with pytest.raises(Interrupted):
        followed(scene, shared_path / "parts", [StopsAfter(n_first + 1)])

    solved, peaks_of = [], levels.peaks_of
    for name, solve in (("peaks_of", peaks_of), ("bifurcations_of", levels.bifurcations_of)):
        counting = partial(
            lambda solve, problem, branch, *more: solved.append(branch.level) or solve(problem, branch, *more), solve
        )
        monkeypatch.setattr(levels, name, counting)
    rest = followed(scene, shared_path / "parts")
    assert solved == [0.5, 0.5]
    for one, other in zip(whole, rest, strict=True):
        assert one.peaks and one.peaks == other.peaks, "to the last bit: the structure has one DOF"
        assert [repr(there) for there in other.bifurcations] == [repr(fold)]


OVER = ('response.over=[{key="level", range=[0.02, 0.2]}, {key="damping", range=[4.0, 1.0], level=0.05}]',)


@pytest.mark.slow
@pytest.mark.parametrize("n_points", [3, pytest.param(9, marks=pytest.mark.ranks(1))])
def test_peaks_over_parameters_continue_after_the_last_point(n_points, shared_path, monkeypatch):
    """Stopped within a curve of peaks: earlier levels and points are read, and the table is that of a run without a stop."""
    mass = scenes.jenkins_mass() | {"C": np.array([[0.02]])}
    of_mass = partial(write_matrix_scene, shared_path, mass, [0.02], (0.5, 2.0), points=20, harmonics=1, samples=64)
    scene = read_scene(on_root(COMM, of_mass), OVER)
    whole, stopped = shared_path / "whole", shared_path / "stopped"
    run(scene, COMM, whole, RunOptions(screen=False))
    n_all = sum(len(curve.value) for curve in on_root(COMM, read_results, str(whole / "results.h5")).over)
    saved, solved = [0], [0]
    save = BranchFiles.save

    def counted(files, task, state, points):
        save(files, task, state, points)
        saved[0] += len(points) * (files._folder.name.startswith("over-"))
        if saved[0] == n_points:
            saved[0] += 1
            raise Interrupted("stopped by a test")

    monkeypatch.setattr(BranchFiles, "save", counted)
    with pytest.raises(Interrupted):
        run(scene, COMM, stopped, RunOptions(screen=False))

    def counts(files, task, state, points):
        save(files, task, state, points)
        solved[0] += len(points)

    monkeypatch.setattr(BranchFiles, "save", counts)
    run(scene, COMM, stopped, RunOptions(screen=False))
    assert n_all - n_points <= solved[0] <= n_all - n_points + 1  # one point may have been postponed
    first, second = (on_root(COMM, read_results, str(folder / "results.h5")).over for folder in (whole, stopped))
    for one, other in zip(first, second, strict=True):
        assert one.key == other.key and len(one.value) == len(other.value)
        for name in ("value", "amplitude", "frequency", "damping"):
            assert np.array_equal(getattr(other, name), getattr(one, name)), "to the last bit: the structure has one DOF"


@pytest.mark.slow
@pytest.mark.parametrize("n_points", [1, pytest.param(7, marks=pytest.mark.ranks(1))])
def test_a_nonlinear_mode_continues_after_the_last_point(n_points, shared_path, monkeypatch):
    of_mass = partial(write_matrix_scene, shared_path, scenes.jenkins_mass(), [0.4], (0.5, 2.0), harmonics=1, samples=64)
    scene, request = read_scene(on_root(COMM, of_mass)), backbone.Request(farthest=5.0)
    folders = shared_path / "whole", shared_path / "stopped"
    on_root(COMM, lambda: [folder.mkdir() for folder in folders])
    backbone.study(scene, COMM, folders[0], request)
    of_stops, counter = Stops.point, StopsAfter(n_points)
    with monkeypatch.context() as stopping:
        stopping.setattr(Stops, "point", lambda stops, *point: (counter.point(*point), of_stops(stops, *point)))
        with pytest.raises(Interrupted, match="the same command continues from there"):
            backbone.study(scene, COMM, folders[1], request)
    solved, save = [0], BranchFiles.save

    def counts(files, task, state, points):
        save(files, task, state, points)
        solved[0] += len(points)

    monkeypatch.setattr(BranchFiles, "save", counts)
    backbone.study(scene, COMM, folders[1], request)
    table = partial(np.genfromtxt, delimiter=",", skip_header=1)
    rows, again = (on_root(COMM, table, folder / "backbone.csv") for folder in folders)
    assert len(rows) - n_points - 1 <= solved[0] <= len(rows) - n_points + 1 and again == pytest.approx(
        rows, rel=1e-9, nan_ok=True
    )
    backbone.study(scene, COMM, folders[1], request)
    assert solved[0] <= len(rows) - n_points + 1, "a complete mode is read"
    backbone.study(scene, COMM, folders[1], replace(request, fresh=True))
    assert solved[0] >= 2 * len(rows) - n_points - 1
