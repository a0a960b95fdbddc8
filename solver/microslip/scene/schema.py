"""The keys of a scene file: one frozen model per table, collected in :class:`Scene`.

The description of a key states its expected value with unit; messages quote it (messages.py).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, PrivateAttr, model_validator

from ..tables.structure_tables import StructureTables
from ..tables.vibration import Damping, Load, Output
from .solution import DEFAULT_ACCURACY, Continuation, Response, Solver
from .wear import Wear

# endings of model files that may contain more than a mesh
WHOLE_MODELS = (".inp", ".cdb", ".rst", ".bdf", ".nas", ".fem", ".op2", ".dat", ".e", ".exo", ".ex2", ".unv")


class Scene(StructureTables):
    """A scene file, checked; attributes are its keys."""

    loads: tuple[Load, ...] = Field(min_length=1, description="at least one table headed [[loads]], with position and direction")
    outputs: tuple[Output, ...] = Field(
        min_length=1, description="at least one table headed [[outputs]], with name, position and direction"
    )
    damping: Damping | None = Field(None, description="a table [damping] with ratio, or with rayleigh = [alpha, beta]")
    response: Response = Field(description="a table [response] with levels and frequencies")
    solver: Solver = Field(Solver(), description="a table [solver]")
    continuation: Continuation | None = Field(None, description="a table [continuation]")
    wear: Wear | None = Field(None, description="a table [wear] with coefficient and cycles")

    _text: str = PrivateAttr(default="")
    _is_complete: bool = PrivateAttr(default=False)
    _settings: tuple[str, ...] = PrivateAttr(default=())

    def model_post_init(self, context: Any, /) -> None:
        """Take path, text, settings, and whether the model file has been read, from the context of the validation."""
        super().model_post_init(context)
        if context:
            self._path, self._text, self._is_complete = context["path"], context["text"], context["is_complete"]
            self._settings = context["settings"]

    def chooses(self, key: str) -> bool:
        """Return whether the program chooses harmonics, samples or tolerance at each point, by the requested accuracy."""
        return self.accuracy is not None and key not in self.solver.model_fields_set

    @property
    def accuracy(self) -> float | None:
        """The accuracy of the response: stated or default; None with stated harmonics or without error bars."""
        solver = self.solver
        if solver.accuracy is not None or not solver.error_bars or "harmonics" in solver.model_fields_set:
            return solver.accuracy
        return DEFAULT_ACCURACY

    @property
    def is_complete(self) -> bool:
        """Whether all data of the model file have been taken over."""
        return self._is_complete

    @property
    def awaits_file(self) -> bool:
        """Whether the model file may still add materials, bodies, supports and points to the scene."""
        file = self.model.mesh
        return not self.is_complete and file is not None and Path(file).suffix.lower() in WHOLE_MODELS

    @property
    def harmonics(self) -> int:
        """The highest harmonic: stated, or if the program chooses, sufficient for the loads."""
        return self.chosen_harmonics[-1]

    @property
    def chosen_harmonics(self) -> tuple[int, ...]:
        """The harmonics of the solution: stated, or if the program chooses, sufficient for the loads."""
        stated = self.solver.chosen
        loaded = max((load.harmonic for load in self.loads), default=0) if self.chooses("harmonics") else 0
        return tuple(range(loaded + 1)) if loaded > stated[-1] else stated

    @property
    def leaves_harmonics_out(self) -> bool:
        """Whether a stated list of harmonics omits some between 0 and its highest."""
        return len(self.chosen_harmonics) <= self.harmonics

    @property
    def is_static(self) -> bool:
        """Whether the solution has only harmonic 0: nothing vibrates."""
        return self.harmonics == 0

    @property
    def folder(self) -> Path:
        """The folder that the scene's paths are relative to."""
        return self._path.parent

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self._path.stem

    @property
    def text(self) -> str:
        """The text of the file, or of an equivalent file with the keys set by the command line."""
        return self._text

    @property
    def settings(self) -> tuple[str, ...]:
        """The settings of the command line, as KEY=VALUE."""
        return self._settings

    @property
    def source(self) -> str:
        """The scene file and the settings of the command line, for logs."""
        return " ".join([str(self._path), *(f"--set {setting}" for setting in self.settings)])


class SceneOfModes(Scene):
    """A scene whose modes alone are computed: loads, outputs, [response] and the wave of [cyclic] may be missing."""

    loads: tuple[Load, ...] = Field((), description=Scene.model_fields["loads"].description)
    outputs: tuple[Output, ...] = Field((), description=Scene.model_fields["outputs"].description)
    response: Response = Field(Response(levels=(1.0,), mode=1, span=(0.9, 1.1)), description="a table [response]")

    @model_validator(mode="before")
    @classmethod
    def _with_some_wave(cls, tables: Any) -> Any:
        """Return the tables with an engine order where [cyclic] states no wave: each nodal diameter has modes of its own."""
        cyclic = tables.get("cyclic") if isinstance(tables, Mapping) else None
        if not isinstance(cyclic, Mapping) or "engine_order" in cyclic or "nodal_diameter" in cyclic:
            return tables
        return {**tables, "cyclic": {**cyclic, "engine_order": 1}}
