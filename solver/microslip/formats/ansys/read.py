"""Read an Ansys archive: mapdl-archive reads its blocks, the commands between them say what they mean."""

from __future__ import annotations

import os
import re
from itertools import islice
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...parallel.apart import Died, read_apart
from ...parallel.errors import MeshError
from ..model import FileMaterial, FileModel, Group
from . import constraints as between
from .attached import attached, known_nodes, nodes_of_solids, rigid_regions
from .commands import Command, commands
from .content import findings_of_loads, gather
from .elements import add_elements, cells_and_bodies

_LEAST_BYTES = 8  # of a node or an element in an archive
_GAIN = 200  # bytes of memory for a byte of the file
# of mapdl-archive, which writes beyond its arrays where a file is damaged
_TAKEN = (
    "nnum nodes n_elem enum ekey _elem _elem_off node_components element_components key_option node_angles rlblock rlblock_num"
).split()
_LONG_EXPONENT = re.compile(rb"[EeDd][+-]?[0-9]{4,}")
_DIGITS = tuple(bytes([byte]) for byte in b"0123456789+-.")


def read_cdb(path: str) -> FileModel:
    """Return what an archive of CDWRITE holds: solids by material and type, components, supports, equations.  Local.

    Raises
    ------
    MeshError without the file's name: damaged, or shapes that are no solids here
    """
    said = tuple(commands(path))
    _check_counts(path, said)
    _refuse_exponents(path)
    archive = _archive(path)
    if archive.nnum is None or not len(archive.nnum) or not archive.n_elem:
        raise MeshError("its NBLOCK or EBLOCK is empty or damaged")
    numbers, points = np.asarray(archive.nnum, dtype=np.int64), np.asarray(archive.nodes, dtype=float)[:, :3]
    _refuse_doubles(numbers)
    components = {name.upper(): np.asarray(nodes, dtype=np.int64) for name, nodes in archive.node_components.items()}
    content = gather(said, numbers, components)
    for number, keys in archive.key_option.items():
        content.keys.setdefault(int(number), {}).update({int(key): int(value) for key, value in keys})
    groups: dict[str, Group] = {}
    cells, bodies = cells_and_bodies(archive, content, numbers, groups)
    for name, own in archive.element_components.items():
        add_elements(groups.setdefault(name, Group()), cells, np.asarray(own))
    for name, own in archive.node_components.items():
        groups.setdefault(name, Group()).add_nodes(known_nodes(numbers, np.asarray(own)))
    angles = np.zeros((len(numbers), 3)) if archive.node_angles is None else np.asarray(archive.node_angles, dtype=float)
    of_solids = nodes_of_solids(cells, len(numbers))
    leading = rigid_regions(content, numbers, points, groups, of_solids)
    leaders = {node: point.name for node, point in leading.items()}
    supports = between.supports(content.constraints, numbers, angles, groups, leaders)
    masses, springs = attached(archive, content, numbers, groups, leading)
    outside = set(leaders) - set(numbers[of_solids].tolist())
    equations = between.equations(content.constraints, numbers, angles, outside)
    findings = [*content.findings, *content.constraints.findings]
    return FileModel(
        points,
        numbers,
        tuple(cells),
        groups,
        materials={f"material {number}": FileMaterial(**known) for number, known in content.materials.items()},
        bodies=bodies,
        supports=supports,
        connected=tuple(leading.values()),
        masses=masses,
        springs=springs,
        equations=equations,
        findings=tuple(findings) + findings_of_loads(content),
        facts=(f"title: {content.title}",) if content.title else (),
    )


def _archive(path: str) -> Any:
    try:
        import mapdl_archive
    except ImportError:
        raise MeshError("Ansys archives are read by mapdl-archive; install it: pip install mapdl-archive") from None
    try:
        return read_apart(path, _parts, mapdl_archive, path, gain=_GAIN)
    except Died as problem:
        raise MeshError(f"it is truncated or damaged: {problem}") from None
    except (RuntimeError, ValueError, IndexError, OverflowError, MemoryError) as problem:
        raise MeshError(
            f"it cannot be read as an Ansys archive; it is truncated, damaged or another format ({problem})"
        ) from None


def _parts(library: Any, path: str) -> SimpleNamespace:
    """Return what the library has read."""
    archive = library.Archive(path, parse_vtk=False)
    return SimpleNamespace(**{name: _plain(getattr(archive, name)) for name in _TAKEN})


def _plain(value: Any) -> Any:
    """Return arrays, and dicts and lists of them, without what the library has around them."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return np.array(value) if isinstance(value, np.ndarray) else value


def _check_counts(path: str, said: tuple[Command, ...]) -> None:
    """Raise MeshError where a block lacks, or counts more than the file can hold, before anything is allocated by it."""
    size, lacking = os.path.getsize(path), {"NBLOCK", "EBLOCK"}
    for command in said:
        lacking.discard(command.word)
        if command.word == "NBLOCK" and command.field(1).upper() != "SOLID":
            _refuse_short_lines(path, command)
        if command.word in ("NBLOCK", "EBLOCK", "CMBLOCK") and command.fields:
            count = command.fields[-1] if command.word != "CMBLOCK" else command.field(2)
            if count.isdigit() and int(count) * _LEAST_BYTES > size:
                raise MeshError(f"{command.where}: {command.word} counts {count}, more than a file of {size} bytes holds")
    if lacking:
        raise MeshError("the file holds no NBLOCK and EBLOCK that this program reads")


def _refuse_exponents(path: str) -> None:
    """Raise MeshError for an exponent of four digits and more, for which the library multiplies by ten so often."""
    with open(path, "rb") as file:
        content = file.read()
    for found in _LONG_EXPONENT.finditer(content):
        start = content.rfind(b"\n", 0, found.start()) + 1
        if content[start : found.start()].lstrip()[:1] in _DIGITS:
            line = content.count(b"\n", 0, start) + 1
            raise MeshError(f"line {line}: {found[0].decode('ascii')!r} is part of no number; the file is damaged")


def _refuse_short_lines(path: str, command: Command) -> None:
    """Raise MeshError for nodes with a number alone before their coordinates, which the library takes for something else."""
    with open(path, encoding="utf-8", errors="replace") as file:
        form = next(islice(file, command.line, None), "").strip()
    if form.lower().startswith(("(i", "(1i")):
        raise MeshError(
            f"{command.where}: NBLOCK in the format {form}, that of Workbench's input files, is not read; write it by CDWRITE"
        )


def _refuse_doubles(numbers: np.ndarray) -> None:
    unique, counts = np.unique(numbers, return_counts=True)
    if (counts > 1).any():
        raise MeshError(f"NBLOCK gives node number {unique[counts > 1][0]} more than once")
