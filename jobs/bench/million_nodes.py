"""A model file of a million nodes: written, and then read, checked, paired and distributed, with times and memory.

    python jobs/bench/million_nodes.py write FOLDER [--cells 100]
    mpirun -n 2 python jobs/bench/million_nodes.py read FOLDER

Two blocks of hexahedra on each other, in ASCII: an input file of Abaqus with sets, surfaces, sections, a material and a support, all of
which the scene takes over. Wall time, the processors' time of rank 0 (the one to look at where the machine is shared), and the
highest memory of the ranks together.
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path

import numpy as np

from microslip.parallel.petsc import initialise

initialise()

from mpi4py import MPI  # noqa: E402

import microslip  # noqa: E402
from microslip.library.complete import read_completed  # noqa: E402
from microslip.library.settings import mesh_settings  # noqa: E402
from microslip.mesh.pairing import pair_contacts  # noqa: E402
from microslip.mesh.partition import distribute  # noqa: E402
from microslip.mesh.read import read_mesh  # noqa: E402
from microslip.parallel.agree import on_root  # noqa: E402

PITCH = 1e-3  # m
REST = """*MATERIAL, NAME=STEEL
*ELASTIC
2.1e11, 0.3
*DENSITY
7850.
*BOUNDARY
held, ENCASTRE
"""
SCENE = """[model]
mesh = "million.inp"
[[joints]]
name = "between"
surfaces = ["lower_face", "upper_face"]
friction = 0.3
tangential_stiffness = 1e13
normal_stiffness = 1e13
preload = 1e6
[[loads]]
position = [0.0, 0.0, 1.0]
direction = [0.0, 0.0, 1.0]
[[outputs]]
name = "corner"
position = [0.0, 0.0, 1.0]
direction = [0.0, 0.0, 1.0]
[damping]
ratio = 0.01
[response]
levels = [1.0]
frequencies = [100.0, 200.0]
"""


def write(folder: Path, n: int) -> None:
    """Write two blocks of n x n x n/2 - 1 cells."""
    cells = (n, n, n // 2 - 1)
    first_node = first_element = 1
    with open(folder / "million.inp", "w") as file:
        for name, bottom in (("lower", 0.0), ("upper", cells[2] * PITCH)):
            numbers = first_node + np.arange(np.prod(np.add(cells, 1))).reshape(np.add(cells, 1))
            points = PITCH * np.argwhere(numbers > 0) + [0.0, 0.0, bottom]
            file.write("*NODE\n")
            np.savetxt(file, np.column_stack([numbers.ravel(), points]), fmt="%d, %.9e, %.9e, %.9e")
            corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
            nodes = [numbers[i : i + n, j : j + n, k : k + cells[2]].ravel() for i, j, k in corners]
            elements = first_element + np.arange(np.prod(cells))
            file.write(f"*ELEMENT, TYPE=C3D8I, ELSET={name}\n")
            np.savetxt(file, np.column_stack([elements, *nodes]), fmt="%d", delimiter=", ")
            layer, face = (cells[2] - 1, "S2") if name == "lower" else (0, "S1")
            file.write(f"*ELSET, ELSET={name}_layer\n")
            np.savetxt(file, elements.reshape(cells)[:, :, layer].ravel(), fmt="%d")
            file.write(f"*SURFACE, NAME={name}_face\n{name}_layer, {face}\n*SOLID SECTION, ELSET={name}, MATERIAL=STEEL\n")
            if name == "lower":
                file.write("*NSET, NSET=held\n")
                np.savetxt(file, numbers[:, :, 0].ravel(), fmt="%d")
            first_node, first_element = int(numbers.max()) + 1, int(elements.max()) + 1
        file.write(REST)
    (folder / "million.toml").write_text(SCENE)


def read(folder: Path, comm: MPI.Comm) -> None:
    """Read, check, pair and distribute.  Collective."""
    begin = time.time(), time.process_time()

    def mark(what: str) -> None:
        comm.barrier()
        memory = comm.gather(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2)
        if memory is not None:
            wall, processor = time.time() - begin[0], time.process_time() - begin[1]
            print(f"{what:12s} {wall:6.1f} s, {processor:6.1f} s of rank 0's processor, {sum(memory):.2f} GiB", flush=True)

    scene = microslip.read(folder / "million.toml")
    model, scene, _ = read_completed(scene, comm)
    mark("read")
    settings = mesh_settings(scene)
    mesh = on_root(comm, read_mesh, settings, model, share=False)
    mark("checked")
    pairs = on_root(comm, pair_contacts, mesh, settings.joints)
    mark("paired")
    distribute(mesh, settings, comm)
    mark("distributed")
    if mesh is not None:
        print(f"{len(mesh.points)} nodes, {pairs.n_pairs} pairs")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("write", "read"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cells", type=int, default=100)
    chosen = parser.parse_args()
    if chosen.what == "write":
        write(chosen.folder, chosen.cells)
    else:
        read(chosen.folder, MPI.COMM_WORLD)


if __name__ == "__main__":
    main()
