"""Memory and fields of a disc whose blades differ; on any number of ranks."""

import numpy as np
import pytest
from discs import write_sector
from mpi4py import MPI

from microslip.library.build import build
from microslip.library.prepare import prepare
from microslip.linear import sector_factor
from microslip.parallel.agree import on_root
from microslip.receptance.columns import ReceptanceColumns
from microslip.receptance.motions import ActingForces
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM = MPI.COMM_WORLD
N = 4
TABLES = """[damping]
ratio = 0.01
[response]
levels = [1.0]
frequencies = [1400.0, 1450.0]
points = 8
[solver]
modes = 6
harmonics = 3
""" + "".join(f"[[cyclic.sector]]\nnumber = {s}\nstiffness = {1.0 + 0.01 * s}\n" for s in range(N))


@pytest.fixture(scope="module")
def disc(tmp_path_factory):
    """Return the structure of a disc with different blades."""
    folder, wave = COMM.bcast(tmp_path_factory.mktemp("disc")), {"engine_order": 1, "whole": True, "blades": ["blade"]}
    structure = build(read_scene(on_root(COMM, lambda: write_sector(folder, N, TABLES, wave=wave, friction=0.05))), COMM)
    yield structure
    structure.close()


def test_motions_at_several_points_need_one_factor_of_the_faces_each(disc, monkeypatch):
    prepared, random = prepare(disc), np.random.default_rng(4)
    rows = 3 * disc.pairs.n_pairs
    points = [ActingForces(level, 9000.0, random.standard_normal((rows, N_H))) for level, N_H in ((1.0, 7), (2.0, 5))]
    factored, packed_cholesky = [], sector_factor.packed_cholesky
    monkeypatch.setattr(sector_factor, "packed_cholesky", lambda S: factored.append(len(S)) or packed_cholesky(S))
    together = prepared.reduction.displacements(prepared.model, points)
    assert len(factored) == (len(disc.tuned) if COMM.rank == 0 else 0)
    for point, u in zip(points, together):
        (alone,) = prepared.reduction.displacements(prepared.model, [point])
        assert u.shape == (N * len(disc.tuned[0].modes.phi_owned), point.p.shape[1])
        np.testing.assert_allclose(u, alone, rtol=0.0, atol=1e-12 * COMM.allreduce(np.abs(alone).max(initial=0.0), op=MPI.MAX))


def test_identical_sectors_use_the_modes_of_the_disc_in_the_same_memory(disc):
    diameters = {d: disc.alike.per_group.of_group(d) for d in (0, 1, 2, N - 1)}
    for d, each in diameters.items():
        shaped = disc.tuned[min(d, N - d)]
        assert each.n_modes == each.n_computed == 6 < shaped.n_modes
        assert d > N // 2 or len(each.modes.phi_owned) == 0 or np.shares_memory(each.modes.phi_owned, shaped.modes.phi_owned)
        expected = shaped.projected.R_phi[:, :6]
        np.testing.assert_array_equal(each.projected.R_phi, expected.conj() if d > N // 2 else expected)


def test_blocks_of_the_static_receptance_are_those_of_its_columns(disc):
    G, every = disc.statics.G_static, np.arange(disc.pairs.n_pairs)
    random = np.random.default_rng(5)
    rows, columns = (np.sort(random.permutation(3 * len(every))[:k]) for k in (20, 30))
    whole = np.concatenate(COMM.allgather(G.transposed(every).T))
    np.testing.assert_allclose(G.block(rows, columns), whole[np.ix_(rows, columns)], rtol=0.0, atol=1e-12 * np.abs(whole).max())


def test_a_group_of_ranks_has_the_receptance_of_all(disc):
    """Each rank alone: products by transforms, and blocks of the static receptance."""
    model, every = prepare(disc).response.model, np.arange(disc.pairs.n_pairs)
    alone = COMM.Split(COMM.rank)
    on_group = prepare(disc).response.on_ranks(alone).model
    p = np.random.default_rng(6).standard_normal((3 * len(every), 2))
    of_all, of_group = (ReceptanceColumns(each, 9000.0, every, for_blocks=True) for each in (model, on_group))
    assert on_group.receptance_of(1).sectors.comm is alone
    for whole, part in zip(of_all.blocks(), of_group.blocks(), strict=True):
        np.testing.assert_allclose(part, whole, rtol=0.0, atol=1e-12 * np.abs(whole).max())
    for whole, part in zip(of_all.groups, of_group.groups, strict=True):
        expected = np.concatenate(COMM.allgather(whole.apply(p)))
        np.testing.assert_allclose(part.apply(p), expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
    alone.Free()
