"""A call in a process of its own, for libraries that crash or hang on damaged files."""

from __future__ import annotations

import os
import pickle
import signal
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn

_DEADLY = ("SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL", "SIGABRT", "SIGALRM", "SIGXCPU", "SIGTERM", "SIGINT")
_LONGEST = 10  # s of the processor for any file: libraries go round in circles in some that are damaged
_FREE = 2**30  # bytes that a file may take whatever its size


class Died(Exception):
    """A process ended before it had answered; the text says how, for messages."""


def read_apart(path: str | os.PathLike[str], function: Callable[..., Any], *arguments: Any, gain: int) -> Any:
    """Return ``function(*arguments)``, which reads a file, from a process of its own.  Local.

    ``gain`` is the memory that each byte of the file may take.

    Raises
    ------
    Died : the library that reads the file crashes on it, does not end, or asks for more memory
    Whatever the function raises
    """
    n_bytes = os.path.getsize(path)
    n_MiB = n_bytes // 2**20
    return apart(function, *arguments, seconds=60 + n_MiB, memory=_FREE + gain * n_bytes, processor=_LONGEST + n_MiB)


def apart(function: Callable[..., Any], *arguments: Any, seconds: int, memory: int, processor: int | None = None) -> Any:
    """Return what a function returns in a fork of this process, of which nothing else comes back.  Local.

    Parameters
    ----------
    seconds : that the call may take
    memory : bytes that it may take beside what there is
    processor : seconds of the processor that it may take; as long as the call if not stated

    Raises
    ------
    Died : the process ended otherwise
    Whatever the function raises
    """
    ours, theirs = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(ours)
        _answer(theirs, function, arguments, seconds, memory, processor or seconds)
    os.close(theirs)
    with os.fdopen(ours, "rb") as file:
        answer = file.read()
    _, status = os.waitpid(process, 0)
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        if number == signal.SIGALRM:
            raise Died(f"its reading does not end within {seconds} s")
        if number == signal.SIGXCPU:
            raise Died(f"its reading does not end within {processor or seconds} s of the processor")
        raise Died(f"the library that reads it crashes on it ({signal.Signals(number).name})")
    if not answer:
        raise Died("it asks for more memory than it can stand for")
    is_well, value = pickle.loads(answer)
    if not is_well:
        raise value
    return value


def _answer(
    pipe: int, function: Callable[..., Any], arguments: tuple[Any, ...], seconds: int, memory: int, processor: int
) -> NoReturn:
    """Write what the function returns or raises to a pipe, nothing where memory is short, and end this process."""
    try:
        for name in _DEADLY:  # those who have set handlers, MPI too, are to hear nothing of it
            signal.signal(getattr(signal, name), signal.SIG_DFL)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        signal.alarm(seconds)
        _limit(memory, processor)
        with os.fdopen(pipe, "wb") as file:
            file.write(_outcome(function, arguments))
    except BaseException:  # no answer is one, too
        pass
    finally:
        os._exit(0)


def _outcome(function: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes:
    """Return whether the function returned, and what it returned or raised."""
    try:
        return pickle.dumps((True, function(*arguments)), protocol=5)
    except MemoryError:
        return b""
    except Exception as problem:
        try:
            return pickle.dumps((False, problem))
        except Exception:
            return pickle.dumps((False, RuntimeError(f"{type(problem).__name__}: {problem}")))


def _limit(memory: int, processor: int) -> None:
    with suppress(ImportError, OSError, ValueError):
        import resource

        with open("/proc/self/statm") as file:
            mapped = int(file.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (processor, processor + 1))
        resource.setrlimit(resource.RLIMIT_AS, (mapped + memory, resource.getrlimit(resource.RLIMIT_AS)[1]))
