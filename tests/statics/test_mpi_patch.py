"""A flat joint of two meshes, and a joint on rigid ground, transmit uniform pressure; on one rank and on several."""

import numpy as np
import pytest
from blocks import box
from msh import write_msh
from scene_text import driven, joint, steel, support, table

import microslip
from microslip.parallel.agree import on_root

PRESSURE = 3.0e6
SIDE = 0.02
SCENE = (
    table("model", mesh="blocks.msh")
    + steel("upper", "lower")
    + "".join(support(side, axis) for side, axis in zip(("left", "right", "front", "rear", "base"), "xxyyz"))
    + joint("under", "on", friction=0.2, k_t=1.0e13)
    + driven([[0.02, 0.02, 0.03], [0.0, 0.0, 0.03]], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], "corner")
    + table("damping", ratio=0.01)
    + table("response", levels=[1.0], frequencies=[100.0, 200.0], points=5)
    + table("solver", modes=4, verify_modes=False)
    + table("[statics.pressures]", group="top", pressure=PRESSURE)
)
SIDES = {"x0": "left", "x1": "right", "y0": "front", "y1": "rear"}


def blocks(upper: str, lower: str):
    """Return two blocks, the upper one with 3 x 4 cells, the lower one with 2 x 3."""
    return {
        "upper": box(upper, (SIDE, SIDE, 0.01), (3, 4, 1), (0.0, 0.0, 0.02), {**SIDES, "z0": "under", "z1": "top"}),
        "lower": box(lower, (SIDE, SIDE, 0.02), (2, 3, 2), (0.0, 0.0, 0.0), {**SIDES, "z0": "base", "z1": "on"}),
    }


TWO = 'surfaces = ["under", "on"]'


@pytest.fixture(scope="module")
def folder(comm, tmp_path_factory):
    return comm.bcast(tmp_path_factory.mktemp("patch"))


def built(comm, folder, upper, lower, *changes):
    """Return the structure of the scene with replaced texts.  Collective."""

    def write():
        text = SCENE
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        write_msh(str(folder / "blocks.msh"), blocks(upper, lower))
        (folder / "scene.toml").write_text(text)
        return microslip.read(folder / "scene.toml")

    return microslip.build(on_root(comm, write), comm)


@pytest.mark.parametrize(
    "upper, lower, pairing",
    [("hex8", "hex8", "auto"), ("tet10", "hex20", "auto"), ("hex20", "wedge15", "points"), ("tet4", "hex8", "points")],
)
def test_the_joint_transmits_uniform_pressure(comm, folder, upper, lower, pairing):
    with built(comm, folder, upper, lower, (TWO, f'{TWO}\npairing = "{pairing}"')) as structure:
        pairs = structure.pairs
        assert f"contact points, {'mortars on faces' if pairing == 'auto' else 'in cells'} of" in pairs.notes[0]
        assert pairs.area.sum() == pytest.approx(SIDE**2, rel=1e-12)
        np.testing.assert_allclose(pairs.N0 / pairs.area, PRESSURE, rtol=1e-8)
        assert np.abs(pairs.T0).max() < 1e-8 * pairs.N0.max()


GROUND = (TWO, 'surfaces = ["base"]\nagainst = "ground"')
NO_BASE = ('[[supports]]\ngroup = "base"\nfix = ["z"]\n', "")
LOWER_TOP = ('group = "top"\npressure', 'group = "on"\npressure')
LOWER_ONLY = (
    ('[bodies.upper]\ngroup = "upper"\nmaterial = "steel"\n', ""),
    ("position = [0.02, 0.02, 0.03]", "position = [0.02, 0.02, 0.02]"),
    ("position = [0.0, 0.0, 0.03]", "position = [0.0, 0.0, 0.02]"),
)


@pytest.mark.parametrize("pairing", ["nodes", "points"])
def test_ground_bears_uniform_pressure(comm, folder, pairing):
    stated = (GROUND[1], GROUND[1] + f'\npairing = "{pairing}"')
    with built(comm, folder, "hex8", "hex8", GROUND, stated, NO_BASE, LOWER_TOP, *LOWER_ONLY) as structure:
        pairs = structure.pairs
        assert (pairs.node2 == -1).all() and (pairs.node1 >= 0).all()
        np.testing.assert_allclose(pairs.frame[:, 2], np.tile([0.0, 0.0, 1.0], (pairs.n_pairs, 1)), atol=1e-12)
        np.testing.assert_allclose(pairs.N0 / pairs.area, PRESSURE, rtol=1e-8)


def test_a_plane_below_a_block_bears_uniform_pressure(comm, folder):
    """The gap of the mesh closes, and the plane bears the load."""
    plane = GROUND[1].replace('"ground"', '"plane"\nplane_point = [0.0, 0.0, -1.0e-6]\nplane_normal = [0.0, 0.0, 2.0]')
    with built(comm, folder, "hex8", "hex8", (GROUND[0], plane), NO_BASE, LOWER_TOP, *LOWER_ONLY) as structure:
        pairs = structure.pairs
        assert "1e-06 to 1e-06 m off" in pairs.notes[0]
        np.testing.assert_allclose(pairs.N0 / pairs.area, PRESSURE, rtol=1e-8)


@pytest.mark.slow
def test_the_response_with_different_meshes_is_the_same_on_all_numbers_of_ranks(comm, folder):
    """All ranks together and each rank by itself compute the same peak, with slip."""
    changes = (
        ("levels = [1.0]", "levels = [13.0]"),
        ("frequencies = [100.0, 200.0]", "mode = 1\nspan = [0.97, 1.02]"),
        ("modes = 4", "modes = 4\nharmonics = 1\nsamples = 32"),
    )
    push = (
        ("direction = [0.0, 0.0, 1.0]\n[[outputs]]", "direction = [1.0, 0.0, 0.0]\n[[outputs]]"),
        ("[0.02, 0.02, 0.03]", "[0.01, 0.01, 0.03]"),
    )
    free = [
        (f'[[supports]]\ngroup = "{side}"\nfix = ["{axis}"]\n', "")
        for side, axis in zip(("left", "right", "front", "rear"), "xxyy")
    ]
    base = ('fix = ["z"]', 'fix = ["x", "y", "z"]')
    values = []
    for ranks in (comm, comm.Split(comm.rank)):
        place = folder if ranks is comm else folder / f"serial_{comm.rank}"
        place.mkdir(exist_ok=True)
        with built(ranks, place, "hex8", "tet4", *changes, *push, *free, base) as structure:
            response = microslip.respond(structure, error_bars=False, peaks=True)
            (level,), (peak,) = response.results.levels, response.peaks[13.0]
            values.append(abs(peak.amplitude))
        assert (level.state == 1).any() and not (level.state == 2).any()
    assert values[1] == pytest.approx(values[0], rel=1e-6)
