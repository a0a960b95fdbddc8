"""Temperature fields, and moments on surfaces and points, against beam theory; on one rank and on several."""

import numpy as np
import pytest
from blocks import box
from msh import write_msh
from scene_text import response, steel, support, table

import microslip
from microslip.messages.errors import CaseError, MeshError
from microslip.parallel.agree import on_root

YOUNG, LENGTH, SIDE, EXPANSION = 2.0e11, 0.4, 0.02, 1e-5
INERTIA = SIDE**4 / 12.0
SLOPE = 4000.0  # K/m across the beam
SCENE = (
    table("model", mesh="beam.msh")
    + steel("beam", young=YOUNG, poisson=0.0, density=8000.0, expansion=EXPANSION)
    + support("hub")
    + "POINTS\n"
    + table("[loads]", group="tip", direction=[0.0, 0.0, 1.0])
    + table("[outputs]", name="tip", position=[LENGTH, 0.0, 0.0], direction=[0.0, 0.0, 1.0])
    + response(1.0)
    + table("solver", modes=3)
    + "[statics]\n"
)
HEATED = '[[statics.temperatures]]\ngroup = "beam"\n'
POINT = f"""
[[points]]
name = "knob"
position = [{LENGTH + 0.1}, 0.0, 0.05]
group = "tip"
connection = "KIND"
"""


def beam(kind="hex20"):
    return box(kind, (LENGTH, SIDE, SIDE), (6, 1, 1), (0.0, -0.5 * SIDE, -0.5 * SIDE), {"x0": "hub", "x1": "tip"})


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    """Return the folder of a beam along x, clamped at one end, with a temperature field."""
    path = comm.bcast(tmp_path_factory.mktemp("beam"))

    def write():
        write_msh(str(path / "beam.msh"), {"beam": beam()}, binary=False)
        z = [SLOPE * point[2] for point in beam().points]
        heat = "".join(f"{i} {value!r}\n" for i, value in enumerate(z, 1))
        with open(path / "beam.msh", "a", encoding="utf-8") as file:
            file.write(f'$NodeData\n1\n"heat"\n1\n0.0\n3\n0\n1\n{len(z)}\n{heat}$EndNodeData\n')
        (path / "heat.csv").write_text("node,temperature\n" + heat.replace(" ", ","))
        (path / "short.csv").write_text("node,temperature\n1,2.0\n3,4.0\n")

    on_root(comm, write)
    return path


def scene_of(comm, folder, statics, points=""):
    path = folder / "beam.toml"
    on_root(comm, lambda: path.write_text(SCENE.replace("POINTS", points) + statics))
    try:
        return microslip.read(path)
    finally:
        comm.barrier()  # before the next test writes it


def tip_of(comm, scene):
    """Return the displacement at rest of the nodes at the tip, (n, 3) [m].  Rank 0 computes it for all ranks."""
    with microslip.build(scene, comm) as structure:
        system = structure.linearised.system
        u = system.at_nodes(np.concatenate(comm.allgather(system.rest_owned)))
        return on_root(comm, lambda: u[np.isclose(structure.mesh.points[:, 0], LENGTH)])


@pytest.mark.parametrize("given", ['field = "heat"\n', 'file = "heat.csv"\n'], ids=["field", "file"])
@pytest.mark.parametrize("large", [False, True])
def test_a_temperature_gradient_bends_the_beam_as_in_theory(comm, folder, given, large):
    """kappa is alpha times the gradient of the temperature; the tip moves down by kappa L^2 / 2."""
    u = tip_of(comm, scene_of(comm, folder, f"large_displacements = {str(large).lower()}\n" + HEATED + given))
    assert u[:, 2].mean() == pytest.approx(-0.5 * EXPANSION * SLOPE * LENGTH**2, rel=2e-3)


MOMENT = 30.0  # N m about -y: it lifts the tip
PLACES = {
    "surface": ('group = "tip"\n', ""),
    "rigid point": ('point = "knob"\n', POINT.replace("KIND", "rigid")),
    "distributing point": ('point = "knob"\n', POINT.replace("KIND", "distributing")),
}


@pytest.mark.parametrize("where", PLACES)
def test_a_moment_bends_the_beam_as_in_theory(comm, folder, where):
    at, points = PLACES[where]
    moment = f"[[statics.forces]]\n{at}moment = [0.0, {-MOMENT}, 0.0]\n"
    u = tip_of(comm, scene_of(comm, folder, moment, points))
    assert u[:, 2].mean() == pytest.approx(MOMENT * LENGTH**2 / (2.0 * YOUNG * INERTIA), rel=2e-3)
    assert np.abs(u[:, :2].mean(axis=0)).max() < 1e-9 * np.abs(u).max()


MISTAKES = {
    "no field": (
        HEATED + 'field = "heet"\n',
        MeshError,
        r'group = "beam" field = \'heet\': there is no such field in the mesh; nearest',
    ),
    "short file": (
        HEATED + 'file = "short.csv"\n',
        MeshError,
        r"short.csv: .* nodes of the body have no row, the first is node 2",
    ),
    "two of them": (
        HEATED + 'field = "heat"\ntemperature = 3.0\n',
        CaseError,
        "exactly one of temperature, field, file is needed",
    ),
    "moment on a node": ("[[statics.forces]]\nnode = 1\nmoment = [1.0, 0.0, 0.0]\n", CaseError, "a node alone bears none"),
    "neither": ('[[statics.forces]]\ngroup = "tip"\n', CaseError, "force is missing: expected the force .* or moment"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_bad_temperatures_and_moments_are_refused(comm, folder, name):
    statics, kind, message = MISTAKES[name]
    with pytest.raises(kind, match=message):
        microslip.build(scene_of(comm, folder, statics), comm)
