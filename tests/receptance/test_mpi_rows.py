"""Products with rows at any address, compared with dense products; static columns computed in batches of limited size."""

import numpy as np
import pytest

from microslip.parallel.ownership import rows_of
from microslip.receptance import static_columns
from microslip.receptance.rows import Rows
from microslip.receptance.static_columns import StaticColumns

pytestmark = pytest.mark.ranks(1, 2, 3)


@pytest.mark.parametrize("precision", [np.float64, np.float32])
@pytest.mark.parametrize("m, n", [(1, 1), (7, 5), (8, 256), (19, 1030), (0, 4), (4, 0)])
@pytest.mark.parametrize("N", [1, 7])
def test_products_equal_dense_products(m, n, N, precision):
    rng, near = np.random.default_rng(m + n), 1e-12 if precision is np.float64 else 1e-4
    A = rng.standard_normal((m, n)).astype(precision)
    p, x = rng.standard_normal((m, N)), rng.standard_normal((n, N))
    assert Rows.of(A).combined(p) == pytest.approx(p.T @ A, abs=near) and Rows.of(A).combined(p).dtype == precision
    assert Rows.of(A).times(x) == pytest.approx(A @ x, abs=near) and Rows.of(A).times(x).dtype == precision


def test_selected_rows_of_several_arrays_are_used_without_a_copy():
    rng, pairs = np.random.default_rng(1), np.array([3, 0, 4])
    G, n_solved = rng.standard_normal((15, 15)), []
    columns = StaticColumns(5, 5, lambda of: n_solved.append(len(of)) or G[:, rows_of(of)])
    columns.require(np.array([4, 1]))
    computed = columns.chosen(pairs)
    assert n_solved == [2, 2] and columns.chosen(pairs.copy()) is computed
    x, rows = rng.standard_normal((15, 3)), rows_of(pairs)
    assert computed.combined(x[:9]) == pytest.approx(x[:9].T @ G[:, rows].T, abs=1e-13)
    assert computed.times(x) == pytest.approx(G[:, rows].T @ x, abs=1e-13)
    assert computed.largest == np.abs(G[:, rows]).max()
    assert np.array_equal(columns.transposed(pairs), G[:, rows].T)
    single = np.empty((2, 2), dtype=np.float32)
    computed.part(np.array([8, 0])).write_columns(np.array([1, 7]), 2.0, single)
    assert np.array_equal(single, (G[np.ix_([1, 7], rows[[8, 0]])].T / 2.0).astype(np.float32))
    columns._blocks[0][:] = 0.0  # the rows of pair 4: the products use them without a copy
    assert not computed.times(x)[6:].any() and computed.times(x)[:6].all()


def test_many_columns_are_solved_in_batches(monkeypatch):
    monkeypatch.setattr(static_columns, "_PART_BYTES", 72 * 60 * 25)
    G, solved, notified = np.random.default_rng(2).standard_normal((180, 180)), [], []
    columns = StaticColumns(60, 60, lambda of: solved.append(len(of)) or G[:, rows_of(of)])
    columns.subscribe(lambda pairs: notified.append((pairs.copy(), columns.known[pairs].all())))
    columns.require(np.arange(60))
    assert solved == [25, 25, 10] and columns.batches == 1
    assert np.array_equal(np.concatenate([pairs for pairs, _ in notified]), np.arange(60)) and all(known for _, known in notified)
    assert np.array_equal(columns.transposed(np.arange(60)), G.T)


def test_a_pass_solves_expected_columns_up_to_the_stated_number():
    solved = []
    columns = StaticColumns(12, 12, lambda of: solved.append(len(of)) or np.zeros((36, 3 * len(of))), 5)
    columns.expect(np.arange(12))
    columns.require(np.array([7, 3]))
    assert solved == [5] and np.array_equal(np.flatnonzero(columns.known), [0, 1, 2, 3, 7])


def test_each_later_pass_solves_as_many_columns_as_are_known(monkeypatch):
    """A joint of 60 pairs that begin to slip one at a time needs 7 passes, not 30; no pass is larger than memory allows."""
    monkeypatch.setattr(static_columns, "_PART_BYTES", 72 * 60 * 20)
    solved = []
    columns = StaticColumns(60, 60, lambda of: solved.append(len(of)) or np.zeros((180, 3 * len(of))), 2)
    columns.expect(np.arange(60))
    for pair in range(60):
        columns.require(np.array([pair]))
    assert solved == [2, 2, 4, 8, 16, 20, 8] and columns.batches == 7


def test_passes_do_not_grow_where_columns_are_products():
    solved = []
    columns = StaticColumns(60, 60, lambda of: solved.append(len(of)) or np.zeros((180, 3 * len(of))), 2, grows=False)
    columns.expect(np.arange(60))
    for pair in range(0, 20, 2):
        columns.require(np.array([pair]))
    assert solved == [2] * 10 and columns.known.sum() == 20


def test_columns_of_the_wrong_shape_are_rejected():
    """Products read the rows by address, and would read past their end."""
    columns = StaticColumns(5, 4, lambda of: np.zeros((9, 3 * len(of))))
    with pytest.raises(ValueError, match=r"columns of 2 pairs in 4 rows of pairs have the shape \(9, 6\)"):
        columns.require(np.array([0, 3]))
    with pytest.raises(ValueError, match="have the shape"):
        columns.put(np.array([1]), np.zeros((12, 2)))
    assert not columns.known.any() and not columns.stored.any()
