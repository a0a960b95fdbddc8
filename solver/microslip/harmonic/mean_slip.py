"""Springs that hold the mean slip of a body that nothing else holds (docs/theory.md, section 5).

The friction of a pair that slips in every cycle has forgotten where the pair was before: it does not change with the mean of the
tangential motion.  Where all pairs of a body slip, and nothing but the joint holds it, the body may stand anywhere, or creep.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
import scipy.sparse.linalg as sla
from mpi4py import MPI

from ..contact.law import ContactCycle, Law
from ..guards.memory import refuse_beyond
from ..parallel.agree import on_root
from ..parallel.ownership import gathered_rows
from ..receptance.reduced_model import ReducedModel
from ..system.signals import is_stopping

HOLD = 1e-3  # stiffness of the springs, as a share of k_t: peaks change by some 1e-3 (docs/validation.md)

FREE = 1e-8  # share of the force against a motion that others than the joint's tangential springs carry: nothing holds it

_FEW = 200  # rows up to which LAPACK is as quick


def hold_mean_slip(cycle: ContactCycle, about: np.ndarray) -> None:
    """Add the springs of eq. (5.6) to the forces and their derivative, in place.  Local.

    The slider of a pair has moved by -p_t / k_t: a spring from its mean to where p_t has the mean ``about`` (n, 2) [N]
    takes its share of their difference.  The set of harmonics has a mean.
    """
    cycle.p[cycle.active, :2, 0] -= HOLD * (cycle.p[cycle.active, :2, 0] - about[cycle.active])
    if cycle.P is not None:
        N_H = cycle.p.shape[2]
        cycle.P[:, [0, N_H]] *= 1.0 - HOLD


def is_held_by_its_joint_alone(model: ReducedModel, law: Law) -> bool:
    """Tell whether the mean slip is undetermined once every pair slips.  Collective; static columns of all pairs are needed.

    ``law`` is that of this rank's pairs.

    Never without a mean, which then is zero; nor without vibration, where the slider has not forgotten where the pair was, and a
    load beyond all friction has no equilibrium that a spring might feign.

    The joint's tangential springs then carry all but a share ``FREE`` of the force against some motion: the largest eigenvalue of
    k_t^1/2 G_tt k_t^1/2, which is k / (k + rest) for that motion, lies so close to 1.  A joint that is only stiff beside a
    structure that holds itself is not meant: springs of ``HOLD`` k_t would be stiffer than the structure.
    """
    if not model.harmonics.vibrate_about_a_mean:
        return False
    return _largest_share(model, law) > 1.0 - FREE


def _largest_share(model: ReducedModel, law: Law) -> float:
    """Return the largest eigenvalue of k_t^1/2 G_tt k_t^1/2.  Collective: a gather for each product; G stays where it is."""
    comm, n_rows = model.comm, 2 * model.n_pairs
    every = model.receptance_of(0).static.G_static.chosen(np.arange(model.n_pairs))
    columns, owned = every.part(_tangential(model.n_pairs)), _tangential(model.owned.stop - model.owned.start)
    root_owned = np.sqrt(law.stiffness[:, :2]).reshape(-1, 1)
    limits = np.append(0, np.array(comm.allgather(2 * model.owned.stop)))
    root = gathered_rows(comm, root_owned, limits)
    assert root is not None, "gathered on every rank"

    def product(x: np.ndarray) -> np.ndarray | None:
        return gathered_rows(comm, root_owned * columns.apply(root * x.reshape(-1, 1))[owned], limits, root=0)

    share = _by_products(comm, product, n_rows) if n_rows > _FEW else None
    if share is not None:
        return share
    if n_rows > _FEW:
        needed = 8.0 * n_rows * (len(owned) + (2 * n_rows if comm.rank == 0 else 0))
        refuse_beyond(comm, needed, f"what holds the mean slip of {model.n_pairs} pairs", "use fewer ranks on each machine")
    scaled = columns.columns(owned).T
    scaled *= root_owned
    scaled *= root[:, 0]
    return on_root(comm, _largest_of_all, gathered_rows(comm, scaled, limits, root=0))


def _tangential(n_pairs: int) -> np.ndarray:
    """Return the rows of the tangential directions of pairs, (2 n_pairs,).  Local."""
    return (3 * np.arange(n_pairs)[:, None] + np.arange(2)).ravel()


def _by_products(comm: MPI.Comm, product: Callable[[np.ndarray], np.ndarray | None], n: int) -> float | None:
    """Return the largest eigenvalue of a symmetric matrix (n, n) by ARPACK on rank 0, on every rank; None: it did not converge.

    Collective, and so is ``product`` with a vector (n,), whose answer (n, 1) rank 0 has.
    """
    share: float | None = None
    if comm.rank > 0:
        while (x := comm.bcast(None)) is not None:
            product(x)
        return comm.bcast(share)
    start = np.random.default_rng(0).standard_normal(n)  # no symmetry that a motion could be orthogonal to
    operator = sla.LinearOperator((n, n), matvec=lambda x: product(comm.bcast(x)), dtype=float)
    try:
        with suppress(sla.ArpackNoConvergence):
            share = float(sla.eigsh(operator, k=1, tol=1e-10, v0=start, return_eigenvectors=False)[0])
    finally:
        if not is_stopping():  # after a signal the others may be elsewhere
            comm.bcast(None)
    return comm.bcast(share)


def _largest_of_all(matrix: np.ndarray) -> float:
    """Return the largest eigenvalue of a symmetric matrix.  Local."""
    return float(np.linalg.eigvalsh(matrix)[-1])
