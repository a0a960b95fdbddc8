"""What a structure given as matrices is made of, as plain values in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..mesh.settings import Joint, Load, Output


@dataclass(frozen=True, kw_only=True)
class PairFile:
    """A joint whose pairs a CSV file lists."""

    name: str
    file: Path
    separate: bool = False  # each tangential direction has its own friction limit
    law: str = "elastic-coulomb"  # of contact/laws.py
    keys: Mapping[str, Any] = field(default_factory=dict)  # of the law, beside the columns of the file


@dataclass(frozen=True, kw_only=True)
class MatrixSettings:
    """A structure given as matrices; DOFs count from 0."""

    files: Mapping[str, Path]  # of "stiffness", "mass" and, where there is one, "damping", "recovery"
    names: Mapping[str, str] = field(default_factory=dict)  # of matrices in files of several, where they are stated
    dofs: Path | None = None  # node and direction of each row
    nodes: Path | None = None  # where the nodes are: a table or a mesh
    recovery_dofs: Path | None = None  # node and direction of each row of the recovery matrix
    joints: tuple[PairFile | Joint, ...] = ()  # by DOFs; by nodes
    loads: tuple[Load, ...] = ()
    outputs: tuple[Output, ...] = ()
    where: str = ""  # the scene file, for messages
