"""Read the model in a results file of Ansys (.rst): mesh, materials, components, supports."""

import importlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...messages.errors import MeshError
from ...system.sandbox import LibraryError, SandboxError, read_file
from ..model import FileModel
from .blocks import Blocks, blocks_of_archive
from .commands import Command
from .read import model_of

_GAIN = 400  # bytes of memory per byte of the file: records may be compressed
_LIBRARY = "ansys.mapdl.reader"
_NOT_STATED = (
    "a results file has no equations, couplings, rigid regions (CE, CP, CERIG) and real constants; the archive has them: "
    "CDWRITE,DB,model,cdb"
)
Contents = tuple[Blocks, list[tuple[str, ...]]]  # the mesh, and further data as commands: word and fields


def read_rst(path: str) -> FileModel:
    """Read a results file: solids by material and type, components, supports of the first result.  Local.

    Raises
    ------
    MeshError without the file's name: the library is missing, the file is damaged, or has unsupported shapes
    """
    try:
        blocks, commands_read = read_file(path, _parts, path, gain=_GAIN, returns=(Blocks,))
    except SandboxError as problem:
        raise MeshError(f"it is truncated or damaged: {problem}") from None
    except LibraryError as problem:  # any failure of the library on a damaged file
        raise MeshError(f"it is truncated, damaged, or holds no results of Ansys ({problem})") from None
    model = model_of(blocks, tuple(Command(fields[0], fields[1:], 0) for fields in commands_read))
    return replace(model, facts=(*model.facts, _NOT_STATED))


def _parts(path: str) -> Contents:
    """Return the library's data as plain numbers and words."""
    try:
        library = importlib.import_module(_LIBRARY)
    except ImportError:
        raise MeshError(
            "results of Ansys are read by ansys-mapdl-reader; install it: pip install ansys-mapdl-reader (with VTK some 500 MB), "
            "or write the archive: CDWRITE,DB,model,cdb"
        ) from None
    result = library.read_binary(path, parse_vtk=False)
    if not hasattr(result, "mesh") or not hasattr(result, "materials"):
        raise ValueError("it holds no mesh")
    blocks = blocks_of_archive(result.mesh)
    keys = {
        int(number): {i: int(value) for i, value in enumerate(values, 1) if value}
        for number, values in result._element_table["keyopts"].items()  # missing in the library's mesh
    }
    return replace(blocks, keys=keys), [*_materials(result.materials), *_supports(result)]


def _materials(materials: Mapping[int, Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Return the materials as MP commands; other than single numbers become findings."""
    return [
        ("MP", label, str(number), repr(float(value))) if np.ndim(value) == 0 else ("TB", label, str(number))
        for number, known in materials.items()
        for label, value in known.items()
    ]


def _supports(result: Any) -> list[tuple[str, ...]]:
    """Return the supports of the first result, if any, as D commands."""
    try:
        nodes, dofs, values = result.nodal_boundary_conditions(0)
    except (IndexError, ValueError):
        return []
    names = result.result_dof(0)
    return [("D", str(int(node)), names[int(dof) - 1], repr(float(value))) for node, dof, value in zip(nodes, dofs, values)]
