"""Results as a MATLAB file, version 5 to 7: one structure of everything that results.h5 holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat
from scipy.io.matlab import MatWriteError

from ..messages.errors import CaseError
from ..points.branch import QUANTITIES
from ..points.quantities import TEXT
from ..system.files import atomic_write
from .fields import Fields
from .record import JOINT_QUANTITIES, LevelResult, ResultFile, bifurcation_arrays, peak_arrays


def write_mat(path: Path, results: ResultFile, fields: Fields | None) -> Path:
    """Write the variables title, scene, outputs, modes, linear, joint, levels, ... and, with a mesh, mesh; return the path.

    Names and shapes are those of results.h5; ``levels`` is a cell array with a structure a level.

    Raises
    ------
    CaseError : an array is too large for the format, or the file cannot be written
    ResourceError : the disk is full
    """
    variables = variables_of(results, fields)
    try:
        with atomic_write(str(path)) as temporary, open(temporary, "wb") as file:
            savemat(file, variables, long_field_names=True, do_compression=True, oned_as="column")
    except MatWriteError:
        raise CaseError(
            f"{path}: an array of these results is larger than the 4 GB that the format holds; read results.h5"
        ) from None
    return path


def variables_of(results: ResultFile, fields: Fields | None) -> dict[str, Any]:
    """Return the variables of the file.  Local."""
    variables: dict[str, Any] = {
        "title": results.title,
        "name": results.name,
        "method": results.method,
        "scene": results.scene_text,
        "versions": _cells([f"{name} {version}" for name, version in results.versions.items()]),
        "outputs": _cells(results.outputs),
        "units": _cells([results.unit_of(k) for k in range(len(results.outputs))]),
        "level_unit": results.level_unit,
        "modes": {"frequency_Hz": results.mode_frequency},
        "joint": {quantity.dataset: getattr(results.joint, quantity.field) for quantity in JOINT_QUANTITIES}
        | {"names": _cells(results.joint.names), "laws": _cells(results.joint.law_names), **results.joint.law_columns},
        "levels": _cells([_level(level) for level in results.levels]),
    }
    if results.linear is not None:
        variables["linear"] = {"frequency_Hz": results.linear.frequency, "response_per_N": results.linear.response}
    if results.at_rest:
        variables["statics"] = {name: {"names": _cells(part.names), **part.columns} for name, part in results.at_rest.items()}
        variables |= {name: variables["statics"][name] for name in ("bolts",) if name in results.at_rest}
    if fields is not None:
        _add_fields(variables, fields)
    return variables


def _level(level: LevelResult) -> dict[str, Any]:
    variables: dict[str, Any] = {"level_N": level.level, "status": level.status, "failure": level.failure}
    for quantity in QUANTITIES:
        values = level.arrays[quantity.name]
        if values is not None:
            variables[quantity.dataset] = _cells(values) if quantity.kind == TEXT else values
    if level.peaks is not None:
        variables["peaks"] = peak_arrays(level.peaks)
    if level.bifurcations is not None:
        variables["bifurcations"] = bifurcation_arrays(level.bifurcations, level.response.shape[1])
    return variables


def _add_fields(variables: dict[str, Any], fields: Fields) -> None:
    """Add the mesh, with elements by kind and body, and the fields at its nodes; indices of nodes count from 1."""
    blocks = [
        {"kind": block.kind, "group": block.group, "nodes": block.nodes + 1, "element": block.numbers}
        for block in fields.mesh.elements
    ]
    variables["mesh"] = {"points": fields.mesh.points, "node": fields.mesh.numbers, "elements": _cells(blocks)}
    variables["modes"]["shape"] = fields.shapes
    if fields.rest is not None:
        variables["rest"] = {"displacement": fields.rest}
    for number, motion in fields.peaks.items():
        variables["levels"][number]["peak"] = {"point": motion.point + 1, "displacement": motion.u}


def _cells(items) -> np.ndarray:
    """Return a cell array."""
    cells = np.empty(len(items), dtype=object)
    cells[:] = list(items)
    return cells
