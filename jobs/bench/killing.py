"""A run in its own session: its output with times, its writes, and its end by SIGKILL of all its processes at once."""

from __future__ import annotations

import atexit
import ctypes
import os
import select
import signal
import struct
import subprocess
import time
from contextlib import suppress
from pathlib import Path

_CREATE, _MODIFY, _CLOSED, _MOVED_TO, _IS_FOLDER = 0x100, 0x2, 0x8, 0x80, 0x40000000  # of <sys/inotify.h>
_EVENT = struct.Struct("iIII")
_libc = ctypes.CDLL(None, use_errno=True)


class Writes:
    """Counts what is created, written and renamed in a folder and all folders below it (Linux inotify)."""

    def __init__(self, folder: Path):
        self._handle = _libc.inotify_init1(os.O_NONBLOCK)
        if self._handle < 0:
            raise OSError(ctypes.get_errno(), "inotify is not available")
        self._folders: dict[int, Path] = {}
        self._add(folder)

    def _add(self, folder: Path) -> None:
        """Watch a folder and the subfolders that already exist in it."""
        watch = _libc.inotify_add_watch(self._handle, os.fsencode(folder), _CREATE | _MODIFY | _CLOSED | _MOVED_TO)
        if watch < 0:
            return  # already removed
        self._folders[watch] = folder
        with suppress(OSError):
            for entry in folder.iterdir():
                if entry.is_dir():
                    self._add(entry)

    def wait(self, seconds: float) -> int:
        """Return the number of writes since the last call; wait a while for the first one."""
        if not select.select([self._handle], [], [], seconds)[0]:
            return 0
        data, at, n_files = os.read(self._handle, 1 << 16), 0, 0
        while at < len(data):
            watch, mask, _, length = _EVENT.unpack_from(data, at)
            name = os.fsdecode(data[at + _EVENT.size : at + _EVENT.size + length].rstrip(b"\0"))
            at += _EVENT.size + length
            if mask & _CREATE and mask & _IS_FOLDER:
                self._add(self._folders[watch] / name)
            n_files += not name.endswith((".log", ".lock"))
        return n_files

    def close(self) -> None:
        os.close(self._handle)


class Run:
    """The running program in its own session; its output goes to a file."""

    def __init__(self, command: list[str], output: Path):
        self._output = output
        with open(output, "wb") as file:
            self.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=file, stderr=file, start_new_session=True, preexec_fn=_answer_signals
            )
        self._began = time.monotonic()
        atexit.register(self.kill)

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._began

    @property
    def is_over(self) -> bool:
        return self.process.poll() is not None

    def output(self) -> str:
        return self._output.read_text(errors="replace")

    def wait(self, limit: float) -> int | None:
        """Return the status when it ends, None if it had to be killed after a while."""
        try:
            return self.process.wait(limit)
        except subprocess.TimeoutExpired:
            self.kill()
            return None

    def kill(self) -> None:
        """Kill all processes of the session, launcher and ranks, which have their own process groups."""
        while living := members(self.process.pid):
            for member in living:
                with suppress(ProcessLookupError):
                    os.kill(member, signal.SIGKILL)
            self.process.poll()
            time.sleep(0.001)
        self.process.wait()
        atexit.unregister(self.kill)


def _answer_signals() -> None:
    """Restore signals that nohup or a shell's background job ignores; the program would leave them ignored."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def members(session: int) -> list[int]:
    """Return the living processes of a session.  Local."""
    processes = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            with suppress(OSError, ValueError, IndexError):
                state, _, _, own = Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()[:4]
                if int(own) == session and state not in "ZX":
                    processes.append(int(entry))
    return processes
