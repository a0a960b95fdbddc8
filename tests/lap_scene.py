"""Two beams in a lap joint: the smallest scene for the whole program, and its mesh as lines of text."""

from pathlib import Path

from lap_joint import LapJoint, lap_joint
from msh import write_msh

SCENE = """\
[model]
mesh = "lap.msh"
[materials.steel]
young = 210e9
poisson = 0.3
density = 7800.0
[bodies.left]
group = "beam_1"
material = "steel"
[bodies.right]
group = "beam_2"
material = "steel"
[[supports]]
group = "clamp"
fix = ["x", "y", "z"]
[[joints]]
name = "lap"
surfaces = ["lap_1", "lap_2"]
friction = 0.3
tangential_stiffness = 1e12
normal_stiffness = 1e12
preload = 1e6
[[loads]]
group = "tip"
direction = [0.0, 0.0, 1.0]
[[outputs]]
name = "tip"
position = [0.21, 0.0, 0.0]
direction = [0.0, 0.0, 1.0]
[damping]
ratio = 0.01
[response]
levels = [1.0]
frequencies = [10.0, 1000.0]
points = 20
[solver]
modes = 5
harmonics = 3
"""


def write_mesh(path: Path) -> list[str]:
    """Write the mesh as text in Gmsh's format and return its lines."""
    write_msh(str(path), lap_joint(LapJoint(kind="hex8", n_free=2, n_overlap=2, n_width=1, n_thickness=1)), binary=False)
    return path.read_text().splitlines()
