"""Reduced models of small dense systems (tests/oracles/scenes.py), for tests of harmonic balance and continuation."""

import numpy as np
import scipy.linalg

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.continuation.follow import follow_branch
from microslip.continuation.problems import ForcedResponse
from microslip.continuation.steps import ArcLength, arc_lengths, linear_frequencies
from microslip.continuation.task import BranchTask
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.balance import HarmonicBalance
from microslip.parallel.ownership import split_evenly
from microslip.points.selection import AllPairs
from microslip.points.sweep import Sweep
from microslip.receptance.damping import Damping
from microslip.receptance.modes import DampedModes
from microslip.receptance.motions import linear_motion
from microslip.receptance.per_group import PerGroup
from microslip.receptance.receptance import Receptance
from microslip.receptance.reduced_model import ReducedModel
from microslip.receptance.static_columns import StaticColumns
from microslip.receptance.static_response import StaticResponse
from microslip.reduction.settings import ModalDamping


def reduced(system, comm, H, n_modes=None):
    """Return the reduced model of a system, with all modes by default, and its contact law.

    ``H`` is the highest harmonic, or a set of harmonics.  Pairs that are ``open_at_rest`` have no springs.
    """
    harmonics = H if isinstance(H, Harmonics) else Harmonics.up_to(H)
    M, R, f = system["M"], system["R"], np.stack([load["vector"] for load in system["loads"]], axis=1)
    open_at_rest = system.get("open_at_rest", np.zeros(len(system["k_t"]), dtype=bool))
    k = np.where(open_at_rest[:, None], 0.0, np.stack([system["k_t"], system["k_t"], system["k_n"]], axis=1)).ravel()
    K_L = system["K"] + R.T @ (k[:, None] * R)
    squares, phi = scipy.linalg.eigh(K_L, M)
    omega_n, phi = np.sqrt(squares[:n_modes]), phi[:, :n_modes]
    C = 2 * system["zeta"] * omega_n if "zeta" in system else phi.T @ system["C"] @ phi
    flexibility = np.linalg.inv(K_L)
    o = np.atleast_2d(system["output"])
    ranges = split_evenly(len(R) // 3, comm.size)
    rows = slice(3 * ranges[comm.rank], 3 * ranges[comm.rank + 1])

    def columns(pairs):
        return R[rows] @ flexibility @ R.reshape(-1, 3, R.shape[1])[pairs].reshape(-1, R.shape[1]).T

    coefficients = np.zeros((len(system["loads"]), harmonics.n_coefficients))
    for row, load in zip(coefficients, system["loads"]):
        cos_and_sin = np.array([np.cos(load["phase"]), -np.sin(load["phase"])])
        row[harmonics.columns(load["harmonic"])] = cos_and_sin[: 1 if load["harmonic"] == 0 else 2]
    static = StaticResponse(
        G_static=StaticColumns(len(R) // 3, ranges[comm.rank + 1] - ranges[comm.rank], columns),
        du_static=R @ flexibility @ f,
        out_static=o @ flexibility @ f,
        out_R=o @ flexibility @ R.T,
        load_static=f.T @ flexibility @ f,
        outputs_static=np.einsum("ij,jk,ik->i", o, flexibility, o),
    )
    model = ReducedModel(
        comm=comm,
        n_pairs=len(R) // 3,
        n_outputs=len(o),
        receptances=PerGroup.single(Receptance(DampedModes(omega_n, Damping(C), R @ phi, phi.T @ f, o @ phi), static)),
        f=coefficients,
        harmonics=harmonics,
        stated_damping=ModalDamping(ratio=system["zeta"]) if "zeta" in system else None,
    )
    return model, ElasticCoulomb(
        *(system[key] for key in ("mu", "N0", "k_t", "k_n", "separate")),
        sampled=system.get("sampled", False),
        open_at_rest=open_at_rest,
    )


def forced(model, law, n_samples, level):
    """Return the forced response of a model at a level [N]."""
    return ForcedResponse(HarmonicBalance.of_all(model, law, n_samples), level)


def branch(
    system,
    comm,
    level,
    *,
    low=None,
    high=None,
    H=3,
    n_samples=128,
    at=(),
    selection=None,
    points=40,
    down=False,
    tolerance=1e-9,
    ds_min=1e-4,
    n_modes=None,
    law_of=lambda law: law,
):
    """Follow the branch of one level between two frequencies [rad/s]; ``law_of`` turns the sampled law into that of the pairs."""
    model, law = reduced(system, comm, H, n_modes)
    problem = forced(model, law_of(law), n_samples, level)
    low, high = low or system["omega"][0], high or system["omega"][1]
    grid = linear_frequencies(low, high, model.omega_n, model.zeta)
    ds = arc_lengths(comm, [linear_motion(model, level, w) for w in grid], grid, high - low)[-1] / points
    start, stop = (high, low) if down else (low, high)
    steps = ArcLength(ds=ds, ds_min=ds_min * ds, ds_max=2 * ds)
    task = BranchTask(problem, selection or AllPairs(), Sweep(start, stop, tuple(at)), steps, tolerance)
    return follow_branch(task, 20 * points)


def amplitude(point, harmonic=1):
    return np.hypot(*point.response[0, 2 * harmonic - 1 : 2 * harmonic + 1])
