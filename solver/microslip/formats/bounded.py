"""Reading with a limit: a file gets no more memory than one of its size can need, whatever its counts say."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ..messages.errors import MeshError

_FREE = 2**30  # bytes for any file
_GAIN = 200  # bytes for each byte of a file: the cards of bulk data are objects of Python


@contextmanager
def bounded_memory(path: str) -> Iterator[None]:
    """Limit the memory that a block may take for reading a file.  Local.

    Libraries allocate what a count in a file asks for, and fill it afterwards.  Where the system has no such limit there is none.

    Raises
    ------
    MeshError without the file's name : it asks for more
    """
    n_bytes = os.path.getsize(path)
    try:
        with _address_space(_FREE + _GAIN * n_bytes):
            yield
    except MemoryError:
        raise MeshError(f"it asks for more memory than a file of {n_bytes} bytes can stand for; it is damaged") from None


@contextmanager
def _address_space(more: int) -> Iterator[None]:
    """Limit what this process may map to what it has mapped and ``more`` bytes."""
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
