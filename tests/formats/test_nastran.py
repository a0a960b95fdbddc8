"""Nastran bulk data: all solids, properties and connections, findings, and damaged files."""

import sys
from pathlib import Path

import numpy as np
import pytest
from plain_model import bdf, plain, tables

from microslip import elements
from microslip.formats.nastran.read import restored_streams
from microslip.formats.read import read_model
from microslip.library.complete import complete, held_by
from microslip.messages.errors import CaseError, MeshError
from microslip.scene.read import scene_of
from microslip.studies.check.model_content import passed_over

pytest.importorskip("pyNastran")
DATA = Path(__file__).parents[1] / "data"
SURFACES = {"surfaces": ("SET 1", "SET 2")}


def written(folder, model=None, *more, case=(), text=None):
    path = folder / "model.bdf"
    path.write_text(bdf(model or plain(), more, case) if text is None else text)
    return path


def scene(folder, **model):
    """Return the scene of the model, whose sets are numbered."""
    computed = tables("model.bdf", **model)
    return scene_of({**computed, "joints": ({**computed["joints"][0], **SURFACES},)}, folder / "s.toml")


@pytest.mark.parametrize("kind", ["hex8", "hex20", "wedge6", "wedge15", "pyramid5", "pyramid13", "tet4", "tet10"])
def test_solids_have_the_nodes_and_numbers_of_the_file(tmp_path, kind):
    model = plain(kind)
    from_file = read_model(written(tmp_path, model))
    np.testing.assert_array_equal(from_file.numbers, model.numbers)
    np.testing.assert_allclose(from_file.points, model.points, atol=1e-11)
    for cells, expected in zip(from_file.cells, model.elements, strict=True):
        assert cells.kind == kind
        np.testing.assert_array_equal(cells.nodes, expected)
        assert (elements.jacobian_minimum(kind, from_file.points[cells.nodes]) > 0.0).all()
    for i, nodes in enumerate(model.sets.values(), 1):
        np.testing.assert_array_equal(from_file.groups[f"SET {i}"].nodes, nodes)


def test_materials_bodies_and_supports_of_the_cards_complete_the_scene(tmp_path):
    written(tmp_path, plain(), "FORCE,5,101,0,1.0,0.0,0.0,1.0", "EIGRL,7,,,5")
    model, notes = complete(scene(tmp_path), read_model(tmp_path / "model.bdf"))
    assert {name: (body.group, body.material) for name, body in model.bodies.items()} == {
        "PSOLID 1": ("1", "MAT1 1"),
        "PSOLID 2": ("2", "MAT1 2"),
    }
    steel = model.materials["MAT1 1"]
    assert (steel.young, steel.poisson, steel.density) == pytest.approx((2.1e11, 0.3, 7800.0))
    assert [(support.group, support.fix) for support in model.supports] == [("SPC xyz", ("x", "y", "z"))]


MAT9 = (
    "MAT9,1,11.,12.,13.,14.,15.,16.,22.",
    ",23.,24.,25.,26.,33.,34.,35.,36.",
    ",44.,45.,46.,55.,56.,66.,2.5,1e-6",
    ",2e-6,3e-6",
)
MAT11 = ("MAT11,1,1.4+11,1.+10,2.+10,.28,.31,.4,5.+9", ",6.+9,3.5+9,1600.,1.-6,2.-5,3.-5")
SYSTEMS = ("CORD2R,7,0,0.,0.,0.,0.,0.,1.", ",1.,1.,0.", "CORD2C,8,0,.5,0.,.25,.5,2.,.25", ",1.,2.,.25")


@pytest.mark.parametrize(
    "card",
    [
        "PARAM,EQCHECK,1,1,1,,,,-1.E20",
        "PARAM   PRTSTIFD,1,1,1,1",
        "EIGRL,1,,,4,,,-1.,MAX,3,DPB",
        "EIGR,1,INV,,,,3,,,POINT,3,3,-1.",
    ],
)
def test_solver_cards_are_ignored(tmp_path, card):
    without_card = read_model(written(tmp_path, plain()))
    model = read_model(written(tmp_path, plain(), card))
    assert len(model.points) == len(without_card.points) and model.findings == without_card.findings


def test_a_file_with_only_bars_is_refused(tmp_path):
    (tmp_path / "bar.bdf").write_text("BEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nCBAR,1,1,1,2,0.,1.,0.\nENDDATA\n")
    with pytest.raises(MeshError, match=r"that this program reads \(1 CBAR\)"):
        read_model(tmp_path / "bar.bdf")


@pytest.mark.parametrize("system", [0, 7, 8, -1])
def test_anisotropic_materials_and_their_axes(tmp_path, system):
    text = bdf(plain(), SYSTEMS).splitlines()
    i = next(i for i, line in enumerate(text) if line.startswith("MAT1,1,"))
    text[i - 1 : i + 1] = [f"PSOLID,1,1,{system}", *(MAT11 if system == 7 else MAT9)]
    model = read_model(written(tmp_path, text="\n".join(text)))
    assert [finding.word for finding in model.findings if finding.changes] == (["PSOLID CORDM"] if system == -1 else [])
    body = model.bodies["PSOLID 1"]
    material = model.materials[body.material]
    if system == 7:
        assert (material.young, material.poisson, material.shear) == ((1.4e11, 1e10, 2e10), (0.28, 0.31, 0.4), (5e9, 6e9, 3.5e9))
        assert (material.density, material.expansion) == (1600.0, (1e-6, 2e-5, 3e-5))
        x, y = model.orientations[body.orientation].directions
        assert x == pytest.approx(np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)) and y == pytest.approx((-x[0], x[1], 0.0))
        return
    C = np.array(material.elasticity)
    assert np.array_equal(C, C.T) and np.array_equal(np.diag(C), [11.0, 22.0, 33.0, 44.0, 66.0, 55.0])
    assert (C[0, 3], C[0, 4], C[0, 5], C[4, 5], C[3, 4]) == (14.0, 16.0, 15.0, 56.0, 46.0)
    assert (material.density, material.expansion) == (2.5, (1e-6, 2e-6, 3e-6))
    around = model.orientations[body.orientation] if system == 8 else None
    assert body.orientation is None or around.axis == (0.0, 1.0, 0.0) and around.axis_point == (0.5, 0.0, 0.25)


def test_mass_is_in_the_units_of_wtmass(tmp_path):
    model = read_model(written(tmp_path, plain(), "PARAM,WTMASS,0.5", "CONM2,900,101,,3.0"))
    assert model.materials["MAT1 1"].density == pytest.approx(3900.0)
    assert [(model.groups[mass.group].nodes.tolist(), mass.mass) for mass in model.masses] == [([0], 1.5)]


def test_rigid_elements_springs_and_equations(tmp_path):
    model = plain()
    a, b, c = map(int, model.numbers[:3])
    tip = int(model.numbers[-1])
    more = (
        "GRID,5000,,0.1,0.0,0.03",
        f"RBE2,901,5000,123456,{a},{b},{c}",
        "CONM2,902,5000,,2.0",
        ",1.0,0.1,2.0,0.2,0.3,3.0",
        "SPC1,1,4,5000",
        f"CELAS2,903,4.0+5,{tip},2,{a},2",
        f"CDAMP2,904,6.0,{tip},3",
        f"CDAMP1,905,906,{b},1",
        "PDAMP,906,7.0",
        f"MPC,7,{tip},1,1.0,{a},1,-1.0",
    )
    from_file = read_model(written(tmp_path, model, *more, case=("MPC = 7",)))
    (point,) = from_file.connected
    assert point.position == pytest.approx((0.1, 0.0, 0.03)) and point.mass == 2.0
    assert point.inertia == pytest.approx((1.0, 2.0, 3.0, -0.1, -0.3, -0.2))
    assert from_file.groups[point.group].nodes.tolist() == [0, 1, 2]
    assert ("RBE2 901", ("rx",)) in [(support.point, support.fix) for support in from_file.supports]
    spring, *dampers = from_file.springs
    assert spring.stiffness == 4e5 and spring.direction == (0.0, 1.0, 0.0)
    assert [(damper.direction, damper.stiffness, damper.damping) for damper in dampers] == [
        ((0.0, 0.0, 1.0), 0.0, 6.0),
        ((1.0, 0.0, 0.0), 0.0, 7.0),
    ]
    assert from_file.equations.coefficients.tolist() == [1.0, -1.0] and from_file.equations.axes.tolist() == [0, 0]


def rows_of(equations):
    """Return the dense coefficients of each equation by point and axis, (n, n_points, 6)."""
    rows = np.zeros((len(equations.where), len(equations.points), 6))
    np.add.at(rows, (equations.equation, -1 - equations.nodes, equations.axes), equations.coefficients)
    return rows


def test_a_rigid_element_may_follow_another_and_equations_may_have_rotations(tmp_path):
    """A chain of two rigid elements is one rigid body: only its six motions satisfy the equations."""
    model = plain()
    a, b, c, d, e, f = map(int, model.numbers[:6])
    more = ("GRID,5000,,0.1,0.0,0.03", "GRID,5001,,0.3,0.2,-0.1", "GRID,5002,,0.0,0.5,0.0")
    more += (f"RBE2,901,5000,123456,{a},{b}", f"RBE2,902,5001,123456,5000,{c},{d}", f"RBE3,903,,5002,123456,1.0,123,{e},{f}")
    more += ("MPC,7,5002,6,1.0,5001,6,-2.0",)
    from_file = read_model(written(tmp_path, model, *more, case=("MPC = 7",)))
    groups = {point.name: from_file.groups[point.group].nodes.tolist() for point in from_file.connected}
    assert groups == {"RBE2 901": [0, 1], "RBE2 902": [2, 3], "RBE3 903": [4, 5]}
    rows, names = rows_of(from_file.equations), from_file.equations.points
    *chain, turn = rows
    assert turn[names.index("RBE3 903")].tolist() == [0, 0, 0, 0, 0, 1.0]
    assert turn[names.index("RBE2 902")].tolist() == [0, 0, 0, 0, 0, -2.0]
    positions = {point.name: np.array(point.position) for point in from_file.connected}
    motions = np.zeros((6, len(names), 6))
    for i, name in enumerate(names):
        motions[:, i, :3] = np.vstack([np.eye(3), np.cross(np.eye(3), positions[name])])
        motions[3:, i, 3:] = np.eye(3)
    chain = np.array(chain).reshape(6, -1)
    assert np.abs(chain @ motions.reshape(6, -1).T).max() < 1e-15 and np.linalg.matrix_rank(chain) == 6


def test_a_rigid_element_over_leading_grid_points_only(tmp_path):
    """An RBE2 over RBE2s leads no node of a solid: its point is connected by equations."""
    model = plain()
    a, b, c, d = map(int, model.numbers[:4])
    more = ("GRID,5000,,0.1,0.0,0.03", "GRID,5001,,0.3,0.2,-0.1", "GRID,5002,,0.0,0.5,0.0", "GRID,5003,,0.0,0.7,0.0")
    more += ("RBE2,900,5003,123456,5002", "RBE2,903,5002,123456,5000,5001")
    more += (f"RBE2,901,5000,123456,{a},{b}", f"RBE2,902,5001,123456,{c},{d}", "CONM2,904,5003,,2.0")
    from_file = read_model(written(tmp_path, model, *more))
    points = {point.name: (point.connection, point.group, point.mass) for point in from_file.connected}
    first, second = ("RBE2 901", "RBE2 902")
    assert points == {
        first: ("rigid", first, 0.0),
        second: ("rigid", second, 0.0),
        "RBE2 903": ("equations", first, 0.0),
        "RBE2 900": ("equations", first, 2.0),
    }
    assert from_file.groups[first].nodes.tolist() == [0, 1] and len(from_file.equations.where) == 18
    assert not any(finding.changes for finding in from_file.findings)


def test_a_mean_over_grid_points_that_lead_others_is_a_finding(tmp_path):
    """An RBE3 over the leading grid point of an RBE2 is not modelled, with or without nodes of solids."""
    model = plain()
    a, b, c, d = map(int, model.numbers[:4])
    grid = ("GRID,5000,,0.1,0.0,0.03", "GRID,5001,,0.3,0.2,-0.1", f"RBE2,901,5000,123456,{a},{b},{c}")
    for others, effect, n in ((f",{d}", "a mean of 2 grid points, 1 of them", 2), ("", "a mean of 1 grid points, 1 of them", 1)):
        from_file = read_model(written(tmp_path, model, *grid, f"RBE3,902,,5001,123456,1.0,123,5000{others}"))
        (finding,) = (finding for finding in from_file.findings if finding.word == "RBE3")
        assert finding.effect == f"{effect} of no solid, as 5000 (which leads others)" and finding.changes
        assert len(from_file.connected) == n


@pytest.mark.parametrize(
    "more, weights",
    [
        ("1.0,123,{a},{b},2.5,123,{c},{d}", (1.0, 1.0, 2.5, 2.5)),
        ("2.5,123,{d},1.0,123,{c},{b},{a},{d}", (1.0, 1.0, 1.0, 3.5)),
        ("2.0,123,{a},{b},2.0,123,{c},{d}", "equal"),
    ],
)
def test_weights_of_a_mean_are_read(tmp_path, more, weights):
    model = plain()
    a, b, c, d = map(int, model.numbers[:4])
    card = f"RBE3,901,,5000,123456,{more.format(a=a, b=b, c=c, d=d)}".split(",")
    lines = [",".join(card[:9]), ",".join(["", *card[9:]])]
    from_file = read_model(written(tmp_path, model, "GRID,5000,,0.1,0.0,0.03", *lines))
    (point,) = from_file.connected
    assert (point.connection, point.weights) == ("distributing", weights)
    assert not [finding for finding in from_file.findings if finding.word == "RBE3"]


def test_a_mean_of_other_components_is_a_finding(tmp_path):
    a, b, c = map(int, plain().numbers[:3])
    model = read_model(written(tmp_path, plain(), "GRID,5000,,0.1,0.0,0.03", f"RBE3,901,,5000,123456,1.0,12,{a},{b}", f",{c}"))
    (finding,) = (finding for finding in model.findings if finding.word == "RBE3")
    assert finding.changes and finding.effect == "a mean of other components than 123, or with a weight that is not above 0"


def test_components_may_have_blanks_between_them(tmp_path):
    """Decks of MYSTRAN have "12 456" in fixed fields."""
    model = plain()
    a, b, c, d = map(int, model.numbers[:4])
    models = []
    for all_three, two, turns, all_six in (("12  3", "1 2", "4 56", "123 456"), ("123", "12", "456", "123456")):
        rows = [f"SPC1    {7:<8d}{all_three:8s}{a:<8d}{b:<8d}", f"SPC     {7:<8d}{c:<8d}{two:8s}{0.0:<8.1f}"]
        rows += [f"GRID    {5000:<8d}{'':8s}{0.1:<8.1f}{0.0:<8.1f}{0.03:<8.2f}{'':8s}{turns:8s}"]
        rows += [f"RBE2    {901:<8d}{5000:<8d}{all_six:8s}{d:<8d}"]
        models.append(read_model(written(tmp_path, model, *rows, case=("SPC = 7",))))
    assert models[0].supports == models[1].supports and models[0].connected == models[1].connected
    assert {("x", "y", "z"), ("x", "y"), ("rx", "ry", "rz")} <= {support.fix for support in models[0].supports}


def test_an_equation_with_a_rotation_of_a_solid_is_omitted_and_reported(tmp_path):
    model = plain()
    a, b = map(int, model.numbers[:2])
    from_file = read_model(written(tmp_path, model, f"MPC,7,{a},4,1.0,{b},1,-1.0", case=("MPC = 7",)))
    assert from_file.equations is None and any("rotation" in finding.effect and finding.changes for finding in from_file.findings)


def test_leading_grid_points_may_have_springs_and_belong_to_solids(tmp_path):
    model = plain()
    a, b, c, d = map(int, model.numbers[:4])
    more = ("GRID,5000,,0.1,0.0,0.03", f"RBE2,901,5000,123,{a},{b}", f"RBE2,902,{c},123,{d}")
    more += ("CELAS2,903,4.0e5,5000,2", "CELAS2,904,7.0,5000,6")
    from_file = read_model(written(tmp_path, model, *more))
    outer, inner = from_file.connected
    assert (outer.stiffness, outer.rotational_stiffness, from_file.springs) == ((0.0, 4e5, 0.0), (0.0, 0.0, 7.0), ())
    assert from_file.groups[inner.group].nodes.tolist() == [2, 3]


def test_rigid_elements_with_the_same_leading_grid_point_are_merged(tmp_path):
    model = plain()
    a, b, c, d = map(int, model.numbers[:4])
    more = ("GRID,5000,,0.1,0.0,0.03", f"RBE2,901,5000,123456,{a},{b}", f"RBE2,902,5000,123,{c}")
    more += (f"RBE3,903,,5001,123456,1.0,123,{d},{a}", "GRID,5001,,0.1,0.1,0.03", f"RBE2,904,5001,123,{c}")
    from_file = read_model(written(tmp_path, model, *more))
    assert [(point.name, point.connection) for point in from_file.connected] == [
        ("RBE2 901", "rigid"),
        ("RBE3 903", "distributing"),
    ]
    assert from_file.groups["RBE2 901"].nodes.tolist() == [0, 1, 2]
    assert [(finding.where, finding.effect) for finding in from_file.findings] == [
        ("RBE2 904", "grid point 5001 leads an RBE3 already")
    ]


def test_the_geometry_of_nastran_output_equals_its_bulk_data():
    """A hex20 by MSC Nastran in single precision; materials have the stated values."""
    model, bulk = read_model(DATA / "chexa20.op2"), read_model(DATA / "chexa20.bdf")
    np.testing.assert_array_equal(model.numbers, bulk.numbers)
    np.testing.assert_allclose(model.points, bulk.points, atol=1e-7 * abs(bulk.points).max())
    for cells, other in zip(model.cells, bulk.cells, strict=True):
        assert cells.kind == other.kind == "hex20"
        np.testing.assert_array_equal(cells.nodes, other.nodes)
    assert (model.materials, model.bodies, model.supports) == (bulk.materials, bulk.bodies, bulk.supports)
    assert model.materials["MAT1 1"].young == 7.2e10
    np.testing.assert_array_equal(model.groups["SPC xyz"].nodes, bulk.groups["SPC xyz"].nodes)


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda data: data[:9000], "truncated.*PARAM,POST,-1"),
        (lambda data: b"", "the file is empty"),
        (None, "Nastran FATAL.*PARAM,POST,-1"),
    ],
)
def test_output_without_complete_geometry_is_refused_with_one_message(tmp_path, change, message):
    data = (DATA / "chexa20.op2").read_bytes() if change else (DATA / "matrices" / "mymatrix.op2").read_bytes()
    (tmp_path / "m.op2").write_bytes(change(data) if change else data)
    with pytest.raises(CaseError, match=f"m.op2: .*{message}"):
        read_model(tmp_path / "m.op2")


@pytest.mark.parametrize(
    "name, message", [("m.db", "CDWRITE"), ("m.odb", "input file, .inp"), ("m.frd", "input file, .inp"), ("m.xdb", "bulk data")]
)
def test_results_and_databases_are_refused_with_the_file_to_write(tmp_path, name, message):
    with pytest.raises(CaseError, match=f"the ending '.{name[2:]}' is not read: .*{message}"):
        read_model(tmp_path / name)


@pytest.mark.parametrize(
    "card, message",
    [
        (("CORD2R,7,,0.,0.,0.,0.,1.,0.", ",0.,0.,1.", "SPC1,1,1,5000"), "SPC: a support in turned axes"),
        (("CELAS2,903,4.0e5,5000,2,101,2",), "CELAS2: a spring at a grid point that leads"),
    ],
)
def test_unsupported_conditions_on_leading_grid_points_are_refused(tmp_path, card, message):
    more = ("GRID,5000,,0.1,0.0,0.03,7", "RBE2,901,5000,123456,102,103", *card)
    system = () if card[0].startswith("CORD") else ("CORD2R,7,,0.,0.,0.,0.,0.,1.", ",1.,0.,0.")
    model = read_model(written(tmp_path, plain(), *more, *system, case=("MPC = 4",) if "MPC" in message else ()))
    with pytest.raises(CaseError, match=message):
        complete(scene(tmp_path), model)


def test_supports_in_rotated_axes_are_not_omitted_silently(tmp_path):
    more = ("GRDSET,,,,,,7", "CORD2R,7,,0.,0.,0.,0.,1.,0.", ",0.,0.,1.", "SPC1,1,1,102")
    model = read_model(written(tmp_path, plain(), *more))
    assert model.equations.n_supports == 1
    with pytest.raises(CaseError, match='1 support of model.bdf is in turned axes, which takes equations; add "equations"'):
        complete(scene(tmp_path, take=("materials", "bodies", "supports")), model)
    stated = scene(tmp_path).model_dump(exclude_unset=True) | {"supports": ({"group": "SET 3", "fix": ("x", "y", "z")},)}
    replaced = scene_of(stated, tmp_path / "s.toml")
    assert any("1 support in turned axes of model.bdf is left out" in note for note in complete(replaced, model)[1])
    assert held_by(replaced, model).equations is None and held_by(scene(tmp_path), model).equations.n_supports == 1


def test_supports_of_the_scene_replace_only_the_support_equations_of_the_file(tmp_path):
    more = ("GRDSET,,,,,,7", "CORD2R,7,,0.,0.,0.,0.,1.,0.", ",0.,0.,1.", "SPC1,1,1,102", "MPC,4,101,1,1.0,103,1,-1.0")
    model = read_model(written(tmp_path, plain(), *more, case=("MPC = 4",)))
    assert model.equations.where == ("SPC of grid point 102 in turned axes", "MPC 4")
    left = model.equations.without_supports()
    assert (left.where, left.equation.tolist(), left.n_supports) == (("MPC 4",), [0, 0], 0)
    assert model.numbers[left.nodes].tolist() == [101, 103]


def test_grdset_supports_grid_points_and_a_set_that_is_not_selected_is_reported(tmp_path):
    model = plain()
    text = bdf(model, ("GRDSET,,,,,,,2",)).replace("SPC = 1\n", "")
    from_file = read_model(written(tmp_path, text=text))
    supported = {
        axis: set().union(*(from_file.groups[s.group].nodes for s in from_file.supports if axis in s.fix)) for axis in "xy"
    }
    assert supported == {"x": set(model.sets["PLATE_BASE"]), "y": set(range(len(model.points)))}
    message = "the case control names no set: Nastran would leave out set 1, the only one; it is taken over here"
    assert [(finding.effect, finding.is_taken, finding.changes) for finding in from_file.findings if finding.word == "SPC"] == [
        (message, True, False)
    ]
    assert passed_over(from_file) == [f"taken over SPC 1: SPC: {message}"]


def test_ranges_of_an_spc1_may_include_missing_grid_points(tmp_path):
    """MYSTRAN's SB-HEXA08 has 10101 THRU 10505 on a mesh with every second number; Nastran ignores missing ones of a range."""
    model = plain()
    last = int(model.numbers.max())
    from_file = read_model(written(tmp_path, model, f"SPC1,1,2,{last - 1},THRU,{last + 5}"))
    assert {i for s in from_file.supports if "y" in s.fix for i in from_file.groups[s.group].nodes} >= {len(model.points) - 1}
    (effect,) = (finding.effect for finding in from_file.findings if finding.word == "SPC1")
    assert effect.startswith(f"5 of its 7 grid points, as {last + 1}, are not in the file")
    with pytest.raises(MeshError, match=f"SPC1 names grid point {last + 5}"):
        read_model(written(tmp_path, model, f"SPC1,1,2,{last + 5},THRU,{last + 6}"))


@pytest.mark.parametrize("case, kind", [("SPC = 1", "MPC"), ("MPC = 7", "SPC")])
def test_sets_of_a_kind_that_the_case_control_does_not_select_are_omitted(tmp_path, case, kind):
    a, b = plain().numbers[:2]
    text = bdf(plain(), (f"MPC,7,{a},1,1.0,{b},1,-1.0",)).replace("SPC = 1\n", f"{case}\n")
    model = read_model(written(tmp_path, text=text))
    assert (model.equations is None, model.supports == ()) == (kind == "MPC", kind == "SPC")
    number = 7 if kind == "MPC" else 1
    message = f"the case control names no {kind} set, and Nastran leaves set {number} out, too"
    assert [(finding.word, finding.effect, finding.changes) for finding in model.findings] == [(kind, message, False)]


def test_sets_of_all_subcases_are_used(tmp_path):
    a, b = plain().numbers[:2]
    text = bdf(plain(), (f"MPC,7,{a},1,1.0,{b},1,-1.0",)).replace("SPC = 1\n", "SUBCASE 1\nSPC = 1\nSUBCASE 2\nMPC = 7\n")
    model = read_model(written(tmp_path, text=text))
    assert model.supports and model.equations is not None and model.findings == ()


def test_a_mean_of_equal_weights_is_distributing(tmp_path):
    model = plain()
    a, b, c = map(int, model.numbers[:3])
    from_file = read_model(written(tmp_path, model, "GRID,5000,,0.1,0.0,0.03", f"RBE3,901,,5000,123456,1.0,123,{a},{b}", f",{c}"))
    (point,) = from_file.connected
    assert (point.connection, point.weights) == ("distributing", "equal") and from_file.findings == ()
    assert from_file.groups[point.group].nodes.tolist() == [0, 1, 2]


def test_cylindrical_systems_of_position_and_displacement(tmp_path):
    """Field CP is the system of the position, field CD that of the supports, here along r of a cylindrical system."""
    model = plain()
    more = ("CORD2C,6,,0.0,0.0,0.0,0.0,0.0,1.0", ",1.0,0.0,0.0", "GRID,6000,6,2.0,30.0,0.5,6", "SPC1,1,1,6000")
    extra = (f"CTETRA,950,1,6000,{model.numbers[0]},{model.numbers[1]},{model.numbers[2]}",)
    from_file = read_model(written(tmp_path, model, *more, *extra))
    at = int(np.flatnonzero(from_file.numbers == 6000)[0])
    assert from_file.points[at] == pytest.approx((np.sqrt(3.0), 1.0, 0.5))
    assert from_file.equations.nodes.tolist() == [at] * 2
    assert from_file.equations.coefficients == pytest.approx((np.cos(np.pi / 6), 0.5), abs=1e-12)


@pytest.mark.parametrize(
    "card, message",
    [
        ("CBAR,990,4,101,102,0.0,0.0,1.0", "CBAR: a bar"),
        ("SPC,1,101,1,0.01", "SPC: a displacement of 0.01 other than 0"),
        ("CONM2,990,101,,1.0,0.1,0.0,0.0", "CONM2: a mass away from its grid point"),
        ("RBE2,990,101,1,102", "RBE2: a rigid element in 1 alone"),
        ("CELAS2,990,1.0,101,1,102,2", "CELAS2: a spring between displacements that differ"),
        ("CELAS2,990,1.0,101,4,102,4", "CELAS2: a spring between displacements that differ"),
        ("FOOBAR,1,2,3", "FOOBAR: not known to this program"),
        ("BSURF,7,ELEM1,1,2", "BSURF: a surface in contact"),
    ],
)
def test_cards_that_change_the_answer_are_refused_unless_ignored(tmp_path, card, message):
    path = written(tmp_path, plain(), card)
    with pytest.raises(CaseError, match=f"(?s)1 entry is not modelled.*{message}"):
        complete(scene(tmp_path), read_model(path))
    complete(scene(tmp_path, ignore=(card.split(",")[0],)), read_model(path))


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda text: text.replace("GRID*,101,", "GRID*,102,"), "102"),
        (lambda text: text.replace("CHEXA,1,1,101,", "CHEXA,1,1,77777,"), "names grid point 77777, which the file does not hold"),
        (lambda text: text.replace("GRID*,103,,", "GRID*,103,,abc"), "GRID"),
        (lambda text: text[: text.index("CHEXA")], "holds no grid points and elements"),
        (lambda text: text.replace("SPC1,1,123,", "SPC1,1,123,88888,"), "SPC1 names grid point 88888"),
        (lambda text: text + "INCLUDE '../other.bdf'\n", "it includes '../other.bdf', which lies outside of"),
        (lambda text: text + "INCLUDE 'none.bdf'\n", "it includes 'none.bdf', and there is no such file"),
        (lambda text: text + "INCLUDE 'model.bdf'\n", "it includes 'model.bdf', which includes this file"),
        (lambda text: "", "the file is empty"),
        (lambda text: "\x00\x01" * 500, "holds no grid points and elements"),
    ],
)
def test_damaged_files_are_refused_with_one_message_and_no_output(tmp_path, capfd, change, message):
    text = change(bdf(plain()))
    with pytest.raises(CaseError, match=f"(?s)model.bdf: .*{message}"):
        read_model(written(tmp_path, text=text))
    output = capfd.readouterr()
    assert output.out == output.err == ""


def test_included_files_are_read(tmp_path):
    text = bdf(plain())
    at = text.index("GRID*,110")
    (tmp_path / "more.inc").write_text(text[at : text.index("CHEXA")])
    expected = read_model(written(tmp_path, text=text))
    parts = read_model(written(tmp_path, text=text[:at] + "INCLUDE 'more.inc'\n" + text[text.index("CHEXA") :]))
    np.testing.assert_array_equal(parts.points, expected.points)


def test_the_streams_of_the_program_are_restored(monkeypatch):
    """The logger of pyNastran replaces them on terminals."""
    before = sys.stdout, sys.stderr
    with restored_streams():
        monkeypatch.setattr(sys, "stdout", None)
    assert (sys.stdout, sys.stderr) == before
