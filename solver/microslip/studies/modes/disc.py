"""The modes of a disc at every nodal diameter: table, interference diagram and shapes on all sectors."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.lines import Line2D

from ...assembly.coriolis import Coriolis
from ...assembly.sectors import Sectors
from ...library.build import Assembled, factor_in_words
from ...library.settings import reduction_settings
from ...linear.joint_springs import Linearised, linearise
from ...linear.lockstep import in_lockstep
from ...messages.errors import CaseError
from ...messages.words import counted
from ...modes.coriolis import Waves
from ...modes.eigen import Modes, first_of, lowest_modes
from ...modes.limits import refuse_too_many
from ...observe.log import RunLog
from ...observe.screen_table import screen_table
from ...parallel.agree import on_root
from ...reduction.expand import node_fields
from ...reduction.memory_of_modes import diameters_together, memory_of_diameter
from ...reduction.modal_structure import damped_modes
from ...reduction.stuck import project_modes
from ...results.style import BOXED, FAINT, INK, RC, WIDTH, Page, Titled, level_colours, some
from ...results.vtk import write_modes
from ...results.whole_disc import whole_mesh, whole_shapes
from ...scene.schema import Scene
from ...system.files import make_folder
from ...system.memory import give_back
from ..records import cell, write_csv
from .campbell import Crossing, write_crossings
from .coriolis import basis_size, of_modes, waves_of
from .report import joint_shares

DIRECTIONS = "backward", "forward"  # against the rotation, and with it
_ON_SCREEN = 6  # modes per nodal diameter on the screen
_NAMED = 24  # largest number of named engine orders in the picture
_DISTANCE = 0.025  # distance of two numbers of modes over the height of the picture


@dataclass(frozen=True, eq=False)
class DiameterModes:
    """The modes of one nodal diameter.  With 0 < 2 d < N each is a pair of waves, one in each direction."""

    diameter: int
    frequency: np.ndarray  # (n,) Hz
    damping: np.ndarray  # (n,) ratio [-]
    joints: dict[str, np.ndarray]  # (n,) fraction of the strain energy in the springs of each joint [-]
    waves: tuple[np.ndarray, np.ndarray] | None = None  # (n,) Hz with Coriolis forces, backward and forward; None: left out

    @property
    def by_direction(self) -> tuple[np.ndarray, ...]:
        """The frequencies of waves backward and forward, which are equal without Coriolis forces, (n,) each [Hz]."""
        return (self.frequency,) if self.waves is None else self.waves

    def excited_by(self, order: int, n_sectors: int) -> np.ndarray:
        """Return the frequencies of the waves that an engine order of this nodal diameter excites, (n,) [Hz].  Local."""
        return self.frequency if self.waves is None else self.waves[is_forward(order, n_sectors)]

    def records(self) -> list[dict[str, Any]]:
        """Return one record per mode, by the names of the columns of modes.csv."""
        return [
            {
                "nodal_diameter": self.diameter,
                "mode": i + 1,
                "frequency_Hz": float(self.frequency[i]),
                "damping_ratio": float(self.damping[i]),
            }
            | {f"{name}_frequency_Hz": float(of_wave[i]) for name, of_wave in zip(DIRECTIONS, self.waves or ())}
            | {f"joint_{name}_energy_percent": 100.0 * float(share[i]) for name, share in self.joints.items()}
            for i in range(len(self.frequency))
        ]


@dataclass(frozen=True, eq=False)
class AtDiameter:
    """The disc at one nodal diameter, all pairs stuck, with its modes over all DOFs."""

    diameter: int
    linearised: Linearised
    modes: Modes
    waves: tuple[Waves, Waves] | None  # with Coriolis forces, backward and forward; None: left out

    def by_direction(self) -> dict[str, Waves]:
        """Return the waves backward and forward; under "" the modes, for both, without Coriolis forces.  Collective."""
        return {"": of_modes(self.linearised, self.modes)} if self.waves is None else dict(zip(DIRECTIONS, self.waves))

    def shapes(self) -> np.ndarray | None:
        """Return the shapes of the modes on the mesh of the sector, on rank 0.  Collective."""
        return node_fields(self.linearised.maps, self.modes.phi_owned)

    def table(self, parts: Assembled) -> DiameterModes:
        """Return frequencies, damping and strain energy of joints.  Collective: one or two sums."""
        projected = project_modes(self.linearised.maps, self.modes.omega_n, self.modes.phi_owned)
        K_J, joints = parts.rest.pairs.law.stiffness.ravel(), joint_shares(parts.rest.pairs, projected)
        damping = damped_modes(projected, K_J, reduction_settings(parts.scene).damping).zeta
        waves = None if self.waves is None else (self.waves[0].frequency, self.waves[1].frequency)
        return DiameterModes(self.diameter, self.modes.frequency, damping, joints, waves)


@dataclass(frozen=True)
class Excited:
    """The excitation of a disc: engine orders between the lowest and the highest speed."""

    n_sectors: int
    speeds: tuple[float, ...]  # rad/s; empty: not stated
    orders: tuple[int, ...] = ()  # empty: 1 to the number of sectors
    frequencies: str = "at rest"  # description of the modes' frequencies

    @property
    def all_orders(self) -> Sequence[int]:
        """The engine orders to search."""
        return self.orders or range(1, self.n_sectors + 1)

    def crossings(self, by_diameter: Sequence[DiameterModes]) -> list[tuple[int, Crossing]]:
        """Return nodal diameter and crossing for each engine order that crosses a mode, by diameter and mode.  Local.

        The frequencies are taken as constant over the speed.
        """
        if not self.speeds:
            return []
        all_crossings = [
            (each.diameter, Crossing(i, order, 2.0 * np.pi * float(f) / order, float(f)))
            for each in by_diameter
            for order in self.all_orders
            if alias(order, self.n_sectors) == each.diameter
            for i, f in enumerate(each.excited_by(order, self.n_sectors), 1)
        ]
        return [(d, crossing) for d, crossing in all_crossings if min(self.speeds) <= crossing.speed <= max(self.speeds)]


def alias(order: int, n_sectors: int) -> int:
    """Return the nodal diameter that an engine order excites, 0 to half of the sectors.  Local."""
    return min(order % n_sectors, -order % n_sectors)


def is_forward(order: int, n_sectors: int) -> bool:
    """Return whether an engine order excites a wave that turns forward, with the disc.  Local."""
    return 2 * (order % n_sectors) > n_sectors


def diameters_of(scene: Scene, stated: tuple[int, ...]) -> tuple[int, ...]:
    """Return the nodal diameters to compute, ascending: the stated ones, or all.  Local.

    Raises
    ------
    CaseError : a nodal diameter that the disc does not have
    """
    assert scene.cyclic is not None, "a disc"
    most = scene.cyclic.sectors // 2
    wrong = [d for d in stated if d > most]
    if wrong:
        N = scene.cyclic.sectors
        raise CaseError(
            f"--diameters: {N} sectors have nodal diameters 0 to {most}, and {wrong[0]} is stated; at the sectors it is that of "
            f"{alias(wrong[0], N)}: state that"
        )
    return stated or tuple(range(most + 1))


def show_disc(
    parts: Assembled, matrix: Coriolis | None, count: int, diameters: Sequence[int], excited: Excited, folder: Path, log: RunLog
) -> None:
    """Compute ``count`` modes of some nodal diameters with all pairs stuck; write tables, diagram and shapes.

    Collective; destroys the ``matrix``.

    Raises
    ------
    CaseError, ResourceError, ConvergenceError : on every rank
    """
    scene, comm, by_diameter, written = parts.scene, log.comm, [], None
    assert scene.cyclic is not None, "a disc"
    for at in modes_by_diameter(parts, matrix, count, diameters, log):
        by_diameter.append(at.table(parts))
        written = on_root(comm, write_shapes, folder, parts, at.diameter, at.modes.omega_n, at.shapes(), written)
    if not by_diameter:
        raise CaseError(f"{scene.path}: nothing holds the disc at any nodal diameter: add [[supports]]")
    with log.stage("table and pictures"):
        log.note(on_root(comm, write_disc, by_diameter, scene, excited, folder))


def modes_by_diameter(
    parts: Assembled, matrix: Coriolis | None, count: int, diameters: Sequence[int], log: RunLog
) -> Iterator[AtDiameter]:
    """Yield the disc at each nodal diameter, with its waves if there is a ``matrix``.  Collective; frees all of them."""
    scene, system = parts.scene, parts.rest.system
    sectors = system.sectors
    assert isinstance(sectors, Sectors), "a disc"
    n, verify = basis_size(scene, count), scene.solver.verify_modes
    allows_fewer = scene.solver.modes is None or matrix is not None
    log.note(f"{system.n_dof} DOF, {counted(parts.rest.pairs.n_pairs, 'contact pair')}")
    refuse_too_many(scene.solver.modes, system.n_dof, scene.path)
    together = diameters_together(memory_of_diameter(sectors, n, system.n_dof), log.comm)
    system.destroy()  # its matrices, and not those of the sectors
    for first in range(0, len(diameters), together):
        some = diameters[first : first + together]
        give_back()
        with log.stage(f"nodal diameter{'s' * (len(some) > 1)} {', '.join(map(str, some))}"):
            structures = _structures(parts, some, log, is_first=first == 0)
            modes = in_lockstep(
                [partial(lowest_modes, each, min(n, each.maps.n_dof), verify, allows_fewer) for each in structures.values()]
            )
        for (d, linearised), computed in zip(structures.items(), modes):
            both = None if matrix is None else waves_of(linearised, computed, matrix, count, log)
            log.note(f"nodal diameter {d}: {'' if both is None else 'modes without Coriolis forces '}{computed.completeness}")
            yield AtDiameter(d, linearised, first_of(computed, count), both)
            linearised.destroy()
            linearised.maps.destroy()
    sectors.destroy()
    if matrix is not None:
        matrix.destroy()


def _structures(parts: Assembled, diameters: Sequence[int], log: RunLog, is_first: bool = True) -> dict[int, Linearised]:
    """Return the stuck structures by nodal diameter, except those in which a free disc moves rigidly.  Collective.

    One pass over the factor of the sector tests all of them; it is logged with the first.
    """
    scene, structures = parts.scene, {}
    with log.stage("factor of the stuck structure"):
        outcomes = in_lockstep([partial(_structure, parts, d) for d in diameters])
    for d, outcome in zip(diameters, outcomes):
        if isinstance(outcome, Linearised):
            structures[d] = outcome
        elif scene.supports or d > 1:
            raise CaseError(f"nodal diameter {d}: {outcome}") from outcome
        else:
            log.note(f"nodal diameter {d} is left out, a free disc moves as a rigid body in it: {outcome}")
    for linearised in list(structures.values())[:1]:
        for note in (*linearised.factor.info["messages"], *([factor_in_words(linearised.factor.info)] if is_first else [])):
            log.note(note)
    return structures


def _structure(parts: Assembled, d: int) -> Linearised | CaseError:
    """Return the stuck structure of a nodal diameter, or why it has none.  Collective, in lockstep with others."""
    scene, sectors = parts.scene, parts.rest.system.sectors
    assert isinstance(sectors, Sectors), "a disc"
    of_d = sectors.system(d, explicit=False)
    try:
        linearised = linearise(of_d, parts.rest.pairs, str(scene.path))
    except CaseError as problem:
        of_d.destroy()
        return problem
    linearised.let_K_go()
    return linearised


def write_shapes(
    folder: Path, parts: Assembled, d: int, omega_n: np.ndarray, shapes: np.ndarray, same_mesh: str | None = None
) -> str:
    """Write the shapes of a nodal diameter on all sectors for ParaView; return the file.  Rank 0.

    ``same_mesh`` is the file of another nodal diameter, whose mesh is copied.
    """
    cyclic = parts.scene.cyclic
    assert cyclic is not None and parts.mesh is not None, "a disc, on rank 0"
    make_folder(str(folder))
    path = str(folder / f"modes_diameter_{d:02d}.vtkhdf")
    write_modes(path, same_mesh or whole_mesh(parts.mesh, cyclic), omega_n, whole_shapes(shapes, cyclic, d))
    return path


def write_disc(by_diameter: Sequence[DiameterModes], scene: Titled, excited: Excited, folder: Path) -> str:
    """Write modes.csv, interference.png and, with speeds, crossings.csv; return the tables for the screen.  Local, rank 0.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(str(folder))
    records = [record for each in by_diameter for record in each.records()]
    write_csv(str(folder / "modes.csv"), records[0], records)
    with matplotlib.rc_context(RC):
        draw_interference(by_diameter, excited, scene, str(folder / "interference.png"))
    n = min(_ON_SCREEN, max(len(each.frequency) for each in by_diameter))
    rows: list[tuple[object, list[str]]] = [
        (0, [f"{each.diameter} {name}".strip(), *(cell(float(f), 7) for f in frequency[:n]), *[""] * (n - len(frequency))])
        for each in by_diameter
        for name, frequency in zip(DIRECTIONS if each.waves else ("",), each.by_direction)
    ]
    heading = f"natural frequencies [Hz] by nodal diameter, all pairs stuck; disc of {counted(excited.n_sectors, 'sector')}"
    if by_diameter[0].waves:
        heading += "; with Coriolis forces, waves that turn backward and forward"
    table = screen_table(heading, ["nodal diameter", *(f"mode {i + 1}" for i in range(n))], rows)
    return f"{table}\n{write_resonances(excited.crossings(by_diameter), excited, folder)}" if excited.speeds else table


def write_resonances(resonances: Sequence[tuple[int, Crossing]], excited: Excited, folder: Path) -> str:
    """Write crossings.csv, nodal diameter and crossing in each row; return it as a table for the screen.  Local, rank 0."""
    at, names = f", with frequencies {excited.frequencies}", ("nodal_diameter", "mode")
    return write_crossings([((d, c.family), c) for d, c in resonances], names, excited.speeds, folder, at)


def draw_interference(by_diameter: Sequence[DiameterModes], excited: Excited, scene: Titled, path: str) -> None:
    """Draw frequency against nodal diameter, with engine orders: f = E Omega / 2 pi at the alias of E.  Local."""
    heading = f"natural frequencies {excited.frequencies} by nodal diameter, all pairs stuck; modes are numbered at the right"
    handles = []
    if by_diameter[0].waves:
        heading += "; with Coriolis forces"
        handles = [Line2D([], [], color=INK, ls=ls, lw=1.0, label=f"{name} waves") for name, ls in zip(DIRECTIONS, ("-", ":"))]
    speeds = sorted({min(excited.speeds), max(excited.speeds)}) if excited.speeds else []
    lines: list[dict[str, Any]] = [
        {"color": INK, "lw": 0.7, "ls": ls, "marker": "x", "ms": 3.5} for ls in ("--", "-")[-len(speeds) :]
    ]
    for speed, line in zip(speeds, lines):
        handles.append(Line2D([], [], label=f"engine orders E at {speed * 30.0 / np.pi:.5g} rpm", **line))
    page = Page(scene, heading, WIDTH, 4.4, handles)
    axes = page.figure.add_subplot(page.grid(1, 1)[0, 0])
    n, diameters = min(len(each.frequency) for each in by_diameter), [each.diameter for each in by_diameter]
    for i, colour in enumerate(level_colours(n)):
        for frequency, marks in zip(zip(*(each.by_direction for each in by_diameter)), ("o-", ".:")):
            axes.plot(diameters, [of_diameter[i] for of_diameter in frequency], marks, color=colour, ms=3.5, lw=0.8)
    highest = 1.05 * max(float(each.frequency[:n].max()) for each in by_diameter)
    _number_modes(axes, by_diameter[-1].frequency[:n], highest)
    for speed, line in zip(speeds, lines):
        _engine_orders(axes, excited.n_sectors, speed, highest, line, is_named=speed == speeds[-1])
    room = max(0.04 * (diameters[-1] - diameters[0]), 0.4)
    xlim = diameters[0] - room, diameters[-1] + 2.5 * room
    axes.set(xlabel="nodal diameter", ylabel="frequency [Hz]", xlim=xlim, ylim=(0.0, highest))
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xticks([tick for tick in axes.get_xticks() if diameters[0] <= tick <= diameters[-1]])
    page.save(path)


def _number_modes(axes, frequency: np.ndarray, highest: float) -> None:
    """Write the numbers of modes at the right, those of close modes together, "3-5".  Local."""
    starts = [0, *(i for i in range(1, len(frequency)) if frequency[i] - frequency[i - 1] > _DISTANCE * highest)]
    for first, end in zip(starts, [*starts[1:], len(frequency)]):
        text = f"{first + 1}" if end == first + 1 else f"{first + 1}\u2013{end}"
        place = 0.995, float(frequency[first:end].mean())
        axes.annotate(text, place, xycoords=("axes fraction", "data"), fontsize=7, ha="right", va="center")


def _engine_orders(axes, n_sectors: int, speed: float, highest: float, line: dict[str, Any], is_named: bool) -> None:
    """Draw f = E speed / 2 pi over the nodal diameter excited by order E, up to E = N, folded at half of the sectors."""
    most = min(int(2.0 * np.pi * highest / speed), n_sectors)
    orders = np.arange(1, most + 1)
    at, frequency = np.array([alias(order, n_sectors) for order in orders]), orders * speed / (2.0 * np.pi)
    corners = np.array(sorted({0.0, min(0.5 * n_sectors, float(most)), min(most + 1.0, float(n_sectors))}))
    folded = np.minimum(corners, n_sectors - corners)
    axes.plot(folded, corners * speed / (2.0 * np.pi), **{**line, "color": FAINT, "marker": "", "zorder": 1})
    axes.plot(at, frequency, **{**line, "ls": ""})
    for k in some(range(most), _NAMED) if is_named else ():
        place = int(at[k]), float(frequency[k])
        axes.annotate(f"E{orders[k]}", place, (4, 1), textcoords="offset points", color=INK, bbox=BOXED, fontsize=6, zorder=3)
