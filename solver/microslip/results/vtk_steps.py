"""Time series for ParaView, one VTKHDF file each: a constant mesh, and fields at every step.  Rank 0 only."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import h5py
import numpy as np

from ..mesh.data import Mesh
from ..system.files import atomic_write
from ..system.hdf5 import written_hdf5
from .joint_mesh import JointMesh
from .vtk import pack, vtk_root, write_grid, write_numbers

At = Callable[[int], Mapping[str, np.ndarray]]  # fields of a step, by name
_TOPOLOGIES = ("Vertices", "Lines", "Polygons", "Strips")  # of PolyData, in VTK's order; cells are counted in it


def write_structure_series(path: str, mesh: Mesh, times: Sequence[float] | np.ndarray, at_nodes: At) -> None:
    """Write fields at the nodes of the mesh, (n_nodes,) or (n_nodes, 3), as steps at ``times``.  Local.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    with atomic_write(path) as temporary, written_hdf5(temporary) as file:
        root = vtk_root(file, "UnstructuredGrid")
        write_grid(root, mesh)
        write_numbers(root, mesh)
        _write_steps(root, times, 1)
        _write_series(root, "PointData", len(mesh.points), len(times), at_nodes)
        _mark_constant(root, "PointData", ["node"], len(times))
        _mark_constant(root, "CellData", ["element", "body"], len(times))


def write_joint_series(
    path: str, joint: JointMesh, times: Sequence[float] | np.ndarray, at_pairs: At, constant: Mapping[str, np.ndarray]
) -> None:
    """Write fields of the pairs as polygons with values, in steps at ``times``.  Local.

    Parameters
    ----------
    at_pairs : (n_pairs,) or (n_pairs, 3) each at a step; ``displacement`` goes to the points, everything else to the polygons
    constant : (n_pairs,) or (n_pairs, 3) each, the same at all steps

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    order = np.argsort(joint.sizes > 1, kind="stable")  # points come before polygons
    pair, n = joint.pair[order], len(times)

    def of_cells(step: int) -> dict[str, np.ndarray]:
        return {name: values[pair] for name, values in at_pairs(step).items() if name != "displacement"}

    def of_points(step: int) -> dict[str, np.ndarray]:
        return {name: joint.weights @ values for name, values in at_pairs(step).items() if name == "displacement"}

    with atomic_write(path) as temporary, written_hdf5(temporary) as file:
        root = vtk_root(file, "PolyData")
        pack(root, "NumberOfPoints", np.array([len(joint.points)], dtype="i8"))
        pack(root, "Points", joint.points.astype("f8"))
        _write_polygons(root, joint, order)
        _write_steps(root, times, len(_TOPOLOGIES))
        _write_series(root, "CellData", len(pair), n, of_cells)
        _write_series(root, "PointData", len(joint.points), n, of_points)
        fixed = {"pair": np.arange(joint.weights.shape[1]), **constant}
        for name, values in fixed.items():
            pack(root, f"CellData/{name}", values[pair])
        _mark_constant(root, "CellData", list(fixed), n)


def _write_polygons(root: h5py.Group, joint: JointMesh, order: np.ndarray) -> None:
    """Write the cells as vertices and polygons, in the order given; lines and strips are empty."""
    corners = np.split(np.arange(len(joint.points)), joint.offsets[1:-1]) if len(joint.sizes) else []
    is_point = joint.sizes[order] == 1
    for name in _TOPOLOGIES:
        cells = order[is_point] if name == "Vertices" else order[~is_point] if name == "Polygons" else order[:0]
        ids = np.concatenate([np.zeros(0, dtype=int), *(corners[i] for i in cells)])
        pack(root, f"{name}/NumberOfCells", np.array([len(cells)], dtype="i8"))
        pack(root, f"{name}/NumberOfConnectivityIds", np.array([len(ids)], dtype="i8"))
        pack(root, f"{name}/Connectivity", ids.astype("i8"))
        pack(root, f"{name}/Offsets", np.concatenate([[0], np.cumsum(joint.sizes[cells])]).astype("i8"))


def _write_steps(root: h5py.Group, times: Sequence[float] | np.ndarray, n_topologies: int) -> None:
    """Write the steps: all of them read the same mesh, which begins at 0."""
    n = len(times)
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = np.int64(n)
    steps.create_dataset("Values", data=np.asarray(times, dtype="f8"))
    steps.create_dataset("NumberOfParts", data=np.ones(n, dtype="i8"))
    for name in ("PartOffsets", "PointOffsets"):
        steps.create_dataset(name, data=np.zeros(n, dtype="i8"))
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        steps.create_dataset(name, data=np.zeros((n, n_topologies), dtype="i8"))


def _write_series(root: h5py.Group, data: str, size: int, n: int, values_at: At) -> None:
    """Write fields of ``size`` places one step after the other, in single precision; none stays in memory."""
    sets: dict[str, h5py.Dataset] = {}
    for step in range(n):
        for name, values in values_at(step).items():
            if name not in sets:
                shape, chunk = (n * size, *values.shape[1:]), (max(size, 1), *values.shape[1:])
                packing = {"chunks": chunk, "compression": "gzip", "compression_opts": 1, "shuffle": True} if size > 256 else {}
                sets[name] = root.create_dataset(f"{data}/{name}", shape=shape, dtype="f4", **packing)
                root.create_dataset(f"Steps/{data}Offsets/{name}", data=np.arange(n, dtype="i8") * size)
            sets[name][step * size : (step + 1) * size] = values


def _mark_constant(root: h5py.Group, data: str, names: Sequence[str], n: int) -> None:
    """Mark fields that are the same at all steps."""
    for name in names:
        root.create_dataset(f"Steps/{data}Offsets/{name}", data=np.zeros(n, dtype="i8"))
