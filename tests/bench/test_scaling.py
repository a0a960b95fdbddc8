"""The model of scaling finds what its numbers were made of, and the counter counts what was said."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from mpi_counter import KINDS, compiled, preloading
from processes import LIMIT, MPIRUN, environment
from scaling_model import (
    RANKS,
    Growth,
    Measured,
    Network,
    Share,
    exponent,
    fitted_network,
    gains_until,
    parts_of_work,
    stage_model,
    weak_seconds,
)
from scaling_of import PARTS

NETWORK = Network(latency=1e-6, bandwidth=1e9)
SHARES = {2: [0.6, 0.4], 4: [0.3, 0.25, 0.25, 0.2]}
NOTHING = {kind: {} for kind in KINDS}


def test_what_is_booked_apart_is_there():
    assert all(callable(vars(owner)[name]) for owner, name, _ in PARTS)


def made(serial, replicated, parallel):
    shares = {1: [1.0], **SHARES}
    return {n: [serial * (r == 0) + replicated + parallel * s for r, s in enumerate(shares[n])] for n in shares}


@pytest.mark.parametrize("parts", [(1.0, 0.5, 8.0), (0.0, 0.0, 3.0), (2.0, 0.0, 0.0)])
def test_serial_replicated_and_parallel_work_are_told_apart(parts):
    assert parts_of_work(made(*parts), SHARES) == pytest.approx(parts, abs=1e-9)


def test_time_is_the_sum_of_its_terms_and_agrees_with_what_was_measured():
    calls, sizes = NOTHING | {"sums": {2: 100.0, 4: 100.0}}, NOTHING | {"sums": {2: 1e6, 4: 1e6}}
    wall = {1: 9.5, 2: 7.0}
    model = stage_model("factor", Measured(made(1.0, 0.5, 8.0), {1: [1.0], **SHARES}, calls, sizes, wall), NETWORK)
    assert [model.seconds(n, NETWORK) for n in (1, 2)] == pytest.approx([9.5, 7.0])
    wire, waiting = 2 * (100 * 1e-6 + 1e6 / 1e9), model.idle * 2 * 8.0 * 0.3
    assert waiting > 0.0
    assert model.seconds(4, NETWORK) == pytest.approx(1.0 + 0.5 + 8.0 * 0.3 + wire + waiting)
    ends = [model.seconds(1024, NETWORK, bound) for bound in ("best", "likely", "worst")]
    assert ends == sorted(ends) and ends[0] > 1.5
    assert weak_seconds(model, 1.0, 1, NETWORK) == pytest.approx(9.5)
    assert model.gains_until(NETWORK)[0] == gains_until([model.seconds(n, NETWORK) for n in RANKS])


def test_time_of_messages_by_latency_and_volume():
    assert NETWORK.seconds("sums", 1, 10, 1e6) == 0.0
    assert NETWORK.seconds("sums", 5, 10, 1e6) == pytest.approx(3 * (10e-6 + 1e-3))
    assert NETWORK.seconds("gathers", 8, 10, 1e6) == pytest.approx(3 * 10e-6 + 1e-3)
    assert NETWORK.seconds("exchanges", 8, 10, 1e6) == pytest.approx(7 * 10e-6 + 1e-3)
    assert NETWORK.seconds("messages", 8, 10, 1e6) == pytest.approx(10e-6 + 1e-3)
    sizes = np.array([0, 8, 4096, 1e6])
    found = fitted_network(sizes, 2e-6 + sizes / 5e9)
    assert (found.latency, found.bandwidth) == pytest.approx((2e-6, 5e9), rel=1e-2)


def test_what_was_not_measured_follows_the_last_doubling_between_its_bounds():
    share = Share({1: 1.0, 2: 0.55, 4: 0.35})
    assert [share.at(n) for n in (1, 2, 4)] == [1.0, 0.55, 0.35]
    best, likely, worst = (share.at(64, bound) for bound in ("best", "likely", "worst"))
    assert best == pytest.approx(0.35 * 4 / 64) and likely == pytest.approx(0.35 * (0.35 / 0.55) ** 4)
    assert worst == pytest.approx(0.15 + 0.8 / 64)  # 0.15 + 0.8 / P meets 0.55 and 0.35
    assert Share().at(8) == 1 / 8
    assert Growth({2: 10.0, 4: 20.0}).at(16) == pytest.approx(80.0)
    assert Growth({2: 10.0, 4: 20.0}).at(16, "best") == pytest.approx(20.0)
    assert Growth({2: 10.0, 4: 50.0}).at(8) == pytest.approx(100.0)  # no faster than the ranks
    assert Growth({2: 7.0}).at(512) == 7.0


def test_ranks_gain_until_the_least_time_is_nearly_reached():
    assert gains_until([1.0 / n for n in RANKS]) == 1024
    assert gains_until([1.0] * len(RANKS)) == 1
    assert gains_until([1.0 / n + n / 64 for n in RANKS]) == 8
    assert exponent(1.0, 4.0, 100, 200, 1.0, 3.0) == pytest.approx(2.0)
    assert [exponent(1.0, large, 100, 200, 1.0, 1.5) for large in (0.0, 1.5, 4.0)] == [1.0, 1.0, 1.5]


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
