"""Two rings, one within the other, whose joint reaches the cyclic faces: there each body has its own nodes at the same places."""

import numpy as np
import pytest
from blocks import block, join
from mpi4py import MPI
from msh import write_msh
from scene_text import joint, steel, support, table

from microslip.library.build import build
from microslip.library.respond import respond
from microslip.parallel.agree import on_root
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
N, ORDER, AT = 6, 2, 7000.0  # Hz
LAW = {"friction": 0.1, "preload": 2.0e6, "k_t": 5.0e11}
END = (
    f"[damping]\nratio = 0.01\n[response]\nlevels = [200.0]\nfrequencies = [{0.995 * AT}, {1.005 * AT}]\nat = [{AT}]\npoints = 8\n"
    "[solver]\nmodes = {}\nharmonics = 3\nerror_bars = false\ntolerance = 1e-10\nsamples = 120\n"
)


def ring_of(radii, s, names):
    """Return a ring's block in sector s, inclined so that it has no mirror symmetry."""

    def mapping(u, v, w):
        r = radii[0] + (radii[1] - radii[0]) * u
        angle = 2.0 * np.pi / N * (s + v) + 1.5 * (r - 0.05) + 0.1 * w
        return np.stack([r * np.cos(angle), r * np.sin(angle), 0.02 * w], axis=-1)

    return block("hex8", mapping, (1, 3, 1), names)


def sector(s, suffix=""):
    """Return the blocks of both rings in sector s."""
    ends = {"y0": "low", "y1": "high"}
    inner = ring_of((0.05, 0.07), s, {"x0": "bore", "x1": f"slot{suffix}"} | ends)
    return inner, ring_of((0.07, 0.09), s, {"x0": f"root{suffix}", "x1": "rim"} | ends)


def direction(s, vector=(0.6, 1.0, 0.3)):
    """Return a direction turned with sector s."""
    a = 2.0 * np.pi * s / N
    turn = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    return [float(x) for x in turn @ vector]


def at(s):
    """Return the position of a node on the rim of sector s, between the cyclic faces [m]."""
    angle = 2.0 * np.pi / N * (s + 1.0 / 3.0) + 1.5 * 0.04
    return [0.09 * float(np.cos(angle)), 0.09 * float(np.sin(angle)), 0.0]


def write(folder, is_full):
    """Write mesh and scene of one sector, or of the complete rings with the loads of the wave."""
    alpha, count = 2.0 * np.pi / N, N if is_full else 1
    parts = [sector(s, str(s) if is_full else "") for s in range(count)]
    name = "full" if is_full else "sector"
    bodies = {key: join([part[i] for part in parts]) for i, key in enumerate(("inner", "outer"))}
    write_msh(str(folder / f"{name}.msh"), bodies)
    text = table("model", mesh=f"{name}.msh") + steel("inner", "outer") + support("bore")
    for s in range(count):
        own = str(s) if is_full else ""
        text += joint(f"root{own}", f"slot{own}", name=f"ring{own}", **LAW) + f"start = {-alpha * ORDER * s!r}\n"
        text += table("[loads]", position=at(s), direction=direction(s), phase=alpha * ORDER * s)
    text += table("[outputs]", name="rim", position=at(0), direction=direction(0))
    if not is_full:
        text += table("cyclic", sectors=N, axis=[0.0, 0.0, 1.0], faces=["low", "high"], engine_order=ORDER)
    path = folder / f"{name}.toml"
    path.write_text(text + END.format(54 * count))
    return path


def test_a_joint_may_reach_the_cyclic_faces(shared_path):
    """Frequencies of all nodal diameters, and the response where pairs slip, are those of the complete rings."""
    one, full = (build(read_scene(on_root(COMM, lambda: write(shared_path, is_full))), COMM) for is_full in (False, True))  # noqa: B023
    assert full.pairs.n_pairs == N * one.pairs.n_pairs
    of_sectors = np.sort(np.concatenate([one.per_group.of_group(d).omega_n for d in range(N)]))
    np.testing.assert_allclose(of_sectors, full.omega_n, rtol=1e-9)
    branches = [respond(structure).level(200.0) for structure in (one, full)]
    points = [int(np.argmin(np.abs(branch.frequency - AT))) for branch in branches]
    slipping = [int((branch.state[i] == 1).sum()) for branch, i in zip(branches, points)]
    assert slipping[1] == N * slipping[0] > 0
    a, b = (branch.response[i] for branch, i in zip(branches, points))
    np.testing.assert_allclose(a, b, atol=1e-6 * np.abs(b).max())
    one.close()
    full.close()
