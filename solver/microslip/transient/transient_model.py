"""The reduced model for time integration: the data of harmonic balance, on every rank (docs/theory.md, section 10)."""

from dataclasses import dataclass

import numpy as np

from ..contact.law import Law
from ..fourier.coefficients import synthesise
from ..guards.memory import refuse_beyond
from ..messages.words import counted
from ..parallel.ownership import gathered_rows
from ..receptance.modes import DampedModes
from ..receptance.reduced_model import ReducedModel
from ..receptance.rigid_motion import RigidMotion

_CHECKED_FROM = 1e8  # bytes of G from which the available memory is checked first
_BLOCK = 512  # rows of G computed at a time
_FEWER = "fewer ranks on each machine, or a coarser mesh of the contact surfaces, need less"


@dataclass(frozen=True, eq=False)
class TransientModel:
    """Modes and residual flexibility; du = R_phi eta + s f - G p, eq. (10.1); everything replicated."""

    modes: DampedModes
    G: np.ndarray  # (3 n_pairs, 3 n_pairs) G_static - R_phi Omega^-2 R_phi^T [m/N]
    s: np.ndarray  # (3 n_pairs, n_loads) du_static - R_phi Omega^-2 b [m/N]
    out_f: np.ndarray  # (n_outputs, n_loads) residual flexibility between outputs and loads [m/N]
    out_p: np.ndarray  # (n_outputs, 3 n_pairs) between outputs and p [m/N]
    load_f: np.ndarray  # (n_loads, n_loads) between loads [m/N]
    f: np.ndarray  # (n_loads, N_H) Fourier coefficients of the loads at unit level
    law: Law
    rigid: RigidMotion | None = None  # of a structure without supports: contact forces do not move it

    @property
    def n_pairs(self) -> int:
        """The number of pairs."""
        return len(self.s) // 3

    @property
    def memory_scale(self) -> np.ndarray:
        """Divisors that convert p and internal variables to units of root energy, (n_pairs (3 + n_memory),) [(N/m)^1/2]."""
        root = np.sqrt(np.where(self.law.springs > 0.0, self.law.springs, 1.0))
        return np.concatenate([root, np.repeat(root[:, :1], self.law.n_memory, axis=1)], axis=1).ravel()

    def forces(self, contact: np.ndarray) -> np.ndarray:
        """Return p (..., 3 n_pairs) from p with internal variables, (..., n_pairs (3 + n_memory)) [N].  Local."""
        by_pair = contact.reshape(*contact.shape[:-1], self.n_pairs, 3 + self.law.n_memory)
        return by_pair[..., :3].reshape(*contact.shape[:-1], 3 * self.n_pairs)

    def loads(self, n_steps: int) -> np.ndarray:
        """Return the loads at unit level at the ends 1 ... ``n_steps`` of the steps of a period, (n_steps, n_loads).  Local."""
        return np.roll(synthesise(self.f, n_steps), -1, axis=1).T

    def rigid_coordinates(self, omega: np.ndarray, level: np.ndarray, n_steps: int) -> np.ndarray | None:
        """Return the steady rigid-body motion of B points at the same instants, (n_steps, B, n).  Local."""
        if self.rigid is None:
            return None
        n = np.arange(self.f.shape[1] // 2 + 1)
        q = [self.rigid.coordinates(a * self.f, n * w) for a, w in zip(level, omega)]
        return np.stack([np.roll(synthesise(each, n_steps), -1, axis=1).T for each in q], axis=1)

    def rigid_loss(self, omega: np.ndarray, level: np.ndarray) -> np.ndarray:
        """Return the loss of the rigid-body motion in dampers per period, (B,) [J].  Local."""
        n, rigid = np.arange(self.f.shape[1] // 2 + 1), self.rigid
        return np.array([0.0 if rigid is None else rigid.loss(a * self.f, n, w) for a, w in zip(level, omega)])


def transient_model(model: ReducedModel, law: Law) -> TransientModel:
    """Return the model of eq. (10.1).

    Collective on ``model.comm``: static columns of all pairs, and a gather of the whole G to every rank, as each rank marches
    different points.

    Raises
    ------
    ResourceError : not enough memory; on every rank
    """
    (group,) = model.groups
    modes, static = group.receptance.modes, group.receptance.static
    _refuse_what_does_not_fit(model)
    R_flexibility, o_flexibility, b_flexibility = (x * modes.omega_n**-2.0 for x in (modes.R_phi, modes.o, modes.b.T))
    return TransientModel(
        modes=modes,
        f=model.f,
        law=law,
        G=_residual_flexibility(model, R_flexibility),
        s=static.du_static - R_flexibility @ modes.b,
        out_f=static.out_static - o_flexibility @ modes.b,
        out_p=static.out_R - o_flexibility @ modes.R_phi.T,
        load_f=static.load_static - b_flexibility @ modes.b,
        rigid=group.receptance.rigid,
    )


def _refuse_what_does_not_fit(model: ReducedModel) -> None:
    """Raise ResourceError if G and the static columns do not fit into memory.  Collective."""
    n_owned, n_missing = model.owned.stop - model.owned.start, np.count_nonzero(~model.groups[0].receptance.static.G_static.known)
    if 72.0 * model.n_pairs**2 > _CHECKED_FROM:
        n_rows = n_owned if model.comm.size > 1 else 0  # in addition to the gathered rows
        needed = 72.0 * (model.n_pairs**2 + n_rows * model.n_pairs + n_missing * n_owned)
        refuse_beyond(
            model.comm, needed, f"time integration: the flexibility between all {counted(model.n_pairs, 'pair')}", _FEWER
        )


def _residual_flexibility(model: ReducedModel, R_flexibility: np.ndarray) -> np.ndarray:
    """Return G of eq. (10.1), (3 n_pairs, 3 n_pairs) [m/N]; each rank computes the rows of its pairs.  Collective."""
    modes, static = model.groups[0].receptance.modes, model.groups[0].receptance.static
    columns = static.G_static.chosen(np.arange(model.n_pairs))
    first, n_owned = 3 * model.owned.start, 3 * (model.owned.stop - model.owned.start)
    G_owned = np.empty((n_owned, 3 * model.n_pairs))
    for start in range(0, n_owned, _BLOCK):
        rows = np.arange(start, min(start + _BLOCK, n_owned))
        G_owned[rows[0] : rows[-1] + 1] = columns.columns(rows).T
        G_owned[rows[0] : rows[-1] + 1] -= R_flexibility[first + rows] @ modes.R_phi.T
    G = gathered_rows(model.comm, G_owned, np.append(0, np.array(model.comm.allgather(3 * model.owned.stop))))
    assert G is not None, "gathered on every rank"
    return G
