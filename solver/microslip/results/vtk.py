"""Fields on the mesh for ParaView: VTKHDF unstructured grids.  Rank 0 only.

Elements keep the node order of :class:`~microslip.mesh.data.Mesh`, which is VTK's; nodes keep the order of the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np

from ..mesh.data import Mesh
from ..mesh.skin import groups_of_bodies
from ..system.files import atomic_write
from ..system.hdf5 import written_hdf5

VERSION = (2, 1)
_CHUNK = 2**20  # bytes that are packed, written and copied together
CELL_TYPE = {"tet4": 10, "hex8": 12, "wedge6": 13, "pyramid5": 14, "tet10": 24, "hex20": 25, "wedge15": 26, "pyramid13": 27}


def write_modes(path: str, mesh: Mesh | str, omega_n: np.ndarray, fields: np.ndarray) -> None:
    """Write mode shapes as point vectors ``mode_01_102.3Hz``, ....  Local, on rank 0.

    Parameters
    ----------
    path : ends in .vtkhdf
    mesh : the mesh, or the path of a file that this function has written with it, from which its data are copied
    omega_n : (n_modes,) rad/s
    fields : (n_modes, n_nodes, 3) displacements in the order of ``mesh.points``

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    digits = max(2, len(str(len(omega_n))))
    hertz = [f"{f:.1f}Hz" if f >= 1.0 else f"{f:.3g}Hz" for f in omega_n / (2.0 * np.pi)]
    named = {f"mode_{i + 1:0{digits}d}_{name}": field for i, (name, field) in enumerate(zip(hertz, fields, strict=True))}
    write_fields(path, mesh, named)


def peak_fields(level: float, frequency: float, u: np.ndarray) -> dict[str, np.ndarray]:
    """Return the vectors of a response for :func:`write_fields`: mean, cos 1 (real part) and sin 1 (minus the imaginary part).

    Local.  u(t) = mean + cos1 cos(omega t) + sin1 sin(omega t) + ..., complex amplitude cos1 - i sin1.

    Parameters
    ----------
    level : N
    frequency : Hz
    u : (n_nodes, 3, N_H) m
    """
    name = f"{level:g}N_{frequency:.6g}Hz"
    return {f"{name}_{part}": u[:, :, k] for k, part in enumerate(("mean", "cos1", "sin1"))}


def write_fields(path: str, mesh: Mesh | str, fields: Mapping[str, np.ndarray]) -> None:
    """Write named point fields, (n_nodes, 3) or (n_nodes,) each, in the order of ``mesh.points``.  Local, on rank 0.

    They are single precision: some seven digits, for pictures.  With them come ``node`` and ``element``, the numbers of the
    user's file, and ``body``, the element's physical group, counted from 0 in the order of ``mesh.elements``.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    with atomic_write(path) as temporary, written_hdf5(temporary) as file:
        root = vtk_root(file, "UnstructuredGrid")
        if isinstance(mesh, Mesh):
            write_grid(root, mesh)
            write_numbers(root, mesh)
        else:
            _copy_mesh(mesh, root)
        for name, values in fields.items():
            values = values.astype("f4", copy=False)
            root.create_dataset(f"PointData/{name}", data=values)  # packed: a fifth less, six times as long


def _copy_mesh(path: str, root: h5py.Group) -> None:
    """Copy the data of :func:`write_grid` and :func:`write_numbers` to another file, without unpacking.  Local."""
    with h5py.File(path, "r") as file:
        for name, part in file["VTKHDF"].items():
            if name != "PointData":
                file.copy(part, root, name)
        file.copy(file["VTKHDF/PointData/node"], root.require_group("PointData"), "node")


def vtk_root(file: h5py.File, kind: str) -> h5py.Group:
    """Return the group of a file that VTK reads, of a kind of data set.  Local."""
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array(VERSION, dtype="i8")
    root.attrs.create("Type", kind.encode(), dtype=h5py.string_dtype("ascii", len(kind)))
    return root


def write_grid(root: h5py.Group, mesh: Mesh) -> None:
    """Write points, connectivity and cell types of one piece.  Local."""
    connectivity = np.concatenate([block.nodes.ravel() for block in mesh.elements])
    sizes = np.concatenate([np.full(len(block.nodes), block.nodes.shape[1]) for block in mesh.elements])
    types = np.concatenate([np.full(len(block.nodes), CELL_TYPE[block.kind]) for block in mesh.elements])
    for name, count in (
        ("NumberOfPoints", len(mesh.points)),
        ("NumberOfCells", len(sizes)),
        ("NumberOfConnectivityIds", len(connectivity)),
    ):
        root.create_dataset(name, data=np.array([count], dtype="i8"))
    pack(root, "Points", mesh.points.astype("f8"))
    pack(root, "Connectivity", connectivity.astype("i8"))
    pack(root, "Offsets", np.concatenate([[0], np.cumsum(sizes)]).astype("i8"))
    pack(root, "Types", types.astype("u1"))


def write_numbers(root: h5py.Group, mesh: Mesh) -> None:
    """Write the user's numbers of nodes and elements, and the body of each element.  Local."""
    groups = groups_of_bodies(mesh)
    pack(root, "PointData/node", mesh.numbers.astype("i8"))
    pack(root, "CellData/element", np.concatenate([block.numbers for block in mesh.elements]).astype("i8"))
    body = [np.full(len(block.nodes), groups.index(block.group)) for block in mesh.elements]
    pack(root, "CellData/body", np.concatenate(body).astype("i4"))


def pack(root: h5py.Group, name: str, values: np.ndarray) -> None:
    """Write an array, packed where it is large.  Local."""
    packing: dict[str, Any] = {}
    if values.nbytes > 4096:
        rows = min(len(values), max(1, _CHUNK * len(values) // values.nbytes))
        packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "chunks": (rows, *values.shape[1:])}
    root.create_dataset(name, data=values, **packing)
