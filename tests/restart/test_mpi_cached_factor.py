"""The factor in the cache: used by a second run, and computed again, with correct results, wherever its validity is in doubt."""

import os
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from bar_scene import write_bar
from mpi4py import MPI

from microslip.linear import factor as factors
from microslip.linear import mumps
from microslip.parallel.agree import on_root
from microslip.restart import cache, cached_factor
from microslip.restart.records import read_record, write_unsynced
from microslip.results.read import read_results
from microslip.run import RunOptions, run
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
FRICTION = "joints.joint.friction=0.04"
FIELDS = ("modes.vtkhdf", "peak_response.vtkhdf")
TAKEN, NOT_USED = "factor: that of an earlier run, ", "is not used: "


@pytest.fixture
def factored(monkeypatch):
    """Return the names of the factorised matrices."""
    values = []
    factorise = factors.factorise

    def noting(A, prefix, what, **keys):
        values.append(what)
        return factorise(A, prefix, what, **keys)

    monkeypatch.setattr(factors, "factorise", noting)
    return values


def run_at(folder: Path, name: str, *settings: str, shared: str = "cache") -> str:
    """Run the bar with keys set, and return its log."""

    def write():
        path = folder / "bar.toml"
        return path if path.is_file() else write_bar(folder, modes=6, error_bars=False)

    few = ("response.span=[0.98, 1.02]", "response.points=5", "solver.harmonics=1", "solver.samples=32")
    scene = read_scene(on_root(COMM, write), (*few, *settings))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(cache.VARIABLE, shared if shared == cache.OFF else str(folder / shared))
        run(scene, COMM, folder / name, RunOptions(screen=False))
    return on_root(COMM, (folder / name / "run.log").read_text)


def factor_folder(folder: Path) -> Path:
    """Return the folder of the factor."""
    (computed,) = on_root(COMM, lambda: list(folder.glob(f"cache/setup-*/factor-{COMM.size}")))
    return computed


def assert_same_results(folder: Path, reference: Path) -> None:
    """Compare curves and fields, on rank 0."""
    if COMM.rank > 0:
        return
    a, b = (read_results(str(each / "results.h5")).levels[0].response for each in (folder, reference))
    np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-15)
    for name in FIELDS:
        with h5py.File(folder / name) as file, h5py.File(reference / name) as expected_file:
            for key, values in arrays_of(file).items():
                expected = expected_file[key][()]
                assert values.shape == expected.shape
                np.testing.assert_allclose(values, expected, rtol=0, atol=1e-6 * np.abs(expected).max(initial=0.0), err_msg=key)


def arrays_of(file):
    values = {}
    file.visititems(
        lambda key, of: values.update({key: of[()]}) if isinstance(of, h5py.Dataset) and of.dtype.kind in "if" else None
    )
    return values


def test_a_second_run_with_fields_needs_no_factorisation(made, factored):
    assert "factor for other runs" in on_root(COMM, (made / "first" / "run.log").read_text)
    second = run_at(made, "second", FRICTION)
    assert factored == [] and TAKEN in second and "factor for other runs" not in second
    assert_same_results(made / "second", made / "alone")


def test_a_continued_run_uses_the_cached_factor_for_additional_fields(shared_path, factored):
    run_at(shared_path, "out", "response.fields=false")
    log = run_at(shared_path, "out")
    assert factored == ["K_L"] and TAKEN in log


def last_file(folder: Path) -> Path:
    return folder / mumps.saved_file(COMM.size - 1)


def cut(folder):
    os.truncate(last_file(folder), last_file(folder).stat().st_size - 8)


def flip(folder):
    with open(last_file(folder), "r+b") as file:
        file.seek(last_file(folder).stat().st_size // 2)
        byte = file.read(1)[0]
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte ^ 1]))


def pipe(folder):
    last_file(folder).unlink()
    os.mkfifo(last_file(folder))


def rewritten(change):
    """Return a function that changes the record of a folder, with a correct checksum."""

    def rewrite(folder):
        arrays, texts = read_record(folder / "of")
        change(arrays, texts)
        write_unsynced(folder / "of", arrays, texts)

    return rewrite


def other_ranks(arrays, texts):
    """Change it to the record of a run with one rank more."""
    arrays["ranges"] = np.concatenate([arrays["ranges"], arrays["ranges"][-1:]])
    arrays["sizes"], arrays["sums"] = (np.append(arrays[name], 0) for name in ("sizes", "sums"))


def other_rows(arrays, texts):
    """Change it to the record of a matrix with one row more."""
    arrays["ranges"] = arrays["ranges"] + (arrays["ranges"] == arrays["ranges"][-1])


DAMAGES = {
    "cut": cut,
    "flipped": flip,
    "gone": lambda folder: last_file(folder).unlink(),
    "a folder": lambda folder: (last_file(folder).unlink(), last_file(folder).mkdir()),
    "a pipe": pipe,
    "no record": lambda folder: (folder / "of").unlink(),
    "a cut record": lambda folder: os.truncate(folder / "of", 40),
    "a record of others": lambda folder: write_unsynced(folder / "of", {}, {"number": 1}),
    "another machine": rewritten(lambda arrays, texts: texts.update(layout="MUMPS 4, vax, big")),
    "other ranks": rewritten(other_ranks),
    "other rows": rewritten(other_rows),
    "no integers": rewritten(lambda arrays, texts: arrays.update(sizes=arrays["sizes"] * np.nan)),
    "no matrix": lambda folder: noise(folder),
}


def noise(folder):
    """Replace the factor by zeros with a correct checksum: MUMPS itself must reject it."""
    file = last_file(folder)
    file.write_bytes(bytes(file.stat().st_size))
    rewritten(lambda arrays, texts: arrays["sums"].__setitem__(-1, cached_factor.summed(file, file.stat().st_size)[1]))(folder)


def copy_of(made: Path, folder: Path) -> None:
    """Copy the scene, the cache and the results without cache to a folder.  Collective."""
    on_root(COMM, shutil.copytree, made, folder, None, shutil.ignore_patterns("first", "second"), shutil.copy2, False, True)


ON_RANKS = ("cut", "gone", "other rows")  # damages tested on several ranks


@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name in ON_RANKS else pytest.mark.ranks(1)) for name in DAMAGES])
def test_a_damaged_factor_is_computed_and_stored_again(name, made, shared_path, factored):
    copy_of(made, shared_path)
    folder = factor_folder(shared_path)
    before = on_root(COMM, names_of, folder)
    on_root(COMM, lambda: [DAMAGES[name](folder), None][1])
    second = run_at(shared_path, "second", FRICTION)
    assert factored == ["K_L"] and NOT_USED in second and TAKEN not in second
    assert_same_results(shared_path / "second", shared_path / "alone")
    assert on_root(COMM, lambda: [path.name for path in folder.parent.glob("factor-*")]) == [folder.name]
    assert on_root(COMM, names_of, folder) == before


def names_of(folder):
    return sorted(path.name for path in folder.iterdir() if path.stat().st_size > 0)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return a folder with the cache of a run, and the results with another friction and no cache."""
    folder = COMM.bcast(tmp_path_factory.mktemp("made"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("microslip.results.draw.draw_share", lambda *share: None)
        run_at(folder, "first")
        run_at(folder, "alone", FRICTION, shared=cache.OFF)
    return folder


def test_the_factor_of_another_number_of_ranks_is_not_used(made, shared_path, factored):
    copy_of(made, shared_path)
    folder = factor_folder(shared_path)
    other = folder.with_name(f"factor-{COMM.size + 1}")
    on_root(COMM, lambda: [folder.rename(other), None][1])
    second = run_at(shared_path, "second", FRICTION)
    assert factored == ["K_L"] and NOT_USED not in second
    assert on_root(COMM, lambda: other.is_dir() and folder.is_dir())


@pytest.mark.ranks(2)
def test_the_factor_of_another_structure_is_detected(made, shared_path, factored):
    """Its files are complete and have the right number of rows: only wrong solutions show it."""
    copy_of(made, shared_path)
    run_at(shared_path, "soft", "materials.steel.young=1e11")
    first, second_entry = on_root(COMM, lambda: sorted(shared_path.glob("cache/setup-*/factor-2")))
    on_root(COMM, lambda: [[folder.rename(folder.with_name("other")) for folder in (first, second_entry)], None][1])
    for source, target in ((first, second_entry), (second_entry, first)):
        on_root(COMM, lambda source=source, target=target: [source.with_name("other").rename(target), None][1])
    second = run_at(shared_path, "second", FRICTION)
    assert len(factored) == 2 and "is not used: it is not that of K_L" in second
    assert_same_results(shared_path / "second", shared_path / "alone")


def test_a_factor_too_large_for_the_cache_is_not_stored(shared_path, monkeypatch):
    monkeypatch.setattr(cached_factor, "LARGEST", 1000.0)
    assert "the factor is not stored for other runs: its size is" in run_at(shared_path, "first")
    assert on_root(COMM, lambda: list(shared_path.glob("cache/setup-*/factor-*"))) == []


def test_a_full_disk_is_reported(shared_path, monkeypatch):
    monkeypatch.setattr(cached_factor.shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(10, 9, 1))
    assert "the disk has no room for" in run_at(shared_path, "first")
    assert on_root(COMM, lambda: list(shared_path.glob("cache/setup-*/factor-*"))) == []


def test_the_cached_factor_is_not_read_if_memory_is_short(made, shared_path, factored, monkeypatch):
    copy_of(made, shared_path)
    monkeypatch.setattr(cached_factor, "shortage", lambda comm, needed: "short")
    assert NOT_USED not in run_at(shared_path, "second", FRICTION)
    assert len(factored) == 1 and on_root(COMM, factor_folder(shared_path).is_dir)


def test_of_two_runs_that_store_the_factor_at_the_same_time_one_is_stored(shared_path, monkeypatch):
    """Another run stored its factor while this run wrote; a third run was killed earlier."""

    def other_was_faster(path, size):
        checksum = summed(path, size)
        if path.parent.suffix == ".part":
            (path.parent.with_name(f"factor-{COMM.size}") / "x").mkdir(parents=True, exist_ok=True)
        return checksum

    def leave():
        (entry,) = shared_path.glob("cache/setup-*")
        left = entry / f"factor-{COMM.size}-0123456789ab.part"
        left.mkdir()
        os.utime(left, (1e9, 1e9))

    summed = cached_factor.summed
    run_at(shared_path, "first", "response.fields=false")
    folder = factor_folder(shared_path)
    on_root(COMM, lambda: [shutil.rmtree(folder), leave()][1])
    monkeypatch.setattr(cached_factor, "summed", other_was_faster)
    run_at(shared_path, "second", FRICTION)
    left = on_root(COMM, lambda: [path.name for path in shared_path.glob("cache/setup-*/factor-*")])
    assert left == [f"factor-{COMM.size}"] and on_root(COMM, (factor_folder(shared_path) / "x").is_dir)


@pytest.mark.ranks(1)
def test_factors_are_deleted_before_set_ups(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "LARGEST", 3500.0)
    a, b = (tmp_path / f"setup-{letter * 24}" for letter in "ab")
    for i, entry in enumerate((a, b)):
        (entry / "factor-2").mkdir(parents=True)
        (entry / "factor-2" / "of").write_bytes(bytes(1000))
        (entry / "model").write_bytes(bytes(1000))
        os.utime(entry / "model", (1e9 + i, 1e9 + i))
    cache.make_room(tmp_path, a)
    assert sorted(path.name for path in tmp_path.glob("setup-*/*")) == ["factor-2", "model", "model"]
    assert (a / "factor-2").is_dir()
    monkeypatch.setattr(cache, "LARGEST", 1500.0)
    cache.make_room(tmp_path, a)
    assert [*tmp_path.glob("setup-*/*")] == [a / "model"]
