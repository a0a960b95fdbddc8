"""The machine a benchmark ran on: processor, memory, versions, and the two rates that bound the program."""

from __future__ import annotations

import os
import platform
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from scipy.linalg.blas import daxpy


def facts() -> dict[str, str]:
    """Return the description of the machine for a table of times.  Local."""
    import microslip

    values = {
        "processor": f"{processor()}, {len(os.sched_getaffinity(0))} of {os.cpu_count()} cores, {memory():.0f} GiB",
        "BLAS threads": os.environ.get("OPENBLAS_NUM_THREADS", "as the library chooses"),
        "OpenBLAS kernels": os.environ.get("OPENBLAS_CORETYPE", "as the library chooses"),
    }
    versions = [f"microslip {microslip.__version__}", f"Python {platform.python_version()}"]
    for package in ("numpy", "scipy", "petsc4py", "slepc4py", "mpi4py"):
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return {**values, "versions": ", ".join(versions)}


def lines(values: dict[str, str]) -> list[str]:
    """Return facts as sentences."""
    return [f"{name[0].upper() + name[1:]}: {text}." for name, text in values.items()]


def items() -> list[str]:
    """Return the facts and the date as a list of Markdown."""
    return [f"- {line}" for line in (*lines(facts()), time.strftime("%Y-%m-%d."))]


def processor() -> str:
    """Return the processor's general name."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def memory() -> float:
    """Return the memory of the machine [GiB]."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30


def matrix_product_rate(n: int = 1024, repetitions: int = 5) -> float:
    """Return the rate of a product of two n x n matrices, 2 n^3 operations, of one process [GFLOP/s]: the best of several."""
    A, B, C = (np.full((n, n), 1.0) for _ in range(3))
    return 2e-9 * n**3 / best_of(lambda: np.matmul(A, B, out=C), repetitions)


def memory_bandwidth(n: int = 20_000_000, repetitions: int = 5) -> float:
    """Return the rate of y += a x on vectors beyond the caches, 24 n bytes, of one process [GB/s]: the best of several."""
    x, y = np.ones(n), np.ones(n)
    return 24e-9 * n / best_of(lambda: daxpy(x, y, a=1e-3), repetitions)


def best_of(call, repetitions: int) -> float:
    """Return the least processor time of ``call`` [s], which others on the machine disturb least."""
    times = []
    for _ in range(repetitions):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)
