"""Checks of an HDF5 file before it is read: the storage of its data sets against the file size.  Local; needs h5py."""

from math import prod
from typing import Any

from ..system.memory import lack_of_memory

MOST_GAIN = 2000  # gzip compresses by at most about 1030 to 1
COPIES = 2  # copies of all values in memory while they are read and checked
_OF_ANY_FILE = 2**24  # bytes allowed to a data set without stored values, all equal to its fill value
_BUILT_IN_FILTERS = range(1, 7)  # deflate, shuffle, fletcher32, szip, nbit, scaleoffset


class Storage:
    """Bytes of one file that its data sets have used so far."""

    def __init__(self, n_bytes: int):
        self.n_bytes = n_bytes  # size of the file
        self.names: dict[int, str] = {}  # by the address of the data set
        self.taken = 0  # stored bytes of all data sets read so far
        self.claimed = 0  # bytes of their values in memory

    def link_fault(self, group: Any, name: str) -> str | None:
        """Return the fault of an item of a group, checked before any of its data are read; None without a fault.  Local.

        Faults: the item is a link, its numbers lie in another file, or a fault of its storage (``fault``).
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
        """Return the fault of the storage of a data set, checked before any value is read; None without a fault.  Local.

        Faults: a data set or chunk larger than its stored bytes can expand to; data sets that share bytes, so that together
        they exceed the file; filters that HDF5 would load as plugins; variable lengths, whose heaps crash the library if damaged.
        """
        stored, claimed = dataset.id.get_storage_size(), dataset.size or 0
        claimed *= dataset.dtype.itemsize
        foreign = _foreign_filter(dataset)
        if foreign is not None:
            return f"{name} is packed by a filter, {foreign}, that is not part of HDF5"
        if dataset.dtype.hasobject:
            return f"{name} has values of variable length or references, which are not read"
        if claimed > max(MOST_GAIN * stored, _OF_ANY_FILE):
            return f"{name} claims {claimed} bytes and holds {stored}"
        chunk = dataset.dtype.itemsize * prod(dataset.chunks or (0,))
        if chunk > max(MOST_GAIN * stored, _OF_ANY_FILE):
            return f"{name} has chunks of {chunk} bytes and holds {stored}"
        return self._shared(dataset, name, stored)

    def _shared(self, dataset: Any, name: str, stored: int) -> str | None:
        """Return the fault if a data set has two names, or if all data sets together exceed the file."""
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
        needed = COPIES * self.claimed
        lack = lack_of_memory(needed) if needed > _OF_ANY_FILE else None
        return f"{name} and what was read before it need {lack}" if lack is not None else None


def _foreign_filter(dataset: Any) -> str | None:
    """Return the name of a filter that HDF5 would look for among its plugins."""
    plist = dataset.id.get_create_plist()
    for i in range(plist.get_nfilters()):
        number, _, _, name = plist.get_filter(i)
        if number not in _BUILT_IN_FILTERS:
            return f"number {number} ({name.decode('ascii', 'replace')[:40]})" if name else f"number {number}"
    return None
