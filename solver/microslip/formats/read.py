"""Read a model file; the format follows from the ending of its name."""

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from itertools import islice

import numpy as np

from ..messages.errors import CaseError, MeshError
from ..messages.words import counted, place
from ..system.memory import bounded_by_machine, gigabytes
from .model import FileModel
from .via_meshio import FORMATS

_HEAD = 200  # lines by which the program of an .inp file is recognised
_ABAQUS = re.compile(r"\*(HEADING|NODE|ELEMENT|PART|INCLUDE|NSET|ELSET|MATERIAL|PARAMETER)\b")
_OTHER = re.compile(r"(BEGIN\s+BULK|CEND)\b|/(PREP7|BATCH)\b|NBLOCK,")
_POINTER = b"version https://git-lfs"
_FREE = 2**30  # bytes for any file
_GAIN = 200  # bytes for each byte of a file: each card of bulk data becomes a Python object


def _by(module: str, function: str) -> Callable[..., FileModel]:
    """Return a reader of this package that imports its module at the first call: a run needs one of a dozen."""
    return lambda path, *step: getattr(import_module(f".{module}", __package__), function)(path, *step)


def _read_dat(path: str) -> FileModel:
    """Read a file whose ending belongs to two programs."""
    from .ansys.read import is_input, read_input
    from .nastran import read_bdf

    return read_input(path) if is_input(path) else read_bdf(path)


def _read_inp(path: str, step: int | None = None) -> FileModel:
    """Read an input file of Abaqus or CalculiX; Ansys and Nastran have the ending, too."""
    with open(path, encoding="utf-8", errors="replace") as file:
        heads = [line.strip().upper() for line in islice(file, _HEAD)]
    if any(_ABAQUS.match(head) for head in heads) or not any(map(_OTHER.match, heads)):
        return _by("abaqus.read", "read_inp")(path, *(() if step is None else (step,)))
    if step is not None:
        raise MeshError("it is a file of Ansys or Nastran, of which no steps are read; leave [model] step out")
    return _read_dat(path)


READERS: dict[str, Callable[..., FileModel]] = {
    ".msh": _by("msh", "read_msh"),
    ".inp": _read_inp,
    ".cdb": _by("ansys.read", "read_cdb"),
    ".rst": _by("ansys.results", "read_rst"),
    **dict.fromkeys((".bdf", ".nas", ".fem"), _by("nastran", "read_bdf")),
    ".dat": _read_dat,
    ".op2": _by("nastran", "read_op2_model"),
    **dict.fromkeys((".e", ".exo", ".ex2"), _by("exodus", "read_exodus")),
    ".unv": _by("unv", "read_unv"),
    **dict.fromkeys(FORMATS, _by("via_meshio", "read_other")),
}


_OF_STEPS = (".inp",)  # files whose steps may be chosen

# results and databases of programs, and the file to write instead
_ADVICE = {
    **dict.fromkeys(
        (".rth", ".db", ".mechdb", ".wbpj"), "databases and thermal results of Ansys; write the archive: CDWRITE,DB,model,cdb"
    ),
    **dict.fromkeys((".odb", ".cae", ".sim", ".fil"), "results and databases of Abaqus; take the input file, .inp, of the job"),
    **dict.fromkeys((".frd", ".fbd"), "files of CalculiX' cgx; take the input file, .inp"),
    **dict.fromkeys(
        (".xdb", ".f06", ".h5", ".dball"), "results of Nastran; take its bulk data, .bdf, or its geometry in an .op2"
    ),
}


def read_model(path: str | os.PathLike[str], step: int | None = None) -> FileModel:
    """Return the content of a model file, with points and cells checked.  Local; to be called on rank 0 only.

    ``step`` is the number of the step whose supports, loads and temperatures are taken over; None: the first with a vibration.

    Raises
    ------
    MeshError, CaseError : one message with the file and the cause, also for a step that the file does not have
    """
    path = os.path.normpath(path)
    ending = os.path.splitext(path)[1].lower()
    if ending in _ADVICE:
        raise CaseError(f"[model] mesh: {path}: the ending {ending!r} is not read: {_ADVICE[ending]}")
    if ending not in READERS:
        cause = f"the ending {ending!r} is not known" if ending else "the name has no ending, which states the format"
        raise CaseError(f"[model] mesh: {path}: {cause}; known are {', '.join(READERS)}")
    if not os.path.isfile(path):
        raise CaseError(f"[model] mesh: there is no file {path}")
    if not os.path.getsize(path):
        raise MeshError(f"{path}: the file is empty")
    if step is not None and ending not in _OF_STEPS:
        raise CaseError(f"[model] step = {step}: {path}: of files {ending} no steps are read; leave step out")
    with open(path, "rb") as file:
        if file.read(len(_POINTER)) == _POINTER:
            raise MeshError(f"{path}: it is a pointer of Git LFS, without the file itself; fetch that: git lfs pull")
    try:
        with bounded_memory(path), np.errstate(all="ignore"):  # numbers are checked after reading
            model = READERS[ending](path) if step is None else READERS[ending](path, step)
        _check_points(model)
    except (MeshError, OSError) as problem:
        raise MeshError(f"{path}: {problem}") from None
    except (ValueError, IndexError, ArithmeticError) as problem:
        raise MeshError(f"{path}: the file is damaged, or not a mesh in the format of its ending ({problem})") from None
    return model


def _check_points(file: FileModel) -> None:
    """Raise MeshError unless every coordinate is finite and every cell's nodes exist."""
    bad = np.flatnonzero(~np.isfinite(file.points).all(axis=1))
    if len(bad):
        raise MeshError(
            f"{len(bad)} of {counted(len(file.points), 'node')} have a coordinate that is not a finite number, "
            f"the first is node {file.numbers[bad[0]]} at {place(file.points[bad[0]])}"
        )
    for cells in file.cells:
        outside = (cells.nodes < 0) | (cells.nodes >= len(file.points))
        if outside.any():
            number = cells.numbers[np.argmax(outside.any(axis=1))]
            raise MeshError(f"{cells.kind} element {number} names a node that the file does not hold")


@contextmanager
def bounded_memory(path: str) -> Iterator[None]:
    """Limit the memory that the block may allocate while it reads a file, by its size and the free memory.  Local.

    Libraries allocate by the counts in a file before they read the data.  No limit where the system does not offer one.

    Raises
    ------
    MeshError without the file's name : reading needs more memory
    """
    n_bytes = os.path.getsize(path)
    try:
        with _address_space(limit := bounded_by_machine(_FREE + _GAIN * n_bytes)):
            yield
    except MemoryError:
        text = f"it requests more than {gigabytes(limit)} of memory, the limit of a file of {n_bytes} bytes on this machine"
        raise MeshError(text) from None


@contextmanager
def _address_space(more: int) -> Iterator[None]:
    """Limit the address space of this process to its present size plus ``more`` bytes."""
    try:
        import resource

        with open("/proc/self/statm") as file:
            mapped = int(file.read().split()[0]) * resource.getpagesize()
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    except (ImportError, OSError, ValueError):
        yield
        return
    limit = mapped + more
    if soft != resource.RLIM_INFINITY and soft <= limit:
        yield
        return
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    try:
        yield
    finally:
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
