"""Read results.h5.  The file may come from anywhere: every shape is checked."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from ..contact.law import OPEN
from ..contact.laws import ELASTIC_COULOMB
from ..formats.hdf5 import MOST_GAIN
from ..messages.errors import CaseError
from ..points.bifurcation import BIFURCATION_QUANTITIES, KINDS, Bifurcation
from ..points.branch import CLOSES_TO, QUANTITIES
from ..points.peak import PEAK_QUANTITIES, Peak
from ..points.quantities import TEXT, Quantity, axis_lengths
from ..system.sandbox import SandboxError, read_file
from .checked_datasets import Reader, attribute, opened
from .fields import read_fields, read_run
from .origin import InputFile, Origin
from .record import (
    COMPLETE,
    JOINT_QUANTITIES,
    RUNNING,
    STATIC_TABLES,
    STOPPED,
    Joint,
    LevelResult,
    LinearCurve,
    PeaksOver,
    ResultFile,
    StaticTable,
    Wear,
)


def read_results(path: str, motion: bool = True) -> ResultFile:
    """Read a result file.  Local; no MPI and no PETSc.

    ``motion`` False leaves the large arrays du and p out.

    Raises
    ------
    CaseError : no such file, truncated or damaged, another kind of file, another version of the format, or a file that
        refers to other files
    """
    if not isinstance(path, (str, os.PathLike)):
        raise CaseError(f"read_results: expected the path of a result file, found {path!r}")
    with opened(path) as reader:
        return _read(path, reader, motion)


def read_in_sandbox(path: str) -> None:
    """Read a result file in a separate process, and raise CaseError if that process crashes.  Local."""
    if not os.path.isfile(path):
        return  # reported when it is opened
    try:
        read_file(path, _read_all, path, gain=MOST_GAIN)
    except SandboxError as problem:
        raise CaseError(f"{path}: cannot be read as a result file: {problem}; the file is damaged") from None


def _read_all(path: str) -> None:
    read_results(path), read_fields(path), read_run(path)


def _read(path: str, reader: Reader, motion: bool) -> ResultFile:
    """Return the results of an open file; without ``motion`` du and p of the points are not read.  CaseError: it is damaged."""
    outputs = tuple(reader.texts("outputs/name"))
    units = tuple(reader.texts("outputs/unit")) if "outputs/unit" in reader else ()
    level_unit = reader.texts("scene/level_unit")[0] if "scene/level_unit" in reader else "N"
    if units and len(units) != len(outputs):
        raise CaseError(f"{path}: {len(outputs)} outputs have {len(units)} units; the file is damaged or was edited")
    joint = _joint(reader)
    levels = tuple(
        _level(reader, f"levels/{name}", len(outputs), joint.n_pairs, motion, level_unit)
        for name in sorted(reader.group("levels"))
    )
    title, name, method, text = (reader.texts(f"scene/{item}")[0] for item in ("title", "name", "method", "text"))
    versions = dict(zip(reader.texts("versions/name"), reader.texts("versions/version")))
    return ResultFile(
        path,
        title,
        name,
        method,
        text,
        tuple(reader.texts("options")),
        versions,
        outputs,
        reader.array("modes/frequency_Hz", "f8", (None,)),
        joint,
        _linear(reader, len(outputs)),
        levels,
        units,
        level_unit,
        int(reader.array("structure/n_dof", "i8", ())) if "structure/n_dof" in reader else 0,
        _origin(reader),
        requested=_requested_levels(reader),
        at_rest={name: _static(reader, name) for name in STATIC_TABLES if f"statics/{name}" in reader},
        over=tuple(_over(reader, f"over/{name}", len(outputs), joint.n_pairs, motion) for name in _names(reader, "over")),
        wear=_wear(reader, outputs, joint.n_pairs) if "wear" in reader else None,
    )


def _wear(reader: Reader, outputs: tuple[str, ...], n_pairs: int) -> Wear:
    """Return the data of a study of wear."""
    law, output = (attribute(reader.group("wear"), name) for name in ("law", "output"))
    cycles = reader.array("wear/cycles", "f8", (None,))
    depth, N0 = (reader.array(f"wear/{name}", "f8", (len(cycles), n_pairs)) for name in ("depth", "N0"))
    curves = (reader.array(f"wear/{name}", "f8", (len(cycles),)) for name in ("frequency", "amplitude", "damping"))
    if output not in outputs or not np.isfinite(cycles).all():
        raise CaseError(f"{reader.path}: 'wear' has values that no study writes; the file is damaged or was edited")
    return Wear(law, output, cycles, depth, N0, *curves)


def _over(reader: Reader, group: str, n_outputs: int, n_pairs: int, motion: bool) -> PeaksOver:
    """Return a peak over a number of the scene."""
    key, unit = (attribute(reader.group(group), name) for name in ("key", "unit"))
    linear, points = (
        _peaks(reader, f"{group}/linear", n_outputs, n_pairs),
        _level(reader, f"{group}/points", n_outputs, n_pairs, motion, unit),
    )
    value, damping = (reader.array(f"{group}/{name}", "f8", (len(points.frequency),)) for name in ("value", "damping"))
    if linear is None or len(linear) != 1 or not np.isfinite(value).all() or (points.level == 0.0 and (value <= 0.0).any()):
        raise CaseError(f"{reader.path}: '{group}' has values that no run writes; the file is damaged or was edited")
    return PeaksOver(key, unit, linear[0], value, damping, points)


def _requested_levels(reader: Reader) -> tuple[float, ...]:
    """Return the levels of the run; none where an earlier version wrote the file."""
    if "scene/levels" not in reader:
        return ()
    return tuple(map(float, reader.array("scene/levels", "f8", (None,))))


def _static(reader: Reader, name: str) -> StaticTable:
    """Return a table of the equilibrium at rest."""
    names = tuple(reader.texts(f"statics/{name}/names"))
    shapes = {key: (len(names), width)[: 2 if width else 1] for key, (_, width) in STATIC_TABLES[name].items()}
    return StaticTable(names, {key: reader.array(f"statics/{name}/{key}", "f8", shape) for key, shape in shapes.items()})


def _origin(reader: Reader) -> Origin | None:
    """Return where the results come from; None where an earlier version wrote the file."""
    if "origin" not in reader:
        return None
    command, started, scene_path = (reader.texts(f"origin/{name}")[0] for name in ("command", "started", "scene_path"))
    columns = (reader.texts(f"origin/inputs/{name}") for name in ("key", "path"))
    sizes = reader.array("origin/inputs/size", "i8", (None,)).tolist()
    return Origin(
        command=command,
        started=started,
        scene_path=scene_path,
        settings=tuple(reader.texts("origin/settings")),
        hosts=tuple(reader.texts("origin/hosts")),
        n_groups=int(reader.array("origin/groups", "i8", ())),
        environment=dict(zip(reader.texts("origin/environment/name"), reader.texts("origin/environment/value"))),
        inputs=tuple(map(InputFile, *columns, sizes, reader.texts("origin/inputs/sha256"))),
    )


def _linear(reader: Reader, n_outputs: int) -> LinearCurve | None:
    if "linear" not in reader:
        return None
    frequency = reader.array("linear/frequency_Hz", "f8", (None,))
    return LinearCurve(frequency, reader.array("linear/response_per_N", "f8", (len(frequency), n_outputs, None)))


def _joint(reader: Reader) -> Joint:
    n_pairs = len(reader.array("joint/mu", "f8", (None,)))
    lengths = axis_lengths(0, n_pairs, 0)
    columns = {quantity.field: _of_joint(reader, quantity, quantity.shape(lengths)) for quantity in JOINT_QUANTITIES}
    names = tuple(reader.texts("joint/names"))
    faces = tuple(reader.array(f"joint/faces/{name}", "i8", (None, None)) for name in sorted(reader.group("joint/faces")))
    laws = tuple(reader.texts("joint/laws")) if "joint/laws" in reader else (ELASTIC_COULOMB,)
    group = "joint/law_columns" if "joint/law_columns" in reader else "joint/own"  # an earlier version
    of_laws = {name: reader.array(f"{group}/{name}", "f8", (n_pairs,)) for name in _names(reader, group)}
    if (
        any(len(part) and not 0 <= part.min() <= part.max() < n_pairs for part in (*faces,))
        or not all(0 <= i < len(names) for i in columns["joint"])
        or not all(0 <= i < len(laws) for i in columns["laws"])
    ):
        raise CaseError(f"{reader.path}: the joint names pairs that are not there; the file is damaged or was edited")
    return Joint(names=names, faces=faces, law_names=laws, law_columns=of_laws, **columns)


def _names(reader: Reader, group: str) -> list[str]:
    """Return the optional contents of a group."""
    return sorted(reader.group(group)) if group in reader else []


def _name(reader: Reader, group: str, quantity: Quantity) -> str:
    """Return the name of the dataset of a quantity in this file, which an earlier version may have written."""
    name, earlier = f"{group}/{quantity.dataset}", f"{group}/{quantity.earlier}"
    return earlier if quantity.earlier and name not in reader and earlier in reader else name


def _of_joint(reader: Reader, quantity: Quantity, shape: tuple[int, ...]) -> np.ndarray:
    """Return a quantity of the joint; zeros where it came with a later version."""
    name = _name(reader, "joint", quantity)
    if quantity.optional and name not in reader:
        return np.zeros(shape, dtype=quantity.kind)
    return reader.array(name, quantity.kind, shape)


def _level(reader: Reader, group: str, n_outputs: int, n_pairs: int, motion: bool, unit: str) -> LevelResult:
    n, _, N_H = reader.array(f"{group}/response", "f8", (None, n_outputs, None)).shape
    if N_H < 3 or N_H % 2 == 0:
        raise CaseError(f"{reader.path}: dataset '{group}/response' has {N_H} coefficients, not 2 H + 1")
    lengths = axis_lengths(n_outputs, n_pairs, N_H)
    arrays = {
        quantity.name: _quantity(reader, group, quantity, n, lengths) if motion or not quantity.is_motion else None
        for quantity in QUANTITIES
    }
    attributes = reader.group(group)
    for name, values in arrays.items():
        if values is not None and values.dtype.kind == "f" and not np.isfinite(values).all():
            raise CaseError(f"{reader.path}: {name} of '{group}' is not finite everywhere; the file is damaged or was edited")
    status, failure = (attribute(attributes, name) for name in ("status", "failure"))
    closes_to = float(attributes.attrs.get("closes_to", CLOSES_TO))  # older files do not have it
    level = float(attributes.attrs["level_N"])
    fault = _out_of_range(arrays, N_H)
    if not np.isfinite([level, closes_to]).all() or status not in (COMPLETE, STOPPED, RUNNING):
        fault = "its attributes"
    if fault is not None:
        raise CaseError(f"{reader.path}: {fault} of '{group}' cannot be; the file is damaged or was edited")
    bifurcations, peaks = _bifurcations(reader, group, n_outputs), _peaks(reader, group, n_outputs, n_pairs)
    return LevelResult(level, status, failure, arrays, unit, closes_to, peaks, bifurcations)


def _bifurcations(reader: Reader, group: str, n_outputs: int) -> tuple[Bifurcation, ...] | None:
    """Return the bifurcations of a level; None where multipliers were not computed."""
    name = f"{group}/bifurcations"
    if name not in reader:
        return None
    n, lengths = len(reader.array(f"{name}/frequency_Hz", "f8", (None,))), {"outputs": n_outputs}
    columns = {
        quantity.dataset: reader.array(f"{name}/{quantity.dataset}", quantity.kind, (n, *quantity.shape(lengths)))
        for quantity in BIFURCATION_QUANTITIES
    }
    is_sound = np.isfinite(columns["amplitude"]).all() and (columns["frequency_Hz"] > 0.0).all()
    if not is_sound or (columns["kind"] >= len(KINDS)).any():
        raise CaseError(f"{reader.path}: '{name}' has values that no run writes; the file is damaged or was edited")
    return tuple(
        Bifurcation(
            KINDS[columns["kind"][i]],
            2.0 * np.pi * float(columns["frequency_Hz"][i]),
            columns["amplitude"][i],
            complex(columns["multiplier_real"][i], columns["multiplier_imaginary"][i]),
            2.0 * np.pi * float(columns["within_Hz"][i]),
            int(columns["after"][i]),
        )
        for i in range(n)
    )


def _peaks(reader: Reader, group: str, n_outputs: int, n_pairs: int) -> tuple[Peak, ...] | None:
    """Return the peaks of a level; None where they were not solved for."""
    if f"{group}/peaks" not in reader:
        return None
    n = len(reader.array(f"{group}/peaks/frequency_Hz", "f8", (None,)))
    lengths = axis_lengths(n_outputs, n_pairs, 0)
    columns = {
        quantity.dataset: reader.array(f"{group}/peaks/{quantity.dataset}", quantity.kind, (n, *quantity.shape(lengths)))
        for quantity in PEAK_QUANTITIES
        if not quantity.axes or f"{group}/peaks/{quantity.dataset}" in reader
    }
    is_sound = np.isfinite(columns["amplitude"]) & (columns["frequency_Hz"] > 0.0)
    if not is_sound.all() or not np.isin(columns["output"], np.arange(n_outputs)).all():
        raise CaseError(f"{reader.path}: '{group}/peaks' has values that no run writes; the file is damaged or was edited")
    return tuple(
        Peak(
            int(columns["output"][i]),
            2.0 * np.pi * float(columns["frequency_Hz"][i]),
            complex(columns["amplitude"][i] * np.exp(1j * columns["phase"][i])),
            2.0 * np.pi * float(columns["half_power_width_Hz"][i]),
            2.0 * np.pi * float(columns["within_Hz"][i]),
            int(columns["slipping"][i]),
            int(columns["newton"][i]),
            int(columns["segment"][i]),
            columns["d_by_pairs"][i] if "d_by_pairs" in columns else None,
            columns["d_by_common"][i] if "d_by_common" in columns else None,
        )
        for i in range(n)
    )


def _out_of_range(arrays: Mapping[str, np.ndarray | None], N_H: int) -> str | None:
    """Return the name of a quantity of a level with values that no run writes; None if all are valid."""
    indices = {name: values for name, values in arrays.items() if values is not None and values.dtype.kind in "iu"}
    most = {"state": OPEN, "harmonics": N_H}
    for name, values in indices.items():
        if values.size and not 0 <= values.min() <= values.max() <= most.get(name, values.max()):
            return name
    frequency = arrays["frequency"]
    return "frequency" if frequency is not None and (frequency < 0.0).any() else None


def _quantity(reader: Reader, group: str, quantity: Quantity, n: int, lengths: dict[str, int]) -> np.ndarray | None:
    """Return a quantity of the n points of a level; None where it may be missing, and is."""
    name = _name(reader, group, quantity)
    if quantity.optional and name not in reader:
        return None
    if quantity.kind == TEXT:
        return np.array(reader.texts(name), dtype=TEXT)[:n]
    if "parts" not in quantity.axes:
        return reader.array(name, quantity.kind, (n, *quantity.shape(lengths)))
    values = reader.array(name, quantity.kind, (n, *(None if axis == "parts" else lengths[axis] for axis in quantity.axes)))
    missing = lengths["parts"] - values.shape[-1]
    if missing < 0:
        raise CaseError(f"{reader.path}: dataset '{name}' has {values.shape[-1]} parts, more than {lengths['parts']}")
    return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, missing)])  # parts that an earlier version did not know
