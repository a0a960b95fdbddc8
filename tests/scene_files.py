"""A complete scene file for the tests, and changes to it."""

from pathlib import Path

GOOD = """\
title = "Fan-blade sector, first flap mode"

[model]
mesh = "fan_sector.msh"
scale = 1.0

[materials.titanium]
young = 114e9
poisson = 0.33
density = 4430.0

[bodies.blade]
group = "blade"
material = "titanium"

[bodies.disc]
group = "disc"
material = "titanium"
integration = "reduced"

[[supports]]
group = "disc_base"
fix = ["x", "y", "z"]

[[joints]]
name = "dovetail"
surfaces = ["blade_root", "disc_slot"]
friction = 0.3
tangential_stiffness = 2.0e13
normal_stiffness = 3.0e13
preload = 5.0e7
gap = 0.0
friction_limit = "circle"

[[loads]]
position = [0.0, 0.02, 0.10]
direction = [1.0, 0.0, 0.0]
harmonic = 1
phase = 0.0

[[outputs]]
name = "mid_blade"
position = [0.0, 0.0, 0.26]
direction = [1.0, 0.0, 0.0]

[damping]
ratio = 1e-3

[response]
levels = [1.0, 3.0, 5.0, 8.0]
frequencies = [90.0, 110.0]
points = 98
at = [99.5, 100.0]

[solver]
method = "adaptive-energy"
modes = 20
harmonics = 3
samples = 128
energy_tolerance = 1e-10
tolerance = 1e-8
"""


def write_scene(folder: Path, old: str = "", new: str = "") -> Path:
    """Write the scene with the first ``old`` replaced by ``new``, and an empty file for its mesh; return its path."""
    assert old in GOOD
    (folder / "fan_sector.msh").touch()
    path = folder / "fan.toml"
    path.write_text(GOOD.replace(old, new, 1))
    return path
