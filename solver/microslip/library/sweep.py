"""Peaks over grids and samples of a scene's numbers: :func:`sweep`, and the table that it returns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..messages.errors import CaseError
from .arguments import refuse_no_structure
from .build import Structure
from .design import Design, grid
from .peak_curves import FACTOR
from .response import xarray_module
from .sample_peaks import DONE, FAILED, OUTSIDE, Sample, SamplePeaks
from .sensitivities import unit_of_key
from .settings import output_names, units_of
from .varied import LEVELS, Varied

if TYPE_CHECKING:
    import xarray

    from ..scene.schema import Scene

NUMBERS = {  # of a sample: unit, None for that of the output; meaning
    "amplitude": (None, "amplitude of harmonic 1 at the peak"),
    "phase": ("rad", "phase of harmonic 1 at the peak"),
    "frequency": ("Hz", "frequency of the peak"),
    "width": ("Hz", "half-power width: between the solutions at 1/√2 of the amplitude"),
    "damping": ("1", "damping ratio of one mode with this amplitude for its level, theory (7.10)"),
    "friction_J": ("J", "friction loss a cycle at the peak"),
    "damping_J": ("J", "loss by damping a cycle at the peak"),
    "error": (None, "error bar of the amplitude"),
    "slipping": ("1", "pairs that slip at the peak"),
    "open": ("1", "pairs that are open at some time of the cycle at the peak"),
}
SMOOTH = ("amplitude", "frequency", "width", "damping", "friction_J")  # that pictures and statistics show


@dataclass(frozen=True, eq=False)
class SweepTable:
    """The peaks of samples, in the order of their design; the same on every rank."""

    design: Design
    samples: tuple[Sample, ...]
    nominal: Sample  # of the scene itself
    output: str
    unit: str  # of the output
    units: tuple[str, ...]  # of the numbers that vary; "" where not known
    frequencies: np.ndarray  # (n_frequencies,) Hz, of the curves

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the values of a number that varies by its key, or a number of the peaks by its name, (n,).

        Raises
        ------
        CaseError : there is none of this name
        """
        if name in self.design.keys:
            return self.design.values[:, self.design.keys.index(name)]
        if name in NUMBERS:
            return np.array([getattr(sample, name) if sample.status == DONE else np.nan for sample in self.samples], dtype=float)
        raise CaseError(f"a sweep has no {name!r}; it has {', '.join((*self.design.keys, *NUMBERS))}")

    def __getattr__(self, name: str) -> np.ndarray:
        if name in NUMBERS:
            return self[name]
        raise AttributeError(name)

    @property
    def is_done(self) -> np.ndarray:
        """Which samples have a peak, (n,) bool."""
        return np.array([sample.status == DONE for sample in self.samples], dtype=bool)

    @property
    def failures(self) -> list[str]:
        """Failures, a line for each allowed sample without a peak."""
        return [self.line(i) for i, sample in enumerate(self.samples) if sample.status == FAILED]

    @property
    def n_outside(self) -> int:
        """The samples that the scene does not allow."""
        return sum(sample.status == OUTSIDE for sample in self.samples)

    @property
    def curves(self) -> np.ndarray | None:
        """Amplitudes of the curves, (n, n_frequencies); NaN where a sample has none; None where none was requested."""
        if not any(sample.curve for sample in self.samples):
            return None
        nothing = (np.nan,) * len(self.frequencies)
        return np.array([sample.curve or nothing for sample in self.samples])

    def line(self, i: int) -> str:
        """Return the message for a sample without a peak."""
        named = ", ".join(f"{key} = {value:.6g}" for key, value in zip(self.design.keys, self.samples[i].values))
        return f"sample {i} ({named}): {self.samples[i].why}"

    def unit_of(self, name: str) -> str:
        """Return the unit of a column."""
        if name in self.design.keys:
            return self.units[self.design.keys.index(name)]
        return NUMBERS[name][0] or self.unit

    def on_axes(self, name: str) -> np.ndarray:
        """Return a number on the axes of the design: of a grid (n_1, n_2, ...), else (n,).

        Collectivity: local.
        """
        return self[name].reshape(self.design.shape)

    def records(self) -> list[dict[str, Any]]:
        """Return a record a sample, by the names of the columns of sweep.csv."""
        rows = []
        for i, sample in enumerate(self.samples):
            row: dict[str, Any] = {"sample": i} | dict(zip(self.design.keys, sample.values))
            row |= {_column(name, self.unit_of(name)): getattr(sample, name) for name in NUMBERS}
            rows.append(row | {"newton": sample.newton, "seconds": sample.seconds, "status": sample.status, "why": sample.why})
        return rows

    def to_xarray(self) -> xarray.Dataset:
        """Return the table as a dataset of xarray, which must be installed.  Local.

        Raises
        ------
        CaseError : xarray is missing
        """
        xarray = xarray_module()
        axes = self.design.axes
        variables = {
            name: (axes, self.on_axes(name), {"units": self.unit_of(name), "long_name": NUMBERS[name][1]}) for name in NUMBERS
        }
        coordinates = {
            key: ((key,) if self.design.is_grid else axes, values, {"units": unit})
            for key, values, unit in zip(self.design.keys, self.design.coordinates, self.units)
        }
        return xarray.Dataset(variables, coordinates)


def _column(name: str, unit: str) -> str:
    """Return the name of a column of sweep.csv: with its unit, as frf.csv has them."""
    return name if unit == "1" or name.endswith(f"_{unit}") else f"{name}_{unit.replace('/', '_')}"


def sweep(
    structure: Structure,
    values: Mapping[str, ArrayLike],
    *,
    paired: bool = False,
    output: str | None = None,
    curves: bool = False,
    keep_modes: bool = False,
    on_sample: Callable[[int, Sample], None] = lambda i, sample: None,
) -> SweepTable:
    """Return the peak of an output for other numbers of the scene: on a grid, or for given samples.

    Collective on ``structure.comm``; the same on every rank.  Factor, modes and static columns are those of the structure for
    level, friction, preload, gap, loads, damping and harmonics; for any other number the structure is built again.  A sample that
    fails has the reason in its ``why``, and the others go on.

    Parameters
    ----------
    values : by key, as ``"joints.dovetail.friction"`` or ``"level"``, the values [unit of the scene]; of pairs whose numbers are
        in a file, factors of these
    paired : value i of every key is sample i; otherwise all combinations are samples
    output : its name; the first one if None
    curves : compute the curve of each sample, too
    keep_modes : contact stiffness, too, leaves the modes as they are: by the update (4.7), which is exact with all modes
    on_sample : is called with number and peak of each sample

    Raises
    ------
    CaseError : an unknown key, a value that the scene does not allow, no peak of the scene itself; on every rank
    ConvergenceError, ResourceError : the scene itself, or memory; on every rank
    """
    refuse_no_structure(structure, "sweep")
    scene = structure.scene
    design = Design.paired(values) if paired else grid(values)
    varied = Varied.of(scene, design.keys, keep_modes)
    refused = next(iter(outside(varied, design).values()), None)
    if refused is not None:
        raise CaseError(refused)
    peaks = SamplePeaks(structure, varied, output, design.spread, curves)
    samples: dict[int, Sample] = {}
    try:
        for i in varied.from_the_scene(design.values, design.spread):
            samples[i] = peaks.solve(design.values[i])
            on_sample(i, samples[i])
    finally:
        peaks.close()
    in_order = [samples[i] for i in range(len(design))]
    return table_of(scene, design, varied, in_order, peaks.nominal, peaks.output, peaks.grid)


def outside(varied: Varied, design: Design) -> dict[int, str]:
    """Return the samples that the scene does not allow, with the messages.  Local."""
    refused = {}
    for i, row in enumerate(design.values):
        try:
            varied.scene_at(row)
        except CaseError as problem:
            refused[i] = str(problem)
    return refused


def table_of(
    scene: Scene, design: Design, varied: Varied, samples: Sequence[Sample], nominal: Sample, output: int, omegas: np.ndarray
) -> SweepTable:
    """Return the table of samples.  Local."""
    units = units_of(scene)
    of_keys = tuple(
        FACTOR if factor else units.level if key in LEVELS else unit_of_key(scene, key)
        for key, factor in zip(varied.keys, varied.is_factor)
    )
    return SweepTable(
        design, tuple(samples), nominal, output_names(scene)[output], units.outputs[output], of_keys, omegas / (2.0 * np.pi)
    )
