"""Endings that a run can take, on the ranks that the name says: started by test_ending.py, not a test itself."""

import os
import sys
import time

from mpi4py import MPI

from microslip.guards import ending
from microslip.messages.errors import CaseError, ConvergenceError
from microslip.parallel.agree import on_root, raise_together
from microslip.system.signals import obey_signals
from microslip.system.watchdog import moved, patient, unwatched, watch

COMM = MPI.COMM_WORLD


def agreed():
    raise_together(COMM, "the first is wrong" if COMM.rank == 1 else None, CaseError)


def met_by_root():
    on_root(COMM, open, "/no/such/file")


def alone_while_others_wait():
    if COMM.rank == 1:
        raise ConvergenceError("one rank did not converge")
    COMM.Barrier()


def alone_after_others_finished():
    if COMM.rank == 1:
        time.sleep(0.3)
        raise ConvergenceError("one rank did not converge")


def defect_while_others_wait():
    if COMM.rank == 1:
        raise ZeroDivisionError("a mistake")
    COMM.Barrier()


def out_of_memory():
    if COMM.rank == 1:
        bytearray(10**16)
    COMM.Barrier()


def exits():
    if COMM.rank == 1:
        sys.exit(3)


def waits_for_a_signal():
    with open(sys.argv[2] + str(COMM.rank), "w") as file:
        file.write(f"{os.getpid()}\n")
    for _ in range(3000):
        time.sleep(0.01)


def hangs():
    moved()
    if COMM.rank == 1:
        time.sleep(60.0)
    COMM.Barrier()


def moves():
    for _ in range(15):
        time.sleep(0.1)
        moved()
    with unwatched():
        time.sleep(1.5)


def calls_long():
    with patient():
        with patient():
            time.sleep(1.5)
        moved()
        time.sleep(1.5)


def calls_long_and_hangs():
    with patient():
        pass
    time.sleep(60.0)


if __name__ == "__main__":
    watch()
    ending.GRACE = 0.5
    obey_signals(COMM.rank == 0)
    sys.exit(ending.conclude(COMM, globals()[sys.argv[1]]))
