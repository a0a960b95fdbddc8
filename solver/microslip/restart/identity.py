"""The inputs of a run (scene, files, program) and the keys of its parts: hashes of the inputs of each part."""

from __future__ import annotations

import hashlib
import json
import mmap
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..contact.laws import ELASTIC_COULOMB, LAWS
from ..library.origin_of_run import fingerprint, input_files
from ..scene.inputs import SECTOR_TABLE
from ..scene.schema import Scene
from ..system.versions import program_hash, versions
from ..version import __version__

Tables = dict[str, Any]
_OF_RESPONSE = ("samples", "tolerance")  # keys of [solver] that the set-up does not depend on
_NOT_OF_STRUCTURE = ("title", "continuation", "response", "solver", "damping", "wear")
_OF_SECTORS = ("scatter", "sector", "table")  # of [cyclic]: how sectors differ
_RANGE = ("frequencies", "mode", "span")  # of [response]
_AT_REST = "loads at rest"  # key in ``files``: the model file may have the loads of [statics]
_PERTURBED, _LOADED = re.compile(rb"(?i)perturbation"), re.compile(rb"(?i)\*\s*(c|d|d\s*s)\s*load")


@dataclass(frozen=True)
class Identity:
    """A scene as stated, and all other inputs that determine its results."""

    scene: Tables  # as JSON, without defaults
    files: dict[str, str]  # hashes of the input files, by their names in the scene
    program: dict[str, str]  # versions, and a hash of the program's own files
    options: tuple[str, ...]  # PETSc options

    def as_texts(self) -> Tables:
        """Return the identity as JSON can represent it."""
        return {"scene": self.scene, "files": self.files, "program": self.program, "options": list(self.options)}

    @classmethod
    def from_texts(cls, texts: Tables) -> Identity:
        """Return the identity of the texts by ``as_texts``."""
        return cls(texts["scene"], texts["files"], texts["program"], tuple(texts["options"]))

    # -- the data that parts of the work depend on --------------------------------------------------------------------------

    @property
    def whole(self) -> str:
        """The key of the whole run."""
        return self._key(self.scene)

    @property
    def setup(self) -> str:
        """The key of the set-up: all inputs except the inputs of only the response.

        It includes the range even with stated modes, because a note of the set-up reports whether they cover the range.  That
        of a disc whose sectors may differ is the disc of identical sectors.
        """
        scene, response, files = dict(self.scene), dict(self.scene["response"]), self.files
        if (cyclic := scene.get("cyclic", {})).get("whole"):
            scene["cyclic"] = {key: value for key, value in cyclic.items() if key not in _OF_SECTORS}
            files = {name: content for name, content in files.items() if not name.startswith(SECTOR_TABLE)}
        solver = {key: value for key, value in scene.pop("solver", {}).items() if key not in _OF_RESPONSE}
        for name in ("title", "continuation", "wear"):
            scene.pop(name, None)
        chosen_by = {key: response[key] for key in _RANGE if key in response}
        if "modes" not in solver:
            chosen_by["level"] = max(response["levels"])
        return self._key({**scene, "solver": solver, "response": chosen_by}, files)

    @property
    def structure(self) -> str:
        """The key of the stuck structure, its modes and static response.

        It omits inputs of only the response or the choice of modes, and friction and preload if neither a spring nor the state of
        rest depends on them.
        """
        scene = {key: value for key, value in self.scene.items() if key not in _NOT_OF_STRUCTURE}
        if "mesh" in self.scene["model"] and not self.scene.get("statics") and _AT_REST not in self.files:
            scene["joints"] = [_without_limits(joint) for joint in self.scene.get("joints", [])]
        return self._key(scene)

    def level(self, level: float, n_modes: int) -> str:
        """Return the key of a level [N]: everything except the other levels, and the number of modes instead of their choice."""
        scene, response = self._without("levels", "fields", "over")
        return self._key({**scene, "response": response, "level": float(level).hex(), "n_modes": n_modes})

    def over(self, number: int, peak: int, level: float, n_modes: int) -> str:
        """Return the key of a curve of peaks over a number: everything except the levels and the other numbers.

        ``number`` counts the tables [[response.over]], ``peak`` the peaks of the linear response; ``level`` [N] is the one at
        which another number varies.
        """
        scene, response = self._without("levels", "fields")
        table = response.pop("over")[number]
        return self._key({**scene, "response": response, "over": table, "peak": peak, "level": level.hex(), "n_modes": n_modes})

    def mode(self, number: int, farthest: float | None, n_modes: int) -> str:
        """Return the key of a nonlinear mode up to an amplitude: everything except levels, peaks over numbers and fields."""
        scene, response = self._without("levels", "fields", "over")
        return self._key({**scene, "response": response, "mode": [number, farthest], "n_modes": n_modes})

    def branch(self, level: float, n_modes: int) -> str:
        """Return the key of a level [N], independent of the range."""
        scene, response = self._without("levels", "at", "fields", "over", *_RANGE)
        return self._key({**scene, "response": response, "level": float(level).hex(), "n_modes": n_modes})

    def _without(self, *keys: str) -> tuple[Tables, Tables]:
        """Return the tables without title and wear, and the table [response] without some of its keys."""
        scene = {name: table for name, table in self.scene.items() if name not in ("title", "wear")}
        return scene, {key: value for key, value in self.scene["response"].items() if key not in keys}

    def _key(self, scene: Tables, files: Mapping[str, str] | None = None) -> str:
        whole = [scene, self.files if files is None else files, self.program, self.options]
        return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:24]

    def differences(self, other: Identity) -> list[str]:
        """Return a line for each difference to an earlier identity, "key: was -> is"."""
        lines = [f"{key}: {was} -> {now}" for key, was, now in _changes("", other.scene, self.scene)]
        for name in sorted(self.files.keys() | other.files.keys()):
            if self.files.get(name) != other.files.get(name):
                lines.append(f"{name}: {_happened(name, other.files, self.files)}")
        lines += [f"{key}: {was} -> {now}" for key, was, now in _changes("", other.program, self.program)]
        if self.options != other.options:
            lines.append(f"PETSc options: {' '.join(other.options) or 'none'} -> {' '.join(self.options) or 'none'}")
        return lines


def identity_of(scene: Scene, options: Iterable[str] = ()) -> Identity:
    """Return the identity of a run.  Local, on rank 0: reads all input files once.  Raises CaseError: a file cannot be read."""
    files: dict[str, str] = {}
    inputs = input_files(scene)
    if _may_be_loaded(scene, [path for _, path in inputs]):
        files[_AT_REST] = "maybe"
    for file in fingerprint(inputs):
        name = f"{file.key} {Path(file.path).name}"
        files[name] = files.get(name, "") + file.sha256  # files of one name in several folders
    program = {"microslip": f"{__version__} ({program_hash()})", **versions()}
    return Identity(scene.model_dump(mode="json", exclude_unset=True), files, program, tuple(options))


def _may_be_loaded(scene: Scene, files: list[Path]) -> bool:
    """Return whether an input file of Abaqus or CalculiX may have loads at rest: it has keywords of a static step and loads."""
    if Path(scene.model.mesh or "").suffix.lower() != ".inp":
        return False
    return all(any(_has(path, word) for path in files) for word in (_PERTURBED, _LOADED))


def _has(path: Path, word: re.Pattern[bytes]) -> bool:
    if not path.is_file() or not path.stat().st_size:
        return False
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        return word.search(text) is not None


def _without_limits(joint: Tables) -> Tables:
    """Return a joint without the keys that the stuck structure does not depend on."""
    limits = LAWS[joint.get("law", ELASTIC_COULOMB)].limits
    return {key: value for key, value in joint.items() if key not in limits}


def _changes(path: str, was: Any, now: Any) -> list[tuple[str, str, str]]:
    """Return the differences of two JSON values: keys with both values, abbreviated."""
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        names = [*was, *(name for name in now if name not in was)]
        return [change for name in names for change in _changes(f"{path} {name}".strip(), was.get(name), now.get(name))]
    if _is_list_of_tables(was) and _is_list_of_tables(now) and len(was) == len(now):
        return [change for i, (a, b) in enumerate(zip(was, now), 1) for change in _changes(f"{path} {i}", a, b)]
    return [] if was == now else [(path, _short(was), _short(now))]


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 0 and isinstance(value[0], Mapping)


def _short(value: Any) -> str:
    text = "not stated" if value is None else json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _happened(name: str, was: Mapping[str, str], now: Mapping[str, str]) -> str:
    return "is new" if name not in was else "is no longer read" if name not in now else "the file has changed"
