"""METIS and signals: it leaves them as they were, and one that finds it at work stops the program as anywhere else."""

import numpy as np
import pytest
import scipy.sparse as sp
from processes import python

from microslip.parallel import metis

WRITES = """
import os, signal, sys
import numpy as np
import scipy.sparse as sp
from microslip.parallel import metis
from microslip.messages.errors import Interrupted
from microslip.system.signals import obey_signals

signal.signal(signal.SIGTERM, signal.SIG_DFL)
obey_signals()
metis.nested_dissection(sp.csr_matrix(np.ones((9, 9)) - np.eye(9)))
_, full = os.pipe()
os.dup2(full, 1)
if os.fork() == 0:
    os.execlp("sh", "sh", "-c", f"sleep 1; kill -TERM {os.getppid()}")
try:
    while True:
        print("a line of progress", flush=True)
except Interrupted:
    print("what is said on the way out", flush=True)
    sys.stderr.write("stopped")
    sys.stderr.flush()
    os._exit(5)
"""
ORDERS = """
import os, signal
import scipy.sparse as sp
from microslip.parallel import metis
from microslip.messages.errors import Interrupted

def grid(n):
    alone, row = sp.eye(n), sp.diags([1.0, 1.0], [-1, 1], shape=(n, n))
    return sp.kron(sp.kron(alone, alone), row) + sp.kron(sp.kron(alone, row), alone) + sp.kron(sp.kron(row, alone), alone)

graph = sp.csr_matrix(grid(90))
metis.nested_dissection(sp.csr_matrix(grid(3)))
signal.signal(signal.SIGTERM, signal.SIG_IGN)
if os.fork() == 0:
    os.execlp("sh", "sh", "-c", f"sleep 1; kill -TERM {os.getppid()}")
try:
    metis.nested_dissection(graph)
except Interrupted as problem:
    print(problem)
"""


def path_graph(n):
    return sp.csr_matrix(sp.diags([1.0, 1.0], [-1, 1], shape=(n, n)))


def test_an_order_names_every_node_once():
    assert np.array_equal(np.sort(metis.nested_dissection(path_graph(50))), np.arange(50))


@pytest.mark.parametrize("n_parts", [2, 3, 7])
def test_parts_are_alike_in_weight_and_cut_little(n_parts):
    weights = np.ones(210)
    part = metis.partition(path_graph(210), n_parts, weights)
    assert np.bincount(part).max() <= 1.1 * 210 / n_parts
    assert np.count_nonzero(np.diff(part)) == n_parts - 1  # a path falls into pieces


def test_a_full_output_is_left_when_a_signal_asks_to_stop_also_after_metis():
    """As mpirun no longer reads what ranks print after it was told to stop: a write would wait until it kills."""
    done = python("-c", WRITES)
    assert (done.returncode, done.stderr) == (5, "stopped")


@pytest.mark.slow
def test_a_signal_while_metis_works_interrupts():
    done = python("-c", ORDERS)
    assert done.returncode == 0 and done.stdout.startswith("stopped by SIGTERM")
