"""Springs that hold the mean slip of a body that nothing else holds (docs/theory.md, section 5).

The friction of a pair that slips in every cycle has forgotten where the pair was before: it does not change with the mean of the
tangential motion.  Where all pairs of a body slip, and nothing but the joint holds it, the body may stand anywhere, or creep.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import scipy.sparse.linalg as sla

from ..contact.law import ContactCycle, Law
from ..parallel.agree import on_root
from ..receptance.reduced_model import ReducedModel

HOLD = 1e-3  # stiffness of the springs, as a share of k_t: peaks change by some 1e-3 (docs/validation.md)

FREE = 1e-8  # share of the force against a motion that others than the joint's tangential springs carry: nothing holds it

_FEW = 200  # rows up to which LAPACK is as quick


def hold_mean_slip(found: ContactCycle, about: np.ndarray) -> None:
    """Add the springs of eq. (5.6) to the forces and their derivative, in place.  Local.

    The slider of a pair has moved by -p_t / k_t: a spring from its mean to where p_t has the mean ``about`` (n, 2) [N]
    takes its share of their difference.  The set of harmonics has a mean.
    """
    found.p[found.active, :2, 0] -= HOLD * (found.p[found.active, :2, 0] - about[found.active])
    if found.P is not None:
        N_H = found.p.shape[2]
        found.P[:, [0, N_H]] *= 1.0 - HOLD


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
    tangential = (3 * np.arange(model.n_pairs)[:, None] + np.arange(2)).ravel()
    n_owned = model.owned.stop - model.owned.start
    own = (3 * np.arange(n_owned)[:, None] + np.arange(2)).ravel()
    rows = model.comm.gather(
        model.receptance_of(0).static.G_static.chosen(np.arange(model.n_pairs)).part(tangential).columns(own).T
    )
    roots = model.comm.gather(np.sqrt(law.stiffness[:, :2]).ravel())
    return on_root(model.comm, _largest_share, rows, roots) > 1.0 - FREE


def _largest_share(rows: list[np.ndarray], roots: list[np.ndarray]) -> float:
    """Return the largest eigenvalue of k_t^1/2 G_tt k_t^1/2, from the rows and k_t^1/2 of each rank."""
    root = np.concatenate(roots)
    flexibility = root[:, None] * np.concatenate(rows) * root
    if len(root) > _FEW:
        start = np.random.default_rng(0).standard_normal(len(root))  # no symmetry that a motion could be orthogonal to
        with suppress(sla.ArpackNoConvergence):
            return float(sla.eigsh(flexibility, k=1, tol=1e-10, v0=start, return_eigenvectors=False)[0])
    return float(np.linalg.eigvalsh(flexibility)[-1])
