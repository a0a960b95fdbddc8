"""Processes beside a run that draw a share of its pictures, where the machine has cores that no rank uses.

They start with the run, load matplotlib and wait; told of a result file they draw while the run writes its fields and draws its
own share.  They know nothing of MPI, hold no file of the run open, and end with it: their input comes from it alone.  What one of
them does not come to draw, for whatever reason, the run draws itself.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..messages import errors

if TYPE_CHECKING:
    from mpi4py import MPI

VARIABLE = "MICROSLIP_DRAWERS"  # of the environment: how many of them a rank may have
MOST = 3  # a rank: the pictures are no more than eight
_OF_LAUNCHERS = (
    "OMPI_",
    "PMI",
    "PRTE_",
    "HYDRA_",
    "MPI",
    "MV2_",
    "I_MPI_",
    "SLURM_",
    "PALS_",
)  # a rank of a job, which they are not
_PATIENCE = 60.0  # s for a picture or two


class Drawers:
    """The processes of one rank.  Collective on ``comm`` where it is made; as many on every rank."""

    def __init__(self, comm: MPI.Comm, most: int = MOST):
        n = min(comm.allgather(min(most, spare(comm)))) if most else 0
        self._step = comm.size * (n + 1)
        self._last = self._step - 1 - comm.rank * (n + 1)  # of the rank's shares; rank 0 comes last, which has files to write
        self._processes = [process for _ in range(n) if (process := Drawer.started()) is not None]
        self._unstarted = n - len(self._processes)

    @property
    def own(self) -> slice:
        """The pictures that the rank draws itself."""
        return slice(self._last, None, self._step)

    def begin(self, results: Path, folder: Path) -> None:
        """Let the processes begin with their shares of the pictures of a result file.  Local."""
        for process, share in zip(self._processes, self._shares()):
            order = {"results": str(results), "folder": str(folder), "share": [share.start, share.step]}
            process.tell(order)

    def left(self) -> list[slice]:
        """Wait for the processes; return the shares that none of them has drawn.  Local.

        Raises
        ------
        MicroslipError : what a process met while it drew
        """
        left = self._shares()[len(self._processes) :]
        for process, share in zip(self._processes, self._shares()):
            answer = process.answer()
            if answer is None:
                left.append(share)
            elif answer["problem"] is not None:
                kind, text = answer["problem"]
                raise getattr(errors, kind)(text)
        self._processes.clear()
        return left

    def _shares(self) -> list[slice]:
        n = len(self._processes) + self._unstarted
        return [slice(self._last - 1 - i, None, self._step) for i in range(n)]

    def close(self) -> None:
        """End those that are left.  Local."""
        for process in self._processes:
            process.end()
        self._processes.clear()

    def __enter__(self) -> Drawers:
        return self

    def __exit__(self, *_) -> None:
        self.close()


def spare(comm: MPI.Comm) -> int:
    """Return how many cores this rank may use beside its own, no more than the environment says.  Collective."""
    here = socket.gethostname()
    n_ranks = comm.allgather(here).count(here)
    cores = len(os.sched_getaffinity(0))  # those of this rank alone, where the launcher binds it
    said = os.environ.get(VARIABLE, "")
    return min(max(cores // n_ranks - 1, 0), int(said) if said.isdigit() else MOST)


@dataclass(frozen=True, eq=False)
class Drawer:
    """A process that waits for an order.  Local."""

    process: subprocess.Popen
    line: socket.socket  # to it; a pipe would answer with a signal where the process has ended

    @classmethod
    def started(cls) -> Drawer | None:
        """Return one; None if it cannot be started."""
        environment = {key: value for key, value in os.environ.items() if not key.startswith(_OF_LAUNCHERS)}
        package = str(Path(__file__).parents[2])
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, (package, environment.get("PYTHONPATH"))))
        command = [sys.executable, "-P", "-m", "microslip.results.beside"]
        line, end = socket.socketpair()
        try:
            process = subprocess.Popen(
                command,
                stdin=end.fileno(),
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=environment,
                text=True,
                start_new_session=True,  # signals to the run are for the run
            )
        except OSError:
            line.close()
            return None
        finally:
            end.close()
        return cls(process, line)

    def tell(self, order: dict) -> None:
        """Send it an order; one that has ended says nothing of it."""
        with suppress(OSError):
            self.line.sendall(json.dumps(order).encode() + b"\n", socket.MSG_NOSIGNAL)

    def answer(self) -> dict | None:
        """Return what it says in the end; None if it ended without a word, or takes too long."""
        try:
            return json.loads(self.process.communicate(timeout=_PATIENCE)[0])
        except (OSError, ValueError, subprocess.TimeoutExpired):
            return None
        finally:
            self.end()

    def end(self) -> None:
        """End it, if it has not ended."""
        self.line.close()
        self.process.kill()
        with suppress(ValueError):  # what it says was read
            self.process.communicate()


def main() -> None:
    """Wait for an order, draw, and say how that went."""
    from .plots import draw_all  # while the run is at its work

    line = sys.stdin.readline()
    if not line:
        return
    order, problem = json.loads(line), None
    try:
        draw_all(order["results"], order["folder"], slice(order["share"][0], None, order["share"][1]))
    except errors.MicroslipError as found:
        problem = [type(found).__name__, str(found)]
    print(json.dumps({"problem": problem}))


if __name__ == "__main__":
    main()
