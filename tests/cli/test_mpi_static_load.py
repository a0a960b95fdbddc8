"""A static load above the friction limit, from the scene to the message."""

import csv

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.parallel.agree import on_root


def sliders(n_pairs):
    """Return bodies held in x only by a friction pair each; the first body is pushed."""
    K = np.diag([0.0, 1.0, 1.0] * n_pairs)
    pairs = [[3 * i, 3 * i + 1, 3 * i + 2, -1, -1, -1] for i in range(n_pairs)]
    first = np.eye(len(K))[0]
    load = {"vector": first, "harmonic": 0, "phase": 0.0}
    joint = {"mu": 0.4, "N0": 1.0, "k_t": 1.5, "k_n": 2.0, "zeta": 0.01}
    return scenes.make_system(
        "sliders", np.eye(len(K)), K, pairs, **joint, loads=[load], output=first, omega=(0.5, 2.0), levels={}
    )


@pytest.mark.ranks(1, 2)
@pytest.mark.filterwarnings("error::RuntimeWarning", "error::UserWarning")
@pytest.mark.parametrize("n_pairs", [1, 2])
def test_a_static_load_above_the_friction_limit_is_reported(comm, shared_path, program, n_pairs):
    def write():
        return write_matrix_scene(shared_path, sliders(n_pairs), [0.3, 5.0], (0.5, 2.0), outputs=[0], points=4, harmonics=0)

    status, _, err = program("run", on_root(comm, write), "--out", shared_path / "out")
    assert status == 3 and "no equilibrium under the static load of 5 N" in err and "Traceback" not in err
    with open(shared_path / "out" / "frf.csv", newline="", encoding="utf-8") as table:
        assert [float(row["mean_m"]) for row in csv.DictReader(table)] == pytest.approx([0.2])  # 0.3 N on 1.5 N/m
