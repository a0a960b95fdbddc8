"""HDF5 files on a full disk: one error at the end, whatever HDF5 still writes and reads."""

import errno
import os

import h5py
import numpy as np
import pytest

from microslip.system import hdf5
from microslip.system.hdf5 import written_hdf5

ARRAYS = {f"group/{i}": np.random.default_rng(i).normal(size=(500 + i, 3)) for i in range(20)}


class Filling:
    """A file on a disk with room for some bytes."""

    def __init__(self, file, room):
        self.file, self.room = file, room

    def __getattr__(self, name):
        return getattr(self.file, name)

    def write(self, data):
        if self.file.tell() >= self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self.file.write(data[: self.room - self.file.tell()])

    def truncate(self, size):
        if size > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self.file.truncate(size)


def write(file):
    for name, values in ARRAYS.items():
        file.create_dataset(name, data=values, chunks=(100, 3), compression="gzip", shuffle=True)
        file[name].attrs["unit"] = "m"


def read(file):
    return all(np.array_equal(file[name], values) and file[name].attrs["unit"] == "m" for name, values in ARRAYS.items())


def test_written_files_are_read(tmp_path):
    path = str(tmp_path / "file.h5")
    with written_hdf5(path) as file:
        write(file)
    with written_hdf5(path, "r+") as file:
        assert read(file)
        del file["group/3"]
        file["group/3"] = ARRAYS["group/3"]
        file["group/3"].attrs["unit"] = "m"
    with h5py.File(path) as file:
        assert read(file)


@pytest.mark.parametrize("room", [0, 1, 100, 2048, 5000, 20_000, 100_000])
def test_a_full_disk_is_one_error_when_the_file_is_closed(tmp_path, monkeypatch, room):
    disk = hdf5._Disk
    monkeypatch.setattr(hdf5, "_Disk", lambda file: disk(Filling(file, room)))
    with pytest.raises(OSError, match="No space left on device"), written_hdf5(str(tmp_path / "file.h5")) as file:
        write(file)
        file.flush()
        assert read(file)  # from memory
