"""Runs of one structure share its set-up: the same curves, error bars and modes as without the cache, and no factorisation."""

import os
import shutil
from dataclasses import astuple
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from bar_scene import write_bar
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles.scenes import chain
from plain_model import tables
from scene_text import driven, response, steel, support, table

import microslip.run as whole_run
from microslip.library.follow_response import follow
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.restart import cache
from microslip.restart.folder import Restart
from microslip.restart.identity import identity_of
from microslip.restart.stored_structure import StoredStructure
from microslip.results.read import read_results
from microslip.run import RunOptions, run
from microslip.scene.read import read_scene, scene_of

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
SMALL, LARGE = (4, 2, 1), (8, 3, 2)  # with all modes by LAPACK, and with a batch of them by SLEPc
ROUNDING = 1e-8 if COMM.size > 1 else 1e-9  # of curves relative to the peak: points are solved to a tolerance


def scene_at(folder: Path, *settings: str, divisions=SMALL, damping="ratio = 0.01", **solver):
    """Return the scene of the bar with some settings; its files are written once."""

    def write():
        path = folder / "bar.toml"
        return path if path.is_file() else write_bar(folder, damping, divisions, **solver)

    few = ("response.levels=[30.0]", "response.span=[0.98, 1.02]", "response.points=5")
    settings = (*few, "solver.harmonics=1", "solver.samples=32", *settings)
    return read_scene(on_root(COMM, write), settings)


def followed(scene, folder, shared, comm=COMM, fresh=False):
    """Return the number of modes, branches and notes of a run with the cache in ``shared``."""
    log = RunLog(comm, screen=False)
    restart = Restart.open(comm, folder, scene, (), fresh, shared)
    prepared = restart.prepared(log, partial(whole_run.build, scene, comm, log))
    try:
        branches = follow(prepared.response, (), 1, log, restart.checkpointers_of(prepared, log))
        restart.share_columns(log)
        return prepared.structure.n_modes, branches, log.notes
    finally:
        prepared.close()


def assert_same(first, second, bars=1e-5):
    assert first[0] == second[0]
    for a, b in zip(first[1], second[1], strict=True):
        assert len(a.points) == len(b.points) and a.failure == b.failure
        peak = max(np.abs(point.response).max() for point in a.points)
        worst = max(point.error.max() for point in a.points)
        for p, q in zip(a.points, b.points):
            assert abs(p.omega - q.omega) <= ROUNDING * p.omega
            assert np.abs(p.response - q.response).max() <= ROUNDING * peak
            assert np.abs(p.error - q.error).max() <= bars * worst


QUICK = ("solver.modes=6", "solver.error_bars=false")
OTHERS = {
    "friction": ("joints.joint.friction=0.04",),
    "preload": ("joints.joint.preload=1.6e7",),
    "levels": ("response.levels=[20.0, 25.0]",),
    "range": ("response.span=[0.97, 1.01]",),
    "harmonics": ("solver.harmonics=3", "solver.method='adaptive-energy'", "damping.ratio=0.02"),
    "accuracy": ("solver.accuracy=0.03",),
    "modes": ("solver.modes=5",),
    "nothing": (),
}
ON_RANKS = ("friction", "accuracy", "modes")  # changes tested on several ranks at both sizes


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with scenes and caches, one for each size of the bar, made by a run with more slip than those of the tests."""
    folder = COMM.bcast(tmp_path_factory.mktemp("made"))
    values = {}
    for divisions in (SMALL, LARGE):
        place = folder / str(len(values))
        on_root(COMM, lambda place=place: place.mkdir(exist_ok=True))
        scene = scene_at(place, "response.levels=[38.0]", "solver.accuracy=0.01", divisions=divisions)
        values[divisions] = place, followed(scene, place / "first", place / "cache")
    return values


@pytest.mark.slow
@pytest.mark.parametrize(
    ("divisions", "name"),
    [
        *(pytest.param(LARGE, name, marks=() if name in ON_RANKS else pytest.mark.ranks(1)) for name in OTHERS),
        (SMALL, "friction"),
        (SMALL, "accuracy"),
    ],
)
def test_a_second_run_of_the_structure_needs_no_factorisation(divisions, name, made, shared_path, built):
    folder, first = made[divisions]
    scene = scene_at(folder, "solver.accuracy=0.01", *OTHERS[name], divisions=divisions)
    cached, notes = prepared_by(scene, shared_path / "second", folder / "cache")
    assert built == {"first": 0, "again": 0}
    assert any("the set-up is that of an earlier run" in note for note in notes)
    built_again, notes_of_other = prepared_by(scene, shared_path / "alone", None)
    assert built == {"first": 1, "again": 0}
    assert_same_set_up(cached, built_again)
    assert why(notes) == why(notes_of_other)
    if name in ("accuracy", "modes"):
        assert cached.structure.n_modes != first[0]


@pytest.mark.ranks(1, 2)
def test_rough_surfaces_share_the_set_up_with_other_friction(shared_path, built):
    def rough(friction):
        def write():
            path = write_bar(shared_path, divisions=SMALL, modes=6)
            springs = "tangential_stiffness = 1.0e12\nnormal_stiffness = 2.0e12\n"
            text = path.read_text().replace(springs, 'law = "rough"\nroughness_height = 1.0e-6\nsliders = 4\n')
            path.write_text(text.replace("friction = 0.05", f"friction = {friction}"))
            return path

        return read_scene(on_root(COMM, write), ("response.span=[0.98, 1.02]", "solver.harmonics=1", "solver.samples=32"))

    prepared_by(rough(0.05), shared_path / "first", shared_path / "cache")
    cached, _ = prepared_by(rough(0.04), shared_path / "second", shared_path / "cache")
    assert built == {"first": 1, "again": 0}
    built_again, _ = prepared_by(rough(0.04), shared_path / "alone", None)
    assert built == {"first": 2, "again": 0} and np.all(cached.pairs.mu == 0.04)
    assert_same_set_up(cached, built_again)


def assert_same_set_up(first, second):
    """Compare all data from which a response is computed."""
    assert_close(first.pairs.mu, second.pairs.mu, 0.0)
    assert_close(first.pairs.N0, second.pairs.N0, 0.0)
    assert type(first.reduction.selection) is type(second.reduction.selection)
    assert_close(first.model.f, second.model.f)
    for name in ("du_static", "out_static", "out_R", "load_static"):
        assert_close(*(getattr(each.model.receptance_of(1).static, name) for each in (first, second)))
    for name in ("omega_n", "R_phi", "b", "o"):
        assert_close(getattr(first.model.receptance_of(1).modes, name), getattr(second.model.receptance_of(1).modes, name), 1e-7)
    assert_close(first.model.receptance_of(1).modes.damping.C, second.model.receptance_of(1).modes.damping.C)
    assert not first.model.receptance_of(1).static.G_static.known.any()  # which would change the points
    of_first, of_second = (each.response.enriched.truncated.of(1) for each in (first, second))
    assert np.isclose(of_first.omega, of_second.omega, rtol=1e-7) and of_first.highest == pytest.approx(
        of_second.highest, rel=1e-9
    )
    assert astuple(of_first.damping) == pytest.approx(astuple(of_second.damping), rel=1e-9)
    for name in ("of_pairs", "of_outputs", "of_loads", "direct", "drive_point", "residual"):
        assert_close(getattr(of_first, name), getattr(of_second, name), 1e-7)
    all_pairs = np.arange(first.pairs.n_pairs)
    assert_close(*(each.model.receptance_of(1).static.G_static.transposed(all_pairs) for each in (first, second)))


def assert_close(computed, expected, rtol=1e-9):
    assert computed.shape == expected.shape and np.abs(computed - expected).max(initial=0.0) <= rtol * np.abs(expected).max(
        initial=0.0
    )


def prepared_by(scene, folder, shared):
    """Return the prepared data of a run with the cache in ``shared``, with its factor, if any, and its notes."""
    log = RunLog(COMM, screen=False)
    restart = Restart.open(COMM, folder, scene, (), False, shared)
    return restart.prepared(log, partial(whole_run.build, scene, COMM, log)), log.notes


@pytest.mark.slow
@pytest.mark.parametrize("name", ["friction", pytest.param("levels", marks=pytest.mark.ranks(1))])
def test_curves_and_error_bars_with_the_cache_are_those_without(name, shared_path, built):
    scene = partial(scene_at, shared_path, "solver.modes=6")
    followed(scene("response.levels=[38.0]"), shared_path / "first", shared_path / "cache")
    second = followed(scene(*OTHERS[name]), shared_path / "second", shared_path / "cache")
    assert built == {"first": 1, "again": 0}
    assert_same(second, followed(scene(*OTHERS[name]), shared_path / "alone", None))


def why(notes):
    """Return the note on the number of modes, without the numbers."""
    (note_on_modes,) = [note for note in notes if note.startswith("modes: ")]
    return note_on_modes.partition("those left out")[0]


@pytest.mark.parametrize(
    "setting",
    [
        "joints.joint.tangential_stiffness=1.1e12",
        "materials.steel.young=2e11",
        "materials.steel.density=7700.0",
        "loads.1.direction=[1.0, 0.0, 0.0]",
        "outputs.1.direction=[0.0, 1.0, 0.0]",
        "supports.1.fix=['x', 'y']",
    ],
)
def test_inputs_of_the_structure_are_part_of_its_key(setting, shared_path):
    scene, other = scene_at(shared_path), scene_at(shared_path, setting)
    keys = {Restart.open(COMM, shared_path / "out", each).identity.structure for each in (scene, other)}
    assert len(keys) == 2


@pytest.mark.parametrize("step, n_keys", [("*STATIC\n*CLOAD\n1, 1, 1.\n", 2), ("*STATIC\n", 1)])
def test_friction_is_part_of_the_key_if_the_model_file_loads_the_joint(step, n_keys, shared_path):
    scene = {**tables("job.inp"), "joints": ({**tables("job.inp")["joints"][0], "friction": 0.3},)}
    other = {**scene, "joints": ({**scene["joints"][0], "friction": 0.4},)}
    text = "*INCLUDE, INPUT=loads.inp\n*STEP, Perturbation\n*FREQUENCY\n1\n*END STEP\n"
    on_root(COMM, lambda: [(shared_path / "job.inp").write_text(text), (shared_path / "loads.inp").write_text(f"*STEP\n{step}")])
    keys = {identity_of(scene_of(one, shared_path / "scene.toml")).structure for one in (scene, other)}
    assert len(keys) == n_keys


def test_a_changed_stiffness_or_mesh_builds_the_structure(shared_path, built):
    shared = shared_path / "cache"
    prepared_by(scene_at(shared_path, *QUICK), shared_path / "first", shared)
    prepared_by(scene_at(shared_path, *QUICK, "joints.joint.normal_stiffness=2.1e12"), shared_path / "second", shared)
    on_root(COMM, lambda: (shared_path / "bar.msh").open("a").write("\n"))
    prepared_by(scene_at(shared_path, *QUICK), shared_path / "third", shared)
    assert built == {"first": 3, "again": 0}
    assert on_root(COMM, lambda: len(list(shared.glob("setup-*")))) == 3


def test_additional_modes_need_the_matrices_again_and_are_cached(shared_path, built):
    scene, shared = partial(scene_at, shared_path, divisions=LARGE), shared_path / "cache"
    few, _ = prepared_by(scene("solver.modes=4"), shared_path / "first", shared)
    more, _ = prepared_by(scene("solver.modes=8"), shared_path / "second", shared)
    third, _ = prepared_by(scene("solver.modes=8", "joints.joint.friction=0.04"), shared_path / "third", shared)
    assert [each.structure.n_modes for each in (few, more, third)] == [4, 8, 8] and built == {"first": 1, "again": 1}
    assert on_root(COMM, lambda: len(list(shared.glob("setup-*/modes-*")))) == 1


@pytest.mark.study
@pytest.mark.ranks(1)
def test_modes_that_structural_damping_couples_are_cached(shared_path, built):
    scene, shared = partial(scene_at, shared_path, damping="structural = 0.02"), shared_path / "cache"
    prepared_by(scene("solver.modes=6"), shared_path / "first", shared)
    other = scene("solver.modes=6", "joints.joint.friction=0.04")
    cached, _ = prepared_by(other, shared_path / "second", shared)
    built_again, _ = prepared_by(other, shared_path / "alone", None)
    assert built == {"first": 2, "again": 0}
    assert_same_set_up(cached, built_again)
    assert_close(cached.model.receptance_of(1).modes.damping.S, built_again.model.receptance_of(1).modes.damping.S)
    for name in ("of_pairs", "of_outputs", "of_loads", "modal"):
        assert_close(*(getattr(each.response.enriched.truncated.of(1).coupling, name) for each in (cached, built_again)))
    three, _ = prepared_by(scene(), shared_path / "third", shared)  # the number of modes depends on the damping residual
    four, _ = prepared_by(scene(), shared_path / "fourth", None)
    assert built == {"first": 3, "again": 2} and three.structure.n_modes == four.structure.n_modes
    assert_same_set_up(three, four)


@pytest.mark.slow
@pytest.mark.ranks(2)
def test_several_ranks_use_the_set_up_of_one(shared_path, built):
    scene, alone = partial(scene_at, shared_path, "solver.modes=6"), COMM.Split(COMM.rank, 0)
    stronger, other = scene("response.levels=[38.0]"), scene("joints.joint.friction=0.04")
    if COMM.rank == 0:
        followed(stronger, shared_path / "first", shared_path / "cache", alone)
    COMM.barrier()
    alone.Free()
    second = followed(other, shared_path / "second", shared_path / "cache")
    assert built == {"first": int(COMM.rank == 0), "again": 0}
    assert_same(second, followed(other, shared_path / "alone", None), bars=0.5)  # other samples


def test_fresh_runs_ignore_and_replace_the_cache(shared_path, built):
    scene, shared = scene_at(shared_path, *QUICK), shared_path / "cache"
    followed(scene, shared_path / "first", shared)
    names = on_root(COMM, lambda: {path.name for path in shared.glob("setup-*/modes-*")})
    followed(scene, shared_path / "second", shared, fresh=True)
    assert built == {"first": 2, "again": 0}
    assert on_root(COMM, lambda: {path.name for path in shared.glob("setup-*/modes-*")}) != names


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """Return a folder with the scene, the cache of a run, and in ``alone`` the results with another friction and no cache."""
    folder = COMM.bcast(tmp_path_factory.mktemp("complete"))
    run_with(folder / "cache", scene_at(folder, *QUICK), folder / "first")
    run_with("off", scene_at(folder, *QUICK, "joints.joint.friction=0.04"), folder / "alone")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("model", {"first": 1, "again": 0}),
        pytest.param("columns", {"first": 0, "again": 1}, marks=pytest.mark.ranks(1)),
        pytest.param("modes-*", {"first": 0, "again": 1}, marks=pytest.mark.ranks(1)),
    ],
)
def test_damaged_files_of_the_cache_are_computed_again(name, times, complete, shared_path, built):
    shared = shared_path / "cache"
    on_root(COMM, lambda: shutil.copytree(complete / "cache", shared))
    on_root(COMM, lambda: [cut(path) for path in shared.glob(f"setup-*/{name}")])
    run_with(shared, scene_at(complete, *QUICK, "joints.joint.friction=0.04"), shared_path / "second")
    assert built == times
    if COMM.rank == 0:
        second, alone = (read_results(str(path / "results.h5")) for path in (shared_path / "second", complete / "alone"))
        assert np.allclose(second.levels[0].response, alone.levels[0].response, rtol=1e-6, atol=1e-15)
        assert (shared_path / "second" / "modes.vtkhdf").is_file()


def run_with(shared, scene, folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(cache.VARIABLE, str(shared))
        patch.setattr(
            "microslip.results.draw.draw_share", lambda *share: None
        )  # module fixtures are set up before that of a test
        run(scene, COMM, folder, RunOptions(screen=False))


def test_without_fields_a_second_run_builds_nothing(shared_path, built):
    shared = shared_path / "cache"
    run_with(shared, scene_at(shared_path, *QUICK), shared_path / "out")
    assert on_root(COMM, (shared_path / "out" / "peak_response.vtkhdf").is_file)
    run_with(shared, scene_at(shared_path, *QUICK, "joints.joint.friction=0.04", "response.fields=false"), shared_path / "out")
    assert built == {"first": 1, "again": 0}
    assert not on_root(COMM, (shared_path / "out" / "peak_response.vtkhdf").exists)
    run_with(shared, scene_at(shared_path, *QUICK, "joints.joint.friction=0.04"), shared_path / "out")
    assert built == {"first": 1, "again": 1}  # the levels are read, the fields are added
    assert on_root(COMM, (shared_path / "out" / "peak_response.vtkhdf").is_file)


def test_a_cache_that_cannot_be_written_is_noted_and_not_needed(shared_path):
    on_root(COMM, lambda: (shared_path / "cache").write_text("a file"))
    _, branches, notes = followed(scene_at(shared_path), shared_path / "out", shared_path / "cache")
    assert all(branch.failure is None for branch in branches)
    assert any("is not stored for other runs" in note for note in notes)


@pytest.mark.parametrize("write", [pytest.param("matrices", marks=pytest.mark.ranks(1)), "mesh"])
def test_without_a_joint_other_points_and_levels_use_the_cache(write, shared_path, built):
    path, cache_folder = on_root(COMM, WITHOUT_JOINT[write], shared_path), shared_path / "cache"
    first = followed(read_scene(path), shared_path / "one", cache_folder)
    assert_same(followed(read_scene(path), shared_path / "two", cache_folder), first)
    for setting in ("response.points=7", "response.levels=[2.0]"):
        scene = read_scene(path, (setting,))
        other = followed(scene, shared_path / "one", cache_folder)
        assert built == {"first": 1, "again": 0}
        assert_same(other, followed(scene, shared_path / f"alone {setting[9]}", None))
        built["first"] = 1


def write_matrices(folder: Path) -> Path:
    """Write a chain of masses as matrices and without its joint; return the scene's path.  Local."""
    path = write_matrix_scene(folder, chain(), [1.0], chain()["omega"][:2], points=5, harmonics=1)
    text = path.read_text()
    path.write_text(text[: text.index("[[joints]]")] + text[text.index("[[loads]]") :])
    return path


def write_block(folder: Path) -> Path:
    """Write a block on the ground of its mesh, both held, without a joint; return the scene's path.  Local."""
    write_bar(folder)
    place = [[0.05, 0.01, 0.02], [0.0, 0.0, 0.02]], [1.0, 0.3, 0.2], [1.0, 0.0, 0.0], "corner"
    supports = support("ground_base") + support("bar_bottom")
    solver = table("solver", harmonics=1)
    text = table("model", mesh="bar.msh") + steel("bar", "ground") + supports + driven(*place) + response(1.0, points=5) + solver
    (folder / "block.toml").write_text(text)
    return folder / "block.toml"


WITHOUT_JOINT = {"matrices": write_matrices, "mesh": write_block}


# -- files, on one rank ------------------------------------------------------------------------------------------------


@pytest.mark.ranks(1)
def test_the_environment_names_the_cache_or_turns_it_off(tmp_path, monkeypatch):
    monkeypatch.delenv(cache.VARIABLE)
    assert cache.cache_of(tmp_path / "results" / "fan") == tmp_path / "results" / "cache"
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "elsewhere"))
    assert cache.cache_of(tmp_path / "results" / "fan") == tmp_path / "elsewhere"
    monkeypatch.setenv(cache.VARIABLE, "off")
    assert cache.cache_of(tmp_path / "results" / "fan") is None


@pytest.mark.ranks(1)
def test_least_recently_used_set_ups_are_deleted(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "LARGEST", 2500.0)
    a, b, c, d = (f"setup-{letter * 24}" for letter in "abcd")
    for i, name in enumerate((a, b, c, d, "setup-of-mine")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "model").write_bytes(bytes(1000))
        os.utime(tmp_path / name / "model", (1e9 + i, 1e9 + i))
    cache.make_room(tmp_path, tmp_path / b)
    assert sorted(path.name for path in tmp_path.iterdir()) == [b, d, "setup-of-mine"]


@pytest.mark.ranks(1)
def test_a_set_up_of_a_disc_is_used_where_one_of_its_nodal_diameters_is(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "LARGEST", 2500.0)
    models = [tmp_path / f"setup-{24 * 'a'}" / f"diameter-{d}" / "model" for d in (0, 1)]
    models += [tmp_path / f"setup-{24 * letter}" / "model" for letter in "bc"]
    for model, used in zip(models, (1.0, 3.0, 2.0, 4.0), strict=True):
        model.parent.mkdir(parents=True)
        model.write_bytes(bytes(800))
        os.utime(model, (1e9 + used, 1e9 + used))
    cache.make_room(tmp_path, tmp_path / f"setup-{24 * 'c'}")
    assert sorted(path.name[-1] for path in tmp_path.iterdir()) == ["a", "c"]


@pytest.mark.ranks(1)
def test_an_entry_that_another_run_replaces_between_two_reads_is_used(tmp_path, monkeypatch):
    entry = cache.Cache(COMM, tmp_path, 24 * "a")
    entry.entry.mkdir()
    (entry.entry / "modes-new").touch()
    states = [({}, {"modes": "modes-old"}), ({}, {"modes": "modes-new"})]
    entry.files.model.touch()
    monkeypatch.setattr(StoredStructure, "read", lambda files: states.pop(0))
    assert entry.read()[1] == {"modes": "modes-new"} and entry.files.model.is_file()
    states = 2 * [({}, {"modes": "modes-lost"})]
    assert entry.read() is None and not entry.entry.exists()


@pytest.mark.ranks(1)
@pytest.mark.parametrize("links", [True, False])
def test_files_are_shared_by_links_or_copies(links, tmp_path, monkeypatch):
    if not links:
        monkeypatch.setattr(cache.os, "link", lambda *_: (_ for _ in ()).throw(OSError("no links here")))
    (tmp_path / "one").write_text("new")
    (tmp_path / "two").write_text("old")
    cache.link_or_copy(tmp_path / "one", tmp_path / "two")
    assert (tmp_path / "two").read_text() == "new" and len(list(tmp_path.iterdir())) == 2


def test_dampers_are_cached_separately_from_other_damping(shared_path, built):
    scene_at(shared_path)
    damper = '[[springs]]\ngroups = ["bar_end"]\ndirection = [1.0, 0.0, 0.0]\ndamping = 30.0\n[[loads]]\n'
    path = shared_path / "bar.toml"
    on_root(COMM, lambda: path.write_text(path.read_text().replace("[[loads]]\n", damper, 1)))
    friction = "joints.joint.friction=0.04"
    prepared_by(scene_at(shared_path, *QUICK), shared_path / "first", shared_path / "cache")
    shared, _ = prepared_by(scene_at(shared_path, *QUICK, friction), shared_path / "second", shared_path / "cache")
    assert built == {"first": 1, "again": 0}
    other = scene_at(shared_path, *QUICK, friction, "damping.ratio=0.02")
    damped, _ = prepared_by(other, shared_path / "third", shared_path / "cache")
    assert built == {"first": 1, "again": 0}
    without_cache, _ = prepared_by(scene_at(shared_path, *QUICK, friction), shared_path / "alone", None)
    from_cache, with_ratio, expected = (each.model.receptance_of(1).modes for each in (shared, damped, without_cache))
    assert_close(from_cache.damping.C, expected.damping.C)
    assert_close(with_ratio.damping.C - expected.damping.C, np.diag(0.02 * expected.omega_n))
