"""A memory limit while a file is read, set by the size of the file and not by the counts in it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ..messages.errors import MeshError
from ..system.memory import bounded_by_machine, gigabytes

_FREE = 2**30  # bytes for any file
_GAIN = 200  # bytes for each byte of a file: each card of bulk data becomes a Python object


@contextmanager
def bounded_memory(path: str) -> Iterator[None]:
    """Limit the memory that the block may allocate while it reads a file, by its size and by what is left.  Local.

    Libraries allocate by the counts in a file before they read the data.  No limit where the system does not offer one.

    Raises
    ------
    MeshError without the file's name : reading needs more memory
    """
    n_bytes = os.path.getsize(path)
    try:
        with _address_space(limit := bounded_by_machine(_FREE + _GAIN * n_bytes)):
            yield
    except MemoryError:
        text = f"it requests more than {gigabytes(limit)} of memory, the limit of a file of {n_bytes} bytes on this machine"
        raise MeshError(text) from None


@contextmanager
def _address_space(more: int) -> Iterator[None]:
    """Limit the address space of this process to its present size plus ``more`` bytes."""
    try:
        import resource

        with open("/proc/self/statm") as file:
            mapped = int(file.read().split()[0]) * resource.getpagesize()
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    except (ImportError, OSError, ValueError):
        yield
        return
    limit = mapped + more
    if soft != resource.RLIM_INFINITY and soft <= limit:
        yield
        return
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    try:
        yield
    finally:
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
