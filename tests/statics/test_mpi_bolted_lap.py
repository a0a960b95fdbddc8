"""The scene jobs/bolted_lap.toml on a coarse mesh, with bolts, ties and plates of different meshes; on any number of ranks."""

import sys
from pathlib import Path

import numpy as np
import pytest

import microslip
from microslip.library.build import at_another_rest
from microslip.library.respond import pairs_with
from microslip.parallel.agree import on_root
from microslip.scene.read import changed

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "meshes"))

from bolted_lap import BoltedLap, bolted_lap
from msh import write_msh

COARSE = BoltedLap(
    around_1=2, around_2=3, radial_1=2, radial_2=1, through_1=1, along_1=3, along_2=4, bolt_around=3, bolt_through=1
)
FORCE = 6000.0  # N, of each bolt


def put(folder: Path) -> Path:
    """Copy the scene and make its mesh, in folders like those of the project."""
    for name in ("jobs", "meshes"):
        (folder / name).mkdir()
    write_msh(str(folder / "meshes" / "bolted_lap.msh"), bolted_lap(COARSE))
    scene = folder / "jobs" / "bolted_lap.toml"
    scene.write_text((ROOT / "jobs" / scene.name).read_text(encoding="utf-8"), encoding="utf-8")
    return scene


@pytest.mark.slow
def test_contact_forces_of_the_plates_balance_the_bolts(comm, shared_path):
    scene = on_root(comm, put, shared_path)
    with microslip.build(microslip.read(scene), comm) as structure:
        pairs, bolts = structure.pairs, structure.bolts
        N = np.maximum(pairs.N0, 0.0)
    assert bolts.names == ("bolt 1", "bolt 2", "bolt 3") and np.allclose(bolts.force, FORCE, rtol=1e-9)
    assert N.sum() == pytest.approx(3.0 * FORCE, rel=1e-9)  # only the bolts cross the lap
    # the force of each bolt is around its hole, and the pressure decreases outwards
    holes = COARSE.length - (np.arange(3)[::-1] + 0.5) * COARSE.pitch
    for x in holes:
        near = np.abs(pairs.position[:, 0] - x) < 0.5 * COARSE.pitch
        assert N[near].sum() == pytest.approx(FORCE, rel=0.03)
        radius, pressure = np.hypot(*(pairs.position[near, :2] - [x, 0.5 * COARSE.width]).T), N[near] / pairs.area[near]
        inner, outer = pressure[radius < 0.6 * COARSE.head], pressure[radius > COARSE.head]
        assert len(inner) and len(outer) and inner.min() > 2.0 * outer.max()


@pytest.mark.study
@pytest.mark.ranks(1)
def test_rest_of_bolts_with_another_friction_equals_that_of_a_new_structure(comm, shared_path):
    scene = microslip.read(on_root(comm, put, shared_path))
    other = changed(scene, {}, {"lap": {"friction": 0.1}})
    with microslip.build(scene, comm) as structure, microslip.build(other, comm) as fresh:
        assert structure.reference is not None
        pairs = pairs_with(structure.reference.pairs, {"friction": {"lap": 0.1}})
        other_rest, messages = at_another_rest(structure, other, pairs)
        for name in ("N0", "T0"):
            a, b, first = (getattr(s.pairs, name) for s in (other_rest, fresh, structure))
            assert a == pytest.approx(b, abs=1e-8 * np.abs(b).max()) and np.abs(a - first).max() > 1e-3 * np.abs(first).max()
        assert other_rest.bolts is not None and other_rest.bolts.shortening == pytest.approx(fresh.bolts.shortening, rel=1e-8)
        assert other_rest.modes.omega_n == pytest.approx(fresh.modes.omega_n, rel=1e-8)
        assert sum(line.startswith("  bolt ") for line in messages) == 3
