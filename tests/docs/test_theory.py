"""Theory and code: equations are numbered in order, each names the code that implements it, and that code cites it."""

import re
from collections import Counter
from itertools import groupby
from pathlib import Path

from sources import ROOT, SOLVER, definitions, sources

THEORY = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
NUMBERS = [(int(section), int(n)) for section, n in re.findall(r"\\tag\{(\d+)\.(\d+)\}", THEORY)]
CITED = re.compile(r"\beq\. \((\d+\.\d+)\)")  # the one form in solver/: "here it is implemented"; "(5.1)" alone refers to it
NAMED = re.compile(r"^\*\*In the code\.\*\*(.*(?:\n.+)*)", flags=re.M)
PAGES = ("theory", "notation", "parallel", "architecture")


def referred(text, alone):
    """Return the numbers in "eq. 5.3, 5.4" and "eq. (5.1)", and with ``alone`` in " (5.1)"."""
    lists = re.findall(r"\beqs?\. \(?(\d+\.\d+(?:(?:, | and | to )\d+\.\d+)*)", text)
    lists += re.findall(r"(?<!tag)(?<=[\s(])\((\d+\.\d+)\)", text) if alone else []
    return {(int(section), int(n)) for each in lists for section, n in re.findall(r"(\d+)\.(\d+)", each)}


def entries(text):
    """Return {number: names} of the lines "In the code", the numbers of each line with its section."""
    values = {}
    for section, part in re.findall(r"^## (\d+)\.(.*?)(?=^## |\Z)", text, flags=re.M | re.S):
        for line in NAMED.findall(part):
            for number, names in re.findall(r"\((\d+\.\d+)\)((?:,?\s`[^`]+`)+)", line):
                assert number.startswith(f"{section}.") and number not in values, number
                values[number] = re.findall(r"`([^`]+)`", names)
    return values


def faults(text, files):
    """Return the inconsistencies between theory and code: the text of the theory, {path: source} of the code."""
    named, numbers = entries(text), re.findall(r"\\tag\{(\d+\.\d+)\}", text)
    places = {}  # name: [(path, its docstring or comment)]
    for path, source in files.items():
        for name, stated in definitions(path, source):
            places.setdefault(name, []).append((path, stated))
    wrong = [f"({number}) names nothing in solver/" for number in numbers if number not in named]
    wrong += [f"({number}) is no equation" for number in named if number not in numbers]
    for number, names in named.items():
        for name in names:
            cited_in = places.get(name, [])
            if len(cited_in) != 1:
                wrong.append(f"({number}): `{name}` is defined {len(cited_in)} times")
            elif number not in CITED.findall(cited_in[0][1]):
                wrong.append(f"({number}): {name} does not say eq. ({number})")
    for path, source in files.items():
        here = {name for name, _ in definitions(path, source)}
        wrong += [f"{path}: eq. ({n}) names nothing in it" for n in CITED.findall(source) if not here & set(named.get(n, ()))]
        wrong += [
            f"{path}: {other!r} cites in another form"
            for other in re.findall(r"\beqs?\.? ?\(?\d+\.\d+", source)
            if not CITED.match(other + ")")
        ]
    return wrong


def test_equations_are_numbered_in_order_in_each_section():
    assert len(NUMBERS) > 30
    for section, numbers in groupby(NUMBERS, key=lambda number: number[0]):
        assert [n for _, n in numbers] == list(range(1, sum(s == section for s, _ in NUMBERS) + 1)), section
    headings = [int(n) for n in re.findall(r"^## (\d+)\.", THEORY, flags=re.M)]
    assert headings == list(range(1, len(headings) + 1))
    for text, heading in zip(re.split(r"^## \d+\.", THEORY, flags=re.M)[1:], headings):
        assert {int(s) for s in re.findall(r"\\tag\{(\d+)\.", text)} <= {heading}


def test_every_cited_equation_exists():
    files = [
        path for folder in ("tests", "docs", "jobs") for path in (ROOT / folder).rglob("*.*") if path.suffix in (".py", ".md")
    ]
    texts = {path: path.read_text(encoding="utf-8") for path in files if path.name != Path(__file__).name} | sources()
    alone = {*sources(), ROOT / "docs" / "theory.md"}
    by_key = {(path.name, number) for path, text in texts.items() for number in referred(text, path in alone)}
    assert len(by_key) > 40
    assert not {entry for entry in by_key if entry[1] not in NUMBERS}


def test_every_equation_names_its_code_and_is_cited_back():
    assert faults(THEORY, sources()) == []


def test_removed_parts_are_detected():
    files = sources()
    balance = SOLVER / "harmonic" / "balance.py"
    kernel = SOLVER / "contact" / "elastic_coulomb.c"

    def inconsistencies(text=THEORY, path=balance, old="", new=""):
        changed = files | {path: files[path].replace(old, new)}
        assert text != THEORY or changed != files
        return faults(text, changed)

    assert inconsistencies(text=THEORY.replace("(5.1) `HarmonicBalance.residual`; ", "")) != []  # the entry of an equation
    assert (
        inconsistencies(text=THEORY.replace("`HarmonicBalance.residual`", "`HarmonicBalance.rest`")) != []
    )  # the name in an entry
    assert inconsistencies(text=THEORY.replace("\\tag{5.1}", "")) != []  # the number of an equation
    assert inconsistencies(old="def residual(", new="def rest(") != []  # the named function
    assert inconsistencies(old="eq. (5.1)", new="the equation") != []  # the citation
    assert inconsistencies(old="eq. (5.1)", new="eq. 5.1") != []  # its form
    assert inconsistencies(old="eq. (5.1)", new="eq. (5.1), eq. (6.2)") != []  # a citation of another equation
    assert inconsistencies(path=kernel, old="eq. (3.3)", new="the return") != []
    assert (
        inconsistencies(path=kernel, old="/* One step on all lanes, eq. (3.6)", new="/* eq. (3.6) */\n\n/* One step on all lanes")
        != []
    )


def test_names_of_code_on_the_pages_exist_in_the_code():
    words = Counter(re.findall(r"\w+", "\n".join([*sources().values(), *map(str, sources())])))
    for page in PAGES:
        text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
        names = re.findall(r"`([A-Za-z_][\w.]*)(?:\(\))?`", re.sub(r"```.*?```", "", text, flags=re.S))
        assert len(names) > 5, page
        assert not {name for name in names for word in name.split(".") if word not in words}, page
