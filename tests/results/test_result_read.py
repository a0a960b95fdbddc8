"""Result files that are damaged, foreign or malicious: one CaseError each, and no other file is opened."""

import h5py
import numpy as np
import pytest
from synthetic_results import branch, two_flanks, write

from microslip.messages.errors import CaseError
from microslip.results.read import read_results


@pytest.fixture
def path(tmp_path):
    pairs = two_flanks(4, 1)
    return write(tmp_path / "run", [branch(8.0, pairs, n_points=5)], pairs)


def replace(path, name, make):
    """Replace a dataset by the result of ``make(group, name)``."""
    with h5py.File(path, "r+") as file:
        group, _, last = name.rpartition("/")
        if name in file:
            del file[name]
        make(file[group or "/"], last)


def refused(path, *words):
    with pytest.raises(CaseError) as error:
        read_results(path)
    text = str(error.value)
    assert path in text and all(word in text for word in words), text
    assert "\n" not in text


def test_missing_file_and_folder(tmp_path):
    refused(str(tmp_path / "none.h5"), "no such file")
    refused(str(tmp_path), "that is a folder; the result file")


@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.7, 0.99])
def test_truncated_file(path, share):
    data = open(path, "rb").read()
    open(path, "wb").write(data[: int(share * len(data))])
    refused(path)


def test_damaged_bytes_are_a_message_or_harmless(path):
    data = bytearray(open(path, "rb").read())
    rng = np.random.default_rng(3)
    for start in rng.integers(100, len(data) - 50, 40):
        damaged = data.copy()
        damaged[start : start + 40] = rng.integers(0, 256, 40, dtype=np.uint8).tobytes()
        open(path, "wb").write(damaged)
        try:
            read_results(path)
        except CaseError as problem:
            assert path in str(problem)


def test_other_kinds_of_files(path, tmp_path):
    (tmp_path / "text.h5").write_text("level_N,point")
    refused(str(tmp_path / "text.h5"), "no HDF5 file")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1.0
    refused(str(tmp_path / "other.h5"), "not one with microslip results")
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = 0
    refused(path, "an older version", "format 0")
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = 99
    refused(path, "a newer version", "format 99")


def test_links_to_other_files_are_rejected(path, tmp_path):
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["x"] = np.ones(5)
    replace(path, "levels/0000/seconds", lambda group, name: group.__setitem__(name, h5py.ExternalLink("../secret.h5", "/x")))
    refused(path, "seconds", "link")


def test_external_groups_are_rejected(path, tmp_path):
    replace(path, "joint", lambda group, name: group.__setitem__(name, h5py.ExternalLink("../secret.h5", "/")))
    refused(path, "joint", "link")


def test_soft_links_are_rejected(path):
    replace(path, "levels/0000/seconds", lambda group, name: group.__setitem__(name, h5py.SoftLink("/levels/0000/input_J")))
    refused(path, "seconds", "link")


@pytest.mark.parametrize("link", [h5py.ExternalLink("../secret.h5", "/x"), h5py.SoftLink("/levels")])
def test_unused_links_are_rejected(path, link):
    with h5py.File(path, "r+") as file:
        file["levels/0000"].create_group("own/deeper")["more"] = link
        file["levels/again"] = file["levels"]  # a cycle
    refused(path, "'levels/0000/own/deeper/more' is a link")


def test_external_storage_is_rejected(path, tmp_path):
    np.ones(5).tofile(tmp_path / "raw")
    replace(
        path,
        "levels/0000/seconds",
        lambda group, name: group.create_dataset(name, (5,), "f8", external=[(str(tmp_path / "raw"), 0, 40)]),
    )
    refused(path, "seconds", "another file")


def test_virtual_datasets_are_rejected(path, tmp_path):
    layout = h5py.VirtualLayout((5,), "f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "x", (5,))
    replace(path, "levels/0000/seconds", lambda group, name: group.create_virtual_dataset(name, layout))
    refused(path, "seconds", "another file")


def test_a_dataset_with_a_false_size_is_rejected(path):
    replace(
        path,
        "levels/0000/response",
        lambda group, name: group.create_dataset(name, (5_000_000_000, 1, 7), "f8", chunks=(1000, 1, 7)),
    )
    refused(path, "response", "claims")


@pytest.mark.parametrize(
    "name, values",
    [
        ("levels/0000/seconds", np.ones(4)),
        ("levels/0000/response", np.ones((5, 1, 6))),
        ("joint/frame", np.ones((3, 3))),
        ("levels/0000/newton", np.array([b"x"] * 5)),
        ("joint/faces/0000", np.full((1, 8), 10**6)),
        ("scene/title", 3.0),
        ("levels/0000/energy_J", None),
    ],
)
def test_wrong_shapes_and_types(path, name, values):
    replace(path, name, lambda group, last: values is None or group.create_dataset(last, data=values))
    refused(path)


def test_nan_is_rejected(path):
    with h5py.File(path, "r+") as file:
        file["levels/0000/response"][2, 0, 1] = np.nan
    refused(path, "response", "not finite")


def test_large_arrays_can_be_omitted(path):
    assert read_results(path, motion=False).levels[0].du is None
    assert read_results(path).levels[0].du is not None


@pytest.mark.parametrize(("name", "value"), [("state", 77), ("harmonics", 10**9), ("newton", -1), ("frequency_Hz", -3.0)])
def test_invalid_values_are_rejected(path, name, value):
    with h5py.File(path, "r+") as file:
        file[f"levels/0000/{name}"][...] = value
    refused(path, name.removesuffix("_Hz"), "of 'levels/0000' cannot be")


@pytest.mark.parametrize(("name", "value"), [("status", "banana"), ("level_N", np.nan)])
def test_invalid_attributes_are_rejected(path, name, value):
    with h5py.File(path, "r+") as file:
        file["levels/0000"].attrs[name] = value
    refused(path, "its attributes of 'levels/0000' cannot be")
