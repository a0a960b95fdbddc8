"""Results as time series for ParaView: a period at the peak of each level, joint by level, modes, state of rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..fourier.coefficients import synthesise
from ..messages.errors import CaseError
from .fields import Fields
from .joint_cycle import SAMPLES, joint_cycle, joint_values, rest_values
from .joint_mesh import JointMesh, joint_mesh
from .record import ResultFile
from .vtk import write_fields
from .vtk_steps import write_joint_series, write_structure_series


def write_series(results: ResultFile, fields: Fields | None, folder: Path, steps: int) -> list[Path]:
    """Write the files that have content and return their paths.  Local.

    motion_0000.vtkhdf, ... and joint_motion_0000.vtkhdf, ... by the number of the level: a period in ``steps`` steps [s].
    joint.vtkhdf: a step a level [N].  mode_shapes.vtkhdf: a step a mode [Hz].  rest.vtkhdf.

    Raises
    ------
    CaseError : neither a mesh nor places of pairs are known; or a file cannot be written
    ResourceError : the disk is full
    """
    mesh = joint_mesh(results.joint)
    if fields is None and len(mesh.sizes) == 0:
        raise CaseError(
            f"{results.path}: nothing to show in space: a scene given as matrices has neither a mesh nor places of its pairs, "
            "and an earlier version stored no mesh; run a scene with a mesh again"
        )
    files = []
    if fields is not None:
        files += _structure(results, fields, folder, steps)
    if len(mesh.sizes):
        files += _joint(results, fields, mesh, folder, steps)
    return files


def _structure(results: ResultFile, fields: Fields, folder: Path, steps: int) -> list[Path]:
    """Write modes, rest and the motion at the peaks on the mesh of the structure."""
    files = [folder / "mode_shapes.vtkhdf"]
    write_structure_series(str(files[0]), fields.mesh, results.mode_frequency, lambda i: {"displacement": fields.shapes[i]})
    if fields.rest is not None:
        files.append(folder / "rest.vtkhdf")
        write_fields(str(files[-1]), fields.mesh, {"displacement": fields.rest})
    for number, motion in fields.peaks.items():
        files.append(folder / f"motion_{number:04d}.vtkhdf")
        level = results.levels[number]
        u = _sampled(motion.u, steps)
        write_structure_series(
            str(files[-1]),
            fields.mesh,
            np.arange(steps) / steps / level.frequency[motion.point],
            lambda i, u=u: {"displacement": u(i)},  # type: ignore[misc]
        )
    return files


def _sampled(u: np.ndarray, steps: int):
    """Return a function of the step: the sum of the harmonics there, (n_nodes, 3) [m]."""
    E = synthesise(np.eye(u.shape[2]), steps)  # (N_H, steps)
    return lambda i: u @ E[:, i].astype(u.dtype)


def _joint(results: ResultFile, fields: Fields | None, mesh: JointMesh, folder: Path, steps: int) -> list[Path]:
    """Write the joint by level, and over the period at the peak of each level."""
    joint, files = results.joint, [folder / "joint.vtkhdf"]
    solved = [(number, level) for number, level in enumerate(results.levels) if len(level.frequency)]
    if not solved:
        return []
    constant = {"joint": joint.joint, "node1": joint.node1, "node2": joint.node2, "area_m2": joint.area, **rest_values(joint)}
    at = {number: level.top for number, level in solved}
    by_level = [joint_values(joint, level, at[number]) for number, level in solved]
    write_joint_series(str(files[0]), mesh, [level.level for _, level in solved], lambda i: by_level[i], constant)
    for number, level in solved:
        files.append(folder / f"joint_motion_{number:04d}.vtkhdf")
        over = _Period(results, fields, number, at[number], steps)
        write_joint_series(
            str(files[-1]), mesh, np.arange(steps) / steps / level.frequency[at[number]], over.values, {"joint": joint.joint}
        )
    return files


class _Period:
    """The state of the pairs over the period at a point of a level, step by step."""

    def __init__(self, results: ResultFile, fields: Fields | None, number: int, at: int, steps: int):
        joint, self.joint = results.joint, results.joint
        self.every = max(1, SAMPLES // steps)
        self.cycle = joint_cycle(joint, results.levels[number], at, steps * self.every)
        self.u = None if fields is None or number not in fields.peaks else motion_of_pairs(fields, joint.node1, number)
        self.sampled = None if self.u is None else _sampled(self.u, steps)

    def values(self, step: int) -> dict[str, np.ndarray]:
        """Return values of the pairs at a step; vectors in model axes."""
        i, joint = step * self.every, self.joint
        tangents = joint.frame[:, :2]
        fields_of_step = {
            "normal_force_N": self.cycle.normal_force[:, i],
            "friction_force_N": np.einsum("nk,nki->ni", self.cycle.friction_force[:, :, i], tangents),
            "slip_m": np.einsum("nk,nki->ni", self.cycle.slip[:, :, i], tangents),
            "relative_motion_m": np.einsum("nk,nki->ni", self.cycle.du[:, :, i], joint.frame),
        }
        if joint.has_areas:
            fields_of_step["pressure_Pa"] = fields_of_step["normal_force_N"] / joint.area
        if self.sampled is not None:
            fields_of_step["displacement"] = self.sampled(step)
        return fields_of_step


def motion_of_pairs(fields: Fields, nodes: np.ndarray, number: int) -> np.ndarray:
    """Return the motion of the nodes of the pairs at the peak of a level, (n_pairs, 3, N_H) [m]; 0 where a pair has none.  Local.

    ``nodes`` are numbers in the mesh file.  Of contact points on a surface, that of the nearest node.
    """
    u = fields.peaks[number].u
    order = np.argsort(fields.mesh.numbers)
    numbers = fields.mesh.numbers[order]
    where = np.minimum(np.searchsorted(numbers, nodes), len(numbers) - 1)
    return np.where((numbers[where] == nodes)[:, None, None], u[order[where]], 0.0).astype(u.dtype)
