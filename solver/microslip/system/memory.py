"""Memory available to this process, by machine, control group and limit, and memory in use.  Local."""

import ctypes
import os
import resource
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath

UNLIMITED = 2.0**60  # bytes: control groups of the first version write 2^63 where there is no limit
_MIB = 1024.0**2
_LEAST = 2**28  # bytes that any call may map: libraries map more than they use
_CACHED_FILES = {1: ("total_inactive_file", "total_active_file"), 2: ("inactive_file", "active_file")}  # given up for others
_M_MMAP_THRESHOLD, _M_MMAP_MAX = -3, -4  # of glibc's malloc.h
_LARGE, _N_BLOCKS = (
    2**25,
    2**16,
)  # bytes of a block from which it is mapped separately, glibc's upper bound; number of them, its default
_PAD = 2**17  # bytes that stay free at the end of the heap, glibc's default M_TOP_PAD
_LIMITS = {1: ("memory.limit_in_bytes",), 2: ("memory.max", "memory.high")}
_USED = {1: "memory.usage_in_bytes", 2: "memory.current"}


@dataclass(frozen=True)
class Limit:
    """A bound on the memory of some processes."""

    name: str  # name in messages
    shared_by: str  # the same for all processes that share it
    available: float  # bytes


def gigabytes(size: float) -> str:
    """Return a number of bytes in words.  Local."""
    return f"{size / 1e9:.3g} GB" if size >= 0.995e9 else f"{size / 1e6:.3g} MB"


def give_back() -> None:
    """Return memory that was freed to the system, which otherwise counts it as this process's.  Local.

    Some stays at the end of the heap: OpenBLAS 0.3.21 reads past the vector of a transposed complex product (zgemv).
    """
    trim = _trim()
    if trim is not None:
        trim(_PAD)


def return_large_blocks() -> None:
    """Let freed memory of large arrays return to the system, glibc's default, which Open MPI turns off.  Local."""
    set_option = _of_c_library("mallopt")
    if set_option is not None:
        set_option(_M_MMAP_MAX, _N_BLOCKS)
        set_option(_M_MMAP_THRESHOLD, _LARGE)


@lru_cache(maxsize=1)
def _trim() -> Callable[[int], int] | None:
    """Return malloc_trim of the C library; None of one without it.  Local."""
    return _of_c_library("malloc_trim")


def _of_c_library(name: str) -> Callable[..., int] | None:
    """Return a function of the C library; None of one without it.  Local."""
    return getattr(ctypes.CDLL(None), name, None)


def resident_memory() -> float:
    """Return the resident memory of this process [bytes]; 0 where unknown.  Local."""
    try:
        return float(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError, ValueError):
        return 0.0


def peak_memory() -> float:
    """Return the most that this process has had in memory so far [bytes].  Local."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0


def memory_left_here() -> float:
    """Return the memory available to this process if no other one takes more [bytes]; infinite where unknown.  Local."""
    return min((limit.available for limit in limits_here("machine", "process", resident_memory())), default=float("inf"))


def lack_of_memory(needed: float) -> str | None:
    """Return the end of a message on missing memory for a number of bytes; None if there is enough.  Local."""
    if needed <= (left := memory_left_here()):
        return None
    return f"{gigabytes(needed)} of memory, of which {gigabytes(left)} are left"


def bounded_by_machine(limit: int) -> int:
    """Return a limit for the memory of a call [bytes], at most the available memory.  Local."""
    return int(min(limit, max(_LEAST, memory_left_here())))


# -- limits, read ------------------------------------------------------------------------------------------------------


def limits_here(machine: str, process: str, resident: float, root: Path = Path("/")) -> list[Limit]:
    """Return the limits of this process's memory.  Local.

    Parameters
    ----------
    machine, process : identify the machine and this process
    resident : bytes that the ranks of this machine have together
    root : where /proc and /sys are found
    """
    limits = [Limit("the machine", machine, available) for available in _machine(root)]
    limits += [Limit(name, f"{machine} {name}", available) for name, available in _control_groups(root)]
    limits += [Limit(name, f"{machine} {name}", total - resident) for name, total in _slurm()]
    return limits + [Limit(name, process + name, available) for name, available in _of_process(root)]


def _machine(root: Path) -> Iterator[float]:
    """Yield the available memory of the machine [bytes], if known."""
    for line in _lines(root / "proc/meminfo"):
        if line.startswith("MemAvailable:"):
            yield 1024.0 * float(line.split()[1])


def _control_groups(root: Path) -> Iterator[tuple[str, float]]:
    """Yield name and bytes left of each control group of this process that has a limit, from its own up to the mounted one."""
    mounts = {version: (mounted, base) for version, mounted, base in _mounted(root)}
    for line in _lines(root / "proc/self/cgroup"):
        number, controllers, path = line.rstrip("\n").split(":", 2)
        version = 2 if number == "0" and not controllers else 1
        if version not in mounts or (version == 1 and "memory" not in controllers.split(",")):
            continue
        mounted, base = mounts[version]
        try:
            inside = PurePosixPath(path).relative_to(base)
        except ValueError:  # the namespace of a container shows another path: its own group is the mounted one
            inside = PurePosixPath()
        for group in [inside, *inside.parents]:
            folder = root / mounted.relative_to("/") / group
            total = min((_number(folder / name) for name in _LIMITS[version]), default=UNLIMITED)
            if total < UNLIMITED:
                yield f"control group /{group}".replace("/.", "/"), total - _used(folder, version)


def _mounted(root: Path) -> Iterator[tuple[int, PurePosixPath, PurePosixPath]]:
    """Yield version, mount point and the group that is mounted there, of hierarchies that control memory."""
    for line in _lines(root / "proc/self/mountinfo"):
        before, _, after = line.partition(" - ")
        fields, kind = before.split(), after.split()
        if kind[0] == "cgroup2":
            yield 2, PurePosixPath(fields[4]), PurePosixPath(fields[3])
        elif kind[0] == "cgroup" and "memory" in kind[2].split(","):
            yield 1, PurePosixPath(fields[4]), PurePosixPath(fields[3])


def _used(folder: Path, version: int) -> float:
    """Return the memory in use by a group [bytes], without its reclaimable page cache."""
    entries = dict(line.split()[:2] for line in _lines(folder / "memory.stat"))
    cached = sum(float(entries.get(name, 0.0)) for name in _CACHED_FILES[version])
    used = _number(folder / _USED[version])
    return 0.0 if used >= UNLIMITED else max(used - cached, 0.0)


def _slurm() -> Iterator[tuple[str, float]]:
    """Yield Slurm's limit for the job on this machine [bytes], if stated: not every site has control groups."""
    try:
        node, cpu = (float(os.environ.get(f"SLURM_MEM_PER_{unit}", 0.0)) for unit in ("NODE", "CPU"))
        total = node or cpu * float(os.environ.get("SLURM_CPUS_ON_NODE", 0.0))
    except ValueError:
        return
    if total > 0.0:
        yield "the job's memory in Slurm", total * _MIB


def _of_process(root: Path) -> Iterator[tuple[str, float]]:
    """Yield name and bytes left of the limits of this process alone."""
    sizes = dict(line.split()[:2] for line in _lines(root / "proc/self/status") if line.startswith("Vm"))
    limits = (("address space (ulimit -v)", resource.RLIMIT_AS, "VmSize:"), ("data (ulimit -d)", resource.RLIMIT_DATA, "VmData:"))
    for name, which, used in limits:
        total = resource.getrlimit(which)[0]
        if total != resource.RLIM_INFINITY and used in sizes:
            yield f"the process's {name}", total - 1024.0 * float(sizes[used])


def _number(path: Path) -> float:
    """Return the number in a file, ``UNLIMITED`` where there is none."""
    try:
        return float(next(_lines(path)))
    except (StopIteration, ValueError):
        return UNLIMITED


def _lines(path: Path) -> Iterator[str]:
    """Yield the lines of a file; none where it cannot be read."""
    try:
        with open(path) as file:
            yield from file
    except OSError:
        return
