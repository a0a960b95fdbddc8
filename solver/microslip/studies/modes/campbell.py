"""Frequencies against speed of rotation: families of modes and their engine-order crossings (docs/theory.md, section 12)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from mpi4py import MPI
from scipy.optimize import linear_sum_assignment

from ...linear.dense import gram
from ...observe.screen_table import screen_table
from ...results.style import BOXED, FAINT, INK, RC, SERIES_COLOURS, WIDTH, Page, Titled
from ...system.files import make_folder
from ..records import cell, write_csv

ORDERS = 6  # default number of engine orders


@dataclass(frozen=True, eq=False)
class Campbell:
    """Families of modes: each row of ``frequency`` is one family at all speeds."""

    speed: np.ndarray  # (n_speeds,) rad/s, ascending
    frequency: np.ndarray  # (n_families, n_speeds) Hz
    power: int = 2  # p: f^p is linear in Omega^p between two speeds; 1 with Coriolis forces

    def records(self) -> list[dict[str, float]]:
        """Return one record per speed, by the names of the columns of campbell.csv."""
        return [
            {"speed_rad_s": float(speed), "speed_rpm": float(speed) * 30.0 / np.pi}
            | {f"family_{i}_Hz": float(f) for i, f in enumerate(frequency, 1)}
            for speed, frequency in zip(self.speed, self.frequency.T)
        ]


@dataclass(frozen=True)
class Crossing:
    """A speed at which an engine order excites a family of modes."""

    family: int  # from 1
    order: int
    speed: float  # rad/s
    frequency: float  # Hz


def follow_families(comm: MPI.Comm, phi_owned: np.ndarray, M_phi_owned: np.ndarray) -> np.ndarray:
    """Return for each earlier mode the most similar later mode, (n,).  Collective: one sum.

    ``phi_owned`` are the earlier modes, ``M_phi_owned`` the later ones times M.  The assignment is the one with the largest sum
    of |phi_a^H M phi_b|^2, so that families cross where their frequencies do.
    """
    product = np.abs(gram(comm, phi_owned, M_phi_owned))
    _, partner = linear_sum_assignment(-(product**2))
    return partner


class Families:
    """The families of modes over speed, by their shapes."""

    def __init__(self, power: int = 2) -> None:
        self._power = power
        self._last: np.ndarray | None = None
        self._frequency: list[np.ndarray] = []

    def add(self, comm: MPI.Comm, frequency: np.ndarray, phi_owned: np.ndarray, M_phi_owned: np.ndarray) -> None:
        """Add the modes at the next speed, in the order of the families.  Collective."""
        if self._last is not None:
            n = min(self._last.shape[1], len(frequency))
            order = follow_families(comm, self._last[:, :n], M_phi_owned[:, :n])
            frequency, phi_owned = frequency[order], phi_owned[:, order]
        self._last = phi_owned
        self._frequency.append(frequency)

    def campbell(self, speeds: Sequence[float]) -> Campbell:
        """Return the families that exist at all speeds.  Local."""
        n = min(map(len, self._frequency))
        frequency = np.array([each[:n] for each in self._frequency]).T
        return Campbell(np.array(speeds), frequency, self._power)


def crossings(campbell: Campbell, orders: Sequence[int]) -> list[Crossing]:
    """Return the crossings of f = E Omega / 2 pi with the families, sorted by family and speed.  Local.

    Between two speeds omega_n^2 is interpolated linearly in Omega^2, exact for stiffness changes proportional to Omega^2; with
    Coriolis forces omega_n in Omega.
    """
    resonances, p = [], campbell.power
    powers = campbell.speed**p
    for family, frequency in enumerate(campbell.frequency, 1):
        raised = (2.0 * np.pi * frequency) ** p
        for order in orders:
            for k, (a, b) in enumerate(zip(powers, powers[1:])):
                slope = (raised[k + 1] - raised[k]) / (b - a)
                if order**p == slope:
                    continue
                at = (raised[k] - slope * a) / (order**p - slope)
                if a <= at < b or (at == b and k == len(powers) - 2):
                    speed = float(at ** (1.0 / p))
                    resonances.append(Crossing(family, order, speed, order * speed / (2.0 * np.pi)))
    return sorted(resonances, key=lambda crossing: (crossing.family, crossing.speed))


def smooth(campbell: Campbell) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield speeds [rad/s] and frequencies [Hz] of each family between the speeds, as :func:`crossings` takes it.  Local."""
    speeds, p = np.linspace(campbell.speed[0], campbell.speed[-1], 200), campbell.power
    for frequency in campbell.frequency:
        yield speeds, np.maximum(np.interp(speeds**p, campbell.speed**p, frequency**p), 0.0) ** (1.0 / p)


def write_campbell(campbell: Campbell, orders: Sequence[int], scene: Titled, folder: Path) -> str:
    """Write campbell.csv, crossings.csv and campbell.png; return the table for the screen.  Local, rank 0.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(str(folder))
    resonances, records = crossings(campbell, orders), campbell.records()
    write_csv(str(folder / "campbell.csv"), records[0], records)
    with matplotlib.rc_context(RC):
        draw_campbell(campbell, orders, resonances, scene, str(folder / "campbell.png"))
    return write_crossings([((c.family,), c) for c in resonances], ("family",), campbell.speed.tolist(), folder)


def write_crossings(
    resonances: Sequence[tuple[tuple[int, ...], Crossing]],
    names: Sequence[str],
    speeds: Sequence[float],
    folder: Path,
    at: str = "",
) -> str:
    """Write crossings.csv, in each row the numbers of a mode under their ``names``; return it as a table for the screen.

    Local, rank 0.  ``at`` states the speeds that the frequencies belong to.
    """
    n, columns = len(names) + 1, (*names, "engine_order", "speed_rad_s", "speed_rpm", "frequency_Hz")
    rows = [(*numbers, c.order, c.speed, c.speed * 30.0 / np.pi, c.frequency) for numbers, c in resonances]
    write_csv(str(folder / "crossings.csv"), columns, [dict(zip(columns, row)) for row in rows])
    return screen_table(
        f"resonances between {min(speeds):g} and {max(speeds):g} rad/s{at}" + ("" if rows else ": none"),
        [*(name.replace("_", " ") for name in columns[:n]), "speed rad/s", "rpm", "frequency Hz"],
        [(row[0], [*map(str, row[:n]), *(cell(value, 6) for value in row[n:])]) for row in rows],
    )


def draw_engine_orders(axes, orders: Sequence[int], end: float, top: float) -> None:
    """Draw f = E Omega / 2 pi of engine orders E up to a speed ``end`` [rad/s] and a frequency ``top`` [Hz].  Local."""
    for order in orders:
        reached = min(end, 2.0 * np.pi * top / order)
        axes.plot([0.0, reached * 30.0 / np.pi], [0.0, order * reached / (2.0 * np.pi)], color=FAINT, lw=0.6, ls="--", zorder=1)
        place = 0.98 * reached * 30.0 / np.pi, 0.98 * order * reached / (2.0 * np.pi)
        axes.annotate(f"E{order}", place, fontsize=6, color=INK, ha="center", va="center", bbox=BOXED)


def draw_campbell(campbell: Campbell, orders: Sequence[int], resonances: Sequence[Crossing], scene: Titled, path: str) -> None:
    """Draw frequencies against speed, the lines of the engine orders, and their crossings.  Local."""
    heading = "natural frequencies with all pairs stuck against speed; engine orders (E)"
    heading += " and their resonances (circles)" if resonances else ""
    page = Page(scene, heading, WIDTH, 4.4)
    axes = page.figure.add_subplot(page.grid(1, 1)[0, 0])
    rpm, highest = campbell.speed * 30.0 / np.pi, 1.08 * float(campbell.frequency.max())
    for i, (speeds, frequency) in enumerate(smooth(campbell)):
        axes.plot(speeds * 30.0 / np.pi, frequency, color=SERIES_COLOURS[i % len(SERIES_COLOURS)])
        axes.plot(rpm, campbell.frequency[i], ".", color=SERIES_COLOURS[i % len(SERIES_COLOURS)], markersize=4.0)
        axes.annotate(f" {i + 1}", (rpm[-1], campbell.frequency[i, -1]), fontsize=7, va="center", annotation_clip=False)
    draw_engine_orders(axes, orders, float(campbell.speed[-1]), highest)
    axes.plot(
        [60.0 * c.frequency / c.order for c in resonances],
        [c.frequency for c in resonances],
        "o",
        mfc="none",
        mec=INK,
        ms=5.0,
        lw=0,
    )
    axes.set(xlabel="speed [rpm]", ylabel="frequency [Hz]", ylim=(0.0, highest), xlim=(0.0, rpm[-1]))
    page.save(path)
