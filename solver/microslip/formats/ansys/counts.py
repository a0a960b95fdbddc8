"""Checks of the blocks of an archive: stated counts against content, and content against the library's reading."""

import re

import numpy as np

from ...messages.errors import MeshError
from .blocks import FIELDS, Blocks
from .commands import Command, numbers_after

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
