"""Access to the datasets of a result file by name, each checked.  The file may be hostile: nothing outside it is opened."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import h5py
import numpy as np

from ..formats.hdf5 import MOST_GAIN, Storage
from ..messages.errors import CaseError
from ..system.files import NO_FILE
from .writer import FORMAT, FORMAT_VERSION

_MOST_TEXTS = 100_000
_LARGEST = 1e150  # magnitude of a number, whose square must not overflow


@contextmanager
def opened(path: str) -> Iterator[Reader]:
    """Yield the datasets of a result file.  Local.

    Raises
    ------
    CaseError : no such file, or one that cannot be read as results, also while it is open
    """
    if not os.path.isfile(path):
        what = "that is a folder" if os.path.isdir(path) else NO_FILE if os.path.exists(path) else "no such file"
        raise CaseError(f"{path}: {what}; the result file of a run is results.h5 in its folder")
    try:
        with h5py.File(path, "r") as file:
            _check_format(path, file)
            _refuse_links(path, file)
            yield Reader(path, file)
    except CaseError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, IndexError) as problem:
        cause = " ".join(str(problem).split())[:200]
        raise CaseError(f"{path}: cannot be read as a result file; it is truncated, damaged or no HDF5 file ({cause})") from None


def _check_format(path: str, file: h5py.File) -> None:
    """Raise CaseError unless the file has results of this version of the format."""
    if attribute(file, "format") != FORMAT:
        raise CaseError(f"{path}: an HDF5 file, but not one with microslip results")
    version = int(file.attrs["format_version"])
    if version != FORMAT_VERSION:
        age = "an older" if version < FORMAT_VERSION else "a newer"
        raise CaseError(
            f"{path}: written by {age} version of the program (format {version}, this one reads {FORMAT_VERSION}); "
            "run the scene again, or use that version"
        )


def _refuse_links(path: str, file: h5py.File) -> None:
    """Raise CaseError if a file has a link to another place or file, whether it is requested or not."""
    known, left = set[int](), [file["/"]]
    while left:
        group = left.pop()
        for name in group:
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                place = f"{group.name.rstrip('/')}/{name}"[1:61]
                raise CaseError(f"{path}: {place!r} is a link to another place or file; such files are refused")
            about = h5py.h5o.get_info(group.id, name.encode("utf-8", "surrogateescape"))
            if about.type == h5py.h5o.TYPE_GROUP and about.addr not in known:
                known.add(about.addr)
                left.append(group[name])


def attribute(item, name: str) -> str:
    """Return an attribute of a group or a dataset as text; "" if there is none.  Local."""
    value = item.attrs.get(name, "")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


class Reader:
    """Datasets of a file by name; datasets that refer to other files, or claim more memory than they store, are refused."""

    def __init__(self, path: str, file: h5py.File):
        self.path, self.file, self.storage = path, file, Storage(os.path.getsize(path))

    def __contains__(self, name: str) -> bool:
        return self._item(name) is not None

    def group(self, name: str) -> h5py.Group:
        """Return a group by its name."""
        item = self._item(name)
        if not isinstance(item, h5py.Group):
            raise CaseError(f"{self.path}: group {name!r} is missing; the file is damaged or was edited")
        return item

    def _item(self, name: str):
        """Return a group or dataset, None if there is none."""
        item = self.file
        for part in name.split("/"):
            if not isinstance(item, h5py.Group) or part not in item:
                return None
            item = item[part]
        return item

    def _dataset(self, name: str) -> h5py.Dataset:
        item = self._item(name)
        if not isinstance(item, h5py.Dataset):
            raise CaseError(f"{self.path}: dataset {name!r} is missing; the file is damaged or was edited")
        if item.is_virtual or item.external:
            raise CaseError(f"{self.path}: dataset {name!r} has its values in another file; such files are refused")
        if item.size and item.nbytes > MOST_GAIN * max(item.id.get_storage_size(), 1):
            raise CaseError(
                f"{self.path}: dataset {name!r} claims {item.nbytes} bytes and holds "
                f"{item.id.get_storage_size()}; such files are refused"
            )
        if h5py.check_string_dtype(item.dtype) is not None and item.dtype.hasobject:
            return item  # texts of variable length, of an earlier version
        fault = self.storage.fault(item, f"dataset {name!r}")
        if fault is not None:
            raise CaseError(f"{self.path}: {fault}; such files are refused")
        return item

    def array(self, name: str, kind: str, shape: tuple[int | None, ...]) -> np.ndarray:
        """Return numbers as type ``kind`` and of ``shape``, where None is any length."""
        dataset = self._dataset(name)
        fits = dataset.ndim == len(shape) and all(expected in (None, have) for expected, have in zip(shape, dataset.shape))
        if dataset.dtype.kind not in "iufb" or not fits:
            wanted = "x".join("n" if expected is None else str(expected) for expected in shape)
            raise CaseError(f"{self.path}: dataset {name!r} is {dataset.dtype} {dataset.shape}, not numbers {wanted}")
        values = dataset[()].astype(kind, copy=False)
        if values.dtype.kind == "f" and np.any(np.abs(values) > _LARGEST, where=np.isfinite(values)):
            raise CaseError(f"{self.path}: dataset {name!r} has values beyond {_LARGEST:g}; the file is damaged or was edited")
        return values

    def texts(self, name: str) -> list[str]:
        """Return one text or several as a list."""
        dataset = self._dataset(name)
        if h5py.check_string_dtype(dataset.dtype) is None or dataset.ndim > 1 or dataset.size > _MOST_TEXTS:
            raise CaseError(f"{self.path}: dataset {name!r} is {dataset.dtype} {dataset.shape}, not text")
        values = np.atleast_1d(dataset.asstr(errors="replace")[()])
        return [str(value) for value in values]
