"""Fields and notes of a run in results.h5: read as stored; edited files are checked."""

import h5py
import numpy as np
import pytest
from full_results import MESH, fields, write_full_results
from synthetic_results import branch, two_flanks, write

from microslip.messages.errors import CaseError
from microslip.results.fields import StageRecord, read_fields, read_run, store_fields
from microslip.results.read import read_results


def test_fields_are_read_as_stored(tmp_path):
    path, wanted = write_full_results(tmp_path), fields()
    computed = read_fields(path)
    assert np.array_equal(computed.mesh.points, MESH.points) and np.array_equal(computed.mesh.numbers, MESH.numbers)
    for own, other in zip(computed.mesh.elements, MESH.elements, strict=True):
        assert (own.kind, own.group) == (other.kind, other.group) and np.array_equal(own.nodes, other.nodes)
    np.testing.assert_allclose(computed.shapes, wanted.shapes, rtol=1e-6)
    np.testing.assert_allclose(computed.rest, wanted.rest, rtol=1e-6)
    assert computed.peaks.keys() == wanted.peaks.keys() and computed.peaks[1].point == 30
    np.testing.assert_allclose(computed.peaks[1].u, wanted.peaks[1].u, rtol=1e-6)
    assert computed.output_node == wanted.output_node and np.array_equal(computed.output_direction, wanted.output_direction)
    run = read_run(path)
    assert run.stages == (StageRecord("modes & more", 1.5, 200.0), StageRecord("a part", 1.0, 190.0, 1))
    assert run.notes[1] == "a note </pre><script>"
    assert [len(level.frequency) for level in read_results(path).levels] == [60, 60]


def test_results_without_fields_have_none(tmp_path):
    pairs = two_flanks(2, 1)
    path = write(tmp_path, [branch(8.0, pairs, n_points=3)], pairs)
    before = open(path, "rb").read()
    store_fields(path, None)
    assert open(path, "rb").read() == before
    assert read_fields(path) is None and read_run(path).stages == ()


@pytest.mark.parametrize(
    "name, values, words",
    [
        ("mesh/elements/0000/nodes", np.full((4, 20), 10**6), "names nodes that are not there"),
        ("mesh/elements/0000/nodes", np.zeros((4, 7), dtype=int), "not numbers nx20"),
        ("mesh/points", np.full((57, 3), np.nan), "not finite"),
        ("modes/shape", np.zeros((2, 5, 3)), "not numbers"),
        ("levels/0001/peak/displacement", np.full((57, 3, 7), np.inf), "not finite"),
        ("levels/0001/peak/displacement", np.zeros((57, 3, 4)), "not 2 H . 1"),
        ("outputs/node", np.zeros(9, dtype=int), "not numbers"),
    ],
)
def test_inconsistent_fields_are_rejected(tmp_path, name, values, words):
    path = write_full_results(tmp_path)
    with h5py.File(path, "r+") as file:
        if name == "mesh/points":
            values = np.full(file[name].shape, np.nan)
        elif name.endswith("displacement"):
            values = np.full((len(MESH.points), 3, values.shape[2]), values.flat[0])
        del file[name]
        file[name] = values
    with pytest.raises(CaseError, match=words) as error:
        read_fields(path)
    assert path in str(error.value)


def test_links_to_other_files_and_unknown_elements_are_rejected(tmp_path):
    path = write_full_results(tmp_path)
    with h5py.File(path, "r+") as file:
        del file["mesh/elements/0001/kind"]
        file["mesh/elements/0001/kind"] = "hex27"
    with pytest.raises(CaseError, match="unknown kind, 'hex27'"):
        read_fields(path)
    with h5py.File(path, "r+") as file:
        del file["mesh/points"]
        file["mesh/points"] = h5py.ExternalLink("/etc/passwd", "x")
    with pytest.raises(CaseError, match="link to another"):
        read_fields(path)
