"""Fields of the whole structure in results.h5: its mesh, mode shapes, state of rest, the motion at the peak of every level.

They have single precision (some seven digits), for pictures and other programs.  They are written when everything is solved;
without a mesh there are none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import h5py
import numpy as np

from ..elements import KINDS
from ..mesh.data import ElementBlock, Mesh
from ..messages.errors import CaseError
from ..system.hdf5 import extended_hdf5
from .checked_datasets import Reader, opened
from .writer import write_array, write_texts


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of the structure at a point of a level."""

    point: int  # on its curve, from 0
    u: np.ndarray  # (n_nodes, 3, N_H) m: mean, cos 1, sin 1, ..., in the order of the mesh


@dataclass(frozen=True, eq=False)
class Fields:
    """Fields at the nodes of the mesh, in its order."""

    mesh: Mesh
    shapes: np.ndarray  # (n_modes, n_nodes, 3) mode shapes, M-normalised [1/sqrt(kg)]
    rest: np.ndarray | None = None  # (n_nodes, 3) m, displacement at rest; None without statics
    peaks: Mapping[int, Motion] = field(default_factory=dict)  # by the number of the level
    output_node: tuple[int, ...] = ()  # numbers in the mesh file; -1 of an output that has none
    output_direction: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))  # (n_outputs, 3)


@dataclass(frozen=True)
class StageRecord:
    """The cost of a stage of the run."""

    name: str
    seconds: float  # of the slowest rank
    memory: float  # MiB, the peak of all ranks together until its end
    depth: int = 0  # number of enclosing stages


@dataclass(frozen=True)
class RunRecord:
    """The log of a run until its results were written."""

    stages: tuple[StageRecord, ...] = ()
    notes: tuple[str, ...] = ()


def store_fields(path: str, fields: Fields | None, run: RunRecord | None = None) -> None:
    """Add fields and the log of the run to a result file, atomically.  Local, on rank 0.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    if fields is None and run is None:
        return
    with extended_hdf5(path) as file:
        if run is not None:
            _write_run(file, run)
        if fields is not None:
            _write_mesh(file, fields.mesh)
            _write_fields(file, fields)


def _write_run(file: h5py.File, run: RunRecord) -> None:
    write_texts(file, "run/notes", run.notes)
    write_texts(file, "run/stages/name", [stage.name for stage in run.stages])
    write_array(file, "run/stages/seconds", np.array([stage.seconds for stage in run.stages], dtype="f8"), "s")
    write_array(file, "run/stages/memory_MiB", np.array([stage.memory for stage in run.stages], dtype="f8"), "MiB")
    write_array(file, "run/stages/depth", np.array([stage.depth for stage in run.stages], dtype="i4"), "enclosing stages")


def _write_mesh(file: h5py.File, mesh: Mesh) -> None:
    write_array(file, "mesh/points", mesh.points, "m")
    write_array(file, "mesh/node", mesh.numbers.astype("i8"), "number in the mesh file")
    for i, block in enumerate(mesh.elements):
        group = f"mesh/elements/{i:04d}"
        write_array(file, f"{group}/nodes", block.nodes.astype("i4"), "index into mesh/points")
        write_array(file, f"{group}/element", block.numbers.astype("i8"), "number in the mesh file")
        write_texts(file, f"{group}/kind", block.kind)
        write_texts(file, f"{group}/group", block.group)


def _write_fields(file: h5py.File, fields: Fields) -> None:
    _write_motion(file, "modes/shape", fields.shapes, "1/sqrt(kg)")
    write_array(file, "outputs/node", np.array(fields.output_node, dtype="i8"), "number in the mesh file")
    write_array(file, "outputs/direction", fields.output_direction, "1")
    if fields.rest is not None:
        _write_motion(file, "statics/displacement", fields.rest, "m")
    for number, motion in fields.peaks.items():
        group = f"levels/{number:04d}/peak"
        write_array(file, f"{group}/point", np.array([motion.point], dtype="i8"), "point of the curve, from 0")
        _write_motion(file, f"{group}/displacement", motion.u, "m")


def _write_motion(file: h5py.File, name: str, values: np.ndarray, unit: str) -> None:
    """Write the motion of the nodes uncompressed: compression saves at most a quarter and takes ten times as long."""
    dataset = file.create_dataset(name, data=values.astype("f4", copy=False))
    dataset.attrs["unit"] = unit


def read_fields(path: str) -> Fields | None:
    """Return the fields of a result file; None where it has none.  Local; no MPI and no PETSc.

    Raises
    ------
    CaseError : as :func:`~microslip.results.read.read_results`
    """
    with opened(path) as reader:
        if "mesh" not in reader:
            return None
        mesh = _mesh(reader)
        n, n_modes = len(mesh.points), len(reader.array("modes/frequency_Hz", "f8", (None,)))
        n_outputs = len(reader.texts("outputs/name"))
        peaks = {
            number: _motion(reader, f"levels/{name}/peak", n)
            for number, name in enumerate(sorted(reader.group("levels")))
            if f"levels/{name}/peak" in reader
        }
        return Fields(
            mesh,
            _finite(reader, "modes/shape", (n_modes, n, 3)),
            _finite(reader, "statics/displacement", (n, 3)) if "statics/displacement" in reader else None,
            peaks,
            tuple(map(int, reader.array("outputs/node", "i8", (n_outputs,)))),
            _finite(reader, "outputs/direction", (n_outputs, 3)),
        )


def read_run(path: str) -> RunRecord:
    """Return the log of a run; an empty one if the file has none.  Local.

    Raises
    ------
    CaseError : as :func:`~microslip.results.read.read_results`
    """
    with opened(path) as reader:
        if "run/stages/name" not in reader:
            return RunRecord()
        seconds = reader.array("run/stages/seconds", "f8", (None,))
        memory = reader.array("run/stages/memory_MiB", "f8", seconds.shape)
        depth = (
            reader.array("run/stages/depth", "i4", seconds.shape) if "run/stages/depth" in reader else np.zeros(len(seconds), int)
        )
        names = reader.texts("run/stages/name")[: len(seconds)]
        stages = tuple(map(StageRecord, names, seconds.tolist(), memory.tolist(), depth.tolist()))
        return RunRecord(stages, tuple(reader.texts("run/notes")))


def _mesh(reader: Reader) -> Mesh:
    """Return the mesh, whose elements refer to existing nodes."""
    points = _finite(reader, "mesh/points", (None, 3), "f8")
    numbers = reader.array("mesh/node", "i8", (len(points),))
    blocks = []
    for name in sorted(reader.group("mesh/elements")):
        where = f"mesh/elements/{name}"
        kind, group = (reader.texts(f"{where}/{item}")[0] for item in ("kind", "group"))
        if kind not in KINDS:
            raise CaseError(f"{reader.path}: {where!r} holds elements of an unknown kind, {kind!r}")
        nodes = reader.array(f"{where}/nodes", "i8", (None, KINDS[kind].n_nodes))
        if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(points):
            raise CaseError(f"{reader.path}: {where!r} names nodes that are not there; the file is damaged or was edited")
        blocks.append(ElementBlock(kind, group, nodes, reader.array(f"{where}/element", "i8", (len(nodes),))))
    return Mesh(reader.path, points, numbers, tuple(blocks), (), {})


def _motion(reader: Reader, group: str, n_nodes: int) -> Motion:
    u = _finite(reader, f"{group}/displacement", (n_nodes, 3, None))
    if u.shape[2] < 3 or u.shape[2] % 2 == 0:
        raise CaseError(f"{reader.path}: '{group}/displacement' has {u.shape[2]} coefficients, not 2 H + 1")
    return Motion(int(reader.array(f"{group}/point", "i8", (1,))[0]), u)


def _finite(reader: Reader, name: str, shape: Sequence[int | None], kind: str = "f4") -> np.ndarray:
    """Return numbers that are finite everywhere."""
    values = reader.array(name, kind, tuple(shape))
    if not np.isfinite(values).all():
        raise CaseError(f"{reader.path}: dataset {name!r} is not finite everywhere; the file is damaged or was edited")
    return values
