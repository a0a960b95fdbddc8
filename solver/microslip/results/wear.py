"""The wear of a joint over cycles in files: a table, a group of results.h5, a series for ParaView.  Rank 0 only."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..contact.law import OPEN, SLIP
from ..system.hdf5 import extended_hdf5
from .joint_mesh import joint_mesh
from .record import Joint, Wear
from .vtk_steps import write_joint_series
from .writer import write_array

COLUMNS = {  # of wear.csv, before those of each joint
    "cycles": "cycles of vibration",
    "depth_max_m": "largest depth of all pairs",
    "volume_m3": "worn volume of all pairs",
    "energy_J": "friction loss of the pairs that wear, since the first cycle",
    "friction_J": "the same of one cycle",
    "frequency_Hz": "frequency of the cycle",
    "amplitude": "amplitude of harmonic 1 of the output, in its unit",
    "damping": "damping ratio of one mode with this amplitude per unit of the level; empty where the frequency stays",
    "slipping": "numbers of pairs",
    "open": "numbers of pairs that open in the cycle",
    "error_m": "error bar of the amplitude; empty without `error_bars`",
    "jump_error_m": "error of the depth in the last jump",
    "jump_errors_m": "sum of these errors since the first cycle",
}
OF_JOINT = {
    "depth_max_m": "largest depth of the pairs of this joint",
    "normal_force_N": "sum of its normal forces at rest",
    "unloaded": "pairs without normal force at rest",
}


@dataclass(frozen=True, eq=False)
class WearHistory(Wear):
    """A joint after n numbers of cycles, with the data of files other than results.h5."""

    unit: str  # of its coefficient
    level: float
    level_unit: str
    output_unit: str
    frequency_stays: bool
    joint: Joint  # before the first cycle
    area: np.ndarray  # (n_pairs,) m2, by which depth is volume
    total: np.ndarray  # (n, n_pairs) J, friction loss since the first cycle
    energy: np.ndarray  # (n, n_pairs) J, friction loss of a cycle
    state: np.ndarray  # (n, n_pairs) states in the cycle
    error: np.ndarray  # (n,) of the amplitude; NaN without error bars
    jump_error: np.ndarray  # (n,) m
    failure: str = ""  # why it ends before the stated cycles

    def records(self) -> list[dict[str, Any]]:
        """Return a record for each number of cycles, by the columns of wear.csv."""
        worn, rows = self.depth > 0.0, []
        volume = np.where(worn, self.depth * np.where(worn.any(axis=0), self.area, 0.0), 0.0).sum(axis=1)
        for i, cycles in enumerate(self.cycles):
            row: dict[str, Any] = {
                "cycles": float(cycles),
                "depth_max_m": float(self.depth[i].max(initial=0.0)),
                "volume_m3": float(volume[i]),
                "energy_J": float(self.total[i].sum()),
                "friction_J": float(self.energy[i].sum()),
                "frequency_Hz": float(self.frequency[i]),
                "amplitude": float(self.amplitude[i]),
                "damping": float(self.damping[i]),
                "slipping": int(np.count_nonzero(self.state[i] == SLIP)),
                "open": int(np.count_nonzero(self.state[i] == OPEN)),
                "error_m": float(self.error[i]),
                "jump_error_m": float(self.jump_error[i]),
                "jump_errors_m": float(self.jump_error[: i + 1].sum()),
            }
            for k, name in enumerate(self.joint.names):
                of_joint = self.joint.joint == k
                N = self.normal_force[i, of_joint]
                values = float(self.depth[i, of_joint].max(initial=0.0)), float(N.sum()), int(np.count_nonzero(N <= 0.0))
                row |= {f"{name}_{column}": value for column, value in zip(OF_JOINT, values)}
            rows.append(row)
        return rows


_ARRAYS = {
    "cycles": "1",
    "depth": "m",
    "total": "J",
    "energy": "J",
    "N0": "N",
    "state": "0 stick, 1 slip, 2 open",
    "frequency": "Hz",
    "damping": "1",
    "jump_error": "m",
}


def store_wear(path: str, history: WearHistory) -> None:
    """Add the group ``wear`` to an existing results.h5.  Local; the file is complete or as it was.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    with extended_hdf5(path, "wear") as file:
        group = file.create_group("wear")
        for name in ("law", "unit", "level", "output"):
            group.attrs[name] = getattr(history, name)
        for name, unit in _ARRAYS.items():
            write_array(group, name, getattr(history, name), unit)
        for name in ("amplitude", "error"):
            write_array(group, name, getattr(history, name), history.output_unit)


def write_wear_series(folder: str, history: WearHistory) -> None:
    """Write wear.vtkhdf: depth, pressure at rest and friction loss of the pairs, a step for each number of cycles.  Local.

    Nothing where no pair has a place.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    mesh, joint = joint_mesh(history.joint), history.joint
    if not len(mesh.sizes):
        return

    def at_pairs(i: int) -> dict[str, np.ndarray]:
        values = {
            "depth_m": history.depth[i],
            "normal_force_at_rest_N": history.normal_force[i],
            "friction_loss_J": history.energy[i],
            "state": history.state[i].astype(float),
        }
        if joint.has_areas:
            values["pressure_at_rest_Pa"] = history.normal_force[i] / joint.area
        return values

    constant = {"joint": joint.joint, "area_m2": joint.area}
    write_joint_series(os.path.join(folder, "wear.vtkhdf"), mesh, history.cycles, at_pairs, constant)
