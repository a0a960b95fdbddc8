"""A structure supported at a hundred-thousandth of its elastic frequencies has the response of the dense sum over its modes."""

import numpy as np
import pytest
import scipy.linalg
from lattices import softly_held_truss
from matrix_scenes import branches_of, requested, write_matrix_scene
from mpi4py import MPI
from oracles.scenes import joint_stiffness

from microslip.fourier.amplitudes import to_complex
from microslip.parallel.agree import on_root

comm = MPI.COMM_WORLD
ELASTIC = 2236.0  # rad/s, the lowest elastic mode of the truss


@pytest.mark.parametrize("held", [1e-2, 1e-5])
def test_the_response_of_a_softly_held_truss(tmp_path, held):
    """All pairs stick.  At 1e-5 the static solution is 1e10 times the part without its rigid-body motion."""
    omega, zeta = ELASTIC * np.array([0.9, 0.97, 1.03]), 0.01
    load, output, free, soft, system = softly_held_truss(held, ELASTIC, omega, zeta=zeta)
    R = system["R"]
    values, phi = scipy.linalg.eigh(free.toarray() + R.T @ (joint_stiffness(system)[:, None] * R))
    omega_n = np.sqrt(np.where(values > 1.0, values, 0.0) + soft)
    dynamic = omega_n**2 - omega[:, None] ** 2 + 2j * zeta * omega_n * omega[:, None]
    exact = (phi.T @ load * (output @ phi) / dynamic).sum(axis=1)
    folder = comm.bcast(tmp_path)
    options = {"at": omega, "outputs": [31], "harmonics": 1, "samples": 32, "modes": 12, "error_bars": False}
    path = on_root(comm, lambda: write_matrix_scene(folder, system, [1.0], system["omega"], **options))
    (branch,) = branches_of(path, comm)
    solved = np.array([to_complex(point.response)[0, 1] for point in requested(branch)])
    np.testing.assert_allclose(solved, exact, rtol=2e-3)
