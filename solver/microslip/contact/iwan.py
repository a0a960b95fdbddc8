"""The four-parameter Iwan element of a lumped bolted joint (Segalman 2005): sliders with power-law distributed strengths.

docs/theory.md, section 3, "Iwan joint".  Each tangential direction is a separate element; the normal direction is a spring.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..fourier.harmonics import Harmonics
from .bundle import Bundle, BundleLaw, initial_positions
from .elastic_coulomb import ElasticCoulomb
from .law import SLIP, STICK, ContactCycle
from .parameters import column_with, not_among

SLIDERS = 50  # default number of sliders of the power law
EXPORTED = "in each direction by itself; f_nl,z = k_n du_z"
WEAKEST = 1e-3  # strength relative to the largest one, below which a single slider represents the population
FINER = 4  # factor of the number of sliders in the refined law: twice the density per decade of strength, twice the decades
_COLUMNS = {"slip_force": "F_S", "k_t": "K_T", "k_n": "k_n"}  # columns of the parameters


@dataclass(frozen=True)
class Iwan(BundleLaw):
    """The law of ``n`` pairs, arrays (n,); ValueError if one is out of range."""

    F_S: np.ndarray  # force at gross slip [N], above 0
    K_T: np.ndarray  # tangential stiffness in full stick [N/m], above 0
    k_n: np.ndarray  # normal stiffness [N/m]
    chi: np.ndarray  # exponent of the distribution, between -1 and 0 [-]: loss per cycle ~ force^(3 + chi)
    beta: np.ndarray  # stiffness of the last slider divided by that of all others, at least 0 [-]
    n_sliders: int = SLIDERS
    sampled: bool = False  # the sliders are evaluated at the samples only
    w0: np.ndarray | None = None  # (n, n_sliders + 1, 2) initial slider positions [m]; None: 0
    weakest: float = WEAKEST
    bundle: Bundle = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name, least in (("F_S", 0.0), ("K_T", 0.0), ("k_n", None), ("chi", -1.0), ("beta", None)):
            values = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if np.any(values < 0.0 if least is None else values <= least):
                raise ValueError(f"{name} of pair {np.nanargmin(values)} is {np.nanmin(values):g}, too small")
            object.__setattr__(self, name, values)
        object.__setattr__(self, "bundle", self._sliders())

    @property
    def n_pairs(self) -> int:
        """The number of pairs."""
        return len(self.K_T)

    @cached_property
    def stiffness(self) -> np.ndarray:
        """The springs K_J in full stick: K_T, K_T, k_n, (n, 3) [N/m]."""
        return np.stack([self.K_T, self.K_T, self.k_n], axis=1)

    @cached_property
    def phi_max(self) -> np.ndarray:
        """Displacement at gross slip, (n,) [m]: docs/theory.md, eq. (3.13)."""
        return self.F_S * (1.0 + self.beta) / (self.K_T * (self.beta + (self.chi + 1.0) / (self.chi + 2.0)))

    @property
    def springs(self) -> np.ndarray:
        """The springs of a pair in contact, (n, 3) [N/m], equal to K_J."""
        return self.stiffness

    def take(self, indices: np.ndarray | slice) -> Iwan:
        """Return the law of some pairs: an index array, a mask or a slice.  Local."""
        names = ("F_S", "K_T", "k_n", "chi", "beta", "w0")
        return replace(self, **{name: getattr(self, name)[indices] for name in names if getattr(self, name) is not None})

    def followed(self, path: bool) -> Iwan:
        """Return the law whose sliders follow the path between samples, or are evaluated at the samples only.  Local."""
        return replace(self, sampled=not path)

    @cached_property
    def refined(self) -> Iwan:
        """The law with :data:`FINER` times the sliders; initial positions are interpolated in the strength."""
        finer = replace(self, n_sliders=FINER * self.n_sliders, weakest=self.weakest**2, w0=None)
        if self.w0 is None or not self.w0.any():
            return finer
        of_old, of_new = (law.bundle.of_elements(law.bundle.elements.mu / law.bundle.elements.k_t) for law in (self, finer))
        w0 = np.empty((self.n_pairs, finer.bundle.size, 2))
        for i, direction in np.ndindex(self.n_pairs, 2):
            w0[i, :, direction] = np.interp(of_new[i], of_old[i], self.w0[i, :, direction])
        return replace(finer, w0=np.clip(w0, -of_new[:, :, None], of_new[:, :, None]))

    def _sliders(self) -> Bundle:
        """Return the sliders of eq. (3.14), exact in stiffness and force for each interval of strengths, and the last slider."""
        ends = np.concatenate([[0.0], self.weakest ** np.linspace(1.0, 0.0, self.n_sliders)])
        chi, weak = self.chi[:, None], (self.K_T / (1.0 + self.beta))[:, None]
        k = np.column_stack([weak * np.diff(ends ** (chi + 1.0), axis=1), self.K_T - weak[:, 0]])
        weights = (chi + 1.0) / (chi + 2.0) * np.diff(ends ** (chi + 2.0), axis=1)
        strength = self.phi_max[:, None] * np.column_stack([weak * weights, k[:, -1]])
        none = np.zeros(k.size)
        separate = np.ones(k.size, dtype=bool)
        w0 = np.zeros(2) if self.w0 is None else self.w0.reshape(-1, 2)
        elements = ElasticCoulomb(strength.ravel(), none + 1.0, k.ravel(), none, separate, w0, sampled=self.sampled)
        return Bundle(elements, k.shape[1])

    # -- forces ------------------------------------------------------------------------------------------------

    def cycle(self, U: np.ndarray, n_samples: int, tangents: bool = True, harmonics: Harmonics | None = None) -> ContactCycle:
        """Return the harmonics of p under the periodic motion ``U`` (n, 3, N_H) [m], with their exact derivative.

        Local.  docs/theory.md, eq. (3.10) for the sliders of this law; p_z is 0.
        """
        if self.n_pairs != len(U):
            raise ValueError(f"harmonics of {len(U)} pairs with the law of {self.n_pairs}")
        return self.bundle.cycle(U, n_samples, tangents, harmonics)

    def step(self, du: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p and internal variables after a step to ``du`` (..., n, 3), d p / d du (..., n, 3, 3), and the states.

        Local.  Both ``before`` and the result are (..., n, 3 + n_memory).
        """
        force, derivative, slips, memory = self.bundle.step(du, before[..., 3:])
        L = np.zeros((*du.shape, 3))
        L[..., :2, :] = derivative
        after = np.concatenate([force, np.zeros_like(force[..., :1]), memory], axis=-1)
        return after, L, np.where(slips, SLIP, STICK).astype(np.uint8)

    def memoryless_rate(self, du: np.ndarray) -> np.ndarray:
        """Return d p / d du of the history-independent part of p, (..., n, 3) [N/m]: zero for this law.  Local."""
        return np.zeros(du.shape)

    # -- its parameters ----------------------------------------------------------------------------------------

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters that vary."""
        return tuple(_COLUMNS)

    def with_parameters(self, name: str, pairs: np.ndarray, values: np.ndarray) -> Iwan:
        """Return the law with new values of slip_force, k_t or k_n for some pairs.  Local.  ValueError as in :class:`Law`."""
        column = self._column(name)
        changed: dict[str, Any] = {column: column_with(getattr(self, column), pairs, values)}
        return replace(self, **changed)

    def parameter_rate(self, name: str, U: np.ndarray, n_samples: int, harmonics: Harmonics | None = None) -> np.ndarray:
        """Return d p / d parameter of each pair under the motion ``U`` (n, 3, N_H), (n, 3, N_H).

        Local.  Friction limits of the sliders are proportional to F_S and independent of K_T; their stiffnesses are proportional
        to K_T; p does not depend on k_n.
        """
        column, elements = self._column(name), self.bundle.elements
        if name == "k_n":
            return np.zeros_like(U)
        of_elements = "mu" if name == "slip_force" else "k_t"
        per_pair = getattr(elements, of_elements) / np.repeat(getattr(self, column), self.bundle.size)
        return self.bundle.parameter_rate(of_elements, per_pair, U, n_samples, harmonics)

    @staticmethod
    def _column(name: str) -> str:
        if name not in _COLUMNS:
            raise not_among(name, "the Iwan joint", tuple(_COLUMNS))
        return _COLUMNS[name]

    # -- its limits --------------------------------------------------------------------------------------------

    def slip_safety(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the factor by which motions may grow while all sliders of each pair certainly stick, (..., n).  Local."""
        return self.bundle.slip_safety(amplitudes, 0)

    def utilisation(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return the utilisation of the slip force in full stick, (..., n).  Local."""
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.maximum(self.F_S - self.bundle.held_at_rest, 0.0)
            return np.nan_to_num(self.K_T * np.hypot(amplitudes[..., 0], amplitudes[..., 1]) / left, nan=0.0, posinf=np.inf)

    def slipping_share(self, amplitudes: np.ndarray, of_limit: float = 1.0) -> np.ndarray:
        """Return an upper bound of |p| / stuck force, (..., n, 3).  Local."""
        weights = self.bundle.slipping_share(amplitudes, of_limit)
        return np.stack([weights, weights, np.zeros_like(weights)], axis=-1)

    def keeps_half_wave_symmetry(self, moves: np.ndarray) -> np.ndarray:
        """Return which pairs keep half-wave symmetry if the components ``moves`` (n, 3) move, (n,); see :class:`Law`.  Local.

        These are the pairs without friction force at rest.
        """
        return self.bundle.held_at_rest == 0.0

    # -- another rest ------------------------------------------------------------------------------------------

    def about(self, du: np.ndarray, memory: np.ndarray) -> Iwan:
        """Return the law about the final state of a march: ``du`` (n, 3) and the internal variables (n, n_memory).  Local.

        docs/theory.md, eq. (12.10): the initial position of each slider is minus its stretch in this state.
        """
        return replace(self, w0=-self.bundle.stretch(du, memory))


# -- of the columns of pairs ---------------------------------------------------------------------------------------


def limit(columns: Mapping[str, np.ndarray], N: np.ndarray | None = None) -> np.ndarray:
    """Return F_S of pairs [N], independent of the normal forces ``N``; mu N0 for pairs from a CSV file.  Local."""
    return np.where(np.isnan(columns["slip_force"]), columns["mu"] * columns["N0"], columns["slip_force"])


def of_columns(columns: Mapping[str, np.ndarray]) -> Iwan:
    """Return the law of pairs with these columns, (n,) each.  Local."""
    F_S = limit(columns)
    k_n, chi, beta = (columns[name] for name in ("k_n", "chi", "beta"))
    n_sliders = int(columns["sliders"][0])
    return Iwan(F_S, columns["k_t"], k_n, chi, beta, n_sliders=n_sliders, w0=initial_positions(columns, n_sliders + 1))


def about_rest(columns: Mapping[str, np.ndarray], du: np.ndarray, memory: np.ndarray) -> dict[str, np.ndarray | None]:
    """Return the columns that change about the final state of a march.  Local."""
    return {"w0": of_columns(columns).about(du, memory).w0}


def on_area(keys: Mapping[str, Any], area: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of pairs from a joint's keys per area and the areas (n,); pairs divide its slip force.  Local."""
    k_t, k_n = (keys[name] * area for name in ("tangential_stiffness", "normal_stiffness"))
    slip_force = keys["slip_force"] * area / area.sum()
    return {"mu": np.full_like(area, np.nan), "N0": np.full_like(area, np.nan), "k_t": k_t, "k_n": k_n, "slip_force": slip_force}


def law_columns(keys: Mapping[str, Any]) -> dict[str, float]:
    """Return the columns beyond those of elastic-Coulomb friction, the same for all pairs of a joint.  Local."""
    return {"slip_force": np.nan, "chi": keys["chi"], "beta": keys["beta"], "sliders": keys["sliders"] or SLIDERS}
