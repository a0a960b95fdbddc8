"""Natural frequencies with Coriolis forces against dense matrices, a rotating shaft, the complete ring; on one and two ranks."""

import csv
from contextlib import contextmanager

import numpy as np
import pytest
import scipy.linalg
from blocks import box
from discs import write_ring, write_sector
from msh import write_msh
from scene_text import driven, response, steel, support, table

from microslip.modes.lapack import gathered
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.scene.read import read_scene
from microslip.studies.modes.command import stuck_modes
from microslip.studies.modes.coriolis import with_matrix
from microslip.studies.modes.disc import modes_by_diameter

pytestmark = pytest.mark.ranks(1, 2)

LENGTH, SIDE, DENSITY = 1.0, 0.02, 8000.0  # m, m, kg/m3


def turning(speed, coriolis=True, **keys):
    return table("statics", rotation_speed=speed, coriolis=coriolis, **keys)


def write_shaft(folder, speed, n=8, modes=4, coriolis=True, more=""):
    """Write a square shaft along its axis of rotation, clamped at one end."""
    shaft = box("hex20", (LENGTH, SIDE, SIDE), (n, 1, 1), (0.0, -0.5 * SIDE, -0.5 * SIDE), {"x0": "hub", "x1": "tip"})
    write_msh(str(folder / "shaft.msh"), {"shaft": shaft})
    path = folder / "shaft.toml"
    path.write_text(
        table("model", mesh="shaft.msh", axis=[1.0, 0.0, 0.0])
        + steel("shaft", young=2.0e11, poisson=0.0, density=DENSITY)
        + support("hub")
        + turning(speed, coriolis)
        + driven([[LENGTH, 0.0, 0.0]], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], "tip")
        + more
        + response(1.0)
        + table("solver", modes=modes)
    )
    return path


@contextmanager
def computed(path, comm):
    """Yield parts, factor, modes and waves of a scene.  Collective."""
    with stuck_modes(read_scene(path), comm, RunLog(comm, screen=False)) as results:
        yield results


def test_the_space_of_all_modes_solves_the_complete_equations(comm, shared_path):
    """All omega of K_L - omega^2 M + i omega G equal those of a dense pencil of twice the size; G is skew and couples y and z."""
    disc = table("[masses]", group="tip", mass=0.05)
    path = on_root(comm, lambda: write_shaft(shared_path, 60.0, 2, 72, more=disc))
    scene, log = read_scene(path), RunLog(comm, screen=False)
    parts, matrix = with_matrix(scene, comm, log)
    G, M = (comm.bcast(gathered(A)) for A in (matrix.G, parts.rest.system.M))
    np.testing.assert_allclose(G, -G.T, atol=1e-14 * np.abs(G).max())
    rows = parts.rest.system.dof
    y, z = (rows[:, k][rows[:, k] >= 0] for k in (1, 2))  # nodes are fixed in all directions, or in none
    np.testing.assert_allclose(G[np.ix_(z, y)], 2.0 * 60.0 * M[np.ix_(y, y)], atol=1e-12 * np.abs(G).max())
    assert np.abs(G[rows[:, 0][rows[:, 0] >= 0]]).max() == 0.0  # no Coriolis forces along the axis
    matrix.destroy()
    parts.rest.system.destroy()
    with computed(path, comm) as (_, linearised, _, waves):
        K_L = comm.bcast(gathered(linearised.K_L))
        n = len(M)
        zeros = np.zeros((n, n))
        pencil = np.block([[zeros, K_L], [K_L, 1j * G]]), scipy.linalg.block_diag(K_L, M)  # for u and omega u
        omega = scipy.linalg.eigh(*pencil, eigvals_only=True)
        np.testing.assert_allclose(waves.omega[:40], omega[n : n + 40], rtol=1e-8)
        assert len(waves.omega) == n and waves.residual < 1e-5
        of_all_modes = waves.omega[:3]
    with computed(on_root(comm, lambda: write_shaft(shared_path, 60.0, 2, 3, more=disc)), comm) as (_, _, _, waves):
        np.testing.assert_allclose(waves.omega, of_all_modes, rtol=1e-9)  # with few modes
        assert waves.residual < 1e-5


def test_a_rotating_shaft_has_frequencies_shifted_by_the_speed(comm, shared_path):
    """In rotating axes the bending frequencies of a shaft are omega_0 -+ Omega, with omega_0 in fixed axes."""
    at_rest = on_root(comm, write_shaft, shared_path, 1e-3)
    with computed(at_rest, comm) as (_, _, modes, _):
        omega_0 = modes.omega_n[0]
    speed = 0.5 * omega_0
    with computed(on_root(comm, write_shaft, shared_path, float(speed)), comm) as (_, _, modes, waves):
        np.testing.assert_allclose(waves.omega[:2], [omega_0 - speed, omega_0 + speed], rtol=1e-3)
        np.testing.assert_allclose(modes.omega_n[0], np.sqrt(omega_0**2 - speed**2), rtol=1e-3)  # without Coriolis forces


@pytest.mark.parametrize("N", [5, pytest.param(6, marks=pytest.mark.ranks(1))])
def test_waves_of_a_sector_have_the_frequencies_of_the_ring(comm, shared_path, N):
    """Every frequency of the complete ring is that of a wave, backward or forward, of a nodal diameter."""
    speed, n, n_few = 600.0, 54, 2
    end = turning(speed) + table("damping", ratio=0.01) + table("response", levels=[1.0], mode=1, span=[0.9, 1.1])
    contact = {"preload": 2e9, "friction": 0.5}
    path = on_root(comm, lambda: write_sector(shared_path, N, end + table("solver", modes=n), **contact))
    log, all_waves, split, of_many_modes = RunLog(comm, screen=False), [], [], []
    parts, matrix = with_matrix(read_scene(path), comm, log)
    for waves_of_diameter in modes_by_diameter(parts, matrix, n, range(N // 2 + 1), log):
        is_real, (backward, forward) = (
            waves_of_diameter.diameter == 0 or 2 * waves_of_diameter.diameter == N,
            waves_of_diameter.waves,
        )
        all_waves += [backward.omega] if is_real else [backward.omega, forward.omega]
        split.append(np.abs(backward.omega / forward.omega - 1.0).max())
        assert backward.residual < 1e-6 and forward.residual < 1e-6
        assert (split[-1] < 1e-10) == is_real
        of_many_modes.append((backward.omega[:n_few], forward.omega[:n_few]))
    assert max(split) > 1e-3
    parts, matrix = with_matrix(read_scene(path), comm, log)
    for waves_of_diameter in modes_by_diameter(parts, matrix, n_few, range(N // 2 + 1), log):
        np.testing.assert_allclose(
            [wave.omega for wave in waves_of_diameter.waves], of_many_modes[waves_of_diameter.diameter], rtol=1e-9
        )  # with few modes
        assert max(wave.residual for wave in waves_of_diameter.waves) < 1e-5

    def written():
        path = write_ring(shared_path, N, end + table("solver", modes=N * n), **contact)
        path.write_text(path.read_text().replace("[model]\n", "[model]\naxis = [0.0, 0.0, 1.0]\n"))
        return path

    with computed(on_root(comm, written), comm) as (_, _, _, of_ring):
        np.testing.assert_allclose(np.sort(np.concatenate(all_waves)), of_ring.omega, rtol=1e-9)


def column(path, name):
    with open(path, newline="") as file:
        return np.array([float(row[name]) for row in csv.DictReader(file)])


@pytest.mark.pictures
def test_campbell_table_has_the_waves_of_a_disc_at_several_speeds(comm, shared_path, program):
    """The difference of backward and forward frequencies is proportional to the speed; the diagrams are drawn."""
    N, out = 6, shared_path / "out"
    end = turning(60.0) + response(1.0) + table("solver", modes=3)
    path = on_root(comm, lambda: write_sector(shared_path, N, end, preload=2e7, friction=0.5))
    status, output, err = program("modes", path, "--speeds", "30,60,120", "--out", out)
    assert (status, err) == (0, "") and "largest residual" in output and "left out" not in output
    assert "nodal diameter 1: modes without Coriolis forces computed from the whole spectrum: none is missing" in output
    comm.barrier()
    with open(out / "campbell.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    of_wave = {(int(row["nodal_diameter"]), row["wave"], float(row["speed_rad_s"])): float(row["family_1_Hz"]) for row in rows}
    assert len(of_wave) == 4 * 2 * 3
    split = [of_wave[1, "backward", speed] - of_wave[1, "forward", speed] for speed in (30.0, 60.0, 120.0)]
    assert split == pytest.approx([0.25 * split[2], 0.5 * split[2], split[2]], rel=1e-2) and abs(split[2]) > 1e-3
    assert of_wave[0, "backward", 60.0] == pytest.approx(of_wave[0, "forward", 60.0], rel=1e-12)
    at_highest = {name: column(out / "modes.csv", f"{name}_frequency_Hz") for name in ("backward", "forward")}
    assert at_highest["forward"][3] == pytest.approx(of_wave[1, "forward", 120.0], rel=1e-8)  # the first of diameter 1
    assert {"campbell.png", "interference.png"} <= {file.name for file in out.iterdir()}


@pytest.mark.parametrize("wave", [None, {"engine_order": 1}, {"engine_order": 1, "whole": True}])
def test_a_forced_response_refuses_coriolis_forces(comm, shared_path, program, wave):
    def write():
        end = turning(60.0) + response(1.0)
        return write_shaft(shared_path, 60.0) if wave is None else write_sector(shared_path, 5, end, wave=wave, preload=2e7)

    path = on_root(comm, write)
    status, _, err = program("run", path, "--out", shared_path / "out")
    assert status == 2 and "only `microslip modes` takes Coriolis forces in" in err and "Traceback" not in err
