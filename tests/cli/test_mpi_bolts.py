"""A scene with a bolt from its file to log and results.h5; on one rank and on several."""

from types import SimpleNamespace

import numpy as np
import pytest
from blocks import box, join
from msh import write_msh
from scene_text import driven, joint, response, steel, support, table

import microslip
from microslip.parallel.agree import on_root
from microslip.results.fields import read_fields
from microslip.results.read import read_results

WIDTH, GRIP, HEAD = 0.02, 0.06, 0.02  # m
HEAD_AT, ALONG = [[0.0, 0.01, 0.08]], [1.0, 0.0, 0.0]
SCENE = (
    table("model", mesh="clamp.msh")
    + steel("bolt", "left", "right")
    + support("base")
    + joint("seat_left", "under_left", name="left seat", k_t=1.0e13)
    + joint("seat_right", "under_right", name="right seat", k_t=1.0e13)
    + table("statics", steps=3)
    + table("[statics.bolts]", name="M16", group="cut", force=9000.0)
    + table("[statics.forces]", group="head_top", force=[0.0, 0.0, 4000.0])
    + driven(HEAD_AT, ALONG, ALONG, "head")
    + response(5.0, span=[0.95, 1.05], points=5)
    + table("solver", modes=4, error_bars=False)
)


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    """Return a folder with a shank between two columns, with a head over all three; its lower half ends in the cut."""
    path = comm.bcast(tmp_path_factory.mktemp("bolts"))

    def write():
        half, cells = (WIDTH, WIDTH, 0.5 * GRIP), (2, 2, 2)
        shank = [box("hex8", half, cells, names={"z0": "base", "z1": "cut"})]
        shank += [box("hex8", half, cells, (0.0, 0.0, 0.5 * GRIP), {})]
        head = [
            box("hex8", (WIDTH, WIDTH, HEAD), (2, 2, 1), (x, 0.0, GRIP), {"z1": "head_top"} | names)
            for x, names in ((-WIDTH, {"z0": "under_left"}), (0.0, {}), (WIDTH, {"z0": "under_right"}))
        ]
        columns = {
            name: box("hex8", (WIDTH, WIDTH, GRIP), (2, 2, 4), (x, 0.0, 0.0), {"z0": "base", "z1": f"seat_{name}"})
            for name, x in (("left", -WIDTH), ("right", WIDTH))
        }
        write_msh(str(path / "clamp.msh"), {"bolt": join(shank + head), **columns})

    on_root(comm, write)
    return path


def test_forces_of_bolts_are_in_log_and_results(comm, folder, program):
    on_root(comm, lambda: (folder / "clamp.toml").write_text(SCENE))
    status, messages, _ = program("run", folder / "clamp.toml", "--out", folder / "out")
    assert status == 0
    assert "bolt 'M16': 9000 N when tightened, " in messages

    def check():
        results = read_results(str(folder / "out" / "results.h5"))
        table, pressed = results.at_rest["bolts"], results.joint.N0[results.joint.N0 > 0.0].sum()
        bolts = SimpleNamespace(**table.columns)
        assert table.names == ("M16",) and bolts.tightened == pytest.approx([9000.0], rel=1e-8)
        assert bolts.area == pytest.approx([WIDTH**2], rel=1e-9) and bolts.shortening > 0.0
        assert 9000.0 < bolts.force < 13000.0
        assert pressed == pytest.approx(bolts.force - 4000.0, rel=1e-6)  # force on the head: bolt, load and seats
        fields, joint = read_fields(str(folder / "out" / "results.h5")), results.joint
        at = {number: u for number, u in zip(fields.mesh.numbers, fields.rest)}
        du = np.array([at[a] - at[b] for a, b in zip(joint.node1, joint.node2)])
        assert -joint.k_n * np.einsum("ni,ni->n", du, joint.frame[:, 2]) == pytest.approx(joint.N0, abs=1e-2 * pressed / len(du))

    on_root(comm, check)


def test_a_bolt_in_compression_at_rest_causes_a_warning(comm, folder, program):
    on_root(comm, lambda: (folder / "pressed.toml").write_text(SCENE.replace("4000.0]", "-9e4]")))
    status, messages, _ = program("run", folder / "pressed.toml", "--out", folder / "pressed", "--set", "response.points=2")
    assert status == 0 and "WARNING: it is pressed at rest" in messages


def test_the_check_reports_cuts_of_bolts(comm, folder, program):
    def write():
        (folder / "clamp.toml").write_text(SCENE)
        (folder / "outer.toml").write_text(SCENE.replace('group = "cut"', 'group = "head_top"'))

    on_root(comm, write)
    status, messages, _ = program("check", folder / "clamp.toml")
    assert status == 0 and "bolt       M16: a cut of 0.0004 m2 with 9 nodes, across (0, 0, 1)" in messages
    status, _, error = program("check", folder / "outer.toml")
    assert status == 2 and error.count("microslip: error: ") == 1 and "bolt 'M16': group 'head_top': 12 of 12 faces" in error


@pytest.mark.parametrize(
    "old, new, status, message",
    [
        (
            'group = "cut"',
            'group = "base"',
            2,
            "clamp.msh: bolt 'M16': group 'base': 12 of 12 faces are not between two elements",
        ),
        ("force = 9000.0", "", 2, '[[statics.bolts]] 1 ("M16"): exactly one of force, shortening is needed, found none'),
        ("[0.0, 0.0, 4000.0]", '[0.0, 0.0, -4000.0]\n[[statics.bolts]]\ngroup = "cut"\nforce = 1.0', 2, "is used 2 times"),
    ],
    ids=["no cut", "no force", "one cut twice"],
)
def test_an_invalid_bolt_is_rejected_with_one_message(comm, folder, program, old, new, status, message):
    def write():
        assert SCENE.count(old) == 1
        (folder / "bad.toml").write_text(SCENE.replace(old, new))

    on_root(comm, write)
    ended, _, error = program("run", folder / "bad.toml", "--out", folder / "bad")
    assert ended == status and message in error
    assert error.count("microslip: error: ") == 1 and "Traceback" not in error


MIDDLE = [[0.1, 0.0, 0.0]], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], "middle"
BAR = (
    table("model", mesh="bar.msh")
    + steel("bar", young=2.0e11, poisson=0.0, density=8000.0, expansion=1.0e-5)
    + support("ends")
    + "[statics]\nLOADED\n"
    + driven(*MIDDLE)
    + response(1.0)
    + table("solver", modes=4)
)


def test_a_tightened_bar_has_the_frequencies_of_a_colder_bar(comm, folder):
    """Between two walls cooling by E A alpha theta and the same force of a bolt cause the same stress, except where walls hinder
    the lateral contraction of the cold bar."""

    def write():
        half, cells = (0.1, 0.01, 0.01), (4, 1, 1)
        halves = [box("hex20", half, cells, names={"x0": "ends", "x1": "cut"})]
        halves.append(box("hex20", half, cells, (0.1, 0.0, 0.0), {"x1": "ends"}))
        write_msh(str(folder / "bar.msh"), {"bar": join(halves)})
        loads = {
            "slack": '[[statics.bolts]]\ngroup = "cut"\nforce = 1e-3\n',
            "tight": '[[statics.bolts]]\ngroup = "cut"\nforce = 2e4\n',
            "cold": '[[statics.temperatures]]\ngroup = "bar"\ntemperature = -100.0\n',
        }
        for name, load in loads.items():
            (folder / f"{name}.toml").write_text(BAR.replace("LOADED", load))

    on_root(comm, write)
    values = {}
    for name in ("slack", "tight", "cold"):
        with microslip.build(microslip.read(folder / f"{name}.toml"), comm) as structure:
            values[name] = structure.modes.frequency
    assert values["tight"] == pytest.approx(values["cold"], rel=2e-4)
    assert (values["tight"] > 1.05 * values["slack"])[:2].all()
