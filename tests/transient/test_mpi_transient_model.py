"""The model for time integration: equal on any number of ranks, computed by blocks, and rejected if memory is short."""

import numpy as np
import pytest
from dense_model import reduced
from mpi4py import MPI
from oracles import scenes

from microslip.guards import memory
from microslip.messages.errors import ResourceError
from microslip.system.memory import Limit
from microslip.transient import march, transient_model
from microslip.transient.march import March
from microslip.transient.scheme import Motion

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD


def period_of(model):
    """Return contact forces of a period, (n_steps, 2, 3 n_pairs), in which pairs slip."""
    zero = np.zeros((2, len(model.modes.omega_n)))
    contact = np.zeros((2, model.n_pairs * (3 + model.law.n_memory)))
    return March(model, np.array([500.0, 560.0]), np.full(2, 100.0), 32).period(Motion(zero, zero, zero), contact)[2].p


@pytest.mark.parametrize("n_rows", [1, 4, 512])
def test_g_is_the_static_flexibility_without_the_modes(monkeypatch, n_rows):
    system = scenes.chain()
    monkeypatch.setattr(transient_model, "_BLOCK", n_rows)
    model = transient_model.transient_model(*reduced(system, COMM, 3, 2))
    whole = np.linalg.inv(system["K"] + system["R"].T @ (model.law.springs.ravel()[:, None] * system["R"]))
    expected = system["R"] @ whole @ system["R"].T - model.modes.R_phi @ np.diag(model.modes.omega_n**-2.0) @ model.modes.R_phi.T
    assert expected == pytest.approx(model.G, abs=1e-12 * np.abs(expected).max())


def test_a_march_by_blocks_of_rows_is_the_same(monkeypatch):
    model = transient_model.transient_model(*reduced(scenes.chain(), COMM, 3, 2))
    expected = period_of(model)
    monkeypatch.setattr(march, "_BLOCK", 2)
    assert np.count_nonzero(expected.any(axis=(0, 1))) > 2
    assert period_of(model) == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def test_a_model_beyond_the_memory_is_rejected_before_any_solve(monkeypatch):
    model, law = reduced(scenes.chain(), COMM, 3)
    monkeypatch.setattr(transient_model, "_CHECKED_FROM", 0.0)
    needed, left = 72.0 * model.n_pairs**2 * (2 if COMM.size == 1 else 4), 0.0
    monkeypatch.setattr(memory, "limits_here", lambda machine, process, resident: [Limit("the test", machine, left)])
    left = needed - 1.0
    with pytest.raises(ResourceError, match=f"between all {model.n_pairs} pairs: not enough memory.* need"):
        transient_model.transient_model(model, law)
    assert not model.receptance_of(0).static.G_static.known.any()
    left = needed
    assert transient_model.transient_model(model, law).n_pairs == model.n_pairs
