"""Functions that tests call in a sandbox, which imports them from here."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from microslip.messages.errors import MeshError


@dataclass(frozen=True)
class Answer:
    """A value of every kind."""

    array: np.ndarray
    matrix: sp.spmatrix
    table: dict
    rest: tuple = ()


def answer() -> Answer:
    matrix = sp.random(7, 5, 0.4, random_state=1, format="csc")
    array = np.arange(6, dtype=">i4").reshape(2, 3)[:, ::2]
    return Answer(
        array, matrix, {3: np.zeros((0, 3)), (1, "a"): [None, True, 2**70]}, (0.1, np.nan, "\udcff", np.float32(0.5), 1j)
    )


def abort() -> None:
    os.abort()


def fill(n_bytes: int) -> None:
    np.ones(n_bytes // 8)


def sleep(seconds: float = 60.0) -> None:
    time.sleep(seconds)


def circle() -> None:
    while True:
        pass


def leave() -> None:
    os._exit(0)


def unsent() -> object:
    return object()


def fault(text: str) -> None:
    raise MeshError(text)


def defect(text: str) -> None:
    raise KeyError(text)


def descriptors() -> list[str]:
    """Return the open descriptors of this process, without the pipe of the result."""
    return [os.readlink(f"/proc/self/fd/{n}") for n in os.listdir("/proc/self/fd") if os.path.exists(f"/proc/self/fd/{n}")]


def variables() -> list[str]:
    return [name for name in os.environ if name.startswith(("OMPI_COMM", "PMIX_"))]


def name_and_sleep(file: str) -> None:
    """Write the number of this process to a file, and wait."""
    Path(file).write_text(f"{os.getpid()}\n")
    time.sleep(60.0)
