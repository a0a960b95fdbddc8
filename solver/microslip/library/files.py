"""The files of a run: tables, results.h5, fields for ParaView."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .. import __version__
from ..continuation.branch import Branch
from ..parallel.agree import on_root
from ..parallel.versions import versions
from ..reduction.expand import node_fields, peak_displacement
from ..results.record import BOLT_UNITS, Bolts, LinearCurve, ResultFile, joint_of
from ..results.vtk import peak_fields, write_fields, write_modes
from ..results.writer import ResultWriter
from .build import Structure
from .prepare import Prepared
from .settings import units_of


def head_of(prepared: Prepared, options: Sequence[str] = ()) -> ResultFile:
    """Return what a result file says before its levels.  Local; with the user's node numbers on rank 0 only."""
    scene, mesh, curve = prepared.scene, prepared.structure.mesh, prepared.response.curve
    bolts = prepared.structure.bolts
    units = units_of(scene)
    return ResultFile(
        path="",
        title=scene.title or scene.name,
        name=scene.name,
        method=scene.solver.method,
        scene_text=scene.text,
        options=tuple(options),
        versions={"microslip": __version__, **versions()},
        outputs=tuple(output.name for output in scene.outputs),
        mode_frequency=prepared.structure.modes.frequency,
        joint=joint_of(prepared.pairs, None if mesh is None else mesh.numbers),
        linear=LinearCurve(curve.omega / (2.0 * np.pi), curve.response),
        bolts=None if bolts is None else Bolts(bolts.names, **{name: getattr(bolts, name) for name in BOLT_UNITS}),
        units=units.outputs,
        level_unit=units.level,
    )


def writer_of(prepared: Prepared, folder: Path, options: Sequence[str] = ()) -> ResultWriter:
    """Return the observer that writes frf.csv and results.h5.  Collective."""
    return ResultWriter(prepared.model.comm, str(folder), head_of(prepared, options), prepared.model.recorded.n_coefficients)


def write_shapes(prepared: Prepared, branches: Sequence[Branch], folder: Path) -> None:
    """Write the modes and the motion at the peak of every level on the mesh, if there is one.  Collective; rank 0 writes."""
    structure, system = prepared.structure, prepared.structure.linearised.system
    if system.dof is None:
        return
    shapes = node_fields(system, structure.modes.phi_owned)
    on_root(system.comm, _write_modes, structure, shapes, folder, share=False)
    fields: dict[str, np.ndarray] = {}
    for branch in branches:
        frequency, u = peak_displacement(system, prepared.reduction, branch)
        if u is not None:
            fields.update(peak_fields(branch.level, frequency, u))
    on_root(system.comm, write_fields, str(folder / "peak_response.vtkhdf"), structure.mesh, fields, share=False)


def _write_modes(structure: Structure, shapes: np.ndarray, folder: Path) -> None:
    assert structure.mesh is not None, "called on rank 0 of a scene with a mesh"
    write_modes(str(folder / "modes.vtkhdf"), structure.mesh, structure.modes.omega_n, np.moveaxis(shapes, -1, 0))
