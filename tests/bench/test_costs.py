"""The synthetic joint is passive, slips as requested, and its costs add up."""

import json
import subprocess
import sys
from pathlib import Path

import cost_measurement
import costs
import numpy as np
import pytest
from mpi4py import MPI
from synthetic import K_T, frequencies, joint_model, joint_problem

from microslip.continuation.grid import at_frequencies
from microslip.points.selection import AllPairs

COMM = MPI.COMM_SELF


def test_synthetic_joint_is_passive_and_its_compliance_decays_with_distance():
    model = joint_model(COMM, 49, 2)
    G = model.receptance_of(1).static.G_static.transposed(np.arange(49)).T
    assert pytest.approx(G.T, abs=1e-12 * G.max()) == G
    squares = np.linalg.eigvalsh(K_T * G)
    assert 0.0 < squares[0] and squares[-1] < 1.0
    residual = G - (model.receptance_of(1).modes.R_phi / model.omega_n**2) @ model.receptance_of(1).modes.R_phi.T
    assert np.linalg.eigvalsh(residual)[0] > 0.0
    assert abs(residual[0, 3 * 24]) < 1e-3 * residual[0, 3] < 1e-3 * residual[0, 0]


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_the_requested_share_of_pairs_slips(share):
    problem = joint_problem(joint_model(COMM, 40, 2), share, n_samples=64)
    points = at_frequencies(problem, AllPairs(), frequencies(3), tolerance=1e-8).points
    assert [np.count_nonzero(point.state) for point in points] == 3 * [40 * share]


def test_costs_of_the_parts_add_up():
    computed = cost_measurement.of_joint(COMM, n_pairs=20, share=0.5, H=2, points=3)
    assert computed["failure"] is None and computed["not_sticking"] == 10 and computed["points"] == 3
    assert sum(computed["groups"].values()) == pytest.approx(computed["cpu"])
    assert min(computed["groups"].values()) >= -1e-4 * computed["cpu"]
    assert computed["calls"]["G p"] >= computed["krylov"] >= computed["newton"] > 1


def test_a_measurement_runs_as_a_command():
    script = Path(costs.__file__).with_name("cost_measurement.py")
    request = {"kind": "joint", "n_pairs": 8, "share": 0.5, "H": 1, "points": 2}
    process = subprocess.run([sys.executable, str(script), json.dumps(request)], stdout=subprocess.PIPE, text=True, check=True)
    assert json.loads(process.stdout)["ranks"] == 1
