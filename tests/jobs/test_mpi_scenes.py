"""The scenes of jobs/ with computed preload on coarse meshes, from statics to points near the peak; on one rank and on several."""

import sys
from pathlib import Path

import numpy as np
import pytest

import microslip
from microslip.parallel.agree import on_root

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "meshes"))

from block_on_ground import BlockOnGround, block_on_ground
from bolted_lap import BoltedLap, bolted_lap
from damper import Damper, damper
from fan_sector import Divisions, Shape, fan_sector
from msh import write_msh

_SECTOR = Divisions(span=6, chord=2, thickness=1, fillet=1, neck=1, flank=1, lobe=1, wall=1, post=1, slot=1, ring=1)
_LAP = BoltedLap(
    around_1=2, around_2=3, radial_1=2, radial_2=1, through_1=1, through_2=1, along_1=3, along_2=4, bolt_around=2, bolt_through=1
)
_DAMPER = Damper(
    kind="hex8", n_chord=3, n_shank=2, n_thick=1, n_platform=2, n_height=1, n_aerofoil=3, n_damper=2, n_flank=1, n_length=2
)
_BLOCK = BlockOnGround(kind="hex8", n_shoulder=2, n_height=1, n_up=3)

# name of the scene: its mesh, which is made here, and the level [N] at which pairs slip
SCENES = {
    "fan_paper_speed": ("fan_paper", lambda: fan_sector(Shape(), _SECTOR), 10.0),
    "bolted_lap": ("bolted_lap", lambda: bolted_lap(_LAP), 4.0),
    "underplatform_damper": ("damper", lambda: damper(_DAMPER), 20.0),
    "block_on_ground": ("block_on_ground", lambda: block_on_ground(_BLOCK), 1.5),
}


def put(folder: Path, name: str) -> Path:
    """Copy a scene and build its mesh, in neighbouring folders as in the project."""
    mesh, make, _ = SCENES[name]
    for folder_name in ("jobs", "meshes"):
        (folder / folder_name).mkdir()
    write_msh(str(folder / "meshes" / f"{mesh}.msh"), make())
    scene = folder / "jobs" / f"{name}.toml"
    scene.write_text((ROOT / "jobs" / scene.name).read_text(encoding="utf-8"), encoding="utf-8")
    return scene


def force_of(structure, body):
    """Return the resultant of the loads on a body, (3,) [N]."""
    bodies = structure.balance.bodies
    return bodies.loads[bodies.names.index(f"body {body!r}"), :3]


def of_blade(structure):
    """The flanks carry the centrifugal force of the blade, a tonne and more along the radius."""
    joints = structure.balance.joints
    assert joints.on_first[0, :3] == pytest.approx(-force_of(structure, "blade"), abs=1e-4)
    assert 1e4 < -joints.on_first[0, 2] < 1e6


def of_lap(structure):
    """The plates are pressed together by the bolt preload; the shanks carry the small shear of the lap."""
    force = structure.balance.joints.on_second[0, :3]
    assert force[2] == pytest.approx(18000.0, abs=1e-3) and np.hypot(*force[:2]) < 20.0


def of_damper(structure):
    """m r Omega^2 of a prism of 14 g, carried equally by both flanks."""
    area, height = 0.5 * (_DAMPER.damper_top + _DAMPER.damper_bottom), 0.5 * (_DAMPER.damper_bottom - _DAMPER.damper_top)
    mass = 7850.0 * area * height * _DAMPER.damper_length
    low = _DAMPER.ridge_radius - 0.5 * _DAMPER.damper_bottom
    third = (2.0 * _DAMPER.damper_top + _DAMPER.damper_bottom) / (_DAMPER.damper_top + _DAMPER.damper_bottom) / 3.0
    pull = mass * 600.0**2 * (low + third * height)
    assert force_of(structure, "damper") == pytest.approx([0.0, 0.0, pull], abs=1e-6 * pull)
    borne = structure.balance.joints.on_first[:, :3]
    assert borne.sum(axis=0) == pytest.approx([0.0, 0.0, -pull], abs=1e-6 * pull)
    assert borne[0] == pytest.approx(borne[1] * [-1.0, 1.0, 1.0], abs=1e-6 * pull)


def of_block(structure):
    """Weight and springs press the block on the ground."""
    pressed = 7.9 + 0.5e6 * (_BLOCK.length - _BLOCK.mast) * _BLOCK.width
    assert structure.balance.joints.on_second[0, :3] == pytest.approx([0.0, 0.0, -pressed], abs=1e-6 * pressed)


AT_REST = {"fan_paper_speed": of_blade, "bolted_lap": of_lap, "underplatform_damper": of_damper, "block_on_ground": of_block}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["fan_paper_speed", *(pytest.param(name, marks=pytest.mark.ranks(1)) for name in SCENES if name != "fan_paper_speed")]
)
def test_the_scene_has_a_state_of_rest_and_vibrates_about_it(comm, shared_path, name):
    """Energy is conserved at every point, some is lost by friction, and the slipping motion is smaller than the stuck one."""
    level = SCENES[name][2]
    keys = {"points": 2, "span": [0.995, 1.0], "harmonics": 1, "samples": 64, "error_bars": False}
    with microslip.build(microslip.read(on_root(comm, put, shared_path, name)), comm) as structure:
        AT_REST[name](structure)
        bodies = structure.balance.bodies
        assert (np.linalg.norm(bodies.left[:, :3], axis=1) < 1e-7 * bodies.size).all()
        results = microslip.respond(structure, levels=[level], **keys).results
    (curve,) = results.levels
    assert not curve.failure and len(curve.frequency) >= 2
    assert (curve.friction > 0.0).all() and curve.friction + curve.damping == pytest.approx(curve.input, rel=curve.closes_to)
    stuck = np.abs(results.linear.response[:, 0, 1] - 1j * results.linear.response[:, 0, 2]).max()
    assert 0.0 < np.abs(curve.response[:, 0, 1] - 1j * curve.response[:, 0, 2]).max() < level * stuck
