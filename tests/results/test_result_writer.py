"""frf.csv and results.h5: all results are written, as soon as they are computed."""

import csv
import dataclasses
import errno
import io
import os

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from synthetic_results import TITLE, branch, head, no_pairs, two_flanks, write, writer_of

from microslip.messages.errors import CaseError, ResourceError
from microslip.results import table
from microslip.results import writer as writer_module
from microslip.results.read import read_results
from microslip.results.table import ResponseTable
from microslip.results.writer import ResultWriter

HEADER = (
    "level_N,point,frequency_Hz,output,amplitude_m,phase_rad,mean_m,sticking,slipping,open,unknowns,newton,"
    "friction_J,damping_J,input_J,seconds,error_m,error_modes_m,error_harmonics_m,error_samples_m,error_pairs_m,error_solver_m,error_sliders_m,segment,unit,"
    "amplitude_corrected_m,phase_corrected_rad,error_corrected_m,stable,largest_multiplier,multiplier_real,multiplier_imaginary,neutral_sliders"
)


@pytest.fixture(scope="module")
def pairs():
    return two_flanks(4, 1)


def rows_of(folder):
    with open(folder / "frf.csv", encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_every_point_has_a_row_per_output(tmp_path, pairs):
    curve = branch(5.0, pairs, n_outputs=2, n_points=5)
    write(tmp_path, [curve], pairs, outputs=("tip", "mid, at \u00bd"))
    assert (tmp_path / "frf.csv").read_text(encoding="utf-8").splitlines()[0] == HEADER
    rows = rows_of(tmp_path)
    assert [(row["point"], row["output"]) for row in rows[:3]] == [("0", "tip"), ("0", "mid, at \u00bd"), ("1", "tip")]
    assert len(rows) == 10
    point, row = curve.points[2], rows[5]
    assert float(row["frequency_Hz"]) == pytest.approx(point.omega / 2 / np.pi, rel=1e-12)
    mean, c, s = point.response[1, :3]
    a, angle = float(row["amplitude_m"]), float(row["phase_rad"])
    assert (a * np.cos(angle), -a * np.sin(angle)) == pytest.approx((c, s), rel=1e-9)
    assert float(row["mean_m"]) == pytest.approx(mean, rel=1e-12)
    assert [int(row[name]) for name in ("sticking", "slipping", "open")] == [np.sum(point.state == k) for k in range(3)]
    assert float(row["input_J"]) == pytest.approx(point.input, rel=1e-12)


def test_a_point_is_on_the_disk_before_the_next_is_solved(tmp_path, pairs):
    curve = branch(5.0, pairs, n_points=3)
    writer = writer_of(tmp_path, pairs)
    writer.level_started(0, 5.0)
    for i, point in enumerate(curve.points):
        writer.point(0, i, point)
        assert len(rows_of(tmp_path)) == i + 1
    writer.close()


def test_result_file_has_all_results(tmp_path, pairs):
    curves = [branch(level, pairs, n_points=6) for level in (1.0, 8.0)]
    results = read_results(write(tmp_path, curves, pairs))
    assert results.title == TITLE and results.scene_text == head(pairs).scene_text and results.method == "adaptive"
    assert results.options == ("-hb_snes_max_it", "30") and results.versions["numpy"] == np.__version__
    assert results.mode_frequency == pytest.approx([100.0, 312.5])
    assert [level.level for level in results.levels] == [1.0, 8.0]
    for level, expected in zip(results.levels, curves):
        assert level.status == "complete" and level.failure == ""
        assert level.frequency == pytest.approx([point.omega / 2 / np.pi for point in expected.points], rel=1e-15)
        for name, of_point in (
            ("response", "response"),
            ("du", "U"),
            ("p", "p"),
            ("energy", "energy"),
            ("state", "state"),
            ("unknowns", "unknowns"),
            ("seconds", "seconds"),
            ("input", "input"),
        ):
            assert np.array_equal(getattr(level, name), [getattr(point, of_point) for point in expected.points]), name
    joint = results.joint
    assert joint.names == ("dovetail",) and np.array_equal(joint.frame, pairs.frame) and np.array_equal(joint.area, pairs.area)
    assert joint.node1[0] == 1001 and np.array_equal(joint.faces[0], pairs.faces[0])


def test_layout_of_the_result_file_is_as_documented(tmp_path, pairs):
    write(tmp_path, [branch(5.0, pairs, n_points=4)], pairs)
    with h5py.File(tmp_path / "results.h5") as file:
        level = file["levels/0000"]
        n_pairs = pairs.n_pairs
        shapes = {
            "frequency_Hz": (4,),
            "response": (4, 1, 7),
            "du": (4, n_pairs, 3, 7),
            "p": (4, n_pairs, 3, 7),
            "energy_J": (4, n_pairs),
            "state": (4, n_pairs),
            "seconds": (4,),
        }
        assert {name: level[name].shape for name in shapes} == shapes
        assert level.attrs["level_N"] == 5.0 and level.attrs["status"] == "complete"
        assert file["modes/frequency_Hz"].shape == (2,) and file["joint/position"].shape == (n_pairs, 3)


def test_a_stopped_level_has_its_points_and_the_reason(tmp_path, pairs):
    curve = branch(8.0, pairs, n_points=4)
    curve.failure = "hb: no convergence beyond 100.1 Hz"
    empty = branch(9.0, pairs, n_points=4)
    empty.points.clear()
    empty.failure = "hb: no convergence at the first frequency"
    levels = read_results(write(tmp_path, [curve, empty], pairs)).levels
    assert [(level.status, level.failure) for level in levels] == [("failed", curve.failure), ("failed", empty.failure)]
    assert [len(level.frequency) for level in levels] == [4, 0]
    assert levels[1].du.shape == (0, pairs.n_pairs, 3, 7)


def test_incomplete_levels_are_listed(tmp_path, pairs):
    requested = dataclasses.replace(head(pairs), requested=(1.0, 8.0, 9.0))
    curve, stopped = branch(1.0, pairs, n_points=4), branch(8.0, pairs, n_points=4)
    stopped.failure = "hb: no convergence beyond 100.1 Hz"
    writer, missing = ResultWriter(MPI.COMM_SELF, str(tmp_path), requested, 7), []
    for number, level in enumerate((curve, stopped, branch(9.0, pairs, n_points=4))):
        writer.level_started(number, level.level)
        for i, point in enumerate(level.points):
            writer.point(number, i, point)
        writer.save()
        missing.append(read_results(writer.path).missing)
        writer.level_finished(number, level)
    writer.close()
    assert missing == [(1.0, 8.0, 9.0), (8.0, 9.0), (9.0,)] and read_results(writer.path).missing == ()
    assert read_results(write(tmp_path / "earlier", [curve], pairs)).missing == ()


def test_a_level_in_progress_can_be_saved_and_is_replaced_at_its_end(tmp_path, pairs):
    curve = branch(8.0, pairs, n_points=4)
    writer = writer_of(tmp_path, pairs)
    writer.save()
    writer.level_started(0, 8.0)
    for i, point in enumerate(curve.points):
        writer.point(0, i, point)
        if i == 1:
            writer.save()
            (level,) = read_results(writer.path).levels
            assert level.status == "running" and len(level.frequency) == 2
    writer.level_finished(0, curve)
    writer.close()
    (level,) = read_results(writer.path).levels
    assert level.status == "complete" and len(level.frequency) == 4


def test_a_scene_without_joint_or_linear_curve(tmp_path):
    results = read_results(write(tmp_path, [branch(1.0, no_pairs(), n_points=3)], no_pairs(), linear=False))
    assert results.joint.n_pairs == 0 and results.joint.names == () and results.linear is None
    assert results.levels[0].state.shape == (3, 0)


def test_texts_with_zero_bytes_and_unicode_are_stored(tmp_path):
    results = read_results(write(tmp_path, [], no_pairs(), title="a\0b \u4e2d $x$", outputs=("\u00fc",)))
    assert results.title == "a\ufffdb \u4e2d $x$" and results.outputs == ("\u00fc",)


def test_an_interrupted_write_leaves_the_previous_file(tmp_path, pairs, monkeypatch):
    curve = branch(8.0, pairs, n_points=3)
    path = write(tmp_path, [curve], pairs)
    before = open(path, "rb").read()
    writer = writer_of(tmp_path / "other", pairs)
    os.replace(path, writer.path)
    writer.level_started(0, 9.0)

    def dies(group, level, unit):
        group.create_dataset("half", data=1.0)
        raise KeyboardInterrupt

    monkeypatch.setattr(writer_module, "write_level", dies)
    with pytest.raises(KeyboardInterrupt):
        writer.save()
    writer.close()
    assert open(writer.path, "rb").read() == before
    assert sorted(os.listdir(tmp_path / "other")) == ["frf.csv", "results.h5"]


class Filling(io.FileIO):
    """A file on a full disk that accepts half of the next write."""

    has_room = True

    def write(self, data):
        if self.has_room:
            return super().write(data)
        super().write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_leaves_complete_rows(tmp_path, monkeypatch, pairs):
    monkeypatch.setattr(table, "open", lambda path, *_, **__: Filling(path, "w"), raising=False)
    rows = ResponseTable(str(tmp_path), ("a", "b"), ("m", "m"))
    point = branch(1.0, pairs, n_points=1, n_outputs=2).points[0]
    rows.add(1.0, 0, point)
    before = (tmp_path / "frf.csv").read_bytes()
    rows._file.has_room = False
    with pytest.raises(ResourceError, match=r"frf\.csv: could not be written: No space left"):
        rows.add(1.0, 1, point)
    assert (tmp_path / "frf.csv").read_bytes() == before and before.count(b"\n") == 3


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_is_status_4(tmp_path, pairs):
    os.symlink("/dev/full", tmp_path / "frf.csv")
    with pytest.raises(ResourceError, match="frf.csv.*No space left"):
        writer_of(tmp_path, pairs)


def test_an_impossible_folder_is_status_2(tmp_path, pairs):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(CaseError, match="taken.*cannot be written"):
        writer_of(tmp_path / "taken" / "results", pairs)


def test_zeros_of_stuck_pairs_need_no_storage(tmp_path):
    pairs = two_flanks()
    path = write(tmp_path, [branch(0.5, pairs, n_points=98)], pairs, comm=MPI.COMM_SELF)
    with h5py.File(path) as file:
        p = file["levels/0000/p"]
        assert p.id.get_storage_size() < 0.02 * p.nbytes
