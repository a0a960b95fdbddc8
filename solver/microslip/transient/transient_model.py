"""The reduced model for time integration: the numbers that harmonic balance uses, on every rank (docs/theory.md, section 10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..contact.law import Law
from ..fourier.coefficients import synthesise
from ..receptance.modes import DampedModes
from ..receptance.reduced_model import ReducedModel


@dataclass(frozen=True, eq=False)
class TransientModel:
    """Modes and what is left of statics beside them; du = R_phi eta + s f - G p, eq. (10.1); everything replicated."""

    modes: DampedModes
    G: np.ndarray  # (3 n_pairs, 3 n_pairs) G_static - R_phi Omega^-2 R_phi^T [m/N]
    s: np.ndarray  # (3 n_pairs, n_loads) du_static - R_phi Omega^-2 b [m/N]
    out_f: np.ndarray  # (n_outputs, n_loads) outputs' residual flexibility to the loads [m/N]
    out_p: np.ndarray  # (n_outputs, 3 n_pairs) the same to p
    load_f: np.ndarray  # (n_loads, n_loads) the loads' own [m/N]
    f: np.ndarray  # (n_loads, N_H) Fourier coefficients of the loads at unit level
    law: Law

    @property
    def n_pairs(self) -> int:
        return len(self.s) // 3

    @property
    def memory_scale(self) -> np.ndarray:
        """What numbers of p and memory are over, in the root of an energy, (n_pairs (3 + n_memory),) [(N/m)^1/2]."""
        root = np.sqrt(np.where(self.law.springs > 0.0, self.law.springs, 1.0))
        return np.concatenate([root, np.repeat(root[:, :1], self.law.n_memory, axis=1)], axis=1).ravel()

    def forces(self, contact: np.ndarray) -> np.ndarray:
        """Return p (..., 3 n_pairs) of p with what the law remembers beside it, (..., n_pairs (3 + n_memory)) [N].  Local."""
        by_pair = contact.reshape(*contact.shape[:-1], self.n_pairs, 3 + self.law.n_memory)
        return by_pair[..., :3].reshape(*contact.shape[:-1], 3 * self.n_pairs)

    def loads(self, n_steps: int) -> np.ndarray:
        """Return the loads at unit level at the ends 1 ... ``n_steps`` of the steps of a period, (n_steps, n_loads).  Local."""
        return np.roll(synthesise(self.f, n_steps), -1, axis=1).T


def transient_model(model: ReducedModel, law: Law) -> TransientModel:
    """Return the model of eq. (10.1).  Collective on ``model.comm``: static columns of all pairs, and one gather."""
    (group,) = model.groups
    modes, static = group.receptance.modes, group.receptance.static
    rows = np.ascontiguousarray(static.G_static.transposed(np.arange(model.n_pairs)).T)
    G_static = rows if model.comm.size == 1 else np.concatenate(model.comm.allgather(rows))
    R_flexibility, o_flexibility, b_flexibility = (x * modes.omega_n**-2.0 for x in (modes.R_phi, modes.o, modes.b.T))
    return TransientModel(
        modes=modes,
        f=model.f,
        law=law,
        G=G_static - R_flexibility @ modes.R_phi.T,
        s=static.du_static - R_flexibility @ modes.b,
        out_f=static.out_static - o_flexibility @ modes.b,
        out_p=static.out_R - o_flexibility @ modes.R_phi.T,
        load_f=static.load_static - b_flexibility @ modes.b,
    )
