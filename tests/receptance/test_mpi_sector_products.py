"""Products with the receptance of a whole disc by transforms over its sectors, compared with columns; on any number of ranks."""

from dataclasses import replace

import numpy as np
import pytest
from discs import write_sector
from mpi4py import MPI

from microslip.library.build import build
from microslip.library.prepare import prepare
from microslip.parallel.agree import on_root
from microslip.receptance import columns
from microslip.receptance.columns import ActiveColumns, GroupColumns, ReceptanceColumns, SectorColumns
from microslip.receptance.damping import Damping
from microslip.receptance.other_springs import with_springs
from microslip.receptance.springs import SpringChange
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM = MPI.COMM_WORLD
DISC = """[damping]
ratio = 0.01
[response]
levels = [1.0]
frequencies = [1400.0, 1450.0]
points = 8
[solver]
modes = 6
harmonics = 3
"""


@pytest.fixture(
    scope="module", params=[(4, True), (5, True), (5, False), (3, True)], ids=["even", "odd", "alike", "two diameters"]
)
def disc(request, tmp_path_factory):
    """Return the model of a disc with an even or odd number of sectors, with different or equal blades.

    With two diameters, one of three ranks has no diameter.
    """
    (N, differ), tables = request.param, DISC
    wave = {"engine_order": 1, "whole": True}
    if differ:
        tables += "".join(f"[[cyclic.sector]]\nnumber = {s}\nstiffness = {1.0 + 0.01 * s}\n" for s in range(N))
        wave["blades"] = ["blade"]
    folder = COMM.bcast(tmp_path_factory.mktemp("disc"))
    structure = build(read_scene(on_root(COMM, lambda: write_sector(folder, N, tables, wave=wave, friction=0.05))), COMM)
    yield prepare(structure).model
    structure.close()


def both(model, monkeypatch, active):
    """Return the columns of some pairs by transforms over the sectors, and as dense columns."""
    monkeypatch.setattr(columns, "_n_products", lambda *counts: 10**9)
    by_sectors = ReceptanceColumns(model, 9000.0, active)
    assert isinstance(by_sectors.groups[0], SectorColumns)
    monkeypatch.setattr(columns, "_n_products", lambda *counts: 0)
    return by_sectors, ReceptanceColumns(model, 9000.0, active)


def assert_close(a, b, accuracy=1e-12):
    largest = COMM.allreduce(np.abs(b).max(initial=0.0), op=MPI.MAX)
    assert largest > 0.0
    np.testing.assert_allclose(a, b, rtol=0.0, atol=accuracy * largest)


def test_blocks_of_few_pairs_need_no_static_columns(disc, request):
    few, G_static = np.arange(0, disc.n_pairs, 5), disc.receptance_of(1).static.G_static
    by_sectors = ReceptanceColumns(disc, 9000.0, few, for_blocks=True)
    known = G_static.known.copy()
    assert not known.all() or request.node.callspec.id == "alike"  # no earlier test computed those of this disc
    block = by_sectors.matrix()
    np.testing.assert_array_equal(G_static.known, known)
    assert_close(block, ReceptanceColumns(disc, 9000.0, few).matrix())


def test_products_by_transforms_equal_products_with_columns(disc, monkeypatch):
    random = np.random.default_rng(1)
    active = np.sort(random.permutation(disc.n_pairs)[: disc.n_pairs // 2])
    by_sectors, dense = both(disc, monkeypatch, active)
    p = random.standard_normal((3 * len(active), disc.N_H))
    x = np.random.default_rng(COMM.rank).standard_normal((disc.owned.stop - disc.owned.start, 3, disc.N_H))
    assert_close(by_sectors.apply(p), dense.apply(p))
    assert_close(by_sectors.apply_rate(p), dense.apply_rate(p))
    assert_close(by_sectors.apply_rate(p, 0.0, 2.0), dense.apply_rate(p, 0.0, 2.0))
    d_C = random.standard_normal((disc.n_modes, disc.n_modes))
    rates = [Damping(d_C + d_C.T)]
    assert_close(by_sectors.apply_rate(p, d_C=rates), dense.apply_rate(p, d_C=rates))  # a rate of damping that couples modes
    assert_close(COMM.allreduce(by_sectors.apply_transposed(x)), COMM.allreduce(dense.apply_transposed(x)))
    assert_close(by_sectors.adjoint().apply(p), dense.adjoint().apply(p))
    chosen = np.arange(0, len(active), 3)
    for block, of_dense in zip(by_sectors.blocks(chosen), dense.blocks(chosen)):
        assert_close(block, of_dense)
    assert "G_static" not in vars(by_sectors.groups[0])  # no dense column is used


@pytest.mark.parametrize(("precision", "accuracy"), [(np.float64, 1e-12), (np.float32, 1e-5)])
def test_products_of_active_pairs_agree_in_both_precisions(disc, monkeypatch, precision, accuracy):
    random = np.random.default_rng(2)
    active = np.sort(random.permutation(disc.n_pairs)[: disc.n_pairs // 2])
    by_sectors, dense = both(disc, monkeypatch, active)
    monkeypatch.setattr(columns, "_n_products", lambda *counts: 10**9)
    for adjoint in (False, True):
        a, b = (ActiveColumns(G.adjoint() if adjoint else G, precision) for G in (by_sectors, dense))
        assert isinstance(a._parts[0], columns._SectorsGroup)
        p = random.standard_normal((2, 3 * len(active), disc.N_H))
        assert_close(a.unit * a.apply(p[0]), b.unit * b.apply(p[0]), accuracy)
        assert_close(a.unit * a.apply_to_several(p), b.unit * b.apply_to_several(p), accuracy)


def test_linear_motions_equal_those_of_the_columns(disc):
    at = disc.flexibilities(9000.0)[0], disc.owned_rows
    receptance = disc.groups[0].receptance
    dense = replace(receptance, sectors=None)
    assert_close(receptance.linear_motion(disc.f, *at), dense.linear_motion(disc.f, *at))
    assert_close(receptance.linear_motion_rate(disc.f, *at), dense.linear_motion_rate(disc.f, *at))
    assert not receptance.linear_motion_rate(0.0 * disc.f, *at).any()


def test_few_pairs_and_changed_springs_use_dense_products(disc):
    every = np.arange(disc.n_pairs)
    assert type(ReceptanceColumns(disc, 9000.0, every[:1]).groups[0]) is GroupColumns
    K_J = np.full(3 * disc.n_pairs, 1e9)
    other = with_springs(disc, SpringChange(np.where(np.arange(len(K_J)) < 3, 1e6, 0.0), K_J, disc.stated_damping))
    assert type(ReceptanceColumns(other, 9000.0, every).groups[0]) is GroupColumns
