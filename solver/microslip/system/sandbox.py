"""Calls in a sandbox: a process with limits, for libraries that crash, hang or write beyond their arrays on damaged files.

The process is new, not forked: it has neither the threads nor the descriptors of its parent, and so no lock.  It has no link
to the MPI launcher, imports only the modules of the called function, and ends with its parent in all cases.  A malicious file may
control the library and its answer, so ``plain_data`` reads that.
"""

import os
import pickle
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module
from typing import Any, NoReturn

from ..messages import errors
from . import plain_data
from .memory import bounded_by_machine, gigabytes

_LONGEST = 10  # s of the processor for any file: libraries go round in circles in some that are damaged
_FREE = 2**30  # bytes that a file of any size may take
_NO_MEMORY = 3  # status of a process whose call needs more
_START = "import sys; sys.path[:] = sys.argv[1:]; from microslip.system.sandbox import serve; serve()"
_LAUNCHERS = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "HYDRA_", "MPI_", "SLURM_")  # variables: the process is no rank
_OF_PARENT = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1)  # the parent handles them
_DEATH_OF_PARENT = 1  # PR_SET_PDEATHSIG


class SandboxError(Exception):
    """The process ended without an answer; the text has the reason, for messages."""


class LibraryError(Exception):
    """The function raised an exception that is no error of this program; the text has it."""


def read_file(
    path: str | os.PathLike[str], function: Callable[..., Any], *arguments: Any, gain: int, returns: Iterable[type] = ()
) -> Any:
    """Return ``function(*arguments)``, which reads a file, from a sandbox.  Local.

    ``gain`` is the memory that each byte of the file may take, at most what is left; for all else see :func:`call`.

    Raises
    ------
    SandboxError : the library that reads the file crashes on it, does not end, or needs more memory
    LibraryError, MicroslipError : as :func:`call`
    """
    n_bytes = os.path.getsize(path)
    n_MiB = n_bytes // 2**20
    memory = bounded_by_machine(_FREE + gain * n_bytes)
    limits = {"seconds": 60 + n_MiB, "memory": memory, "processor": _LONGEST + n_MiB}
    return call(function, *arguments, **limits, returns=returns)


def call(
    function: Callable[..., Any],
    *arguments: Any,
    seconds: int,
    memory: int,
    processor: int | None = None,
    returns: Iterable[type] = (),
) -> Any:
    """Return ``function(*arguments)`` from a sandbox; only plain data leave it.  Local.

    Parameters
    ----------
    function : of a module, which the sandbox imports
    arguments : what pickle can send
    seconds : that the call may take
    memory : bytes that it may take in addition to its modules
    processor : seconds of the processor that it may take; as long as the call if not stated
    returns : the dataclasses that the answer may hold, in addition to what ``plain_data`` sends

    Raises
    ------
    SandboxError : the process ended otherwise
    MicroslipError : raised by the function: the same type with the same text
    LibraryError : anything else that it raised
    """
    processor = processor or seconds
    request = os.getpid(), function.__module__, function.__qualname__, arguments, seconds, memory, processor
    environment = {name: value for name, value in os.environ.items() if not name.startswith(_LAUNCHERS)}
    environment["OMPI_MCA_ess_singleton_isolated"] = "1"  # an HDF5 with MPI starts it: without a daemon
    with subprocess.Popen(
        [sys.executable, "-I", "-c", _START, *sys.path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=environment,
    ) as process:
        try:
            with suppress(BrokenPipeError), process.stdin as pipe:
                pickle.dump(request, pipe)
            is_well, answer = _answer(process.stdout, returns, memory)
        except plain_data.Unreadable as problem:
            raise SandboxError(_end(process.wait(), seconds, processor, memory, problem)) from None
        finally:
            process.kill()
    if is_well:
        return answer
    name, text, trace = answer
    kind = getattr(errors, str(name), None)
    if isinstance(kind, type) and issubclass(kind, errors.MicroslipError):
        raise kind(text)
    raise LibraryError(f"{name}: {text}") from LibraryError(f"in the sandbox\n{trace}")


def _answer(pipe: Any, returns: Iterable[type], memory: int) -> tuple[bool, Any]:
    """Return whether the function returned, and what: or the type, the text and the trace of what it raised."""
    answer = plain_data.read(pipe, returns, most=memory)
    if not isinstance(answer, tuple) or len(answer) != 2 or not (answer[0] is True or len(answer[1]) == 3):
        raise plain_data.Unreadable("something else than an answer")
    return answer


def _end(status: int, seconds: int, processor: int, memory: int, problem: Exception) -> str:
    """Return how a process without an answer ended."""
    if status == -signal.SIGALRM:
        return f"its reading does not end within {seconds} s"
    if status == -signal.SIGXCPU:
        return f"its reading does not end within {processor} s of the processor"
    if status < 0:
        return f"the library that reads it crashes on it ({signal.Signals(-status).name})"
    if status == _NO_MEMORY:
        return f"it requests more than {gigabytes(memory)} of memory, its limit on this machine"
    return f"the process that reads it ends with status {status} and no answer ({problem})"


# -- in the sandbox ----------------------------------------------------------------------------------------------------


def serve() -> NoReturn:
    """Answer the request on standard input, and end the process.  Local; all that a sandbox does."""
    for number in _OF_PARENT:
        signal.signal(number, signal.SIG_IGN)
    parent, module, name, arguments, seconds, memory, processor = pickle.load(sys.stdin.buffer)
    _end_with(parent)
    with os.fdopen(os.dup(1), "wb") as pipe:
        nowhere = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1):
            os.dup2(nowhere, stream)
        try:
            answer = True, _limited(module, name, seconds, memory, processor)(*arguments)
        except MemoryError:
            os._exit(_NO_MEMORY)
        except Exception as problem:
            answer = False, (type(problem).__name__, str(problem), traceback.format_exc())
        try:
            plain_data.write(pipe, answer)
        except MemoryError:
            os._exit(_NO_MEMORY)
        except TypeError as problem:
            plain_data.write(pipe, (False, ("TypeError", str(problem), traceback.format_exc())))
    os._exit(0)


def _end_with(parent: int) -> None:
    """Let the system end this process with its parent, after a check that this still exists.  Linux alone has that."""
    import ctypes

    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(_DEATH_OF_PARENT, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def _limited(module: str, name: str, seconds: int, memory: int, processor: int) -> Callable[..., Any]:
    """Return a function of a module, with limits set for its call."""
    function: Any = import_module(module)
    for part in name.split("."):
        function = getattr(function, part)
    signal.alarm(seconds)
    with suppress(ImportError, OSError, ValueError):
        import resource

        with open("/proc/self/statm") as file:
            mapped = int(file.read().split()[0]) * resource.getpagesize()
        used, most = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2])), resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (used + processor, used + processor + 1))
        total = mapped + memory
        resource.setrlimit(resource.RLIMIT_AS, (total if most == resource.RLIM_INFINITY else min(total, most), most))
    return function
