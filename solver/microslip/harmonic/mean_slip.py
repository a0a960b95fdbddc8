"""Springs that hold the mean slip of a body without other support (docs/theory.md, section 5).

The friction force of a pair that slips in every cycle does not depend on the mean of the tangential motion.  If all pairs of a
body slip and only the joint supports it, the position of the body is undetermined, and it may drift.
"""

from collections.abc import Callable
from contextlib import suppress

import numpy as np
import scipy.sparse.linalg as sla
from mpi4py import MPI

from ..contact.law import ContactCycle, Law
from ..guards.memory import refuse_beyond
from ..messages.words import counted
from ..parallel.agree import on_root
from ..parallel.ownership import gathered_rows
from ..receptance.reduced_model import ReducedModel
from ..system.signals import is_stopping

HOLD = 1e-3  # stiffness of the springs, as a fraction of k_t: peaks change by about 1e-3 (docs/validation.md)

FREE = 1e-8  # without other support: fraction of the force against a motion not carried by the joint's tangential springs

_FEW = 200  # rows up to which LAPACK is as fast


def hold_mean_slip(cycle: ContactCycle, about: np.ndarray) -> None:
    """Add the springs of eq. (5.6) to the forces and their derivative, in place.  Local.

    The position of the slider of a pair is -p_t / k_t; the spring acts on its mean, relative to the position with p_t = ``about``
    (n, 2) [N].  The set of harmonics has a mean.
    """
    cycle.p[cycle.active, :2, 0] -= HOLD * (cycle.p[cycle.active, :2, 0] - about[cycle.active])
    if cycle.P is not None:
        N_H = cycle.p.shape[2]
        cycle.P[:, [0, N_H]] *= 1.0 - HOLD


def is_held_by_its_joint_alone(model: ReducedModel, law: Law) -> bool:
    """Return whether the mean slip is undetermined if every pair slips.  Collective; needs the static columns of all pairs.

    ``law`` is the law of this rank's pairs.

    False without a mean harmonic, as the mean slip is then zero, and without vibration, where friction depends on the position
    and a load beyond the friction limit has no equilibrium, which springs would hide.

    Criterion: the joint's tangential springs carry all but a fraction ``FREE`` of the force against some motion, that is, the
    largest eigenvalue of k_t^1/2 G_tt k_t^1/2, equal to k / (k + rest) for that motion, is so close to 1.  A joint that is only
    much stiffer than a supported structure does not qualify: springs of ``HOLD`` k_t would be stiffer than the structure.
    """
    if not model.harmonics.vibrate_about_a_mean:
        return False
    return _largest_share(model, law) > 1.0 - FREE


def _largest_share(model: ReducedModel, law: Law) -> float:
    """Return the largest eigenvalue of k_t^1/2 G_tt k_t^1/2.  Collective: one gather per product; G remains distributed."""
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
        refuse_beyond(
            comm,
            needed,
            f"test for undetermined mean slip of {counted(model.n_pairs, 'pair')}",
            "use fewer ranks on each machine",
        )
    scaled = columns.columns(owned).T
    scaled *= root_owned
    scaled *= root[:, 0]
    return on_root(comm, _largest_of_all, gathered_rows(comm, scaled, limits, root=0))


def _tangential(n_pairs: int) -> np.ndarray:
    """Return the rows of the tangential directions of pairs, (2 n_pairs,).  Local."""
    return (3 * np.arange(n_pairs)[:, None] + np.arange(2)).ravel()


def _by_products(comm: MPI.Comm, product: Callable[[np.ndarray], np.ndarray | None], n: int) -> float | None:
    """Return the largest eigenvalue of a symmetric matrix (n, n) by ARPACK on rank 0, on every rank; None: no convergence.

    Collective; ``product`` with a vector (n,) is collective as well, with its result (n, 1) on rank 0.
    """
    share: float | None = None
    if comm.rank > 0:
        while (x := comm.bcast(None)) is not None:
            product(x)
        return comm.bcast(share)
    start = np.random.default_rng(0).standard_normal(n)  # random, so that it is not orthogonal to a symmetric motion
    operator = sla.LinearOperator((n, n), matvec=lambda x: product(comm.bcast(x)), dtype=float)
    try:
        with suppress(sla.ArpackNoConvergence):
            share = float(sla.eigsh(operator, k=1, tol=1e-10, v0=start, return_eigenvectors=False)[0])
    finally:
        if not is_stopping():  # after a signal the other ranks may not be in this loop
            comm.bcast(None)
    return comm.bcast(share)


def _largest_of_all(matrix: np.ndarray) -> float:
    """Return the largest eigenvalue of a symmetric matrix.  Local."""
    return float(np.linalg.eigvalsh(matrix)[-1])
