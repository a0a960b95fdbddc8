"""The equations of docs/theory.md: numbered in the order in which they stand, and there where others refer to them."""

import re
from itertools import groupby
from pathlib import Path

ROOT = Path(__file__).parents[2]
THEORY = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
NUMBERS = [(int(section), int(n)) for section, n in re.findall(r"\\tag\{(\d+)\.(\d+)\}", THEORY)]


def referred(text):
    """Return the numbers in "eq. 5.3, 5.4" and "eq. (5.1)"."""
    return [
        (int(section), int(n))
        for found in re.findall(r"\beqs?\. \(?(\d+\.\d+(?:(?:, | and | to )\d+\.\d+)*)", text)
        for section, n in re.findall(r"(\d+)\.(\d+)", found)
    ]


def test_equations_are_numbered_in_order_in_each_section():
    assert len(NUMBERS) > 30
    for section, found in groupby(NUMBERS, key=lambda number: number[0]):
        assert [n for _, n in found] == list(range(1, sum(s == section for s, _ in NUMBERS) + 1)), section
    headings = [int(n) for n in re.findall(r"^## (\d+)\.", THEORY, flags=re.M)]
    assert headings == list(range(1, len(headings) + 1))
    for text, heading in zip(re.split(r"^## \d+\.", THEORY, flags=re.M)[1:], headings):
        assert {int(s) for s in re.findall(r"\\tag\{(\d+)\.", text)} <= {heading}


def test_every_equation_referred_to_is_there():
    files = [
        path
        for folder, ending in (("solver", "py"), ("solver", "c"), ("tests", "py"), ("docs", "md"), ("jobs", "py"))
        for path in (ROOT / folder).rglob(f"*.{ending}")
        if path.name != "test_theory.py"
    ]
    found = {(path.name, number) for path in files for number in referred(path.read_text(encoding="utf-8"))}
    assert len(found) > 10
    inside = {("theory.md", (int(s), int(n))) for s, n in re.findall(r"(?<!tag)[ (]\((\d+)\.(\d+)\)", THEORY)}
    assert len(inside) > 10
    assert not {entry for entry in found | inside if entry[1] not in NUMBERS}
