"""Cells that meshio 5.3 reads but does not store: the program completes its table, or refuses them with a message."""

from pathlib import Path

import numpy as np
import pytest

meshio = pytest.importorskip("meshio")

from microslip.formats.read import read_model
from microslip.formats.via_meshio import WHOLE, load_meshio
from microslip.messages.errors import MeshError

DATA = Path(__file__).parents[1] / "data"
KINDS = {"wedge15": 15, "pyramid13": 13}
TABLE = meshio._mesh.topological_dimension


def remove_cells(monkeypatch):
    for kind in KINDS:
        monkeypatch.delitem(TABLE, kind, raising=False)


@pytest.mark.parametrize("kind", KINDS)
def test_quadratic_wedges_and_pyramids_are_read(tmp_path, monkeypatch, kind):
    remove_cells(monkeypatch)
    with pytest.raises(KeyError):
        meshio.CellBlock(kind, np.zeros((0, KINDS[kind]), dtype=np.int64))
    points = np.arange(3.0 * KINDS[kind]).reshape(-1, 3)
    load_meshio().Mesh(points, [(kind, [np.arange(KINDS[kind])])]).write(tmp_path / "one.vtu")
    remove_cells(monkeypatch)
    (cells,) = read_model(tmp_path / "one.vtu").cells
    assert (cells.kind, cells.nodes.shape) == (kind, (1, KINDS[kind]))


def test_a_version_with_these_cells_is_not_changed(monkeypatch):
    remove_cells(monkeypatch)
    monkeypatch.setattr(meshio, "CellBlock", lambda kind, nodes: None)
    load_meshio()
    assert not TABLE.keys() & KINDS.keys()


@pytest.mark.parametrize("ending", ["vtu", "vtk"])
def test_volumes_without_groups_form_one_group(tmp_path, ending):
    points = np.vstack([np.zeros(3), np.eye(3)])
    cells = [("triangle", [[0, 1, 2]]), ("tetra", [[0, 1, 2, 3]])]
    meshio.Mesh(points, cells).write(tmp_path / f"one.{ending}")
    model = read_model(tmp_path / f"one.{ending}")
    (block,) = [i for i, cells in enumerate(model.cells) if cells.kind == "tet4"]
    assert list(model.groups) == [WHOLE] and {i: list(rows) for i, rows in model.groups[WHOLE].cells.items()} == {block: [0]}
    assert any("'all'" in note for note in model.notes)


def test_files_of_vtk_4_may_have_integers_of_vtk_9(tmp_path):
    path = tmp_path / "one.vtk"
    path.write_text(
        "# vtk DataFile Version 4.1\none\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n0 0 0 1 0 0 0 1 0 0 0 1\n"
        "CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\nCELL_DATA 1\nFIELD FieldData 1\npart 1 1 vtktypeint64\n7\n"
    )
    assert list(read_model(path).groups) == ["part=7"]


def test_a_version_without_the_table_is_refused_with_a_message(tmp_path, monkeypatch):
    path = tmp_path / "one.vtu"
    load_meshio().Mesh(np.eye(4)[:, :3], [("tetra", [[0, 1, 2, 3]])]).write(path)
    remove_cells(monkeypatch)
    table = dict(TABLE)
    monkeypatch.setattr(meshio, "CellBlock", lambda kind, nodes: table[kind])
    monkeypatch.delattr(meshio._mesh, "topological_dimension")
    with pytest.raises(MeshError, match=r"meshio [\d.]+ has no cells wedge15; install meshio 5.3"):
        read_model(path)


def test_meshio_drops_the_numbers_of_a_gmsh_file(tmp_path):
    """The reason for a reader of this program: numbers of nodes and elements need not begin with 1."""
    nodes = "4\n11 0 0 0\n12 1 0 0\n13 0 1 0\n14 0 0 1\n"
    elements = "2\n7 4 2 1 1 11 12 13 14\n8 4 2 2 1 11 12 13 14\n"
    names = '2\n3 1 "block"\n3 2 "all"\n'
    path = tmp_path / "m.msh"
    path.write_text(
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n{names}$EndPhysicalNames\n"
        f"$Nodes\n{nodes}$EndNodes\n$Elements\n{elements}$EndElements\n"
    )
    model = read_model(path)
    assert model.numbers.tolist() == [11, 12, 13, 14] and model.cells[0].numbers.tolist() == [7, 8]
    assert {"block", "all"} <= set(model.groups)
    mesh = meshio.read(path, file_format="gmsh")
    data = [*mesh.point_data.values(), *(part for parts in mesh.cell_data.values() for part in parts)]
    assert not any({11, 7} & set(np.ravel(values).tolist()) for values in data)


@pytest.mark.parametrize("name", ["pyvista.vtu", "pyvista_raw.vtu"])
def test_texts_in_field_data_are_ignored(name):
    """pyvista writes texts as field data, which meshio reports as damage."""
    model = read_model(DATA / name)
    (cells,) = model.cells
    assert cells.kind == "hex8" and cells.nodes.tolist() == [list(range(8)), list(range(4, 12))]
    assert set(model.groups) == {"body=1", "body=2"} and model.fields["T"].tolist() == np.repeat([0.0, 1.0, 2.0], 4).tolist()


@pytest.mark.parametrize("kind, letters", [("int", ">i4"), ("unsigned_char", "u1"), ("vtktypeint64", ">i8")])
def test_binary_files_of_vtk_9_with_groups(tmp_path, kind, letters):
    """Format 5.1 as VTK and pyvista write it by default: two tetrahedra with an integer each, and metadata behind arrays."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]], dtype=">f8")
    metadata = b"\nMETADATA\nINFORMATION 0\n\n"
    parts = [b"# vtk DataFile Version 5.1\nvtk output\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n", points.tobytes()]
    parts += [metadata, b"CELLS 3 8\nOFFSETS vtktypeint64\n", np.array([0, 4, 8], dtype=">i8").tobytes()]
    parts += [b"\nCONNECTIVITY vtktypeint64\n", np.array([0, 1, 2, 3, 0, 2, 1, 4], dtype=">i8").tobytes()]
    parts += [b"\nCELL_TYPES 2\n", np.array([10, 10], dtype=">i4").tobytes(), b"\nCELL_DATA 2\nFIELD FieldData 1\n"]
    parts += [f"body 1 2 {kind}\n".encode(), np.array([1, 2], dtype=letters).tobytes(), metadata]
    (tmp_path / "m.vtk").write_bytes(b"".join(parts))
    model = read_model(tmp_path / "m.vtk")
    assert model.cells[0].nodes.tolist() == [[0, 1, 2, 3], [0, 2, 1, 4]] and set(model.groups) == {"body=1", "body=2"}


def test_an_unsupported_compression_is_named(tmp_path):
    path = tmp_path / "one.vtu"
    path.write_bytes((DATA / "pyvista.vtu").read_bytes().replace(b"vtkZLibDataCompressor", b"vtkLZ4DataCompressor"))
    with pytest.raises(MeshError, match="compressed by LZ4.*save it with zlib"):
        read_model(path)
