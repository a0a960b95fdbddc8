"""Model files of a million nodes: read, checked, paired and distributed; times and memory.

    python jobs/bench/large_files.py [--formats inp cdb msh vtu exo unv bdf] [--nodes 1000000] [--bdf-nodes 1000000] [--pairs 5041]
                                     [--ranks 1 2] [--folder DIR]

Two blocks of hexahedra on each other (large_models.py) are written in a temporary folder, or in DIR, where the files stay; each
file is read by a separate job on each number of ranks (mpirun, or $MPIRUN).  Measured: wall time; processor time of rank 0, which
does most of the work (other jobs on the machine disturb it least); and peak memory, summed over the ranks.
"""

from __future__ import annotations

import os

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import argparse
import contextlib
import json
import resource
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import machine
from large_models import WRITERS, blocks, scene

LIMITS = {"wall": 60.0, "memory": 6.0}  # s, GiB
STEPS = ("start", "model file", "mesh", "pairs", "partition", "elements", "report")


def measure(path: Path) -> None:
    """Do the steps of `microslip check` and print seconds by step and memory as JSON.  On every rank."""
    from microslip.parallel.petsc import initialise

    initialise()
    from mpi4py import MPI

    from microslip.assembly.check import check_elements
    from microslip.library.complete import read_completed
    from microslip.mesh.pairing import pair_contacts
    from microslip.mesh.partition import distribute
    from microslip.mesh.read import read_mesh
    from microslip.parallel.agree import on_root
    from microslip.studies.check.report import description

    comm = MPI.COMM_WORLD
    times = {"begin": (_since_start(), 0.0, 0.0)}

    def mark(step: str) -> None:
        comm.barrier()
        times[step] = (_since_start(), time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)

    mark("start")
    file, whole, notes = read_completed(microslip.read(path), comm)
    mark("model file")
    mesh = on_root(comm, read_mesh, whole, file, share=False)
    mark("mesh")
    pairs = on_root(comm, pair_contacts, mesh, whole.joints)
    mark("pairs")
    share = distribute(mesh, whole, comm)
    mark("partition")
    check_elements(share, whole)
    mark("elements")
    on_root(comm, description, whole, file, mesh, pairs, notes)
    mark("report")
    every = comm.gather(times)
    if every is not None:
        totals = {step: [*every[0][step][:2], sum(one[step][2] for one in every)] for step in STEPS}
        print("FOUND " + json.dumps({"steps": totals, "nodes": len(mesh.points), "pairs": pairs.n_pairs}))


def _since_start() -> float:
    """Return the seconds since this process began."""
    began = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
    return time.clock_gettime(time.CLOCK_BOOTTIME) - began


def job(path: Path, ranks: int) -> dict:
    """Return what a job on some ranks measured."""
    launcher = [*shlex.split(os.environ.get("MPIRUN", "mpirun")), "-n", str(ranks)]
    command = [*launcher, sys.executable, __file__, "--measure", str(path)]
    done = subprocess.run(command, capture_output=True, text=True)
    lines = [line for line in done.stdout.splitlines() if line.startswith("FOUND ")]
    if not lines:
        raise SystemExit(f"{path} on {ranks} ranks failed:\n{done.stdout}\n{done.stderr}")
    return json.JSONDecoder().raw_decode(lines[-1].removeprefix("FOUND "))[0]  # libraries may print behind it


def row(what: str, ranks: int, size: float, totals: dict) -> str:
    """Return a line of the table: wall and processor seconds of each step, and in all."""
    last, cells = (0.0, 0.0), []
    for step in STEPS:
        wall, processor, memory = totals["steps"][step]
        cells.append(f"{wall - last[0]:.1f} ({processor - last[1]:.1f})")
        last = wall, processor
    is_kept = wall < LIMITS["wall"] and memory < LIMITS["memory"]
    cells += [f"{wall:.1f} ({processor:.1f})", f"{memory:.2f}", "yes" if is_kept else "no"]
    return (
        " | ".join([f"| .{what}, {size:.0f} MB, {totals['nodes']:,} nodes, {totals['pairs']:,} pairs", str(ranks), *cells]) + " |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--formats", nargs="+", choices=WRITERS, default=list(WRITERS))
    parser.add_argument("--nodes", type=int, default=1_000_000)
    parser.add_argument("--bdf-nodes", type=int, help="pyNastran keeps an object a card; by default as many as the others")
    parser.add_argument("--pairs", type=int, default=5041)
    parser.add_argument("--ranks", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        measure(options.measure)
        return
    print("\n".join(machine.lines(machine.facts())))
    print(
        f"\n| file | ranks | {' | '.join(STEPS)} | in all, s | GiB | under {LIMITS['wall']:g} s, {LIMITS['memory']:g} GiB |",
        flush=True,
    )
    print("| --- | ---: |" + " ---: |" * (len(STEPS) + 2) + " --- |")
    with contextlib.ExitStack() as stack:
        folder = options.folder or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for what in options.formats:
            path = folder / f"large.{what}"
            model = blocks(options.bdf_nodes if what == "bdf" and options.bdf_nodes else options.nodes, options.pairs)
            if not path.exists():
                WRITERS[what](model, path)
            (folder / f"{what}.toml").write_text(scene(path.name, model))
            del model
            for ranks in options.ranks:
                print(row(what, ranks, path.stat().st_size / 1e6, job(folder / f"{what}.toml", ranks)), flush=True)


if __name__ == "__main__":
    main()
