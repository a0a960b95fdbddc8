"""Ansys archives: all element shapes, commands, the example files of mapdl-archive, and damaged files."""

import re
import time

import numpy as np
import pytest
from plain_model import bdf, cdb, cdb_with_contact, ds_dat, plain, tables

from microslip import elements
from microslip.formats.ansys.contacts import side_of
from microslip.formats.ansys.pages import _PAGE as HEADER
from microslip.formats.read import read_model
from microslip.library.complete import complete
from microslip.mesh.read import read_mesh
from microslip.messages.errors import CaseError, MeshError
from microslip.scene.read import scene_of
from microslip.studies.check.model_mesh import whole_mesh
from microslip.tables.units import UNITS

mapdl_archive = pytest.importorskip("mapdl_archive")

SANDBOXED = ("test_files_of_mapdl_archive_are_read", "test_damaged_archives_are_refused_with_one_message")


@pytest.fixture(autouse=True)
def sandbox(monkeypatch, request):
    """Read archives that a test writes in this process; a process for each would take ten times as long."""
    if request.node.originalname not in SANDBOXED:
        monkeypatch.setattr(
            "microslip.formats.ansys.read.read_file", lambda path, function, *arguments, **limits: function(*arguments)
        )


def written(folder, model=None, *more, text=None):
    path = folder / "model.cdb"
    path.write_text(cdb(model or plain(), more) if text is None else text)
    return path


@pytest.mark.parametrize("kind", ["hex8", "hex20", "wedge6", "wedge15", "pyramid5", "pyramid13", "tet10"])
def test_solids_have_the_shape_nodes_and_numbers_of_the_file(tmp_path, kind):
    model = plain(kind)
    from_file = read_model(written(tmp_path, model))
    np.testing.assert_array_equal(from_file.numbers, model.numbers)
    np.testing.assert_allclose(from_file.points, model.points, atol=1e-15)
    for cells, expected in zip(from_file.cells, model.elements, strict=True):
        assert cells.kind == kind
        np.testing.assert_array_equal(cells.nodes, expected)
        assert (elements.jacobian_minimum(kind, from_file.points[cells.nodes]) > 0.0).all()
    for name, nodes in model.sets.items():
        np.testing.assert_array_equal(from_file.groups[name].nodes, nodes)
    assert from_file.facts == ("title: bar on a plate",)


def page(
    system="ANSYS", stars="***", release="2021 R2          21.2", product="Ansys Mechanical Enterprise\n", time="CP=      1.766"
):
    """Return a page header in the form of public listings of releases 14 to 2026."""
    return (
        f"1\n\n {stars} {system} - ENGINEERING ANALYSIS SYSTEM  RELEASE {release}     {stars}\n {product}"
        f" 00000000  VERSION=WINDOWS x64   10:52:24  SEP 13, 2021 {time}\n\n bar on a plate--Modal (A5)\n\n"
    )


PAGES = (
    page(stars="*****", release="14.0", product="ANSYS Multiphysics\n"),
    page(product="DISTRIBUTED Ansys Mechanical Enterprise\n\n"),
    page().replace("bar on a plate--Modal (A5)", " " * 79).removeprefix("1\n\n"),  # without a title
    page("MAPDL", release="2022 R2          22.2"),
    page("MAPDL", release="2026 R1.01       26.1", time="Elapsed Time=      1.000"),
)


@pytest.mark.parametrize("page", PAGES, ids=["14", "2021, distributed", "2021, no title", "2022", "2026"])
@pytest.mark.parametrize("write, ending", [(cdb, ".cdb"), (ds_dat, ".dat")])
def test_page_headers_of_a_listing_are_ignored_between_commands_and_within_blocks(tmp_path, write, ending, page):
    plain_file, listing = tmp_path / f"model{ending}", tmp_path / f"listing{ending}"
    lines = write(plain()).splitlines(keepends=True)
    plain_file.write_text("".join(lines))
    listing.write_text("".join((page if i % 25 == 0 else "") + line for i, line in enumerate(lines)))
    expected, model = read_model(plain_file), read_model(listing)
    n_pages = len(range(0, len(lines), 25))
    assert model.facts == (*expected.facts, f"{n_pages} page headers of a listing are left out, lines are counted without them")
    assert [finding.word for finding in model.findings] == [finding.word for finding in expected.findings]
    np.testing.assert_array_equal(model.points, expected.points)
    for cells, of_plain in zip(model.cells, expected.cells, strict=True):
        np.testing.assert_array_equal(cells.nodes, of_plain.nodes)
    assert {name: len(group.nodes) for name, group in model.groups.items()} == {
        name: len(group.nodes) for name, group in expected.groups.items()
    }
    listing.write_text("".join([page, *lines[:20]]))
    with pytest.raises(MeshError, match=r"\(1 page header of a listing is left out, lines are counted without them\)"):
        read_model(listing)


@pytest.mark.parametrize("line", [b"\n", b"1\n", b" ***** RELEASE ", b" ***** A RELEASE 1 *****\n", b" "])
def test_the_search_for_page_headers_takes_linear_time(line):
    began = time.process_time()
    assert not HEADER.search(line * (1_000_000 // len(line)) + b"VERSION=")
    assert time.process_time() - began < 3.0


def test_a_missing_midside_node_is_refused(tmp_path):
    model = plain("hex20")
    lines = cdb(model).splitlines()
    first = next(i for i, line in enumerate(lines) if line == "(19i9)") + 1
    lines[first + 1] = lines[first + 1].replace(lines[first + 1][9:18], f"{0:9d}")
    with pytest.raises(MeshError, match="element 1: a mid-side node is left out"):
        read_model(written(tmp_path, text="\n".join(lines)))


def test_materials_bodies_and_supports_of_the_commands_complete_the_scene(tmp_path):
    more = ("MP,ALPX,1,1.2e-5", "F,150,FX,3.0", "TREF,20.0")
    written(tmp_path, plain(), *more)
    scene, notes = complete(scene_of(tables("model.cdb"), tmp_path / "s.toml"), read_model(tmp_path / "model.cdb"))
    assert {name: (body.group, body.material) for name, body in scene.bodies.items()} == {
        "material 1": ("material 1", "material 1"),
        "material 2": ("material 2", "material 2"),
    }
    assert scene.materials["material 1"].model_dump(exclude_none=True) == {
        "young": 2.1e11,
        "poisson": 0.3,
        "density": 7800.0,
        "expansion": 1.2e-5,
    }
    assert [(support.group, support.fix) for support in scene.supports] == [("D xyz", ("x", "y", "z"))]
    assert any("F is left out: loads of the file" in note for note in notes)


@pytest.mark.slow
@pytest.mark.parametrize(
    "command, message",
    [
        ("TB,HYPE,1,1,1", "TB: HYPE of material 1, which is not taken over"),
        ("D,102,UX,0.001", "D: a displacement UX = 0.001 other than 0"),
        ("CE,1,0.5,102,UX,1.0,103,UX,-1.0", "CE: an equation whose constant is not 0"),
        ("CP,R5.0,DEFI,UX,1,2", "CP: coupled nodes as CDWRITE writes them"),
        ("PSMESH,1,bolt", "PSMESH: a bolt's pretension section"),
        ("CYCLIC,24", "CYCLIC: cyclic symmetry"),
        ("WOBBLE,1", "WOBBLE: not known to this program"),
        ("MP,EY,1,1.0e9", "MP: EY of material 1: it is not isotropic"),
        ("MP,EX,1,1.0e9,1.0e6", "MP: EX of material 1 depends on the temperature"),
        ("CE,1,0,102,UX,1.0,103,ROTX,-1.0", "CE: an equation with a rotation of a node that leads no others"),
        ("EBLOCK,10", "EBLOCK: a block in the format of elements that are not solids"),
    ],
)
def test_commands_that_change_the_answer_are_refused_unless_ignored(tmp_path, command, message):
    path = written(tmp_path, plain(), command)
    with pytest.raises(CaseError, match=f"(?s)1 entry is not modelled.*line [0-9]+: {message}"):
        complete(scene_of(tables("model.cdb"), tmp_path / "s.toml"), read_model(path))
    word = command.split(",")[0]
    complete(scene_of(tables("model.cdb", ignore=(word,)), tmp_path / "s.toml"), read_model(path))


@pytest.mark.parametrize(
    "commands, sectors, axis, point",
    [
        (("CYCLIC,24",), 24, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
        (("CYCLIC,,15,5",), 24, (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)),
        (("LOCAL,11,1,0.1,0.2,0.3,0.0,90.0,0.0", "CYCLIC,8,,11"), 8, (0.0, -1.0, 0.0), (0.1, 0.2, 0.3)),
        (("CYCLIC,NSECT",), None, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
        (("CYCLIC,OFF",), None, None, None),
    ],
)
def test_a_cyclic_sector_has_its_faces_and_axis(tmp_path, commands, sectors, axis, point):
    """The components of the faces end in M01L and M01H; the finding belongs to the table [cyclic] of the scene."""
    path = written(tmp_path, plain(), *commands)
    path.write_text(path.read_text().replace("BAR_BOTTOM", "CYC_M01L").replace("PLATE_TOP", "CYC_M01H"))
    model = read_model(path)
    assert model.cyclic.faces == ("CYC_M01L", "CYC_M01H") and model.cyclic.sectors == sectors
    findings = [finding for finding in model.findings if finding.word == "CYCLIC"]
    assert len(findings) == (axis is not None)
    if axis is not None:
        np.testing.assert_allclose(model.cyclic.axis, axis, atol=1e-15)
        np.testing.assert_allclose(model.cyclic.axis_point, point)
        assert findings[0].part == "cyclic" and 'faces = ["CYC_M01L", "CYC_M01H"]' in findings[0].effect


def test_equations_couplings_and_rigid_regions(tmp_path):
    model = plain()
    a, b, c = map(int, model.numbers[:3])
    more = (
        "CE,R5.0,DEFI,       3,       1,  0.00000000    ",
        f"CE,R5.0,NODE,{a:8d},UX  ,  1.00000000    ,{b:8d},UX  , -0.50000000    ",
        f"CE,R5.0,NODE,{c:8d},UZ  , -0.50000000    ",
        f"CP,2,UY,{a},{b},{c}",
        f"CERIG,{a},BAR_BOTTOM",
        "ET,7,21",
        "KEYOPT,7,3,2",
        "R,9,0.25",
    )
    from_file = read_model(written(tmp_path, model, *more))
    rows = list(
        zip(from_file.equations.equation, from_file.equations.nodes, from_file.equations.axes, from_file.equations.coefficients)
    )
    assert rows == [
        (0, 0, 0, 1.0),
        (0, 1, 0, -0.5),
        (0, 2, 2, -0.5),
        (1, 1, 1, 1.0),
        (1, 0, 1, -1.0),
        (2, 2, 1, 1.0),
        (2, 0, 1, -1.0),
    ]
    (point,) = from_file.connected
    assert point.position == pytest.approx(tuple(model.points[0]))
    assert set(from_file.groups[point.group].nodes) == set(model.sets["BAR_BOTTOM"]) | {0}, (
        "a leading node of a solid follows, too"
    )


def test_a_leading_node_has_its_mass_and_supports(tmp_path):
    model = plain()
    followers = ",".join(("BAR_BOTTOM", "ALL"))
    lines = cdb(
        model, ("ET,7,21", "R,9,0.25,0.25,0.25,1.0,2.0,3.0", f"CERIG,5000,{followers}", "D,5000,UZ,0,,,,ROTX")
    ).splitlines()
    end = lines.index("N,R5.3,LOC,       -1,")
    lines.insert(end, f"{5000:9d}{0:9d}{0:9d}{0.02:21.13E}{0.0:21.13E}{0.1:21.13E}")
    end = lines.index(f"{-1:9d}")
    lines.insert(end, "".join(f"{value:9d}" for value in [1, 7, 9, 1, 0, 0, 0, 0, 1, 0, 901, 5000]))
    text = (
        "\n".join(lines)
        .replace("EBLOCK,19,SOLID,6,6", "EBLOCK,19,SOLID,7,7")
        .replace(f"NBLOCK,6,SOLID,{model.numbers[-1]},{len(model.points)}", f"NBLOCK,6,SOLID,5000,{len(model.points) + 1}")
    )
    from_file = read_model(written(tmp_path, text=text))
    (point,) = from_file.connected
    assert (point.mass, point.inertia, from_file.masses) == (0.25, (1.0, 2.0, 3.0), ())
    assert [support.fix for support in from_file.supports if support.point == point.name] == [("z", "rx")]


@pytest.mark.parametrize(
    "members, connection", [(lambda c: (f"CERIG,5001,{c}",), "rigid"), (lambda _: (), "equations")], ids=["nodes", "points alone"]
)
def test_a_rigid_region_may_follow_another_and_equations_may_have_rotations(tmp_path, members, connection):
    model = plain()
    a, b, c = map(int, model.numbers[:3])
    more = ("CERIG,5000,BAR_BOTTOM", *members(c), "CERIG,5001,5000", "CE,1,0,5000,ROTX,1,5001,ROTX,-1")
    lines = cdb(model, more).splitlines()
    end = lines.index("N,R5.3,LOC,       -1,")
    lines[end:end] = [f"{n:9d}{0:9d}{0:9d}{0.02:21.13E}{y:21.13E}{0.1:21.13E}" for n, y in ((5000, 0.0), (5001, 0.3))]
    size = f"NBLOCK,6,SOLID,{model.numbers[-1]},{len(model.points)}"
    text = "\n".join(lines).replace(size, f"NBLOCK,6,SOLID,5001,{len(model.points) + 2}")
    from_file = read_model(written(tmp_path, text=text))
    connections = {point.name: point.connection for point in from_file.connected}
    assert connections == {"CERIG node 5000": "rigid", "CERIG node 5001": connection}
    assert len(from_file.equations.where) == 7 and from_file.equations.axes[-2:].tolist() == [3, 3]


@pytest.mark.parametrize(
    "text", ["ET,1,SOLID185,,2", "ETBLOCK,1,1\n(2i9,19a9)\n" + "".join(f"{k:9d}" for k in (1, 185, 0, 2, 0)) + f"\n{-1:9d}"]
)
def test_keyopts_of_types_are_read_from_et_and_etblock(tmp_path, text):
    lines = [line for line in cdb(plain()).splitlines() if not line.startswith(("ET,1", "KEYOP,1"))]
    lines.insert(2, text)
    model = read_model(written(tmp_path, text="\n".join(lines)))
    assert all(body.incompatible_modes for body in model.bodies.values())


def test_supports_of_ranges_and_selections_and_equations_of_several_commands(tmp_path):
    model = plain()
    a, b, c = map(int, model.numbers[:3])
    more = (f"D,{a},UX,0,,{c},2", "CMSEL,S,BAR_BOTTOM", "D,ALL,UZ", "ALLSEL", f"CE,1,0,{a},UY,1,{b},UY,-1", f"CE,1,0,{c},UY,2")
    more += ("CE,R5.0,DEFI,2,2,0.0", f"CE,R5.0,NODE,{a},UX,1.0,{b},ROTX,1.0", "/TITLE,a $ WOBBLE")
    from_file = read_model(written(tmp_path, model, *more))
    supported = {
        axis: np.concatenate([from_file.groups[s.group].nodes for s in from_file.supports if axis in s.fix]).tolist()
        for axis in "xz"
    }
    assert {0, 2} <= set(supported["x"]) and 1 not in supported["x"]
    assert set(supported["z"]) == {*model.sets["BAR_BOTTOM"], *model.sets["PLATE_BASE"]}
    assert list(zip(from_file.equations.equation, from_file.equations.nodes, from_file.equations.coefficients)) == [
        (0, 0, 1.0),
        (0, 1, -1.0),
        (0, 2, 2.0),
    ]
    assert [finding.word for finding in from_file.findings if finding.changes] == ["CE"]


def test_point_masses_and_springs_are_read_from_elements(tmp_path):
    model = plain()
    a, b = map(int, model.numbers[:2])
    lines = cdb(model, ("ET,7,21", "KEYOPT,7,3,2", "ET,8,14", "R,9,0.25", "R,10,4.0e5,3.0")).splitlines()
    end = lines.index(f"{-1:9d}")
    rows = [[1, 7, 9, 1, 0, 0, 0, 0, 1, 0, 901, a], [1, 8, 10, 1, 0, 0, 0, 0, 2, 0, 902, a, b]]
    lines[end:end] = ["".join(f"{value:9d}" for value in row) for row in rows]
    from_file = read_model(written(tmp_path, text="\n".join(lines).replace("EBLOCK,19,SOLID,6,6", "EBLOCK,19,SOLID,8,8")))
    assert [(from_file.groups[mass.group].nodes.tolist(), mass.mass) for mass in from_file.masses] == [([0], 0.25)]
    (spring,) = from_file.springs
    assert (spring.stiffness, spring.damping) == (4e5, 3.0) and spring.direction is None
    assert [from_file.groups[name].nodes.tolist() for name in spring.groups] == [[0], [1]]


def test_the_surfaces_of_a_contact_are_groups_for_a_tie_or_a_joint(tmp_path):
    model = plain()
    path = written(tmp_path, text=cdb_with_contact(model))
    from_file, names = read_model(path), ("CONTA174 real 5", "TARGE170 real 5")
    of_cells = [
        {int(node) for block, rows in from_file.groups[name].cells.items() for node in from_file.cells[block].nodes[rows].ravel()}
        for name in names
    ]
    assert of_cells == [set(model.sets["BAR_BOTTOM"]), set(model.sets["PLATE_TOP"])]
    assert [(finding.word, finding.surfaces, finding.is_glued) for finding in from_file.findings] == [
        ("element type 170", names, True),
        ("element type 174", names, True),
    ]
    base = {**tables("model.cdb"), "joints": ()}
    with pytest.raises(
        CaseError, match=r"(?s)2 entries.*bonded; state \[\[ties\]\] or \[\[joints\]\] with surfaces = .*CONTA174 real 5"
    ):
        complete(scene_of(tables("model.cdb"), tmp_path / "s.toml"), from_file)
    complete(scene_of({**base, "ties": ({"surfaces": names},)}, tmp_path / "s.toml"), from_file)
    joint = {**tables("model.cdb")["joints"][0], "surfaces": names}
    complete(scene_of({**base, "joints": (joint,)}, tmp_path / "s.toml"), from_file)
    complete(scene_of(tables("model.cdb", ignore=("element type 174", "element type 170")), tmp_path / "s.toml"), from_file)


def test_a_contact_with_a_missing_surface_or_with_a_pilot_node_is_reported(tmp_path):
    model = plain()
    text = cdb_with_contact(model, 0).replace(f"{7:9d}{5:9d}", f"{7:9d}{6:9d}")  # targets of another pair
    from_file = read_model(written(tmp_path, text=text))
    assert [(finding.effect, finding.surfaces) for finding in from_file.findings] == [
        ("a target of contact", ()),
        ("a surface in contact", ()),
    ]
    lines = cdb_with_contact(model, 5).splitlines()
    lines = [line for line in lines if not line.startswith(f"{2:9d}{7:9d}{5:9d}")]
    lines.insert(lines.index(f"{-1:9d}"), "".join(f"{n:9d}" for n in [2, 7, 5, 1, 0, 0, 0, 0, 1, 0, 901, 101]))
    from_file = read_model(written(tmp_path, text="\n".join(lines).replace("SOLID,12,12", "SOLID,10,10")))
    assert "a pilot node or a rigid body; state [[points]]" in from_file.findings[0].effect and not from_file.findings[1].surfaces


@pytest.mark.parametrize(
    "row, kind, nodes",
    [
        ((1, 2, 3), "tri3", (1, 2, 3)),
        ((1, 2, 3, 3), "tri3", (1, 2, 3)),
        ((1, 2, 3, 4), "quad4", (1, 2, 3, 4)),
        ((1, 2, 3, 4, 5, 6), "tri6", (1, 2, 3, 4, 5, 6)),
        ((1, 2, 3, 3, 4, 5, 3, 6), "tri6", (1, 2, 3, 4, 5, 6)),
        ((1, 2, 3, 4, 5, 6, 7, 8), "quad8", (1, 2, 3, 4, 5, 6, 7, 8)),
    ],
)
def test_contact_faces_have_their_shape(row, kind, nodes):
    rows = np.array([[*row, *[0] * (8 - len(row))]])
    (cells,) = side_of(170, 7, 5, 1, rows, np.array([9]), np.arange(1, 9)).cells
    assert (cells.kind, tuple(cells.nodes[0] + 1)) == (kind, nodes)


@pytest.mark.parametrize(
    "more, message", [((), None), (("MP,GXY,1,8.1e10",), "GXY"), (("MP,PRYZ,1,0.31",), "PRYZ"), (("MP,EZ,1,2.0e11",), "EZ")]
)
def test_constants_along_all_axes_may_be_isotropic(tmp_path, more, message):
    alike = (
        "MP,EY,1,2.1e11",
        "MP,EZ,1,2.1e11",
        f"MP,GXY,1,{2.1e11 / 2.6:.6e}",
        "MP,PRYZ,1,0.3",
        "MP,NUXZ,1,0.3",
        "MP,PRXY,1,0.3",
    )
    model = read_model(written(tmp_path, plain(), *alike, *more))
    assert [finding.effect.partition(",")[0] for finding in model.findings] == (
        [f"{message} of material 1: it is not isotropic"] if message else []
    )
    assert model.materials["material 1"].poisson == 0.3


PLY = (
    "EX 1.4e11",
    "EY 1.0e10",
    "EZ 2.0e10",
    "PRXY 0.28",
    "NUXZ 0.05",
    "PRYZ 0.4",
    "GXY 5e9",
    "GYZ 3.5e9",
    "GXZ 6e9",
    "ALPY 3e-5",
)


def test_an_orthotropic_material_has_the_axes_of_the_element_systems(tmp_path):
    """Elements in the axes of the model, in axes rotated by 30 degrees about z, and in cylindrical axes about y."""
    lines = cdb(plain(), [f"MP,{text.split()[0]},1,{text.split()[1]}" for text in ("ALPX 1e-6", *PLY)]).splitlines()
    begin = next(i for i, line in enumerate(lines) if line == "(19i9)") + 1
    rows = [i for i in range(begin, len(lines)) if lines[i].startswith(f"{1:9d}" * 2)]
    for i, system in zip(rows, [0, 12] + [13] * len(rows)):
        lines[i] = f"{lines[i][:36]}{system:9d}{lines[i][45:]}"
    lines[4:4] = [
        "LOCAL,R5.0,LOC,    12,  0, 0.1, 0.0, 0.0",
        "LOCAL,R5.0,ANG,    12,  0, 30.0, 0.0, 0.0",
        "LOCAL,13,1,0.5,0.0,0.25,0.0,-90.0,0.0",
    ]
    model = read_model(written(tmp_path, text="\n".join(lines)))
    assert not [finding for finding in model.findings if finding.changes]
    material = model.materials["material 1"]
    assert (material.young, material.shear, material.expansion) == ((1.4e11, 1e10, 2e10), (5e9, 6e9, 3.5e9), (1e-6, 3e-5, 0.0))
    assert material.poisson == pytest.approx((0.28, 0.05 * 1.4e11 / 2e10, 0.4))
    axes = {name: body.orientation for name, body in model.bodies.items() if body.material == "material 1"}
    assert axes == {"material 1 ESYS 0": None, "material 1 ESYS 12": "ESYS 12", "material 1 ESYS 13": "ESYS 13"}
    first, second = model.orientations["ESYS 12"].directions
    assert first == pytest.approx((np.sqrt(0.75), 0.5, 0.0)) and second == pytest.approx((-0.5, np.sqrt(0.75), 0.0))
    around = model.orientations["ESYS 13"]
    assert around.axis == pytest.approx((0.0, 1.0, 0.0)) and around.axis_point == (0.5, 0.0, 0.25)
    lines[4:7] = []
    unknown_systems = [finding for finding in read_model(written(tmp_path, text="\n".join(lines))).findings if finding.changes]
    assert [finding.word for finding in unknown_systems] == ["ESYS 12", "ESYS 13"]


def test_an_isotropic_material_may_have_anisotropic_expansion(tmp_path):
    model = read_model(written(tmp_path, plain(), "MP,ALPX,1,1e-5", "MP,ALPY,1,1e-5", "MP,ALPZ,1,2e-5"))
    material = model.materials["material 1"]
    assert (material.young, material.poisson, material.expansion) == ((2.1e11,) * 3, (0.3,) * 3, (1e-5, 1e-5, 2e-5))


def test_supports_in_rotated_nodal_axes_become_equations(tmp_path):
    model = plain()
    lines = cdb(model).splitlines()
    node = model.numbers[model.sets["PLATE_BASE"][0]]
    i = next(i for i, line in enumerate(lines) if line.startswith(f"{node:9d}{0:9d}"))
    lines[i] += f"{30.0:21.13E}"
    lines = [line for line in lines if not (line.startswith(f"D,{node},") and "UX" not in line)]
    from_file = read_model(written(tmp_path, text="\n".join(lines)))
    assert from_file.equations.coefficients == pytest.approx([np.cos(np.pi / 6), np.sin(np.pi / 6)], abs=1e-12)
    assert model.sets["PLATE_BASE"][0] not in from_file.groups["D xyz"].nodes


def test_unblocked_archives_give_the_same_model(tmp_path):
    """UNBL replaces R5.0; supports in a DBLOCK; analysis options, loads, and identifiers of materials by Workbench."""
    text = cdb(plain())
    lines = [line for line in text.replace("R5.0", "UNBL").splitlines() if not line.startswith("D,")]
    supports = [line.split(",") for line in text.splitlines() if line.startswith("D,")]
    block = [f"{int(node):9d}{label:<6s}{0.0:16.9f}{0.0:16.9f}" for _, node, label, *_ in supports]
    at = next(i for i, line in enumerate(lines) if line.startswith("MPDATA"))
    more = [f"DBLOCK,{len(block)}", "(i9,a6,2(pg16.9))", *block, "       -1", "DMPOPT,FULL,NO", "NLDIAG,NRRE,OFF"]
    more += ["CSCIR,      12,       0,       0", "FC,1,S,XTEN,2.0e9"]
    more += ["MP,UVID,1,fc4313a1-c4ae-43af-b253-ad2923dee743", "MP,UMID,1,7f", "SFEBLOCK,1,PRES,1,1,0", "(i9,i4,i4,6(pg20.9))"]
    more += [f"{1:9d}{4:4d}{1:4d}{2.0:20.9f}", "       -1"]
    blocked, model = (read_model(written(tmp_path, text=each)) for each in (text, "\n".join([*lines[:at], *more, *lines[at:]])))
    assert model.materials == blocked.materials and model.supports == blocked.supports
    np.testing.assert_array_equal(model.groups["D xyz"].nodes, blocked.groups["D xyz"].nodes)
    assert [(finding.word, finding.where) for finding in model.findings if finding not in blocked.findings] == [
        ("SFEBLOCK", "1 command")
    ]


@pytest.mark.parametrize("value, n", [("0.00000000", 0), ("0.", 0), ("0.0E+00", 0), ("9.81", 1), ("G", 1), ("1.0E+00", 1)])
def test_zero_accelerations_are_no_loads(tmp_path, value, n):
    model = read_model(written(tmp_path, plain(), f"ACEL, 0.00000000 ,  0.00000000  , {value}"))
    assert [finding.where for finding in model.findings if finding.word == "ACEL"] == n * ["1 command"]


def test_elements_of_unknown_types_are_named_with_their_count(tmp_path):
    text = re.sub(r"^ET,(\s*\d+),\s*\d+", r"ET,\1,87", cdb(plain()), flags=re.MULTILINE)
    with pytest.raises(MeshError, match="none of its elements are solids .*: 6 of type 87, not known to this program"):
        read_model(written(tmp_path, text=text))


@pytest.mark.parametrize("number, effect", [(181, "a shell"), (200, "a mesh that is not solved")])
def test_a_file_without_solids_names_its_elements(tmp_path, number, effect):
    text = re.sub(r"^ET,(\s*\d+),\s*\d+", rf"ET,\1,{number}", cdb(plain(), ("UNHEARD,1",)), flags=re.MULTILINE)
    path = written(tmp_path, text=text)
    with pytest.raises(MeshError, match=rf"no volume elements \(6 elements of ET 1, 2: element type {number}, {effect}\)"):
        whole_mesh(str(path), read_model(path), UNITS["m-kg-s"])


@pytest.mark.parametrize("kind, number", [("hex8", 225), ("hex20", 226), ("tet10", 227)])
def test_coupled_field_solids_are_read_without_their_temperatures(tmp_path, kind, number):
    """Solids as in Ansys' example of friction stir welding: SOLID226 with KEYOPT(1) = 11."""
    structural = cdb(plain(kind))
    text = re.sub(r"^ET,(\s*\d+),\s*\d+(\nKEYOP.*)?", rf"ET,\1,{number}\nKEYOP,\1,1,11", structural, flags=re.MULTILINE)
    model, mechanical = (read_model(written(tmp_path, text=each)) for each in (text, structural))
    assert [cells.nodes.tolist() for cells in model.cells] == [cells.nodes.tolist() for cells in mechanical.cells]
    assert {body.integration for body in model.bodies.values()} == {"full"}
    (note,) = {finding.effect for finding in model.findings if finding.word == f"SOLID{number}"}
    assert note == f"SOLID{number} has temperatures too; the vibration here is isothermal"
    with pytest.raises(MeshError, match=rf"SOLID{number} with KEYOPT\(1\) = 1001 \(not 11, displacements and temperatures"):
        read_model(written(tmp_path, text=text.replace(",1,11", ",1,1001")))


@pytest.mark.parametrize(
    "commands", [("MP,MU,1,0.25",), ("TB,FRIC,1,2,1,ISO", "TBFIELD,TEMP,20.0", "TBDATA,1,0.25", "TBFI,TEMP,90.0", "TBDATA,1,0.2")]
)
def test_the_friction_coefficient_of_a_contact_comes_from_its_material(tmp_path, commands):
    text = cdb_with_contact(plain(), 0).splitlines()
    at = next(i for i, line in enumerate(text) if line.startswith("MPDATA"))
    model = read_model(written(tmp_path, text="\n".join([*text[:at], *commands, *text[at:]])))
    (joint,) = model.joints
    assert (joint.surfaces, joint.friction) == (("CONTA174 real 5", "TARGE170 real 5"), 0.25)
    assert joint.lacking  # a run does not use it without a joint of the scene
    notes = [finding.effect for finding in model.findings if finding.word == "TBDATA"]
    assert notes == (
        ["friction coefficient of material 1 at further temperatures; new writes the first, 0.25"] * (len(commands) > 1)
    )
    assert not [finding for finding in model.findings if finding.changes and finding.word.startswith("TB")]


@pytest.mark.parametrize("key, connection", [(1, "distributing"), (2, "rigid")])
def test_a_pilot_node_leads_its_surface(tmp_path, key, connection):
    """A remote point of Workbench: a node as the target of a bonded contact by equations."""
    model = plain()
    commands = ("ET,7,170", "KEYOP,7,2,1", "ET,8,174", "KEYOP,8,2,2", f"KEYOP,8,4,{key}", "KEYOP,8,12,5", "D,5000,UZ,0,,,,ROTX")
    lines = cdb_with_contact(model, 5).replace("ET,7,170\nET,8,174\n", "\n".join(commands) + "\n").splitlines()
    end = lines.index("N,R5.3,LOC,       -1,")
    lines.insert(end, f"{5000:9d}{0:9d}{0:9d}{0.02:21.13E}{0.0:21.13E}{0.1:21.13E}")
    lines = [line for line in lines if not line.startswith(f"{2:9d}{7:9d}{5:9d}")]
    end = lines.index(f"{-1:9d}")
    lines.insert(end, "".join(f"{value:9d}" for value in [2, 7, 5, 1, 0, 0, 0, 0, 1, 0, 901, 5000]))
    text = "\n".join(lines).replace("EBLOCK,19,SOLID,12,12", "EBLOCK,19,SOLID,10,10")
    text = text.replace(f"NBLOCK,6,SOLID,{model.numbers[-1]},{len(model.points)}", f"NBLOCK,6,SOLID,5000,{len(model.points) + 1}")
    from_file = read_model(written(tmp_path, text=text))
    (point,) = from_file.connected
    assert (point.name, point.connection, point.position) == ("pilot node 5000", connection, (0.02, 0.0, 0.1))
    np.testing.assert_array_equal(from_file.groups[point.group].nodes, np.sort(model.sets["BAR_BOTTOM"]))
    assert [support.fix for support in from_file.supports if support.point == point.name] == [("z", "rx")]
    assert not [finding for finding in from_file.findings if finding.changes]
    other = read_model(written(tmp_path, text=text.replace(f"KEYOP,8,4,{key}", "KEYOP,8,4,0")))
    assert any("pilot node" in finding.effect for finding in other.findings if finding.changes) and not other.connected


def test_plasticity_is_a_note(tmp_path):
    model = read_model(written(tmp_path, plain(), "TB,PLAS,1,1,2,BISO", "TBTEMP,20.0", "TBDATA,1,3.0e8,1.0e9"))
    (note,) = [finding for finding in model.findings if finding.word.startswith("TB")]
    assert not note.changes and note.effect == "PLAS of material 1: it yields or creeps in Ansys, and is elastic here"


def test_iges_geometry_before_the_data_is_ignored(tmp_path):
    """CDWRITE,ALL first writes IGES, whose lines end with a letter and a number."""
    without_geometry = cdb(plain())
    head = ["", "/COM,ANSYS RELEASE 12.1", "/TITLE,", "1H,,1H;,,19HElectronics_PCB.cdb,;"]
    lines = [f"{line:<72s}{letter}{i:7d}" for i, (letter, line) in enumerate(zip("SSSG", head), 1)]
    text = "\n".join([*lines, ":CDWRITE      ! START OF CDWRITE DATA", without_geometry])
    model, other = (read_model(written(tmp_path, text=each)) for each in (text, without_geometry))
    assert model.findings == other.findings and model.facts == other.facts
    np.testing.assert_array_equal(model.points, other.points)


def test_solids_with_an_unavailable_option_are_reported_with_it(tmp_path):
    text = re.sub(r"^ET,(\d+),\d+\nKEYOP,\d+,2,\d+", r"ET,\1,185\nKEYOP,\1,2,1", cdb(plain()), flags=re.MULTILINE)
    message = r"6 of type 185, SOLID185 with KEYOPT\(2\) = 1 .*which is not available here"
    with pytest.raises(MeshError, match=f"none of its elements are solids .*: {message}"):
        read_model(written(tmp_path, text=text))


@pytest.mark.parametrize("file, volume", [("hexarchivefile", 5.0), ("tetarchivefile", None), ("sector_archive_file", None)])
def test_files_of_mapdl_archive_are_read(file, volume):
    model = read_model(getattr(mapdl_archive.examples, file))
    total = 0.0
    for cells in model.cells:
        assert (elements.jacobian_minimum(cells.kind, model.points[cells.nodes]) > 0.0).all()
        total += elements.mass(cells.kind, model.points[cells.nodes], 1.0).sum()
    assert volume is None or total == pytest.approx(volume)


def test_surfaces_of_an_archive_are_selected_by_its_components(tmp_path):
    scene, _ = complete(scene_of(tables("model.cdb"), written(tmp_path).parent / "s.toml"), read_model(tmp_path / "model.cdb"))
    from microslip.mesh.pairing import pair_contacts

    assert pair_contacts(read_mesh(scene), scene.joints).n_pairs == 8


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda text: text.replace("NBLOCK,6,SOLID,1132,32", "NBLOCK,6,SOLID,1132,2000000000"), "NBLOCK counts 2000000000, more"),
        (lambda text: text.replace("EBLOCK,19,SOLID,6,6", "EBLOCK,19,SOLID,6,900000000"), "EBLOCK counts 900000000, more"),
        (lambda text: text[: text.index("EBLOCK")], "holds no NBLOCK and EBLOCK"),
        (
            lambda text: text.replace("NBLOCK,6,SOLID,1132,32\n(3i9", "NBLOCK,3\n(1i9"),
            "line 8: NBLOCK in the format .*is not read; write",
        ),
        (lambda text: text.replace(f"{102:9d}{0:9d}", f"{101:9d}{0:9d}"), "node number 101 more than once"),
        (lambda text: text.replace(f"{1132:9d}{0:9d}", f"{1134:9d}{0:9d}"), "names node 1132, which the file does not hold"),
        (lambda text: "", "the file is empty"),
        (lambda text: "\x00\x01" * 500, "holds no NBLOCK and EBLOCK"),
    ],
)
def test_damaged_archives_are_refused_with_one_message(tmp_path, change, message):
    text = change(cdb(plain()))
    with pytest.raises(CaseError, match=f"model.cdb: .*{message}"):
        read_model(written(tmp_path, text=text))


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
def test_an_input_file_of_workbench_gives_the_model_of_the_archive(tmp_path, kind):
    model = plain(kind)
    (tmp_path / "ds.dat").write_text(ds_dat(model))
    from_file, archived = read_model(tmp_path / "ds.dat"), read_model(written(tmp_path, model))
    np.testing.assert_array_equal(from_file.numbers, archived.numbers)
    np.testing.assert_allclose(from_file.points, archived.points, atol=1e-11)
    solids = [cells for cells in from_file.cells if cells.kind == kind]
    for cells, other in zip(solids, archived.cells, strict=True):
        np.testing.assert_array_equal(cells.nodes, other.nodes)
        np.testing.assert_array_equal(cells.numbers, other.numbers)
    assert (from_file.bodies, from_file.materials, from_file.supports) == (archived.bodies, archived.materials, archived.supports)
    for name in model.sets:
        np.testing.assert_array_equal(from_file.groups[name].nodes, archived.groups[name].nodes)
    names = ("CONTA174 real 3", "TARGE170 real 3")
    assert [(finding.word, finding.surfaces, finding.is_glued) for finding in from_file.findings] == [
        ("element type 174", names, True),
        ("element type 170", names, True),
    ]
    for name, nodes in zip(names, ("BAR_BOTTOM", "PLATE_TOP")):
        ((block, _),) = from_file.groups[name].cells.items()
        assert set(from_file.cells[block].nodes.ravel()) == set(model.sets[nodes])
    assert from_file.facts == ("title: bar on a plate--Modal (A5)", "units: MKS, as stated in the file")


@pytest.mark.parametrize(
    "more, word, message",
    [
        ("en,501901,102,103", "E", "elements defined one by one .*CDWRITE"),
        ("esel,s,type,,2\nnsle\nd,all,ux,0", "D", "a support of 'all', which is not a known node, component or selection"),
        ("pp=8.1e10\nmp,gxy,1,pp", "MP", "GXY of material 1: it is not isotropic"),
        ("wobb,1", "WOBB", "not known"),
        (
            "et,9,185\neblock,19,solid,,1\n(19i9)\n"
            + "".join(f"{n:9d}" for n in (1, 9, 1, 1, 0, 0, 0, 0, 8, 0, 77))
            + "{nodes}\n-1",
            "SOLID185",
            "KEYOPT",
        ),
    ],
)
def test_further_commands_of_an_input_file_are_refused_unless_ignored(tmp_path, more, word, message):
    model = plain()
    nodes = "".join(f"{n:9d}" for n in model.numbers[model.elements[0][0]])
    (tmp_path / "ds.dat").write_text(ds_dat(model, (more.replace("{nodes}", nodes),)))
    from_file = read_model(tmp_path / "ds.dat")
    (finding,) = [finding for finding in from_file.findings if finding.changes and not finding.surfaces]
    assert finding.word == word
    with pytest.raises(CaseError, match=message):
        complete(scene_of(tables("ds.dat"), tmp_path / "s.toml"), from_file)


@pytest.mark.parametrize(
    ("script", "message"),
    [
        (
            "/prep7\nK,1,0,0\nk,2,1,0\nBLOCK,0,1,0,1,0,1\nvmesh,all\n",
            r"commands that make one .*\(K, BLOCK, VMESH\); write the mesh in",
        ),
        ("/PREP7\nN,1\nN,11,10\nFILL\nE,1,2\nEGEN,10,1,1\n", r"\(N, FILL, E, EGEN\)"),
        ("/COM no model\n*DIM,A,,3\n", r"it holds no mesh \(NBLOCK, EBLOCK\); write"),
    ],
)
def test_a_script_that_builds_its_mesh_is_refused(script, message, tmp_path):
    (tmp_path / "vm.dat").write_text(f"/TITLE,a script\n{script}")
    with pytest.raises(MeshError, match=message):
        read_model(tmp_path / "vm.dat")


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda text: text[: text.index("et,1,185") - 200], "the block of line 8 ends without -1; the file is truncated"),
        (lambda text: text[: text.index("eblock")], "its NBLOCK or EBLOCK is empty or damaged"),
        (lambda text: text.replace("(1i9,3e20.9e3)", "(3f20.5)"), "line 9: a format like .* is expected after NBLOCK"),
        (lambda text: text.replace("(1i9,3e20.9e3)", "(1i9,2e20.9e3)"), "three coordinates"),
        (lambda text: text.replace("(19i9)", "(99i999)"), "the format .* is not a format of a block"),
        (lambda text: text.replace(f"{8:9d}{0:9d}{1:9d}", f"{80:9d}{0:9d}{1:9d}"), "fewer nodes than it states"),
        (lambda text: text.replace(f"{101:9d} ", "     1x1 "), "line 10: NBLOCK holds .*where numbers are expected"),
        (
            lambda text: text.replace("CMBLOCK,PLATE_BASE,NODE,        8", "CMBLOCK,PLATE_BASE,NODE,999999999"),
            "the file ends before",
        ),
        (lambda text: text.replace("keyo,cid,12,5", "keyo,cid,12,who"), "KEYOPT: 'who' where a number is expected"),
    ],
)
def test_damaged_input_files_are_refused_with_one_message(tmp_path, change, message):
    (tmp_path / "ds.dat").write_text(change(ds_dat(plain())))
    with pytest.raises(CaseError, match=f"ds.dat: .*{message}"):
        read_model(tmp_path / "ds.dat")


def test_a_dat_file_of_nastran_is_recognised(tmp_path):
    pytest.importorskip("pyNastran")
    (tmp_path / "m.dat").write_text(bdf(plain()))
    assert len(read_model(tmp_path / "m.dat").points) == 32


def test_an_input_file_of_ansys_or_nastran_may_end_in_inp(tmp_path):
    """Abaqus, decks of NASTRAN-95 and inputs of Mechanical APDL share the ending."""
    for text, node_group in ((ds_dat(plain()), "_FIXEDSU"), (bdf(plain()), None)):
        (tmp_path / "m.inp").write_text(text)
        model = read_model(tmp_path / "m.inp")
        assert len(model.points) >= len(plain().points) and (node_group is None or node_group in model.groups)
        with pytest.raises(MeshError, match="m.inp: it is a file of Ansys or Nastran, of which no steps are read"):
            read_model(tmp_path / "m.inp", 1)
