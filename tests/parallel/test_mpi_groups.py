"""Groups of ranks on 1, 2 or 3 ranks: the components, then levels and scenes of the whole program."""

import csv
import time
from types import SimpleNamespace

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import scenes
from petsc4py import PETSc

from microslip.continuation import levels
from microslip.library import side_by_side
from microslip.library.build import build
from microslip.library.prepare import prepare
from microslip.library.side_by_side import groups_that_pay
from microslip.messages.errors import CaseError, ResourceError
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.parallel.rank_groups import Counter, Reports, dealt, refuse_too_many, split
from microslip.receptance.on_ranks import on_ranks
from microslip.results.read import read_results
from microslip.results.table import ResponseTable
from microslip.scene.read import read_scene

LEVELS = [0.05, 0.2, 0.02, 0.1]  # N, neither rising nor falling
AT = [1.2, 1.45]  # rad/s


# -- the parts ---------------------------------------------------------------------------------------------------------


def test_groups_are_consecutive_ranks_of_equal_size(comm):
    for n in range(1, comm.size + 1):
        parts = split(comm, n)
        computed = comm.allgather((parts.number, parts.comm.rank, parts.comm.size, parts.is_root, parts.where))
        numbers, own_ranks, sizes, roots, names = zip(*computed)
        assert list(numbers) == sorted(numbers) and set(numbers) == set(range(n)) and parts.n == n
        assert max(sizes) - min(sizes) <= 1 and sum(roots) == n
        assert all(root == (own == 0) for root, own in zip(roots, own_ranks))
        assert names[-1] == (f"rank {comm.size - 1}" if sizes[-1] == 1 else f"ranks {comm.size - sizes[-1]} to {comm.size - 1}")
        parts.comm.Free()


def test_a_group_without_a_rank_is_rejected():
    refuse_too_many(2, 2)
    with pytest.raises(CaseError, match="--groups 3: there are only 2 ranks"):
        refuse_too_many(3, 2)
    with pytest.raises(CaseError, match="--groups 2: there is only 1 rank"):
        refuse_too_many(2, 1)


def test_each_task_is_assigned_once_and_fast_groups_get_more(comm):
    parts, counter = split(comm, comm.size), Counter(comm)
    taken = []
    for task in dealt(parts, counter, 12):
        taken.append(task)
        time.sleep(0.1 if comm.rank == 0 else 0.002)
    everything = comm.allgather(taken)
    assert sorted(sum(everything, [])) == list(range(12))
    assert comm.size == 1 or len(everything[0]) < 6
    counter.free()


def test_rank_0_receives_all_messages_in_the_order_of_each_group(comm):
    parts, received = split(comm, min(2, comm.size)), []
    reports = Reports(parts, lambda *news: received.append(news))
    with reports.shared_failure():
        for k in range(20):
            on_root(parts.comm, reports.notify, parts.number, k, np.full(5000, float(k)))  # too long to be sent at once
        on_root(parts.comm, reports.finish)
    reports.free()
    for number in range(parts.n) if comm.rank == 0 else ():
        own = [(k, values) for group, k, values in received if group == number]
        assert [k for k, _ in own] == list(range(20)) and all((values == k).all() for k, values in own)
    assert received == [] or comm.rank == 0


@pytest.mark.parametrize("culprit", [0, 1])
def test_an_error_of_one_group_ends_all(comm, culprit):
    parts = split(comm, min(2, comm.size))
    reports = Reports(parts, lambda *news: None)
    begun = 0

    def works(k):
        nonlocal begun
        begun += 1
        if parts.number == culprit % parts.n and k == 3:
            raise ResourceError("no more room")
        time.sleep(0.002)
        reports.notify(k)

    with pytest.raises(ResourceError, match="^no more room$"), reports.shared_failure():
        for k in range(3000):
            on_root(parts.comm, works, k)
        on_root(parts.comm, reports.finish)
    assert begun < 3000
    comm.Barrier()


def test_a_finished_group_is_notified_of_a_failure(comm):
    parts = split(comm, min(2, comm.size))

    def full(*news):
        raise ResourceError("the disk is full")

    reports = Reports(parts, full)
    with pytest.raises(ResourceError, match="the disk is full"), reports.shared_failure():
        if parts.number == parts.n - 1:
            on_root(parts.comm, reports.notify, "something")
        on_root(parts.comm, reports.finish)
    comm.Barrier()


def test_each_group_has_the_whole_model(comm, shared_path, monkeypatch):
    monkeypatch.setattr("microslip.receptance.on_ranks._BATCH", 2)
    path = on_root(comm, lambda: write_matrix_scene(shared_path, scenes.chain(), [0.4], (1.0, 1.6)))
    scene = read_scene(path)
    structure = build(scene, comm, RunLog(comm, screen=False))
    model = prepare(structure).model
    parts = split(comm, min(2, comm.size))
    own, everything = on_ranks(model, parts.comm), np.arange(model.n_pairs)
    whole = np.concatenate(comm.allgather(model.receptance_of(1).static.G_static.transposed(everything)), axis=1)
    there = np.concatenate(parts.comm.allgather(own.receptance_of(1).static.G_static.transposed(everything)), axis=1)
    assert own.receptance_of(1).static.G_static.known.all() and there.shape == (3 * model.n_pairs, 3 * model.n_pairs)
    assert np.array_equal(there, whole) or np.abs(there - whole).max() <= 1e-14 * np.abs(whole).max()
    structure.linearised.destroy()


# -- the program -------------------------------------------------------------------------------------------------------


@pytest.fixture
def program(program, shared_path, monkeypatch):
    """Return the program in the folder of the test."""
    monkeypatch.chdir(shared_path)
    return program


def write(comm, folder, name="scene", levels=LEVELS):
    """Write a matrix scene of three DOF into a separate folder; return its path on every rank."""

    def files():
        place = folder / name
        place.mkdir(parents=True)
        path = write_matrix_scene(place, scenes.spatial_mass(), levels, (1.0, 1.6), at=AT, outputs=[0, 2], points=6)
        return path.rename(place / f"{name}.toml")

    return str(on_root(comm, files))


def rows(folder):
    with open(folder / "frf.csv", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.ranks(2, 3)
@pytest.mark.slow
def test_levels_in_groups_equal_those_in_turn(comm, shared_path, program):
    scene = write(comm, shared_path)
    for arguments in (["--out", "turn", "--groups", "1"], ["--out", "side"]):
        status, out, err = program("run", scene, *arguments)
        assert (status, err) == (0, "")
    assert comm.size == 1 or f"4 levels on {comm.size} groups of 1 rank" in out  # automatic for so few pairs
    turn, side = (read_results(str(shared_path / name / "results.h5")).levels for name in ("turn", "side"))
    assert [level.level for level in side] == [level.level for level in turn] == LEVELS
    for a, b in zip(turn, side):
        assert (b.status, b.failure) == ("complete", "")
        assert b.frequency[b.requested == 1] == pytest.approx(a.frequency[a.requested == 1], rel=1e-14) and (
            b.requested == 1
        ).sum() == len(AT)
        peak = np.abs(a.response).max()
        assert np.abs(b.response[b.requested == 1] - a.response[a.requested == 1]).max() < 1e-8 * peak
        assert np.abs(b.du[b.requested == 1] - a.du[a.requested == 1]).max() < 1e-8 * np.abs(a.du).max()
    keys = [[(row["level_N"], row["point"], row["output"]) for row in rows(shared_path / name)] for name in ("turn", "side")]
    assert keys[0] == keys[1] and len(keys[0]) == 2 * sum(len(level.frequency) for level in turn)
    log = (shared_path / "side" / "run.log").read_text()
    assert all(f"level {i + 1} of 4: {level:g} N: " in log for i, level in enumerate(LEVELS)) and log.endswith("done\n")


def test_the_default_number_of_groups_is_that_of_slipping_levels(comm, monkeypatch):
    monkeypatch.setattr(side_by_side, "levels_of_slip", lambda of: np.array([2.0, 5.0]) if of.vibrates else None)

    def groups(levels, n_pairs=200, n_dof=100_000, vibrates=True):
        model, settings = SimpleNamespace(comm=comm, n_pairs=n_pairs), SimpleNamespace(levels=levels)
        return groups_that_pay(SimpleNamespace(model=model, settings=settings, vibrates=vibrates), n_dof)

    assert groups((1.0, 3.0, 4.0)) == min(2, comm.size) and groups((1.0, 2.0)) == 1
    assert groups((3.0,) * 100) == comm.size
    too_many = groups((3.0, 4.0), n_dof=600_000), groups((3.0, 4.0), n_pairs=1001, n_dof=3003)
    assert groups((3.0, 4.0), vibrates=False) == 1 and too_many == (1, 1)


def test_more_groups_than_ranks_are_rejected_before_any_work(comm, shared_path, program):
    scene = write(comm, shared_path)
    status, _, err = program("run", scene, "--out", "out", "--groups", str(comm.size + 1))
    assert status == 2 and err.count("microslip: error: ") == 1 and f"--groups {comm.size + 1}: there " in err
    assert not (shared_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "n_groups", [pytest.param(1, marks=pytest.mark.ranks(1)), pytest.param(2, marks=pytest.mark.ranks(2, 3))]
)
def test_a_level_that_ends_early_does_not_affect_the_others(comm, shared_path, program, n_groups, monkeypatch):
    monkeypatch.setattr(levels, "SHORTER", 1)  # the steps of the third segment: shorter ones complete it
    scene = write(comm, shared_path, levels=[0.4, 0.02, 0.01])
    options = PETSc.Options()  # PETSc has started: it does not read a command line again
    options["hb_snes_max_it"] = 1
    status, _, err = program("run", scene, "--out", "out", "--groups", str(n_groups))
    del options["hb_snes_max_it"]
    assert status == 3 and err.count("microslip: error: ") == 1 and "Traceback" not in err
    assert "level 0.4 N ends after" in err and "what converged is in out" in err
    failed, *whole = read_results(str(shared_path / "out" / "results.h5")).levels
    assert failed.status == "failed" and "no convergence beyond" in failed.failure
    assert [level.status for level in whole] == ["complete", "complete"]
    assert all((level.requested == 1).sum() == len(AT) for level in whole)
    assert all(level.frequency.max() == pytest.approx(1.6 / (2.0 * np.pi)) for level in whole)


def test_a_full_disk_ends_all_groups_with_one_message(comm, shared_path, program, monkeypatch):
    scene = write(comm, shared_path)

    def add(self, level, i, point):
        if i == 3:
            raise ResourceError("frf.csv: could not be written: No space left on device")

    monkeypatch.setattr(ResponseTable, "add", add)
    status, _, err = program("run", scene, "--out", "out", "--groups", str(min(2, comm.size)))
    assert status == 4 and err.count("microslip: error: ") == 1 and "alone" not in err


@pytest.mark.slow
def test_scenes_in_groups(comm, shared_path, program):
    a, b = write(comm, shared_path, "a", [0.2]), write(comm, shared_path, "b", [0.1, 0.05])
    bad = write(comm, shared_path, "bad", [0.1])
    on_root(comm, lambda: (shared_path / "bad" / "K.mtx").write_text("not a matrix\n"))
    status, out, err = program("run", a, bad, b, "--out", "out", "--groups", str(min(2, comm.size)))
    assert status == 2 and err.count("microslip: error: bad: ") == 1 == err.count("microslip: error: ")
    assert [len(read_results(str(shared_path / "out" / name / "results.h5")).levels) for name in "ab"] == [1, 2]
    assert all((shared_path / "out" / name / "run.log").read_text().endswith("done\n") for name in "ab")
    assert comm.size == 1 or [out.count(f"{name}: begun on rank") for name in ("a", "bad", "b")] == [1, 1, 1]


def test_an_option_read_by_any_rank_is_used(comm, shared_path, program, monkeypatch):
    """A group may have had no work."""
    scene, options = write(comm, shared_path, levels=[0.02]), ["-hb_a", "-hb_b"]
    monkeypatch.setattr("microslip.__main__.unused_options", lambda given: options[comm.rank > 0 :])
    status, _, err = program("run", scene, "--out", "out")
    assert status == 2 and err.count(f"error: {'-hb_a' if comm.size == 1 else '-hb_b'}: no solver of this run reads") == 1


def test_scenes_of_the_same_name_are_rejected(comm, shared_path, program):
    a, b = write(comm, shared_path / "x", "a"), write(comm, shared_path / "y", "a")
    status, _, err = program("run", a, b, "--out", "out")
    assert status == 2 and err.count("two scenes are called 'a'") == 1 and not (shared_path / "out").exists()
