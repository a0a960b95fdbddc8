"""Read further formats with meshio, which prints, exits and guesses; here it may only return or fail."""

from __future__ import annotations

import contextlib
import io

import numpy as np

from ..parallel.errors import MeshError
from .file import Cells, FileMesh, Group

# Formats that can refer to other files through HDF5 (.xdmf, .h5, .med, .cgns, .e) are left out on purpose.
FORMATS = {".vtu": "vtu", ".vtk": "vtk", ".bdf": "nastran", ".nas": "nastran", ".fem": "nastran", ".mesh": "medit"}
_KINDS = {
    "vertex": "point", "line": "line2", "line3": "line3", "triangle": "tri3", "triangle6": "tri6", "quad": "quad4",
    "quad8": "quad8", "quad9": "quad9", "tetra": "tet4", "tetra10": "tet10", "hexahedron": "hex8",
    "hexahedron20": "hex20", "hexahedron27": "hex27", "wedge": "wedge6", "wedge15": "wedge15", "wedge18": "wedge18",
    "pyramid": "pyramid5", "pyramid13": "pyramid13", "pyramid14": "pyramid14",
}  # fmt: skip
_REFERENCES = ("nastran:ref", "medit:ref", "gmsh:physical", "cell_tags")    # the format's own word for a group
_MOST_VALUES = 1000     # an integer array with more values numbers its cells, it does not group them


def read_other(path: str, ending: str) -> FileMesh:
    """Read a file through meshio.  Local.

    Groups are the format's named sets, its references ("3"), and further integer arrays on cells or points
    ("name=3").  Node and cell numbers are ``GlobalNodeIds`` and ``GlobalCellIds`` where the file has them,
    otherwise positions from 1.

    Raises
    ------
    MeshError without the file's name: whatever meshio did not like.
    """
    mesh = _read_quietly(path, FORMATS[ending])
    cells, groups = [], {}
    numbers = _numbers(mesh.point_data.get("GlobalNodeIds"), len(mesh.points), 0)
    first = 0
    for i, block in enumerate(mesh.cells):
        own = mesh.cell_data.get("GlobalCellIds", [None] * len(mesh.cells))[i]
        kind = _KINDS.get(block.type, block.type)
        cells.append(Cells(kind, np.asarray(block.data, dtype=np.int64), _numbers(own, len(block.data), first)))
        first += len(block.data)
    for name, parts in mesh.cell_sets.items():
        for i, rows in enumerate(parts):
            if rows is not None and len(rows):
                groups.setdefault(name, Group()).add_cells(i, np.asarray(rows, dtype=np.int64))
    for name, nodes in mesh.point_sets.items():
        groups.setdefault(name, Group()).add_nodes(np.asarray(nodes, dtype=np.int64))
    _group_by_values(mesh, groups)
    points = np.asarray(mesh.points, dtype=float)
    if points.shape[1:] != (3,):
        raise MeshError(f"the points have {points.shape[-1]} coordinates, not 3")
    has_numbers = "GlobalNodeIds" in mesh.point_data
    notes = () if has_numbers else ("node and element numbers are positions in the file, from 1",)
    return FileMesh(points, numbers, tuple(cells), groups, notes)


def _read_quietly(path: str, file_format: str):
    """Return what meshio reads; anything else it does becomes a MeshError."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), np.errstate(all="ignore"):
            import meshio

            return meshio.read(path, file_format=file_format)
    except (KeyboardInterrupt, MemoryError):
        raise
    except ImportError:
        raise MeshError("this format needs meshio; install it: pip install meshio") from None
    except BaseException as problem:  # noqa: BLE001      meshio exits the interpreter on a bad file
        text = str(problem) if not isinstance(problem, SystemExit) else ""
        cause = " ".join((said.getvalue() + " " + text).split()) or type(problem).__name__
        raise MeshError(
            f"it cannot be read as {file_format}; it is truncated, damaged or another format ({cause[:200]})"
        ) from None


def _numbers(given: np.ndarray | None, n: int, first: int) -> np.ndarray:
    if given is None or len(given) != n:
        return np.arange(first + 1, first + n + 1)
    return np.asarray(given).astype(np.int64)


def _group_by_values(mesh, groups: dict[str, Group]) -> None:
    """Make a group of every value of the integer arrays; names of the format's field data are used."""
    named = {int(np.ravel(value)[0]): name for name, value in mesh.field_data.items() if np.size(value) == 2}
    for array, parts in mesh.cell_data.items():
        for i, values in enumerate(parts):
            if array == "GlobalCellIds" or not _groups_cells(values):
                continue
            for value in np.unique(values):
                plain = named.get(int(value), str(value)) if array in _REFERENCES else f"{array}={value}"
                groups.setdefault(plain, Group()).add_cells(i, np.flatnonzero(values == value))
    for array, values in mesh.point_data.items():
        if array != "GlobalNodeIds" and _groups_cells(values):
            for value in np.unique(values):
                groups.setdefault(f"{array}={value}", Group()).add_nodes(np.flatnonzero(values == value))


def _groups_cells(values: np.ndarray) -> bool:
    values = np.asarray(values)
    return values.ndim == 1 and values.dtype.kind in "iu" and 0 < len(np.unique(values)) <= _MOST_VALUES
