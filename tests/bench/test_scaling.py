"""Work that cannot be shared is found from the work of every rank, and the counter counts every message once."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from mpi_counter import compiled, preloading
from page_tables import MARKED
from processes import LIMIT, MPIRUN, environment
from scaling_of import PARTS
from scaling_report import ORDER, POINT, gains_until, least, parts_of_work, tables
from sources import ROOT

SHARES = {2: np.array([0.6, 0.4]), 4: np.array([0.3, 0.25, 0.25, 0.2])}


def test_the_functions_that_are_timed_exist():
    assert all(callable(vars(owner)[name]) for owner, name, _ in PARTS)


def work_of(serial, replicated, shared, shares):
    return {n: serial * (np.arange(n) == 0) + replicated + shared * share for n, share in shares.items()}


@pytest.mark.parametrize("parts", [(1.0, 0.5, 8.0), (0.0, 0.0, 3.0), (2.0, 0.0, 0.0)])
def test_serial_replicated_and_shared_work_are_separated(parts):
    assert parts_of_work(work_of(*parts, {1: np.ones(1), **SHARES}), SHARES) == pytest.approx(parts, abs=1e-9)


def test_ranks_gain_until_what_cannot_be_shared_prevails():
    assert least((1.0, 0.5, 8.0), 4) == pytest.approx(3.5)
    assert gains_until((0.0, 0.0, 1.0)) == 64 and gains_until((1.0, 0.0, 0.0)) == 1
    assert gains_until((1.0, 0.5, 8.0)) == 32  # 1.75 s; 2 s on 16 ranks, 1.63 s on 64


def run_of(ranks, parts):
    """Return what scaling_of.py reports where every stage has the same parts, shared evenly."""
    even = {ranks: np.full(ranks, 1.0 / ranks)}
    taken = work_of(*parts, even)[ranks].tolist()
    stage = {"wall": taken, "cpu": taken, "mpi_cpu": [0.0] * ranks, "mpi_wall": [0.0] * ranks, "sums, bytes": [2e3] * ranks}
    shares = {name: [1.0 / ranks] * ranks for name in ("flops", "entries", "pairs")}
    return {"ranks": ranks, "points": 1, "stages": dict.fromkeys(ORDER, stage), "memory_MiB": {}, "shares": shares}


def test_tables_have_the_parts_and_are_those_of_the_page():
    runs = [run_of(ranks, (0.1, 0.2, 0.8)) for ranks in (1, 2, 4)]
    made = tables({"small": runs, "paper": runs})
    page = (ROOT / "docs" / "scaling.md").read_text(encoding="utf-8")
    assert {*made, "machine"} == {name for _, name, _ in MARKED.findall(page)}
    assert "| factor | 100 ms | 200 ms | 800 ms | 700 ms | 500 ms |" in str(made["small-more"])
    n = len(ORDER) - 1
    assert f"| set-up of small | {1.1 * n:.3g} s | {0.7 * n:.3g} s | 1.57 |" in str(made["summary"])
    assert POINT not in str(made["summary"])


SAYS = """
import json, sys
sys.path.insert(0, {folder!r})
import numpy as np
from mpi4py import MPI
from scaling_of import Ledger
comm, x = MPI.COMM_WORLD, np.zeros(10)
other, ledger = 1 - comm.rank, Ledger()
persistent = comm.Send_init(x, other), comm.Recv_init(np.zeros(10), other)
with ledger.entry("outer"):
    comm.Allreduce(MPI.IN_PLACE, x)
    MPI.COMM_SELF.Allreduce(MPI.IN_PLACE, x)
    with ledger.entry("{{}}: inner"):
        for _ in range(3):
            MPI.Prequest.Startall(persistent)
            MPI.Request.Waitall(persistent)
    comm.Allgather(x, np.zeros(20))
    comm.Alltoall(np.zeros(4), np.zeros(4))
    comm.Bcast(x)
    if comm.rank == 0:
        comm.Send(x, 1)
    else:
        comm.Recv(x, 0)
from petsc4py import PETSc
A = PETSc.Mat().createAIJ((8, 8), comm=comm)
A.setUp()
for i in range(*A.getOwnershipRange()):
    A[i, i] = 2.0 + i
    A[i, 7 - i] = -1.0
A.assemble()
A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
ksp = PETSc.KSP().create(comm)
ksp.setOperators(A)
ksp.setType("preonly")
ksp.getPC().setType("cholesky")
ksp.getPC().setFactorSolverType("mumps")
with ledger.entry("MUMPS"):
    ksp.setUp()
everyone = comm.gather({{name: list(map(float, taken)) for name, taken in ledger.taken.items()}})
if comm.rank == 0:
    print(json.dumps(everyone))
"""


def test_what_is_said_is_counted_once_and_by_its_kind(tmp_path):
    library = compiled(tmp_path)
    folder = os.path.dirname(sys.modules["mpi_counter"].__file__)
    launch = [MPIRUN, "--oversubscribe", "-n", "2"]
    command = [*launch, *preloading(library), sys.executable, "-c", SAYS.format(folder=folder)]
    said = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=LIMIT)
    assert said.returncode == 0, said.stderr
    for rank, taken in enumerate(json.loads(said.stdout.splitlines()[-1])):
        outer, inner, mumps = (np.array(taken[name]) for name in ("outer", "outer: inner", "MUMPS"))
        calls, sizes = outer[4:9], outer[9:14]
        assert calls[:4].tolist() == [2, 1, 1, 1 - rank]  # the one over one rank alone is none
        assert sizes[:4].tolist() == [160, 160, 32, 80 * (1 - rank)]
        assert inner[4:8].tolist() == [0, 0, 0, 3] and inner[12] == 240
        assert mumps[4] > 10  # Fortran's calls, which go by another name
        assert all(0.0 <= one[2] <= one[0] for one in (outer, inner, mumps))
