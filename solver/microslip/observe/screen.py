"""The screen of a run: on a terminal a bar per active level, otherwise plain lines.  Rank 0 only; no communication."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from ..messages.words import counted
from ..system.signals import unsignalled

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress


class Screen:
    """Lines, and one moving display.  ``interactive`` None: whether standard error is a terminal.

    Under mpirun standard output appears as a terminal even if redirected; standard error does not.
    Lines of a batch job go to standard output, complete and flushed.
    """

    def __init__(self, interactive: bool | None = None, *, silent: bool = False):
        self._silent = silent
        self._moving: Any = None  # the bar or spinner shown now
        self._bars: dict[str, tuple[Any, float, float]] = {}  # by name: task of the progress display, start, stop
        self._console = None if silent else _console(interactive)

    @property
    def interactive(self) -> bool:
        """Whether the screen is a terminal."""
        return self._console is not None

    def line(self, text: str) -> None:
        """Show a finished line above the moving display."""
        if self._console is not None:
            self._console.print(text, markup=False, highlight=False, emoji=False, soft_wrap=True)
        elif not self._silent:
            print(text, flush=True)

    def begin(self, name: str) -> None:
        """Show that a stage has begun; plain screens show only its result."""
        if self._console is not None:
            self.clear()
            self._moving = self._console.status(name.strip())
            with unsignalled():
                self._moving.start()

    def bar(self, name: str, start: float, stop: float) -> None:
        """Show a bar from one frequency to another [Hz], below the other bars."""
        if self._console is None:
            return
        if not self._bars:
            self.clear()
            self._moving = self._progress()
            with unsignalled():
                self._moving.start()
        self._bars[name] = self._moving.add_task(name, total=1.0, at=""), start, stop

    def _progress(self) -> Progress:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        return Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=20),
            TextColumn("{task.fields[at]}", markup=False),
            TimeElapsedColumn(),
            console=self._console,
            transient=True,
        )

    def end_bar(self, name: str) -> None:
        """Remove a bar, and with the last one the display."""
        if name in self._bars:
            self._moving.remove_task(self._bars.pop(name)[0])
        if not self._bars:
            self.clear()

    def advance(self, name: str, frequency: float, amplitude: float, n_moving: int, n_points: int, unit: str = "m") -> None:
        """Move a bar to a converged point."""
        if name not in self._bars:
            return
        task, start, stop = self._bars[name]
        share = (frequency - start) / (stop - start) if stop != start else 1.0
        self._moving.update(
            task,
            completed=min(max(share, 0.0), 1.0),
            at=f"{frequency:.5g} Hz  {amplitude:.3e} {unit}  {n_moving} slip  {counted(n_points, 'point')}",
        )

    def clear(self) -> None:
        """Remove the moving display."""
        if self._moving is not None:
            self._moving.stop()
            self._moving = None
            self._bars.clear()


def _console(interactive: bool | None) -> Console | None:
    """Return a console on standard error for a terminal, otherwise None."""
    if not (sys.stderr.isatty() if interactive is None else interactive):
        return None
    try:
        from rich.console import Console
    except ImportError:  # without rich: plain lines
        return None
    return Console(stderr=True, force_terminal=True)
