"""The command line of a mesh generator: an option for each field of a dataclass, with its description."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import field, fields
from typing import Any

from blocks import Body
from msh import summary, write_msh

Contacts = list[tuple[str, str]]  # pairs of surfaces whose nodes coincide


def option(default, text: str, choices: Sequence | None = None):
    """Return a field of a dataclass with its help text."""
    return field(default=default, metadata={"help": text, "choices": choices})


def parser_of(doc: str, written: str) -> argparse.ArgumentParser:
    """Return a parser with the first line of a generator's docstring, and the file that is ``written``."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0], formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--out", required=True, help=f"file to write, {written}")
    return parser


def add_options(parser, kind: type, has_defaults: bool = True) -> None:
    """Add an option for each field of a dataclass, with its default unless that depends on others."""
    for item in fields(kind):
        parser.add_argument(
            "--" + item.name.replace("_", "-"),
            type=type(item.default),
            default=item.default if has_defaults else argparse.SUPPRESS,
            **item.metadata,
        )


def named(given: dict[str, Any], kind: type) -> dict[str, Any]:
    """Return the given options that are fields of a dataclass."""
    return {item.name: given[item.name] for item in fields(kind) if item.name in given}


def generate(
    doc: str, kind: type, make: Callable, contacts: Callable[[Any], Contacts] = lambda parameters: [], arguments=None
) -> None:
    """Write the requested Gmsh mesh and print a summary.

    ``make`` returns the bodies for a value of the dataclass ``kind``; ``contacts`` its matching surfaces.
    """
    parser = parser_of(doc, "Gmsh format 2.2")
    parser.add_argument("--ascii", action="store_true", help="write text instead of binary")
    add_options(parser, kind)
    given = vars(parser.parse_args(arguments))
    parameters = kind(**named(given, kind))
    write(parser, given, lambda: make(parameters), contacts(parameters))


def write(
    parser: argparse.ArgumentParser, given: dict[str, Any], make: Callable[[], dict[str, Body]], contacts: Contacts
) -> None:
    """Write the bodies that ``make`` returns and print a summary; exit with status 2 if the parameters are not valid."""
    try:
        bodies = make()
        write_msh(given["out"], bodies, binary=not given["ascii"])
    except (ValueError, OSError) as problem:
        parser.exit(2, f"{parser.prog}: {problem}\n")
    print(f"{given['out']}\n{summary(bodies, contacts)}")
