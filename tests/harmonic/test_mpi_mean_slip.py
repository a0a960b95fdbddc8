"""The share of the joint in the stiffness that holds a body: by products with distributed rows and by the whole matrix."""

import numpy as np
import pytest
from dense_model import reduced
from mpi4py import MPI
from oracles import scenes
from scipy.sparse.linalg import ArpackNoConvergence

from microslip.harmonic import mean_slip

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM = MPI.COMM_WORLD


def block(n_pairs=12, k=0.3):
    """A body of many masses on springs and on pairs of different stiffness."""
    rng = np.random.default_rng(5)
    n, A = 3 * n_pairs, rng.standard_normal((3 * n_pairs, 3 * n_pairs))
    return scenes.make_system(
        "block",
        np.eye(n),
        A @ A.T / n + k * np.eye(n),
        [[*range(3 * i, 3 * i + 3), -1, -1, -1] for i in range(n_pairs)],
        mu=0.3,
        N0=1.0,
        k_t=rng.uniform(0.5, 3.0, n_pairs),
        k_n=rng.uniform(0.5, 3.0, n_pairs),
        zeta=0.02,
        loads=[{"vector": np.ones(n), "harmonic": 1, "phase": 0.0}],
        output=np.eye(n)[0],
        omega=(0.5, 2.0),
        levels={},
    )


@pytest.mark.parametrize("way", ["products", "products that do not converge", "all of it"])
def test_the_largest_share_is_that_of_the_whole_matrix(monkeypatch, way):
    system = block()
    model, law = reduced(system, COMM, 1)
    k = np.stack([system["k_t"], system["k_t"], system["k_n"]], axis=1).ravel()
    G = system["R"] @ np.linalg.inv(system["K"] + system["R"].T @ (k[:, None] * system["R"])) @ system["R"].T
    rows = np.flatnonzero(np.arange(len(G)) % 3 < 2)
    expected = np.linalg.eigvalsh(np.sqrt(k[rows, None]) * G[np.ix_(rows, rows)] * np.sqrt(k[rows]))[-1]

    def ends_early(*_, **__):
        raise ArpackNoConvergence("no", np.zeros(0), np.zeros((0, 0)))

    monkeypatch.setattr(mean_slip, "_FEW", 200 if way == "all of it" else 0)
    if way == "products that do not converge":
        monkeypatch.setattr(mean_slip.sla, "eigsh", ends_early)
    assert 0.1 < expected < 0.999
    assert mean_slip._largest_share(model, law.take(np.arange(model.n_pairs)[model.owned])) == pytest.approx(expected, rel=1e-9)
