"""Available memory, read from the files of Linux: machine, control groups of both versions, Slurm, limits of a process."""

import ctypes
import resource

import pytest

from microslip.guards.memory import worst
from microslip.system import memory
from microslip.system.memory import Limit, gigabytes, limits_here

GB = 1e9
MEMINFO = "MemTotal:       24000000 kB\nMemFree:        10000000 kB\nMemAvailable:   20000000 kB\n"
STATUS = "Name:\tpython\nVmSize:\t  500000 kB\nVmData:\t  300000 kB\n"
V2 = "31 23 0:26 / /sys/fs/cgroup rw,nosuid - cgroup2 cgroup2 rw,nsdelegate\n"
V1 = (
    "35 31 0:32 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory\n36 31 0:33 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw,cpu\n"
)


@pytest.fixture
def root(tmp_path, monkeypatch):
    """Return a function of files and their texts that makes a root folder with /proc and /sys."""
    for name in ("SLURM_MEM_PER_NODE", "SLURM_MEM_PER_CPU", "SLURM_CPUS_ON_NODE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(resource, "getrlimit", lambda which: (resource.RLIM_INFINITY,) * 2)

    def make(**files):
        for name, text in {"proc/meminfo": MEMINFO, "proc/self/status": STATUS, **files}.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return tmp_path

    return make


def left(root):
    return {limit.name: limit.available for limit in limits_here("machine 0", "rank 0", 1.0 * GB, root)}


def test_memory_of_the_machine(root):
    assert left(root()) == {"the machine": 20000000 * 1024.0}


def test_other_systems_have_no_information(root):
    assert left(root(**{"proc/meminfo": "", "proc/self/status": ""})) == {}


def test_control_groups_of_version_2_are_read_up_to_the_root(root):
    """Cached files are released for other processes; the lower of memory.max and memory.high applies."""
    job, step = "sys/fs/cgroup/slurm/job_7", "sys/fs/cgroup/slurm/job_7/step_0"
    files = {
        "proc/self/cgroup": "0::/slurm/job_7/step_0\n",
        "proc/self/mountinfo": V2,
        f"{job}/memory.max": "4000000000\n",
        f"{job}/memory.high": "3000000000\n",
        f"{job}/memory.current": "2500000000\n",
        f"{job}/memory.stat": "anon 1\ninactive_file 900000000\nactive_file 100000000\n",
        f"{step}/memory.max": "max\n",
        f"{step}/memory.high": "max\n",
        f"{step}/memory.current": "2000000000\n",
    }
    assert left(root(**files)) == {"the machine": pytest.approx(20.48e9), "control group /slurm/job_7": 1.5e9}


def test_control_groups_of_version_1(root):
    group = "sys/fs/cgroup/memory/pbs/job"
    files = {
        "proc/self/cgroup": "9:cpu:/other\n4:memory:/pbs/job\n0::/\n",
        "proc/self/mountinfo": V1,
        f"{group}/memory.limit_in_bytes": "2000000000\n",
        f"{group}/memory.usage_in_bytes": "1200000000\n",
        f"{group}/memory.stat": "cache 5\ntotal_inactive_file 150000000\ntotal_active_file 50000000\n",
        "sys/fs/cgroup/memory/memory.limit_in_bytes": "9223372036854771712\n",
    }
    assert left(root(**files))["control group /pbs/job"] == 1.0e9 and len(left(root())) == 2


def test_a_container_has_its_group_as_the_root(root):
    """Its namespace has a path that is not mounted; the mounted group is its own."""
    files = {
        "proc/self/cgroup": "0::/\n",
        "proc/self/mountinfo": V2.replace("0:26 / ", "0:26 /docker/ab12 "),
        "sys/fs/cgroup/memory.max": "1000000000\n",
        "sys/fs/cgroup/memory.current": "400000000\n",
    }
    assert left(root(**files))["control group /"] == 0.6e9


@pytest.mark.parametrize(
    "stated, total",
    [
        ({"SLURM_MEM_PER_NODE": "4096"}, 4096),
        ({"SLURM_MEM_PER_CPU": "2048", "SLURM_CPUS_ON_NODE": "3"}, 6144),
        ({"SLURM_MEM_PER_NODE": "0"}, None),
        ({"SLURM_MEM_PER_NODE": "4G"}, None),
    ],
)
def test_memory_granted_by_slurm_is_shared_by_the_ranks_of_a_machine(root, monkeypatch, stated, total):
    for name, value in stated.items():
        monkeypatch.setenv(name, value)
    available = left(root()).get("the job's memory in Slurm")
    assert available == (None if total is None else total * 1024**2 - 1.0 * GB)


@pytest.mark.parametrize(
    "which, name, used", [("RLIMIT_AS", "address space (ulimit -v)", 500000), ("RLIMIT_DATA", "data (ulimit -d)", 300000)]
)
def test_limits_of_the_process(root, monkeypatch, which, name, used):
    limited = getattr(resource, which)
    monkeypatch.setattr(resource, "getrlimit", lambda requested: (2**31 if requested == limited else resource.RLIM_INFINITY,) * 2)
    assert left(root())[f"the process's {name}"] == 2**31 - 1024.0 * used


def test_shared_limits_are_compared_with_the_sum_of_the_ranks():
    machine, group, own = Limit("the machine", "m", 10.0), Limit("group", "g", 5.0), Limit("own", "r1", 3.0)
    ranks = [[machine, group], [machine, group, own]]
    assert worst(ranks, [2.0, 2.5]) is None
    assert str(worst(ranks, [3e9, 2.5e9])).startswith("its 2 ranks need 5.5 GB more, but only 5e-06 MB of group")
    assert worst(ranks, [0.5, 3.5]).limit == "own" and worst(ranks, [0.5, 3.5]).n_ranks == 1
    assert worst([[], []], [1e30, 1e30]) is None


def test_numbers_of_bytes_in_words():
    assert [gigabytes(size) for size in (1.234e10, 2e9, 3.21e6)] == ["12.3 GB", "2 GB", "3.21 MB"]


def test_freed_memory_is_returned_to_the_system():
    memory.give_back()  # otherwise part of it reuses memory freed by earlier tests
    before = memory.resident_memory()
    many = [bytearray(1000) for _ in range(300_000)]
    last, held = many[-1], memory.resident_memory()  # memory next to the last one cannot be returned by itself
    many.clear()
    memory.give_back()
    assert held - before > 60e6 and memory.resident_memory() - before < 0.5 * (held - before) and last is not None
    assert memory.peak_memory() > 0.99 * held


def test_some_memory_remains_at_the_end_of_the_heap():
    """A library that reads slightly past the end of an array there would otherwise read unmapped memory."""
    library = ctypes.CDLL(None)
    if not hasattr(library, "mallinfo2"):
        pytest.skip("a C library other than glibc 2.33 or later")
    library.mallinfo2.restype = type(
        "Info", (ctypes.Structure,), {"_fields_": [(f"size_{i}", ctypes.c_size_t) for i in range(10)]}
    )
    some = [bytearray(1000) for _ in range(10000)]
    del some
    memory.give_back()
    assert 2**16 <= library.mallinfo2().size_9 <= 2**19  # keepcost, free at the end
