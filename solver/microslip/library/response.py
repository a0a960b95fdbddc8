"""A response in memory: curves, states, forces and fields as arrays with named axes and units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..fourier.amplitudes import to_complex, to_real
from ..fourier.coefficients import amplitude, phase
from ..messages.errors import CaseError
from ..messages.words import counted
from ..observe.observer import Observers
from ..parallel.agree import on_each, on_root
from ..points.branch import QUANTITIES, Branch
from ..points.error_parts import total
from ..points.peak import Peak
from ..points.quantities import LABELS, TEXT, Quantity
from ..receptance.motions import ActingForces
from ..reduction.expand import motions_at_nodes
from ..results.measures import AMPLITUDE, Shown
from ..results.record import COMPLETE, STOPPED, LevelResult, ResultFile, level_result
from ..results.sensitivities import SensitivityTable, write_sensitivities
from .prepare import Prepared
from .result_files import head_of, shapes_of, write_shapes, writer_of
from .sensitivities import varied_numbers

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

_QUANTITY = {quantity.name: quantity for quantity in QUANTITIES if quantity.kind != TEXT}


@dataclass(frozen=True, eq=False)
class Curves:
    """The curves of one output: one row per level, points in the order of the branch, padded with nan."""

    name: str
    level: np.ndarray  # (n_levels,) N
    frequency: np.ndarray  # (n_levels, n) Hz
    coefficients: np.ndarray  # (n_levels, n, N_H) m: mean, cos 1, sin 1, ..., cos H, sin H
    error: np.ndarray | None  # (n_levels, n) m, the error bar of the amplitude; None where it was not estimated
    shown: Shown = AMPLITUDE  # the quantity shown where there is room for one number: in statics the mean
    unit: str = "m"  # of the output, in place of m where it is another; the levels' is that of the loads
    corrected: np.ndarray | None = None  # (n_levels, n) complex, m: harmonic 1, corrected by the error estimate
    error_corrected: np.ndarray | None = None  # (n_levels, n) m, the error bar of that
    results: ResultFile | None = None  # of this output alone

    @property
    def amplitude(self) -> np.ndarray:
        """Of harmonic 1, (n_levels, n) [m]."""
        return amplitude(self.coefficients)

    @property
    def phase(self) -> np.ndarray:
        """Of harmonic 1, u = amplitude cos(omega t + phase), (n_levels, n) [rad]."""
        return phase(self.coefficients)

    @property
    def mean(self) -> np.ndarray:
        """The constant part, (n_levels, n) [m]."""
        return self.coefficients[..., 0]

    def harmonic(self, n: int) -> np.ndarray:
        """Return the complex amplitude of harmonic n, cos - i sin, (n_levels, n) [m]."""
        return self.mean + 0j if n == 0 else self.coefficients[..., 2 * n - 1] - 1j * self.coefficients[..., 2 * n]

    def plot(self, path: str | Path | None = None) -> Figure:
        """Draw the curves and return the figure, which a notebook shows; with a path also write it.  Local."""
        assert self.results is not None, "curves of a response"
        return _draw(self.results, "response", path)

    @property
    def peaks(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequency [Hz] and amplitude [m] of the largest point of each level, (n_levels,) both; with harmonics = 0 the mean."""
        rows, top = np.arange(len(self.level)), np.argmax(np.nan_to_num(self.shown.size(self.coefficients), nan=-1.0), axis=1)
        return self.frequency[rows, top], self.shown.of(self.coefficients[rows, top])


class Response:
    """The response of a structure at some levels, the same on every rank.

    ``results`` is what :func:`microslip.read_results` returns for the files that :meth:`save` writes.  ``notes`` are those of a
    run's log: the reason for the number of modes, and whether the range may have resonances of further modes.  Made collectively.
    """

    def __init__(self, prepared: Prepared, branches: Sequence[Branch], notes: Sequence[str] = ()):
        self.prepared, self.branches, self.notes = prepared, tuple(branches), tuple(notes)
        self.results: ResultFile = on_root(prepared.model.comm, self._results)

    def _results(self) -> ResultFile:
        head = head_of(self.prepared)
        sizes = len(head.outputs), head.joint.n_pairs, self.prepared.model.recorded.n_coefficients
        levels = (
            level_result(branch, sizes, STOPPED if branch.failure else COMPLETE, head.level_unit) for branch in self.branches
        )
        return replace(head, levels=tuple(levels))

    def __repr__(self) -> str:
        n_points, outputs = sum(len(level.frequency) for level in self.results.levels), ", ".join(self.outputs)
        sizes = f"{counted(len(self.levels), 'level')}, {counted(n_points, 'point')}"
        return f"<Response of {self.results.name}: {sizes}, outputs {outputs}>"

    @property
    def levels(self) -> np.ndarray:
        """The levels, (n_levels,) [N]."""
        return np.array([level.level for level in self.results.levels])

    @property
    def outputs(self) -> tuple[str, ...]:
        """The names of the outputs."""
        return self.results.outputs

    @property
    def failures(self) -> dict[float, str]:
        """Why levels ended early, by level; empty if all are complete."""
        return {level.level: level.failure for level in self.results.levels if level.failure}

    @property
    def peaks(self) -> dict[float, tuple[Peak, ...]]:
        """The maxima of the outputs at each level [N], with [response] ``peaks = true``; empty without."""
        return {level.level: level.peaks for level in self.results.levels if level.peaks is not None}

    @property
    def stability(self) -> dict[float, np.ndarray]:
        """Which points of each level [N] are stable, (n,) bool, with [response] ``stability = true``; empty without.

        Multipliers are ``response.level(1.0).multipliers``, and where stability changes is ``response.level(1.0).bifurcations``.
        """
        return {level.level: level.stable.astype(bool) for level in self.results.levels if level.stable is not None}

    @property
    def sensitivity(self) -> SensitivityTable:
        """The derivatives of amplitudes and phases, with ``sensitivities=True``: by numbers of the scene, or of each pair.

        ``response.sensitivity["joints.dovetail.friction"].amplitude`` (n_levels, n, n_outputs), ``response.sensitivity["mu"]`` by
        that of each pair, ``.of_peaks(level)`` those of peaks, ``.scatter({key: per cent})`` scatter to first order.
        """
        return SensitivityTable(self.results, varied_numbers(self.prepared.scene, self.prepared.pairs))

    def level(self, level: float) -> LevelResult:
        """Return the points of one level [N], each quantity an attribute: ``frequency``, ``response``, ``state``, ``du``, ...

        Raises
        ------
        CaseError : the response does not have this level
        """
        for branch in self.results.levels:
            if np.ndim(level) == 0 and branch.level == level:
                return branch
        shown = f"{level:g} N" if isinstance(level, (int, float)) else repr(level)
        raise CaseError(f"there is no level {shown}; there are {', '.join(f'{known:g}' for known in self.levels)}")

    def __getitem__(self, output: str) -> Curves:
        """Return the curves of an output.

        Raises
        ------
        CaseError : there is no output of this name
        """
        if output not in self.outputs:
            raise CaseError(f"there is no output {output!r}; there are {', '.join(self.outputs)}")
        names, k = ("frequency", "response", "error", "corrected", "error_corrected"), self.outputs.index(output)
        frequency, response, error, corrected, remaining = map(self.array, names)
        assert frequency is not None and response is not None, "every point has them"
        return Curves(
            output,
            self.levels,
            frequency,
            response[:, :, k],
            None if error is None else total(error[:, :, k]),
            replace(self.results.shown, unit=self.results.unit_of(k)),
            self.results.unit_of(k),
            None if corrected is None else corrected[:, :, k, 0] - 1j * corrected[:, :, k, 1],
            None if remaining is None else remaining[:, :, k],
            self.results.of_output(k),
        )

    def in_sector(self, output: str, sector: int) -> Curves:
        """Return the curves of an output in a sector of a disc of alike sectors, 0 to N - 1, in axes turned with it: eq. (14.1).

        Harmonic n leads that of sector 0 by n h ``sector`` 2 pi / N; amplitudes and error bars are equal.

        Raises
        ------
        CaseError : there is no output of this name, or no such sector
        """
        curves, cyclic = self[output], self.prepared.scene.cyclic
        if cyclic is None or cyclic.whole:
            raise CaseError("in_sector: the scene has no [cyclic] of alike sectors; name the output as response.outputs has it")
        if not 0 <= sector < cyclic.sectors:
            raise CaseError(f"in_sector: there is no sector {sector}; there are 0 to {cyclic.sectors - 1}")
        shape = curves.coefficients.shape
        amplitudes = to_complex(curves.coefficients.reshape(-1, shape[-1]))
        lead = np.exp(1j * sector * cyclic.wave_number * cyclic.angle * np.arange(amplitudes.shape[1]))
        coefficients = to_real(amplitudes * lead, shape[-1]).reshape(shape)
        corrected = None if curves.corrected is None else curves.corrected * lead[1]
        return replace(curves, coefficients=coefficients, corrected=corrected)

    # -- named axes ----------------------------------------------------------------------------------------------------

    def axes(self, name: str) -> tuple[str, ...]:
        """Return the names of the axes of a quantity's array.  Local."""
        return ("level", "point", *_quantity(name).axes)

    def unit(self, name: str) -> str:
        """Return the unit of a quantity, or the meaning of its numbers.  Local."""
        return _quantity(name).unit

    def array(self, name: str) -> np.ndarray | None:
        """Return a quantity of all levels, with the axes of :meth:`axes`; None where it was not computed.  Local.

        Levels with fewer points are padded with nan, integers with 0.
        """
        _quantity(name)
        parts = [part for level in self.results.levels if (part := level.arrays[name]) is not None]
        if len(parts) < len(self.results.levels):
            return None
        shape = np.max([part.shape for part in parts], axis=0)
        padded = np.full((len(parts), *shape), np.nan if parts[0].dtype.kind == "f" else 0, dtype=parts[0].dtype)
        for row, part in zip(padded, parts):
            row[: len(part)] = 0  # coefficients of harmonics that a level has none of
            row[tuple(map(slice, part.shape))] = part
        return padded

    def to_xarray(self) -> xarray.Dataset:
        """Return all quantities as a dataset of xarray, which must be installed.  Local.

        Raises
        ------
        CaseError : xarray is missing
        """
        xarray = xarray_module()
        arrays = {name: self.array(name) for name in _QUANTITY}
        variables = {
            name: (self.axes(name), values, {"units": self.unit(name), "long_name": _quantity(name).meaning})
            for name, values in arrays.items()
            if values is not None
        }
        labels = {axis: list(names) for axis, names in LABELS.items() if any(axis in dims for dims, *_ in variables.values())}
        coordinates = {"level": ("level", self.levels, {"units": "N"}), "outputs": list(self.outputs), **labels}
        return xarray.Dataset(variables, coordinates, {"title": self.results.title}).set_coords("frequency")

    # -- on the mesh ---------------------------------------------------------------------------------------------------

    def fields(self, level: float, frequency: float | None = None) -> tuple[float, np.ndarray]:
        """Return the motion of the whole structure at the point of a level nearest to a frequency [Hz], by default at its peak.

        Collective: a static solve; the structure must not be closed.

        Returns
        -------
        frequency : of the point [Hz]
        u : (n_nodes, 3, N_H) m, axes nodes, directions and coefficients, in the order of ``structure.mesh.points``; without a
            mesh (n_dof, N_H)
        """
        structure = self.prepared.structure
        structure.refuse_closed()
        branch, system = self.level(level), structure.system
        if len(branch.frequency) == 0:
            raise CaseError(f"{level:g} N has no point: {branch.failure}")
        i = int(
            np.argmax(
                self.results.shown.size(branch.response[:, 0]) if frequency is None else -np.abs(branch.frequency - frequency)
            )
        )
        p = branch.p[i].reshape(-1, branch.p.shape[-1])
        at = ActingForces(level, 2.0 * np.pi * branch.frequency[i], p)
        (u_owned,) = self.prepared.reduction.displacements(self.prepared.model, [at])
        if system.dof is None:
            return float(branch.frequency[i]), np.concatenate(system.comm.allgather(u_owned))
        return float(branch.frequency[i]), system.comm.bcast(motions_at_nodes(system, u_owned))

    # -- files ---------------------------------------------------------------------------------------------------------

    def plot(self, path: str | Path | None = None, picture: str = "response") -> Figure | None:
        """Draw one of the pictures of a run: response, states, slip_map, rom_size, energy, energy_map, error.

        Collective; rank 0 draws into a file, further pages into files next to it.  Without a path nothing is written.  The
        structure may be closed.

        Returns
        -------
        figure : the first page, which a notebook shows; None on other ranks

        Raises
        ------
        CaseError : no such picture, or nothing to draw in it; on every rank
        """
        return on_root(self.prepared.model.comm, _draw, self.results, picture, path, share=False)

    def save(self, folder: str | Path) -> None:
        """Write the files of a run: tables, results.h5, fields for ParaView, pictures.  Collective; rank 0 writes.

        Fields need static solves: the structure must not be closed.  The scene in results.h5 is the one that was read; friction
        and preload of each pair are those of this response.
        """
        from ..results.plots import draw_all

        comm, folder = self.prepared.model.comm, Path(folder)
        writer = writer_of(self.prepared, folder)
        try:
            notify = Observers(comm, list(self.levels), [writer]).notify
            for number, branch in enumerate(self.branches):
                notify("level_started", number)
                for point in branch.points:
                    notify("point", number, point)
                notify("level_finished", number, branch)
        finally:
            writer.close()
        shapes = shapes_of(self.prepared, self.branches)
        on_root(comm, write_shapes, self.prepared, self.branches, shapes, folder, share=False)
        on_root(comm, write_sensitivities, str(folder), self.results, varied_numbers(self.prepared.scene, self.prepared.pairs))
        on_each(comm, draw_all, str(folder / "results.h5"), str(folder), slice(comm.rank, None, comm.size))


def xarray_module() -> Any:
    """Return xarray.  Local.  Raises CaseError: it is missing."""
    try:
        import xarray
    except ImportError:
        raise CaseError("to_xarray needs xarray; install it: pip install xarray") from None
    return xarray


def _draw(results: ResultFile, picture: str, path: str | Path | None) -> Figure:
    """Return the first page of a picture; with a path all pages are written into its folder."""
    from ..results.plots import draw_one

    pages = draw_one(results, picture)
    if path is not None:
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        for i, page in enumerate(pages, 1):
            page.save(str(path if i == 1 else path.with_stem(f"{path.stem}_{i}")))
    return pages[0].figure


def _quantity(name: str) -> Quantity:
    if name not in _QUANTITY:
        raise CaseError(f"there is no quantity {name!r}; there are {', '.join(_QUANTITY)}")
    return _QUANTITY[name]
