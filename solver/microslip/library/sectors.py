"""Results by sector of a disc whose sectors may differ, compared with the same disc with alike sectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..fourier.coefficients import amplitude
from ..parallel.agree import on_root
from ..points.branch import Branch, Point
from ..points.peak import Peak, top_of_curve
from ..results.table import write_table
from .build import WholeStructure
from .follow_response import follow
from .prepare import Prepared, prepare

FILE = "sectors.csv"
COLUMNS = ("level", "sector", "peak", "frequency_Hz", "amplification", "friction_J")


@dataclass(frozen=True, eq=False)
class LevelBySector:
    """One level: the largest amplitude of harmonic 1 of the first output in each sector; alike sectors have one."""

    level: float
    peak: np.ndarray  # (N,) in the output's unit
    frequency: np.ndarray  # (N,) Hz, of each
    friction: np.ndarray  # (N,) J, friction loss of the pairs of each sector, a cycle, at the peak of the sector that moves most
    alike: float  # peak of the disc with alike sectors

    @property
    def amplification(self) -> np.ndarray:
        """The peaks over that of alike sectors, (N,)."""
        return self.peak / self.alike

    @property
    def localisation(self) -> float:
        """Share of the sector that moves most in the sum of squares of the peaks: 1/N to 1."""
        return float(self.peak.max() ** 2 / np.sum(self.peak**2))

    def in_words(self) -> str:
        """Return a line for the log."""
        N, most = len(self.peak), int(np.argmax(self.peak))
        return (
            f"sectors at {self.level:g}: sector {most} moves most, {self.peak[most]:.4e} at {self.frequency[most]:.6g} Hz, "
            f"{self.amplification[most]:.4g} times alike sectors ({self.alike:.4e}; Whitehead's bound of one family of modes, "
            f"(1 + sqrt(N)) / 2 = {whitehead(N):.3g}); {100.0 * self.localisation:.3g} % of the sum of squares of all peaks"
        )


def whitehead(N: int) -> float:
    """Return the largest amplification in a linear disc of N blades with one family of modes.  Local."""
    return 0.5 * (1.0 + float(np.sqrt(N)))


def levels_by_sector(prepared: Prepared, branches: Sequence[Branch]) -> list[LevelBySector] | None:
    """Return the results of all levels by sector, on rank 0; None elsewhere.

    Collective: the response of alike sectors at the same levels, with solved peaks and without error bars.

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : on every rank
    """
    structure = prepared.structure
    assert isinstance(structure, WholeStructure), "a whole disc"
    of_alike = prepare(structure.alike, has_bars=False).response
    settings = replace(of_alike.settings, peaks=1 in of_alike.model.harmonics, stability=False, sensitivities=False)
    alike = follow(replace(of_alike, settings=settings))
    N, n_outputs = structure.waves.n_sectors, len(prepared.scene.outputs)
    return on_root(prepared.model.comm, _by_sector, branches, alike, N, n_outputs, share=False)


def _by_sector(branches: Sequence[Branch], alike: Sequence[Branch], N: int, n_outputs: int) -> list[LevelBySector]:
    """Return the results of the levels that have points.  Rank 0."""
    levels = []
    for branch, other in zip(branches, alike):
        if not (branch.points and other.points):
            continue
        omega = np.array([point.omega for point in branch.points])
        sizes = np.array([amplitude(point.response[::n_outputs]) for point in branch.points])  # (n_points, N)
        tops = np.array([top_of_curve(omega, of_sector) for of_sector in sizes.T])
        most = branch.points[int(np.argmax(sizes[:, np.argmax(tops[:, 1])]))]
        levels.append(
            LevelBySector(
                level=branch.level,
                peak=tops[:, 1],
                frequency=tops[:, 0] / (2.0 * np.pi),
                friction=most.energy.reshape(N, -1).sum(axis=1),
                alike=max(_largest(point) for point in (*other.points, *(other.peaks or ()))),
            )
        )
    return levels


def _largest(at: Point | Peak) -> float:
    """Return the amplitude of the first output; 0 at a peak of another one.  Local."""
    if isinstance(at, Peak):
        return abs(at.amplitude) if at.output == 0 else 0.0
    return float(amplitude(at.response[0]))


def write_by_sector(levels: Sequence[LevelBySector], folder: Path) -> None:
    """Write a row for each level and sector.  Rank 0.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    rows = (
        [f"{each.level:.10g}", s, *(f"{value:.10g}" for value in row)]
        for each in levels
        for s, row in enumerate(zip(each.peak, each.frequency, each.amplification, each.friction))
    )
    write_table(str(folder / FILE), COLUMNS, rows)
