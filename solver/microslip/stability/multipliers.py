"""The multipliers of a point of a curve (docs/theory.md, section 16)."""

from dataclasses import dataclass

import numpy as np

from ..harmonic.balance import HarmonicBalance
from ..harmonic.operating_point import OperatingPoint
from ..points.multipliers import BEYOND, N_MULTIPLIERS
from ..receptance.reduced_model import ReducedModel
from .contact_variation import ContactVariation, contact_variation, joined
from .cycle_map import CycleMap, ModalStep

N_STEPS = 128  # a cycle
NEAR = 0.1  # of the unit circle: truncated motions of random structures change multipliers by less
N_WITHIN = 8  # samples of a step through which the sliders are followed, more closely where one begins or ceases to slip


@dataclass(frozen=True, eq=False)
class Multipliers:
    """The largest multipliers of a periodic motion.  The same on all ranks."""

    values: np.ndarray  # (N_MULTIPLIERS,) complex by falling modulus, zeros where there are fewer
    n_neutral: int  # sliders that never slip: each has the multiplier 1, which is no instability
    stuck: float  # largest modulus while all pairs stick

    @property
    def largest(self) -> float:
        """The largest modulus."""
        return float(np.abs(self.values[0]))

    @property
    def is_doubtful(self) -> bool:
        """Whether the motion has a multiplier so near to 1 that truncation may put it on the wrong side."""
        return abs(self.largest - 1.0) < NEAR and self.largest > self.stuck + BEYOND


def multipliers_at(
    equation: HarmonicBalance, at: OperatingPoint, U: np.ndarray, n_steps: int = N_STEPS, n_within: int = N_WITHIN
) -> Multipliers:
    """Return the multipliers of the periodic motion ``U`` (n_owned, 3, N_H) of this rank's pairs.

    Collective: static columns of the pairs that leave sticking, gathers of the data of their ranks.  Rank 0 computes.
    """
    mine, G = _of_owned(equation, U, n_steps, n_within)
    n_sliders = sum(len(sliders.pair) for sliders in equation.law.sliders) - len(mine.slider_pair)
    own = mine, G, n_sliders
    parts = equation.comm.gather(own) if equation.comm.size > 1 else [own]
    return equation.comm.bcast(parts and _of_parts(equation.model_at(at), at.omega, parts))


def _of_owned(equation: HarmonicBalance, U: np.ndarray, n_steps: int, n_within: int) -> tuple[ContactVariation, np.ndarray]:
    """Return the variation of this rank's pairs, and their rows of G_static, (3 m_owned, 3 m) [m/N].  Collective."""
    first = equation.model.owned.start
    active = equation.contact_forces(U, equation.every_pair, tangents=False).active_owned
    mine = contact_variation(equation.law.take(active), active + first, U[active], equation.harmonics, n_steps, n_within)
    (group,) = equation.model.groups
    pairs = equation.gather(mine.pairs)
    columns = group.receptance.static.G_static.chosen(pairs)
    rows = (3 * (mine.pairs - first)[:, None] + np.arange(3)).ravel()
    return mine, columns.columns(rows).T if len(pairs) else np.zeros((0, 0))


def _of_parts(model: ReducedModel, omega: float, parts: list[tuple[ContactVariation, np.ndarray, int]]) -> Multipliers:
    """Return the multipliers from the data of the ranks' pairs.  Local."""
    contact, modes = joined([mine for mine, _, _ in parts]), model.groups[0].receptance.modes
    R_phi = modes.R_phi[(3 * contact.pairs[:, None] + np.arange(3)).ravel()]
    G = np.concatenate([G for _, G, _ in parts]) - (R_phi / modes.omega_n**2) @ R_phi.T
    computed = CycleMap(omega, modes.omega_n, modes.damping, R_phi, G, contact).multipliers()
    values = np.zeros(N_MULTIPLIERS, dtype=complex)
    values[: len(computed)] = computed
    stuck = np.abs(ModalStep(modes.omega_n, modes.damping, 2.0 * np.pi / omega).multipliers()).max()
    return Multipliers(values, sum(n_sliders for _, _, n_sliders in parts), float(stuck))
