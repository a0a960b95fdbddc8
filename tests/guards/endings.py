"""Ways in which a run can end, on the ranks named by the function: started by test_ending.py, not a test itself."""

import ctypes
import os
import signal
import sys
import threading
import time
from pathlib import Path

from mpi4py import MPI

from microslip.guards import ending, overdue
from microslip.guards.lock import locked
from microslip.messages.errors import CaseError, ConvergenceError
from microslip.parallel.agree import raise_together
from microslip.system.signals import conclude_signals, obey_signals, parting_with
from microslip.system.watchdog import moved, patient, unwatched, watch

COMM = MPI.COMM_WORLD


def agreed():
    raise_together(COMM, "the first is wrong" if COMM.rank == 1 else None, CaseError)


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


def never_returns():
    """Call a function that no signal interrupts, as a library that permits threads: acquire a lock that this thread has."""
    library, mutex = ctypes.CDLL(None), ctypes.create_string_buffer(128)
    library.pthread_mutex_lock(mutex)
    library.pthread_mutex_lock(mutex)


def calls_without_an_answer():
    """Send a signal in such a call, with a locked folder."""
    with locked(COMM, Path(sys.argv[2])), parting_with("; the results are elsewhere"):
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGTERM)).start()
        never_returns()


def waits_without_an_answer():
    """Stay in such a call while another process sends a signal."""
    with open(sys.argv[2] + str(COMM.rank), "w") as file:
        file.write(f"{os.getpid()}\n")
    with parting_with("; the results are elsewhere"):
        never_returns()


def hangs_on_its_way_out():
    """Send a signal on all ranks; the first waits before its message for another rank that does not arrive."""
    try:
        time.sleep(0.5)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(30.0)
    finally:
        never_returns()


def says_and_hangs():
    """End with the message of a signal on the first rank, and stay in a call afterwards."""
    ending.leave = lambda status: never_returns()
    signal.raise_signal(signal.SIGTERM)


def is_stopped_at_the_very_end():
    """Send a signal after the end of the work."""
    ending.conclude_signals = lambda: (conclude_signals(), signal.raise_signal(signal.SIGTERM))


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
            time.sleep(3.0)
        moved()
        time.sleep(3.0)


def calls_long_and_hangs():
    with patient():
        pass
    time.sleep(60.0)


if __name__ == "__main__":
    ending.GRACE, overdue.NOTICE, overdue.ANSWER, overdue.LEAVING, overdue._STILL = 0.5, 0.2, 1.0, 0.5, 0.2
    overdue.oversee_signals()
    obey_signals(COMM.rank == 0)
    overdue.pass_on_to_first(COMM)
    watch()
    ending.leave(ending.conclude(COMM, globals()[sys.argv[1]]))
