"""Read Nastran bulk data: pyNastran reads the cards, and this module assembles the structure."""

import contextlib
import io
import re
import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ...messages.errors import Interrupted, MeshError
from ...messages.words import counted
from ...tables.structure import Body, Orientation
from ..draft import cells_of
from ..includes import Includes, place
from ..model import KINDS, Cells, FileModel, Finding, Group, names_of_tags
from .cards import EFFECTS, HARMLESS, PARTS, SHELLS
from .connections import take_connections
from .content import Content
from .materials import axes_of, materials, name_of
from .plain import Plain, Solids, none_plain, take_plain
from .supports import take_equations, take_supports

# references between cards that are not needed
_OTHER_REFERENCES = "elements nodes_with_elements properties masses materials loads constraints aero sets optimization".split()
_RANGE = re.compile(r"\b(\d{1,18})[\s,+*]+THRU[\s,+*]+(\d{1,18})\b", re.IGNORECASE)
_BEGIN = re.compile(r"^([^\S\n]*BEGIN[^\S\n]+BULK.*)$", re.MULTILINE | re.IGNORECASE)
_CASE = re.compile(  # OptiStruct's case control that is read; a set continues after a comma
    r"^[^\S\n]*(?:(?:SUBCASE|SPC|MPC)\b.*|SET\s+\d+\s*=(?:.*,[^\S\n]*\n)*.*)$", re.MULTILINE | re.IGNORECASE
)
_END = re.compile(rb"^[^\S\n]*ENDDATA", re.MULTILINE | re.IGNORECASE)
_PLACES = {  # of components
    "GRID": (56,),
    "GRDSET": (56,),
    "SPC1": (16,),
    "SPC": (24, 48),
    "RBE2": (24,),
    "RBE3": (32,),
    "MPC": (24, 48),
}
_COMPONENTS = re.compile(r"^(GRID|GRDSET|SPC1|SPC|RBE2|RBE3|MPC)\b(?=[^,*\t\n]*$).*[1-6] +[1-6].*$", re.MULTILINE | re.IGNORECASE)
_LONGEST_RANGE = 2**22  # numbers of a range that any file may have
_SOLIDS = {"CTETRA": "tet", "CPENTA": "wedge", "CHEXA": "hex", "CPYRAM": "pyramid"}
_ORDER = {  # Nastran writes the mid-side nodes of vertical edges before the mid-side nodes of the top
    "hex20": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15],
    "wedge15": [*range(9), 12, 13, 14, 9, 10, 11],
}
_EIGENVALUES = ("EIGB", "EIGC", "EIGP", "EIGR", "EIGRL")  # cards that select Nastran's eigensolver
_PARAMETERS = re.compile(r"^PARAM(?![\s,]*WTMASS)\b[^\n]*\n", re.MULTILINE | re.IGNORECASE)  # without effect on the structure


def read_bdf(path: str) -> FileModel:
    """Read bulk data: solids by property, sets, supports, rigid elements, masses, springs, equations.  Local.

    Groups are the properties by their numbers ("7"), and the sets of the case control ("SET 5").

    Raises
    ------
    MeshError without the file's name: the file is damaged, or an included file is missing or outside its folder
    """
    includes = Includes(path)
    text = _text(includes, includes.path)
    plain, cards = _plain_and_others(text)
    if not (cards.nodes or len(plain.numbers)) or not (cards.elements or plain.solids):
        others = ", ".join(f"{n} {card}" for card, n in cards.card_count.items() if card in EFFECTS and card.startswith("C"))
        raise MeshError(f"the file holds no grid points and elements that this program reads{others and f' ({others})'}")
    model = model_of(plain, cards)
    if b"ENDDATA" not in text and _END.search(text) is None:
        effect = "it is missing: the file may be truncated"
        model = replace(
            model, findings=(*model.findings, Finding(word="ENDDATA", where="the last line", effect=effect, changes=False))
        )
    return model


def model_of(plain: Plain, cards: Any) -> FileModel:
    """Return the model from the plain cards and the cards read by pyNastran.  Local.

    Raises
    ------
    MeshError : grid points that do not exist, elements that lack some of their mid-side nodes
    """
    numbers = np.concatenate([plain.numbers, np.array(list(cards.nodes), dtype=np.int64)])
    other_positions = np.array([node.get_position() for node in cards.nodes.values()], dtype=float).reshape(-1, 3)
    order = np.argsort(numbers)
    content = Content(numbers[order], np.concatenate([plain.points, other_positions])[order], cards=cards)
    orientations: dict[str, Orientation] = {}
    cells, bodies = _cells_and_bodies(content, plain.solids, orientations)
    content.mark_solids(cells)
    _take_sets(content)
    take_connections(content)
    take_supports(content)
    take_equations(content)
    stated = materials(content)
    _report(content)
    return content.model(cells, materials=stated, orientations=orientations, bodies=bodies)


def _plain_and_others(text: bytes) -> tuple[Plain, Any]:
    """Return the plain cards of a file, and the other cards as read by pyNastran."""
    plain = take_plain(text)
    cards = cards_of(plain.rest)
    if plain.meets(cards.nodes, cards.elements):  # a repeated number: pyNastran reports its place
        plain = none_plain(text)
        cards = cards_of(plain.rest)
    return plain, cards


def cards_of(text: str) -> Any:
    """Return the cards of bulk data read by pyNastran, with or without executive and case control.  Local.

    Raises
    ------
    MeshError : pyNastran is missing or cannot read the text
    """
    try:
        with restored_streams():
            from pyNastran.bdf.bdf import BDF
    except ImportError:
        raise MeshError("Nastran bulk data is read by pyNastran; install it: pip install pyNastran") from None
    if not text.strip():
        raise MeshError("the file is empty")
    _refuse_endless_ranges(text)
    source, is_whole = _source(_without_blanks(_PARAMETERS.sub("", text)))
    cards = BDF(debug=None)
    # counted, not parsed: the fields of these cards differ between programs
    cards.disable_cards(("DEFUSET", "LOAD", *_EIGENVALUES, *(EFFECTS.keys() - {"DMIG"})))
    with read_by_pynastran("Nastran bulk data"):
        cards.read_bdf(source, xref=False, punch=not is_whole, validate=False)
        follow_references(cards)
    return cards


def _without_blanks(text: str) -> str:
    """Return bulk data whose components in fixed fields, as "12 456", are written together, as pyNastran requires."""
    return _COMPONENTS.sub(_joined, text)


def _joined(card: re.Match[str]) -> str:
    """Return a line with its components joined."""
    line = card[0]
    for first in _PLACES[card[1].upper()]:
        field = line[first : first + 8]
        if re.fullmatch(r" *[1-6]+(?: +[1-6]+)+ *", field):
            line = line[:first] + field.replace(" ", "").ljust(8) + line[first + 8 :]
    return line


@contextlib.contextmanager
def restored_streams() -> Iterator[None]:
    """Preserve standard output and error while pyNastran is imported.  Local.

    On terminals (Open MPI's ranks have one) pyNastran's logger replaces both streams by colorama's, which append an escape
    sequence to every later output of the program and at its exit.
    """
    streams = sys.stdout, sys.stderr
    with contextlib.suppress(ImportError):
        from colorama import initialise  # type: ignore[import-untyped]

        initialise.atexit_done = True
    try:
        yield
    finally:
        sys.stdout, sys.stderr = streams


@contextlib.contextmanager
def read_by_pynastran(what: str, advice: str = "") -> Iterator[None]:
    """Silence pyNastran while it reads ``what``; any of its exceptions becomes a MeshError.  Local."""
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (Interrupted, KeyboardInterrupt, MemoryError):
        raise
    except BaseException as problem:  # pyNastran raises many types of errors and sometimes exits
        text = " ".join(str(problem).split()) or type(problem).__name__
        cause = f"it is truncated, damaged or another format ({text[:200]})"
        raise MeshError(f"it cannot be read as {what}; {cause}{advice}") from None


def _refuse_endless_ranges(text: str) -> None:
    """Refuse "1 THRU 999999999": pyNastran would store every number of the range.  Local.

    Raises
    ------
    MeshError : more numbers than a file of this size can have grid points or elements
    """
    for first, last in _RANGE.findall(text):
        if int(last) - int(first) > _LONGEST_RANGE + len(text):
            raise MeshError(
                f"{first} THRU {last} requests more memory than a file of {len(text)} characters can need; "
                "end the range at the last existing number"
            )


def follow_references(cards: Any) -> None:
    """Let pyNastran resolve the references that are needed here: those to coordinate systems.  Local."""
    cards.cross_reference(xref=True, **{f"xref_{name}": False for name in _OTHER_REFERENCES})


def _source(text: str) -> tuple[Any, bool]:
    """Return the text for pyNastran, and whether it has an executive and a case control.

    Gmsh writes only bulk data, with or without BEGIN BULK; meshio appends a slash to the names of quadratic elements.
    OptiStruct has no CEND and its own keywords before the bulk data; it selects supports, equations and sets as Nastran does.
    """
    if re.search(r"^[^\S\n]*CEND", text, re.MULTILINE | re.IGNORECASE):
        return io.StringIO(text), True
    head, begin, bulk = _BEGIN.split(text, maxsplit=1) if _BEGIN.search(text) else ("", "", text)
    chosen = "\n".join(match[0] for match in _CASE.finditer(head))
    if chosen:
        return io.StringIO(f"SOL 103\nCEND\n{chosen}\n{begin}{bulk}"), True
    text = bulk if begin else text
    text = re.sub(r"^(CHEXA|CTETRA|CPENTA)_", r"\1 ", text, flags=re.MULTILINE)
    return io.StringIO(re.sub(r"^CPYRA_", "CPYRAM", text, flags=re.MULTILINE)), False


def _text(includes: Includes, path: str, within: tuple[str, ...] = ()) -> bytes:
    """Return the text of a file with its included files inserted.  Raises MeshError: as in ``Includes``."""
    content = includes.read(path)
    if b"INCLUDE" not in content.upper():
        return content
    lines = content.splitlines(keepends=True)
    for i, line in enumerate(lines):
        if line.lstrip()[:7].upper() == b"INCLUDE":
            name = line.decode("utf-8", "replace").strip()[7:].split("$")[0].strip().strip("'\"")
            where = place(includes.label(path), i + 1)
            lines[i] = _text(includes, includes.find(name, (*within, path), where), (*within, path)) + b"\n"
    return b"".join(lines)


def _cells_and_bodies(
    content: Content, plain: tuple[Solids, ...], orientations: dict[str, Orientation]
) -> tuple[list[Cells], dict[str, Body]]:
    """Return cells by kind and property, and one body per property of solids; add the axes of their materials."""
    rows: dict[tuple[str, int], list[tuple[np.ndarray, np.ndarray]]] = {}
    for block in plain:
        for pid in np.unique(block.properties):
            is_of_property = block.properties == pid
            kind = f"{_SOLIDS[block.card]}{block.nodes.shape[1]}"
            rows.setdefault((kind, int(pid)), []).append((block.numbers[is_of_property], block.nodes[is_of_property]))
    for key, listed in _of_others(content).items():
        numbers, nodes = zip(*listed, strict=True)
        rows.setdefault(key, []).append((np.array(numbers, dtype=np.int64), np.array(nodes, dtype=np.int64)))
    names, cells, bodies = names_of_tags({(KINDS[kind][0], pid) for kind, pid in rows}), [], {}
    for (kind, pid), parts in sorted(rows.items()):
        elements, wanted = (np.concatenate(column) for column in zip(*parts, strict=True))
        wanted = wanted[:, _ORDER[kind]] if kind in _ORDER else wanted
        cells.append(cells_of(kind, elements, wanted, content.numbers, content.node))
        name = names[KINDS[kind][0], pid]
        content.groups.setdefault(name, Group()).add_cells(len(cells) - 1, np.arange(len(elements)))
        if KINDS[kind][0] == 3 and (known := content.cards.properties.get(pid)) is not None:
            axes = axes_of(content, known, orientations) if known.type == "PSOLID" else None
            bodies[f"PSOLID {pid}"] = Body.of_file(group=name, material=name_of(content, known.mid), orientation=axes)
    return cells, bodies


def _of_others(content: Content) -> dict[tuple[str, int], list[tuple[int, list[int]]]]:
    """Return number and nodes of the solids and faces that pyNastran has read, by kind and property."""
    rows: dict[tuple[str, int], list[tuple[int, list[int]]]] = {}
    for number, element in content.cards.elements.items():
        kind = _kind(element)
        if kind is not None:
            nodes = list(element.nodes)[: KINDS[kind][1]]
            if any(not node for node in nodes):
                raise MeshError(f"{element.type} {number}: a mid-side node is left out; mesh it with all of them, or with none")
            rows.setdefault((kind, int(element.pid)), []).append((number, nodes))
    return rows


def _kind(element: Any) -> str | None:
    """Return the kind of a solid or of a face; None for other elements."""
    if element.type in SHELLS:
        kind = SHELLS[element.type]
        given = [node for node in element.nodes if node]
        return {"quad8": "quad4", "tri6": "tri3"}.get(kind, kind) if len(given) < KINDS[kind][1] else kind
    if element.type not in _SOLIDS:
        return None
    family, n = _SOLIDS[element.type], len([node for node in element.nodes if node])
    linear = {"tet": 4, "wedge": 6, "hex": 8, "pyramid": 5}[family]
    quadratic = {"tet": 10, "wedge": 15, "hex": 20, "pyramid": 13}[family]
    return f"{family}{linear if n == linear else quadratic}"


def _take_sets(content: Content) -> None:
    """Make groups of the sets of grid points in the case control and in bulk data."""
    deck = content.cards.case_control_deck
    known_numbers = set(content.numbers.tolist())
    sets = {f"SET1 {number}": getattr(card, "ids", ()) for number, card in content.cards.sets.items()}
    for subcase in deck.subcases.values() if deck is not None else ():
        stated = {name: value for name, (value, *_) in subcase.params.items() if name.startswith("SET ")}
        sets |= {name: value for name, value in stated.items() if isinstance(value, list)}
    for name, members in sets.items():
        nodes = [number for number in members if isinstance(number, int) and number in known_numbers]
        if nodes:
            content.group(name, content.find(nodes, name))


def _report(content: Content) -> None:
    """Report the cards that are not taken over."""
    cards, findings = content.cards, content.findings
    for word, n in sorted(cards.card_count.items()):
        if word not in HARMLESS and word not in SHELLS and not re.match(r"P(SHELL|COMP|LPLANE)", word):
            findings.add(word, counted(n, "card"), EFFECTS.get(word, "not known to this program"), part=PARTS.get(word, ""))
    stiff = {pid for pid, card in cards.properties.items() if card.type in ("PSHELL", "PCOMP", "PCOMPG")}
    n_shells = sum(element.type in SHELLS and element.pid in stiff for element in cards.elements.values())
    if n_shells:
        findings.add("PSHELL", f"{counted(n_shells, 'element')}", "shells with stiffness; only their faces are used, as groups")
    if any(card.type == "PSOLID" and (card.integ is not None or card.isop is not None) for card in cards.properties.values()):
        effect = "the quadrature stated by a PSOLID; set it by [bodies.NAME] integration"
        findings.add("PSOLID", "fields 5 and 7", effect, False, "bodies")
