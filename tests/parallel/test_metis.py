"""METIS and signals: handlers are preserved, and a signal during its work stops the program as usual."""

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
GRID = """
import os, random, signal, threading, time, traceback
import scipy.sparse as sp
from microslip.parallel import metis
from microslip.messages.errors import Interrupted
from microslip.system.signals import obey_signals, unsignalled

def grid(n):
    alone, row = sp.eye(n), sp.diags([1.0, 1.0], [-1, 1], shape=(n, n))
    return sp.csr_matrix(
        sp.kron(sp.kron(alone, alone), row) + sp.kron(sp.kron(alone, row), alone) + sp.kron(sp.kron(row, alone), alone)
    )
"""
ORDERS = (
    GRID
    + """
graph = grid(90)
assert graph.nnz > metis.LARGE  # METIS takes more than the second until the signal
obey_signals()
if os.fork() == 0:
    os.execlp("sh", "sh", "-c", f"sleep 1; kill -TERM {os.getppid()}")
try:
    metis.nested_dissection(graph)
except Interrupted as problem:
    print(problem, "sandbox" in traceback.format_exc())
"""
)
MANY = (
    GRID
    + """
with unsignalled():
    threading.Thread(target=time.sleep, args=(1e6,), daemon=True).start()
graph, weights = grid(12), np.ones(12**3)
began = time.perf_counter()
metis.partition(graph, 2, weights)
seconds = time.perf_counter() - began
receiver, sender = os.pipe()
if os.fork() == 0:
    os.close(sender)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    while os.read(receiver, 1):
        until = time.perf_counter() + random.uniform(0.0, seconds)
        while time.perf_counter() < until:
            pass
        os.kill(os.getppid(), signal.SIGTERM)
    os._exit(0)
n = 0
for _ in range(300):
    obey_signals()
    try:
        os.write(sender, b"x")
        metis.partition(graph, 2, weights)
        time.sleep(30.0)  # the sender may wait for a core
    except Interrupted:
        n += 1
print(n)
"""
).replace("import scipy.sparse", "import numpy as np\nimport scipy.sparse", 1)
THREADS = """
import glob, signal, time
from microslip import __main__ as program
from microslip.guards.overdue import oversee_signals

oversee_signals()
program._world()
time.sleep(0.5)
masks = []
for status in glob.glob("/proc/self/task/*/status"):
    masks += [int(line.split()[1], 16) for line in open(status) if line.startswith("SigBlk")]
print(len(masks) > 2, [bool(mask >> signal.SIGTERM - 1 & 1) for mask in masks].count(False))
"""


def path_graph(n):
    return sp.csr_matrix(sp.diags([1.0, 1.0], [-1, 1], shape=(n, n)))


def test_an_order_is_a_permutation():
    assert np.array_equal(np.sort(metis.nested_dissection(path_graph(50))), np.arange(50))


@pytest.mark.parametrize("n_parts", [2, 3, 7])
def test_parts_have_similar_weights_and_few_cuts(n_parts):
    weights = np.ones(210)
    part = metis.partition(path_graph(210), n_parts, weights)
    assert np.bincount(part).max() <= 1.1 * 210 / n_parts
    assert np.count_nonzero(np.diff(part)) == n_parts - 1  # a path falls into pieces


def test_a_blocked_output_is_interrupted_by_a_signal_also_after_metis():
    """When mpirun was stopped it no longer reads the output of ranks: a write would block until it kills them."""
    done = python("-c", WRITES)
    assert (done.returncode, done.stderr) == (5, "stopped")


@pytest.mark.slow
def test_a_signal_while_metis_works_interrupts():
    done = python("-c", ORDERS)
    assert (done.returncode, done.stdout) == (0, "stopped by SIGTERM True\n"), done.stderr


@pytest.mark.slow
def test_signals_during_a_small_graph_are_handled_after_it():
    """METIS' handler leaves by longjmp: after about twenty signals the process waited forever, or crashed."""
    done = python("-c", MANY)
    assert (done.returncode, done.stdout) == (0, "300\n"), done.stderr


def test_only_the_first_thread_receives_signals():
    assert python("-c", THREADS).stdout == "True 1\n"


def test_a_large_graph_has_the_same_order_in_another_process(monkeypatch):
    graph, weights = path_graph(300), np.ones(300)
    computed = metis.nested_dissection(graph), metis.partition(graph, 3, weights)
    monkeypatch.setattr(metis, "LARGE", 0)
    by_process = metis.nested_dissection(graph), metis.partition(graph, 3, weights)
    assert all(np.array_equal(a, b) for a, b in zip(computed, by_process))
