"""What a run of a scene will need, told without solving anything."""

from __future__ import annotations

import numpy as np

from .assembly.assemble import read_off
from .mesh.data import ContactPairs, Mesh, place

# measured on the hex20 fan-blade sector of 122,124 DOF: 1.0 GB for the factor and 4 GiB in all at most (docs/guide.md)
_FACTOR_GB, _MEASURED_DOF = 1.0, 122_124


def needs(scene, mesh: Mesh, pairs: ContactPairs) -> list[str]:
    """Return lines that say what the scene holds and what a run will need.  Local, on rank 0.

    Raises
    ------
    MeshError, CaseError : what only mesh and scene together show: free parts, loads or outputs without a node
    """
    is_fixed, _, part_names, load_nodes, output_nodes = read_off(mesh, pairs, scene)
    n_dof = int((~is_fixed).sum())
    N_H, n_pairs = 2 * scene.solver.harmonics + 1, pairs.n_pairs
    kinds = ", ".join(f"{len(block.nodes)} {block.kind} in {block.group}" for block in mesh.elements)
    lines = [
        f"scene      {scene.path}: no fault found",
        f"mesh       {mesh.path}: {len(mesh.points)} nodes, {kinds}; {len(part_names)} connected parts",
        f"           from {place(mesh.points.min(axis=0))} to {place(mesh.points.max(axis=0))} m",
        *(f"           {note}" for note in mesh.notes),
        f"unknowns   {n_dof} DOF free, {int(is_fixed.sum())} fixed",
        *_joints(pairs),
        *(f"load {i}     {_at(mesh, load, nodes)}" for i, (load, nodes) in enumerate(zip(scene.loads, load_nodes), 1)),
        *(f"output     {out.name}: {_at(mesh, out, nodes)}" for out, nodes in zip(scene.outputs, output_nodes)),
        f"method     {scene.solver.method}: {scene.solver.modes} modes, harmonics 0 to {scene.solver.harmonics}, "
        f"{scene.solver.samples} samples; at most {(scene.solver.modes + 3 * n_pairs) * N_H} unknowns with all pairs slipping",
        f"response   {len(scene.response.levels)} levels of about {scene.response.points} points",
        f"memory     about {_FACTOR_GB * (n_dof / _MEASURED_DOF) ** (4 / 3):.2g} GB for the factor (solid meshes), "
        f"{72e-9 * n_pairs**2:.2g} GB for static columns if every pair slips",
    ]
    return lines


def _joints(pairs: ContactPairs) -> list[str]:
    lines = []
    for name in dict.fromkeys(pairs.joint):
        own = np.array([joint == name for joint in pairs.joint])
        N0 = pairs.N0[own]
        lines.append(f"joint      {name}: {own.sum()} pairs on {pairs.area[own].sum():.6g} m2, normal preload {N0[N0 > 0].sum():.4g} N in all, "
                     f"{np.count_nonzero(N0 < 0)} with a gap")
    return lines


def _at(mesh: Mesh, entry, nodes: np.ndarray) -> str:
    """Say where a load or an output lies."""
    if len(nodes) > 1:
        return f"shared by {len(nodes)} nodes of {entry.group}"
    text = f"node {mesh.numbers[nodes[0]]} at {place(mesh.points[nodes[0]])} m"
    if entry.position is not None:
        text += f", {np.linalg.norm(mesh.points[nodes[0]] - np.array(entry.position)):.3g} m from the position asked for"
    return text
