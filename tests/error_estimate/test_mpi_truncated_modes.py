"""The part of the truncated modes compared with their true effect, under every kind of damping: a chain whose one pair sticks."""

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles.scenes import make_system

import microslip

N = 36
AT = (0.1, 0.2)  # rad/s, about the first modes


def chain(damping):
    """Return masses in a line, each with three directions coupled by springs; a sticking pair holds the last one."""
    rng = np.random.default_rng(3)
    A = rng.standard_normal((N, N))
    links = np.diag(np.full(N, 2.2)) - np.diag(np.ones(N - 3), 3) - np.diag(np.ones(N - 3), -3)
    K, M = links + 0.002 * A @ A.T, np.diag(rng.uniform(0.5, 2.0, N))
    M[3, 3] = 0.01  # the truncated modes that the load excites have much higher frequencies
    load = np.zeros(N)
    load[3] = 1.0
    return make_system(
        "chain",
        M,
        K,
        [[N - 3, N - 2, N - 1, -1, -1, -1]],
        mu=[1.0],
        N0=[1e6],
        k_t=[0.5],
        k_n=[0.8],
        loads=[{"vector": load, "harmonic": 1}],
        output=load,
        omega=AT,
        levels={},
        **damping(K, M),
    )


DAMPINGS = {
    "stiffness": lambda K, M: {"rayleigh": [0.0, 0.08]},
    "mass": lambda K, M: {"rayleigh": [0.1, 0.0]},
    "ratio": lambda K, M: {"zeta": 0.1},
    "matrix": lambda K, M: {"C": 0.02 * M + 0.02 * K},
}


@pytest.mark.parametrize("name", list(DAMPINGS))
def test_the_error_bar_estimates_the_effect_of_truncated_modes(name, comm, shared_path):
    path = shared_path / "scene.toml"
    if comm.rank == 0:
        write_matrix_scene(shared_path, chain(DAMPINGS[name]), [1.0], (0.08, 0.22), at=AT, outputs=[0, 3, 10], points=6, modes=4)
    comm.barrier()
    scene = microslip.read(path)
    values = []
    for changed in ({}, {"modes": N}):
        with microslip.build(scene.model_copy(update={"solver": scene.solver.model_copy(update=changed)}), comm) as structure:
            values.append(microslip.respond(structure))
    few, every = values
    for k, output in enumerate(few.outputs):
        for hertz in np.array(AT) / (2.0 * np.pi):
            i, j = (int(np.argmin(np.abs(of[output].frequency[0] - hertz))) for of in values)
            error = abs(few[output].harmonic(1)[0][i] - every[output].harmonic(1)[0][j])
            parts = few.array("error")[0][i][k].sum()
            assert 0.5 <= error / parts <= 1.5
