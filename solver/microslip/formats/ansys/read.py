"""Read an Ansys archive or input file: its blocks and commands."""

import os
import re
from itertools import islice

import numpy as np

from ...messages.errors import MeshError
from ...system.sandbox import LibraryError, SandboxError, read_file
from ..model import FileModel, Group
from .attached import take_attached, take_rigid_regions
from .blocks import FIELDS, Blocks, blocks_of_library, blocks_of_text
from .commands import Command, as_archived, commands, numbers_after
from .constraints import take_constraints
from .content import Content, report_loads, take_commands
from .cyclic import sectors_of
from .elements import cells_and_bodies
from .pages import without_pages

_LEAST_BYTES = 8  # least bytes of a node or an element in an archive
_STARTS = ("/BATCH", "/COM", "/PREP7", "/TITLE", "/UNITS", "/WB", "NBLOCK,")  # lines near the beginning of an input file
_MAKE_MESHES = set(  # first letters, as compared by Ansys, of commands for geometry, meshes, nodes and elements
    "K KGEN KFIL L LARC LSTR LGEN A AL AGEN AROT V VA VGEN VDRA VROT VEXT BLOC BLC4 BLC5 CYL4 CYL5 CYLI RECT PCIR "
    "SPHE SPH4 CONE PRIS TORU VSWE VMES AMES LMES KMES AMAP VMAP N NGEN NDIS NSYM FILL E EN EGEN EMOR EINT".split()
)
_HEAD = 200  # lines searched for them
_GAIN = 200  # bytes of memory per byte of the file
_LONG_EXPONENT = re.compile(rb"[EeDd][+-]?[0-9]{4,}")
_DIGITS = tuple(bytes([byte]) for byte in b"0123456789+-.")


@without_pages
def read_cdb(path: str) -> FileModel:
    """Read an archive of CDWRITE: solids by material and type, components, supports, equations.  Local.

    Raises
    ------
    MeshError without the file's name: damaged, or shapes that are no solids here
    """
    commands_read = tuple(commands(path))
    _check_counts(path, commands_read)
    _refuse_exponents(path)
    blocks = _archive(path)
    check_counts(path, commands_read, blocks)
    return model_of(blocks, commands_read)


@without_pages
def read_input(path: str) -> FileModel:
    """Read an input file as Workbench writes it (ds.dat): in addition, elements in blocks of surfaces.  Local.

    Raises
    ------
    MeshError without the file's name: damaged, or shapes that are no solids here
    """
    given = tuple(commands(path))
    _refuse_scripts(given)
    commands_read = tuple(as_archived(given))
    with open(path, encoding="utf-8", errors="replace") as file:
        blocks = blocks_of_text(file.read().splitlines())
    return model_of(blocks, commands_read)


def _refuse_scripts(commands_read: tuple[Command, ...]) -> None:
    """Raise MeshError if the file has no mesh, with the commands that would generate one."""
    words = list(dict.fromkeys(command.word for command in commands_read))
    if {"NBLOCK", "EBLOCK"} & set(words):
        return
    made_by = ", ".join([word for word in words if word[:4] in _MAKE_MESHES and "=" not in word][:4])
    but = f" but commands that make one when Ansys runs them ({made_by})" if made_by else ""
    raise MeshError(f"it holds no mesh (NBLOCK, EBLOCK){but}; write the mesh in Ansys by CDWRITE,DB,NAME,cdb and take that file")


def is_input(path: str) -> bool:
    """Return whether a file is an Ansys input file, not a file of another program with the same ending.  Local."""
    with open(path, encoding="utf-8", errors="replace") as file:
        return any(line.strip().upper().startswith(_STARTS) for line in islice(file, _HEAD))


def model_of(blocks: Blocks, commands_read: tuple[Command, ...]) -> FileModel:
    """Return the model from blocks and commands.  Local."""
    _refuse_doubles(blocks.numbers)
    content = Content(blocks.numbers, blocks.points, angles=blocks.angles)
    take_commands(content, commands_read, {name.upper(): nodes for name, nodes in blocks.node_components.items()})
    for number, keys in blocks.keys.items():
        content.keys.setdefault(number, {}).update(keys)
    cells, bodies, orientations = cells_and_bodies(blocks, content)
    for name, members in blocks.element_components.items():
        content.groups.setdefault(name, Group()).add_elements(cells, members)
    for name, members in blocks.node_components.items():
        content.group(name, content.known(members))
    content.mark_solids(cells)
    take_rigid_regions(content)
    take_attached(blocks, content)
    take_constraints(content.constraints, content)
    cyclic = sectors_of(content, commands_read)
    report_loads(content)
    materials = {f"material {number}": material for number, material in content.materials.items()}
    return content.model(
        cells,
        materials=materials,
        orientations=orientations,
        bodies=bodies,
        cyclic=cyclic,
        joints=tuple(content.joints),
        facts=content.facts,
    )


def _archive(path: str) -> Blocks:
    try:
        return read_file(path, blocks_of_library, path, gain=_GAIN, returns=(Blocks,))
    except SandboxError as problem:
        raise MeshError(f"it is truncated or damaged: {problem}") from None
    except LibraryError as problem:
        raise MeshError(
            f"it cannot be read as an Ansys archive; it is truncated, damaged or another format ({problem})"
        ) from None


def _check_counts(path: str, commands_read: tuple[Command, ...]) -> None:
    """Raise MeshError for a missing block or a count beyond the file size, before memory is allocated for it."""
    size, lacking = os.path.getsize(path), {"NBLOCK", "EBLOCK"}
    for command in commands_read:
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
    """Raise MeshError for exponents of four and more digits, for which the library loops too long."""
    with open(path, "rb") as file:
        content = file.read()
    for exponent in _LONG_EXPONENT.finditer(content):
        start = content.rfind(b"\n", 0, exponent.start()) + 1
        if content[start : exponent.start()].lstrip()[:1] in _DIGITS:
            line = content.count(b"\n", 0, start) + 1
            raise MeshError(f"line {line}: {exponent[0].decode('ascii')!r} is not part of a number; the file is damaged")


def _refuse_short_lines(path: str, command: Command) -> None:
    """Raise MeshError for nodes with only a number before their coordinates, which the library misreads."""
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


_BLANK = re.compile(rb"\n[ \t\r]*(?=\n)")
_FIRST_LINE = 8  # nodes of an element on its first line of 19 fields


def check_counts(path: str, commands_read: tuple[Command, ...], blocks: Blocks) -> None:
    """Raise unless the blocks have their stated lengths and were read to their ends.  Local.

    Raises
    ------
    MeshError : a truncated block, or a count that differs from the content
    """
    with open(path, "rb") as file:
        content = file.read()
    heads = [command for command in commands_read if command.word == "EBLOCK"]
    n_lines = 0  # lines of elements in all blocks
    for command in commands_read:
        if command.word == "CMBLOCK":
            _check_component(command, numbers_after(content, command))
        elif command.word == "NBLOCK":
            _check(command, _n_lines(numbers_after(content, command)), "nodes")
        elif command.word == "EBLOCK" and _is_solid(command):
            block = numbers_after(content, command)
            if not block.endswith(b"-1"):
                raise MeshError(f"{command.where}: the EBLOCK ends without -1; the file is truncated or damaged")
            n_lines += _n_lines(block)
    if all(_is_solid(command) for command in heads):
        _check_elements(heads, n_lines, blocks)


def _is_solid(command: Command) -> bool:
    """Return whether the elements of a block are in the format of solids, the only one that is read."""
    return command.field(1).upper() == "SOLID"


def _check_component(command: Command, block: bytes) -> None:
    n_numbers, count = len(block.split()), command.field(2)
    if count.isdigit() and int(count) != n_numbers:
        raise MeshError(
            f"{command.where}: CMBLOCK {command.field(0)} counts {count} numbers and holds {n_numbers}; "
            "the file is truncated or damaged"
        )


def _check(command: Command, n_read: int, what: str) -> None:
    """Raise MeshError if the last field of a block, its count, differs from ``n_read``."""
    count = command.field(len(command.fields) - 1)
    if len(command.fields) > 3 and count.isdigit() and int(count) != n_read:
        raise MeshError(
            f"{command.where}: {command.word} counts {count} {what} and holds {n_read}; the file is truncated or damaged"
        )


def _check_elements(heads: list[Command], n_lines: int, blocks: Blocks) -> None:
    """Raise unless the elements that were read match the lines and the counts of the blocks."""
    n_nodes = np.diff(blocks.start) - FIELDS
    n_read = int((1 + (n_nodes > _FIRST_LINE)).sum())
    if heads and n_read != n_lines:
        raise MeshError(
            f"{heads[0].where}: EBLOCK holds {n_lines} lines, and {n_read} make the {len(n_nodes)} elements that it counts; "
            "the file is damaged"
        )
    if len(heads) == 1:
        _check(heads[0], len(n_nodes), "elements")


def _n_lines(block: bytes) -> int:
    """Return the number of lines with numbers, without the final -1."""
    block = block.removesuffix(b"-1").strip()
    return block.count(b"\n") + 1 - len(_BLANK.findall(block)) if block else 0
