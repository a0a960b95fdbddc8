"""The counts of docs/reliability.md are those of the named tests."""

import re
from pathlib import Path

import pytest
from catalogue.bad_inputs import BY_SORT, CASES
from catalogue.faults import FAULTS
from reader_targets import TARGETS

PAGE = (Path(__file__).parents[2] / "docs" / "reliability.md").read_text()
pytestmark = pytest.mark.ranks(1)


def test_the_page_states_the_sizes_of_the_catalogue():
    table = PAGE[PAGE.index("## The catalogue") : PAGE.index("## Faults")]
    stated = {kind: int(n) for kind, n in re.findall(r"^\| (\w+) \| (\d+) \| .* \|$", table, re.MULTILINE)}
    assert stated.keys() == BY_SORT.keys()
    for kind, cases in BY_SORT.items():
        assert stated[kind] <= len(cases) <= stated[kind] + 20, kind
    (total,) = re.findall(r"^More than (\d+) bad inputs", table, re.MULTILINE)
    assert int(total) < len(CASES) <= int(total) + 60
    assert f"\n{len(FAULTS)} faults within a run: " in PAGE


def test_the_page_has_a_line_for_each_fuzzed_reader():
    table = PAGE[PAGE.index("### Tests") : PAGE.index("Findings that were fixed")]
    seconds = {name: int(n) for name, n in re.findall(r"^\| (\w+) \| (\d+) \| [\d,]+ \| ", table, re.MULTILINE)}
    assert set(seconds) == set(TARGETS) and min(seconds.values()) >= 600
    assert f"of {len(TARGETS)} readers" in PAGE
