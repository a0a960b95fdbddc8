"""Write results during the run: a row of frf.csv for each point, results.h5 at the end of every level."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

import h5py
import numpy as np

from ..parallel.agree import on_root
from ..points.bifurcation import BIFURCATION_QUANTITIES
from ..points.branch import QUANTITIES, Branch, Point
from ..points.peak import PEAK_QUANTITIES
from ..points.quantities import LABELS, TEXT, Quantity, axis_lengths
from ..system.files import atomic_write, make_folder
from ..system.hdf5 import extended_hdf5, written_hdf5
from ..system.signals import unbroken
from .origin import Origin
from .record import (
    COMPLETE,
    JOINT_QUANTITIES,
    RUNNING,
    STATIC_TABLES,
    STOPPED,
    Joint,
    LevelResult,
    ResultFile,
    bifurcation_arrays,
    level_result,
    peak_arrays,
)
from .table import ResponseTable

if TYPE_CHECKING:
    from mpi4py import MPI

FORMAT, FORMAT_VERSION = "microslip results", 1
NAME = "results.h5"


class ResultWriter:
    """The result files of a run in ``folder``, which is created; results of an earlier run there are replaced.

    Collective on ``comm``, as is ``put_in_order``: every rank raises the error of a full disk.  The other methods are local, on
    rank 0: it is an :class:`~microslip.observe.observer.Observer` of levels that come one after the other or several at a time.

    Parameters
    ----------
    head : the results without levels; used on rank 0
    N_H : coefficients per DOF, 2 H + 1

    Raises
    ------
    CaseError, ResourceError : on every rank, if the folder or a file cannot be written
    """

    def __init__(self, comm: MPI.Comm, folder: str, head: ResultFile, N_H: int):
        self.comm, self.folder = comm, folder
        self.path = os.path.join(folder, NAME)
        self._sizes = (len(head.outputs), head.joint.n_pairs, N_H)
        self._units, self._level_unit = [head.unit_of(k) for k in range(len(head.outputs))], head.level_unit
        self._unfinished: dict[int, Branch] = {}  # by the number of the level
        self._table = on_root(comm, self._create, head, share=False)

    def _create(self, head: ResultFile) -> ResponseTable:
        """Create both files, without levels."""
        make_folder(self.folder)
        table = ResponseTable(self.folder, head.outputs, tuple(self._units))
        with atomic_write(self.path) as temporary, written_hdf5(temporary) as file:
            _write_head(file, head)
            _write_joint(file.create_group("joint"), head.joint)
            for name, static in head.at_rest.items():
                write_texts(file, f"statics/{name}/names", static.names)
                for column, (unit, _) in STATIC_TABLES[name].items():
                    write_array(file, f"statics/{name}/{column}", static.columns[column], unit)
            file.create_group("levels")
        return table

    def level_started(self, number: int, level: float, where: str = "") -> None:
        """Begin a level [N]."""
        self._unfinished[number] = Branch(level)

    def point(self, number: int, i: int, point: Point) -> None:
        """Append the ``i``-th converged point of a level, counted from 0, to frf.csv."""
        branch = self._unfinished[number]
        with unbroken():  # both files have the same points where a signal stops the run
            branch.points.append(point)
            self._table.add(branch.level, i, point)

    def level_finished(self, number: int, branch: Branch) -> None:
        """Write the level to results.h5, complete or stopped early."""
        del self._unfinished[number]
        self._save(number, branch, STOPPED if branch.failure else COMPLETE)

    def table_is_gone(self) -> bool:
        """Return whether frf.csv has been removed meanwhile; collective."""
        return on_root(self.comm, lambda: self._table.is_gone())

    def put_in_order(self, branches: list[Branch]) -> None:
        """Put the rows of frf.csv, which came level by level or mixed, into the order of the branches, those of rank 0."""
        on_root(self.comm, lambda: self._table.put_in_order(branches), share=False)

    def save(self) -> None:
        """Write the points so far of unfinished levels to results.h5: before a time limit, or after an error elsewhere."""
        for number, branch in self._unfinished.items():
            self._save(number, branch, RUNNING)

    def _save(self, number: int, branch: Branch, status: str) -> None:
        """Replace results.h5 by a copy with a level added."""
        result = level_result(branch, self._sizes, status, self._level_unit)
        name = f"levels/{number:04d}"
        with extended_hdf5(self.path, name) as file:
            write_level(file.create_group(name), result, common_unit(self._units))

    def close(self) -> None:
        """Close frf.csv; results.h5 is closed between the levels.  Local, so that an error of one rank may pass through."""
        if self._table is not None:
            self._table.close()


def _write_head(file: h5py.File, head: ResultFile) -> None:
    file.attrs["format"], file.attrs["format_version"] = FORMAT, FORMAT_VERSION
    file.attrs["coefficients"] = "last axis: mean, cos 1, sin 1, ..., cos H, sin H"
    write_texts(file, "outputs/name", head.outputs)
    units = [head.unit_of(k) for k in range(len(head.outputs))]
    write_texts(file, "outputs/unit", units)
    write_texts(file, "scene/level_unit", head.level_unit)
    for name, text in (("text", head.scene_text), ("title", head.title), ("name", head.name), ("method", head.method)):
        write_texts(file, f"scene/{name}", text)
    write_texts(file, "versions/name", head.versions.keys())
    write_texts(file, "versions/version", head.versions.values())
    write_texts(file, "options", head.options)
    if head.n_dof:
        file.create_dataset("structure/n_dof", data=np.int64(head.n_dof))
    if head.origin is not None:
        _write_origin(file.create_group("origin"), head.origin)
    write_array(file, "scene/levels", np.array(head.requested, dtype="f8"), head.level_unit)
    write_array(file, "modes/frequency_Hz", head.mode_frequency, "Hz")
    if head.linear is not None:
        write_array(file, "linear/frequency_Hz", head.linear.frequency, "Hz")
        write_array(file, "linear/response_per_N", head.linear.response, f"{common_unit(units)}/{head.level_unit}")


def _write_origin(group: h5py.Group, origin: Origin) -> None:
    for name in ("command", "started", "scene_path", "settings", "hosts"):
        write_texts(group, name, getattr(origin, name))
    group.create_dataset("groups", data=np.int64(origin.n_groups))
    write_texts(group, "environment/name", origin.environment.keys())
    write_texts(group, "environment/value", origin.environment.values())
    for name in ("key", "path", "sha256"):
        write_texts(group, f"inputs/{name}", [getattr(entry, name) for entry in origin.inputs])
    write_array(group, "inputs/size", np.array([entry.size for entry in origin.inputs], dtype="i8"), "bytes")


def common_unit(units: list[str]) -> str:
    """Return the unit common to all outputs, or where it is stated.  Local."""
    return units[0] if len(set(units)) == 1 else "that of outputs/unit"


def _write_joint(group: h5py.Group, joint: Joint) -> None:
    write_texts(group, "names", joint.names)
    write_texts(group, "laws", joint.law_names)
    lengths = axis_lengths(0, joint.n_pairs, 0)
    for quantity in JOINT_QUANTITIES:
        write_array(
            group, quantity.dataset, np.asarray(quantity.of(joint), quantity.kind).reshape(quantity.shape(lengths)), quantity.unit
        )
    for name, values in joint.law_columns.items():
        write_array(group, f"law_columns/{name}", np.asarray(values, "f8"), "")
    group.create_group("faces")
    for i, faces in enumerate(joint.faces):
        write_array(group, f"faces/{i:04d}", np.asarray(faces, dtype="i8"), "index of the pair")


def write_level(group: h5py.Group, level: LevelResult, unit: str) -> None:
    """Write a level; ``unit`` is that of the outputs."""
    group.attrs["level_N"], group.attrs["status"], group.attrs["failure"] = level.level, level.status, _clean(level.failure)
    group.attrs["closes_to"] = level.closes_to
    if level.peaks is not None:
        arrays = peak_arrays(level.peaks)
        for quantity in PEAK_QUANTITIES:
            of = unit if quantity.unit == "m" else quantity.unit
            _write_quantity(group, replace(quantity, dataset=f"peaks/{quantity.dataset}"), arrays.get(quantity.dataset), of)
    if level.bifurcations is not None:
        arrays = bifurcation_arrays(level.bifurcations, level.response.shape[1])
        for quantity in BIFURCATION_QUANTITIES:
            of = unit if quantity.unit == "m" else quantity.unit
            write_array(group, f"bifurcations/{quantity.dataset}", arrays[quantity.dataset], of)
    for quantity in sorted(QUANTITIES, key=lambda quantity: (quantity.kind != TEXT, quantity.is_motion)):  # the large ones last
        _write_quantity(group, quantity, level.arrays[quantity.name], unit if "outputs" in quantity.axes else quantity.unit)


def _write_quantity(group: h5py.Group, quantity: Quantity, values: np.ndarray | None, unit: str) -> None:
    """Write the quantity of a level, with its unit and the names along its axes; nothing where it was not computed."""
    if values is None:
        return
    if quantity.kind == TEXT:
        write_texts(group, quantity.dataset, values)
        return
    write_array(group, quantity.dataset, values, unit)
    for axis in LABELS.keys() & set(quantity.axes):
        group[quantity.dataset].attrs[axis] = ", ".join(LABELS[axis])


def write_array(group: h5py.Group, name: str, values: np.ndarray, unit: str) -> None:
    """Write an array; large ones are compressed, mostly for the zeros of pairs that stick.  Local."""
    values = np.asarray(values)
    packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if values.nbytes > 4096 else {}
    dataset = group.create_dataset(name, data=values, **packing)
    dataset.attrs["unit"] = unit


def write_texts(group: h5py.Group, name: str, texts) -> None:
    """Write one text or several as UTF-8, padded to one length: of others, damaged ones crash HDF5.  Local."""
    coded = [_clean(text).encode() for text in ([texts] if isinstance(texts, str) else texts)]
    kind = h5py.string_dtype("utf-8", max([1, *map(len, coded)]))
    group.create_dataset(name, data=coded[0] if isinstance(texts, str) else np.array(coded, dtype=kind), dtype=kind)


def _clean(text: str) -> str:
    """Return a text that HDF5 can hold: it would end at a zero byte, and bytes of a file's name need not be UTF-8."""
    return text.replace("\0", "\ufffd").encode(errors="backslashreplace").decode()
