"""Memory of the rest of a joint grows with the pairs that open or slip, not with the square of all pairs."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from microslip.statics import equilibrium

N_PAIRS = 20_000  # the dense flexibility of all pairs has 29 GB
ACTIVE = np.arange(7, N_PAIRS, N_PAIRS // 24)  # 24 or 25 pairs


def columns_of(pairs, rows):
    """Return columns of a flexibility that decays with the distance of the pairs, (3 n_rows, 3 m)."""
    near = np.exp(-np.abs(rows[:, None] - pairs) / 2000.0)
    return np.kron(near, np.diag([2.0, 1.5, 1.0]) + 0.1)


@pytest.fixture
def flexibility(comm, monkeypatch):
    system = SimpleNamespace(comm=comm, R=sp.csr_matrix((3 * N_PAIRS, 9)))
    G = equilibrium.Flexibility(SimpleNamespace(system=system))
    pairs_owned = np.arange(N_PAIRS)[G.owned]

    def solved(linearised, left, right, row_ranges):
        assert right.shape[1] <= 3 * len(ACTIVE)
        return columns_of(ACTIVE, pairs_owned)

    monkeypatch.setattr(equilibrium, "static_columns", solved)
    return G


def test_the_flexibility_is_computed_and_stored_only_for_active_pairs(comm, flexibility):
    L = np.random.default_rng(0).standard_normal((len(ACTIVE), 3, 3))
    p = np.random.default_rng(1).standard_normal((len(ACTIVE), 3))
    tracemalloc.start()
    try:
        is_active = np.zeros(N_PAIRS, dtype=bool)
        is_active[ACTIVE] = True
        flexibility.require(is_active)
        du = flexibility.apply(ACTIVE, p)
        J = flexibility.newton_matrix(ACTIVE, L, None)
        stored, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    columns = 72.0 * len(ACTIVE) * (flexibility.owned.stop - flexibility.owned.start)  # bytes
    assert stored < 1.2 * columns + 5e6
    assert peak < 4.0 * columns + 5e6
    assert np.array_equal(np.flatnonzero(flexibility.known), ACTIVE)

    np.testing.assert_allclose(du.ravel(), columns_of(ACTIVE, np.arange(N_PAIRS)) @ p.ravel(), rtol=1e-10, atol=1e-12)
    if comm.rank > 0:
        assert J is None
        return
    G = columns_of(ACTIVE, ACTIVE)
    expected = np.eye(len(G)) + G @ sp.block_diag(list(L)).toarray()
    np.testing.assert_allclose(J, expected, rtol=1e-10, atol=1e-12)
