"""The mesh of all bodies of a model file, without a scene."""

import numpy as np

from ...formats.model import KINDS, FileModel, Group
from ...mesh.data import Mesh
from ...mesh.read import read_mesh
from ...messages.errors import MeshError
from ...tables.structure import Body, Model
from ...tables.structure_tables import StructureTables
from ...tables.units import UNITS, Units
from .plausible import SI, better_units, suspicion


def whole_mesh(path: str, file: FileModel, units: Units) -> tuple[Mesh, StructureTables]:
    """Return the mesh of all bodies of a model file in metres, and the tables used to read it.  Local, rank 0.

    Raises
    ------
    MeshError : no volume elements, some outside all named groups, or of unsupported kinds
    """
    bodies = {name: Body.of_file(group=group) for name, group in bodies_of(file).items()}
    if not bodies:
        raise MeshError(f"{path}: {_no_bodies(file)}")
    model = Model.of_file(mesh=str(path), scale=units.length, take=())
    tables = StructureTables.of_file(model=model, bodies=bodies)
    return read_mesh(tables, file), tables


def densities_of(file: FileModel, units: Units) -> dict[str, float]:
    """Return the density of each body in kg/m3, NaN if the file does not state it.  Local."""
    known = {name: file.materials.get(body.material) for name, body in file.bodies.items()}
    stated = {name: None if material is None else material.density for name, material in known.items()}
    return {name: np.nan if (rho := stated.get(name)) is None else rho * units.density for name in bodies_of(file)}


def likely_units(path: str, file: FileModel) -> str:
    """Return the units in which a file is plausible: SI, or others if materials or size are implausible in SI.  Local, rank 0.

    Millimetres are assumed for a mesh without materials whose size is implausible in metres.
    """
    mesh, _ = whole_mesh(path, file, UNITS[SI])
    if not suspicion(mesh.diagonal, file.materials, UNITS[SI]):
        return SI
    better = better_units(mesh.diagonal, file.materials.values())
    return better[0] if better else "mm-kg-s" if not file.materials and mesh.diagonal > 1.0 else SI


def bodies_of(file: FileModel) -> dict[str, str]:
    """Return the group of each body: as stated by the file, or groups that contain each volume element once.  Local.

    Of nested groups the small ones are taken if they contain all elements, otherwise the large ones.
    """
    if file.bodies:
        return {name: body.group for name, body in file.bodies.items()}
    members = {name: solids for name, group in file.groups.items() if len(solids := solids_of(file, group))}
    n_solids = sum(len(cell.nodes) for cell in file.cells if _is_solid(cell.kind))
    by_size = sorted(members, key=lambda name: len(members[name]))
    for names in (by_size, by_size[::-1]):
        taken = np.zeros(sum(len(cell.nodes) for cell in file.cells), dtype=bool)
        chosen = set()
        for name in names:
            if not taken[members[name]].any():
                taken[members[name]] = True
                chosen.add(name)
        if np.count_nonzero(taken) == n_solids:
            break
    return {name: name for name in members if name in chosen}


def solids_of(file: FileModel, group: Group) -> np.ndarray:
    """Return the volume elements of a group, indices over all cells of the file, ascending.  Local."""
    start = np.cumsum([0, *(len(cell.nodes) for cell in file.cells)])
    rows = [start[i] + rows_of_block for i, rows_of_block in group.cells.items() if _is_solid(file.cells[i].kind)]
    return np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *rows]))


def _is_solid(kind: str) -> bool:
    return KINDS.get(kind, (0, 0))[0] == 3


def _no_bodies(file: FileModel) -> str:
    """Return the reason why there is no body."""
    kinds = {cell.kind: len(cell.nodes) for cell in file.cells if len(cell.nodes)}
    if any(_is_solid(kind) for kind in kinds):
        return (
            "its volume elements are in no named group, and a body is a named group of them (in Gmsh a Physical Volume with a "
            "name); name one in the program that wrote the file"
        )
    unknown = [f"{finding.where}: {finding.word}" for finding in file.findings if finding.effect.startswith("not known")]
    nodes = f"nodes, and {', '.join(unknown[:3])}, not known to this program" if unknown else "nodes alone"
    others = [
        f"{finding.where}: {finding.word}, {finding.effect}" for finding in file.findings if finding.word.startswith("element ")
    ]
    contents = ", ".join(f"{n} {kind}" for kind, n in kinds.items()) or "; ".join(others) or nodes
    return f"it holds no volume elements ({contents}): nothing that could be a body"
