"""The modes of a disc at every nodal diameter: table, interference diagram and shapes on all sectors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np

from ...library.build import Assembled, factor_of
from ...library.settings import reduction_settings
from ...messages.errors import CaseError
from ...modes.hermitian import lowest_modes_of
from ...observe.log import RunLog
from ...observe.screen_table import screen_table
from ...parallel.agree import on_root
from ...reduction.expand import node_fields
from ...reduction.modal_structure import damped_modes
from ...reduction.stuck import project_modes
from ...results.style import FAINT, INK, RC, WIDTH, Page, Titled
from ...results.vtk import write_modes
from ...results.whole_disc import whole_mesh, whole_shapes
from ...system.files import make_folder
from ..records import cell, write_csv

if TYPE_CHECKING:
    from ...linear.joint_springs import Linearised
    from ...modes.eigen import Modes

_ON_SCREEN = 6  # modes of each nodal diameter


@dataclass(frozen=True, eq=False)
class DiameterModes:
    """The modes of one nodal diameter.  With 0 < 2 d < N each is a pair of waves, one in each direction."""

    diameter: int
    frequency: np.ndarray  # (n,) Hz
    damping: np.ndarray  # (n,) ratio [-]
    joints: dict[str, np.ndarray]  # (n,) share of the strain energy that the springs of each joint have [-]

    def records(self) -> list[dict[str, Any]]:
        """Return a record a mode, by the names of the columns of modes.csv."""
        return [
            {
                "nodal_diameter": self.diameter,
                "mode": i + 1,
                "frequency_Hz": float(self.frequency[i]),
                "damping_ratio": float(self.damping[i]),
            }
            | {f"joint_{name}_energy_percent": 100.0 * float(share[i]) for name, share in self.joints.items()}
            for i in range(len(self.frequency))
        ]


def show_disc(parts: Assembled, count: int, speeds: Sequence[float], folder: Path, log: RunLog) -> None:
    """Compute ``count`` modes of every nodal diameter with all pairs stuck; write table, diagram and shapes.

    Collective.  ``speeds`` [rad/s] are those whose engine orders the interference diagram shows.

    Raises
    ------
    CaseError, ResourceError, ConvergenceError : on every rank
    """
    scene, comm, found = parts.scene, log.comm, []
    assert scene.cyclic is not None, "a disc"
    for d, linearised, computed in _by_diameter(parts, count, log):
        found.append(_table(d, parts, linearised, computed))
        shapes = node_fields(linearised.maps, computed.phi_owned)
        on_root(comm, _write_shapes, folder, parts, d, computed.omega_n, shapes, share=False)
    if not found:
        raise CaseError(f"{scene.path}: nothing holds the disc at any nodal diameter: add [[supports]]")
    with log.stage("table and pictures"):
        log.note(on_root(comm, write_disc, found, scene, scene.cyclic.sectors, speeds, folder))


def _by_diameter(parts: Assembled, count: int, log: RunLog) -> Iterator[tuple[int, Linearised, Modes]]:
    """Yield each nodal diameter with its factor and its modes, and free them.  Collective."""
    scene, system = parts.scene, parts.rest.system
    sectors = system.sectors
    assert sectors is not None, "a disc"
    for d in range(sectors.n_sectors // 2 + 1):
        of_d = system if d == 0 else sectors.system(d)
        with log.stage(f"nodal diameter {d}"):
            try:
                linearised = factor_of(replace(parts, rest=replace(parts.rest, system=of_d)), log)
            except CaseError as problem:
                of_d.destroy()
                if scene.supports or d > 1:
                    raise CaseError(f"nodal diameter {d}: {problem}") from problem
                log.note(f"nodal diameter {d} is left out, a free disc moves as a rigid body in it: {problem}")
                continue
            n = min(count, of_d.n_dof)
            computed = lowest_modes_of(linearised, n, scene.solver.verify_modes, scene.solver.modes is None)
        if "proof" in computed.info:
            log.note(f"nodal diameter {d} is proved complete by inertia: {computed.info['proof']}")
        yield d, linearised, computed
        linearised.destroy()
        of_d.destroy()
    sectors.destroy()


def _table(d: int, parts: Assembled, linearised: Linearised, computed: Modes) -> DiameterModes:
    """Return what is told of the modes of a nodal diameter.  Collective: a sum or two."""
    pairs = parts.rest.pairs
    projected = project_modes(linearised.maps, computed.omega_n, computed.phi_owned)
    K_J, n = pairs.law.stiffness.ravel(), len(computed.omega_n)
    energy = (K_J[:, None] * np.abs(projected.R_phi) ** 2).reshape(pairs.n_pairs, 3, n).sum(axis=1) / computed.omega_n**2
    names = np.array(pairs.joint, dtype=str)
    joints = {name: energy[names == name].sum(axis=0) for name in dict.fromkeys(pairs.joint)}
    damping = damped_modes(projected, K_J, reduction_settings(parts.scene).damping).zeta
    return DiameterModes(d, computed.frequency, damping, joints)


def _write_shapes(folder: Path, parts: Assembled, d: int, omega_n: np.ndarray, shapes: np.ndarray) -> None:
    """Write the shapes of a nodal diameter on all sectors for ParaView.  Rank 0."""
    cyclic = parts.scene.cyclic
    assert cyclic is not None and parts.mesh is not None, "a disc, on rank 0"
    make_folder(str(folder))
    of_disc = np.moveaxis(whole_shapes(shapes, cyclic, d), -1, 0)
    write_modes(str(folder / f"modes_diameter_{d:02d}.vtkhdf"), whole_mesh(parts.mesh, cyclic), omega_n, of_disc)


def write_disc(found: Sequence[DiameterModes], scene: Titled, n_sectors: int, speeds: Sequence[float], folder: Path) -> str:
    """Write modes.csv and interference.png; return the table for the screen.  Local, rank 0.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(str(folder))
    records = [record for each in found for record in each.records()]
    write_csv(str(folder / "modes.csv"), records[0], records)
    with matplotlib.rc_context(RC):
        draw_interference(found, n_sectors, speeds, scene, str(folder / "interference.png"))
    n = min(_ON_SCREEN, max(len(each.frequency) for each in found))
    rows = [
        (each.diameter, [str(each.diameter), *(cell(float(f), 7) for f in each.frequency[:n]), *[""] * (n - len(each.frequency))])
        for each in found
    ]
    says = f"natural frequencies [Hz] by nodal diameter, all pairs stuck; disc of {n_sectors} sectors"
    return screen_table(says, ["nodal diameter", *(f"mode {i + 1}" for i in range(n))], rows)


def draw_interference(found: Sequence[DiameterModes], n_sectors: int, speeds: Sequence[float], scene: Titled, path: str) -> None:
    """Draw frequency against nodal diameter, and where engine orders act: f = E Omega / 2 pi at the alias of E.  Local."""
    says = "natural frequencies with all pairs stuck against nodal diameter"
    says += "; dashed: frequency of the engine orders at each speed, folded at half of the sectors" if speeds else ""
    page = Page(scene, says, WIDTH, 4.4)
    axes = page.figure.add_subplot(page.grid(1, 1)[0, 0])
    n, diameters = min(len(each.frequency) for each in found), [each.diameter for each in found]
    for i in range(n):
        axes.plot(diameters, [each.frequency[i] for each in found], ".-", color=INK, lw=0.7, ms=5.0)
    highest = 1.08 * max(float(each.frequency[:n].max()) for each in found)
    for speed in speeds:
        last = min(int(highest * 2.0 * np.pi / speed), 4 * n_sectors)
        orders = np.arange(last + 1)
        folded = np.minimum(orders % n_sectors, -orders % n_sectors)
        axes.plot(folded, orders * speed / (2.0 * np.pi), ".--", color=FAINT, lw=0.7, ms=2.0, zorder=1)
        at = min(last, n_sectors // 2)
        axes.annotate(f"{speed * 30.0 / np.pi:.0f} rpm", (folded[at], at * speed / (2.0 * np.pi)), fontsize=7, color=INK)
    axes.set(xlabel="nodal diameter", ylabel="frequency [Hz]", ylim=(0.0, highest), xlim=(-0.2, n_sectors // 2 + 0.2))
    page.save(path)
