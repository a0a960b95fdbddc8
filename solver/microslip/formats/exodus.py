"""Read Exodus II files: element blocks, node sets and side sets with their names, numbers of nodes and elements."""

import io
import os
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import h5py
import numpy as np
import scipy.io

from ..messages.errors import MeshError
from ..messages.words import counted
from ..system.sandbox import LibraryError, SandboxError, read_file
from .draft import face_of
from .hdf5 import MOST_GAIN, Storage
from .model import KINDS, Cells, FileModel, Finding, Group, family_of

_SHAPES = {"TET": "tet", "HEX": "hex", "WED": "wedge", "PYR": "pyramid", "TRI": "tri", "QUA": "quad", "SHE": "quad"}
_SIZES = {"tet": (4, 10), "hex": (8, 20, 27), "wedge": (6, 15), "pyramid": (5, 13), "tri": (3, 6), "quad": (4, 8)}
_KINDS = {(word, size): f"{shape}{size}" for word, shape in _SHAPES.items() for size in _SIZES[shape]}
# Exodus writes the mid-side nodes of vertical edges before the mid-side nodes of the top
_ORDER = {"hex20": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15], "wedge15": [*range(9), 12, 13, 14, 9, 10, 11]}
# sides 1, 2, ... by their corners
_SIDES = {
    "hex": ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 3, 7, 4), (0, 1, 2, 3), (4, 5, 6, 7)),
    "tet": ((0, 1, 3), (1, 2, 3), (0, 2, 3), (0, 1, 2)),
    "wedge": ((0, 1, 3, 4), (1, 2, 4, 5), (0, 2, 3, 5), (0, 1, 2), (3, 4, 5)),
    "pyramid": ((0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 3, 4), (0, 1, 2, 3)),
}
_HDF5 = b"\x89HDF\r\n\x1a\n"
_PARTS = (FileModel, Cells, Group, Finding)


def read_exodus(path: str) -> FileModel:
    """Read an Exodus file, in classic NetCDF or in HDF5.  Local.

    Groups are the element blocks, node sets and side sets; without a name they are "block 1", "node set 1", "side set 1".

    Raises
    ------
    MeshError without the file's name: the file is damaged, not an Exodus file, or refers to other files through HDF5
    """
    with open(path, "rb") as file:
        head = file.read(8)
    if head[:3] != b"CDF" and head != _HDF5:
        raise MeshError("it is not a NetCDF file (classic or HDF5), as Exodus files are")
    try:
        return _read(path) if head != _HDF5 else read_file(path, _read, path, gain=MOST_GAIN, returns=_PARTS)
    except (SandboxError, LibraryError) as problem:
        raise MeshError(f"it is truncated or damaged: {' '.join(str(problem).split())[:200]}") from None


def _read(path: str) -> FileModel:
    with ExitStack() as stack:
        variable = _opened(path, stack)
        try:
            return _model(variable)
        except (RuntimeError, KeyError, TypeError, AttributeError) as problem:  # from the libraries, for damaged files
            raise MeshError(f"it is truncated or damaged ({' '.join(str(problem).split())[:200]})") from None


def _model(variable: Callable[[str], Any]) -> FileModel:
    points = _points(variable)
    numbers = _numbers(variable("node_num_map"), len(points))
    cells, groups, findings = _blocks(variable)
    _node_sets(variable, groups, len(points))
    _side_sets(variable, cells, groups)
    return FileModel(points, numbers, tuple(cells), groups, findings=tuple(findings))


def _opened(path: str, stack: ExitStack) -> Callable[[str], Any]:
    """Return a function from a name to the variable with its attributes, or to None if the file has no such variable."""
    with open(path, "rb") as file:
        head = file.read(8)
    if head != _HDF5:
        try:
            file = stack.enter_context(_Bounded(io.FileIO(path)))
            netcdf = stack.enter_context(scipy.io.netcdf_file(file, mmap=False))
        except (TypeError, ValueError, OSError, KeyError, AssertionError, AttributeError) as problem:
            raise MeshError(f"it is truncated, damaged or not a NetCDF file ({problem})") from None
        return lambda name: netcdf.variables.get(name)
    try:
        hdf = stack.enter_context(h5py.File(path, "r"))
    except OSError as problem:
        raise MeshError(f"it is truncated or damaged ({problem})") from None
    storage = Storage(os.path.getsize(path))
    return lambda name: _dataset(hdf, name, storage)


class _Bounded(io.BufferedReader):
    """A file that refuses to read beyond its end, because the reader of classic NetCDF does not check counts."""

    def read(self, n: int | None = -1, /) -> bytes:
        n_left = os.fstat(self.fileno()).st_size - self.tell()
        if n is None or not 0 <= n <= n_left:
            raise ValueError(f"{n} bytes are announced, {n_left} follow")
        return super().read(n)


def _dataset(hdf: h5py.File, name: str, storage: Storage) -> Any:
    """Return a data set of the file itself; MeshError if it lies in another file or is too large."""
    if hdf.get(name, getlink=True) is None:
        return None
    fault = storage.link_fault(hdf, name)
    if fault is None and not isinstance(hdf[name], h5py.Dataset):
        fault = f"{name} is a group where numbers are expected"
    if fault is not None:
        raise MeshError(f"{fault}; the file is damaged or refers to others")
    return hdf[name]


def _array(variable: Any) -> np.ndarray:
    return np.asarray(variable[...] if isinstance(variable, h5py.Dataset) else variable[:])


def _attribute(variable: Any, name: str) -> str:
    value = variable.attrs.get(name, b"") if isinstance(variable, h5py.Dataset) else getattr(variable, name, b"")
    value = value.tobytes() if isinstance(value, np.ndarray) else value
    return value.decode(errors="replace").strip("\x00 ") if isinstance(value, bytes) else str(value)


def _points(variable: Callable[[str], Any]) -> np.ndarray:
    single = [variable(f"coord{axis}") for axis in "xyz"]
    if variable("coord") is not None:
        points = _array(variable("coord")).T
    elif all(coordinate is not None for coordinate in single):
        points = np.stack([_array(coordinate) for coordinate in single], axis=1)
    else:
        raise MeshError("it holds no coordinates in three dimensions (coordx, coordy, coordz)")
    return np.asarray(points, dtype=float)


def _numbers(variable: Any, n: int) -> np.ndarray:
    numbers = np.arange(1, n + 1) if variable is None else _array(variable).astype(np.int64)
    if len(numbers) != n or len(np.unique(numbers)) != n:
        raise MeshError(f"{len(np.unique(numbers))} different numbers for {n} nodes or elements; the file is damaged")
    return numbers


def _names(variable: Any, n: int, kind: str) -> list[str]:
    """Return the names of blocks or sets; the name of an unnamed one is its position."""
    rows = _array(variable) if variable is not None else np.zeros((0, 1), dtype="S1")
    texts = [b"".join(bytes(letter) for letter in row).split(b"\x00")[0].decode(errors="replace").strip() for row in rows]
    return [texts[i] if i < len(texts) and texts[i] else f"{kind} {i + 1}" for i in range(n)]


def _in_order(variable: Callable[[str], Any], stem: str, identities: str) -> list[Any]:
    """Return the variables stem1, stem2, ..., one per identity; None for empty ones, which the file leaves out."""
    known = variable(identities)
    variables: list[Any] = []
    while len(variables) < (0 if known is None else known.shape[0]) or variable(f"{stem}{len(variables) + 1}") is not None:
        variables.append(variable(f"{stem}{len(variables) + 1}"))
    return variables


def _blocks(variable: Callable[[str], Any]) -> tuple[list[Cells], dict[str, Group], list[Finding]]:
    blocks = _in_order(variable, "connect", "eb_prop1")
    shapes = [block.shape if block is not None else (0, 0) for block in blocks]
    element_numbers = _numbers(variable("elem_num_map"), sum(shape[0] for shape in shapes))
    names = _names(variable("eb_names"), len(blocks), "block")
    cells: list[Cells] = []
    groups: dict[str, Group] = {}
    findings, first = [], 0
    for name, block, (n, n_nodes) in zip(names, blocks, shapes, strict=True):
        if block is None:
            continue
        word = _attribute(block, "elem_type").upper()
        kind = _KINDS.get((word[:3], n_nodes), word.lower() or "unknown")
        nodes = _array(block).astype(np.int64) - 1
        cells.append(Cells(kind, nodes[:, _ORDER[kind]] if kind in _ORDER else nodes, element_numbers[first : first + n]))
        if kind not in KINDS:
            effect = f"{counted(n, 'element')} of a kind that is not a solid here"
            findings.append(Finding(word=word or "elements", where=f"block {name!r}", effect=effect, changes=True))
        groups.setdefault(name, Group()).add_cells(len(cells) - 1, np.arange(n))
        first += n
    return cells, groups, findings


def _node_sets(variable: Callable[[str], Any], groups: dict[str, Group], n_points: int) -> None:
    sets = _in_order(variable, "node_ns", "ns_prop1")
    for name, members in zip(_names(variable("ns_names"), len(sets), "node set"), sets, strict=True):
        nodes = (_array(members) if members is not None else np.zeros(0)).astype(np.int64) - 1
        if ((nodes < 0) | (nodes >= n_points)).any():
            raise MeshError(f"node set {name!r} names a node that the file does not hold")
        groups.setdefault(name, Group()).add_nodes(nodes)


def _side_sets(variable: Callable[[str], Any], cells: list[Cells], groups: dict[str, Group]) -> None:
    """Add the sides of side sets as separate cells."""
    sets, sides = _in_order(variable, "elem_ss", "ss_prop1"), _in_order(variable, "side_ss", "ss_prop1")
    start = np.cumsum([0] + [len(block.nodes) for block in cells])
    n_blocks = len(cells)
    for name, of_elements, of_sides in zip(_names(variable("ss_names"), len(sets), "side set"), sets, sides, strict=True):
        if of_elements is None or of_sides is None:
            continue
        element, number = _array(of_elements).astype(np.int64) - 1, _array(of_sides).astype(np.int64)
        if len(element) != len(number) or ((element < 0) | (element >= start[-1])).any():
            raise MeshError(f"side set {name!r} names an element that the file does not hold")
        group = groups.setdefault(name, Group())
        for block in range(n_blocks):
            in_block = (element >= start[block]) & (element < start[block + 1])
            for side in np.unique(number[in_block]):
                rows = element[in_block & (number == side)] - start[block]
                made = _side(cells[block], int(side), rows, name)
                if made is not None:
                    cells.append(made)
                    group.add_cells(len(cells) - 1, np.arange(len(rows)))


def _side(block: Cells, number: int, rows: np.ndarray, name: str) -> Cells | None:
    """Return side ``number`` of some elements as cells; None if the elements are not solids here."""
    family = family_of(block.kind)
    if family not in _SIDES:
        return None
    if not 1 <= number <= len(_SIDES[family]):
        raise MeshError(f"side set {name!r} names side {number} of a {family}")
    face = face_of(block.kind, _SIDES[family][number - 1])
    return Cells(face[0], block.nodes[rows][:, face[1]], block.numbers[rows]) if face is not None else None
