"""Damaged and invalid result files for the commands that read them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from .case import NOISE, Case, Spoil, cut, made_a_folder, made_a_loop, removed, written

FILE = "copy.h5"  # a copy, so that the earlier results are unchanged


def of_hdf5(change: Callable[[h5py.File], None]) -> Spoil:
    """Return a function that changes the copy of the results by ``change(file)``."""

    def spoil(folder: Path) -> None:
        with h5py.File(folder / FILE, "r+") as file:
            change(file)

    return spoil


def plot(name: str, spoil: Spoil, *words: str) -> Case:
    return Case(name, f"plot {FILE} --out pictures", (FILE, *words), spoil)


def replaced(name: str, values) -> Spoil:
    """Return a function that replaces the values of a dataset."""

    def change(file: h5py.File) -> None:
        del file[name]
        file[name] = values

    return of_hdf5(change)


def without(name: str) -> Spoil:
    return of_hdf5(lambda file: file.__delitem__(name))


def linked(name: str) -> Spoil:
    """Return a function that replaces a dataset by a link to another file."""

    def change(file: h5py.File) -> None:
        del file[name]
        file[name] = h5py.ExternalLink("/etc/passwd", "/x")

    return of_hdf5(change)


def _huge(file: h5py.File) -> None:
    """Make a dataset of nearly a hundred gigabytes that takes a few bytes."""
    del file["levels/0000/response"]
    file.create_dataset("levels/0000/response", (10**6, 10**4), "f8", chunks=(10, 10), compression="gzip")


def _virtual(file: h5py.File) -> None:
    """Make a virtual dataset of frequencies in another file."""
    n = len(file["levels/0000/frequency_Hz"])
    del file["levels/0000/frequency_Hz"]
    layout = h5py.VirtualLayout((n,), "f8")
    layout[:] = h5py.VirtualSource("/tmp/other.h5", "x", (n,))
    file.create_virtual_dataset("levels/0000/frequency_Hz", layout)


RESPONSE = "levels/0000/response"
FREQUENCY = "levels/0000/frequency_Hz"
FILES = [
    plot("results missing", removed(FILE), "no such file"),
    plot("results are a folder", made_a_folder(FILE), "that is a folder"),
    plot("results are a loop of links", made_a_loop(FILE), "no such file"),
    plot("results empty", written(FILE, ""), "damaged"),
    plot("results of noise", written(FILE, NOISE), "no HDF5 file"),
    plot("results cut", cut(FILE), "truncated"),
    plot("results cut at their end", cut(FILE, 0.999), "truncated"),
    plot("results are a table", written(FILE, "level_N,point\n"), "no HDF5 file"),
    Case("scene for results", "plot lap.toml --out pictures", ("lap.toml", "no HDF5 file")),
    Case("report of nothing", "report none.h5", ("none.h5: no such file",)),
    Case("difference from nothing", "diff out/results.h5 none.h5", ("none.h5: no such file",)),
    Case("difference from a scene", "diff out/results.h5 lap.toml", ("lap.toml", "no HDF5 file")),
    Case("conversion of nothing", "convert none.h5", ("none.h5: no such file",)),
]
CONTENTS = [
    plot(
        "results of another program",
        of_hdf5(lambda file: file.attrs.__setitem__("format", "other")),
        "not one with microslip results",
    ),
    plot("results without a format", of_hdf5(lambda file: file.attrs.__delitem__("format")), "not one with microslip results"),
    plot(
        "results of a version to come",
        of_hdf5(lambda file: file.attrs.__setitem__("format_version", 99)),
        "written by a newer version of the program (format 99",
    ),
    plot("results without levels", without("levels"), "levels"),
    plot("results without a joint", without("joint"), "joint"),
    plot("results without a response", without(RESPONSE), RESPONSE),
    plot("results without frequencies", without(FREQUENCY), FREQUENCY),
    plot("results without outputs", without("outputs/name"), "outputs/name"),
    plot("response of another shape", replaced(RESPONSE, np.zeros((3, 1))), RESPONSE, "(3, 1)"),
    plot("response of words", replaced(RESPONSE, "words"), RESPONSE),
    plot("frequencies too few", replaced(FREQUENCY, np.ones(2)), "levels/0000"),
    plot("response of a hundred gigabytes", of_hdf5(_huge), RESPONSE),
    plot("response from another file", linked(RESPONSE), RESPONSE),
    plot("frequencies from another file, virtually", of_hdf5(_virtual), FREQUENCY),
    plot("group for a dataset", of_hdf5(lambda file: (file.__delitem__(RESPONSE), file.create_group(RESPONSE))), RESPONSE),
    Case("report of damaged results", f"report {FILE} --out pages", (FILE, RESPONSE), without(RESPONSE)),
    Case("difference from damaged results", f"diff {FILE} out/results.h5", (FILE, RESPONSE), without(RESPONSE)),
    Case("difference from cut results", f"diff out/results.h5 {FILE}", (FILE, "truncated"), cut(FILE)),
    Case("conversion of damaged results", f"convert {FILE} --out others", (FILE, RESPONSE), without(RESPONSE)),
]

CASES = [*FILES, *CONTENTS]
