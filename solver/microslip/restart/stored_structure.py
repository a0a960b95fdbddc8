"""A stuck structure in the folder of a run or in the cache.

    model        everything except data as large as the mesh (structure_arrays.py); names the file of its modes
    modes-NAME   all computed modes, in the order of the user's nodes, for fields on the mesh
    columns      static columns (columns_file.py)

The modes are written first: a folder without a model has no structure.
"""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ..assembly.real_form import complex_columns, real_columns
from ..library.build import Structure, rebuilt
from ..linear.factor import FactorCache
from ..linear.joint_springs import Linearised
from ..messages.errors import CaseError
from ..modes.eigen import Modes, lowest_modes
from ..modes.user_order import from_user_order
from ..observe.log import RunLog
from ..parallel.agree import on_root
from ..receptance.modes import ProjectedModes
from ..reduction.enriched_model import COUPLED, SAMPLED
from ..reduction.reduction import Basis
from ..reduction.stuck import Factored, ModesOf, OnDemand, project_modes
from ..scene.schema import Scene
from ..system.files import make_folder
from .columns_file import ColumnsFile
from .records import Arrays, Disk, read_record, write_record
from .structure_arrays import structure_of, to_arrays

_SAME = 1e-6  # relative difference of frequencies up to which modes computed again are the same
_SAME_SHAPE = 1e-5  # the same of their motions at pairs, outputs and loads, over the largest
Large = Callable[[ModesOf], Factored]  # computes the large parts of a structure whose modes are read; collective


class StoredStructure:
    """The files of a structure in a folder; ``factor`` is its factor in the cache.

    Raises
    ------
    CaseError, ResourceError : files cannot be written; on every rank
    """

    def __init__(self, comm: MPI.Comm, path: Path, factor: FactorCache | None = None, disk: Disk | None = None):
        self.comm, self.path, self.factor = comm, path, factor
        self.model = path / "model"
        self.columns = ColumnsFile(comm, path / "columns", disk)

    def read(self) -> tuple[Arrays, dict[str, Any]] | None:
        """Return the arrays and texts of the model; None if it is missing or damaged.  Rank 0."""
        return read_record(self.model)

    def structure(
        self,
        stored: tuple[Arrays, dict[str, Any]],
        scene: Scene,
        log: RunLog,
        large: Large | None = None,
        copies: Path | None = None,
    ) -> Structure:
        """Return the structure of arrays and texts, the same on every rank.  Local.

        Its large parts are computed when first needed, by ``large`` from a function that reads the modes, or from the scene.
        ``copies`` is a folder that may have the file of the modes, too.
        """
        arrays, texts = stored

        def assemble() -> Factored:
            places = [folder / texts["modes"] for folder in (copies, self.path) if folder is not None]
            modes_of = partial(self._modes, places, structure.projected, structure.n_proved)
            return rebuilt(scene, self.comm, log, self.factor, modes_of) if large is None else large(modes_of)

        structure = structure_of(arrays, texts, scene, self.comm, OnDemand(assemble))
        return structure

    def _modes(self, places: Sequence[Path], stored: ProjectedModes, n_proved: int, linearised: Linearised) -> Modes:
        """Return the modes of the first file that has them, or compute them again if all are missing or damaged.  Collective.

        Raises
        ------
        CaseError : they are missing or damaged, and those computed again are not of these ``stored`` projections; on every rank
        """
        omega_n = stored.omega_n
        record = on_root(self.comm, _first_modes, places, share=False)
        if not self.comm.bcast(record is not None):
            modes = lowest_modes(linearised, len(omega_n))
            same = np.allclose(modes.omega_n, omega_n, rtol=_SAME)
            if not same or (phi_owned := _combined(modes, stored, linearised)) is None:
                raise CaseError(f"{places[-1]}: missing or damaged; --fresh computes the modes again")
            return replace(modes, phi_owned=phi_owned)
        proof = {"complete": False, "proved": n_proved}
        if not linearised.maps.is_complex:
            return Modes(omega_n, from_user_order(linearised, record), proof)
        parts = None if record is None else real_columns(record)
        return Modes(omega_n, complex_columns(from_user_order(linearised, parts)), proof)

    def write(self, structure: Structure, basis: Basis | None, modes: Path | None, more: dict[str, Any]) -> None:
        """Write a structure, with ``more`` texts; ``modes`` is the file of its modes, None: they are written.  Collective."""
        phi = None
        if modes is None:
            phi = structure.in_user_order(structure.using(structure.n_computed).modes.phi_owned)
        on_root(self.comm, self._write, structure, basis, phi, modes, more, share=False)

    def _write(
        self, structure: Structure, basis: Basis | None, phi: np.ndarray | None, modes: Path | None, more: dict[str, Any]
    ) -> None:
        """Write the modes, then the model that names them.  Rank 0."""
        make_folder(str(self.path))
        name = f"modes-{uuid.uuid4().hex[:12]}" if modes is None else modes.name
        if modes is not None:
            with suppress(OSError):  # modes removed meanwhile are computed again when needed
                link_or_copy(modes, self.path / name)
        elif phi is not None:
            write_record(self.path / name, {"phi": phi})
        arrays, texts = to_arrays(structure, basis)
        write_record(self.model, arrays, {**texts, "modes": name, "extent": extent_of(structure), **more})
        self._remove_other_modes(name)

    def copy_from(self, other: StoredStructure) -> None:
        """Link or copy the model and the modes of another folder.  Rank 0."""
        stored = other.read()
        if stored is None:
            return
        make_folder(str(self.path))
        name = stored[1]["modes"]
        link_or_copy(other.path / name, self.path / name)
        link_or_copy(other.model, self.model)
        self._remove_other_modes(name)

    def _remove_other_modes(self, name: str) -> None:
        for other in self.path.glob("modes-*"):
            if other.name != name:
                other.unlink(missing_ok=True)


def extent_of(structure: Structure) -> list[int]:
    """Return the extent of a structure: counts of modes computed and proved, whether it has samples and coupling.  Local."""
    has_results = (int((name, structure.projected) in structure.results) for name in (SAMPLED, COUPLED))
    return [structure.n_computed, structure.n_proved, *has_results]


def read_modes(path: Path) -> np.ndarray | None:
    """Return modes from their file, None if it is missing or damaged.  Rank 0."""
    with suppress(OSError):
        record = read_record(path)
        return None if record is None else record[0]["phi"]
    return None


def _combined(modes: Modes, stored: ProjectedModes, linearised: Linearised) -> np.ndarray | None:
    """Return the modes with the phases, and of multiple modes the combination, of their stored projections; None without.

    Collective: one sum.
    """
    again = project_modes(linearised.maps, modes.omega_n, modes.phi_owned)
    wanted, present = (np.vstack([each.R_phi, each.o, each.b.conj().T]) for each in (stored, again))
    Q, omega_n = np.zeros((len(stored.omega_n),) * 2, dtype=present.dtype), stored.omega_n
    for multiple in np.split(np.arange(len(omega_n)), np.flatnonzero(np.diff(omega_n) > _SAME * omega_n[1:]) + 1):
        u, _, v = np.linalg.svd(present[:, multiple].conj().T @ wanted[:, multiple])
        Q[np.ix_(multiple, multiple)] = u @ v
    is_close = np.allclose(present @ Q, wanted, rtol=0.0, atol=_SAME_SHAPE * np.abs(wanted).max(initial=0.0))
    return modes.phi_owned @ Q if is_close else None


def _first_modes(places: Sequence[Path]) -> np.ndarray | None:
    """Return the modes of the first of some files that has them.  Rank 0."""
    return next((modes for modes in map(read_modes, places) if modes is not None), None)


def link_or_copy(source: Path, target: Path) -> None:
    """Replace ``target`` by a hard link to ``source``, or by a copy if the file system has no links.  Rank 0."""
    temporary = target.with_name(f"{target.name}-{uuid.uuid4().hex[:12]}.part")
    try:
        try:
            os.link(source, temporary)
        except OSError:
            shutil.copyfile(source, temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
