"""The start of a process, before its libraries are imported, which may take a minute on a cluster.  Local.

This module imports next to nothing, so that signals are answered from the first line on.
"""

import io
import os
import resource
import signal
import sys

_STOPPED = 5  # exit status of Interrupted
ADDRESS_SPACE_OF_ONE, ADDRESS_SPACE_OF_SEVERAL = 700_000_000, 1_000_000_000  # bytes, which MPI, PETSc and their libraries map
_put_off: list[int] = []  # the last signal that stops, of a rank that is not the first
_LAUNCHERS = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID")


def launcher_rank() -> int:
    """Return this process's rank from the variables of its launcher, before or without MPI.  Local."""
    ranks = [os.environ[name] for name in _LAUNCHERS if os.environ.get(name, "").isdigit()]
    return int(ranks[0]) if ranks else 0


def too_little_address_space() -> str | None:
    """Return the message for an address space too small for the libraries; an empty text if it suffices.  Local."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    needed = ADDRESS_SPACE_OF_ONE if _n_ranks() == 1 else ADDRESS_SPACE_OF_SEVERAL
    if limit == resource.RLIM_INFINITY or limit >= needed:
        return None
    return (
        f"the address space of a process is limited to {limit / 1e6:.0f} MB (ulimit -v), and the libraries of the program take "
        f"{needed / 1e6:.0f} MB before there is a model; ulimit -v {2 * needed // 1000} leaves room for a small one, ulimit -v "
        "unlimited for any"
    )


def _n_ranks() -> int:
    """Return the number of ranks from the variables of the launcher.  Local."""
    sizes = [
        os.environ[name] for name in ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_NTASKS") if os.environ.get(name, "").isdigit()
    ]
    return int(sizes[0]) if sizes else 1


def open_streams() -> None:
    """Open /dev/null in the place of standard streams that the caller closed, and let any name be printed.  Local.

    Without that MPI's sockets would take the numbers of the closed ones, and be written to.  A letter that the stream's
    encoding lacks is written as an escape.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number, which is this one
    sys.stdout = sys.stdout or open(1, "w", closefd=False)
    sys.stderr = sys.stderr or open(2, "w", closefd=False)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def stop_at_once() -> None:
    """Let stopping signals end the process immediately, without saving, and ignore the signal to save.  Local.

    Until signals.py answers them.  One that the caller ignores stays ignored.  A rank that is not the first puts off a signal
    that stops: the first, which writes the message, may not have started.
    """
    answers = {signal.SIGTERM: _end, signal.SIGINT: _end, signal.SIGHUP: _end, signal.SIGUSR1: _pass}
    for number, answer in answers.items():
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, answer)


def early_signal() -> int | None:
    """Return the signal that stop_at_once() has put off, once, or None.  Local."""
    return _put_off.pop() if _put_off else None


def _end(number: int, frame: object) -> None:
    if launcher_rank() > 0:  # its launcher would end rank 0, which may not have reached its first line, without a message
        _put_off[:] = [number]
        return
    if sys.stderr is not None:
        sys.stderr.write(f"microslip: error: stopped by {signal.Signals(number).name} before it had begun\n")
        sys.stderr.flush()
    os._exit(_STOPPED)


def _pass(number: int, frame: object) -> None:
    pass
