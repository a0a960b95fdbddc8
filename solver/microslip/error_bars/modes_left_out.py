"""How strongly forces act on the modes left out, without knowing them (docs/theory.md, eq. 10.4).

The receptance (4.1) lacks E_n = sum over k > m of phi_k c_kn phi_k^T of the modes left out.  Below their resonances

    E_n ~ (n omega)^2 W,        W = sum over k > m of phi_k phi_k^T / omega_k^4 = Z^T M Z,      Z = K_L^-1 - phi Omega^-2 phi^T,

and W is sampled: with random vectors s of covariance M, W is the mean of (Z s)(Z s)^T.  A few static solutions once, however
many pairs there are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..linear.dense import diagonal_owned, summed
from ..reduction.build import owned_product
from ..reduction.model import ReducedModel

SAMPLES = 32            # random vectors: norms are known to about a quarter
_NEAR = 0.9             # of the last mode kept: a harmonic above it is taken to lie there


@dataclass(frozen=True)
class ModesLeftOut:
    """The samples Z s seen from pairs, outputs and loads; replicated."""

    omega_m: float              # rad/s, the last mode kept
    damping: float              # phi_m^T C phi_m of that mode [1/s]
    of_pairs: np.ndarray        # (3 n_pairs, SAMPLES)
    of_outputs: np.ndarray      # (n_outputs, SAMPLES)
    of_loads: np.ndarray        # (n_loads, SAMPLES)

    def gains(self, n_omega: np.ndarray) -> np.ndarray:
        """Return the factor of W in E_n at the frequencies n omega, (n_harmonics,) [1/s2].  Local."""
        s = np.minimum(n_omega / self.omega_m, _NEAR)
        return np.hypot(n_omega**2, self.damping * n_omega) / (1.0 - s**2)

    def changes(self, weights: np.ndarray, forces: np.ndarray, model: ReducedModel, omega: float) -> np.ndarray:
        """Return what the modes left out would change at most in some quantities, (n_quantities,).  Local.

        Cauchy and Schwarz, harmonic by harmonic.

        Parameters
        ----------
        weights : (n_quantities, SAMPLES, N_H) samples of what each quantity feels
        forces : (SAMPLES, N_H) samples of the forces
        """
        gain = self.gains(omega * model.harmonics.numbers)
        return (_norms(weights, model) * _norms(forces, model)) @ gain


def _norms(samples: np.ndarray, model: ReducedModel) -> np.ndarray:
    """Return the norm of each harmonic, (..., n_harmonics), of samples (..., SAMPLES, N_H).  Local."""
    widths = [1 if n == 0 else 2 for n in model.harmonics.numbers]
    starts = np.concatenate([[0], np.cumsum(widths)[:-1]])
    return np.sqrt(np.add.reduceat((samples**2).sum(axis=-2), starts, axis=-1))


def sample_modes_left_out(linearised, modes, model: ReducedModel) -> ModesLeftOut | None:
    """Return the samples for the modes beyond ``modes``; None where there are none.

    Collective on the system's communicator: ``SAMPLES`` static solves.
    """
    system, phi_owned = linearised.system, modes.phi_owned
    if len(modes.omega_n) == 0 or len(modes.omega_n) == system.n_dof:
        return None
    comm, mass = system.comm, np.maximum(diagonal_owned(linearised.M), 0.0)
    first, _ = linearised.K_L.getOwnershipRange()
    # the diagonal of M, scaled to have the kinetic energy of the highest modes kept
    of_modes = summed(comm, mass @ phi_owned[:, -3:] ** 2)
    S_owned = np.sqrt(mass / of_modes.mean())[:, None] * signs(first, len(mass))
    Z_owned = linearised.factor.solve(S_owned)
    Z_owned -= phi_owned @ (summed(comm, phi_owned.T @ S_owned) / modes.omega_n[:, None] ** 2)
    everything = sp.vstack([system.R, system.outputs, system.loads.T], format="csr")
    rows = owned_product(everything, Z_owned, system) / np.sqrt(SAMPLES)
    n_rows, n_out = system.R.shape[0], system.outputs.shape[0]
    damping = model.C if model.C.ndim == 1 else np.diag(model.C)
    return ModesLeftOut(float(modes.omega_n[-1]), float(damping[-1]), rows[:n_rows], rows[n_rows: n_rows + n_out],
                        rows[n_rows + n_out:])


def signs(first: int, n: int) -> np.ndarray:
    """Return random signs of rows ``first`` to ``first + n``, (n, SAMPLES): the same whatever rank owns a row.  Local."""
    generator = np.random.Philox(key=20)
    generator.advance(first // 4)                       # four words of 64 bits a step of the counter
    words = generator.random_raw(first % 4 + n)[first % 4:]
    bits = (words[:, None] >> np.arange(SAMPLES, dtype=np.uint64)) & np.uint64(1)
    return 1.0 - 2.0 * bits.astype(float)
