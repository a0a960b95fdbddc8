"""The options of a sweep: lists and ranges, scatter, a table of samples; and the resulting design of samples."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...library.design import DISTRIBUTIONS, KINDS, Design, Scatter, grid, one_by_one, scattered
from ...library.varied import Varied
from ...messages.errors import CaseError
from ...messages.words import hint, listed
from ...scene.schema import Scene
from ...system.files import file_errors, refuse_devices

SAMPLES = 64
_LISTS = "KEY=A,B,..., KEY=FIRST:LAST:COUNT or KEY=FIRST:LAST:COUNT:log"
_LARGEST_TABLE = 50_000_000  # bytes


@dataclass(frozen=True)
class Request:
    """The command's arguments in addition to the scene."""

    swept: tuple[str, ...] = ()  # KEY=LIST or KEY=RANGE
    scatter: tuple[str, ...] = ()  # KEY=PERCENT or KEY=PERCENT:DISTRIBUTION
    table: str | None = None  # file of samples
    samples: int | None = None
    design: str | None = None  # of scatter
    seed: int = 0
    one_by_one: bool = False
    output: str | None = None
    outside: str = "refuse"  # or skip, of samples that the scene does not allow
    curves: bool = False
    groups: int | None = None  # of ranks; None: as many as there are ranks
    part: tuple[int, int] = (1, 1)  # of a job array: number of this part, number of parts
    fresh: bool = False
    keep_modes: bool = False  # under another contact stiffness
    walltime: float | None = None  # s, time limit; None: from the scheduler


def design_of(scene: Scene, request: Request) -> Design:
    """Return the requested samples.  Local, on rank 0: reads the table of samples.

    Raises
    ------
    CaseError : no or several options that vary numbers; a value that is no number; an unknown key; a table that does not fit
    """
    where = f"{scene.source}: sweep"
    is_requested = [bool(request.swept), bool(request.scatter), request.table is not None]
    if sum(is_requested) != 1:
        stated = listed([flag for flag, has in zip(("--set KEY=LIST", "--scatter", "--table"), is_requested) if has] or ["none"])
        raise CaseError(
            f"{where}: exactly one of --set {_LISTS}, --scatter KEY=PERCENT or --table FILE.csv varies numbers, found {stated}"
        )
    if not request.scatter and (request.samples or request.design):
        raise CaseError(f"{where}: --samples and --design belong to --scatter KEY=PERCENT")
    if request.one_by_one and not request.swept:
        raise CaseError(f"{where}: --one-by-one belongs to --set {_LISTS}")
    if request.table is not None:
        return read_table(request.table)
    if request.scatter:
        return _scattered(scene, request)
    values = _by_key((_listed(text) for text in request.swept), where)
    if not request.one_by_one:
        return grid(values)
    varied = Varied.of(scene, list(values))
    return one_by_one(values, dict(zip(varied.keys, varied.nominal)))


def _by_key(entries, where: str) -> dict:
    """Return entries by their keys; CaseError if a key comes twice."""
    by_key: dict = {}
    for key, value in entries:
        if key in by_key:
            raise CaseError(f"{where}: {key} is stated twice; each number has one list, range or scatter")
        by_key[key] = value
    return by_key


def _listed(text: str) -> tuple[str, np.ndarray]:
    """Return key and values of KEY=LIST or KEY=RANGE."""
    key, _, values = (part.strip() for part in text.partition("="))
    try:
        if ":" not in values:
            return key, np.array([_finite(word) for word in values.split(",")])
        first, last, count, *log = values.split(":")
        n, ends = int(count), (_finite(first), _finite(last))
        is_log = [word.strip() for word in log] == ["log"]
        if n < 1 or (log and not is_log) or (n == 1 and ends[0] != ends[1]) or (is_log and min(ends) <= 0.0):
            raise ValueError
        return key, np.geomspace(*ends, n) if is_log else np.linspace(*ends, n)
    except (ValueError, OverflowError):
        raise CaseError(f"--set {text}: expected {_LISTS}, with finite numbers, above 0 where they are logarithmic") from None


def _finite(text: str) -> float:
    """Return a finite number; ValueError if it is none."""
    if not np.isfinite(number := float(text)):
        raise ValueError(f"{text} is not finite")
    return number


def _scattered(scene: Scene, request: Request) -> Design:
    """Return samples about the numbers of the scene."""
    where = f"{scene.source}: sweep"
    kind = request.design or "sobol"
    if kind not in KINDS:
        raise CaseError(f"{where}: --design {kind}: expected {listed(KINDS, 'or')}{hint(kind, KINDS)}")
    stated = _by_key((_percent(text) for text in request.scatter), where)
    varied = Varied.of(scene, list(stated))
    scatter = {}
    for (key, (percent, distribution)), mean in zip(stated.items(), varied.nominal):
        if not np.isfinite(mean) or mean == 0.0:
            fault = "is 0" if mean == 0.0 else "is not stated"
            raise CaseError(
                f"{where}: --scatter {key}: the number {fault} in the scene, and a scatter in percent needs one; state it"
            )
        scatter[key] = Scatter(float(mean), percent, distribution)
    return scattered(scatter, request.samples or SAMPLES, kind, request.seed)


def _percent(text: str) -> tuple[str, tuple[float, str]]:
    """Return key, percent and distribution of KEY=PERCENT:DISTRIBUTION."""
    key, _, value = (part.strip() for part in text.partition("="))
    number, _, distribution = value.partition(":")
    distribution = distribution.strip() or DISTRIBUTIONS[0]
    if distribution not in DISTRIBUTIONS:
        known = listed(DISTRIBUTIONS, "or")
        raise CaseError(f"--scatter {text}: expected the distribution {known}{hint(distribution, DISTRIBUTIONS)}")
    try:
        percent = float(number.removesuffix("%"))
    except ValueError:
        percent = 0.0
    if not key or not 0.0 < percent < 1000.0:
        raise CaseError(f"--scatter {text}: expected KEY=PERCENT or KEY=PERCENT:DISTRIBUTION, percent above 0 and below 1000")
    return key, (percent, distribution)


def read_table(path: str) -> Design:
    """Return the samples of a CSV file with the keys in its first line.  Local.

    Raises
    ------
    CaseError : there is no such file, no keys or no samples in it, or a cell is no finite number
    """
    expected = "expected a first line of keys, as joints.dovetail.friction,level, and a line of numbers for each sample"
    if Path(path).is_dir():
        raise CaseError(f"--table {path}: that is a folder and no file; {expected}")
    if not Path(path).exists():
        raise CaseError(f"--table {path}: there is no such file; {expected}")
    with file_errors(path):
        refuse_devices(path)
        if Path(path).stat().st_size > _LARGEST_TABLE:
            raise CaseError(f"--table {path}: too large for a table of samples")
        try:
            with open(path, newline="", encoding="utf-8-sig") as file:
                lines = [line for line in csv.reader(row for row in file if row.strip() and not row.lstrip().startswith("#"))]
        except (UnicodeDecodeError, csv.Error) as problem:
            raise CaseError(f"--table {path}: no CSV file ({problem}); {expected}") from None
    if lines and ";" in lines[0][0]:
        raise CaseError(f"--table {path}: values are separated by semicolons, not by commas; {expected}")
    keys = [key.strip() for key in lines[0]] if lines else []
    if not keys or any(_is_number(key) or not key for key in keys):
        raise CaseError(f"--table {path}: the columns have no names; {expected}")
    if len(lines) < 2:
        raise CaseError(f"--table {path}: there is no sample in it; {expected}")
    return Design.of_columns(keys, np.array([_row(path, i, row, keys) for i, row in enumerate(lines[1:])]))


def _row(path: str, i: int, row: Sequence[str], keys: Sequence[str]) -> list[float]:
    """Return the numbers of a line of a table."""
    if len(row) != len(keys):
        raise CaseError(f"--table {path}: sample {i} has {len(row)} cells, and there are {len(keys)} columns")
    for key, cell in zip(keys, row):
        if not _is_number(cell):
            raise CaseError(f"--table {path}: sample {i}: {key}: expected a finite number, found {cell.strip()!r}")
    return [float(cell) for cell in row]


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def refusal(outside: Mapping[int, str], n: int) -> str:
    """Return why a sweep is refused whose samples the scene does not allow."""
    first = next(iter(outside))
    return (
        f"{outside[first]}\n  {len(outside)} of {n} samples are outside what the scene allows, first sample {first}; "
        "--outside skip leaves them out, and a lognormal scatter keeps positive numbers positive"
    )
