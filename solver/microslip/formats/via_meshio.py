"""Read further formats with meshio; its prints, exits and guesses become errors."""

import contextlib
import io
import os
import re
import tempfile
from collections.abc import Iterator

import numpy as np

from ..messages.errors import Interrupted, MeshError
from .model import KINDS, Cells, FileModel, Group, names_of_tags

# Formats that can refer to other files through HDF5 (.xdmf, .h5, .med, .cgns, .e) are left out on purpose.
WHOLE = "all"  # the group of all volume elements, for a file without groups of volume elements
FORMATS = {".vtu": "vtu", ".vtk": "vtk"}
_NAMES = (  # of meshio, in the order of KINDS
    "vertex line line3 triangle triangle6 quad quad8 quad9 tetra tetra10 hexahedron hexahedron20 hexahedron27 "
    "wedge wedge15 wedge18 pyramid pyramid13 pyramid14"
)
_KINDS = dict(zip(_NAMES.split(), KINDS, strict=True))
_REFERENCES = ("gmsh:physical", "cell_tags")  # the format's word for a group
_TEXTS = re.compile(rb'<(Array|DataArray)\b[^>]*type="String"[^>]*?(/>|>.*?</\1>)', re.DOTALL)
_HEAD = 200  # bytes of an XML element within which its encoding is stated
_MOST_VALUES = 1000  # an integer array with more distinct values numbers the cells and does not group them


def read_other(path: str) -> FileModel:
    """Read a file through meshio.  Local.

    Groups are the format's named sets, its references ("3"), and further integer arrays on cells or points
    ("name=3").  Node and cell numbers are ``GlobalNodeIds`` and ``GlobalCellIds`` if the file has them, otherwise positions
    from 1.

    Raises
    ------
    MeshError without the file's name: any failure of meshio.
    """
    file_format = FORMATS[os.path.splitext(path)[1].lower()]
    with _without_texts(path, file_format) as plain:
        mesh = _read_quietly(plain, file_format)
    points = np.asarray(mesh.points, dtype=float)
    if points.shape[1:] != (3,):
        raise MeshError(f"the points have {points.shape[-1]} coordinates, not 3")
    node_numbers, cell_numbers = _global_ids(mesh)
    n_cells = sum(len(block.data) for block in mesh.cells)
    has_numbers = len(node_numbers) == len(points) and len(cell_numbers) == n_cells
    if not has_numbers:
        node_numbers, cell_numbers = np.arange(1, len(points) + 1), np.arange(1, n_cells + 1)
    cells, first = [], 0
    for block in mesh.cells:
        numbers = cell_numbers[first : first + len(block.data)]
        first += len(block.data)
        cells.append(Cells(_KINDS.get(block.type, block.type), np.asarray(block.data, dtype=np.int64), numbers))
    groups: dict[str, Group] = {}
    for name, parts in mesh.cell_sets.items():
        for i, rows in enumerate(parts):
            if rows is not None and len(rows):
                groups.setdefault(name, Group()).add_cells(i, np.asarray(rows, dtype=np.int64))
    for name, nodes in mesh.point_sets.items():
        groups.setdefault(name, Group()).add_nodes(np.asarray(nodes, dtype=np.int64))
    _group_by_values(mesh, cells, groups)
    notes = [] if has_numbers else ["node and element numbers are positions in the file, from 1"]
    volumes = [i for i, block in enumerate(cells) if KINDS.get(block.kind, (0, 0))[0] == 3]
    if volumes and not any(i in group.cells for group in groups.values() for i in volumes):
        whole = groups.setdefault(WHOLE, Group())
        for i in volumes:
            whole.add_cells(i, np.arange(len(cells[i].nodes)))
        notes.append(f"no group holds volume elements; all of them are the group {WHOLE!r}")
    return FileModel(points, node_numbers, tuple(cells), groups, tuple(notes), _fields(mesh))


@contextlib.contextmanager
def _without_texts(path: str, file_format: str) -> Iterator[str]:
    """Yield a path to the file, or to a copy without the string arrays of VTK and pyvista, which meshio does not know.

    In a file with raw bytes, whose arrays meshio counts, a string array becomes an array of bytes.
    """
    with open(path, "rb") as file:
        content = file.read() if file_format == "vtu" else b""
    head, mark, raw = content.partition(b"<AppendedData")
    if b'"vtkLZ4DataCompressor"' in head:
        raise MeshError("it is compressed by LZ4, which meshio does not read; save it with zlib, or without compression")
    if b'type="String"' not in head:
        yield path
        return
    is_raw = bool(mark) and b'encoding="raw"' in raw[:_HEAD]
    head = _TEXTS.sub(_as_bytes if is_raw else b"", head)
    with tempfile.TemporaryDirectory() as folder:
        copy = os.path.join(folder, "copy.vtu")
        with open(copy, "wb") as file:
            file.write(head + mark + raw)
        yield copy


def _as_bytes(match: re.Match[bytes]) -> bytes:
    """Return a string array as an array of bytes."""
    return re.sub(rb"(</?)Array\b", rb"\1DataArray", match[0].replace(b'"String"', b'"UInt8"'))


def _fields(mesh) -> dict[str, np.ndarray]:
    """Return the real scalar arrays on points."""
    arrays = {name: np.asarray(values) for name, values in mesh.point_data.items()}
    return {
        name: values.reshape(-1).astype(float)
        for name, values in arrays.items()
        if values.dtype.kind == "f" and values.size == len(values)
    }


def load_meshio():
    """Return meshio, with quadratic wedges and pyramids added to its tables if they are missing.  Local.

    Version 5.3 reads the nodes of these cells, but they are missing in its table of dimensions, and it has no public way to add
    a kind.  Its tables of types for VTK's formats 4 and 5.1 each lack some of the other's, and "int" of 5.1 has 8 bytes there.

    Raises
    ------
    MeshError : this version of meshio has neither these cells nor the table
    """
    import meshio

    for kind, n_nodes in (("wedge15", 15), ("pyramid13", 13)):
        try:
            meshio.CellBlock(kind, np.zeros((0, n_nodes), dtype=np.int64))
        except KeyError:
            dimensions = getattr(getattr(meshio, "_mesh", None), "topological_dimension", None)
            if not isinstance(dimensions, dict):
                raise MeshError(f"meshio {meshio.__version__} has no cells {kind}; install meshio 5.3") from None
            dimensions[kind] = 3
    older, newer = (getattr(getattr(meshio.vtk, f"_vtk_{version}", None), "vtk_to_numpy_dtype_name", {}) for version in (42, 51))
    both = {**newer, **older}
    older.update(both)
    newer.update(both)
    return meshio


def _read_quietly(path: str, file_format: str):
    """Return the mesh read by meshio; a MeshError for any other outcome and for cells that meshio leaves out."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed), np.errstate(all="ignore"):
            mesh = load_meshio().read(path, file_format=file_format)
    except (Interrupted, KeyboardInterrupt, MemoryError, MeshError):
        raise
    except ImportError:
        raise MeshError("this format needs meshio; install it: pip install meshio") from None
    except BaseException as problem:  # meshio exits the interpreter on a bad file
        text = str(problem) if not isinstance(problem, SystemExit) else ""
        cause = " ".join((printed.getvalue() + " " + text).split()) or type(problem).__name__
        raise MeshError(
            f"it cannot be read as {file_format}; it is truncated, damaged or another format ({cause[:200]})"
        ) from None
    left_out = re.search(r"cannot\s+handle\s+\(type\s+(\d+)", printed.getvalue())
    if left_out:
        raise MeshError(f"it holds cells of VTK's type {left_out[1]}, which meshio leaves out; write solids and faces alone")
    return mesh


def _global_ids(mesh) -> tuple[np.ndarray, np.ndarray]:
    nodes = mesh.point_data.get("GlobalNodeIds", ())
    cells = mesh.cell_data.get("GlobalCellIds", ())
    return np.asarray(nodes).astype(np.int64), np.concatenate([np.zeros(0, dtype=np.int64), *cells]).astype(np.int64)


def _group_by_values(mesh, cells: list[Cells], groups: dict[str, Group]) -> None:
    """Make a group for every value of the integer arrays, with the names of the format's field data."""
    named = {int(np.ravel(value)[0]): name for name, value in mesh.field_data.items() if np.size(value) == 2}
    dimension = [KINDS.get(block.kind, (3, 0))[0] for block in cells]
    for array, parts in mesh.cell_data.items():
        if array == "GlobalCellIds":
            continue
        grouping = [i for i, values in enumerate(parts) if _is_grouping(values)]
        keys = {(dimension[i], int(value)) for i in grouping for value in np.unique(parts[i])}
        names = {key: f"{array}={key[1]}" for key in keys}
        if array in _REFERENCES:
            names = {key: named.get(key[1], name) for key, name in names_of_tags(keys).items()}
        for i in grouping:
            for value in np.unique(parts[i]):
                name = names[dimension[i], int(value)]
                groups.setdefault(name, Group()).add_cells(i, np.flatnonzero(parts[i] == value))
    for array, values in mesh.point_data.items():
        if array not in ("GlobalNodeIds", *_REFERENCES) and _is_grouping(values):
            for value in np.unique(values):
                groups.setdefault(f"{array}={value}", Group()).add_nodes(np.flatnonzero(values == value))


def _is_grouping(values: np.ndarray) -> bool:
    """Return whether an array groups cells or points: integers with few distinct values."""
    values = np.asarray(values)
    return values.ndim == 1 and values.dtype.kind in "iu" and 0 < len(np.unique(values)) <= _MOST_VALUES
