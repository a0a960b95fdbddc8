"""How strongly forces act on the modes left out, without knowing them (docs/theory.md, section 11).

The receptance (4.1) lacks E_n = sum over k > m of phi_k c_kn phi_k^T of the modes left out.  Below their resonances

    E_n ~ (n omega)^2 W,        W = sum over k > m of phi_k phi_k^T / omega_k^4 = Z^T M Z,      Z = K_L^-1 - phi Omega^-2 phi^T,

and W is sampled: with random vectors s of covariance M, W is the mean of (Z s)(Z s)^T.  A few static solutions once, however
many pairs there are.  A damping alpha M + beta K adds -i n omega (alpha W + beta Z), structural damping -i eta Z, a ratio zeta
-2 i n omega zeta times what lies between W and Z: no more than their geometric mean, where x E_n x is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .on_group import on_group
from .reduced_model import ReducedModel
from .reduced_structure import ReducedStructure
from .structural_coupling import StructuralCoupling

if TYPE_CHECKING:
    from mpi4py import MPI

SAMPLES = 32  # random vectors: norms are known to about a quarter
KEY = 20  # of the random vectors
LAST = 3  # modes whose kinetic energy they have
_NEAR = 0.9  # of that frequency: a harmonic above it is taken to lie here


@dataclass(frozen=True)
class DampingBeyond:
    """Of the modes left out: phi_k^T C phi_k ~ alpha + 2 zeta omega_k + beta omega_k^2, and a loss factor beside it."""

    alpha: float = 0.0  # 1/s
    ratio: float = 0.0  # zeta
    beta: float = 0.0  # s
    loss_factor: float = 0.0  # eta of structural damping; the static part has none


@dataclass(frozen=True)
class ModesLeftOut:
    """The samples Z s seen from pairs, outputs and loads; replicated."""

    omega: float  # rad/s: what the loads move beyond the modes kept vibrates about here, or above
    highest: float  # rad/s, of the last mode kept
    damping: DampingBeyond
    of_pairs: np.ndarray  # (3 n_pairs, SAMPLES)
    of_outputs: np.ndarray  # (n_outputs, SAMPLES)
    of_loads: np.ndarray  # (n_loads, SAMPLES)
    direct: np.ndarray  # (n_outputs, n_loads) W between outputs and loads, exactly
    own: np.ndarray  # (n_loads,) W of each load with itself, exactly
    residual: np.ndarray  # (n_outputs, n_loads) their static flexibility without the modes kept, exactly [m/N]
    coupling: StructuralCoupling | None  # of structural damping with a joint

    def gains(self, n_omega: np.ndarray) -> np.ndarray:
        """Return the factor of W in E_n at the frequencies n omega, (n_harmonics,) [1/s2].  Local."""
        s = np.minimum(n_omega / self.omega, _NEAR)
        return np.hypot(n_omega**2, self._of_mass * n_omega) / (1.0 - s**2)

    @property
    def _of_mass(self) -> float:
        """Factor of -i n omega W in E_n, where that is all that is known [1/s]."""
        return self.damping.alpha + 2.0 * self.damping.ratio * self.highest

    def changes(self, model: ReducedModel, level: float, omega: float, p: np.ndarray, felt: np.ndarray) -> np.ndarray:
        """Return what the modes left out would change in cos 1 and then sin 1 of the outputs, (2 n_outputs,) [m].  Local.

        From a load straight to an output exactly, but for the order beyond W; by way of the pairs at most, by Cauchy and Schwarz,
        harmonic by harmonic.  docs/theory.md, eq. (11.2).

        Parameters
        ----------
        p : (3 n_pairs, N_H) forces of the pairs [N]
        felt : (2 n_outputs, SAMPLES, N_H) samples of what an output feels by way of the pairs, R^T tau
        """
        harmonics, f = model.harmonics, level * model.f
        gain, first = self.gains(omega * harmonics.numbers), harmonics.columns(1)
        loads, pairs = self.of_loads.T @ f, self.of_pairs.T @ p
        straight = np.zeros((len(felt), SAMPLES, model.N_H))
        n_out, factors = len(self.of_outputs), np.broadcast_to(model.output_factors(omega), len(self.of_outputs))
        straight[:n_out, :, first.start] = straight[n_out:, :, first.start + 1] = self.of_outputs * factors[:, None]
        through = _norms(straight, model) * _norms(pairs, model) + _norms(felt, model) * _norms(loads - pairs, model)
        known = np.abs(self.direct @ f[:, first]).T.ravel()
        static = np.abs(self.residual @ f[:, first]).T.ravel()
        n_first, lost = list(harmonics.chosen).index(1), self.damping.loss_factor + self.damping.beta * omega * harmonics.numbers
        between = 2.0 * self.damping.ratio * omega * np.sqrt(known * static)
        known = gain[n_first] * known + np.maximum(between - self._of_mass * omega * known, 0.0) + lost[n_first] * static
        if self.coupling is not None:
            known = known + self.coupling.changes(model, level, omega, p)
        gain = gain + np.where(harmonics.numbers > 0, lost, 0.0) * self.omega**2  # static parts are about W omega^2
        return np.tile(factors, 2) * known + through @ gain


def _norms(samples: np.ndarray, model: ReducedModel) -> np.ndarray:
    """Return the norm of each harmonic, (..., n_harmonics), of samples (..., SAMPLES, N_H).  Local."""
    squares = np.einsum("...sh,...sh->...h", samples, samples)
    mean, cos, sin = (squares[..., columns] for columns in (model.harmonics.mean, model.harmonics.cos, model.harmonics.sin))
    return np.sqrt(np.concatenate([mean, cos + sin], axis=-1))


def of_samples(
    structure: ReducedStructure,
    rows: np.ndarray,
    direct: np.ndarray,
    own: np.ndarray,
    damping: DampingBeyond,
    coupling: StructuralCoupling | None,
) -> ModesLeftOut:
    """Return what samples tell beside the modes of a structure.  Local.

    Parameters
    ----------
    rows : (3 n_pairs + n_outputs + n_loads, SAMPLES) the samples Z s seen from pairs, outputs and loads
    direct, own : (n_outputs, n_loads), (n_loads,) of W, as kept
    """
    family, n_rows, n_out = structure.one_family, 3 * structure.n_pairs, structure.n_outputs
    # Rayleigh's quotients of the loads: energy x^T K_L^-1 x over x^T W x, without the modes kept
    static = np.diag(structure.load_static) - (family.b**2 / family.omega_n[:, None] ** 2).sum(axis=0)
    squares = np.maximum(static, 0.0) / np.maximum(own, np.finfo(float).tiny)
    effective = np.sqrt(squares[squares > 0.0].min(initial=np.inf))
    omega = np.clip(effective, family.omega_n[-1], 1e3 * family.omega_n[-1])
    return ModesLeftOut(
        float(omega),
        float(family.omega_n[-1]),
        damping,
        rows[:n_rows],
        rows[n_rows : n_rows + n_out],
        rows[n_rows + n_out :],
        direct,
        own,
        structure.out_static - (family.o / family.omega_n**2) @ family.b,
        coupling,
    )


@dataclass(frozen=True)
class BetterModel:
    """The receptance with an exact static residual, and samples of the modes left out; None where none is."""

    structure: ReducedStructure
    left_out: ModesLeftOut | None
    is_solved: bool  # whether it is the very model that is solved

    def on_group(self, own: ReducedStructure, comm: MPI.Comm) -> BetterModel:
        """Return the same for a group of ranks, which solves the model ``own``.  Collective on ``structure.comm``."""
        return replace(self, structure=own if self.is_solved else on_group(self.structure, comm))
