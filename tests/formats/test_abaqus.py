"""Input files of Abaqus and CalculiX: parts, includes, sets, surfaces, properties, connections, findings and damaged files."""

import contextlib
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from plain_model import CUBE, bdf, inp, plain, tables

from microslip import elements
from microslip.assembly.assemble import assemble
from microslip.formats.model import FileSectors
from microslip.formats.read import read_model
from microslip.library.complete import complete
from microslip.linear.joint_springs import linearise
from microslip.mesh.links import find_links
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.read import read_mesh
from microslip.messages.errors import CaseError, MeshError
from microslip.modes.eigen import lowest_modes
from microslip.scene.read import scene_of
from microslip.tables.structure import Body, Material, Spring, Support, Tie

sys.path.insert(0, str(Path(__file__).parents[2] / "meshes"))

from brake_reuss import BrakeReuss, input_file

STEEL = """*MATERIAL, NAME=Steel
*ELASTIC
210000., .3
*DENSITY
7.85e-9
*SOLID SECTION, ELSET=CUBE, MATERIAL=STEEL
"""
# a second cube above the cube, and a reference node
TWICE = """*NODE
11, 0, 0, 1
12, 1, 0, 1
13, 1, 1, 1
14, 0, 1, 1
15, 0, 0, 2
16, 1, 0, 2
17, 1, 1, 2
18, 0, 1, 2
99, 0.5, 0.5, 3
*ELEMENT, TYPE=C3D8R, ELSET=SECOND
2, 11, 12, 13, 14, 15, 16, 17, 18
*SURFACE, NAME=TOP
CUBE, S2
*SURFACE, NAME=FEET
SECOND, S1
*SURFACE, NAME=CROWN
2, S2
*NSET, NSET=POLE
99
"""


def read(tmp_path, text, name="job.inp"):
    (tmp_path / name).write_text(text)
    return read_model(tmp_path / name)


def numbers(model, group):
    """Return the numbers of the nodes of a group."""
    return model.numbers[model.groups[group].nodes].tolist()


def words(model, changes=True):
    return [finding.word for finding in model.findings if finding.changes == changes]


PART = "*PART, NAME=P\n" + CUBE + "*NSET, NSET=base, GENERATE\n1, 4\n*SURFACE, NAME=top\nCUBE, S2\n*END PART\n"
TWO = """*ASSEMBLY, NAME=A
*INSTANCE, NAME=one, PART=P
*END INSTANCE
*INSTANCE, NAME=two, PART=P
10., 0., 0.
10., 0., 0., 10., 0., 1., 90.
*END INSTANCE
*NODE
1, 7., 8., 9.
*NSET, NSET=both
one.base, two.8
*NSET, NSET=from_two, INSTANCE=two
1, base
*ELSET, ELSET=all_of_it
one.CUBE, two.CUBE
*SURFACE, NAME=tops
all_of_it, S2
*END ASSEMBLY
"""


def test_instances_are_translated_then_rotated_and_prefix_their_names(tmp_path):
    model = read(tmp_path, PART + TWO)
    assert model.numbers.tolist() == [*range(1, 9), *range(11, 19), 21]
    np.testing.assert_allclose(model.points[8:12], [[10, 0, 0], [10, 1, 0], [9, 1, 0], [9, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(model.points[16], [7, 8, 9])
    assert numbers(model, "one.base") == [1, 2, 3, 4] and numbers(model, "two.base") == [11, 12, 13, 14]
    assert numbers(model, "both") == [1, 2, 3, 4, 18] and numbers(model, "from_two") == [11, 12, 13, 14]
    assert sum(len(rows) for rows in model.groups["tops"].cells.values()) == 2
    assert "two.top" in model.groups and "base" not in model.groups
    assert any("raised by 10" in fact for fact in model.facts)


def test_unique_numbers_are_preserved_and_a_single_instance_needs_no_prefix(tmp_path):
    only = TWO[: TWO.index("*INSTANCE, NAME=two")] + "*NODE\n50, 0., 0., 5.\n*END ASSEMBLY\n"
    model = read(tmp_path, PART + only)
    assert model.numbers.tolist() == [*range(1, 9), 50]
    assert numbers(model, "base") == numbers(model, "one.base") == [1, 2, 3, 4]
    assert read(tmp_path, PART).numbers.tolist() == list(range(1, 9))  # a part without instances


@pytest.mark.parametrize(
    "text, point",
    [
        ("*NODE, SYSTEM=C\n1, 2., 90., 3.\n", (0, 2, 3)),
        ("*NODE, SYSTEM=S\n1, 2., 0., 30.\n", (np.sqrt(3.0), 0, 1)),
        ("*SYSTEM\n1., 1., 1.\n*NODE\n1, 1., 2., 3.\n*SYSTEM\n", (2, 3, 4)),
        ("*SYSTEM\n1., 0., 0., 1., 1., 0.\n0., 0., 0.\n*NODE\n1, 1., 2., 3.\n*SYSTEM\n", (-1, 1, 3)),
        ("*NODE\n1, 1., , 3.\n", (1, 0, 3)),
        ("*NODE\n1, 1., 2.\n", (1, 2, 0)),
        ("*NODE\n1, 1.D0, 2.d-1, 3.\n", (1, 0.2, 3)),
    ],
)
def test_coordinates_in_local_systems(tmp_path, text, point):
    model = read(tmp_path, text + CUBE.replace("1, 0, 0, 0\n", "", 1))
    np.testing.assert_allclose(model.points[0], point, atol=1e-12)


def test_includes_are_relative_to_the_folder_of_the_file_and_may_hold_data_lines_only(tmp_path):
    (tmp_path / "parts").mkdir()
    lines = CUBE.splitlines()
    (tmp_path / "parts" / "nodes.txt").write_text("\n".join(lines[1:5]) + "\n** a comment\n" + "\n".join(lines[5:9]))
    (tmp_path / "parts" / "rest.inp").write_text("*INCLUDE, INPUT=more.inp\n*WHATEVER\n")
    (tmp_path / "parts" / "more.inp").write_text("*ELEMENT, TYPE=C3D8\n" + lines[-1] + "\n")
    model = read(tmp_path, "*NODE, INPUT=parts/nodes.txt\n*INCLUDE, INPUT=parts/rest.inp\n")
    assert len(model.numbers) == 8 and model.cells[0].numbers.tolist() == [1]
    unknown = next(finding for finding in model.findings if finding.word == "*WHATEVER")
    assert unknown.where == "parts/rest.inp, line 2" and unknown.changes and "not known" in unknown.effect


def test_elements_continue_on_further_lines_until_all_nodes_are_read(tmp_path):
    spread = CUBE.replace("1, 1, 2, 3, 4, 5, 6, 7, 8\n", "1, 1, 2, 3, 4,\n5, 6, 7, 8, 9, 10,\n2, 8, 7, 6, 5, 4, 3, 2, 1, 77,\n")
    assert read(tmp_path, spread).cells[0].nodes.tolist() == [list(range(8)), list(range(7, -1, -1))]


def test_surfaces_of_element_faces_free_faces_and_nodes(tmp_path):
    more = "*SURFACE, NAME=outside\n,\n*SURFACE, NAME=low, TYPE=NODE\n1, \n2,\n*SURFACE, NAME=of_set\nCUBE,\n"
    stacked = CUBE + TWICE.replace("11, 12, 13, 14, 15", "5, 6, 7, 8, 15")
    model = read(tmp_path, stacked + more)
    count = {name: sum(len(rows) for rows in group.cells.values()) for name, group in model.groups.items()}
    assert count["outside"] == 10 and count["of_set"] == 5 and numbers(model, "low") == [1, 2]


def test_each_section_and_integration_has_a_body(tmp_path):
    text = CUBE + TWICE + "*ELSET, ELSET=EVERY\nCUBE, SECOND\n" + STEEL.replace("ELSET=CUBE", "ELSET=EVERY")
    model = read(tmp_path, text + "*EXPANSION\n1.2e-5\n")
    assert model.materials == {"Steel": Material.of_file(young=210000.0, poisson=0.3, density=7.85e-9, expansion=1.2e-5)}
    assert model.bodies == {
        "EVERY C3D8": Body.of_file(group="EVERY C3D8", material="Steel", incompatible_modes=False),
        "EVERY C3D8R": Body.of_file(group="EVERY C3D8R", material="Steel"),
    }
    assert "*ELEMENT, TYPE=C3D8R" in words(model, changes=False) and words(model) == []
    assert [finding.is_taken for finding in model.findings if finding.word == "*ELEMENT, TYPE=C3D8R"] == [True]


def test_supports_are_those_of_the_first_frequency_step(tmp_path):
    steps = "*STEP\n*STATIC\n*BOUNDARY\n5, 3\n*END STEP\n*STEP\n*FREQUENCY\n2\n*BOUNDARY, OP={op}\nALL, YSYMM\n*END STEP\n"
    steps += "*STEP\n*STATIC\n*BOUNDARY\nALL, ENCASTRE\n*END STEP\n"
    text = CUBE + "*BOUNDARY\n1, 1, 2\n2, 1, 2\n" + steps
    expected = (
        Support.of_file(group="*BOUNDARY xy", fix=("x", "y")),
        Support.of_file(group="*BOUNDARY z", fix=("z",)),
        Support.of_file(group="ALL", fix=("y",)),
    )
    assert read(tmp_path, text.format(op="MOD")).supports == expected
    assert read(tmp_path, text.format(op="NEW")).supports == expected[2:]


def test_the_group_of_a_support_has_only_the_supported_nodes(tmp_path):
    text = CUBE + "*NSET, NSET=CUBE\n1, 2\n*BOUNDARY\nCUBE, PINNED\n" + STEEL
    model = read(tmp_path, text)
    assert [support.group for support in model.supports] == ["CUBE (nodes)"]
    assert numbers(model, "CUBE (nodes)") == [1, 2]


GENERATED = """*NODE
1, 0, 0, 0
5, 4, 0, 0
21, 0, 2, 0
25, 4, 2, 0
*NGEN, NSET=FRONT
1, 5
*NGEN, NSET=BACK
25, 21, 1
*NFILL, NSET=FLOOR
FRONT, BACK, 2, 10
*NCOPY, CHANGE NUMBER=100, OLD SET=FLOOR, SHIFT, NEW SET=ROOF
0, 0, 1.5

*ELEMENT, TYPE=C3D8
1, 1, 2, 12, 11, 101, 102, 112, 111
*ELGEN, ELSET=CUBE
1, 4, 1, 1, 2, 10, 10
*NCOPY, CHANGE NUMBER=1000, OLD SET=FLOOR, SHIFT, NEW SET=FLOOR2
0., 0., 1.5
0, 0, 0, 0, 0, 1, 90
*NCOPY, CHANGE NUMBER=1000, OLD SET=ROOF, SHIFT
0., 0., 1.5
0, 0, 0, 0, 0, 1, 90
*ELCOPY, ELEMENT SHIFT=1000, OLD SET=CUBE, SHIFT NODES=1000, NEW SET=TURNED
"""


def test_nodes_and_elements_are_generated_from_others(tmp_path):
    """*NGEN, *NFILL, *NCOPY, *ELGEN, *ELCOPY make a box of 4 x 2 x 1 elements, and a copy above it, rotated 90 degrees about z."""
    model = read(tmp_path, GENERATED)
    at = {int(number): point for number, point in zip(model.numbers, model.points, strict=True)}
    expected = {1 + i + 10 * j + 100 * k: (i, j, 1.5 * k) for i in range(5) for j in range(3) for k in range(2)}
    for number, (x, y, z) in expected.items():
        assert at[number] == pytest.approx((x, y, z))
        assert at[number + 1000] == pytest.approx((-y, x, z + 1.5), abs=1e-12)
    assert len(at) == 60
    rows = {}
    for cells in model.cells:
        rows |= {int(number): model.numbers[nodes].tolist() for number, nodes in zip(cells.numbers, cells.nodes, strict=True)}
        assert (elements.jacobian_minimum(cells.kind, model.points[cells.nodes]) > 0.0).all()
    corner = np.array([1, 2, 12, 11, 101, 102, 112, 111])
    generated = {1 + i + 10 * j: (corner + i + 10 * j).tolist() for i in range(4) for j in range(2)}
    assert rows == generated | {number + 1000: [node + 1000 for node in nodes] for number, nodes in generated.items()}
    assert {int(number) for number in model.numbers[model.groups["FRONT"].nodes]} == {1, 2, 3, 4, 5}
    assert {int(number) for number in model.numbers[model.groups["FLOOR"].nodes]} == {n for n in expected if n < 100}


def test_nodes_along_an_arc_about_a_centre(tmp_path):
    model = read(tmp_path, CUBE + "*NODE\n20, 2, 0, 0\n26, 0, 2, 0\n30, 0, 0, 0\n*NGEN, LINE=C\n20, 26, 2, 30\n")
    at = {int(number): point for number, point in zip(model.numbers, model.points, strict=True)}
    angles = np.pi / 2 * np.array([1, 2]) / 3
    np.testing.assert_allclose([at[22], at[24]], 2.0 * np.column_stack([np.cos(angles), np.sin(angles), [0, 0]]), atol=1e-12)
    by_place = read(tmp_path, CUBE + "*NODE\n20, 2, 0, 0\n26, 0, 2, 0\n*NGEN, LINE=C\n20, 26, 2, , 0., 0., 0.\n")
    assert by_place.points[by_place.numbers == 22][0] == pytest.approx(at[22])


@pytest.mark.parametrize("expansion, changes", [("", False), ("*EXPANSION\n1e-5\n", True)])
def test_a_prescribed_temperature_is_no_support(tmp_path, expansion, changes):
    """Degree of freedom 11 supports no node; it changes the answer only if a material expands."""
    material = STEEL.replace("*SOLID", f"{expansion}*SOLID")
    model = read(tmp_path, CUBE + "*BOUNDARY\n1, 1, 3\n2, 11, 11, 80.\n" + material)
    (finding,) = (finding for finding in model.findings if finding.word == "*BOUNDARY")
    assert finding.effect.startswith("a temperature") and finding.changes == changes
    assert [support.fix for support in model.supports] == [("x", "y", "z")]


def test_supports_in_nodal_axes_become_equations(tmp_path):
    text = CUBE + "*TRANSFORM, NSET=ALL, TYPE=C\n0.5, -1, 0, 0.5, -1, 1\n*BOUNDARY\n1, 1\n2, 1, 3\n3, 2\n"
    model = read(tmp_path, text)
    assert model.supports == (Support.of_file(group="*BOUNDARY xyz", fix=("x", "y", "z")),)
    radial, tangential = np.array([-0.5, 1.0]) / np.sqrt(1.25), np.array([-2.0, 0.5]) / np.sqrt(4.25)
    values = {}
    for node, axis, value in zip(model.equations.nodes, model.equations.axes, model.equations.coefficients, strict=True):
        values[int(model.numbers[node]), int(axis)] = value
    assert values == pytest.approx({(1, 0): radial[0], (1, 1): radial[1], (3, 0): tangential[0], (3, 1): tangential[1]})


def test_ties_couplings_and_contact(tmp_path):
    more = "*SURFACE, NAME=nodes, TYPE=NODE\n5\n6\n7\n8\n*TIE, NAME=glue, POSITION TOLERANCE=0.1\nFEET, nodes\n"
    more += "*COUPLING, CONSTRAINT NAME=hub, REF NODE=POLE, SURFACE=CROWN\n*KINEMATIC\n*CONTACT PAIR, INTERACTION=i\nFEET, TOP\n*CONTACT PAIR, TIED\nFEET, TOP\n"
    more += "*SURFACE INTERACTION, NAME=i\n*FRICTION\n0.25\n*BOUNDARY\nPOLE, 1, 6\n"
    more += "*ELEMENT, TYPE=MASS, ELSET=lump\n500, 99\n*MASS, ELSET=lump\n2.5\n*ELEMENT, TYPE=ROTARYI, ELSET=turn\n501, 99\n"
    more += "*ROTARY INERTIA, ELSET=turn\n1., 2., 3., .1, .2, .3\n"
    model = read(tmp_path, CUBE + TWICE + more)
    assert model.ties == (
        Tie.of_file(surfaces=("FEET", "nodes (faces)"), name="glue", tolerance=0.1),
        Tie.of_file(surfaces=("FEET", "TOP")),
    )
    (point,) = model.connected
    assert (point.name, point.position, point.group, point.connection) == ("hub", (0.5, 0.5, 3.0), "CROWN", "rigid")
    assert point.mass == 2.5 and point.inertia == (1.0, 2.0, 3.0, 0.1, 0.3, 0.2)
    assert model.supports == (Support.of_file(point="hub", fix=("x", "y", "z", "rx", "ry", "rz")),)
    contact = next(finding for finding in model.findings if finding.word == "*CONTACT PAIR")
    assert contact.surfaces == ("FEET", "TOP") and "friction 0.25" in contact.effect


@pytest.mark.parametrize("line, inertia", [("1., , , , .2", (1.0, 0.0, 0.0, 0.0, 0.0, 0.2)), (" , 2.", (0.0, 2.0) + 4 * (0.0,))])
def test_blank_fields_of_an_inertia_are_zero(tmp_path, line, inertia):
    """A blank field does not move the numbers behind it to another place."""
    more = "*COUPLING, CONSTRAINT NAME=hub, REF NODE=POLE, SURFACE=CROWN\n*KINEMATIC\n"
    more += f"*ELEMENT, TYPE=ROTARYI, ELSET=turn\n501, 99\n*ROTARY INERTIA, ELSET=turn\n{line}\n"
    (point,) = read(tmp_path, CUBE + TWICE + more).connected
    assert point.inertia == inertia


@pytest.mark.parametrize(
    "card",
    [
        "*RIGID BODY, NSET=UPPER, REF NODE=99\n",
        "*KINEMATIC COUPLING, REF NOD=99\nUPPER, 1, 6\n",
        "*MPC\nBEAM, UPPER, 99\n",
        "*ELEMENT, TYPE=DCOUP3D, ELSET=D\n77, 99\n*DISTRIBUTING COUPLING, ELSET=D\nUPPER, 1.\n",
    ],
)
def test_nodes_connected_to_a_reference_node(tmp_path, card):
    model = read(tmp_path, CUBE + TWICE + "*NSET, NSET=UPPER\n15, 16, 17, 18\n" + card)
    (point,) = model.connected
    assert point.connection == ("distributing" if "DISTR" in card else "rigid") and point.name == "node 99"
    assert numbers(model, point.group) == [15, 16, 17, 18]
    notes = [finding.effect for finding in model.findings if not finding.changes and finding.word == "*DISTRIBUTING COUPLING"]
    assert len(notes) == ("DISTR" in card) and not any("DCOUP3D" in finding.word for finding in model.findings)
    coplanar = read(
        tmp_path, CUBE + TWICE.replace("99, 0.5, 0.5, 3", "99, .5, .5, 2") + "*NSET, NSET=UPPER\n15, 16, 17, 18\n" + card
    )
    assert not any(finding.word == "*DISTRIBUTING COUPLING" for finding in coplanar.findings)


def test_missing_coordinates_are_zero(tmp_path):
    """As in CalculiX, whose example beam10p.inp has such lines; a note reports lines of different length."""
    complete_text, short = CUBE.replace("1, 0, 0, 0", "1, 0., 0., 0."), CUBE
    for line, fewer in (("1, 0, 0, 0", "1, 0, 0"), ("2, 1, 0, 0", "2, 1.")):
        assert line in CUBE
        short = short.replace(line, fewer)
    model, complete_lines = read(tmp_path, short), read(tmp_path, complete_text)
    np.testing.assert_array_equal(model.points, complete_lines.points)
    notes = [finding.effect for finding in model.findings if finding.word == "*NODE" and not finding.changes]
    assert notes == ["2 lines hold fewer coordinates than others; the missing ones are 0, as in CalculiX"]
    assert not [finding for finding in complete_lines.findings if finding.word == "*NODE"]


def test_weights_of_a_distributing_coupling(tmp_path):
    """Stated weights replace areas, in the order of node numbers; a weight that is not positive is refused."""
    card = "*NSET, NSET=UPPER\n15, 16\n*ELEMENT, TYPE=DCOUP3D, ELSET=D\n77, 99\n*DISTRIBUTING COUPLING, ELSET=D\n"
    for lines, weights in (
        ("18, 4.\nUPPER, 1.\n17, 2.\n", (1.0, 1.0, 2.0, 4.0)),
        ("UPPER, 3.\n17, 3.\n18, 3.\n", "equal"),
        ("UPPER\n17\n18\n", "equal"),
    ):
        (point,) = read(tmp_path, CUBE + TWICE + card + lines).connected
        assert (point.connection, point.weights) == ("distributing", weights)
    with pytest.raises(MeshError, match=r"\*DISTRIBUTING COUPLING: a weight is '-1.', not a number above 0"):
        read(tmp_path, CUBE + TWICE + card + "UPPER, -1.\n")


def test_springs_and_masses(tmp_path):
    more = "*ELEMENT, TYPE=SPRING1, ELSET=feet\n21, 1\n22, 2\n*SPRING, ELSET=feet\n3\n5.\n"
    more += "*ELEMENT, TYPE=SPRINGA, ELSET=rod\n23, 7, 99\n*SPRING, ELSET=rod\n\n7.\n"
    more += "*ELEMENT, TYPE=SPRING2, ELSET=link\n24, 5, 11\n*SPRING, ELSET=link\n1, 1\n9.\n"
    more += "*ELEMENT, TYPE=MASS, ELSET=lump\n25, 3\n*MASS, ELSET=lump\n4.\n"
    model = read(tmp_path, CUBE + TWICE + more)
    up, along = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    assert model.springs == (
        Spring.of_file(groups=("node 1",), direction=up, stiffness=5.0),
        Spring.of_file(groups=("node 2",), direction=up, stiffness=5.0),
        Spring.of_file(groups=("node 7", "node 99"), stiffness=7.0),
        Spring.of_file(groups=("node 5", "node 11"), direction=along, stiffness=9.0),
    )
    assert [(numbers(model, mass.group), mass.mass) for mass in model.masses] == [([3], 4.0)]


def test_dampers_are_springs_with_damping(tmp_path):
    more = "*ELEMENT, TYPE=DASHPOT1, ELSET=feet\n21, 1\n*DASHPOT, ELSET=feet\n3\n5.\n"
    more += "*ELEMENT, TYPE=DASHPOTA, ELSET=rod\n23, 7, 99\n*DASHPOT, ELSET=rod\n\n7.\n"
    more += "*ELEMENT, TYPE=DASHPOT2, ELSET=link\n24, 5, 11\n*DASHPOT, ELSET=link\n1, 1\n9.\n"
    model = read(tmp_path, CUBE + STEEL + TWICE + more)
    assert model.springs == (
        Spring.of_file(groups=("node 1",), direction=(0.0, 0.0, 1.0), damping=5.0),
        Spring.of_file(groups=("node 7", "node 99"), damping=7.0),
        Spring.of_file(groups=("node 5", "node 11"), direction=(1.0, 0.0, 0.0), damping=9.0),
    )
    assert not any("DASHPOT" in word for word in words(model))


@pytest.mark.parametrize(
    "card",
    [
        "*DASHPOT, ELSET=rod\n\n7., 10.\n8., 20.\n",
        "*DASHPOT, ELSET=rod\n\n7., 10.\n",
        "*DASHPOT, ELSET=rod, NONLINEAR\n\n7., 1.\n",
    ],
)
def test_nonlinear_dampers_change_the_answer(tmp_path, card):
    model = read(tmp_path, CUBE + STEEL + TWICE + "*ELEMENT, TYPE=DASHPOTA, ELSET=rod\n23, 7, 99\n" + card)
    (word,) = (word for word in words(model) if "DASHPOT" in word)
    assert word == ("*DASHPOT, NONLINEAR" if "NON" in card else "*DASHPOT") and model.springs == ()


def test_masses_and_springs_of_the_assembly_are_at_nodes_of_instances(tmp_path):
    more = "*ELEMENT, TYPE=MASS, ELSET=M\n1, two.7\n*MASS, ELSET=M\n0.5,\n"
    more += '*ELEMENT, TYPE=SPRINGA, ELSET="S, 1"\n2, "one".3, two.8\n*SPRING, ELSET="S, 1"\n\n1e3\n'
    model = read(tmp_path, PART + TWO.replace("*END ASSEMBLY", more + "*END ASSEMBLY"))
    places = {name: i for i, name in enumerate([f"{part}.{k}" for part in ("one", "two") for k in range(1, 9)])}
    (mass,), (spring,) = model.masses, model.springs
    assert model.groups[mass.group].nodes.tolist() == [places["two.7"]] and mass.mass == 0.5
    assert [model.groups[name].nodes.tolist() for name in spring.groups] == [[places["one.3"]], [places["two.8"]]]
    with pytest.raises(MeshError, match=r"\*ELEMENT names 'two.base', which holds 4 nodes where one is expected"):
        read(tmp_path, PART + TWO.replace("*END ASSEMBLY", more.replace("two.7", "two.base") + "*END ASSEMBLY"))
    with pytest.raises(MeshError, match="expected a number and 1 node"):
        read(tmp_path, PART + TWO.replace("*END ASSEMBLY", more.replace("1, two.7", "two.7") + "*END ASSEMBLY"))


def test_names_in_quotes_may_hold_commas(tmp_path):
    model = read(
        tmp_path, CUBE + STEEL.replace("NAME=Steel", 'NAME="Steel, old"').replace("MATERIAL=STEEL", 'MATERIAL="STEEL, OLD"')
    )
    assert [body.material for body in model.bodies.values()] == ["Steel, old"] and not words(model)


def test_absurd_counts_need_no_memory_and_no_time(tmp_path):
    doubled = "".join(f"*NSET, NSET=s{i}\ns{i + 1}, s{i + 1}\n" for i in range(60)) + "*NSET, NSET=s60\n1\n"
    model = read(tmp_path, CUBE + "*NSET, NSET=n, GENERATE\n2, 9000000000000, 3\n" + doubled)
    assert numbers(model, "n") == [2, 5, 8] and numbers(model, "s0") == [1]
    assert any(
        "'n' names 2999999999997 nodes that the file does not hold, the first is 11" in finding.effect
        for finding in model.findings
    )


def test_missing_members_of_sets_are_reported(tmp_path):
    model = read(tmp_path, CUBE + "*NSET, NSET=n, GENERATE\n7, 12\n*ELSET, ELSET=e\n1, 2\n")
    assert numbers(model, "n") == [7, 8] and len(model.groups["e"].cells[0]) == 1
    assert [finding.effect for finding in model.findings if finding.word in ("*NSET", "*ELSET")] == [
        "'e' names 1 elements that the file does not hold, the first is 2",
        "'n' names 4 nodes that the file does not hold, the first is 9",
    ]


def test_equations_between_sets_and_between_nodes(tmp_path):
    more = "*NSET, NSET=A\n5, 6\n*NSET, NSET=B\n11, 12\n*EQUATION\n2\nA, 1, 1., B, 1, -1.\n3\n7, 2, 1., 8, 2, -.5,\n99, 2, -.5\n"
    equations = read(tmp_path, CUBE + TWICE + more).equations
    assert equations.equation.tolist() == [0, 0, 1, 1, 2, 2, 2] and equations.axes.tolist() == [0, 0, 0, 0, 1, 1, 1]
    assert equations.coefficients.tolist() == [1.0, -1.0, 1.0, -1.0, 1.0, -0.5, -0.5]
    assert equations.nodes.tolist() == [4, 8, 5, 9, 6, 7, 16]
    assert equations.where[2].startswith("*EQUATION, line")


def test_a_mass_on_a_spring_attached_by_an_equation(tmp_path):
    """The frequency is sqrt(k / m): a stiff cube, free along x; the mean motion of a face moves the end of a spring to ground."""
    text = CUBE + "*NODE\n21, -1., .5, .5\n22, 0., .5, .5\n*ELEMENT, TYPE=SPRINGA, ELSET=S\n9, 21, 22\n*SPRING, ELSET=S\n\n10.\n"
    text += "*BOUNDARY\n21, 1, 3\n22, 2, 3\nALL, 2, 3\n*EQUATION\n5\n22, 1, 1., 1, 1, -.25, 4, 1, -.25,\n5, 1, -.25, 8, 1, -.25\n"
    model = read(tmp_path, text + STEEL)
    scene, _ = complete(scene_of({**tables("job.inp"), "joints": ()}, tmp_path / "s.toml"), model)
    mesh = read_mesh(scene, model)
    pairs = pair_contacts(mesh, scene.joints)
    linearised = linearise(assemble(distribute(mesh, scene, MPI.COMM_SELF), mesh, pairs, scene), pairs, "job.inp")
    omega = lowest_modes(linearised, 1, verify=False).omega_n[0]
    linearised.destroy()
    assert omega == pytest.approx(np.sqrt(10.0 / 7.85e-9), rel=3e-5)  # the cube is elastic: 1e-5


def test_the_bolted_beam_is_read_unchanged(tmp_path):
    beam = BrakeReuss(around=2, radial=1, through=1, along=4)
    model = read(tmp_path, input_file(beam))
    assert len(model.bodies) == 14 and len(model.ties) == 15 and [point.name for point in model.connected] == ["SENSOR"]
    assert model.connected[0].mass == 2e-5 and model.connected[0].position == (725.0, 0.0, 0.0)
    assert words(model) == ["*CONTACT PAIR", "*STEP, PERTURBATION"] and len(model.bolts) == 3
    assert sum("in the file with 9000: [[statics.bolts]]" in finding.effect for finding in model.findings) == 3
    joint = {"name": "lap", "surfaces": ("LAP_LOWER", "LAP_UPPER"), "friction": 0.2, "preload": "static"}
    joint |= {"tangential_stiffness": 1e13, "normal_stiffness": 1e13}
    at = {"point": "SENSOR", "direction": (0.0, 0.0, 1.0)}
    bolts = tuple({"group": f"BOLT-{i}.CUT", "force": 9000.0} for i in (1, 2, 3))
    more = {"joints": (joint,), "loads": (at,), "outputs": ({"name": "end", **at},), "statics": {"bolts": bolts}}
    scene, _ = complete(scene_of({**tables("job.inp", units="mm-t-s"), **more}, tmp_path / "s.toml"), model)
    del more["statics"]
    taken, _ = complete(scene_of({**tables("job.inp", units="mm-t-s"), **more}, tmp_path / "s.toml"), model)
    assert [(bolt.group, bolt.force) for bolt in taken.statics.bolts] == [(f"BOLT-{i}.CUT", 9000.0) for i in (1, 2, 3)]
    assert taken.statics.deformed_shape and not scene.statics.deformed_shape
    mesh = read_mesh(scene, model)
    pairs = pair_contacts(mesh, scene.joints)
    np.testing.assert_allclose(mesh.points[pairs.node1], mesh.points[pairs.node2], atol=1e-9)
    lap = 0.12 * 0.025 - 3 * 2.0 * np.sqrt(2.0) * 0.0043**2  # the holes are octagons
    assert pairs.area.sum() == pytest.approx(lap, rel=1e-6)
    assert len(find_links(mesh, scene).notes) == 16


FINDINGS = {
    "*ELASTIC, TYPE=LAMINA\n1., 1., .3, 1., 1., 1.\n": "*ELASTIC, TYPE=LAMINA",
    "*ELASTIC\n210000., .3, 0.\n200000., .3, 500.\n": "*ELASTIC",
    "*INITIAL CONDITIONS, TYPE=STRESS\nCUBE, 1.\n": "*INITIAL CONDITIONS, TYPE=STRESS",
    "*MATRIX ASSEMBLE, STIFFNESS=K\n": "*MATRIX ASSEMBLE",
    "*SHELL SECTION, ELSET=CUBE\n1.\n": "*SHELL SECTION",
    "*CYCLIC SYMMETRY MODEL, N=12\n": "*CYCLIC SYMMETRY MODEL",
    "*TIE, CYCLIC SYMMETRY, NAME=T\nTOP, FEET\n": "*TIE, CYCLIC SYMMETRY",
    "*SURFACE, NAME=three, TYPE=NODE\n5\n6\n7\n*TIE, NAME=T\nFEET, three\n": "*TIE",
    "*SPRING, NONLINEAR, ELSET=CUBE\n\n1., 1.\n": "*SPRING, NONLINEAR",
    "*ELEMENT, TYPE=SPRING1, ELSET=S\n77, 1\n*SPRING, ELSET=S\n1\n5.\n9., , 100.\n": "*SPRING",
    "*ELEMENT, TYPE=B31, ELSET=BEAM\n77, 1, 2\n": "*ELEMENT, TYPE=B31",
    "*ELEMENT, TYPE=MASS, ELSET=LUMP\n77, 1\n": "*ELEMENT, TYPE=MASS",
    "*BOUNDARY\n1, 1, 1, 0.5\n": "*BOUNDARY",
    "*MPC\nSLIDER, 1, 2, 3\n": "*MPC SLIDER",
    "*EQUATION\n2\n1, 4, 1., 2, 1, 1.\n": "*EQUATION",
    "*COUPLING, CONSTRAINT NAME=C, REF NODE=99, SURFACE=CROWN\n*KINEMATIC\n3, 3\n": "*KINEMATIC",
    "*CONTACT\n": "*CONTACT",
    "*SOLID SECTIONS, ELSET=SECOND\n": "*SOLID SECTIONS",
    "*RIGID BODY, NSET=ALL, REF NODE=99, POSITION=CENTER OF MASS\n": "*RIGID BODY, POSITION",
}


@pytest.mark.parametrize("card, word", FINDINGS.items(), ids=FINDINGS.values())
def test_cards_that_change_the_answer_are_findings(tmp_path, card, word):
    plain_text = CUBE + TWICE + STEEL
    before = words(read(tmp_path, plain_text))
    assert [each for each in words(read(tmp_path, plain_text + "*MATERIAL, NAME=other\n" + card)) if each not in before] == [word]


STEPS = """*STEP, NAME=Fixed, PERTURBATION
*FREQUENCY
2
*BOUNDARY
ALL, ENCASTRE
*END STEP
*STEP, NAME=Press
*STATIC
*BOUNDARY
1, PINNED
*CLOAD
5, 3, -1.
6, 3, -1.
*END STEP
*STEP, NAME=Modes, PERTURBATION
*FREQUENCY
2
*END STEP
"""


@pytest.mark.parametrize(
    "step, n_supported, at_rest", [(None, 8, None), (1, 8, None), (2, 1, "*STATIC"), (3, 1, "*STEP, PERTURBATION")]
)
def test_boundary_conditions_are_those_of_the_chosen_step(tmp_path, step, n_supported, at_rest):
    """Supports of a perturbation step end with it; a chosen *STATIC step is the reference state, with its loads."""
    (tmp_path / "job.inp").write_text(CUBE + STEEL + STEPS)
    model = read_model(tmp_path / "job.inp", step)
    assert len(set(np.concatenate([model.groups[support.group].nodes for support in model.supports]).tolist())) == n_supported
    assert model.step == (step or 1)
    assert (None if model.statics is None else model.statics.word) == at_rest
    if at_rest:
        assert model.statics.kinds == ["1 force"] and words(model) == [at_rest]
        assert model.statics.table.forces[0].force == (0.0, 0.0, -2.0)


def test_the_table_of_steps_lists_stated_and_used_conditions(tmp_path):
    heat = "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 20.\n*BOUNDARY\n4, PINNED\n"
    (tmp_path / "job.inp").write_text(CUBE + STEEL + heat + STEPS)
    rows = {step.number: step for step in read_model(tmp_path / "job.inp", 3).steps}
    assert rows[0].states == {"supports": "single nodes", "temperatures": "ALL"} and "supports" in rows[0].taken
    assert rows[1].procedure == '*FREQUENCY, PERTURBATION "Fixed"' and rows[1].states == {"supports": "ALL"}
    assert rows[1].taken == () and rows[3].taken == ("supports",)
    assert rows[2].states == {"supports": "single nodes", "loads": "2 *CLOAD"}
    assert set(rows[2].taken) == {"supports", "loads", "temperatures"}


@pytest.mark.parametrize("text, step, message", [
    (STEPS, 4, r'\[model\] step = 4: the file has 3 steps, 1: \*FREQUENCY, PERTURBATION "Fixed"; 2: \*STATIC "Press"; 3: '),
    ("", 1, r"\[model\] step = 1: the file has no steps"),
])  # fmt: skip
def test_a_missing_step_is_refused_with_a_list_of_the_steps(tmp_path, text, step, message):
    (tmp_path / "job.inp").write_text(CUBE + STEEL + text)
    with pytest.raises(MeshError, match=message):
        read_model(tmp_path / "job.inp", step)


def test_a_step_of_a_format_without_steps_is_refused(tmp_path):
    (tmp_path / "m.bdf").write_text(bdf(plain()))
    with pytest.raises(CaseError, match=r"\[model\] step = 2: .*: of files .bdf no steps are read; leave step out"):
        read_model(tmp_path / "m.bdf", 2)


VIBRATION = "*STEP, PERTURBATION\n*FREQUENCY\n2\n*END STEP\n"
STATICS = {
    "*DLOAD\nCUBE, GRAV, 9810., 0., 0., -1.\n": "*DLOAD, GRAV",
    "*DLOAD\nSECOND, CENTRIF, 1e4, 0., 0., 0., 0., 0., 1.\n": "*DLOAD, CENTRIF",
    "*DLOAD\nCUBE, P2NU, 1.\n": "*DLOAD, P2NU",
    "*DSLOAD\nCROWN, TRVEC, 1., 1., 0., 0.\n": "*DSLOAD, TRVEC",
    "*CLOAD, AMPLITUDE=a\n1, 1, 1.\n": "*CLOAD, AMPLITUDE",
    "*CLOAD\n1, 4, 1.\n": "*CLOAD",
    "*TEMPERATURE, AMPLITUDE=a\nALL, 20.\n": "*TEMPERATURE, AMPLITUDE",
    "*BOUNDARY, AMPLITUDE=a\n1, 1, 1, 0.5\n": "*BOUNDARY",
    "*BOUNDARY, TYPE=VELOCITY\n1, 1, 1, 0.5\n": "*BOUNDARY",
    "*BOUNDARY\n99, 1, 1, 0.5\n": "*BOUNDARY",
}


@pytest.mark.parametrize("card, word", STATICS.items(), ids=STATICS.values())
def test_unsupported_loads_before_the_vibration_are_findings(tmp_path, card, word):
    plain_text = CUBE + TWICE + STEEL
    keywords = words(read(tmp_path, plain_text + "*STEP\n*STATIC\n" + card + "*END STEP\n" + VIBRATION))
    assert set(keywords) - set(words(read(tmp_path, plain_text))) == {word, "*STEP, PERTURBATION"}


def test_effects_missing_in_the_statics_are_findings(tmp_path):
    step = "*STEP, NLGEOM\n*STATIC\n*CLOAD\n1, 1, 1.\n*END STEP\n"
    plastic = STEEL.replace("*SOLID", "*PLASTIC\n300., 0.\n*SOLID")
    assert words(read(tmp_path, CUBE + plastic + step + VIBRATION)) == ["*STEP, NLGEOM", "*PLASTIC", "*STEP, PERTURBATION"]
    assert words(read(tmp_path, CUBE + plastic + step + VIBRATION.replace(", PERTURBATION", ""))) == []
    dynamic = step.replace(", NLGEOM", "").replace("*STATIC", "*DYNAMIC")
    assert words(read(tmp_path, CUBE + STEEL + dynamic + VIBRATION)) == 2 * ["*STEP, PERTURBATION"]


def test_prescribed_displacements_before_the_vibration_are_used(tmp_path):
    """A later value replaces an earlier one; in the vibration the displaced nodes are supported."""
    first = "*STEP, NLGEOM\n*STATIC\n*BOUNDARY\nALL, 3, 3, 0.5\n5, 1, 2, 0.25\n*END STEP\n"
    second = "*STEP\n*STATIC\n*BOUNDARY\n1, 3\n2, 3, 3, -0.5\n*END STEP\n"
    model = read(tmp_path, CUBE + STEEL + first + second + VIBRATION)
    displacements = model.statics.table.displacements
    by_key = {entry.displacement: model.numbers[model.groups[entry.group].nodes].tolist() for entry in displacements}
    assert by_key == {(0.0, 0.0, 0.5): [3, 4, 6, 7, 8], (0.25, 0.25, 0.5): [5], (0.0, 0.0, -0.5): [2]}
    assert model.statics.large == "*STEP, NLGEOM" and words(model) == ["*STEP, NLGEOM", "*STEP, PERTURBATION"]
    supported = {axis for support in model.supports for axis in support.fix if support.group == "ALL"}
    assert supported == {"z"}


@pytest.mark.parametrize("more", ["*DLOAD\nCUBE, P2, 4.\n", "*DSLOAD\nSIDE, P, 1.\n"])
def test_large_displacements_with_follower_loads_are_left_to_the_user(tmp_path, more):
    step = f"*STEP, NLGEOM\n*STATIC\n{more}*END STEP\n"
    model = read(tmp_path, CUBE + STEEL + "*SURFACE, NAME=SIDE\nCUBE, S3\n" + step + VIBRATION)
    (finding,) = (finding for finding in model.findings if finding.word == "*STEP, NLGEOM")
    assert model.statics.large == "" and "pressures, which do not follow the surface" in finding.effect


def test_loads_before_the_vibration_are_those_at_the_end_of_the_steps(tmp_path):
    """A load replaces that of an earlier step and adds to those of the same step; OP = NEW removes all others."""
    sets = "*NSET, NSET=PAIR\n5, 6\n*TRANSFORM, NSET=PAIR, TYPE=R\n0., 1., 0., -1., 0., 0.\n*SURFACE, NAME=SIDE\nCUBE, S3\n"
    first = "*CLOAD\nPAIR, 1, 3.\nPAIR, 1, 2.\n7, 3, 9.\n*DLOAD\nCUBE, P2, 4.\nCUBE, CENTRIF, 1e4, 1., 0., 0., 0., 0., 2.\n"
    second = "*CLOAD\nPAIR, 1, 7.\n8, 1, 1.\n*DSLOAD\nSIDE, P, -2.\n"
    steps = f"*STEP\n*STATIC\n{first}*END STEP\n*STEP\n*STATIC\n{second}*END STEP\n"
    model = read(tmp_path, CUBE + STEEL + sets + steps + VIBRATION)
    statics = model.statics
    by_key = {tuple(model.numbers[model.groups[force.group].nodes]): force.force for force in statics.table.forces}
    assert by_key == {(5, 6): (0.0, 14.0, 0.0), (7,): (0.0, 0.0, 9.0), (8,): (1.0, 0.0, 0.0)}
    on_faces, side = statics.table.pressures
    assert on_faces.pressure == 4.0 and (side.group, side.pressure) == ("SIDE", -2.0)
    assert set(model.numbers[model.cells[next(iter(model.groups[on_faces.group].cells))].nodes.ravel()]) == {5, 6, 7, 8}
    assert (statics.table.rotation_speed, statics.axis, statics.axis_point) == (100.0, (0.0, 0.0, 2.0), (1.0, 0.0, 0.0))
    renewed = steps.replace("*CLOAD\nPAIR, 1, 7.", "*CLOAD, OP=NEW\nPAIR, 1, 7.").replace("*DSLOAD", "*DSLOAD, OP=NEW")
    statics = read(tmp_path, CUBE + STEEL + sets + renewed + VIBRATION).statics
    assert [pressure.pressure for pressure in statics.table.pressures] == [-2.0]
    assert len(statics.table.forces) == 2 and statics.table.rotation_speed == 0.0


SPEED = "*STEP\n*STATIC\n*DLOAD\nCUBE, CENTRIF, {}, 1., 0., 0., 0., 0., 2.\n*END STEP\n"


def test_a_later_step_replaces_the_speed_of_a_rotation(tmp_path):
    """As in Abaqus with OP = MOD; no other finding than the loads at rest."""
    steps = SPEED.format("1e4") + SPEED.format("4e4")
    model = read(tmp_path, CUBE + STEEL + steps + VIBRATION)
    assert model.statics.table.rotation_speed == 200.0
    assert words(model) == ["*STEP, PERTURBATION"]


@pytest.mark.parametrize(
    "steps, effect",
    [
        (SPEED.format("1e4") + SPEED.format("4e4").replace("2.", "-2."), "a second rotation about another axis"),
        (
            SPEED.format("1e4").replace("*END", "CUBE, CENTRIF, 1e4, 1., 0., 0., 0., 0., 2.\n*END"),
            "a second rotation in the same step",
        ),
    ],
)
def test_a_second_rotation_is_a_finding(tmp_path, steps, effect):
    findings = read(tmp_path, CUBE + STEEL + steps + VIBRATION).findings
    assert [finding.effect for finding in findings if finding.word == "*DLOAD, CENTRIF"] == [effect]


def test_cards_without_effect_on_the_answer_are_listed_or_ignored(tmp_path):
    step = "*STEP\n*STATIC\n*CLOAD\n1, 1, 1.\n2, 1, 1.\n*CLOAD\n3, 1, 1.\n*NODE PRINT, NSET=ALL\nU\n*OUTPUT, FIELD\n*END STEP\n"
    findings = read(tmp_path, CUBE + STEEL + "*AMPLITUDE, NAME=a\n0., 1.\n*Damping, alpha=3.\n" + step).findings
    assert {finding.word: finding.where for finding in findings} == {
        "*AMPLITUDE": "line 18",
        "*DAMPING": "line 20",
        "*STATIC": "line 22",
        "*CLOAD": "line 23 and 1 more",
    }
    assert not any(finding.changes for finding in findings)


BAD = {
    "a node twice": (CUBE + "*NODE\n8, 0, 0, 0\n", "line 12: .NODE gives node number 8 more than once"),
    "an element twice": (
        CUBE + "*ELEMENT, TYPE=C3D8\n1, 8, 7, 6, 5, 4, 3, 2, 1\n",
        "line 12: .ELEMENT gives element number 1 more",
    ),
    "a node that is not there": (CUBE.replace("7, 8\n", "7, 9\n"), "line 10: .ELEMENT names node 9, which no .NODE"),
    "no coordinates": (CUBE.replace("5, 0, 0, 1", "5"), "line 6: .NODE: every line must hold a number and coordinates"),
    "a word for a number": (CUBE.replace("5, 0, 0, 1", "5, 0, o, 1"), "line 6: .NODE holds '5,0,o,1' where numbers are expected"),
    "half a number": (CUBE.replace("5, 0, 0, 1", "5.5, 0, 0, 1"), "line 1: .NODE: a node number is not a whole number"),
    "nodes missing": (CUBE.replace(", 7, 8\n", "\n"), "line 10: .ELEMENT, TYPE=C3D8: .* the last has 6 nodes"),
    "an unknown solid": (CUBE.replace("C3D8", "C3D9"), "line 10: .ELEMENT, TYPE=C3D9 is not read"),
    "a set that is not there": (
        CUBE + "*NSET, NSET=a\nALLL\n",
        "line 12: .NSET 'ALLL' is used but not defined; nearest is 'ALL'",
    ),
    "a set of elements for one of nodes": (
        CUBE + "*ELSET, ELSET=whole\n1\n*BOUNDARY\nWHOLE, 1\n",
        r"line 15: .NSET '[Ww]\w+' is used but not defined; there is an .ELSET of this name",
    ),
    "a pointer": (
        "version https://git-lfs.github.com/spec/v1\noid sha256:a3\nsize 9\n",
        "it is a pointer of Git LFS.*git lfs pull",
    ),
    "a set of itself": (CUBE + "*NSET, NSET=a\nb\n*NSET, NSET=b\na\n", "contains itself"),
    "a set without a name": (CUBE + "*NSET\n1\n", "line 12: .NSET without a name"),
    "a range of no numbers": (CUBE + "*NSET, NSET=a, GENERATE\n1, 9e300\n", "line 13: .*GENERATE: '1,9e300' is not a range"),
    "an absurd node": (
        CUBE + "*BOUNDARY\n99999999999999999999, 1\n",
        "line 13: 99999999999999999999 is not a number of the file",
    ),
    "sets too deep": (CUBE + "".join(f"*NSET, NSET=s{i}\ns{i + 1}\n" for i in range(200)), "within more than 100 others"),
    "an infinite node number": (
        CUBE.replace("8, 0, 1, 1", "1e300, 0, 1, 1"),
        "line 1: .NODE: a node number is not a whole number",
    ),
    "a falling range": (CUBE + "*NSET, NSET=a, GENERATE\n5, 1\n", "is not a range of numbers"),
    "an absurd number": (CUBE + "*NSET, NSET=a\n99999999999999999999\n", "which is not a number of the file"),
    "a face too many": (CUBE + "*SURFACE, NAME=s\nCUBE, S7\n", "line 13: .SURFACE names face S7 of element 1, a hex"),
    "nodes that are mapped": (CUBE + "*NMAP\n1, 8\n", "line 12: the keyword .NMAP is not supported; write the nodes out"),
    "nodes along a parabola": (CUBE + "*NGEN, LINE=P\n1, 8\n", "line 12: .NGEN, LINE=P is not supported; write the nodes out"),
    "nodes between none": (CUBE + "*NGEN\n1, 80\n", "line 13: node 80 is not defined before it is used"),
    "nodes in steps that do not fit": (
        CUBE + "*NGEN\n1, 8, 3\n",
        "line 13: .NGEN: from node 1 to 8 there are no whole steps of 3",
    ),
    "an arc of half a turn": (
        CUBE + "*NGEN, LINE=C\n1, 3, 1, , .5, .5, 0\n",
        "line 13: .NGEN, LINE=C: an arc of half a turn or more is not supported",
    ),
    "filled unevenly": (CUBE + "*NFILL, BIAS=2\n", "line 12: .NFILL, BIAS is not supported; write the nodes out"),
    "filled between unlike sets": (
        CUBE + "*NSET, NSET=A\n1\n*NSET, NSET=B\n2, 3\n*NFILL\nA, B, 4, 10\n",
        "line 17: .NFILL: A has 1 node and B 2, to be joined by 4 intervals",
    ),
    "rows of an element that is not there": (CUBE + "*ELGEN\n7, 3, 1, 1\n", "line 13: .ELGEN: element 7 is not defined before"),
    "endless rows": (CUBE + "*ELGEN\n1, 300000, 1, 1, 300000, 1, 1, 300000\n", "line 13: .ELGEN: rows of .* elements"),
    "elements reflected": (CUBE + "*ELCOPY, REFLECT, OLD SET=CUBE\n", "line 12: .ELCOPY, REFLECT is not supported"),
    "nodes copied without numbers": (CUBE + "*NCOPY, OLD SET=ALL, SHIFT\n1,0,0\n", "line 12: .NCOPY: CHANGE NUMBER is missing"),
    "a part that does not end": ("*PART, NAME=P\n" + CUBE, "line 1: .PART has no .END PART; the file is truncated"),
    "an unknown part": (PART + TWO.replace("one, PART=P", "one, PART=Q"), "there is no part 'Q'; it has: P"),
    "an axis of no length": (
        PART + TWO.replace("10., 0., 1., 90.", "10., 0., 0., 90."),
        "the two points of its axis of rotation coincide",
    ),
    "a rotation cut short": (PART + TWO.replace(", 1., 90.", ""), "expected a line of 3 numbers, its translation, and one of 7"),
    "a file that is not there": (
        CUBE + "*INCLUDE, INPUT=none.inp\n",
        "line 12: it includes 'none.inp', and there is no such file",
    ),
    "an include without a name": (CUBE + "*INCLUDE\n", "line 12: .INCLUDE names no file"),
    "an include of itself": (CUBE + "*INCLUDE, INPUT=job.inp\n", "line 12: .* the includes form a cycle"),
    "an include outside": (
        CUBE + "*INCLUDE, INPUT=../outside.inp\n",
        "line 12: it includes '../outside.inp', which lies outside",
    ),
    "an encrypted include": (CUBE + "*INCLUDE, INPUT=job.inp, PASSWORD=x\n", "is encrypted"),
    "a spring with a direction alone": (
        CUBE + "*ELEMENT, TYPE=SPRING1, ELSET=S\n9, 1\n*SPRING, ELSET=S\n1\n",
        "line 14: .SPRING: expected 1 finite number",
    ),
    "a mass without a number": (
        CUBE + "*ELEMENT, TYPE=MASS, ELSET=S\n9, 1\n*MASS, ELSET=S\n , 2.\n",
        "line 15: .MASS: expected 1 finite number",
    ),
    "an inertia of words": (
        CUBE + "*ELEMENT, TYPE=ROTARYI, ELSET=S\n9, 1\n*ROTARY INERTIA, ELSET=S\n1., x\n",
        "line 15: .ROTARY INERTIA: expected 6 finite numbers, found '1.,x'",
    ),
    "a spring without a number": (CUBE + "*ELEMENT, TYPE=SPRING1, ELSET=S\n9, 1\n*SPRING, ELSET=S\n1\nstiff\n", "finite number"),
    "an equation cut short": (
        CUBE + "*EQUATION\n3\n1, 1, 1., 2, 1, 1.\n",
        "line 13: .EQUATION: expected a number of terms and a",
    ),
    "an absurd equation": (CUBE + "*EQUATION\n999999999\n1, 1, 1.\n", "line 13: .EQUATION: expected a number of terms and a"),
    "a support in no direction": (CUBE + "*BOUNDARY\nALL, 12\n", "line 13: .BOUNDARY holds 'ALL,12'; expected a node or a set"),
    "a tie of no surface": (CUBE + TWICE + "*TIE\nTOPP, FEET\n", "there is no .SURFACE 'TOPP'; nearest is 'TOP'"),
    "a material of no numbers": (
        CUBE + "*MATERIAL, NAME=m\n*ELASTIC\nstiff, 1.\n",
        "line 14: .ELASTIC holds 'stiff,1.' where numbers",
    ),
    "no mesh": ("*HEADING\n", "no .NODE and .ELEMENT blocks"),
}


@pytest.mark.parametrize("text, message", BAD.values(), ids=BAD.keys())
def test_a_bad_file_gives_one_message_with_its_line(tmp_path, text, message):
    (tmp_path / "outside.inp").write_text(CUBE)
    (tmp_path / "in").mkdir()
    with pytest.raises(MeshError, match=message) as caught:
        read(tmp_path / "in", text)
    assert str(caught.value).startswith(str(tmp_path / "in" / "job.inp"))


def test_links_out_of_the_folder_and_cycles_of_includes_are_refused(tmp_path):
    (tmp_path / "outside.inp").write_text(CUBE)
    folder = tmp_path / "in"
    folder.mkdir()
    os.symlink(tmp_path / "outside.inp", folder / "link.inp")
    with pytest.raises(MeshError, match="lies outside"):
        read(folder, "*INCLUDE, INPUT=link.inp\n")
    (folder / "a.inp").write_text("*INCLUDE, INPUT=b.inp\n")
    (folder / "b.inp").write_text("*HEADING\n*INCLUDE, INPUT=a.inp\n")
    with pytest.raises(MeshError, match="b.inp, line 2: it includes 'a.inp', which includes this file"):
        read(folder, "*INCLUDE, INPUT=a.inp\n")


@pytest.mark.parametrize("step", [211, 307])
def test_truncated_and_edited_files_give_a_message_or_a_model(tmp_path, step):
    text = inp(plain("hex20"), ("*Tie, name=t", "BAR_BOTTOM, PLATE_TOP", "*Mass, elset=m", "1."))
    between_blocks = range(text.index("*End Assembly") + 13, len(text))  # no part, instance or assembly is open there
    for at in range(step, len(text), step):
        with contextlib.suppress(MeshError) if at in between_blocks else pytest.raises(MeshError):
            read(tmp_path, text[:at])
        with contextlib.suppress(MeshError):
            assert len(read(tmp_path, text[:at] + ",x=" + text[at + 3 :]).points)


SECTOR = """*CYCLIC SYMMETRY MODEL, N=12, NGRAPH=12, TIE=T
0., 0., 5., 0., 0., 7.
*TIE, CYCLIC SYMMETRY, NAME=T
CROWN, FEET
"""


def test_a_cyclic_sector_names_the_table_for_the_scene(tmp_path):
    """The high face is in the positive direction about the axis, either the first or the second surface of the tie."""
    model = read(tmp_path, CUBE + TWICE + STEEL + SECTOR)
    finding = next(finding for finding in model.findings if finding.word == "*CYCLIC SYMMETRY MODEL")
    assert "sectors = 12, axis = [0.0, 0.0, 2.0], axis_point = [0.0, 0.0, 5.0]" in finding.effect
    assert {finding.part for finding in model.findings if "CYCLIC" in finding.word} == {"cyclic"}
    assert model.cyclic == FileSectors(sectors=12, axis=(0.0, 0.0, 2.0), axis_point=(0.0, 0.0, 5.0), faces=("CROWN", "FEET"))
    load_and_output = {
        "loads": ({"node": 5, "direction": (0.0, 0.0, 1.0)},),
        "outputs": ({"name": "o", "node": 5, "direction": (0.0, 0.0, 1.0)},),
    }
    with pytest.raises(CaseError, match="2 entries are not modelled and would change the answer"):
        complete(scene_of({**tables("job.inp", ignore=("*ELEMENT",)), **load_and_output}, tmp_path / "s.toml"), model)
    cyclic = {"sectors": 12, "axis": (0.0, 0.0, 2.0), "faces": ("CROWN", "FEET"), "engine_order": 2}
    complete(
        scene_of({**tables("job.inp", ignore=("*ELEMENT",)), **load_and_output, "cyclic": cyclic}, tmp_path / "s.toml"), model
    )


def test_cyclic_faces_of_several_parts_are_one_pair(tmp_path):
    """As of two rings, each with its own faces; those of another disc are a finding that the scene cannot replace."""
    second = "*NSET, NSET=UPPER\n1, 2\n*NSET, NSET=LOWER\n5, 6\n"
    second += SECTOR.replace("TIE=T", "TIE=U").replace("NAME=T", "NAME=U").replace("CROWN, FEET", "UPPER, LOWER")
    model = read(tmp_path, CUBE + TWICE + STEEL + SECTOR + second)
    assert model.cyclic.faces in (("CROWN and UPPER", "FEET and LOWER"), ("CROWN and LOWER", "FEET and UPPER"))
    names = [*model.cyclic.faces[0].split(" and "), model.cyclic.faces[0]]

    def nodes(name):
        group = model.groups[name]
        of_cells = [model.cells[block].nodes[rows].ravel() for block, rows in group.cells.items()]
        return set(np.concatenate([group.nodes, *of_cells]).tolist())

    one, other, both = map(nodes, names)
    assert both == one | other
    (finding,) = [finding for finding in model.findings if finding.word == "*CYCLIC SYMMETRY MODEL"]
    assert finding.part == "cyclic" and finding.where.endswith("and 1 more") and names[2] in finding.effect
    model = read(tmp_path, CUBE + TWICE + STEEL + SECTOR + second.replace("N=12", "N=8"))
    assert model.cyclic.faces == ("CROWN", "FEET")
    (left,) = [finding for finding in model.findings if "another cyclic symmetry" in finding.effect]
    assert left.changes and left.part == ""


@pytest.mark.parametrize(
    "card, message",
    [
        ("*CYCLIC SYMMETRY MODEL, N=1\n", "N=1: expected a number of sectors, at least 2"),
        ("*CYCLIC SYMMETRY MODEL, N=12\n0., 0., 1.\n", "expected six coordinates of two points of the axis"),
        ("*CYCLIC SYMMETRY MODEL, N=12\n0., 0., 1., 0., 0., 1.\n", "the two points of the axis coincide"),
    ],
)
def test_a_damaged_cyclic_sector_is_refused(tmp_path, card, message):
    with pytest.raises(MeshError, match=message):
        read(tmp_path, CUBE + TWICE + STEEL + card)


def test_a_reference_node_that_leads_only_reference_nodes(tmp_path):
    """It is a point without followers on a solid, in any order of the cards; without any follower it is a finding."""
    more = "*NODE\n97, 0.5, 0.5, 5.0\n98, 0.5, 0.5, 4.0\n96, 0.0, 0.0, 9.0\n*NSET, NSET=FOOT\n1, 2, 3, 4\n"
    more += "*KINEMATIC COUPLING, REF NODE=97\n98, 1, 6\n*KINEMATIC COUPLING, REF NODE=98\n99, 1, 6\n"
    hub = "*COUPLING, CONSTRAINT NAME=hub, REF NODE=99, SURFACE=CROWN\n*KINEMATIC\n"
    model = read(tmp_path, CUBE + TWICE + more + hub)
    by_key = {point.name: (point.connection, point.group) for point in model.connected}
    group = by_key["hub"][1]
    assert by_key == {"hub": ("rigid", group), "node 97": ("equations", group), "node 98": ("equations", group)}
    assert len(model.equations.where) == 12 and not any("COUPLING" in finding.word for finding in model.findings)
    model = read(tmp_path, CUBE + TWICE + more)
    effects = [finding.effect for finding in model.findings if finding.changes]
    assert "the reference node 98 leads no node of a solid, nor a reference node that leads some" in effects


def test_equations_and_couplings_of_reference_nodes(tmp_path):
    """Terms of a reference node, also rotations, belong to its point; a reference node in a coupling follows as a rigid body."""
    more = "*NODE\n98, 0.5, 0.5, 4.0\n*NSET, NSET=ALL2\n5, 6, 7, 8, 98\n"
    more += "*COUPLING, CONSTRAINT NAME=hub, REF NODE=99, SURFACE=CROWN\n*KINEMATIC\n"
    more += "*KINEMATIC COUPLING, REF NODE=98\nFOOT, 1, 6\n98, 1, 6\n99, 1, 6\n*EQUATION\n2\n99, 6, 2.0, 1, 1, -3.0\n"
    more = "*NSET, NSET=FOOT\n1, 2, 3, 4\n" + more
    model = read(tmp_path, CUBE + TWICE + more)
    equations = model.equations
    assert equations.points[0] == "hub" and len(equations.where) == 7
    first = [
        (int(node), int(axis), value)
        for node, axis, value, number in zip(equations.nodes, equations.axes, equations.coefficients, equations.equation)
        if number == 0
    ]
    assert first[0] == (-1, 5, 2.0) and first[1][1:] == (0, -3.0) and model.numbers[first[1][0]] == 1
    by_name = {point.name: point for point in model.connected}
    leader, follower = by_name["node 98"], by_name["hub"]
    arm = np.subtract(follower.position, leader.position)
    theta = (0.1, 0.2, 0.3)  # the follower moves as theta x r
    values = {"node 98": (0.0, 0.0, 0.0, *theta), "hub": (*np.cross(theta, arm), *theta)}
    sums = np.zeros(7)
    for number, node, axis, value in zip(equations.equation, equations.nodes, equations.axes, equations.coefficients):
        if number > 0:
            sums[number] += value * values[equations.points[-1 - node]][axis]
    np.testing.assert_allclose(sums, 0.0, atol=1e-15)
