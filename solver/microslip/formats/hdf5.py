"""How much of an HDF5 file may be believed: the storage of its data sets against the size of the file.  Local; needs h5py."""

from __future__ import annotations

from math import prod
from typing import Any

from ..system.memory import gigabytes, memory_left_here

MOST_GAIN = 2000  # gzip packs no more than about 1030 to 1
_COPIES = 2  # of all values, that are in memory while they are read and checked
_OF_ANY_FILE = 2**24  # bytes that a data set may have without a value in the file: all of them are its fill value
_OWN_FILTERS = range(1, 7)  # deflate, shuffle, fletcher32, szip, nbit, scaleoffset


class Storage:
    """What the data sets of one file have taken of it so far."""

    def __init__(self, n_bytes: int):
        self.n_bytes = n_bytes  # of the file
        self.names: dict[int, str] = {}  # by the address of the data set
        self.taken = 0
        self.claimed = 0  # bytes of all values together

    def link_fault(self, group: Any, name: str) -> str | None:
        """Return what is wrong with an item of a group before anything of it is read, its storage included.  Local.

        What is wrong: it is a link to another place, its numbers lie in another file, or a fault of its storage.
        """
        import h5py

        link = group.get(name, getlink=True)
        if not isinstance(link, h5py.HardLink):
            return f"{name} is a link to {getattr(link, 'filename', 'another place')}; links are not followed"
        item = group[name]
        if not isinstance(item, h5py.Dataset):
            return None
        if item.external or item.is_virtual:
            return f"the numbers of {name} lie in another file; they are not read"
        return self.fault(item, name)

    def fault(self, dataset: Any, name: str) -> str | None:
        """Return what is wrong with a data set before one of its values is read; None where nothing is.  Local.

        What is wrong: it claims more than its stored bytes can stand for, or a chunk that does; data sets that share their
        bytes, so that together they would have more than the file; filters that HDF5 would load from elsewhere; variable
        lengths, which lie in heaps whose damage crashes the library.
        """
        stored, claimed = dataset.id.get_storage_size(), dataset.size or 0
        claimed *= dataset.dtype.itemsize
        foreign = _foreign_filter(dataset)
        if foreign is not None:
            return f"{name} is packed by a filter, {foreign}, that is no part of HDF5"
        if dataset.dtype.hasobject:
            return f"{name} has values of variable length or references, which are not read"
        if claimed > max(MOST_GAIN * stored, _OF_ANY_FILE):
            return f"{name} claims {claimed} bytes and holds {stored}"
        chunk = dataset.dtype.itemsize * prod(dataset.chunks or (0,))
        if chunk > max(MOST_GAIN * stored, _OF_ANY_FILE):
            return f"{name} has chunks of {chunk} bytes and holds {stored}"
        return self._shared(dataset, name, stored)

    def _shared(self, dataset: Any, name: str, stored: int) -> str | None:
        """Return what is wrong where a data set stands there under two names, or all together are larger than the file."""
        import h5py

        address = h5py.h5o.get_info(dataset.id).addr
        if address not in self.names:
            self.names[address] = name
            self.taken += stored
            self.claimed += (dataset.size or 0) * dataset.dtype.itemsize
        if self.names[address] != name:
            return f"{name} and {self.names[address]} are one data set under two names"
        if self.taken > self.n_bytes:
            return f"{name} holds {stored} bytes, more than the file has left"
        needed = _COPIES * self.claimed
        if needed > _OF_ANY_FILE and needed > (left := memory_left_here()):
            return f"{name} and what was read before it need {gigabytes(needed)} of memory, of which {gigabytes(left)} are left"
        return None


def _foreign_filter(dataset: Any) -> str | None:
    """Return the name of a filter that HDF5 would look for among its plugins."""
    plist = dataset.id.get_create_plist()
    for i in range(plist.get_nfilters()):
        number, _, _, name = plist.get_filter(i)
        if number not in _OWN_FILTERS:
            return f"number {number} ({name.decode('ascii', 'replace')[:40]})" if name else f"number {number}"
    return None
