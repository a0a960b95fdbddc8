"""A signal during a search of SLEPc ends the program with its status, without freeing objects that SLEPc uses."""

from pathlib import Path

import pytest
from processes import python

SCRIPT = """
import signal, sys
sys.path.insert(0, sys.argv[1])
from microslip.parallel.petsc import initialise
initialise()
from mpi4py import MPI
import lattices
from microslip.guards.ending import conclude, leave
from microslip.linear.joint_springs import linearise
from microslip.modes.shift_invert import ModeSearch, _SolvesByFactor
from microslip.system.signals import obey_signals

solve, n = _SolvesByFactor._solve, iter(range(10**9))

def interrupted(self, B):
    if next(n) == int(sys.argv[2]):
        signal.raise_signal(signal.SIGTERM)
    return solve(self, B)

def action():
    obey_signals(MPI.COMM_WORLD.rank == 0)
    system, pairs = lattices.lattice(MPI.COMM_WORLD, (12, 7, 6))
    _SolvesByFactor._solve = interrupted
    linearised = linearise(system, pairs)
    try:
        ModeSearch(linearised).lowest(10)
    finally:
        linearised.destroy()

leave(conclude(MPI.COMM_WORLD, action))
"""

MORE = (1, 0), (1, 7), (2, 7)  # ranks, number of the solve


@pytest.mark.ranks(1)
@pytest.mark.parametrize(
    ("ranks", "number"),
    [pytest.param(2, 0, marks=pytest.mark.slow), *(pytest.param(*of, marks=pytest.mark.study) for of in MORE)],
)
def test_a_signal_in_a_solve_ends_the_program_with_its_status(ranks, number):
    process = python("-c", SCRIPT, Path(__file__).parents[1], number, ranks=ranks)
    assert process.returncode == 5, process.stderr
    assert process.stderr.count("microslip: error: stopped by SIGTERM") == 1 and "Traceback" not in process.stderr
