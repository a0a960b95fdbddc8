"""Static columns against dense inverses of small lattices."""

from dataclasses import replace

import lattices
import numpy as np
import pytest
import scipy.sparse as sp
from mpi4py import MPI

from microslip.linear.factor import Factor
from microslip.linear.joint_springs import joint_stiffness, linearise
from microslip.modes import constraint
from microslip.modes.constraint import RowSums, static_columns
from microslip.parallel.ownership import split_evenly
from microslip.reduction.stuck import static_response

comm = MPI.COMM_WORLD
SHAPE = (6, 3, 2)


@pytest.fixture(params=[None, 1], ids=["all", "rank 1 empty"])
def joined(request):
    system, pairs = lattices.lattice(comm, SHAPE, empty_rank=request.param, k_t=3.0e5)
    linearised = linearise(system, pairs)
    yield linearised, pairs
    linearised.destroy()


def inverse(system, pairs):
    K = lattices.lattice_stiffness(SHAPE, cut=SHAPE[0] // 2)
    return np.linalg.inv((K + system.R.T @ sp.diags(joint_stiffness(pairs)) @ system.R).toarray())


@pytest.mark.parametrize("batch", [None, 1, 5])
def test_static_columns_equal_the_dense_flexibility(joined, batch, monkeypatch):
    linearised, pairs = joined
    system = linearised.system
    monkeypatch.setattr(constraint, "_BATCH", batch or constraint._BATCH)
    monkeypatch.setattr(constraint, "_FEWEST", min(batch or constraint._FEWEST, constraint._FEWEST))
    exact = system.R @ inverse(system, pairs) @ system.R.T
    columns = static_columns(linearised, system.R, system.R.T.tocsc())
    np.testing.assert_allclose(columns, exact, atol=1e-13 * abs(exact).max())
    ranges = np.array([0] + [len(exact)] * comm.size)  # all rows on rank 0
    columns = static_columns(linearised, system.R, system.R.T.tocsc(), row_ranges=ranges)
    np.testing.assert_allclose(columns, exact[ranges[comm.rank] : ranges[comm.rank + 1]], atol=1e-13 * abs(exact).max())


@pytest.mark.parametrize("m_left, m_right", [(0, 3), (3, 0), (0, 0), (2, 7), (7, 2)])
def test_solves_are_those_of_the_smaller_side(joined, m_left, m_right):
    """The number of solves is that of the nonzero columns of the smaller side."""
    linearised, pairs = joined
    n_dof = linearised.system.n_dof
    left = sp.random(m_left, n_dof, 0.1, format="csr", random_state=1)
    right = sp.random(n_dof, m_right, 0.1, format="csc", random_state=2)
    exact = left @ inverse(linearised.system, pairs) @ right
    before = linearised.factor.info["solves"]
    columns = static_columns(linearised, left, right)
    assert columns.shape == (m_left, m_right)
    np.testing.assert_allclose(columns, exact, atol=1e-13 * abs(exact).max(initial=0.0))
    assert linearised.factor.info["solves"] - before == min(m_left, m_right)
    ranges = np.arange(comm.size + 1) * m_left // comm.size
    columns_owned = static_columns(linearised, left, right, row_ranges=ranges)
    np.testing.assert_allclose(columns_owned, columns[ranges[comm.rank] : ranges[comm.rank + 1]], rtol=1e-12)


def test_zero_columns_need_no_solve(joined):
    linearised, _ = joined
    right = sp.csc_matrix(([2.0], ([4], [3])), shape=(linearised.system.n_dof, 6))
    before = linearised.factor.info["solves"]
    columns = static_columns(linearised, linearised.system.R, right)
    assert linearised.factor.info["solves"] == before + 1
    assert np.count_nonzero(columns.any(axis=0)) == 1 and columns[:, 3].any()


@pytest.fixture
def requested(monkeypatch):
    """Use entries of the inverse for a small structure; return the list of the number of columns of each call."""
    monkeypatch.setattr(constraint, "_FEW", 0)
    monkeypatch.setattr(constraint, "_MOST_ROWS", 1.0)
    numbers, entries = [], Factor.inverse_entries
    monkeypatch.setattr(Factor, "inverse_entries", lambda *args: (numbers.append(len(args[2])), entries(*args))[1])
    return numbers


@pytest.mark.parametrize("bytes_of_batch", [None, 2000.0])
def test_columns_from_entries_of_the_inverse_are_exact(joined, requested, monkeypatch, bytes_of_batch):
    linearised, pairs = joined
    system = linearised.system
    R, J = system.R, np.unique(system.R.indices)
    if bytes_of_batch:
        monkeypatch.setattr(constraint, "_BATCH_BYTES", bytes_of_batch)
    exact = R @ inverse(system, pairs) @ R.T
    before = linearised.factor.info["solves"]
    columns = static_columns(linearised, R, R.T.tocsc())
    assert requested == ([6] * 6 if bytes_of_batch else [len(J)])  # 2,000 bytes are 6 columns of 36 rows
    assert linearised.factor.info["solves"] == before + 1  # the check
    np.testing.assert_allclose(columns, exact, atol=1e-13 * abs(exact).max())
    ranges = np.array([0] + [len(exact)] * comm.size)
    some = R.T.tocsc()[:, [3, 4, 5, 12, 13, 14]]
    columns = static_columns(linearised, R, some, row_ranges=ranges)
    columns_owned = exact[ranges[comm.rank] : ranges[comm.rank + 1]]
    np.testing.assert_allclose(columns, columns_owned[:, [3, 4, 5, 12, 13, 14]], atol=1e-13 * abs(exact).max())


def test_wrong_and_refused_entries_are_replaced_by_solves(joined, requested, monkeypatch):
    linearised, pairs = joined
    R, inverse_entries = linearised.system.R, Factor.inverse_entries

    def wrong(*args):
        entries = inverse_entries(*args)
        if entries.size:
            entries[:, 7] *= 1.0 + 1e-5
        return entries

    exact = R @ inverse(linearised.system, pairs) @ R.T
    for answer, n_checks in ((wrong, 1), (lambda *args: None, 0)):
        monkeypatch.setattr(Factor, "inverse_entries", answer)
        before = linearised.factor.info["solves"]
        columns = static_columns(linearised, R, R.T.tocsc())
        assert linearised.factor.info["solves"] == before + n_checks + len(exact)
        np.testing.assert_allclose(columns, exact, atol=1e-13 * abs(exact).max())


def test_sums_of_rows_replace_the_check_by_a_solve(joined, requested, monkeypatch):
    """Correct sums need no solve, wrong sums a solve that confirms the entries; wrong entries disagree with correct sums."""
    linearised, pairs = joined
    R, inverse_entries, some = linearised.system.R, Factor.inverse_entries, np.array([3, 4, 5, 12, 13, 14])
    exact = R @ inverse(linearised.system, pairs) @ R.T
    signs = np.random.default_rng(1).choice([-1.0, 1.0], len(exact))
    sums = RowSums(signs, static_columns(linearised, R, sp.csc_matrix(R.T @ signs).T)[:, 0])

    def checks(known):
        before = linearised.factor.info["solves"]
        columns = static_columns(linearised, R, R.T.tocsc()[:, some], known=known)
        np.testing.assert_allclose(columns, exact[:, some], atol=1e-13 * abs(exact).max())
        return linearised.factor.info["solves"] - before

    assert checks(sums.of(some)) == 0
    assert checks(replace(sums, sums=sums.sums * (1.0 + 1e-5)).of(some)) == 1

    def wrong(*args):
        entries = inverse_entries(*args)
        if entries.size:
            entries[7] *= 1.0 + 1e-5
        return entries

    monkeypatch.setattr(Factor, "inverse_entries", wrong)
    assert checks(sums.of(some)) == 1 + len(some)  # the check, and solves that replace the entries


def test_columns_of_pairs_are_checked_by_one_solve_in_advance(joined, requested):
    linearised, pairs = joined
    G, system = static_response(linearised).G_static, linearised.system
    before = linearised.factor.info["solves"]
    for part in np.array_split(np.arange(pairs.n_pairs), 3):
        G.put(part, G.solve(part))
    assert linearised.factor.info["solves"] == before and len(requested) == 3
    exact = system.R @ inverse(system, pairs) @ system.R.T
    columns = G.transposed(np.arange(pairs.n_pairs)).T
    rows = split_evenly(pairs.n_pairs, comm.size)[comm.rank :][:2] * 3
    np.testing.assert_allclose(columns, exact[slice(*rows)], atol=1e-13 * abs(exact).max())


def test_columns_of_many_forces_are_solved(joined, requested):
    linearised, _ = joined
    right = sp.random(linearised.system.n_dof, 5, 0.5, format="csc", random_state=3)
    static_columns(linearised, linearised.system.R, right)
    assert requested == []
