"""A model driven by the amplitude q of one of its modes, the leading mode (docs/theory.md, section 15).

Mode j leads in harmonic 1 by a load s q M phi_j and a spring s of this mode only, s = omega_j^2.  With the receptance G~ and the
linear motion U~ of D_1 + s e_j e_j^T,

    U = U~(q) - G~ p(U),        eta_j = q,

in which load and spring cancel.  The first equation is not singular at the resonance of the mode, for any damping.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..fourier.harmonics import Harmonics
from ..parallel.ownership import rows_of
from .per_group import PerGroup
from .receptance import Receptance
from .reduced_model import ReducedModel


def led_by(model: ReducedModel, j: int) -> ReducedModel:
    """Return the model under omega_j^2 M phi_j [N per kg^1/2 m] instead of its loads, with leading mode j (from 0), eq. (15.2).

    Local.
    """
    return _under_mode(model, j, 1)


def pushed_by(model: ReducedModel, j: int) -> ReducedModel:
    """Return the model under the constant load omega_j^2 M phi_j instead of its loads, with the mean only.  Local."""
    return _under_mode(replace(model, f=np.zeros_like(model.f)).with_harmonics(Harmonics((0,))), j, 0)


def _under_mode(model: ReducedModel, j: int, n: int) -> ReducedModel:
    """Return the model under the load of mode j in harmonic n only; for n > 0 the mode leads."""
    of_mode = model.receptances.group_of(1)

    def under(group: Hashable) -> Receptance:
        return _of_group(model.receptances.of_group(group), j if group == of_mode else None, leads=n > 0)

    f = np.zeros((1, model.N_H))
    f[0, model.harmonics.columns(n).start] = 1.0
    observed = model.observed and replace(model.observed, of_base=np.zeros((model.n_outputs, 1)))
    receptances = PerGroup(under, model.receptances.group_of, model.receptances.groups)
    return replace(model, receptances=receptances, f=f, observed=observed)


def _of_group(receptance: Receptance, j: int | None, leads: bool) -> Receptance:
    """Return a receptance under the load of mode j; j is None for a group without the mode."""
    modes, static, rigid = receptance.modes, receptance.static, receptance.rigid
    chosen = np.zeros(len(modes.omega_n)) if j is None else np.eye(len(modes.omega_n))[j]
    springs = chosen * modes.omega_n**2
    return replace(
        receptance,
        modes=replace(modes, b=springs[:, None], springs=springs if leads else None),
        static=replace(
            static,
            du_static=(modes.R_phi @ chosen)[:, None],
            out_static=(modes.o @ chosen)[:, None],
            load_static=np.array([[springs.sum()]]),
        ),
        rigid=rigid and replace(rigid, b=np.zeros((len(rigid.b), 1))),
    )


class Coordinate(NamedTuple):
    """The motion of the leading mode of a model in harmonic 1, eta = row (b q - R_phi^H p), complex."""

    per_load: complex  # row b: eta under a unit amplitude q without forces of the pairs
    row: np.ndarray  # (m,) row of D_1^-1, or of its rate [s2]
    of_pairs: np.ndarray  # (3 n, m) R_phi of some pairs

    def under(self, q: float, p_1: np.ndarray) -> complex:
        """Return eta for an amplitude q and the complex forces p_1 (3 n,) of the pairs [N].  Local."""
        return complex(q * self.per_load - self.row @ (self.of_pairs.conj().T @ p_1))

    @property
    def by_pairs(self) -> np.ndarray:
        """d eta / d p_1, (3 n,) complex."""
        return -self.of_pairs.conj() @ self.row


def coordinate(model: ReducedModel, j: int, omega: float, pairs: np.ndarray) -> Coordinate:
    """Return the coordinate of the leading mode j, eq. (15.3), under forces of the ``pairs``, at omega [rad/s].  Local."""
    k, i = model.index_of(1)
    modes, c = model.groups[k].receptance.modes, model.flexibilities(omega)[k]
    row = c.row(j, i) + np.eye(len(modes.omega_n))[j] / modes.omega_n**2
    return Coordinate(complex(row @ modes.b[:, 0]), row, modes.R_phi[rows_of(pairs)])


def coordinate_rate(model: ReducedModel, j: int, omega: float, pairs: np.ndarray, d_omega: float, d_sigma: float) -> Coordinate:
    """Return the rate of the coordinate for rates ``d_omega`` of the frequency and ``d_sigma`` of a damping sigma M.  Local."""
    k, i = model.index_of(1)
    modes, rate = model.groups[k].receptance.modes, model.flexibility_rates(omega, d_omega, d_sigma)[k]
    row = rate.row(j, i)
    return Coordinate(complex(row @ modes.b[:, 0]), row, modes.R_phi[rows_of(pairs)])
