"""Universal and Exodus files: all solids, groups and sides, damaged files and links to other files."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from plain_model import exodus, plain, unv

from microslip import elements
from microslip.formats.read import read_model
from microslip.messages.errors import CaseError

DATA = Path(__file__).parents[1] / "data"


def check(computed, model):
    np.testing.assert_array_equal(computed.numbers, model.numbers)
    np.testing.assert_allclose(computed.points, model.points, atol=1e-15)
    solids = [cells for cells in computed.cells if cells.kind in elements.KINDS]
    rows = np.concatenate([cells.nodes for cells in solids])
    np.testing.assert_array_equal(rows, np.concatenate(model.elements))
    assert all((elements.jacobian_minimum(cells.kind, computed.points[cells.nodes]) > 0.0).all() for cells in solids)
    for name, nodes in model.sets.items():
        np.testing.assert_array_equal(computed.groups[name].nodes, nodes)
    assert {"bar", "plate"} <= set(computed.groups)


@pytest.mark.parametrize("kind", ["hex8", "hex20", "wedge6", "wedge15", "pyramid5", "tet4", "tet10"])
def test_universal_files_have_nodes_numbers_and_groups(tmp_path, kind):
    (tmp_path / "model.unv").write_text(unv(plain(kind)))
    check(read_model(tmp_path / "model.unv"), plain(kind))


def test_a_universal_file_of_gmsh_is_the_unit_cube():
    model = read_model(DATA / "gmsh_hex20.unv")
    (solid,) = (cells for cells in model.cells if cells.kind == "hex20")
    assert elements.mass("hex20", model.points[solid.nodes], 1.0).sum() == pytest.approx(1.0, rel=1e-12)
    assert {"face", "solid"} <= set(model.groups)


def test_pyuff_reads_neither_groups_nor_large_elements_that_gmsh_writes():
    """The reason for a reader of this program: pyuff reads the second line of nodes of a hex20 as another element."""
    file = pytest.importorskip("pyuff").UFF(str(DATA / "gmsh_hex20.unv"))
    types = list(file.get_set_types())
    assert 2477 in types and list(file.read_sets(types.index(2477))) == ["type"]
    by_descriptor = file.read_sets(types.index(2412))
    assert len(by_descriptor[116][0]["nodes_nums"]) == 8 and {kind for kind in by_descriptor if kind != "type"} > {95, 116}


@pytest.mark.parametrize("hdf5", [False, True])
@pytest.mark.parametrize("kind", ["hex8", "hex20", "wedge6", "wedge15", "pyramid5", "pyramid13", "tet4", "tet10"])
def test_exodus_files_have_nodes_numbers_and_sets(tmp_path, kind, hdf5):
    exodus(plain(kind), tmp_path / "model.e", hdf5)
    model = read_model(tmp_path / "model.e")
    check(model, plain(kind))
    if kind == "hex8":
        assert set(
            np.concatenate([model.cells[i].nodes[rows] for i, rows in model.groups["side set 1"].cells.items()]).ravel()
        ) == set(plain(kind).sets["BAR_BOTTOM"])


def test_empty_blocks_and_sets_of_an_exodus_file_do_not_shift_others(tmp_path):
    model = plain()
    exodus(model, tmp_path / "m.exo", hdf5=True)
    with h5py.File(tmp_path / "m.exo", "r+") as file:
        n = len(model.sets)
        for i in range(n, 0, -1):
            file.move(f"node_ns{i}", f"node_ns{i + 1}")
        file["ns_prop1"] = np.arange(1, n + 2)
        names = np.concatenate([file["ns_names"][:1], file["ns_names"][...]])
        names[0] = np.frombuffer(b"nothing".ljust(33, b"\0"), dtype="S1")
        del file["ns_names"]
        file["ns_names"] = names
        file.move("connect2", "connect3")
        file["eb_prop1"] = np.array([1, 2, 3])
    from_file = read_model(tmp_path / "m.exo")
    assert [len(cells.nodes) for cells in from_file.cells[:2]] == [len(block) for block in model.elements]
    for name, nodes in model.sets.items():
        np.testing.assert_array_equal(from_file.groups[name].nodes, nodes)
    assert len(from_file.groups["nothing"].nodes) == 0


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda text: text[: len(text) // 2], "a data set does not end; the file is truncated"),
        (
            lambda text: text.replace("       102         1         1        11", "       101         1         1        11"),
            "number 101 is given",
        ),
        (lambda text: text.replace("D-02", "X-02", 1), "where numbers are expected"),
        (
            lambda text: text.replace("         1       115         1         1         7         8", "         1       115"),
            "six numbers",
        ),
        (lambda text: text.replace("         8\n", "         9\n", 1), "element 1"),
        (lambda text: "", "the file is empty"),
        (lambda text: "nonsense\n", "holds no nodes"),
    ],
)
def test_damaged_universal_files_are_refused(tmp_path, change, message):
    (tmp_path / "model.unv").write_text(change(unv(plain())))
    with pytest.raises(CaseError, match=f"model.unv: .*{message}"):
        read_model(tmp_path / "model.unv")


def test_exodus_files_that_refer_to_others_or_are_damaged_are_refused(tmp_path):
    path = tmp_path / "model.e"
    exodus(plain(), tmp_path / "other.e", hdf5=True)
    exodus(plain(), path, hdf5=True)
    with h5py.File(path, "a") as file:
        del file["coordx"]
        file["coordx"] = h5py.ExternalLink("other.e", "coordx")
    with pytest.raises(CaseError, match="coordx is a link to other.e; links are not followed"):
        read_model(path)
    with h5py.File(path, "a") as file:
        del file["coordx"]
        file.create_dataset("coordx", (4,), dtype="f8", external=[(str(tmp_path / "raw"), 0, 32)])
    with pytest.raises(CaseError, match="the numbers of coordx lie in another file"):
        read_model(path)
    with h5py.File(path, "a") as file:
        del file["coordx"]
        file.create_dataset("coordx", (10**12,), dtype="f8", chunks=(1000,))
    with pytest.raises(CaseError, match="coordx claims 8000000000000 bytes and holds 0"):
        read_model(path)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(CaseError, match="truncated or damaged"):
        read_model(path)
    path.write_bytes(b"CDF\x01" + b"\xff" * 60)
    with pytest.raises(CaseError, match="model.e: "):
        read_model(path)
    path.write_bytes(b"something else")
    with pytest.raises(CaseError, match="not a NetCDF file"):
        read_model(path)


@pytest.mark.parametrize("kind, n_findings", [(0, 0), (1, 1)])
def test_curvilinear_systems_of_a_universal_file_are_reported(tmp_path, kind, n_findings):
    rows = "".join("   0.0   0.0   0.0\n" for _ in range(4))
    systems = f"    -1\n  2420\n         1\nPart\n         1{kind:10d}         0\nglobal\n{rows}    -1\n"
    (tmp_path / "model.unv").write_text(systems + unv(plain()))
    assert [finding.word for finding in read_model(tmp_path / "model.unv").findings] == ["data set 2420"] * n_findings
