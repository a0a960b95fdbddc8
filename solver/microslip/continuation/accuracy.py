"""Harmonics, samples, Newton's tolerance and steps from the requested accuracy (docs/theory.md, section 11).

At every point the error bar estimates the effect of more harmonics, more samples and a smaller residual.  Where that exceeds its
share of the accuracy the point is solved again with more, starting from itself; where it is far below for some points, the next
points have fewer.  The step along the branch follows from the error of a straight line between the points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..fourier.harmonics import Harmonics
from ..harmonic.balance import HarmonicBalance
from ..harmonic.symmetry import symmetric
from ..points.error_parts import PARTS
from .settings import ResponseSettings
from .steps import ArcLength

MOST_HARMONICS, MOST_SAMPLES = 31, 4096
LEAST_SAMPLES = 64  # fewer cost as much
PER_HARMONIC = 4  # samples a harmonic, at least
FAINT_OUTPUT = 1e-3  # of the largest output: fainter ones are judged against that
LOW = {"harmonics": 0.05, "samples": 0.2, "solver": 0.2}  # share of the allowed error, below which coarser is enough
IN_A_ROW = 3  # points in a row
MUST_PAY, PAYS = 9, 0.8  # harmonics from which more of them must reduce the ratio to this share; by 1 / H^2 it would be 0.67
SHARES = {"harmonics": 0.4, "samples": 0.15, "solver": 0.1}  # of the accuracy; estimates may be half of the true error
BOTH = SHARES["harmonics"] + SHARES["samples"]  # together: samples may use the unused part of the harmonics' share
TOLERANCE = 1e-2  # of Newton, times the accuracy
STEP = 0.5  # share of the accuracy for the straight line between two points
LEAST_STRETCH, MOST_STRETCH = 0.5, 2.0  # bounds of the change from one step to the next
LONGEST = 0.1  # step, in the relative norm


@dataclass(frozen=True)
class Resolution:
    """Harmonics and samples of a point, and the tolerance of its residual."""

    harmonics: Harmonics
    n_samples: int
    tolerance: float = 1e-8

    def with_highest(self, H: int, same_samples: bool = False) -> Resolution:
        """Return the resolution with harmonics up to H, and at least the samples that they need, unless ``same_samples``."""
        odd = all(n % 2 for n in self.harmonics.chosen)
        harmonics = Harmonics.odd_up_to(H) if odd else Harmonics.up_to(H)
        n_samples = self.n_samples if same_samples else max(self.n_samples, least_samples(H))
        return replace(self, harmonics=harmonics, n_samples=n_samples)


def samples_from(least: float) -> int:
    """Return the next number of samples in use: powers of two, and halfway between two of them."""
    power = 2 ** int(np.ceil(np.log2(least)))
    return power - power // 4 if power - power // 4 >= least else power


def least_samples(H: int) -> int:
    """Return the smallest number of samples that the program chooses for harmonics up to H: a power of two."""
    return max(LEAST_SAMPLES, 2 ** int(np.ceil(np.log2(PER_HARMONIC * (H + 1)))))


@dataclass(frozen=True, eq=False)
class Memory:
    """Data for the choice of resolution along a branch; the same on every rank."""

    peak: np.ndarray | None = None  # (n_outputs,) largest amplitude so far [m]
    calm: Mapping[str, int] = field(default_factory=lambda: dict.fromkeys(SHARES, 0))  # points in a row, by part
    patience: Mapping[str, int] = field(default_factory=lambda: dict.fromkeys(SHARES, IN_A_ROW))
    ceiling: int = MOST_HARMONICS  # no more harmonics than these, while more of them do not reduce the error bar
    raised: tuple[int, float] | None = None  # harmonics and their ratio at this point before they were raised

    def after_too_few(self, part: str) -> Memory:
        """Return the memory after a resolution that was too low: it will be lowered more slowly.  Local."""
        patience = min(2 * self.patience[part], 48)
        return replace(self, calm={**self.calm, part: 0}, patience={**self.patience, part: patience})

    def after_raising(self, ratio: float = np.inf) -> Memory:
        """Return the memory after harmonics were raised, now with this ratio, or without success: Newton's method failed.  Local.

        Where the mean slip is nearly free, the bar stays large with any number of harmonics, and only the cost grows.
        """
        if self.raised is None or self.raised[0] < MUST_PAY or ratio <= max(1.0, PAYS * self.raised[1]):
            return self
        return replace(self, ceiling=min(self.ceiling, self.raised[0]))


@dataclass(frozen=True, eq=False)
class Accuracy:
    """How the resolution of a branch follows from the requested accuracy.  Local; its state is a `Memory`.

    Parameters
    ----------
    target : the requested accuracy, relative to the peak of each output
    coarsest : with which a branch starts, and below which it never goes
    keeps : parts whose resolution the scene states
    chooses_steps : whether the step length follows from the accuracy, or from the number of points that the scene states
    tightest : tolerance of a point whose residual matters
    is_corrected : whether it counts for the corrected amplitude, and its remaining bar
    """

    target: float
    coarsest: Resolution
    keeps: frozenset[str] = frozenset()
    chooses_steps: bool = True
    tightest: float = 1e-8
    is_corrected: bool = False

    def allowed(self, peak: np.ndarray) -> np.ndarray:
        """Return the error that each output may have [m]."""
        return self.target * np.maximum(peak, FAINT_OUTPUT * peak.max(initial=0.0))

    def ratios(self, amplitude: np.ndarray, error: np.ndarray, memory: Memory) -> tuple[dict[str, float], Memory]:
        """Return each part relative to the allowed error, the largest of the outputs.

        ``amplitude`` (n_outputs,) [m]; ``error`` are the parts of the bar that counts, (n_outputs, n_parts) [m].
        """
        peak = amplitude if memory.peak is None else np.maximum(memory.peak, amplitude)
        allowed, shares = self.allowed(peak), {}
        used = np.minimum(error[:, PARTS.index("harmonics")], SHARES["harmonics"] * allowed)
        for part, share in SHARES.items():
            values, most = error[:, PARTS.index(part)], BOTH * allowed - used if part == "samples" else share * allowed
            over = np.divide(values, most, out=np.zeros_like(values), where=allowed > 0.0)
            shares[part] = float(np.nan_to_num(over, nan=np.inf).max(initial=0.0))  # an undefined bar
        return shares, replace(memory, peak=peak)

    def finer(self, now: Resolution, ratios: dict[str, float], memory: Memory) -> tuple[Resolution | None, Memory]:
        """Return the resolution for solving the point again; None if it is sufficient or the finest."""
        if not ratios:
            return None, memory
        resolution, H, memory = now, now.harmonics.highest, memory.after_raising(ratios["harmonics"])
        most = min(memory.ceiling, (now.n_samples - 1) // 2) if "samples" in self.keeps else memory.ceiling
        if ratios["harmonics"] > 1.0 and "harmonics" not in self.keeps and H + 2 <= most:
            grown = int(np.clip(np.ceil(H * np.sqrt(ratios["harmonics"])), H + 2, 2 * H + 1))
            resolution = resolution.with_highest(min(grown + (grown - H) % 2, most - (most - H) % 2), "samples" in self.keeps)
            memory = replace(memory.after_too_few("harmonics"), raised=(H, ratios["harmonics"]))
        if ratios["samples"] > 1.0 and "samples" not in self.keeps and now.n_samples < MOST_SAMPLES:
            grown = samples_from(now.n_samples * min(ratios["samples"], 8.0))
            resolution = replace(resolution, n_samples=min(max(grown, resolution.n_samples), MOST_SAMPLES))
            memory = memory.after_too_few("samples")
        if ratios.get("solver", 0.0) > 1.0:
            tighter, memory = self.tighter(resolution, memory)
            resolution = tighter or resolution
        return (resolution if resolution != now else None), memory

    def tighter(self, now: Resolution, memory: Memory) -> tuple[Resolution | None, Memory]:
        """Return the resolution with the tightest tolerance; None if it has that, or if the scene states a tolerance."""
        if "solver" in self.keeps or now.tolerance <= self.tightest:
            return None, memory
        return replace(now, tolerance=self.tightest), memory.after_too_few("solver")

    def coarser(self, now: Resolution, ratios: dict[str, float], memory: Memory) -> tuple[Resolution, Memory]:
        """Return the resolution of the point after one with sufficient accuracy."""
        if not ratios:
            return now, memory
        calm = {part: memory.calm[part] + 1 if ratios[part] < LOW[part] else 0 for part in SHARES}
        resolution, H = now, now.harmonics.highest
        is_calm = {part: part not in self.keeps and calm[part] >= memory.patience[part] for part in SHARES}
        if is_calm["harmonics"] and H - 2 >= self.coarsest.harmonics.highest:
            resolution = resolution.with_highest(H - 2, "samples" in self.keeps)
        elif H > memory.ceiling:
            resolution = resolution.with_highest(memory.ceiling, "samples" in self.keeps)
        ceiling = memory.ceiling if ratios["harmonics"] > 1.0 else MOST_HARMONICS
        least = max(self.coarsest.n_samples, least_samples(resolution.harmonics.highest))
        fewer = samples_from(0.5 * now.n_samples)
        if is_calm["samples"] and fewer >= least:
            resolution = replace(resolution, n_samples=fewer)
        if is_calm["solver"]:
            resolution = replace(resolution, tolerance=self.coarsest.tolerance)
        calm = {part: 0 if is_calm[part] else calm[part] for part in SHARES}
        return resolution, replace(memory, calm=calm, ceiling=ceiling, raised=None)

    def stretch(self, responses: list[np.ndarray], steps: tuple[float, float], memory: Memory) -> float:
        """Return the factor from the last step to the next, from the amplitudes (n_outputs,) at the last three points."""
        before, now, after = responses
        error = chord_error(before, now, after, steps)
        allowed = STEP * self.allowed(np.abs(responses).max(axis=0) if memory.peak is None else memory.peak)
        worst = float(np.divide(error, allowed, out=np.zeros_like(error), where=allowed > 0.0).max(initial=0.0))
        return float(np.clip(worst**-0.5 if worst > 0.0 else MOST_STRETCH, LEAST_STRETCH, MOST_STRETCH))


def accuracy_of(settings: ResponseSettings, equation: HarmonicBalance, linear: bool = False) -> Accuracy | None:
    """Return the control of the accuracy on a branch; None if none is requested, or the whole resolution is stated.

    Collective.  A level known to be ``linear`` moves in the harmonics of its loads, whatever the symmetry,
    which takes static columns to find out.
    """
    keeps, target, harmonics = settings.keeps, settings.accuracy, equation.harmonics
    if target is None or ({"harmonics", "samples"} <= keeps and not settings.chooses_steps):
        return None
    if "harmonics" not in keeps:
        H = settings.loaded
        harmonics = Harmonics.odd_up_to(H) if not linear and symmetric(equation) else Harmonics.up_to(H)
    n_samples = settings.samples if "samples" in keeps else least_samples(harmonics.highest)
    loosest = settings.tolerance if "solver" in keeps else max(TOLERANCE * target, settings.tolerance)
    coarsest = Resolution(harmonics, n_samples, loosest)
    return Accuracy(target, coarsest, keeps, settings.chooses_steps, settings.tolerance, settings.is_corrected)


def steps_for(target: float) -> ArcLength:
    """Return the step lengths of a branch: on a circle, a resonance, a chord of c diameters strays by c^2 / 4 of them."""
    ds = min(2.0 * np.sqrt(STEP * target), LONGEST)
    return ArcLength(ds=ds, ds_min=ds / 1024.0, ds_max=min(8.0 * ds, LONGEST))


def chord_error(before: np.ndarray, now: np.ndarray, after: np.ndarray, steps: tuple[float, float]) -> np.ndarray:
    """Return how far curves stray from the straight line between their last two points, from the last three.  Local.

    ``steps`` are the arc lengths between them.  A parabola of second derivative c strays by c h^2 / 8 over a length h.
    """
    a, b = steps
    return np.abs(((after - now) / b - (now - before) / a) * 2.0 / (a + b)) * b**2 / 8.0
