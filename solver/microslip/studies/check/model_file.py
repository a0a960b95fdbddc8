"""The command `check` for a model file without a scene."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from ...formats.model import FileModel
from ...formats.read import read_model
from ...mesh.connected import connected_parts
from ...mesh.data import Mesh
from ...messages.words import counted, place
from ...parallel.agree import on_root
from ...tables.structure_tables import StructureTables
from ...tables.units import UNITS
from . import model_content as content
from .marks import marks_of_file
from .model_mesh import densities_of, likely_units, whole_mesh
from .picture import draw
from .plausible import SI, suspicion

if TYPE_CHECKING:
    from mpi4py import MPI


def check_model(path: str, comm: MPI.Comm, out: Path | None = None) -> None:
    """Read a model file and print its content; with a folder ``out`` also draw the mesh there.

    Collective on ``comm``; only rank 0 reads and draws.

    Raises
    ------
    CaseError, MeshError : on every rank
    """
    lines = on_root(comm, _lines, path, out)
    if comm.rank == 0:
        print("\n".join(lines))


def _lines(path: str, out: Path | None) -> list[str]:
    file = read_model(path)
    units = likely_units(path, file)
    mesh, settings = whole_mesh(path, file, UNITS[units])
    lines = lines_of_file(path, file, mesh, settings, units)
    return lines + ([] if out is None else draw(out, mesh, marks_of_file(mesh, file, settings), Path(path).name))


def lines_of_file(path: str, file: FileModel, mesh: Mesh, settings: StructureTables, units: str) -> list[str]:
    """Return lines on the content of a file, in SI units if the file is in ``units``.  Local, rank 0."""
    _, parts = connected_parts(mesh, settings.body_of)
    volume = content.volumes(mesh, settings.bodies)
    metres, taken = UNITS[units].length, "metres" if units == SI else f'"{units}"' if file.materials else "millimetres"
    suspected = suspicion(mesh.diagonal / metres, file.materials, UNITS[SI], _mass_in_si(volume, file, metres))
    return [
        f"model      {path}: {counted(len(file.points), 'node')}, {content.elements_of(mesh)}; "
        f"{counted(len(parts), 'connected part')}",
        f"           from {place(mesh.points.min(axis=0))} to {place(mesh.points.max(axis=0))} m, if it is in {taken}",
        *([f"           {suspected}"] if suspected else []),
        *(f"           {note}" for note in mesh.notes),
        *content.facts(file),
        *content.steps(file),
        *content.bodies(mesh, settings.bodies, volume, densities_of(file, UNITS[units])),
        *content.materials(
            {name: material.model_copy(update=material.in_si(UNITS[units])) for name, material in file.materials.items()}
        ),
        *content.axes(file.orientations, file.bodies, UNITS[units].length),
        *content.groups(mesh, settings.bodies),
        *content.attached(file, UNITS[units]),
        *content.loads_at_rest(file),
        *content.passed_over(file),
        f"next       microslip new {quote(path)}",
    ]


def _mass_in_si(volume: Mapping[str, float], file: FileModel, metres: float) -> float:
    """Return the mass of the file if its numbers were in SI units [kg]; NaN for an unknown density."""
    return content.mass({name: value / metres**3 for name, value in volume.items()}, densities_of(file, UNITS[SI]))
