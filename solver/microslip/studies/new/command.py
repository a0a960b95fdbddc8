"""The command `new`: read a model file, find candidates for joints, and write a first scene."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from ...formats.model import FileModel
from ...formats.read import READERS, read_model
from ...messages.errors import CaseError
from ...messages.words import counted, hint, listed, place
from ...parallel.agree import on_root
from ...scene.inputs import absent
from ...system.files import atomic_write
from ...tables.units import UNITS
from ..check.model_content import table
from ..check.model_mesh import likely_units, whole_mesh
from ..check.plausible import SI
from .bolts import Shank, uncut
from .candidates import candidates_and_bolts
from .first import First
from .places import disconnected, farthest, fixed_groups, supports_of_joints
from .scene_text import lacks_entries, named, text_of
from .sectors import sector_of

if TYPE_CHECKING:
    from mpi4py import MPI


def new(model: str, comm: MPI.Comm, out: Path | None = None, force: bool = False) -> None:
    """Write a first scene for a model file, and print a report.

    Collective on ``comm``; only rank 0 reads and writes.

    Parameters
    ----------
    out : the scene; None: the model's name with ``.toml``, in the current folder
    force : overwrite an existing file

    Raises
    ------
    CaseError, MeshError : no model file, an empty model, or an existing scene; on every rank
    """
    lines = on_root(comm, _write, model, Path(f"{Path(model).stem}.toml") if out is None else out, force)
    if comm.rank == 0:
        print("\n".join(lines))


def _write(model: str, out: Path, force: bool) -> list[str]:
    """Write the scene and return the report.  Local, rank 0."""
    _refuse(model, out, force)
    first = _first(model, out, read_model(model))
    if first.step is not None and first.needs_loads:
        first = replace(_first(model, out, read_model(model, first.step.number)), names_step=True)
    text, scene = text_of(first), quote(str(out))
    with atomic_write(str(out)) as partial:
        Path(partial).write_text(text, encoding="utf-8")
    steps = f"fill in what begins with #> in {out}, then: microslip check {scene}"
    if not lacks_entries(text):
        steps = f"microslip check {scene}, then: microslip run {scene}"
    return [*_lines(model, out, first), f"next       {steps}"]


def _refuse(model: str, out: Path, force: bool) -> None:
    """Raise CaseError if there is no model file, or a scene would be overwritten."""
    path = Path(model)
    ending = path.suffix.lower()
    if ending == ".toml":
        raise CaseError(
            f"{model} is a scene; new takes the model file that a scene is to be written for; try: microslip check {model}"
        )
    if ending not in READERS:
        raise CaseError(f"{model}: the ending {ending!r} is not known{hint(ending, READERS, str)}; known are {listed(READERS)}")
    if not path.is_file():
        raise CaseError(f"{model}: {'that is a folder' if path.is_dir() else absent(path.absolute())}")
    if out.suffix.lower() != ".toml":
        raise CaseError(f"--out {out}: the name of a scene ends in .toml")
    if out.exists() and not force:
        raise CaseError(f"{out} exists and is not overwritten; choose another name with --out, or add --force")


def _first(model: str, out: Path, file: FileModel) -> First:
    """Return the data of the first scene.  Local, rank 0."""
    units = likely_units(model, file)
    mesh, settings = whole_mesh(model, file, UNITS[units])
    states_scale = units != SI and not file.materials
    candidates, bolts = candidates_and_bolts(mesh, file, settings)
    likely = [candidate for candidate in candidates if candidate.is_likely and not candidate.is_distant]
    in_contact = [candidate for candidate in candidates if candidate.in_contact_in_file]
    left_out = supports_of_joints(mesh, file, likely)
    file = replace(file, supports=tuple(support for support in file.supports if support not in left_out))
    fixed, may_be = fixed_groups(mesh, file, settings, [name for candidate in likely for name in candidate.surfaces])
    sector = sector_of(mesh, file, settings)
    return First(
        model=Path(os.path.relpath(model, out.parent)).as_posix(),
        units=None if units == SI or states_scale else units,
        scale=UNITS[units].length if states_scale else None,
        mesh=mesh,
        file=file,
        settings=settings,
        candidates=candidates,
        left_out=left_out,
        shanks=uncut(mesh, file, bolts),
        fixed=fixed,
        may_be_fixed=may_be,
        disconnected=disconnected(mesh, file, settings, [*likely, *in_contact], fixed) if sector is None else [],
        place=farthest(mesh, file, fixed),
        sector=sector,
    )


def _on_steps(first: First) -> list[str]:
    """Return lines on the step whose conditions are used, and on omitted supports."""
    lines = [] if first.step is None else [f"conditions of step {first.step.number} of the file: {first.step.procedure}"]
    if first.names_step:
        lines.append("step = in the scene takes its loads, which act at rest and may close the gap")
    elif first.loads_left_out:
        lines.append(f"without its loads, {first.loads_left_out}")
    if first.left_out:
        lines.append(f"left out: {named(first.left_out)}, which fix both sides of a joint")
    return lines


def _cut(shank: Shank) -> str:
    """Return the position of a bolt's cut as text."""
    if shank.group is not None:
        return f"cut by {shank.group}"
    return f"to be cut at {place(shank.position)} m across {place(shank.direction)}"


def _lines(model: str, out: Path, first: First) -> list[str]:
    """Return the report as lines."""
    joints = [f"{joint.name}: {joint.text}" for joint in first.joints]
    others = [candidate.text for candidate in first.others]
    bolts = [f"{shank.body}: shank of {2e3 * shank.radius:.3g} mm, {_cut(shank)}" for shank in first.shanks]
    assumed = [f"{name}: {listed(keys)} of steel, not in the file" for name, keys in first.lacking.items()]
    place = first.place
    where = f"point {place.point}" if place.point else f"node {place.node}"
    holds = [f"{support.group or support.point}, by the file" for support in first.file.supports] + [
        f"{name}, by its name" for name in first.fixed
    ]
    units = first.units or (f"scale = {first.scale:g}" if first.scale else "SI, by its size")
    return [
        f"new        {out}, for {model}: {counted(len(first.mesh.points), 'node')}, {first.mesh.diagonal:.4g} m across ({units})",
        *table("bodies", list(first.settings.bodies)),
        *table("materials", assumed),
        *table("joints", joints or ["no touching surfaces of different bodies"]),
        *table("separate", first.disconnected),
        *table("disc", [first.sector.text] if first.sector is not None else []),
        *table("glued", [candidate.text for candidate in first.glued], 10),
        *table("or", others, 10),
        *table("bolts", bolts),
        *table("supports", holds or ["none known: the structure is free until the scene has [[supports]]"]),
        *table("", _on_steps(first)),
        f"load       {where}, along ({', '.join(f'{x:g}' for x in place.direction)}); the output is at the same place",
        *table("to answer", [f"{finding.where}: {finding.word}: {finding.effect}" for finding in first.open_findings]),
    ]
