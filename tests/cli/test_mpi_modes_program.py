"""`microslip modes`: frequencies, effective masses and shares of the joints against independent numbers, on any number of ranks."""

import csv

import numpy as np
import pytest
from bar_scene import N_DOF, write_bar
from matrix_scenes import write_matrix_scene
from oracles import scenes
from scipy.linalg import eigh

from microslip.library.build import build
from microslip.modes.lapack import gathered
from microslip.parallel.agree import on_root
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)


def column(folder, name):
    with open(folder / "modes.csv", newline="") as file:
        return np.array([float(row[name]) for row in csv.DictReader(file)])


@pytest.fixture
def bar(comm, shared_path, program):
    """Return what to call with a folder's name and more of the command: the folder with the results.  Collective."""
    path = on_root(comm, write_bar, shared_path)

    def run(name, *more):
        status, out, err = program("modes", path, "--out", shared_path / name, *more)
        assert (status, err) == (0, "")
        return shared_path / name, out

    return run


@pytest.mark.ranks(1, 2, 3)
def test_all_modes_together_have_the_mass_that_moves_and_the_stuck_frequencies(bar, comm, shared_path):
    folder, out = bar("all", "--count", N_DOF)
    assert "none is missing" in out
    for axis in "xyz":
        assert column(folder, f"effective_mass_{axis}_percent").sum() == pytest.approx(100.0, rel=1e-9)
    structure = build(read_scene(shared_path / "bar.toml"), comm)
    omega_n = np.sqrt(eigh(*(comm.bcast(gathered(A)) for A in (structure.K_L, structure.M)), eigvals_only=True))
    assert column(folder, "frequency_Hz") == pytest.approx(omega_n / (2 * np.pi), rel=1e-8)
    structure.close()


def test_the_share_of_a_joint_is_how_its_stiffness_moves_the_frequency(bar):
    share = column(bar("as_is")[0], "joint_joint_energy_percent") / 100.0
    assert len(share) == 12
    h = 2e-3
    softer, stiffer = (
        column(
            bar(
                name,
                "--set",
                f"joints.joint.tangential_stiffness={1e12 * f}",
                "--set",
                f"joints.joint.normal_stiffness={2e12 * f}",
            )[0],
            "frequency_Hz",
        )
        for name, f in (("softer", 1.0 - h), ("stiffer", 1.0 + h))
    )
    assert share == pytest.approx(np.log(stiffer**2 / softer**2) / np.log((1.0 + h) / (1.0 - h)), rel=1e-4, abs=1e-6)
    assert share.max() > 0.1


@pytest.mark.pictures
def test_a_mesh_gets_shapes_and_a_picture(bar):
    folder, out = bar("drawn", "--count", 3)
    assert {"modes.csv", "modes.log", "modes.png", "modes.vtkhdf"} == {file.name for file in folder.iterdir()}
    assert "none is missing" in out


def test_matrices_have_frequencies_alone(comm, shared_path, program):
    path = on_root(comm, write_matrix_scene, shared_path, scenes.spatial_mass(), [0.02], (1.0, 1.6))
    status, out, err = program("modes", path, "--out", shared_path / "out")
    assert (status, err) == (0, "") and "mass x" not in out
    assert not (shared_path / "out" / "modes.png").exists()
    assert len(column(shared_path / "out", "frequency_Hz")) > 0


def test_more_modes_than_degrees_of_freedom_are_refused(comm, shared_path, program):
    path = on_root(comm, write_bar, shared_path)
    status, _, err = program("modes", path, "--out", shared_path / "out", "--count", N_DOF + 1)
    assert status == 2 and f"modes = {N_DOF + 1}" in err and str(N_DOF) in err
