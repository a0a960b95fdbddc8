"""The files of a run: tables, results.h5, fields for ParaView."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..fourier.coefficients import amplitude
from ..mesh.data import Mesh
from ..mesh.locate import find_node
from ..messages.words import listed
from ..observe.not_computed import Extent
from ..points.branch import Branch
from ..points.quantities import hertz
from ..reduction.expand import node_fields, peak_displacements, rest_at_nodes
from ..results.fields import Fields, Motion, RunRecord, store_fields
from ..results.origin import Origin
from ..results.record import STATIC_TABLES, LinearCurve, ResultFile, StaticTable, joint_of
from ..results.vtk import peak_fields, write_fields, write_modes
from ..results.whole_disc import turns, whole_mesh, whole_motion, whole_shapes
from ..results.writer import ResultWriter
from ..statics.balance import Balance, BodiesAtRest, JointsAtRest
from ..statics.bolts import BoltsAtRest
from ..system.versions import commit, program_hash, versions
from ..version import __version__
from .build import WholeStructure
from .origin_of_run import origin_of
from .prepare import Prepared
from .settings import output_names, reduction_settings, units_of

LARGE = 0.1  # displacement over the size of the mesh from which small displacements are doubtful


def head_of(prepared: Prepared, options: Sequence[str] = (), origin: Origin | None = None) -> ResultFile:
    """Return the head of a result file, before its levels.  Local; with the user's node numbers on rank 0 only."""
    scene, structure, curve = prepared.scene, prepared.structure, prepared.response.curve
    units = units_of(scene)
    return ResultFile(
        path="",
        title=scene.title or scene.name,
        name=scene.name,
        method=scene.solver.method,
        scene_text=scene.text,
        options=tuple(options),
        versions={"microslip": __version__, "commit": commit(), "program": program_hash(), **versions()},
        outputs=output_names(scene),
        mode_frequency=structure.excited.omega_n / (2.0 * np.pi),
        joint=joint_of(prepared.pairs, structure.numbers),
        linear=LinearCurve(curve.omega / (2.0 * np.pi), curve.response),
        at_rest=_tables(structure.balance, structure.bolts),
        units=units.outputs,
        level_unit=units.level,
        requested=prepared.response.settings.levels,
        n_dof=structure.n_dof,
        origin=origin,
    )


def _tables(balance: Balance | None, bolts: BoltsAtRest | None) -> dict[str, StaticTable]:
    """Return the tables of the equilibrium at rest; none without [statics].  Local."""
    parts: dict[str, JointsAtRest | BodiesAtRest | BoltsAtRest | None] = {"bolts": bolts}
    if balance is not None:
        parts |= {"joints": balance.joints, "bodies": balance.bodies}
    return {
        name: StaticTable(part.names, {column: getattr(part, column) for column in STATIC_TABLES[name]})
        for name, part in parts.items()
        if part is not None
    }


def extent_of(prepared: Prepared) -> Extent:
    """Return the extent of a response, for the notes at its end.  Local."""
    scene, structure = prepared.scene, prepared.structure
    settings, n_damped = reduction_settings(scene), None
    if settings.damping is not None and structure.projected.C is None:
        n_damped = max([len(settings.damping.ratios), *(mode for mode, _ in settings.damping.of_modes)])
    return Extent(
        method=settings.method,
        leaves_out=prepared.reduction.leaves_out,
        omega_n=structure.omega_n,
        n_dof=structure.n_dof,
        harmonics=prepared.model.harmonics,
        n_damped=n_damped,
        has_bars=scene.solver.error_bars,
        has_mesh=structure.has_mesh,
        rests=scene.response.sensitivities and scene.statics is not None,
        is_whole_disc=isinstance(structure, WholeStructure),
        turns=scene.statics is not None and scene.statics.rotation_speed > 0.0,
    )


def writer_of(prepared: Prepared, folder: Path, options: Sequence[str] = (), origin: Origin | None = None) -> ResultWriter:
    """Return the observer that writes frf.csv and results.h5; ``origin`` is determined if not given.  Collective."""
    comm = prepared.model.comm
    head = head_of(prepared, options, origin or origin_of(prepared.scene, comm))
    return ResultWriter(comm, str(folder), head, prepared.model.recorded.n_coefficients)


@dataclass(frozen=True, eq=False)
class Shapes:
    """Fields on the mesh, in the order of its nodes."""

    modes: np.ndarray  # (n_nodes, 3, n_modes) [1/sqrt(kg)]; of a disc those of sector 0, maybe complex
    rest: np.ndarray | None  # (n_nodes, 3) m; None without statics
    peaks: Mapping[int, Motion]  # by the number of the level


def shapes_of(prepared: Prepared, branches: Sequence[Branch]) -> Shapes | None:
    """Return modes, rest and the motion at the peak of every level on the mesh, on rank 0; None elsewhere, or if none are wanted.

    Collective: static solves for the peaks of all levels, and gathers.
    """
    if not (prepared.structure.has_mesh and prepared.scene.response.fields):
        return None
    structure, system = prepared.structure, prepared.structure.system
    structure.refuse_closed()
    shown = structure.excited
    modes = node_fields(shown.system, shown.modes.phi_owned)
    rest = rest_at_nodes(system)
    numbers = [number for number, branch in enumerate(branches) if branch.points]
    motions = peak_displacements(system, prepared.reduction, prepared.model, [branches[number] for number in numbers])
    return None if modes is None else Shapes(modes, rest, {number: Motion(*motion) for number, motion in zip(numbers, motions)})


def notes_on_size(prepared: Prepared, branches: Sequence[Branch], shapes: Shapes | None) -> list[str]:
    """Return a note if the motion at some peak is not small compared with the mesh; none on ranks other than 0.  Local."""
    if shapes is None or prepared.structure.mesh is None:
        return []
    size = prepared.structure.mesh.diagonal
    largest = {branches[i].level: np.linalg.norm(amplitude(motion.u), axis=1).max() for i, motion in shapes.peaks.items()}
    large = [f"{u:.3g} m at level {level:g}" for level, u in largest.items() if u > LARGE * size]
    if not large:
        return []
    why = f"more than {LARGE:g} of the size of its mesh, {size:.3g} m, and the equations are those of small displacements"
    return [f"WARNING: the structure moves by up to {listed(large)}, {why}; lower [response] levels"]


def write_shapes(
    prepared: Prepared, branches: Sequence[Branch], shapes: Shapes | None, folder: Path, run: RunRecord | None = None
) -> None:
    """Write fields to files for ParaView and into the existing results.h5, with the notes of the run.  Local, on rank 0.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    fields = None
    if shapes is not None:
        structure = prepared.structure
        mesh, modes, peaks = _on_whole_disc(prepared, shapes) if prepared.scene.cyclic else _on_mesh(prepared, shapes)
        write_modes(str(folder / "modes.vtkhdf"), mesh, structure.excited.omega_n, modes)
        motions: dict[str, np.ndarray] = {}
        for number, motion in peaks.items():
            branch = branches[number]
            motions.update(peak_fields(branch.level, hertz(branch.points[motion.point].omega), motion.u))
        write_fields(str(folder / "peak_response.vtkhdf"), mesh, motions)
        rest = shapes.rest
        if rest is not None and prepared.scene.cyclic is not None:
            rest = np.concatenate([rest @ turn.T for turn in turns(prepared.scene.cyclic)])
        fields = Fields(mesh, modes, rest, peaks, *_places(prepared))
    store_fields(str(folder / "results.h5"), fields, run)


def _on_mesh(prepared: Prepared, shapes: Shapes) -> tuple[Mesh, np.ndarray, Mapping[int, Motion]]:
    """Return mesh, modes (n_modes, n_nodes, 3) and motions in the layout of files.  Rank 0."""
    assert prepared.structure.mesh is not None, "called on rank 0"
    return prepared.structure.mesh, np.moveaxis(shapes.modes, -1, 0), shapes.peaks


def _on_whole_disc(prepared: Prepared, shapes: Shapes) -> tuple[Mesh, np.ndarray, Mapping[int, Motion]]:
    """Return the same of all sectors of a disc; modes at the instant 0.  Rank 0."""
    cyclic, group = prepared.scene.cyclic, prepared.structure.excited.group
    mesh, modes, peaks = _on_mesh(prepared, shapes)
    assert cyclic is not None and isinstance(group, int), "a disc"
    modes = whole_shapes(np.moveaxis(modes, 0, -1), cyclic, group)
    if not cyclic.whole:
        peaks = {number: Motion(motion.point, whole_motion(motion.u, cyclic)) for number, motion in peaks.items()}
    return whole_mesh(mesh, cyclic), modes, peaks


def _places(prepared: Prepared) -> tuple[tuple[int, ...], np.ndarray]:
    """Return node (number in the mesh file; -1: none) and direction of outputs that are displacements or derivatives of them."""
    mesh, wanted = prepared.structure.mesh, prepared.scene.outputs
    assert mesh is not None, "called on rank 0 of a scene with a mesh"
    nodes, directions = np.full(len(wanted), -1), np.zeros((len(wanted), 3))
    for i, output in enumerate(wanted):
        if output.direction is not None and output.point is None and output.joint is None:
            nodes[i] = mesh.numbers[find_node(mesh, position=output.position, node=output.node)[0]]
            directions[i] = output.direction
    cyclic = prepared.scene.cyclic
    if cyclic is not None and cyclic.whole:
        stride = int(mesh.numbers.max(initial=0)) + 1
        nodes = np.concatenate([np.where(nodes < 0, -1, nodes + s * stride) for s in range(cyclic.sectors)])
        directions = np.concatenate([directions @ turn.T for turn in turns(cyclic)])
    return tuple(map(int, nodes)), directions
