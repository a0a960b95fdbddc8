"""The state of rest of a disc from one sector and the vibration about it, compared with the full ring; on any number of ranks."""

import numpy as np
import pytest
from discs import of_ring, write_ring, write_sector
from mpi4py import MPI
from scene_text import table
from scipy.spatial import cKDTree

from microslip.library.build import build
from microslip.library.respond import respond
from microslip.parallel.agree import on_root
from microslip.results.fields import read_fields
from microslip.results.read import read_results
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
AXIS = "axis = [0.0, 0.0, 1.0]\n"


def end(statics, modes, frequency, level, **solver):
    """Return [statics] and the tables of damping, response and solver."""
    keys = {"harmonics": 3, "error_bars": False, "tolerance": 1e-10, "samples": 120} | solver
    near = [0.998 * frequency, 1.002 * frequency]
    return (
        statics
        + table("damping", ratio=0.01)
        + table("response", levels=[level], frequencies=near, at=[frequency], points=6)
        + table("solver", modes=modes, **keys)
    )


def built(write, folder, *args, **how):
    """Return the structure of a scene that rank 0 writes; the ring gets an axis in [model].  Collective."""

    def written():
        path = write(folder, *args, **how)
        if write is write_ring:
            path.write_text(path.read_text().replace("[model]\n", "[model]\n" + AXIS))
        return path

    return build(read_scene(on_root(COMM, written)), COMM)


def forces_at_rest(pairs):
    """Return friction and minus the normal force at rest in the axes of the pairs, gaps as forces of their springs, (n, 3, 1) [N]."""
    return np.column_stack([pairs.T0, -pairs.N0])[:, :, None]


def at_frequency(structure, frequency, level):
    """Return the output's coefficients at a frequency and the number of pairs that slip.  Collective."""
    branch = respond(structure).level(level)
    assert not branch.failure
    i = int(np.argmin(np.abs(branch.frequency - frequency)))
    assert branch.frequency[i] == pytest.approx(frequency, rel=1e-12)
    return branch.response[i, 0], int((branch.state[i] == 1).sum())


SPEED = table("statics", rotation_speed=450.0, steps=5)
PRESSED = SPEED + table("[statics.pressures]", group="tip", pressure=3.0e6)
SHROUDS = {"preload": 3e7, "friction": 0.2, "how": {"shroud": True}, "of_shrouds": {"preload": "static"}}
CASES = {  # N, h, statics, joints and shape of the sector
    "pressed, with slip at rest": (5, 1, PRESSED, {"preload": 2e7, "friction": 0.085}, 1420.0, 200.0),
    "large displacements": (
        6,
        3,
        PRESSED.replace("steps", "large_displacements = true\nsteps"),
        {"preload": 2e7, "friction": 0.06},
        1392.0,
        300.0,
    ),
    "shrouds that untwist closes in part": (5, 2, SPEED, SHROUDS, 946.0, 60.0),
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=() if "pressed" in name else pytest.mark.ranks(1)) for name in CASES])
def test_rest_and_vibration_are_those_of_the_ring(shared_path, name):
    N, h, statics, how, frequency, level = CASES[name]
    n_dof = 90 if how.get("how") else 54
    sector = built(write_sector, shared_path, N, end(statics, n_dof, frequency, level), wave={"engine_order": h}, **how)
    ring = built(write_ring, shared_path, N, end(statics, N * n_dof, frequency, level), h=h, **how)
    at_rest = COMM.bcast(of_ring(sector.pairs, ring.pairs, N, h, forces_at_rest(sector.pairs)) if COMM.rank == 0 else None)
    slid = np.hypot(*sector.pairs.T0.T) > (1.0 - 1e-9) * sector.pairs.mu * sector.pairs.N0
    assert (sector.pairs.open_at_rest.any() or slid.any()) and not slid.all()
    size = np.abs(at_rest).max()
    np.testing.assert_allclose(forces_at_rest(ring.pairs), at_rest, atol=1e-8 * size)
    joints, bodies = sector.balance.joints, sector.balance.bodies
    n = 3 if "large" in name else 6  # moments in the deformed shape are of the order of its rotations
    assert np.abs((joints.on_first + joints.on_second)[:, :n]).max() < 1e-9 * joints.size.max()
    assert np.abs(bodies.left).max() < 1e-9 * bodies.size.max()
    omega_n = np.sort(np.concatenate([sector.per_group.of_group(d).omega_n for d in range(N)]))
    np.testing.assert_allclose(omega_n, ring.omega_n, rtol=1e-9)
    of_sector, n_slip = at_frequency(sector, frequency, level)
    of_ring_, n_slip_of_ring = at_frequency(ring, frequency, level)
    assert n_slip_of_ring == N * n_slip > 0
    np.testing.assert_allclose(of_sector, of_ring_, atol=1e-6 * np.abs(of_ring_).max())
    sector.close()
    ring.close()


@pytest.mark.pictures
@pytest.mark.ranks(1)
def test_the_program_writes_frequencies_at_speed_of_every_nodal_diameter(shared_path, program):
    """The frequencies are those of the structures at these speeds, with stress stiffening, and the orders excite each diameter."""
    N, scene = 5, end(PRESSED, 4, 1420.0, 1.0)
    path = on_root(COMM, lambda: write_sector(shared_path, N, scene, preload=2e7))
    status, _, messages = program("modes", str(path), "--out", str(shared_path / "out"), "--speeds", "100,300,450")
    assert status == 0, messages
    COMM.barrier()
    table = np.genfromtxt(shared_path / "out" / "campbell.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["nodal_diameter"], np.repeat([0, 1, 2], 3))
    sector = build(read_scene(path), COMM)
    for d in range(3):
        of_d = table[table["nodal_diameter"] == d]
        np.testing.assert_allclose(of_d["speed_rad_s"], [100.0, 300.0, 450.0])
        families = np.sort([of_d[f"family_{i}_Hz"][-1] for i in range(1, 5)])
        np.testing.assert_allclose(families, sector.per_group.of_group(d).omega_n[:4] / (2.0 * np.pi), rtol=1e-8)
        assert (np.diff(of_d["family_1_Hz"]) != 0.0).all()
    sector.close()
    met = np.genfromtxt(shared_path / "out" / "crossings.csv", delimiter=",", names=True)
    d, order = np.atleast_1d(met["nodal_diameter"]), np.atleast_1d(met["engine_order"])
    np.testing.assert_array_equal(d, np.minimum(order % N, -order % N))
    assert {"campbell.png", "interference.png", "modes_diameter_02.vtkhdf"} <= {
        file.name for file in (shared_path / "out").iterdir()
    }


def test_a_run_writes_the_disc_at_rest_and_continues(shared_path, program):
    """The displacement at rest of all sectors, rotated, in results.h5; a second run uses the structures of the first."""
    N = 5
    path = on_root(COMM, lambda: write_sector(shared_path, N, end(PRESSED, 6, 1420.0, 1.0), preload=2e7))
    for _ in range(2):
        status, _, messages = program("run", str(path), "--out", str(shared_path / "out"))
        assert status == 0, messages
        COMM.barrier()
    results, fields = (read(str(shared_path / "out" / "results.h5")) for read in (read_results, read_fields))
    n, alpha = len(fields.mesh.points) // N, 2.0 * np.pi / N
    turn = np.array([[np.cos(alpha), -np.sin(alpha), 0.0], [np.sin(alpha), np.cos(alpha), 0.0], [0.0, 0.0, 1.0]])
    u = fields.rest
    np.testing.assert_allclose(u[n : 2 * n], u[:n] @ turn.T, atol=1e-6 * np.abs(u).max())
    disc = np.unique(np.concatenate([each.nodes.ravel() for each in fields.mesh.elements if each.group == "disc"]))
    close = cKDTree(fields.mesh.points[disc]).query_pairs(1e-9, output_type="ndarray")
    assert len(close) == 4 * N and np.abs(u[disc]).max() > 0.0
    np.testing.assert_allclose(u[disc[close[:, 0]]], u[disc[close[:, 1]]], atol=1e-6 * np.abs(u).max())
    assert set(results.at_rest) == {"joints", "bodies"}
