"""The modes of a structure as a table, modes.csv, modes.png and modes.vtkhdf.  Rank 0 only."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection

from ...mesh.data import ContactPairs, Mesh
from ...messages.words import counted
from ...observe.screen_table import screen_table
from ...receptance.modes import ProjectedModes
from ...results.skin_triangles import OuterTriangles, outer_triangles
from ...results.style import MOST_PANELS, RC, WIDTH, Page, Titled, panels, view_from
from ...results.vtk import write_modes
from ...system.files import make_folder
from ..records import cell, write_csv

_MOST_JOINTS = 4  # joints on the screen
_MOST_NODES = 6_000  # surface nodes in a picture
_DEFORMED = 0.08  # largest drawn displacement over the diagonal of the structure


@dataclass(frozen=True, eq=False)
class ModeTable:
    """The quantities of each mode."""

    frequency: np.ndarray  # (n,) Hz
    damping: np.ndarray  # (n,) ratio [-]
    joints: Mapping[str, np.ndarray]  # (n,) fraction of the strain energy in the springs of each joint [-]
    mass: np.ndarray | None  # (n, 3) effective mass along x, y, z [kg]; None without a mesh
    total: np.ndarray | None  # (3,) movable mass along x, y, z [kg]
    coriolis: np.ndarray | None = None  # (n,) Hz, frequencies with Coriolis forces; None: left out

    @property
    def shares(self) -> np.ndarray:
        """The effective masses over the movable mass, (n, 3) [-]."""
        assert self.mass is not None and self.total is not None, "a structure with a mesh"
        return self.mass / np.where(self.total > 0.0, self.total, 1.0)

    def records(self) -> list[dict[str, Any]]:
        """Return one record per mode, by the names of the columns of modes.csv."""
        columns: dict[str, np.ndarray] = {"frequency_Hz": self.frequency, "damping_ratio": self.damping}
        if self.coriolis is not None:
            columns["coriolis_frequency_Hz"] = self.coriolis
        if self.mass is not None:
            columns |= {f"effective_mass_{axis}_kg": self.mass[:, k] for k, axis in enumerate("xyz")}
            columns |= {f"effective_mass_{axis}_percent": 100.0 * self.shares[:, k] for k, axis in enumerate("xyz")}
        columns |= {f"joint_{name}_energy_percent": 100.0 * share for name, share in self.joints.items()}
        return [
            {"mode": i + 1} | {name: float(values[i]) for name, values in columns.items()} for i in range(len(self.frequency))
        ]


def joint_shares(pairs: ContactPairs, modes: ProjectedModes) -> dict[str, np.ndarray]:
    """Return the fraction of the strain energy of modes in each joint's springs, (n_modes,) [-], by joint name.  Local.

    The sum of k |R phi|^2 / omega_n^2 over its pairs, which is the relative change of omega_n^2 with the joint's stiffness.
    """
    energy = pairs.law.stiffness.reshape(-1, 1) * np.abs(modes.R_phi) ** 2
    share = energy.reshape(pairs.n_pairs, 3, len(modes.omega_n)).sum(axis=1) / modes.omega_n**2
    return {name: share[of_joint].sum(axis=0) for name, of_joint in pairs.by_joint().items()}


def write_modes_of(table: ModeTable, mesh: Mesh | None, shapes: np.ndarray | None, scene: Titled, folder: Path) -> str:
    """Write modes.csv and, with a mesh, modes.png and modes.vtkhdf; return the table for the screen.  Local.

    ``shapes`` (n_nodes, 3, n_modes) are M-normalised [kg^-1/2].

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(str(folder))
    records = table.records()
    write_csv(str(folder / "modes.csv"), records[0], records)
    if mesh is not None and shapes is not None:
        write_modes(str(folder / "modes.vtkhdf"), mesh, 2.0 * np.pi * table.frequency, np.moveaxis(shapes, -1, 0))
        with matplotlib.rc_context(RC):
            draw_shapes(table, mesh, shapes, scene, str(folder / "modes.png"))
    return on_screen(table)


def on_screen(table: ModeTable) -> str:
    """Return the table for the screen, with the joints of the largest fractions.  Local."""
    joints = sorted(table.joints, key=lambda name: -float(table.joints[name].max()))[:_MOST_JOINTS]
    head = ["mode", "frequency Hz", "damping %"]
    columns: list[np.ndarray] = [table.frequency, 100.0 * table.damping]
    digits = [7, 3]
    if table.coriolis is not None:
        head.append("with Coriolis Hz")
        columns.append(table.coriolis)
        digits.append(7)
    if table.mass is not None:
        head += [f"mass {axis} %" for axis in "xyz"]
        columns += list(100.0 * table.shares.T)
    head += [f"{name} %" for name in joints]
    columns += [100.0 * table.joints[name] for name in joints]
    digits += [3] * (len(columns) - len(digits))
    rows: list[tuple[object, list[str]]] = [
        (0, [str(i + 1), *(cell(float(values[i]) + 0.0, n) for values, n in zip(columns, digits))])
        for i in range(len(table.frequency))
    ]
    if table.mass is not None:
        sums = [cell(float(100.0 * share), 3) for share in table.shares.sum(axis=0)]
        rows.append((1, ["sum", *[""] * (2 + (table.coriolis is not None)), *sums, *("" for _ in joints)]))
    heading = "all pairs stuck"
    if table.mass is not None:
        heading += "; effective mass along x, y, z in % of the mass that moves"
    if joints:
        heading += "; share of the joints' springs in the strain energy"
    return screen_table(heading, head, rows)


def draw_shapes(table: ModeTable, mesh: Mesh, shapes: np.ndarray, scene: Titled, path: str) -> None:
    """Draw the shapes of the lowest modes, deformed and coloured by displacement.  Local."""
    n = min(len(table.frequency), MOST_PANELS)
    surface = outer_triangles(mesh, _MOST_NODES)
    view = view_from(24.0, -56.0)
    points = mesh.points[surface.nodes]
    flat = points @ view[1:].T
    room = 1.1 * _DEFORMED * mesh.diagonal
    low, high = flat.min(axis=0) - room, flat.max(axis=0) + room
    rows, columns = panels(n)
    height = rows * (np.clip(WIDTH / columns * (high - low)[1] / (high - low)[0], 0.7, 2.6) + 0.25)
    of = f"the first {n} of {counted(len(table.frequency), 'mode')}" if n < len(table.frequency) else "modes"
    page = Page(scene, f"{of} with all pairs stuck; displacement from none (dark) to the largest (light)", WIDTH, float(height))
    cells = page.grid(rows, columns)
    for i in range(n):
        axes = page.figure.add_subplot(cells[i // columns, i % columns])
        _shape(axes, surface, points, shapes[surface.nodes, :, i], view, mesh.diagonal)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.set_axis_off()
        axes.set_title(f"{i + 1}: {table.frequency[i]:.5g} Hz")
    page.save(path)


def _shape(axes, surface: OuterTriangles, points: np.ndarray, u: np.ndarray, view: np.ndarray, diagonal: float) -> None:
    """Draw one deformed surface, from far to near triangles."""
    size = np.linalg.norm(u, axis=1)
    largest = float(size.max(initial=0.0)) or 1.0
    corners = (points + _DEFORMED * diagonal / largest * u)[surface.triangles]
    order = np.argsort(corners.mean(axis=1) @ view[0], kind="stable")
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    shade = 0.7 + 0.3 * np.maximum(normal @ view[0], 0.0)
    colours = matplotlib.colormaps["viridis"](size[surface.triangles].mean(axis=1) / largest)[:, :3] * shade[:, None]
    faces = np.clip(colours[order], 0.0, 1.0)
    axes.add_collection(PolyCollection(corners[order] @ view[1:].T, facecolors=faces, edgecolors=faces, linewidths=0.2))
