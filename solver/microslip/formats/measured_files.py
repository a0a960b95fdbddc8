"""Measured responses in files of other programs: variables of MATLAB files, response functions of universal files.

SciPy and pyuff read them in a sandbox: SciPy crashes on some damaged files.
"""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..messages.errors import CaseError
from ..messages.words import counted, hint, listed
from ..system.files import refuse_devices
from ..system.sandbox import LibraryError, SandboxError, read_file

FUNCTION, UNITS = 58, 164  # numbers of data sets
FREQUENCY_RESPONSE = 4  # type of a function; coherences and spectra, which others are, are not read
OF_KIND = {8: "m", 11: "m/s", 12: "m/s2", 9: "N", 13: "N"}  # units by the type of a quantity; 0 is unknown
MOST_LINES = 400  # of a file whose range the scene does not state: each is a solution in each step of a fit
GAIN = 100  # bytes of memory for each byte of a file: pyuff makes a list of numbers


def variables(path: Path) -> dict[str, np.ndarray]:
    """Return the variables of a MATLAB file of version 4 to 7.2, arrays of any shape.  Local.

    Raises
    ------
    CaseError : it cannot be read
    """
    return _in_sandbox(path, _variables, "a MATLAB file of version 5 to 7.2")


def functions(
    path: Path,
    outputs: Sequence[str],
    units: Sequence[str],
    levels: Sequence[float],
    frequencies: tuple[float, float] | None = None,
) -> dict[str, list[Any]]:
    """Return columns of the frequency response functions (data set 58) of a universal file, by name.  Local.

    A function belongs to the output that its response entity or its first line names, or to the only output.  Its level is the
    Z-axis value where that is a force or an acceleration, otherwise the only level of the scene.

    Parameters
    ----------
    outputs, units, levels : names and units of the outputs, and levels of the scene
    frequencies : range whose lines are read [Hz]; None for all above 0

    Raises
    ------
    CaseError : the file cannot be read, or has no function of an output in its unit
    """
    sets = _in_sandbox(path, _sets, "a universal file")
    factors = next((each for each in sets if each["type"] == UNITS), {"length": 1.0, "force": 1.0})
    columns: dict[str, list[Any]] = {}
    low, high = frequencies or (0.0, np.inf)
    chosen = [each for each in sets if each["type"] == FUNCTION and each["func_type"] == FREQUENCY_RESPONSE]
    for number, each in enumerate(chosen, 1):
        where = f"{path}, response function {number}"
        k = _output(each, outputs, where)
        unit = _unit(each, units[k], where)
        H, level = _in_SI(each, unit, factors, levels, where)
        f = np.asarray(each["x"], dtype=float)
        inside = (f > 0.0) & (f >= low) & (f <= high)
        rows = {
            "frequency_Hz": f,
            f"amplitude_{unit}": level * np.abs(H),
            "phase_rad": np.angle(H),
            "level": np.full(len(f), level),
        }
        for name, values in rows.items():
            columns.setdefault(name, []).extend(values[inside].tolist())
        columns.setdefault("output", []).extend([outputs[k]] * int(inside.sum()))
    if not chosen:
        raise CaseError(
            f"{path}: there is no frequency response function (data set {FUNCTION}, function type {FREQUENCY_RESPONSE})"
        )
    n = len(columns["frequency_Hz"])
    if n == 0:
        raise CaseError(f"{path}: there is no line within [response] frequencies, {low:g} to {high:g} Hz")
    if frequencies is None and n > MOST_LINES:
        raise CaseError(f"{path}: {n} lines; state [response] frequencies, the range of those to fit")
    return columns


def _output(function: dict[str, Any], outputs: Sequence[str], where: str) -> int:
    """Return the number of the output of a function."""
    if len(outputs) == 1:
        return 0
    entity, line = str(function["rsp_ent_name"]).strip(), str(function["id1"]).strip()
    named = [k for k, name in enumerate(outputs) if line == name or line.startswith(f"{name},") or entity in (name, name[:10])]
    if len(named) != 1:
        raise CaseError(
            f'{where}: the response entity "{entity}" is not the name of one output{hint(entity, outputs)}; '
            f"there are {listed(outputs)}"
        )
    return named[0]


def _unit(function: dict[str, Any], unit: str, where: str) -> str:
    """Return the unit of an output, which must be that of its function."""
    kind = int(function["ordinate_spec_data_type"])
    if kind and OF_KIND.get(kind, "") != unit:
        kind_text = f"is in {OF_KIND[kind]}" if kind in OF_KIND else f"has the data type {kind}"
        raise CaseError(f"{where}: it {kind_text}, and the output in {unit}: state the quantity of the output")
    return unit


def _in_SI(
    function: dict[str, Any], unit: str, factors: dict[str, Any], levels: Sequence[float], where: str
) -> tuple[np.ndarray, float]:
    """Return a function in SI units (n,), and its level."""
    of_unit = {"N": float(factors["force"])}
    x, H = np.asarray(function["x"], dtype=float), np.asarray(function["data"])
    if not np.iscomplexobj(H) or x.shape != H.shape or function["abscissa_spec_data_type"] not in (0, 18):
        raise CaseError(f"{where}: complex values over frequency are expected")
    if not (np.isfinite(x).all() and np.isfinite(H).all()):
        raise CaseError(f"{where}: there is a value that is not a finite number")
    per = OF_KIND.get(int(function["orddenom_spec_data_type"]), "N")
    of_level = of_unit.get(per, float(factors["length"]))
    level = np.nan
    if function["z_axis_spec_data_type"] in (12, 13) and function["z_axis_value"] > 0.0:
        level = float(function["z_axis_value"]) / of_level
    elif len(levels) == 1:
        level = float(levels[0])
    else:
        raise CaseError(
            f"{where}: the scene has {counted(len(levels), 'level')}, and no Z-axis value (data type 13) states its level; "
            "keep one level in the scene"
        )
    return H * of_level / of_unit.get(unit, float(factors["length"])), level


def _in_sandbox(path: Path, function: Any, what: str) -> Any:
    refuse_devices(path)
    try:
        return read_file(path, function, str(path), gain=GAIN)
    except OSError as problem:
        raise CaseError(f"{path}: {problem.strerror or problem}") from None
    except (SandboxError, LibraryError) as problem:
        how = f" ({problem})" if isinstance(problem, SandboxError) else ""
        raise CaseError(f"{path}: it cannot be read as {what}; it is truncated, damaged or another format{how}") from None


# -- in the sandbox ----------------------------------------------------------------------------------------------------


def _variables(path: str) -> dict[str, np.ndarray]:
    """Return the variables of a MATLAB file.  Local; may raise any exception for a damaged file."""
    from scipy.io import loadmat

    content = loadmat(path, appendmat=False, squeeze_me=True, chars_as_strings=True)
    arrays = {name: np.atleast_1d(values) for name, values in content.items() if not name.startswith("__")}
    for name, values in arrays.items():
        if values.dtype.kind == "O" and all(isinstance(value, str) for value in values.flat):
            arrays[name] = values.astype(str)  # a cell array of texts
        elif values.dtype.kind not in "biufU":
            raise CaseError(f"{path}: {name} is neither numbers nor texts")
    return arrays


def _sets(path: str) -> list[dict[str, Any]]:
    """Return the data sets 58 and 164 of a universal file.  Local; may raise any exception for a damaged file."""
    try:
        import pyuff
    except ImportError:
        raise CaseError(
            f"{path}: response functions of universal files are read by pyuff; install it: pip install pyuff"
        ) from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file = pyuff.UFF(path)
        kinds = [int(kind) for kind in file.get_set_types()]
        return [file.read_sets(i) for i, kind in enumerate(kinds) if kind in (FUNCTION, UNITS)]
