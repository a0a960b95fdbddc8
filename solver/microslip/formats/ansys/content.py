"""The content of the commands of an archive: types, materials, constants, constraints, and findings."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from ...messages.errors import MeshError
from ...messages.words import counted
from ...tables.joint import Joint
from ...tables.structure import Material
from ..draft import Draft
from ..model import index_of
from . import constraints as between
from .commands import Command
from .materials import OTHER_AXES, PLAIN, material_of, take_system

# commands that set up the program, select, solve or print; loads, which are counted
_HARMLESS = set(
    "FINISH DOF *IF *ELSE *ELSEIF *ENDIF *SET *DIM *GET *DO *ENDDO NUMOFF EXTOPT TYPE MAT REAL ESYS SECNUM SHPP N EN NBLOCK "
    "EBLOCK CMBLOCK CM CMGRP CMSEL ALLSEL ESEL NSEL RLBLOCK MPTEMP CSYS DSYS TREF TUNIF BFUNIF TOFFST ANTYPE "
    "MODOPT MXPAND MODCONTROL QRDOPT EQSLV HROPT HROUT HARFRQ KUSE TIME NCNV CRPLIM AUTOTS NSUBST DELTIM KBC OUTRES OUTPR "
    "NROPT CNVTOL LNSRCH NEQIT PRED NLGEOM SSTIF RESCONTROL ERESX SOLVE SAVE ALPHAD BETAD DMPRAT DMPSTR MDAMP IRLF CGLOC "
    "LSWRITE CDREAD CDOPT PSTRES WPSTYL SECDATA SECTYPE SECBLOCK SECCONTROL SECOFFSET SECJOINT SECLOCK SECSTOP SFBEAM "
    "MPDATAT DMPOPT DMPOPTION NLDIAG NLHIST CYCLIC CYCOPT CSCIR FC FCUM RSTSUPPRESS CMWRITE TINTP IOPTN".split()
)
_YIELDS = set("PLAS BISO BKIN MISO MKIN KINH NLIS CHAB CREE RATE HILL".split())  # first letters of TB
_OF_TABLE = ("TBDA", "TBTE", "TBPT", "TBFI", "TBIN", "TBLI")  # commands about the table of the TB before them
_LOADS = set("F SF SFE BF BFE FBLOCK SFBLOCK SFEBLOCK BFBLOCK BFEBLOCK ACEL OMEGA DOMEGA CGOMEGA DCGOMG CMACEL CMOMEGA".split())
_OF_STRUCTURE = set("ACEL OMEGA DOMEGA CGOMEGA DCGOMG".split())  # of the structure; CDWRITE writes them in any case
_ZERO = re.compile(r"(?:[+-]?0*\.?0+\.?(?:[ED][+-]?\d+)?)?", re.IGNORECASE)
_EFFECTS = {
    "EALIVE": "activated elements (birth)",
    "EKILL": "deactivated elements (death)",
    "PSMESH": "a bolt's pretension section; state [[statics.bolts]]",
    "SLOAD": "a bolt's load; state [[statics.bolts]]",
    "INISTATE": "stress before any load",
    "/INPUT": "a further file",
    "E": "elements defined one by one (springs, masses, remote points), which are not read; write the model by CDWRITE for them",
    "USE": "a macro that the file does not contain",
    "*USE": "a macro that the file does not contain",
}


@dataclass(eq=False)
class Content(Draft):
    """The structure so far, and the content of the commands."""

    angles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))  # (n_nodes, 3) angles of the nodal axes [degrees]
    types: dict[int, int] = field(default_factory=dict)  # ET: number of a type: number of its element
    keys: dict[int, dict[int, int]] = field(default_factory=dict)  # KEYOPT
    properties: dict[int, dict[str, float]] = field(default_factory=dict)  # properties of materials by label
    stated: dict[tuple[int, str], Command] = field(default_factory=dict)  # command that states a property of a material
    materials: dict[int, Material] = field(default_factory=dict)
    systems: dict[int, tuple[int, np.ndarray, np.ndarray]] = field(default_factory=dict)  # LOCAL: kind, origin, angles
    constants: dict[int, list[float]] = field(default_factory=dict)  # R, RMORE, RMODIF
    friction: dict[int, float] = field(default_factory=dict)  # MP,MU or TB,FRIC: coefficient by material, the first stated
    joints: list[Joint] = field(default_factory=list)  # contact pairs with a friction coefficient
    pilots: list[tuple[int, np.ndarray, str]] = field(default_factory=list)  # pilot nodes: number, positions of nodes, connection
    constraints: between.Restraints = field(default_factory=between.Restraints)
    loads: dict[str, int] = field(default_factory=dict)
    facts: tuple[str, ...] = ()  # title, units
    is_chosen: bool = False  # whether Ansys chooses KEYOPTs (ETCONTROL,SET)
    selected: np.ndarray | None = None  # nodes given by ALL; None: an unsupported selection

    def axes(self, node: int) -> np.ndarray | None:
        """Return the rotated axes of a node (position), (3, 3), or None for those of the model.  Local."""
        return between.turned_axes(self.angles[node]) if self.angles[node].any() else None

    def known(self, wanted: np.ndarray) -> np.ndarray:
        """Return the positions of the existing nodes."""
        index, missing = index_of(self.numbers, wanted)
        return index[~np.isin(wanted, missing)]


def take_commands(content: Content, commands_read: Iterable[Command], components: dict[str, np.ndarray]) -> None:
    """Take the commands of a file.  Local."""
    content.selected = content.numbers
    content.constraints.findings = content.findings
    last_real, friction_material = 0, 0
    for command in commands_read:
        word = command.word
        if word == "TB":
            friction_material = int(command.number(1)) if _is_friction(command) else 0
            if not friction_material:
                _pass_over_table(content, command)
        elif word.startswith(_OF_TABLE):
            if friction_material and word.startswith("TBDA") and command.number(0) == 1:
                _take_friction(content, friction_material, command, command.number(1))
        elif word == "ET":
            content.types[int(command.number(0))] = int("".join(c for c in command.field(1) if c.isdigit()) or 0)
            _take_keys(content, command, command.fields[2:8])
        elif word == "ETBLOCK":
            _take_types(content, command)
        elif word in ("NSEL", "NSLE", "CMSEL", "ALLSEL"):
            _select(content, command, components)
        elif word in ("KEYO", "KEYOP", "KEYOPT"):
            content.keys.setdefault(int(command.number(0)), {})[int(command.number(1))] = int(command.number(2))
        elif word in ("MP", "MPDATA"):
            _take_property(content, command)
        elif word == "LOCAL":
            take_system(content.systems, command)
        elif word in ("R", "RMORE"):
            last_real = int(command.number(0)) if word == "R" else last_real
            values = [command.number(i) for i in range(1 if word == "R" else 0, len(command.fields))]
            content.constants.setdefault(last_real, []).extend(values)
        elif word in ("RMOD", "RMODI", "RMODIF"):
            _change_constants(content, command)
        elif word == "D":
            between.take_support(content.constraints, command, content.selected, components)
        elif word == "CE":
            between.take_equation(content.constraints, command)
        elif word == "CP":
            between.take_coupling(content.constraints, command)
        elif word == "CERIG":
            between.take_rigid(content.constraints, command, content.selected, components)
        elif word == "/TITLE":
            content.facts += (f"title: {','.join(command.fields).strip()}",) if any(command.fields) else ()
        elif word == "ETCONTROL":
            content.is_chosen |= command.field(0).upper() == "SET"
        elif word == "/UNITS":
            content.facts += (f"units: {command.field(0)}, as stated in the file",)
        else:
            _pass_over(content, command)
    _make_materials(content)


def _is_friction(command: Command) -> bool:
    """Return whether a TB command begins a table of one isotropic friction coefficient."""
    return command.field(0).upper().startswith("FRIC") and command.field(4).upper() in ("", "ISO")


def _take_friction(content: Content, material: int, command: Command, value: float) -> None:
    """Take a friction coefficient; further ones of the material, of other temperatures, are findings."""
    known = content.friction.setdefault(material, value)
    if value != known:
        effect = f"friction coefficient of material {material} at further temperatures; new writes the first, {known:g}"
        content.findings.add(command.word, command.where, effect, False)


def _change_constants(content: Content, command: Command) -> None:
    """Take an RMODIF command: a set of constants, the position of the first new value, and the values."""
    known, first = content.constants.setdefault(int(command.number(0)), []), int(command.number(1)) - 1
    values = {first + i: command.number(2 + i) for i, word in enumerate(command.fields[2:8]) if word and first + i >= 0}
    known.extend([0.0] * (max(values, default=-1) + 1 - len(known)))
    for i, value in values.items():
        known[i] = value


def _make_materials(content: Content) -> None:
    """Make the materials from their properties, with a finding for each incomplete property of other axes."""
    for number, known in content.properties.items():
        content.materials[number], lacking = material_of(known)
        for label in lacking:
            command = content.stated[number, label]
            effect = f"{label} of material {number}: it is not isotropic, and E, PR or NU, and G of all axes are not stated"
            content.findings.add(command.word, command.where, effect, part="materials")


def _take_keys(content: Content, command: Command, fields: tuple[str, ...]) -> None:
    """Take the KEYOPTs 1 to 6 of an ET command."""
    shifted = Command(command.word, fields, command.line)
    known = content.keys.setdefault(int(command.number(0)), {})
    known.update({i + 1: int(shifted.number(i)) for i, word in enumerate(fields) if word})


def _take_types(content: Content, command: Command) -> None:
    """Take a block of types: number, element, KEYOPTs 1 to 18 in fields of one width."""
    for i, line in enumerate(command.block):
        words = line.split()
        if len(words) < 2 or not all(word.lstrip("-").isdigit() for word in words):
            raise MeshError(f"line {command.line + 2 + i}: ETBLOCK holds {line.strip()[:60]!r} where whole numbers are expected")
        number, element, *keys = map(int, words)
        content.types[number] = element
        content.keys.setdefault(number, {}).update({key: value for key, value in enumerate(keys[:18], 1) if value})


def _select(content: Content, command: Command, components: dict[str, np.ndarray]) -> None:
    """Update the nodes given by ALL: all nodes, or the nodes of one component."""
    how, name = command.field(0).upper(), command.field(1).upper()
    if command.word == "ALLSEL" or (command.word == "NSEL" and how in ("", "ALL")):
        content.selected = content.numbers
    elif command.word in ("NSEL", "NSLE"):
        content.selected = None
    elif name in components or how != "S":
        content.selected = components.get(name) if how == "S" else None


def _take_property(content: Content, command: Command) -> None:
    """Take MP (label, material, value) or MPDATA (R5.0, 1, label, material, position, value)."""
    i = 2 if command.word == "MPDATA" and command.is_archived else 0
    label = command.field(i).upper()
    if label in ("UVID", "UMID"):  # names of Workbench's materials
        return
    number, position = int(command.number(i + 1)), command.number(i + 2)
    first = i + 3 if command.word == "MPDATA" else i + 2
    value = command.number(first)
    if label == "MU":
        _take_friction(content, number, command, value)
        return
    known = content.properties.setdefault(number, {})
    where, part = command.where, "materials"
    is_taken = label in (*PLAIN, *OTHER_AXES)
    if label == "REFT" or (is_taken and command.word == "MPDATA" and position > 1):
        changes = is_taken and known.get(label, value) != value
        effect = f"{label} of material {number} at further temperatures"
        content.findings.add(command.word, where, effect, changes, part)
    elif is_taken:
        known[label] = value
        content.stated[number, label] = command
        further = [command.number(k) for k in range(first + 1, len(command.fields)) if command.field(k)]
        if any(further) if command.word == "MP" else any(other != value for other in further):
            at = "0" if command.word == "MP" else "its first temperature"
            effect = f"{label} of material {number} depends on the temperature; its value at {at} would be taken"
            content.findings.add(command.word, where, effect, part=part)
    elif label in ("DMPR", "BETD", "ALPD", "DMPS"):
        effect = f"damping of material {number}; state [damping]"
        content.findings.add(command.word, where, effect, False, part)


def _pass_over(content: Content, command: Command) -> None:
    """Add a finding of a command that is not taken over."""
    word = command.word
    if word == "EBLOCK" and command.field(1).upper() != "SOLID":
        effect = "a block in the format of elements that are not solids, which is not read"
        content.findings.add(word, command.where, effect)
    elif word in _OF_STRUCTURE and all(map(_ZERO.fullmatch, command.fields)):
        return
    elif word in _LOADS:
        content.loads[word] = content.loads.get(word, 0) + 1
    elif word in _HARMLESS or "=" in word or "(" in word or (word.startswith("/") and word != "/INPUT"):
        return
    else:
        content.findings.add(word, command.where, _EFFECTS.get(word, "not known to this program"))


def _pass_over_table(content: Content, command: Command) -> None:
    """Add a finding of a TB command that is not taken over."""
    label, number = command.field(0).upper()[:4], int(command.number(1))
    if label in _YIELDS:
        effect = f"{label} of material {number}: it yields or creeps in Ansys, and is elastic here"
        content.findings.add("TB", command.where, effect, False, "materials")
    else:
        effect = f"{label} of material {number}, which is not taken over"
        content.findings.add("TB", command.where, effect, part="materials")


def report_loads(content: Content) -> None:
    """Add a finding, without effect on the answer, for each kind of load: the scene states the loads.  Local."""
    for word, n in content.loads.items():
        content.findings.add(word, counted(n, "command"), "loads of the file are not taken over; state [[loads]]", False)
