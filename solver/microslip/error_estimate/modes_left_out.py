"""How strongly forces act on the modes left out, without knowing them (docs/theory.md, section 11).

The receptance (4.1) lacks E_n = sum over k > m of phi_k c_kn phi_k^T of the modes left out.  Below their resonances

    E_n ~ (n omega)^2 W,        W = sum over k > m of phi_k phi_k^T / omega_k^4 = Z^T M Z,      Z = K_L^-1 - phi Omega^-2 phi^T,

and W is sampled: with random vectors s of covariance M, W is the mean of (Z s)(Z s)^T.  A few static solutions once, however
many pairs there are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..linear.dense import diagonal_owned, gram, multiply, summed
from ..linear.random_signs import random_signs
from ..receptance.model import ReducedModel
from ..reduction.build import owned_product
from .structural_coupling import StructuralCoupling

if TYPE_CHECKING:
    from ..linear.joint_springs import Linearised
    from ..modes.eigen import Modes

SAMPLES = 32  # random vectors: norms are known to about a quarter
KEY = 20  # of the random vectors
LAST = 3  # modes whose kinetic energy they have
_NEAR = 0.9  # of that frequency: a harmonic above it is taken to lie here


@dataclass(frozen=True)
class ModesLeftOut:
    """The samples Z s seen from pairs, outputs and loads; replicated."""

    omega: float  # rad/s: what the loads move beyond the modes kept vibrates about here, or above
    damping: float  # phi^T C phi of the last mode kept [1/s]
    of_pairs: np.ndarray  # (3 n_pairs, SAMPLES)
    of_outputs: np.ndarray  # (n_outputs, SAMPLES)
    of_loads: np.ndarray  # (n_loads, SAMPLES)
    direct: np.ndarray  # (n_outputs, n_loads) W between outputs and loads, exactly
    own: np.ndarray  # (n_loads,) W of each load with itself, exactly
    residual: np.ndarray  # (n_outputs, n_loads) their static flexibility without the modes kept, exactly [m/N]
    loss_factor: float  # of structural damping; the static part has none
    coupling: StructuralCoupling | None  # of structural damping with a joint

    def gains(self, n_omega: np.ndarray) -> np.ndarray:
        """Return the factor of W in E_n at the frequencies n omega, (n_harmonics,) [1/s2].  Local."""
        s = np.minimum(n_omega / self.omega, _NEAR)
        return np.hypot(n_omega**2, self.damping * n_omega) / (1.0 - s**2)

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
        known = (self.direct @ f[:, first]).T.ravel() * gain[list(harmonics.chosen).index(1)]
        if self.loss_factor > 0.0:  # E_n then holds -i eta times the static flexibility, about W times the square of a frequency
            known = np.abs(known) + self.loss_factor * np.abs(self.residual @ f[:, first]).T.ravel()
            if self.coupling is not None:
                known = known + self.coupling.changes(model, level, omega, p)
            gain = gain + self.loss_factor * self.omega**2 * (harmonics.numbers > 0)
        return np.tile(factors, 2) * np.abs(known) + through @ gain


def _norms(samples: np.ndarray, model: ReducedModel) -> np.ndarray:
    """Return the norm of each harmonic, (..., n_harmonics), of samples (..., SAMPLES, N_H).  Local."""
    squares = np.einsum("...sh,...sh->...h", samples, samples)
    mean, cos, sin = (squares[..., columns] for columns in (model.harmonics.mean, model.harmonics.cos, model.harmonics.sin))
    return np.sqrt(np.concatenate([mean, cos + sin], axis=-1))


def sample_modes_left_out(linearised: Linearised, modes: Modes, model: ReducedModel, eta: float = 0.0) -> ModesLeftOut | None:
    """Return the samples for the modes beyond ``modes``; None where there are none.

    Collective on the system's communicator: ``SAMPLES`` static solves, with a loss factor ``eta`` as many more as modes.
    docs/theory.md, eq. (11.3).
    """
    system, n_rows, n_out = linearised.system, linearised.system.R.shape[0], linearised.system.outputs.shape[0]
    if len(modes.omega_n) == 0 or len(modes.omega_n) == system.n_dof:
        return None
    comm, mass = system.comm, np.maximum(diagonal_owned(linearised.M), 0.0)
    first, last = linearised.K_L.getOwnershipRange()
    # the diagonal of M, scaled to have the kinetic energy of the highest modes kept
    energies = summed(comm, mass @ modes.phi_owned[:, -LAST:] ** 2)
    random = np.sqrt(mass / energies.mean())[:, None] * random_signs(first, last - first, SAMPLES, KEY)
    given = sp.hstack([system.loads, system.outputs.T], format="csr")[first:last].toarray()
    Z_random, Z_given = (beyond_modes(linearised, modes, right_owned) for right_owned in (random, given))
    everything = sp.vstack([system.R, system.outputs, system.loads.T], format="csr")
    rows = owned_product(everything, Z_random, system) / np.sqrt(SAMPLES)
    W = gram(comm, Z_given, multiply(linearised.M, Z_given))
    coupling = structural_coupling(linearised, modes, everything, eta) if eta > 0.0 and n_rows > 0 else None
    return of_samples(rows, W[-n_out:, :-n_out], np.diag(W)[:-n_out], model, eta, coupling)


def of_samples(
    rows: np.ndarray, direct: np.ndarray, own: np.ndarray, model: ReducedModel, eta: float, coupling: StructuralCoupling | None
) -> ModesLeftOut:
    """Return what samples tell beside the modes of a model.  Local.

    Parameters
    ----------
    rows : (3 n_pairs + n_outputs + n_loads, SAMPLES) the samples Z s seen from pairs, outputs and loads
    direct, own : (n_outputs, n_loads), (n_loads,) of W, as kept
    """
    family, n_rows, n_out = model.one_family, 3 * model.n_pairs, model.n_outputs
    # Rayleigh's quotients of the loads: energy x^T K_L^-1 x over x^T W x, without the modes kept
    static = np.diag(model.load_static) - (family.b**2 / family.omega_n[:, None] ** 2).sum(axis=0)
    squares = np.maximum(static, 0.0) / np.maximum(own, np.finfo(float).tiny)
    effective = np.sqrt(squares[squares > 0.0].min(initial=np.inf))
    omega = np.clip(effective, family.omega_n[-1], 1e3 * family.omega_n[-1])
    return ModesLeftOut(
        float(omega),
        float(family.damping.diagonal[-1]),
        rows[:n_rows],
        rows[n_rows : n_rows + n_out],
        rows[n_rows + n_out :],
        direct,
        own,
        model.out_static - (family.o / family.omega_n**2) @ family.b,
        eta,
        coupling,
    )


def structural_coupling(linearised: Linearised, modes: Modes, everything: sp.csr_matrix, eta: float) -> StructuralCoupling:
    """Return how a loss factor couples the modes to those beyond.  Collective: as many static solves as modes."""
    system, phi_owned = linearised.system, modes.phi_owned
    d_owned = eta * (multiply(linearised.K_L, phi_owned) - multiply(system.K, phi_owned))  # eta R^T K_J R phi
    Z_owned = beyond_modes(linearised, modes, d_owned)
    n_rows, n_out = system.R.shape[0], system.outputs.shape[0]
    seen = owned_product(everything, Z_owned, system)
    return StructuralCoupling(
        seen[:n_rows], seen[n_rows : n_rows + n_out], seen[n_rows + n_out :], gram(system.comm, d_owned, Z_owned)
    )


def beyond_modes(linearised: Linearised, modes: Modes, right_owned: np.ndarray) -> np.ndarray:
    """Return Z B = K_L^-1 B - phi Omega^-2 phi^T B, this rank's rows.  Collective: as many static solves as columns."""
    comm = linearised.system.comm
    of_modes = gram(comm, modes.phi_owned, right_owned) / modes.omega_n[:, None] ** 2
    return linearised.factor.solve(right_owned) - modes.phi_owned @ of_modes
