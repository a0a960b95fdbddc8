"""A call tried out in a process of its own, for libraries that crash or hang on damaged files."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import suppress
from typing import Any

_DEADLY = ("SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL", "SIGABRT", "SIGALRM", "SIGTERM", "SIGINT")
_OUT_OF_MEMORY = 3  # status of the process


def dies_of(function: Callable[..., Any], *arguments: Any, seconds: int, memory: int) -> str | None:
    """Return how a process dies of a call, for messages; None where it returns or raises an error.  Local.

    The process is a fork of this one: it sees what this one sees, and nothing that it does comes back.

    Parameters
    ----------
    seconds : that the call may take
    memory : bytes that it may take beside what there is
    """
    process = os.fork()
    if process == 0:
        _try(function, arguments, seconds, memory)
    _, status = os.waitpid(process, 0)
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        if number == signal.SIGALRM:
            return f"its reading does not end in {seconds} s"
        return f"the library that reads it crashes on it ({signal.Signals(number).name})"
    return "it asks for more memory than it can stand for" if os.WEXITSTATUS(status) == _OUT_OF_MEMORY else None


def _try(function: Callable[..., Any], arguments: tuple[Any, ...], seconds: int, memory: int) -> None:
    """Call the function and end this process without a word."""
    status = 0
    try:
        for name in _DEADLY:  # those who have set handlers, MPI too, are to hear nothing of it
            signal.signal(getattr(signal, name), signal.SIG_DFL)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        signal.alarm(seconds)
        _limit(memory)
        function(*arguments)
    except MemoryError:
        status = _OUT_OF_MEMORY
    except BaseException:  # the caller meets it again
        pass
    finally:
        os._exit(status)


def _limit(memory: int) -> None:
    with suppress(ImportError, OSError, ValueError):
        import resource

        with open("/proc/self/statm") as file:
            mapped = int(file.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (mapped + memory, resource.getrlimit(resource.RLIMIT_AS)[1]))
