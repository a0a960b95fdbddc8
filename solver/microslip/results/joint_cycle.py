"""The pairs of a joint during a cycle: pressure, friction force, sliding.  NumPy only; every function is local."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fourier.coefficients import synthesise
from .record import Joint, LevelResult
from .sensitivities import relative_of_pairs

SAMPLES = 128  # of a cycle, from which largest values are taken


@dataclass(frozen=True, eq=False)
class JointCycle:
    """Samples of a cycle, each (n_pairs, N_t)."""

    normal_force: np.ndarray  # N, compression above 0; with the preload where it is known
    friction_force: np.ndarray  # (n_pairs, 2, N_t) N along x and y of the pairs; with that at rest
    slip: np.ndarray  # (n_pairs, 2, N_t) m, slip since rest: du without the deformation of the springs
    du: np.ndarray  # (n_pairs, 3, N_t) m

    def pressure(self, area: np.ndarray) -> np.ndarray:
        """Return the contact pressure, (n_pairs, N_t) [Pa]; NaN where the area is not known."""
        return self.normal_force / area[:, None]

    @property
    def slip_amplitude(self) -> np.ndarray:
        """The largest distance of the slider from its middle, (n_pairs,) [m]."""
        middle = 0.5 * (self.slip.max(axis=2) + self.slip.min(axis=2))
        return np.hypot(*np.moveaxis(self.slip - middle[:, :, None], 1, 0)).max(axis=1)


def joint_cycle(joint: Joint, level: LevelResult, at: int, n_samples: int = SAMPLES) -> JointCycle:
    """Return the cycle of the pairs at point ``at`` of a level, sampled; read with motion.

    docs/theory.md, eq. (1.3): f_nl = K_J du + p, measured from rest; a pair that is open at rest has no springs.  The normal
    force is N0 - f_nl,z, at least 0: a sum of harmonics swings a little beyond.
    """
    du, p = synthesise(level.du[at], n_samples), synthesise(level.p[at], n_samples)
    k_t, k_n = (np.nan_to_num(k)[:, None] for k in (joint.k_t, joint.k_n))
    sprung = 1.0 - joint.open_at_rest[:, None]
    at_rest = np.maximum(np.nan_to_num(joint.N0), 0.0)[:, None]
    stretch = np.divide(p[:, :2], k_t[:, None], out=np.zeros_like(p[:, :2]), where=k_t[:, None] > 0.0)
    slip = np.where(sprung[:, None] > 0.0, -stretch, du[:, :2] - stretch)
    return JointCycle(
        normal_force=np.maximum(at_rest - sprung * k_n * du[:, 2] - p[:, 2], 0.0),
        friction_force=joint.T0[:, :, None] + (sprung * k_t)[:, None] * du[:, :2] + p[:, :2],
        slip=slip,
        du=du,
    )


def joint_values(joint: Joint, level: LevelResult, at: int) -> dict[str, np.ndarray]:
    """Return the quantities of a joint map at point ``at`` of a level, (n_pairs,) each, by a name with its unit.

    Per area where areas are known.  Names are those of files for ParaView.
    """
    cycle = joint_cycle(joint, level, at)
    values = {
        "state": level.state[at].astype(float),
        "slip_amplitude_m": cycle.slip_amplitude,
        "friction_loss_J": np.where(level.p[at].any(axis=(1, 2)), np.maximum(level.energy[at], 0.0), 0.0),  # else rounding
        "normal_force_N": cycle.normal_force.mean(axis=1),
    }
    if joint.has_areas:
        pressure = cycle.pressure(joint.area)
        values["friction_loss_J_m2"] = values["friction_loss_J"] / joint.area
        values |= {"pressure_Pa": pressure.mean(axis=1), "pressure_min_Pa": pressure.min(axis=1)}
        values |= {"pressure_max_Pa": pressure.max(axis=1)}
    return values | {f"sensitivity_{name}": change for name, change in relative_of_pairs(joint, level, at).items()}


def rest_values(joint: Joint) -> dict[str, np.ndarray]:
    """Return the forces of the joint at rest, (n_pairs,) each, as :func:`joint_values`."""
    N = np.maximum(np.nan_to_num(joint.N0), 0.0)
    values = {"normal_force_at_rest_N": N}
    if joint.has_areas:
        values["pressure_at_rest_Pa"] = N / joint.area
    return values | {"friction_force_at_rest_N": np.hypot(*joint.T0.T), "open_at_rest": joint.open_at_rest.astype(float)}
