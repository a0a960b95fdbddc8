"""How long the statics of the paper's sector take: the parts, on as many ranks as it is started on.

    python jobs/bench/statics.py [SCENE]
    mpirun -n 2 python jobs/bench/statics.py

Needs meshes/fan_paper.msh (python meshes/fan_sector.py --size paper --out meshes/fan_paper.msh).  Prints a line of a table: wall time
of each part, and of rank 0 the processor time, which others on the machine disturb least; the line of columns is part of the rest.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import numpy as np
from machine import facts, lines
from mpi4py import MPI

from microslip.parallel.petsc import initialise

initialise()

import microslip
from microslip.assembly.assemble import assemble
from microslip.assembly.prestress import constant_forces, stiffness_at_rest
from microslip.linear.joint_springs import Linearised, linearise
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.read import read_mesh
from microslip.parallel.agree import on_root
from microslip.statics.equilibrium import Flexibility, equilibrium

P = ParamSpec("P")
T = TypeVar("T")
SCENE = Path(__file__).parents[1] / "fan_paper_speed.toml"


class Parts:
    """Wall and processor time [s] of what is called, by name."""

    def __init__(self, comm: MPI.Comm):
        self.comm, self.seconds = comm, dict[str, tuple[float, float]]()

    def timed(self, name: str, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Return what ``function`` returns.  Collective: ranks start together."""
        self.comm.Barrier()
        wall, processor = time.perf_counter(), time.process_time()
        try:
            return function(*args, **kwargs)
        finally:
            before = self.seconds.get(name, (0.0, 0.0))
            now = time.perf_counter() - wall, time.process_time() - processor
            self.seconds[name] = before[0] + now[0], before[1] + now[1]


class Timed(Flexibility):
    """The flexibility of the joint, with the time that its columns take."""

    def __init__(self, linearised: Linearised, parts: Parts):
        super().__init__(linearised)
        self.parts = parts

    def require(self, pairs: np.ndarray) -> None:
        self.parts.timed("columns", super().require, pairs)


def measure(path: Path, comm: MPI.Comm) -> tuple[Parts, str]:
    """Return the times, and what was solved in words.  Collective."""
    parts, settings = Parts(comm), microslip.read(path)
    mesh = parts.timed("mesh", on_root, comm, read_mesh, settings, share=False)
    pairs = parts.timed("mesh", on_root, comm, pair_contacts, mesh, settings.joints)
    shares = parts.timed("mesh", distribute, mesh, settings, comm)
    system = parts.timed("assembly", assemble, shares, mesh, pairs, settings)
    forces = parts.timed("assembly", constant_forces, shares, mesh, settings, system)
    linearised = parts.timed("factor", linearise, system, pairs)
    rest = parts.timed("rest", equilibrium, Timed(linearised, parts), pairs, forces, settings.statics.steps)
    linearised.destroy()
    K = parts.timed("stress", stiffness_at_rest, shares, settings, system, rest.u_owned)
    K.destroy()
    return parts, f"{system.n_dof} DOF, {pairs.n_pairs} pairs, {rest.steps} steps, {rest.iterations} iterations"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    comm = MPI.COMM_WORLD
    parts, solved = measure(parser.parse_args().scene, comm)
    if comm.rank == 0:
        set_up = ("mesh", "assembly", "factor")
        names = [*set_up, "rest", "columns", "stress"]
        print(f"{solved}; " + " ".join(lines(facts())))
        print(
            f"| ranks | set-up: {', '.join(set_up)} | rest | of it columns | stress and spin | all |\n| --- | --- | --- | --- | --- | --- |"
        )
        for k, clock in enumerate(("", ", processor")):
            s = {name: parts.seconds.get(name, (0.0, 0.0))[k] for name in names}
            first = sum(s[name] for name in set_up)
            whole = first + s["rest"] + s["stress"]
            shown = " + ".join(f"{s[name]:.1f}" for name in set_up)
            print(
                f"| {comm.size}{clock} | {shown} = {first:.1f} s | {s['rest']:.1f} s | {s['columns']:.1f} s | {s['stress']:.1f} s "
                f"| {whole:.1f} s |"
            )


if __name__ == "__main__":
    main()
