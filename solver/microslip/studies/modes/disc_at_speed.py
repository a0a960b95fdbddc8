"""The Campbell diagram of a disc: the modes of every nodal diameter about the state of rest at several speeds."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.lines import Line2D

from ...assembly.coriolis import Coriolis
from ...library.build import Assembled
from ...messages.errors import CaseError
from ...observe.log import RunLog
from ...parallel.agree import on_root
from ...results.style import INK, MOST_NAMED, RC, WIDTH, Page, Titled, level_colours, some
from ...system.files import make_folder
from ..records import write_csv
from .campbell import Campbell, Crossing, Families, crossings, draw_engine_orders, smooth
from .disc import (
    DIRECTIONS,
    DiameterModes,
    Excited,
    alias,
    draw_interference,
    is_forward,
    modes_by_diameter,
    write_resonances,
    write_shapes,
)

_NAMED = 16  # engine orders in the picture


@dataclass(frozen=True)
class Wave:
    """Waves of one nodal diameter."""

    diameter: int
    direction: str  # "backward" or "forward"; "": both, as their frequencies are equal

    @property
    def words(self) -> str:
        """The nodal diameter and the direction."""
        return f"diameter {self.diameter} {self.direction}".strip()

    def is_excited_by(self, order: int, n_sectors: int) -> bool:
        """Return whether an engine order excites these waves.  Local.

        Diameter 0 and half of the sectors stand still: their frequencies are equal in both directions.
        """
        if alias(order, n_sectors) != self.diameter:
            return False
        return self.direction in ("", DIRECTIONS[is_forward(order, n_sectors)])


def show_at_speeds(
    at_speeds: Iterable[tuple[float, Assembled, Coriolis | None]],
    count: int,
    diameters: Sequence[int],
    excited: Excited,
    folder: Path,
    log: RunLog,
) -> None:
    """Compute ``count`` modes of nodal diameters at rising speeds [rad/s]; write tables, diagrams, and shapes at the highest.

    Collective.

    Raises
    ------
    CaseError, ResourceError, ConvergenceError : on every rank
    """
    families: dict[Wave, Families] = {}
    at_highest: list[DiameterModes] = []
    speeds, highest, written = [], max(excited.speeds), None
    for speed, parts, matrix in at_speeds:
        speeds.append(speed)
        log.note(f"speed of rotation {speed:g} rad/s")
        scene, at_highest = parts.scene, []
        for at in modes_by_diameter(parts, matrix, count, diameters, log):
            power = 2 if at.waves is None else 1
            for direction, of_wave in at.by_direction().items():
                family = families.setdefault(Wave(at.diameter, direction), Families(power))
                family.add(log.comm, of_wave.frequency, of_wave.phi_owned, of_wave.M_phi_owned)
            at_highest.append(at.table(parts))
            if speed == highest:
                written = on_root(log.comm, write_shapes, folder, parts, at.diameter, at.modes.omega_n, at.shapes(), written)
    if not at_highest:
        raise CaseError(f"{scene.path}: nothing holds the disc at any nodal diameter: add [[supports]]")
    by_wave = {wave: of_wave.campbell(speeds) for wave, of_wave in families.items()}
    with log.stage("Campbell diagram"):
        excited = replace(excited, frequencies=f"at {highest * 30.0 / np.pi:.5g} rpm")
        log.note(on_root(log.comm, write_at_speeds, by_wave, at_highest, scene, excited, folder))


def resonances(by_wave: Mapping[Wave, Campbell], excited: Excited) -> list[tuple[int, Crossing]]:
    """Return nodal diameter and crossing of each engine order that meets a family of waves which it excites.  Local."""
    N = excited.n_sectors
    return [
        (wave.diameter, crossing)
        for wave, campbell in by_wave.items()
        for crossing in crossings(campbell, [order for order in excited.all_orders if wave.is_excited_by(order, N)])
    ]


def write_at_speeds(
    by_wave: Mapping[Wave, Campbell], at_highest: Sequence[DiameterModes], scene: Titled, excited: Excited, folder: Path
) -> str:
    """Write modes.csv, campbell.csv, crossings.csv and both pictures; return the table for the screen.  Local, rank 0.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(str(folder))
    records = [record for each in at_highest for record in each.records()]
    write_csv(str(folder / "modes.csv"), records[0], records)
    rows = [
        {"nodal_diameter": wave.diameter} | ({"wave": wave.direction} if wave.direction else {}) | at_speed
        for wave, campbell in by_wave.items()
        for at_speed in campbell.records()
    ]
    columns: dict[str, Any] = {name: None for row in rows for name in row}
    write_csv(str(folder / "campbell.csv"), columns, rows)
    met = resonances(by_wave, excited)
    with matplotlib.rc_context(RC):
        draw_interference(at_highest, excited, scene, str(folder / "interference.png"))
        draw_at_speeds(by_wave, met, excited, scene, str(folder / "campbell.png"))
    return write_resonances(met, replace(excited, frequencies="at speed"), folder)


def draw_at_speeds(
    by_wave: Mapping[Wave, Campbell], met: Sequence[tuple[int, Crossing]], excited: Excited, scene: Titled, path: str
) -> None:
    """Draw the families of all nodal diameters against speed, lines of engine orders, and where these excite them.  Local."""
    heading = "frequencies by nodal diameter against speed (dots: computed), without slip"
    heading += "; engine orders E meet them at circles" if met else ""
    diameters = list(dict.fromkeys(wave.diameter for wave in by_wave))
    colours = dict(zip(diameters, level_colours(len(diameters))))
    lines = {
        wave: {"color": colours[wave.diameter], "lw": 0.9, "ls": ":" if wave.direction == DIRECTIONS[1] else "-"}
        for wave in by_wave
    }
    named = [Line2D([], [], color=colours[d], lw=0.9, label=f"diameter {d}") for d in some(diameters, MOST_NAMED)]
    directions = dict.fromkeys(wave.direction for wave in by_wave if wave.direction)
    named += [Line2D([], [], color=INK, lw=0.9, ls=ls, label=f"{name} waves") for name, ls in zip(directions, ("-", ":"))]
    page = Page(scene, heading, WIDTH, 4.8, named)
    axes = page.figure.add_subplot(page.grid(1, 1)[0, 0])
    top = 1.05 * max(float(campbell.frequency.max()) for campbell in by_wave.values())
    end = max(excited.speeds)
    for wave, campbell in by_wave.items():
        for speed, frequency in smooth(campbell):
            axes.plot(speed * 30.0 / np.pi, frequency, **lines[wave])
        axes.plot(np.array(campbell.speed) * 30.0 / np.pi, campbell.frequency.T, ".", ms=3.0, color=colours[wave.diameter])
    at_once = [order for order in excited.all_orders if any(crossing.order == order for _, crossing in met)]
    draw_engine_orders(axes, some(at_once, _NAMED), end, top)
    for d, crossing in met:
        axes.plot(crossing.speed * 30.0 / np.pi, crossing.frequency, "o", mfc=colours[d], mec=INK, ms=4.0, mew=0.6, clip_on=False)
    low, high = (float(speed) * 30.0 / np.pi for speed in (min(excited.speeds), end))
    axes.set(xlabel="speed [rpm]", ylabel="frequency [Hz]", ylim=(0.0, top), xlim=(low, high))
    page.save(path)
