"""Convert commands of an input file to commands of an archive: parameters replaced, words in full, set-up omitted."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace

from .commands import Command

# words of archives that may be abbreviated: Ansys compares the first four letters
_ABBREVIATED = "ALLSEL CERIG CMSEL CYCLIC EALIVE EKILL ETCONTROL INISTATE KEYOPT MPDATA PSMESH RMODIF"
# blocks; further commands that select elements, set up a solution, print or write
_SET_UP = (
    "ANTYPE AUTOTS CMBLOCK CMDELE CNCHECK CNTR CNVTOL CEWRITE DELTIM DMPOPTION EBLOCK EQSLV ERESX ESLL ESLN FINISH FCUM HROPT "
    "KEYW MAGOPT MCHECK MODOPT MXPAND NBLOCK NLDIAG NLGEOM NLHIST NSLL NSUBST OUTGEOM OUTPR OUTRES RESCONTROL SELTOL SOLCONTROL "
    "SOLVE TIMINT TRNOPT XMLO *ASK *CFCLOSE *CFOPEN *LIST *MSG *VGET *VWRITE"
)
_IN_FULL = {word[:4]: word for word in _ABBREVIATED.split()}
_SKIPPED = {word[:4] for word in _SET_UP.split()}
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([ED][-+]?\d+)?\Z", re.IGNORECASE)
_ASSIGNED = re.compile(r"([A-Z_]\w*)\s*=\s*(\S+)\Z")


def as_archived(commands_read: Iterable[Command]) -> Iterator[Command]:
    """Yield commands with parameters (*SET, name = value) replaced by their numbers and words in full.  Local.

    Elements that are defined one by one become one command E.
    """
    known: dict[str, str] = {}
    has_elements = False
    for command in commands_read:
        fields = tuple(known.get(field.upper(), field) for field in command.fields)
        assigned = _ASSIGNED.match(command.word)
        if assigned or command.word == "*SET":
            name, value = assigned.groups() if assigned else (fields + ("", ""))[:2]
            _set_parameter(known, name.upper(), known.get(value.upper(), value))
        elif command.word in ("E", "EN", "EMORE"):
            if not has_elements:
                yield replace(command, word="E", fields=fields)
            has_elements = True
        elif command.word[:4] not in _SKIPPED:
            word = _IN_FULL.get(command.word[:4], command.word)
            yield replace(command, word=word, fields=fields)


def _set_parameter(known: dict[str, str], name: str, value: str) -> None:
    """Store the number of a parameter; remove the parameter if its new value is not a number."""
    known.pop(name, None)
    if _NUMBER.match(value):
        known[name] = value
