"""Records on disk: a record is read completely or not at all, for any truncation of a file and any wrong byte."""

import errno
import os
from concurrent import futures

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from microslip.messages.errors import CaseError, ResourceError
from microslip.restart import records
from microslip.restart.records import Disk, Journal, Latest, length_of, pack, read_record, read_records, unpack, write_record

ARRAYS = {"U": np.arange(24.0).reshape(4, 3, 2), "selected": np.array([True, False]), "n": np.array(3), "none": np.zeros((0, 2))}


@settings(derandomize=True, max_examples=50)
@given(npst.arrays(st.sampled_from(["f8", "i8", "u1", "?", "c16"]), npst.array_shapes(min_dims=0, min_side=0)))
def test_arrays_and_texts_are_read_bit_for_bit(values):
    body = pack({"a/b": values}, {"notes": ["é\n", ""], "n": 3})[records._FRAME.size :]
    arrays, texts = unpack(body)
    assert texts == {"notes": ["é\n", ""], "n": 3}
    assert arrays["a/b"].dtype == values.dtype and arrays["a/b"].shape == values.shape
    assert arrays["a/b"].tobytes() == values.tobytes()


def test_a_truncated_file_has_the_records_before_its_end(tmp_path):
    whole = [pack({"i": np.array(i)}, {"i": i}) for i in range(3)]
    path, ends = tmp_path / "journal", np.cumsum([0, *map(len, whole)])
    for cut in range(ends[-1] + 1):
        path.write_bytes(b"".join(whole)[:cut])
        records = read_records(path)
        assert [unpack(body)[1]["i"] for body in records] == list(range(np.searchsorted(ends, cut, side="right") - 1))
        assert length_of(records) == ends[len(records)]


def test_a_wrong_byte_anywhere_is_detected(tmp_path):
    path, record = tmp_path / "record", pack(ARRAYS, {"of": "this"})
    for i in range(len(record)):
        path.write_bytes(record[:i] + bytes([record[i] ^ 0x10]) + record[i + 1 :])
        assert read_record(path) is None


def test_a_record_longer_than_the_file_is_not_read(tmp_path):
    path = tmp_path / "record"
    path.write_bytes(records._FRAME.pack(10**15, 0) + b"few")
    assert read_records(path) == []


def test_shapes_and_types_that_do_not_match_the_bytes_are_rejected():
    body = pack({"a": np.zeros(4)})[records._FRAME.size :]
    for old, new in ((b"[4]", b"[5]"), (b"<f8", b"|O8")):
        with pytest.raises((ValueError, TypeError)):
            unpack(body.replace(old, new))


def test_a_journal_continues_after_its_last_complete_record(tmp_path):
    path = tmp_path / "points"
    journal = Journal(path)
    journal.append(ARRAYS)
    journal.append(ARRAYS, {"second": True})
    journal.close()
    with open(path, "ab") as file:
        file.write(b"the process was killed while it wrote this")
    records = read_records(path)
    journal = Journal(path, keep=length_of(records[:1]))
    journal.append({}, {"instead": True})
    journal.close()
    journal.close()
    assert [unpack(body)[1] for body in read_records(path)] == [{}, {"instead": True}]


def test_the_latest_record_is_complete_while_the_next_is_written(tmp_path):
    path = tmp_path / "state"
    latest = Latest(path)
    assert latest.read() == []
    for i in range(5):
        latest.write({"i": np.array(i)})
    latest.close()
    assert [int(arrays["i"]) for arrays, _ in Latest(path).read()] == [4, 3]
    (tmp_path / "state.0").write_bytes(pack({"i": np.array(6)})[:-1])  # killed while writing the next record
    reopened = Latest(path)
    assert [int(arrays["i"]) for arrays, _ in reopened.read()] == [3]
    reopened.write({"i": np.array(4)})
    reopened.close()
    assert [int(arrays["i"]) for arrays, _ in Latest(path).read()] == [4, 3]


def test_waiting_for_the_disk_is_a_small_part_of_the_time(tmp_path, monkeypatch):
    now, waits = [0.0], []

    def wait(handle):
        waits.append(now[0])
        now[0] += 0.02

    monkeypatch.setattr(os, "fsync", wait)
    monkeypatch.setattr(records, "monotonic", lambda: now[0])
    monkeypatch.setattr(records, "perf_counter", lambda: now[0])
    disk, handle = Disk(), os.open(tmp_path, os.O_RDONLY)
    while now[0] < 60.0:
        disk.sync(handle)
        disk.wait()
        now[0] += 0.1
    assert len(waits) == 10 and np.diff(waits).min() > 300 * 0.02  # at first, and then every six seconds
    os.close(handle)


def test_parts_of_a_record_belong_to_it(tmp_path):
    """A file whose beginning was written over the record before the last is not complete."""
    path, parts = tmp_path / "state", [pack({"U": np.full(3, float(i))}) for i in range(4)]
    latest = Latest(path)
    for i in range(3):
        latest.write({"i": np.array(i)}, {"now": parts[i + 1], "before": parts[i]})
    latest.close()
    (computed, _), (other, _) = Latest(path).read()
    assert [computed["i"], *computed["now/U"], *computed["before/U"]] == [2, 3, 3, 3, 2, 2, 2] and other["before/U"][0] == 1.0
    newest, older = tmp_path / "state.0", tmp_path / "state.1"
    head = len(newest.read_bytes()) - 2 * len(parts[0])
    older.write_bytes(newest.read_bytes()[:head] + older.read_bytes()[head:])
    assert [int(arrays["i"]) for arrays, _ in Latest(path).read()] == [2]


def test_a_failing_disk_is_reported_with_the_next_record(tmp_path, monkeypatch):
    def fail(handle):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    disk = Disk()
    journal = Journal(tmp_path / "points", disk=disk)
    monkeypatch.setattr(os, "fsync", fail)
    journal.append({}, {"i": 0})
    futures.wait(disk._pending)
    with pytest.raises(ResourceError, match="points: could not be written: Input/output error"):
        journal.append({}, {"i": 1})
    journal.close()
    with pytest.raises(OSError):
        disk.wait()


def test_a_record_that_cannot_be_written_names_the_file(tmp_path):
    with pytest.raises(CaseError, match="record: cannot be written"):
        write_record(tmp_path / "nowhere" / "record", {})
    with pytest.raises(CaseError, match="points: cannot be written"):
        Journal(tmp_path / "nowhere" / "points")


def test_files_are_synchronised_without_a_thread(tmp_path, monkeypatch):
    def refuse(*_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("microslip.restart.records.ThreadPoolExecutor.submit", refuse)
    synced = []
    monkeypatch.setattr("microslip.restart.records.os.fsync", synced.append)
    journal = Journal(tmp_path / "points")
    journal.append({"x": np.arange(3)})
    journal.close()
    assert len(synced) == 2 and len(read_records(tmp_path / "points")) == 1
