"""VTKHDF files checked by the format: as read by VTK 9.1 and later."""

import h5py
import numpy as np
import pytest
from box_meshes import KINDS, box, mesh_of

from microslip.messages.errors import CaseError
from microslip.results.vtk import peak_fields, write_fields, write_modes

# vtkCellType.h
CELL_TYPES = {"tet4": 10, "hex8": 12, "wedge6": 13, "pyramid5": 14, "tet10": 24, "hex20": 25, "wedge15": 26, "pyramid13": 27}


@pytest.fixture(scope="module")
def mesh():
    return mesh_of(*((f"body_{kind}", kind, *box(kind, n=(1, 1, 2), origin=(2.0 * i, 0, 0))) for i, kind in enumerate(KINDS)))


def test_grid_is_one_piece_with_consistent_counts(tmp_path, mesh):
    path = str(tmp_path / "x.vtkhdf")
    write_fields(path, mesh, {})
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        assert tuple(root.attrs["Version"]) == (2, 1) and root.attrs["Type"] == b"UnstructuredGrid"
        kind = root.attrs.get_id("Type").get_type()
        assert not kind.is_variable_str() and kind.get_cset() == h5py.h5t.CSET_ASCII
        n_points, n_cells, n_ids = (int(root[name][0]) for name in ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds"))
        assert root["Points"].shape == (n_points, 3) and root["Types"].shape == (n_cells,) and root["Types"].dtype == np.uint8
        offsets, ids = root["Offsets"][()], root["Connectivity"][()]
        assert offsets.shape == (n_cells + 1,) and offsets[0] == 0 and offsets[-1] == n_ids == len(ids)
        assert np.array_equal(root["Points"], mesh.points) and ids.max() < n_points
        first = 0
        for block in mesh.elements:
            cells = slice(first, first + len(block.nodes))
            assert set(root["Types"][cells]) == {CELL_TYPES[block.kind]}
            assert np.array_equal(ids[offsets[cells.start] : offsets[cells.stop]], block.nodes.ravel())
            assert np.array_equal(root["CellData/element"][cells], block.numbers)
            first = cells.stop
        assert root["CellData/body"].shape == (n_cells,) and np.array_equal(root["PointData/node"], mesh.numbers)
        assert list(np.unique(root["CellData/body"])) == list(range(len(KINDS)))


def test_modes_are_named_by_number_and_frequency(tmp_path, mesh):
    fields = np.random.default_rng(0).normal(size=(2, len(mesh.points), 3))
    write_modes(str(tmp_path / "modes.vtkhdf"), mesh, 2 * np.pi * np.array([102.34, 12345.6]), fields)
    with h5py.File(tmp_path / "modes.vtkhdf") as file:
        data = file["VTKHDF/PointData"]
        assert sorted(data) == ["mode_01_102.3Hz", "mode_02_12345.6Hz", "node"]
        assert np.array_equal(data["mode_02_12345.6Hz"], fields[1].astype("f4"))


def test_peak_fields_are_mean_cosine_and_sine():
    u = np.arange(2 * 3 * 5.0).reshape(2, 3, 5)
    fields = peak_fields(8.0, 99.6371, u)
    assert list(fields) == ["8N_99.6371Hz_mean", "8N_99.6371Hz_cos1", "8N_99.6371Hz_sin1"]
    assert np.array_equal(fields["8N_99.6371Hz_sin1"], u[:, :, 2])


def test_a_file_that_cannot_be_written_is_status_2(tmp_path, mesh):
    with pytest.raises(CaseError, match="cannot be written"):
        write_fields(str(tmp_path / "none" / "x.vtkhdf"), mesh, {})


def test_vtk_reads_volumes_and_fields(tmp_path, mesh):
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    path = str(tmp_path / "x.vtkhdf")
    write_fields(path, mesh, {"u": mesh.points * [1.0, 2.0, 3.0]})
    reader = vtk.vtkHDFReader()
    reader.SetFileName(path)
    sizes = vtk.vtkCellSizeFilter()
    sizes.SetInputConnection(reader.GetOutputPort())
    sizes.Update()
    grid = sizes.GetOutput()
    volume, body = (vtk_to_numpy(grid.GetCellData().GetArray(name)) for name in ("Volume", "body"))
    for i in range(len(KINDS)):
        assert volume[body == i].sum() == pytest.approx(1.0)
    assert vtk_to_numpy(grid.GetPointData().GetArray("u")) == pytest.approx(mesh.points * [1.0, 2.0, 3.0])
