"""A bar supported only by its joint on ground, under constant loads: scenes of the tests of statics."""

import numpy as np
from blocks import stacked
from mpi4py import MPI
from msh import write_msh
from scene_text import driven, joint, response, steel, support, table

import microslip
from microslip.parallel.agree import on_root

COMM = MPI.COMM_WORLD
LENGTH, WIDTH, HEIGHT = 0.05, 0.01, 0.02
SCENE = (
    table("model", mesh="bar.msh", axis=[0.0, 0.0, 1.0])
    + steel("bar", "ground", expansion=1.2e-5)
    + support("ground_base")
    + joint("bar_bottom", "ground_top")
    + driven([[0.05, 0.01, 0.02], [0.0, 0.0, 0.02]], [0.2, 0.1, 1.0], [0.0, 0.0, 1.0], "corner")
    + response(5.0, points=10)
    + table("solver", modes=8, harmonics=3, samples=64)
)


GUIDED = (  # no friction: a support holds the bar along the joint
    ("friction = 0.3", "friction = 0.0"),
    ('fix = ["x", "y", "z"]\n', 'fix = ["x", "y", "z"]\n[[supports]]\ngroup = "bar_start"\nfix = ["x", "y"]\n'),
)


def folder_with_bar(tmp_path_factory):
    """A fixture: a folder with the mesh of the bar, the same on all ranks.  Collective."""
    path = COMM.bcast(tmp_path_factory.mktemp("bar"))
    on_root(COMM, lambda: write_msh(str(path / "bar.msh"), stacked("hex8", (LENGTH, WIDTH, HEIGHT), (4, 2, 1), 0.005)))
    return path


def scene_of(comm, folder, statics: str | None, *changes: tuple[str, str], name="scene"):
    """Return the scene with a table [statics] of these lines, or none, and replaced texts.  Collective."""

    def write():
        text = SCENE
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = folder / f"{name}.toml"
        path.write_text(text if statics is None else text + "[statics]\n" + statics)
        return path

    return microslip.read(on_root(comm, write))


def force(x, y, z, group="bar_top"):
    return f'[[statics.forces]]\ngroup = "{group}"\nforce = [{x}, {y}, {z}]\n'


def eccentric(size):
    """Return a load whose line of action crosses the joint at 0.9 of its length."""
    return force(0.0, 0.0, -0.2 * size) + force(0.0, 0.0, -0.8 * size, "bar_end")


def at_one_frequency(comm, scene):
    """Return harmonics 1 to 3 of the output at the requested frequency, and the states of the pairs."""
    with microslip.build(scene, comm) as structure:
        (level,) = microslip.respond(structure, error_bars=False).results.levels
    (i,) = np.flatnonzero(level.requested)
    return level.response[i, 0, 1:], level.state[i], structure.pairs
