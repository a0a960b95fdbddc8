"""Frequencies against speed of rotation: families of modes and their engine-order crossings (docs/theory.md, section 12)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from scipy.optimize import linear_sum_assignment

from ...linear.dense import gram, multiply
from ...modes.eigen import first_of
from ...observe.screen_table import screen_table
from ...results.style import FAINT, INK, RC, WIDTH, Page, Titled
from ...system.files import make_folder
from ..records import cell, write_csv

if TYPE_CHECKING:
    from ...linear.joint_springs import Linearised
    from ...modes.eigen import Modes

ORDERS = 6  # default number of engine orders
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")


@dataclass(frozen=True, eq=False)
class Campbell:
    """Families of modes: each row of ``frequency`` is one family at all speeds."""

    speed: np.ndarray  # (n_speeds,) rad/s, ascending
    frequency: np.ndarray  # (n_families, n_speeds) Hz
    likeness: np.ndarray  # (n_families, n_speeds - 1) |phi_a^T M phi_b| from one speed to the next


@dataclass(frozen=True)
class Crossing:
    """A speed at which an engine order excites a family of modes."""

    family: int  # from 1
    order: int
    speed: float  # rad/s
    frequency: float  # Hz


def follow_families(linearised: Linearised, before: Modes, after: Modes) -> tuple[np.ndarray, np.ndarray]:
    """Return for each earlier mode the most similar later mode, (n,), and their similarity, (n,).  Collective: one sum.

    The assignment is the one with the largest sum of (phi_a^T M phi_b)^2, so that families cross where their frequencies do.
    """
    comm = linearised.system.comm
    product = gram(comm, before.phi_owned, multiply(linearised.M, after.phi_owned))
    _, partner = linear_sum_assignment(-(np.abs(product) ** 2))
    return partner, np.abs(product[np.arange(len(partner)), partner])


class Families:
    """The families of modes over speed, by their shapes."""

    def __init__(self) -> None:
        self._last: Modes | None = None
        self._frequency: list[np.ndarray] = []
        self._likeness: list[np.ndarray] = []

    def add(self, linearised: Linearised, computed: Modes) -> None:
        """Add the modes at the next speed, in the order of the families.  Collective."""
        if self._last is not None:
            n = min(len(self._last.omega_n), len(computed.omega_n))
            order, likeness = follow_families(linearised, first_of(self._last, n), first_of(computed, n))
            computed = replace(computed, omega_n=computed.omega_n[order], phi_owned=computed.phi_owned[:, order])
            self._likeness.append(likeness)
        self._last = computed
        self._frequency.append(computed.frequency)

    def campbell(self, speeds: Sequence[float]) -> Campbell:
        """Return the families that exist at all speeds.  Local."""
        n = min(map(len, self._frequency))
        frequency = np.array([each[:n] for each in self._frequency]).T
        likeness = np.array([each[:n] for each in self._likeness]).reshape(-1, n).T
        return Campbell(np.array(speeds), frequency, likeness)


def crossings(campbell: Campbell, orders: Sequence[int]) -> list[Crossing]:
    """Return the crossings of f = E Omega / 2 pi with the families, sorted by family and speed.  Local.

    Between two speeds omega_n^2 is interpolated linearly in Omega^2, exact for stiffness changes proportional to Omega^2.
    """
    resonances = []
    squares = campbell.speed**2
    for family, frequency in enumerate(campbell.frequency, 1):
        omega2 = (2.0 * np.pi * frequency) ** 2
        for order in orders:
            for k, (a, b) in enumerate(zip(squares, squares[1:])):
                slope = (omega2[k + 1] - omega2[k]) / (b - a)
                if order**2 == slope:
                    continue
                at = (omega2[k] - slope * a) / (order**2 - slope)
                if a <= at < b or (at == b and k == len(squares) - 2):
                    speed = float(np.sqrt(at))
                    resonances.append(Crossing(family, order, speed, order * speed / (2.0 * np.pi)))
    return sorted(resonances, key=lambda crossing: (crossing.family, crossing.speed))


def smooth(campbell: Campbell) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield speeds [rad/s] and frequencies [Hz] of each family between the speeds, as :func:`crossings` takes it.  Local."""
    speeds = np.linspace(campbell.speed[0], campbell.speed[-1], 200)
    for frequency in campbell.frequency:
        yield speeds, np.sqrt(np.maximum(np.interp(speeds**2, campbell.speed**2, frequency**2), 0.0))


def write_campbell(campbell: Campbell, orders: Sequence[int], scene: Titled, folder: Path) -> str:
    """Write campbell.csv, crossings.csv and campbell.png; return the table for the screen.  Local, rank 0.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(str(folder))
    resonances = crossings(campbell, orders)
    records = [
        {"speed_rad_s": float(speed), "speed_rpm": float(speed) * 30.0 / np.pi}
        | {f"family_{i}_Hz": float(f) for i, f in enumerate(campbell.frequency[:, k], 1)}
        for k, speed in enumerate(campbell.speed)
    ]
    write_csv(str(folder / "campbell.csv"), records[0], records)
    columns = ("family", "engine_order", "speed_rad_s", "speed_rpm", "frequency_Hz")
    rows = [(c.family, c.order, c.speed, c.speed * 30.0 / np.pi, c.frequency) for c in resonances]
    write_csv(str(folder / "crossings.csv"), columns, [dict(zip(columns, row)) for row in rows])
    with matplotlib.rc_context(RC):
        draw_campbell(campbell, orders, resonances, scene, str(folder / "campbell.png"))
    return screen_table(
        f"resonances between {campbell.speed[0]:g} and {campbell.speed[-1]:g} rad/s" + ("" if rows else ": none"),
        ["family", "engine order", "speed rad/s", "rpm", "frequency Hz"],
        [(row[0], [str(row[0]), str(row[1]), *(cell(value, 6) for value in row[2:])]) for row in rows],
    )


def draw_campbell(campbell: Campbell, orders: Sequence[int], resonances: Sequence[Crossing], scene: Titled, path: str) -> None:
    """Draw frequencies against speed, the lines of the engine orders, and their crossings.  Local."""
    says = "natural frequencies with all pairs stuck against speed; engine orders (E) and their resonances (circles)"
    page = Page(scene, says, WIDTH, 4.4)
    axes = page.figure.add_subplot(page.grid(1, 1)[0, 0])
    rpm, highest = campbell.speed * 30.0 / np.pi, 1.08 * float(campbell.frequency.max())
    for i, (speeds, frequency) in enumerate(smooth(campbell)):
        axes.plot(speeds * 30.0 / np.pi, frequency, color=_COLOURS[i % len(_COLOURS)])
        axes.plot(rpm, campbell.frequency[i], ".", color=_COLOURS[i % len(_COLOURS)], markersize=4.0)
        axes.annotate(f" {i + 1}", (rpm[-1], campbell.frequency[i, -1]), fontsize=7, va="center", annotation_clip=False)
    for order in orders:
        end = min(rpm[-1], 60.0 * highest / order)
        axes.plot([0.0, end], [0.0, order * end / 60.0], color=FAINT, lw=0.7, ls="--", zorder=1)
        at = 0.97 * end
        boxed = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none"}
        axes.annotate(f"E{order}", (at, order * at / 60.0), fontsize=7, color=INK, ha="center", va="center", bbox=boxed)
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
