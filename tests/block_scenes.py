"""Two blocks of 36 DOF, the upper supported only by its joint: as a mesh, and as matrices stored by CalculiX."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import scipy.io
import scipy.linalg
from matrix_files import WITH_DOFS, WRITERS

from microslip.formats.matrices.file_matrix import DofMap
from microslip.formats.matrices.read import read_matrix

DATA = Path(__file__).parents[1] / "jobs" / "matrices"
OF_MESH = """
[model]
mesh = "calculix_blocks.inp"
[materials.steel]
young = 2.1e11
poisson = 0.3
density = 7800.0
[bodies.lower]
group = "LOWER"
material = "steel"
incompatible_modes = false
[bodies.upper]
group = "UPPER"
material = "steel"
incompatible_modes = false
[[supports]]
group = "FOOT"
fix = ["x", "y", "z"]
"""
OF_CALCULIX = '[model]\nstiffness = "calculix_blocks.sti"\nmass = "calculix_blocks.mas"\n'
SURFACES = 'surfaces = ["UPPER_BOTTOM", "LOWER_TOP"]\n'
NODE_PAIRS = 'node_pairs = "pairs.csv"\n'
JOINT = """[[joints]]
name = "joint"
PAIRSfriction = 0.3
tangential_stiffness = 2.0e12
normal_stiffness = 4.0e12
preload = 1.0e6
"""
REST = """
[[loads]]
node = 17
direction = [1.0, 0.2, 0.0]
[[outputs]]
name = "top"
PLACE
direction = [1.0, 0.0, 0.0]
[damping]
ratio = 0.01
[response]
levels = [60.0]
frequencies = [2090.0, 2102.0]
at = [2100.0]
points = 4
[solver]
error_bars = false
harmonics = 1
samples = 32
"""


def write_scene(folder: Path, model: str, pairs: str = NODE_PAIRS, place: str = "node = 18", rest: str = REST) -> Path:
    """Write a scene of the blocks with all of CalculiX's files; return its path."""
    for file in DATA.glob("calculix_blocks.*"):
        shutil.copy(file, folder)
    lines = [f"{11 + i},{5 + i},0,0,2,0.0025" for i in range(4)]
    (folder / "pairs.csv").write_text("\n".join(["node1,node2,nx,ny,nz,area", *lines]) + "\n")
    path = folder / "scene.toml"
    path.write_text(model + JOINT.replace("PAIRS", pairs) + rest.replace("PLACE", place))
    return path


def calculix_blocks():
    """Return K, M and the nodes and directions of their rows."""
    K, M = (read_matrix(DATA / f"calculix_blocks.{ending}", ending, symbol) for ending, symbol in (("sti", "K"), ("mas", "M")))
    return K.matrix, M.matrix, K.dofs


def in_format(folder: Path, ending: str) -> str:
    """Write K and M in a format, and missing information on its rows in another file; return the table [model]."""
    K, M, dofs = calculix_blocks()
    WRITERS[ending][0](folder / f"K.{ending}", K, dofs)
    write = WRITERS[ending][0]
    write(folder / f"M.{ending}", M, dofs, **({"symbol": "M"} if ending in ("full", "sub") else {}))
    lines = ["[model]", f'stiffness = "K.{ending}"', f'mass = "M.{ending}"']
    if ending not in WITH_DOFS:
        write_dofs(folder / "dofs.csv", dofs)
        lines.append('dofs = "dofs.csv"')
    return "\n".join(lines) + "\n"


def write_dofs(path: Path, dofs) -> None:
    rows = [f"{node},{direction}" for node, direction in zip(dofs.nodes, dofs.directions)]
    path.write_text("\n".join(["node,direction", *rows]) + "\n")


def positions() -> dict[int, np.ndarray]:
    """Return the positions of the nodes."""
    lines = (DATA / "calculix_blocks.inp").read_text().split("*NODE, NSET=ALL\n")[1].split("*ELEMENT")[0].splitlines()
    return {int(line.split(",")[0]): np.array([float(x) for x in line.split(",")[1:]]) for line in lines}


def craig_bampton():
    """Return K, M, T of all fixed-interface modes, the interface rows and the inner rows: without truncation."""
    K, M, dofs = calculix_blocks()
    K, M = K.toarray(), M.toarray()
    at_joint = np.isin(dofs.nodes, [5, 6, 7, 8, 11, 12, 13, 14])
    b, i = np.flatnonzero(at_joint), np.flatnonzero(~at_joint)
    _, phi = scipy.linalg.eigh(K[np.ix_(i, i)], M[np.ix_(i, i)])
    psi = -np.linalg.solve(K[np.ix_(i, i)], K[np.ix_(i, b)])
    T = np.zeros((len(K), len(K)))
    T[np.ix_(b, range(len(b)))] = np.eye(len(b))
    T[np.ix_(i, range(len(b)))], T[np.ix_(i, range(len(b), len(K)))] = psi, phi
    return T.T @ K @ T, T.T @ M @ T, T[i], DofMap(dofs.nodes[b], dofs.directions[b]), DofMap(dofs.nodes[i], dofs.directions[i])


def write_superelement(folder):
    """Write a superelement with the joint on its interface nodes; load and output are inside, by its recovery matrix."""
    K, M, T, interface, inside = craig_bampton()
    modes = np.zeros(len(K) - len(interface.nodes), dtype=int)
    write_dofs(folder / "dofs.csv", DofMap(np.r_[interface.nodes, modes], np.r_[interface.directions, modes]))
    write_dofs(folder / "inside.csv", inside)
    scipy.io.savemat(folder / "cb.mat", {"K": (K + K.T) / 2.0, "M": (M + M.T) / 2.0, "T": T})
    return write_scene(
        folder,
        '[model]\nstiffness = "cb.mat"\nmass = "cb.mat:M"\ndofs = "dofs.csv"\nrecovery = "cb.mat:T"\nrecovery_dofs = "inside.csv"\n',
        NODE_PAIRS,
    )
