"""Reduced models of any number of pairs without finite elements, to measure how the cost of the response grows.

The joint is a periodic patch of pairs on a grid: the coupling of two pairs depends only on their distance along the grid, so that
a column needs no matrix, and a joint of any size costs only its columns.  Its compliance without the joint's springs is F, which
decays with distance; with the springs K_J = k I and the compliance C of the modes the static compliance is

    G_static = (F^-1 + K_J / (1 - beta))^-1 + r Omega^-2 r^T,        |K_J^(1/2) r Omega^-2 r^T K_J^(1/2)| = beta,

so that K_J^(1/2) G_static K_J^(1/2) < 1 as in any structure.  The modes move the patch smoothly; the first one resonates below
the frequencies used here, and the load excites it.  The friction limits are set from the stuck motion, so that the requested
share of pairs slips.
"""

from __future__ import annotations

import numpy as np

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.continuation.problems import ForcedResponse
from microslip.fourier.coefficients import synthesise
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.balance import HarmonicBalance
from microslip.parallel.ownership import split_evenly
from microslip.receptance.damping import Damping
from microslip.receptance.modes import DampedModes
from microslip.receptance.motions import linear_motion
from microslip.receptance.per_group import PerGroup
from microslip.receptance.receptance import Receptance
from microslip.receptance.reduced_model import ReducedModel
from microslip.receptance.static_columns import StaticColumns
from microslip.receptance.static_response import StaticResponse

K_T = 2e7  # N/m, of each pair and direction
OMEGA = 600.0  # rad/s, the middle of the frequencies to solve at
BETA = 0.2  # share of the compliance that modes carry
DECAY = 0.15  # of the patch's side over which F falls by e
SLIPS, HOLDS = 0.7, 3.0  # friction limit of slipping and of other pairs over the largest force while stuck


def joint_model(comm, n_pairs: int, H: int, n_modes: int = 20) -> ReducedModel:
    """Return the reduced model of a joint of ``n_pairs`` pairs, loaded with unit level.  Collective on ``comm``."""
    rng = np.random.default_rng(1)
    shape = grid(n_pairs)
    x, G_local = patch(shape), local_compliance(shape)
    omega_n = 560.0 * np.linspace(1.0, 40.0, n_modes)
    R_phi = smooth_shapes(x, n_modes, rng)
    compliance = R_phi / omega_n
    R_phi *= np.sqrt(BETA / K_T) / np.linalg.norm(compliance, 2)
    ranges = split_evenly(n_pairs, comm.size)
    own = np.arange(3 * ranges[comm.rank], 3 * ranges[comm.rank + 1])

    def columns(pairs: np.ndarray) -> np.ndarray:
        chosen = (3 * pairs[:, None] + np.arange(3)).ravel()
        flexibility = (R_phi[own] / omega_n**2) @ R_phi[chosen].T
        between = G_local[offsets(own[::3] // 3, pairs, shape)]  # (n_owned, m)
        for direction in range(3):
            flexibility[direction::3, direction::3] += between
        return flexibility

    b = np.zeros((n_modes, 1))
    b[0] = 1.0
    harmonics = Harmonics.up_to(H)
    f = np.zeros((1, harmonics.n_coefficients))
    f[0, 1] = 1.0
    o = rng.standard_normal((1, n_modes))
    static = StaticResponse(
        G_static=StaticColumns(n_pairs, len(own) // 3, columns),
        du_static=(R_phi / omega_n**2) @ b,
        out_static=(o / omega_n**2) @ b,
        out_R=(o / omega_n**2) @ R_phi.T,
        load_static=(b.T / omega_n**2) @ b,
        outputs_static=(o**2 / omega_n**2).sum(axis=1),
    )
    return ReducedModel(
        comm=comm,
        n_pairs=n_pairs,
        n_outputs=len(o),
        receptances=PerGroup.single(Receptance(DampedModes(omega_n, Damping(2e-2 * omega_n), R_phi, b, o), static)),
        f=f,
        harmonics=harmonics,
    )


def grid(n_pairs: int) -> tuple[int, int]:
    """Return the two factors of ``n_pairs`` that are nearest to each other."""
    short = next(n for n in range(int(np.sqrt(n_pairs)), 0, -1) if n_pairs % n == 0)
    return short, n_pairs // short


def patch(shape: tuple[int, int]) -> np.ndarray:
    """Return positions on a unit square, (n_pairs, 2)."""
    return np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2) / shape


def local_compliance(shape: tuple[int, int]) -> np.ndarray:
    """Return (F^-1 + K_J / (1 - beta))^-1 of one direction between the first pair and each, (n_pairs,) [m/N].

    F is the sum of 4 exp(-distance) / k over a pair and its images beyond the edges.  Both are circulant over the grid: the
    Fourier transform diagonalises them.
    """
    x, images = patch(shape), np.stack(np.meshgrid(*2 * [np.arange(-3, 3)]), axis=-1).reshape(-1, 2)
    F = sum(4.0 / K_T * np.exp(-np.linalg.norm(x + image, axis=1) / DECAY) for image in images)
    values = np.fft.fft2(np.reshape(F, shape)).real
    return np.fft.ifft2(values / (1.0 + K_T / (1.0 - BETA) * values)).real.ravel()


def offsets(a: np.ndarray, b: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return the pair whose offset from the first pair is that of pairs ``a`` from pairs ``b``, (n_a, n_b)."""
    (i, j), (k, m) = divmod(a[:, None], shape[1]), divmod(b, shape[1])
    return (i - k) % shape[0] * shape[1] + (j - m) % shape[1]


def smooth_shapes(x: np.ndarray, n_modes: int, rng) -> np.ndarray:
    """Return the motion of the pairs in smooth shapes, (3 n_pairs, n_modes)."""
    waves = rng.uniform(0.5, 3.0, (n_modes, 2))
    phases, directions = rng.uniform(0.0, 2 * np.pi, n_modes), rng.standard_normal((n_modes, 3)) * [1.0, 1.0, 0.1]
    shapes = 1.0 + 0.6 * np.cos(np.pi * x @ waves.T + phases)
    return (shapes[:, None, :] * directions.T).reshape(-1, n_modes)


def joint_problem(model: ReducedModel, share: float, n_samples: int = 128, level: float = 1.0) -> ForcedResponse:
    """Return the problem in which about a ``share`` of the pairs slips at OMEGA.  Collective on the model's communicator."""
    U = linear_motion(model, level, OMEGA)
    rows = model.comm.allgather(U.reshape(-1, 3, model.N_H))
    du_t = synthesise(np.concatenate(rows)[:, :2], 64)
    most = K_T * np.linalg.norm(du_t, axis=1).max(axis=1)
    slips = np.arange(model.n_pairs) * 7919 % model.n_pairs < share * model.n_pairs
    ones, mu = np.ones(model.n_pairs), 0.3
    N0 = np.where(slips, SLIPS, HOLDS) * most / mu
    law = ElasticCoulomb(mu * ones, N0, K_T * ones, K_T * ones, np.zeros(model.n_pairs, dtype=bool))
    return ForcedResponse(HarmonicBalance.of_all(model, law, n_samples), level)


def frequencies(n: int) -> np.ndarray:
    """Return ``n`` frequencies about OMEGA [rad/s], a few per mille apart, as along a curve."""
    return OMEGA * (1.0 + 2e-3 * (np.arange(n) - n // 2))
