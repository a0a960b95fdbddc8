"""Results for other programs: files checked by their formats, and read by independent programs."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from full_results import LEVELS, MESH, fields, write_full_results
from scipy.io import loadmat
from synthetic_results import branch, no_pairs, pairs_of, write

from microslip.fourier.coefficients import synthesise
from microslip.messages.errors import CaseError
from microslip.results.convert import convert
from microslip.results.joint_cycle import joint_cycle, joint_values
from microslip.results.joint_mesh import joint_mesh
from microslip.results.read import read_results
from microslip.results.universal_file import ELEMENTS


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_full_results(tmp_path_factory.mktemp("kept"), title="<script>alert(1)</script>")


@pytest.fixture(scope="module")
def paraview(path, tmp_path_factory):
    folder = tmp_path_factory.mktemp("paraview")
    return {file.name: file for file in convert(path, folder, ["vtkhdf"], steps=16)}


# -- ParaView -------------------------------------------------------------------------------------------------------------


def test_every_series_is_written(paraview):
    series = [f"{name}_{i:04d}.vtkhdf" for name in ("motion", "joint_motion") for i in range(len(LEVELS))]
    assert sorted(paraview) == sorted(["mode_shapes.vtkhdf", "rest.vtkhdf", "joint.vtkhdf", *series])


def test_steps_have_the_offsets_of_their_values(path, paraview):
    level = read_results(path).levels[1]
    with h5py.File(paraview["motion_0001.vtkhdf"]) as file:
        root, steps = file["VTKHDF"], file["VTKHDF/Steps"]
        assert root.attrs["Type"] == b"UnstructuredGrid" and steps.attrs["NSteps"] == 16
        assert steps["Values"][()] == pytest.approx(np.arange(16) / 16 / level.frequency[30])
        n = len(MESH.points)
        assert np.array_equal(steps["PointDataOffsets/displacement"], np.arange(16) * n)
        assert not steps["PointOffsets"][()].any() and steps["CellOffsets"].shape == (16, 1)
        assert set(steps["CellDataOffsets"]) == set(root["CellData"]) and set(steps["PointDataOffsets"]) == set(root["PointData"])
        u = root["PointData/displacement"][()].reshape(16, n, 3)
    np.testing.assert_allclose(np.moveaxis(u, 0, -1), synthesise(fields().peaks[1].u, 16), atol=1e-5)
    with h5py.File(paraview["mode_shapes.vtkhdf"]) as file:
        assert file["VTKHDF/Steps/Values"][()] == pytest.approx([100.0, 312.5])


def test_the_joint_is_a_separate_mesh_with_a_step_per_level(path, paraview):
    results = read_results(path)
    with h5py.File(paraview["joint.vtkhdf"]) as file:
        root = file["VTKHDF"]
        assert root.attrs["Type"] == b"PolyData" and root["Steps/Values"][()] == pytest.approx(LEVELS)
        assert root["Steps/CellOffsets"].shape == (2, 4) and root["Polygons/NumberOfCells"][0] == 8
        pair, cells = root["CellData/pair"][()].astype(int), root["CellData"]
        at = int(np.argmax(np.hypot(*results.levels[1].response[:, 0, 1:3].T)))
        assert np.array_equal(cells["state"][8:], results.levels[1].state[at][pair])
        np.testing.assert_allclose(cells["friction_loss_J_m2"][8:] / 6.0, results.levels[1].energy[at][pair], rtol=1e-6)
        points, offsets = root["Points"][()], root["Polygons/Offsets"][()]
        area = np.zeros(6)
        for k, own in enumerate(pair):
            corners = points[root["Polygons/Connectivity"][offsets[k] : offsets[k + 1]]]
            area[own] += 0.5 * np.linalg.norm(np.cross(corners[2] - corners[0], corners[3] - corners[1]))
    assert area.sum() == pytest.approx(1.0)  # the whole surface: cells neither overlap nor have gaps


@pytest.mark.slow
def test_vtk_reads_and_renders_the_series(paraview):
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(paraview["motion_0001.vtkhdf"]))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == 16
    reader.SetStep(5)
    reader.Update()
    u = vtk_to_numpy(reader.GetOutput().GetPointData().GetArray("displacement"))
    np.testing.assert_allclose(u, synthesise(fields().peaks[1].u, 16)[:, :, 5], atol=1e-5)
    joint = vtk.vtkHDFReader()
    joint.SetFileName(str(paraview["joint.vtkhdf"]))
    joint.UpdateInformation()
    joint.SetStep(1)
    joint.Update()
    state = joint.GetOutput().GetCellData().GetArray("state")
    with h5py.File(paraview["joint.vtkhdf"]) as file:
        assert np.array_equal(vtk_to_numpy(state), file["VTKHDF/CellData/state"][8:])
    mapper, actor, renderer, window = vtk.vtkPolyDataMapper(), vtk.vtkActor(), vtk.vtkRenderer(), vtk.vtkRenderWindow()
    mapper.SetInputConnection(joint.GetOutputPort())
    mapper.SetScalarModeToUseCellFieldData()
    mapper.SelectColorArray("state")
    actor.SetMapper(mapper)
    renderer.AddActor(actor)
    window.SetOffScreenRendering(True)
    window.SetSize(120, 90)
    window.AddRenderer(renderer)
    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.Update()
    assert vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars()).std() > 1.0


# -- the joint ------------------------------------------------------------------------------------------------------------


def test_forces_and_slip_of_a_cycle_are_those_of_the_law(path):
    """By eq. (1.3): a pair with p = 0 does not slide, its friction force is k_t du, its pressure varies by k_n du_z."""
    results = read_results(path)
    level, joint = results.levels[1], results.joint
    at = 30
    cycle = joint_cycle(joint, level, at)
    moves = level.p[at].any(axis=(1, 2))
    assert moves.any()
    assert not cycle.slip[~moves].any()
    du = synthesise(level.du[at], 128)
    np.testing.assert_allclose(cycle.friction_force[~moves], (joint.k_t[:, None, None] * du[:, :2])[~moves])
    np.testing.assert_allclose(cycle.normal_force, np.maximum(joint.N0[:, None] - joint.k_n[:, None] * du[:, 2], 0.0), rtol=1e-12)
    # p = -1 N cos theta along x: a slider with an amplitude of 1 N / k_t
    np.testing.assert_allclose(cycle.slip_amplitude[moves], 1.0 / joint.k_t[moves])
    values = joint_values(joint, level, at)
    assert values["pressure_min_Pa"] == pytest.approx(cycle.normal_force.min(axis=1) / joint.area)


def test_pairs_without_faces_are_points_and_pairs_without_positions_are_omitted():
    from microslip.results.record import joint_of

    places = np.array([[0.0, 0, 0], [1.0, 0, 0], [np.nan, np.nan, np.nan]])
    mesh = joint_mesh(joint_of(pairs_of(places, np.tile(np.eye(3), (3, 1, 1)), np.ones(3), ("a",) * 3, ()), np.arange(9)))
    assert mesh.sizes.tolist() == [1, 1] and mesh.pair.tolist() == [0, 1]


# -- UNV, MATLAB ----------------------------------------------------------------------------------------------------------


def test_mid_side_nodes_of_quadratic_elements_alternate_with_corners():
    """In UNV a mid-side node is between the two corners of its side, around the bottom and around the top."""
    from microslip.elements import KINDS

    assert ELEMENTS.keys() == KINDS.keys()
    for kind, (_, order) in ELEMENTS.items():
        nodes = KINDS[kind].nodes[list(order)]
        assert set(order) == set(range(KINDS[kind].n_nodes))
        if kind in ("hex20", "wedge15", "tet10", "pyramid13"):
            n = 8 if kind in ("hex20", "pyramid13") else 6
            for ring in (nodes[:n], nodes[-n:]) if kind != "tet10" else (nodes[:n],):
                assert ring[1::2] == pytest.approx((ring[::2] + np.roll(ring[::2], -1, axis=0)) / 2.0)
            top = nodes[-n::2] if kind != "tet10" else nodes[-1:]
            assert nodes[n : n + n // 2] == pytest.approx((nodes[:n:2] + top) / 2.0)


def data_sets(path):
    """Return number and lines of the data sets of a universal file."""
    parts = Path(path).read_text(encoding="ascii").split("    -1\n")
    assert all(part == "" for part in parts[::2])
    return [(int(part.splitlines()[0]), part.splitlines()[1:]) for part in parts[1::2]]


def test_universal_file_by_its_columns(path, tmp_path):
    (file,) = convert(path, tmp_path, ["unv"])
    sets = data_sets(file)
    assert [number for number, _ in sets] == [164, 2411, 2412, 55, 55, 55, 55, 58, 58, 58, 58]
    results = read_results(path)
    nodes = sets[1][1]
    assert [int(line[:10]) for line in nodes[::2]] == MESH.numbers.tolist()
    assert np.array([[float(x.replace("D", "E")) for x in line.split()] for line in nodes[1::2]]) == pytest.approx(MESH.points)
    mode = sets[3][1]
    assert float(mode[7][:13]) == pytest.approx(100.0) and int(mode[8]) == 1001
    assert [float(x) for x in mode[9].split()] == pytest.approx(fields().shapes[0][0], rel=1e-5)
    function = sets[9][1]  # level 2, output 1
    assert function[5][:5].strip() == "4" and int(function[5][42:52]) == MESH.numbers[5] and int(function[5][52:56]) == -3
    level = results.levels[1]
    table = np.array([[float(line[:13]), float(line[13:33]), float(line[33:])] for line in function[11:]])
    np.testing.assert_allclose(table[:, 0], level.frequency, rtol=1e-10)
    np.testing.assert_allclose(
        table[:, 1] - 1j * -table[:, 2], (level.response[:, 0, 1] - 1j * level.response[:, 0, 2]) / 8.0, rtol=1e-11
    )
    assert all(len(line) <= 80 for _, lines in sets for line in lines)


def test_pyuff_reads_the_universal_file(path, tmp_path):
    pyuff = pytest.importorskip("pyuff")
    (file,) = convert(path, tmp_path, ["unv"])
    file_of_sets = pyuff.UFF(str(file))
    sets = file_of_sets.read_sets(
        [i for i, kind in enumerate(file_of_sets.get_set_types()) if kind != 2412]
    )  # it reads no more than 8 nodes
    function = [one for one in sets if one["type"] == 58][2]
    level = read_results(path).levels[1]
    nodes = next(one for one in sets if one["type"] == 2411)
    assert np.stack([nodes["x"], nodes["y"], nodes["z"]], axis=1) == pytest.approx(MESH.points)
    assert function["x"] == pytest.approx(level.frequency, rel=1e-9) and function["rsp_node"] == MESH.numbers[5]
    assert function["data"] == pytest.approx((level.response[:, 0, 1] - 1j * level.response[:, 0, 2]) / 8.0)
    shape = [one for one in sets if one["type"] == 55][1]
    assert shape["freq"] == pytest.approx(312.5) and shape["r2"] == pytest.approx(fields().shapes[1][:, 1], rel=1e-5)


def test_matlab_file_has_all_results(path, tmp_path):
    (file,) = convert(path, tmp_path, ["mat"])
    content, results = loadmat(file, simplify_cells=True), read_results(path)
    level = content["levels"][1]
    assert level["level_N"] == 8.0 and content["title"] == results.title and list(content["outputs"]) == list(results.outputs)
    for name in ("frequency_Hz", "response", "du", "p", "state"):
        assert np.array_equal(level[name], results.levels[1].arrays[name.removesuffix("_Hz")])
    assert level["peak"]["point"] == 31 and np.array_equal(content["joint"]["k_t"], results.joint.k_t)
    assert content["mesh"]["elements"][0]["nodes"].min() == 1 and content["modes"]["shape"].shape == (2, len(MESH.points), 3)


# -- bad input ------------------------------------------------------------------------------------------------------------


def test_unknown_formats_and_results_with_nothing_to_show_are_status_2(path, tmp_path):
    with pytest.raises(CaseError, match="unknown format 'unf'; nearest is unv; formats are vtkhdf, unv, mat and scene"):
        convert(path, tmp_path, ["mat", "unf"])
    without_pairs = write(tmp_path / "bare", [branch(1.0, no_pairs())], no_pairs())
    with pytest.raises(CaseError, match="nothing to show in space"):
        convert(without_pairs, tmp_path, ["vtkhdf"])
    unv, mat = convert(without_pairs, tmp_path, ())
    assert [number for number, _ in data_sets(unv)] == [164, 58] and mat.name == "results.mat"
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(CaseError, match="taken"):
        convert(path, tmp_path / "taken", ["mat"])
