"""A scene with a tie, a rigid and a distributing point, and a joint, from the file to the fields; on one rank and on several."""

import h5py
import numpy as np
import pytest
from blocks import box, stacked
from msh import write_msh
from scene_text import joint, response, steel, support, table

import microslip
from microslip.messages.errors import CaseError, ConvergenceError
from microslip.parallel.agree import on_root

LENGTH, WIDTH, HEIGHT = 0.05, 0.01, 0.02
SCENE = (
    table("model", mesh="motor.msh", axis=[0.0, 1.0, 0.0], axis_point=[0.0, 0.0, 0.3])
    + steel("bar", "cap", "ground")
    + support("ground_base")
    + table("[ties]", name="glue", surfaces=["cap_bottom", "bar_top"])
    + table("[points]", name="motor", position=[0.025, 0.005, 0.06], group="cap_top", mass=0.3, inertia=[1e-5, 2e-5, 3e-5])
    + table("[points]", name="end", position=[0.06, 0.005, 0.01], group="bar_end", connection="distributing")
    + joint("bar_bottom", "ground_top", preload=2.0e7)
    + table("[loads]", point="motor", direction=[1.0, 0.2, 0.0])
    + table("[loads]", point="end", moment=[0.0, 0.002, 0.0])
    + table("[outputs]", name="motor", point="motor", direction=[1.0, 0.0, 0.0])
    + table("[outputs]", name="turn", point="end", rotation=[0.0, 1.0, 0.0])
    + response(1500.0, span=[0.95, 1.05], points=6)
    + table("solver", modes=8, samples=64)
)


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    path = comm.bcast(tmp_path_factory.mktemp("motor"))

    def write():
        bodies = stacked("hex8", (LENGTH, WIDTH, HEIGHT), (4, 2, 1), 0.005)
        cap = box("hex20", (0.03, WIDTH, 0.01), (2, 1, 1), (0.01, 0.0, HEIGHT), {"z0": "cap_bottom", "z1": "cap_top"})
        write_msh(str(path / "motor.msh"), {**bodies, "cap": cap})

    on_root(comm, write)
    return path


def scene_of(comm, folder, *changes, more="", name="scene"):
    """Return the scene with replaced texts and additional tables.  Collective."""

    def write():
        text = SCENE
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = folder / f"{name}.toml"
        path.write_text(text + more)
        return path

    return microslip.read(on_root(comm, write))


NO_AXIS = ("axis = [0.0, 1.0, 0.0]\naxis_point = [0.0, 0.0, 0.3]\n", "")


@pytest.fixture(scope="module")
def first_frequency(comm, folder):
    with microslip.build(scene_of(comm, folder, NO_AXIS), comm) as structure:
        return float(structure.modes.frequency[0])


def around(frequency, **solver):
    """Return the changes that request a point at a frequency, and keys of [solver]."""
    keys = "".join(f"\n{key} = {value}" for key, value in solver.items())
    span = f"frequencies = [{0.95 * frequency}, {1.05 * frequency}]\nat = [{frequency}]"
    return NO_AXIS, ("mode = 1\nspan = [0.95, 1.05]", span), ("modes = 8", f"modes = 60{keys}")


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_methods_agree(comm, folder, first_frequency):
    values = []
    for method in ("receptance", "rubin", "full"):
        scene = scene_of(comm, folder, *around(first_frequency, method=f'"{method}"', tolerance=1e-10))
        with microslip.build(scene, comm) as structure:
            (level,) = microslip.respond(structure, error_bars=False).results.levels
        assert level.state.max() > 0  # some pairs slip
        values.append(level.response[np.flatnonzero(level.requested)[0]])
    size = np.abs(values[0]).max(axis=1, keepdims=True)
    for other in values[1:]:
        assert other / size == pytest.approx(values[0] / size, abs=1e-3)


def test_fields_satisfy_ties_and_rigid_points(comm, folder, first_frequency):
    with microslip.build(scene_of(comm, folder, *around(first_frequency)), comm) as structure:
        response = microslip.respond(structure, error_bars=False)
        (level,) = response.results.levels
        frequency, u = response.fields(1500.0, first_frequency)
        mesh = comm.bcast(structure.mesh)
    seen = level.response[np.flatnonzero(level.frequency == frequency)[0]]
    top = mesh.node_groups["cap_top"]
    arms = mesh.points[top] - [0.025, 0.005, 0.06]
    rigid = np.concatenate([np.tile(np.eye(3), (len(top), 1, 1)), np.cross(np.eye(3), arms[:, None]).swapaxes(1, 2)], axis=2)
    for k in (1, 2):
        motion, *_ = np.linalg.lstsq(rigid.reshape(-1, 6), u[top, :, k].ravel(), rcond=None)
        assert rigid @ motion == pytest.approx(u[top, :, k], abs=1e-12 * np.abs(u).max())
        assert motion[0] == pytest.approx(seen[0, k], abs=1e-10 * np.abs(seen[0]).max())
    bottom, bar = mesh.node_groups["cap_bottom"], mesh.node_groups["bar_top"]
    of_bar, of_cap = (nodes[np.isclose(mesh.points[nodes], [0.025, 0.0, HEIGHT]).all(axis=1)] for nodes in (bottom, bar))
    assert u[of_bar] == pytest.approx(u[of_cap], abs=1e-15) and len(of_bar) == 1  # two nodes at the same position
    corner = bottom[np.isclose(mesh.points[bottom], [0.01, 0.0, HEIGHT]).all(axis=1)]
    left, right = (bar[np.isclose(mesh.points[bar], [x, 0.0, HEIGHT]).all(axis=1)] for x in (0.0, 0.0125))
    assert u[corner] == pytest.approx(0.2 * u[left] + 0.8 * u[right], abs=1e-15)


STATICS = """
[statics]
rotation_speed = 300.0
[[statics.forces]]
point = "motor"
force = [100.0, 0.0, -2000.0]
[[statics.forces]]
point = "end"
force = [0.0, 50.0, -100.0]
"""
TURNING = (
    ("inertia = [1.0e-5, 2.0e-5, 3.0e-5]\n", ""),
    ("preload = 2.0e7", 'preload = "static"'),
    ("friction = 0.3", "friction = 0.9"),
)


def test_statics_carry_loads_on_points(comm, folder):
    """The joint carries the forces on both points and the weight of all rotating parts and the motor; tied parts are one body."""
    with microslip.build(scene_of(comm, folder, *TURNING, more=STATICS), comm) as structure:
        pairs = structure.pairs
        total = np.einsum("pji,pj->i", pairs.frame, np.column_stack([pairs.T0, -np.maximum(pairs.N0, 0.0)]))
        loose = structure.linearised.system.constraints.loose
        names = structure.linearised.system.part_names
    masses = (
        7800.0 * np.array([LENGTH * WIDTH * HEIGHT, 0.03 * WIDTH * 0.01]),
        np.array([[0.025, 0.0, 0.01], [0.025, 0.0, 0.025]]),
    )
    pull = sum(mass * (at - [0.0, 0.0, 0.3]) for mass, at in zip(*masses)) + 0.3 * (
        np.array([0.025, 0.0, 0.06]) - [0.0, 0.0, 0.3]
    )
    assert total == pytest.approx(np.array([100.0, 50.0, -2100.0]) + 300.0**2 * pull * [1.0, 0.0, 1.0], rel=1e-9)
    assert [[names[i] for i in parts] for parts in loose] == [["body 'bar'", "body 'cap'"]]


def test_an_unsupported_body_is_named_with_the_bodies_tied_to_it(comm, folder):
    pulled = '[statics]\n[[statics.forces]]\npoint = "motor"\nforce = [0.0, 0.0, 10.0]\n'
    message = r"body 'bar' with body 'cap' moves along \(0, 0, 1\)"
    with pytest.raises(ConvergenceError, match=message):
        microslip.build(scene_of(comm, folder, NO_AXIS, ("preload = 2.0e7", 'preload = "static"'), more=pulled), comm)


QUICK = (("levels = [1500.0]", "levels = [1.0]"), ("samples = 64", "samples = 16\nerror_bars = false"))


def test_the_program_runs_a_scene_with_ties(comm, folder, program):
    scene = scene_of(comm, folder, *TURNING, *QUICK, more=STATICS, name="run")
    status, out, err = program("run", scene.path, "--out", folder / "out")
    assert status == 0, err
    log = on_root(comm, (folder / "out" / "run.log").read_text)
    assert "tie 'glue': 13 nodes of 'cap_bottom' follow the facets of 'bar_top', up to " in log
    assert "point 'motor': 13 nodes of 'cap_top' follow it as a rigid body" in log
    line = next(line for line in log.splitlines() if "imbalance " in line)
    assert "body 'bar' and body 'cap'" in line
    shares = [float(word) for word in line.replace(",", " ").split() if word.endswith(tuple("0123456789")) and "e-" in word]
    assert max(shares[-2:]) < 1e-8
    status, out, err = program("check", scene.path)
    assert status == 0 and "that follow ties or points" in out and "load 1     point motor" in out

    def modes():
        with h5py.File(folder / "out" / "modes.vtkhdf") as file:
            return sorted(name for name in file["VTKHDF/PointData"])

    assert len(on_root(comm, modes)) == 9


MISTAKES = {
    "no such point": (
        ('point = "motor"\ndirection', 'point = "moter"\ndirection'),
        r'point = "moter": there is no such point; nearest is "motor"',
    ),
    "held distributing": (
        ("[[ties]]", '[[supports]]\npoint = "end"\nfix = ["x"]\n[[ties]]'),
        r'\[\[supports\]\] 2 point = "end": a distributing point follows its nodes and cannot be held',
    ),
    "rotation of nodes": (
        ("[[ties]]", '[[supports]]\ngroup = "bar_end"\nfix = ["rx"]\n[[ties]]'),
        'fix holds "rx": the nodes of a group have no rotation',
    ),
    "group and point": (
        ("[[ties]]", '[[supports]]\ngroup = "bar_end"\npoint = "end"\nfix = ["x"]\n[[ties]]'),
        "exactly one of group, point is needed",
    ),
    "moment on nodes": (('point = "end"\nmoment', 'group = "bar_end"\nmoment'), "moment belongs to a point; nodes do not turn"),
    "moment and force": (
        ("moment = [0.0, 0.002, 0.0]", "moment = [0.0, 0.002, 0.0]\ndirection = [1.0, 0.0, 0.0]"),
        "exactly one of direction, moment",
    ),
    "rotation of a node": (('point = "end"\nrotation', "node = 1\nrotation"), "rotation belongs to a point; nodes do not turn"),
    "inertia": (
        ("[1.0e-5, 2.0e-5, 3.0e-5]", "[1e-5, 2e-5]"),
        r"\[\[points\]\] 1 \(\"motor\"\) inertia = .*: expected the moments of inertia",
    ),
    "negative inertia": (
        ("[1.0e-5, 2.0e-5, 3.0e-5]", "[1.0e-5, 2.0e-5, 3.0e-5, 1e-4, 0.0, 0.0]"),
        "inertia = .*: expected the moments of inertia",
    ),
    "names": (('name = "end"', 'name = "motor"'), r'\[\[points\]\] name = "motor" is used 2 times'),
    "one surface": (
        ('["cap_bottom", "bar_top"]', '["bar_top", "bar_top"]'),
        r"\[\[ties\]\] 1 \(\"glue\"\) surfaces = .*: expected the names of two different groups",
    ),
    "no such group": (
        ('["cap_bottom", "bar_top"]', '["cap_botom", "bar_top"]'),
        r"\[\[ties\]\] 'glue' surfaces = 'cap_botom': there is no such group in the mesh; nearest is 'cap_bottom'",
    ),
    "group of a point": (
        ('group = "cap_top"', 'group = "cap_topp"'),
        r"\[\[points\]\] 'motor' group = 'cap_topp': there is no such group",
    ),
    "too far": (
        ('["cap_bottom", "bar_top"]', '["cap_bottom", "ground_base"]'),
        r"tie 'glue': 13 of 13 nodes of 'cap_bottom' lie farther than",
    ),
    "joint on the tie": (('["bar_bottom", "ground_top"]', '["cap_bottom", "bar_top"]'), "tied faces cannot slip"),
    "turning inertia": (("[solver]", "[statics]\nrotation_speed = 3.0\n[solver]"), "the inertia of a point would turn"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_bad_input(comm, folder, name):
    change, message = MISTAKES[name]
    changes = (change,) if name == "turning inertia" else (NO_AXIS, change)
    with pytest.raises(CaseError, match=message):
        microslip.build(scene_of(comm, folder, *changes, name=f"bad {name}"), comm)
