"""Mesh files: every format gives the same mesh with the numbers of the user, and each fault one message."""

import numpy as np
import pytest
from box_meshes import EDGES, KINDS, box, joint, settings

from microslip.formats.read import read_model
from microslip.formats.via_meshio import load_meshio
from microslip.mesh.read import read_mesh
from microslip.messages.errors import CaseError, MeshError

meshio = load_meshio()
MESHIO = {
    "tet4": "tetra",
    "tet10": "tetra10",
    "hex8": "hexahedron",
    "hex20": "hexahedron20",
    "wedge6": "wedge",
    "wedge15": "wedge15",
    "pyramid5": "pyramid",
    "pyramid13": "pyramid13",
}


def meshio_box(kind):
    """Return a box as a mesh of meshio, with a separate cell block for the points of the group ``bottom``."""
    points, elements = box(kind, (2, 1, 3), (2.0, 1.0, 3.0))
    bottom = np.flatnonzero(points[:, 2] == 0.0)[:, None]
    cells = [("vertex", bottom), (MESHIO[kind], elements)]
    tags = [np.full(len(bottom), 5), np.full(len(elements), 7)]
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    names = {"bottom": np.array([5, 0]), "block": np.array([7, 3])}
    dims = np.where(np.isin(np.arange(len(points)), bottom)[:, None], [0, 5], [3, 7])
    return meshio.Mesh(points, cells, cell_data=data, field_data=names, point_data={"gmsh:dim_tags": dims})


def settings_of(path, scale=1.0):
    return settings({"block": "block"}, [("bottom", ["x", "y", "z"])], file=path, scale=scale)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("file_format, binary", [("gmsh22", False), ("gmsh22", True), ("gmsh", False), ("gmsh", True)])
def test_gmsh_formats_give_vtk_order_and_groups(tmp_path, kind, file_format, binary):
    written = meshio_box(kind)
    path = tmp_path / "box.msh"
    meshio.write(path, written, file_format=file_format, binary=binary)
    mesh = read_mesh(settings_of(path, scale=1e-3))
    assert [(block.kind, block.group) for block in mesh.elements] == [(kind, "block")]
    order = mesh.numbers - 1  # version 4.1 writes nodes by entity
    np.testing.assert_allclose(mesh.points, 1e-3 * written.points[order], atol=1e-15)
    np.testing.assert_array_equal(order[mesh.elements[0].nodes], written.cells[1].data)
    np.testing.assert_array_equal(mesh.node_groups["bottom"], np.flatnonzero(mesh.points[:, 2] == 0.0))


@pytest.mark.parametrize("ending", [".vtu", ".vtk", ".bdf"])
def test_other_formats_give_the_same_mesh(tmp_path, ending):
    points, elements = box("hex20", (2, 1, 3), (2.0, 1.0, 3.0))
    array = "nastran:ref" if ending == ".bdf" else "part"
    path = tmp_path / f"box{ending}"
    written = meshio.Mesh(points, [("hexahedron20", elements)], cell_data={array: [np.full(len(elements), 7)]})
    meshio.write(path, written)
    group = "7" if ending == ".bdf" else "part=7"
    mesh = read_mesh(settings({"block": group}, file=path))
    np.testing.assert_allclose(mesh.points, points, atol=1e-12)
    np.testing.assert_array_equal(mesh.elements[0].nodes, elements)


def test_nastran_numbers_and_properties_are_read(tmp_path):
    path = tmp_path / "box.bdf"
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    lines = [f"GRID,{10 * i},0,{x}.,{y}.,{z}." for i, (x, y, z) in enumerate(corners, 1)]
    lines += ["PSOLID,3,1", "CTETRA,77,3,10,20,30,40", "CTRIA3,78,3,10,30,20"]
    path.write_text("\n".join(lines))
    mesh = read_mesh(settings({"block": "volume 3"}, [("surface 3", ["x"])], file=path))
    assert mesh.numbers.tolist() == [10, 20, 30, 40] and mesh.elements[0].numbers.tolist() == [77]
    assert mesh.numbers[mesh.node_groups["surface 3"]].tolist() == [10, 20, 30]


ABAQUS = """*HEADING
** two elements of two kinds, numbered as a user would
*NODE, NSET=all
 10, 0, 0, 0
 20, 1, 0, 0
 30, 1, 1, 0
 40, 0, 1, 0
 50, 0, 0, 1
 60, 1, 0, 1
 70, 1, 1, 1
 80, 0, 1, 1
 90, 2, 0, 0
100, 2, 0, 1
*Element, type=C3D8R, elset=Block
 5, 10, 20, 30, 40,
 50, 60, 70, 80
*ELEMENT, TYPE=C3D6, ELSET=Wedge
 6, 20, 90, 30, 60, 100, 70
*ELEMENT, TYPE=SPRINGA, ELSET=springs
 99, 10, 20
*ELSET, ELSET=both
 block, Wedge
*NSET, NSET=low, GENERATE
 10, 40, 10
*NSET, NSET=of_wedge, ELSET=Wedge
*SURFACE, NAME=top, TYPE=ELEMENT
 Block, S2
 6, S2
*STEP
"""


def test_abaqus_sets_surfaces_and_numbers_are_read(tmp_path):
    path = tmp_path / "box.inp"
    path.write_text(ABAQUS)
    mesh = read_mesh(settings({"all": "both"}, [("low", ["x"])], file=path))
    assert {block.kind: block.numbers.tolist() for block in mesh.elements} == {"hex8": [5], "wedge6": [6]}
    assert mesh.numbers[mesh.node_groups["low"]].tolist() == [10, 20, 30, 40]
    assert mesh.numbers[mesh.node_groups["of_wedge"]].tolist() == [20, 30, 60, 70, 90, 100]
    assert {block.kind: mesh.numbers[block.nodes].tolist() for block in mesh.faces if block.group == "top"} == {
        "quad4": [[50, 60, 70, 80]],
        "tri3": [[60, 100, 70]],
    }
    assert any("SPRINGA" in note for note in mesh.notes)


def test_abaqus_quadratic_surface_has_its_mid_sides(tmp_path):
    points, elements = box("tet10", (1, 1, 1))
    path = tmp_path / "tet.inp"
    lines = ["*NODE"] + [f"{i}, " + ", ".join(map(str, point)) for i, point in enumerate(points, 1)]
    lines += ["*ELEMENT, TYPE=C3D10, ELSET=block"]
    lines += [f"{i}, " + ", ".join(map(str, row + 1)) for i, row in enumerate(elements, 1)]
    for face in (1, 2, 3, 4):
        lines += [f"*SURFACE, NAME=s{face}", f"1, S{face}"]
    path.write_text("\n".join(lines))
    mesh = read_mesh(settings({"block": "block"}, file=path))
    for block in mesh.faces:
        corners, mid = block.nodes[0, :3], block.nodes[0, 3:]
        ends = mesh.points[corners], mesh.points[np.roll(corners, -1)]
        np.testing.assert_allclose(mesh.points[mid], (ends[0] + ends[1]) / 2)
    assert len(mesh.faces) == 4


MSH = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
2 1 "base"
3 2 "block"
3 3 "spare part"
$EndPhysicalNames
$Entities
0 0 1 2
7 0 0 0 1 1 0 1 1 0
1 0 0 0 1 1 1 1 2 0
2 0 0 0 1 1 1 1 3 0
$EndEntities
$Nodes
1 6 11 77
3 1 0 6
77
11
22
33
44
55
9 9 9
0 0 0
1 0 0
0 1 0
0 0 1
1 1 1
$EndNodes
$Elements
3 3 1 9
2 7 2 1
1 11 33 22
3 1 4 1
8 11 22 33 44
3 2 4 1
9 22 33 44 55
$EndElements
"""


def read_text(tmp_path, text, name="box.msh", bodies=None, **more):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_mesh(settings(bodies or {"block": "block"}, file=tmp_path / name, **more))


def test_numbers_are_those_of_the_file_and_unused_elements_and_nodes_are_noted(tmp_path):
    mesh = read_text(tmp_path, MSH)
    assert mesh.numbers.tolist() == [11, 22, 33, 44]
    assert mesh.elements[0].numbers.tolist() == [8]
    assert mesh.numbers[mesh.node_groups["base"]].tolist() == [11, 22, 33]
    assert mesh.faces[0].kind == "tri3" and mesh.faces[0].group == "base"
    assert "'spare part' belong to no body" in mesh.notes[0] and "2 nodes" in mesh.notes[1]


def test_comments_may_precede_the_format(tmp_path):
    (tmp_path / "m.msh").write_text("$Comments\na block\n$EndComments\n" + MSH)
    (tmp_path / "n.msh").write_text(MSH)
    commented, plain = (read_model(tmp_path / name) for name in ("m.msh", "n.msh"))
    np.testing.assert_array_equal(commented.points, plain.points)
    assert list(commented.groups) == list(plain.groups)


def test_an_element_in_two_groups_is_read_once(tmp_path):
    twice = """$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n3 1 "block"\n3 2 "all"\n$EndPhysicalNames
$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes
$Elements\n3\n1 15 2 9 9 1\n2 4 2 1 1 1 2 3 4\n3 4 2 2 1 1 2 3 4\n$EndElements\n"""
    mesh = read_text(tmp_path, twice)
    assert [block.numbers.tolist() for block in mesh.elements] == [[2]]
    assert mesh.notes == ()
    with pytest.raises(MeshError, match="tet4 element 2 belongs to body 'block' and to body 'other'"):
        read_text(tmp_path, twice, bodies={"block": "block", "other": "all"})


BAD = {
    "truncated in the nodes": (MSH[: MSH.index("9 9 9")], r"truncated: \$Nodes is not closed by \$EndNodes"),
    "truncated before the elements": (MSH[: MSH.index("$Elements")], r"no \$Elements section"),
    "empty": ("", r"the file is empty"),
    "not a mesh": ("<html>404</html>", r"not a Gmsh file"),
    "version": (MSH.replace("4.1 0 8", "4 0 8"), r"Gmsh format 4 is not read, only 2.2 and 4.1"),
    "NaN": (MSH.replace("0 1 0\n0 0 1\n1", "0 nan 0\n0 0 1\n1"), r"1 of 6 nodes .* first is node 33 at \(0, nan, 0\)"),
    "word for a number": (MSH.replace("9 9 9", "9 oops 9"), r"'oops' where a number is expected"),
    "missing node": (MSH.replace("8 11 22 33 44", "8 11 22 33 66"), "element 8 names node 66, which the file does not hold"),
    "double node": (MSH.replace("\n77\n11", "\n55\n11"), r"node number 55 more than once"),
    "too few numbers": (MSH.replace("3 2 4 1\n", "3 2 4 2\n"), r"announces more than it holds"),
    "too many numbers": (MSH.replace("3 3 1 9", "2 3 1 9"), r"\$Elements holds more than it announces"),
    "too many announced": (MSH.replace("1 6 11 77", "1 7 11 77"), r"announces 7 nodes and holds 6"),
    "high order": (MSH.replace("3 1 4 1\n", "3 1 29 1\n"), r"element type 29, of order 3 or higher"),
}


@pytest.mark.parametrize("text, message", BAD.values(), ids=BAD.keys())
def test_a_bad_gmsh_file_gives_one_message(tmp_path, text, message):
    with pytest.raises(MeshError, match=message) as caught:
        read_text(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "box.msh"))


@pytest.mark.parametrize("is_binary", [False, True])
@pytest.mark.parametrize("file_format", ["gmsh22", "gmsh"])
def test_every_truncation_is_refused(tmp_path, file_format, is_binary):
    path = tmp_path / "box.msh"
    meshio.write(path, meshio_box("hex8"), file_format=file_format, binary=is_binary)
    content = path.read_bytes()
    for n_bytes in range(0, len(content) - 20, 97):
        with pytest.raises(MeshError):
            read_text(tmp_path, content[:n_bytes])


@pytest.mark.parametrize("name", ["box.vtu", "box.vtk", "box.bdf", "box.inp"])
@pytest.mark.parametrize("text", ["", "nonsense\n", "*NODE\n1, 0, zero, 0\n*ELEMENT, TYPE=C3D4\n1, 1, 2\n"])
def test_bad_files_of_other_formats_are_refused_without_output(tmp_path, name, text, capsys):
    with pytest.raises(MeshError, match=name):
        read_text(tmp_path, text, name)
    assert capsys.readouterr() == ("", "")


def test_unknown_endings_and_missing_files_are_refused(tmp_path):
    with pytest.raises(CaseError, match=r"the ending '.stl' is not known; known are .msh, .inp, .cdb"):
        read_text(tmp_path, "", "box.stl")
    with pytest.raises(CaseError, match="there is no file"):
        read_mesh(settings({"block": "block"}, file=tmp_path / "none.msh"))


def test_unknown_groups_are_refused_with_the_nearest_name(tmp_path):
    with pytest.raises(MeshError, match=r"\[bodies.blade\] group = 'Blok': .* nearest is 'block'; it has: base, block"):
        read_text(tmp_path, MSH, bodies={"blade": "Blok"})
    with pytest.raises(MeshError, match=r"\[\[supports\]\] 1 group = 'bass'.*nearest is 'base'"):
        read_text(tmp_path, MSH, supports=[("bass", ["x"])])
    with pytest.raises(MeshError, match=r"\[\[joints\]\] 'dovetail' surfaces = 'root'"):
        read_text(tmp_path, MSH, joints=[joint("dovetail", ("base", "root"))])


def test_groups_of_the_wrong_type_are_refused(tmp_path):
    with pytest.raises(MeshError, match=r"\[bodies.block\] group = 'base' holds no volume elements \(1 tri3\)"):
        read_text(tmp_path, MSH, bodies={"block": "base"})
    with pytest.raises(MeshError, match=r"'base': no node of this group belongs to an element of a body"):
        far = MSH.replace("1 11 33 22", "1 77 77 77")
        read_text(tmp_path, far, supports=[("base", ["x"])])
    with pytest.raises(MeshError, match=r"1 tet4 elements, the first of them element 9, are in no named group"):
        read_text(tmp_path, MSH.replace("1 1 1 1 3 0", "1 1 1 0 0"))


def test_an_unsupported_kind_is_refused_with_the_supported_ones(tmp_path):
    path = tmp_path / "hexahedron.vtk"
    points = np.random.default_rng(0).random((27, 3))
    meshio.write(path, meshio.Mesh(points, [("hexahedron27", np.arange(27)[None])], cell_data={"part": [np.array([1])]}))
    with pytest.raises(MeshError, match=r"holds 1 element of kind hex27, which is not supported \(supported: tet4"):
        read_mesh(settings({"block": "part=1"}, file=path))


def test_boxes_of_quadratic_kinds_have_midside_nodes_at_the_middle():
    for kind, edges in EDGES.items():
        points, elements = box(kind)
        mid = elements[:, -len(edges) :]
        np.testing.assert_allclose(points[elements[:, edges]].mean(axis=2), points[mid])


@pytest.mark.parametrize("how", [("gmsh22", False), ("gmsh22", True), ("gmsh", False), ("gmsh", True), ("vtu", True)], ids=str)
def test_scalar_fields_of_nodes_are_read(tmp_path, how):
    """Fields with one number per node are read; vectors are ignored."""
    file_format, binary = how
    written = meshio_box("hex8")
    heat = np.sin(np.arange(len(written.points))) * 1e7
    written.point_data |= {"heat": heat, "flow": np.ones((len(heat), 3))}
    path = tmp_path / ("box.vtu" if file_format == "vtu" else "box.msh")
    if file_format == "vtu":
        written.point_data.pop("gmsh:dim_tags")
        part = [np.full(len(block.data), 7) for block in written.cells]
        vtu = meshio.Mesh(written.points, written.cells, cell_data={"part": part}, point_data=written.point_data)
        meshio.write(path, vtu)
        mesh = read_mesh(settings({"block": "part=7"}, file=path))
    else:
        meshio.write(path, written, file_format=file_format, binary=binary)
        mesh = read_mesh(settings_of(path))
    assert set(mesh.fields) == {"heat"}
    np.testing.assert_array_equal(mesh.fields["heat"], heat[mesh.numbers - 1])


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("$NodeData\n", "$NodeData\nx\n", "damaged"),
        ("\n1\n24\n", "\n1\n25\n", r"\$NodeData 'heat' ends early: it announces 25 nodes and holds 24"),
        ("\n24 ", "\n99 ", r"\$NodeData 'heat' names node 99, which the file does not hold"),
    ],
)
def test_damaged_fields_are_refused(tmp_path, old, new, message):
    written = meshio_box("hex8")
    written.point_data["heat"] = np.arange(float(len(written.points)))
    path = tmp_path / "box.msh"
    meshio.write(path, written, file_format="gmsh22", binary=False)
    text = path.read_text()
    at = text.index("$NodeData")
    assert old in text[at:]
    path.write_text(text[:at] + text[at:].replace(old, new))
    with pytest.raises(MeshError, match=message):
        read_mesh(settings_of(path))
