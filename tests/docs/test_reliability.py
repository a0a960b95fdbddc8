"""The counts of docs/reliability.md are those of the tests that it names."""

import re
from pathlib import Path

import pytest
from catalogue.bad_inputs import BY_SORT, CASES
from catalogue.faults import FAULTS
from reader_targets import TARGETS

PAGE = (Path(__file__).parents[2] / "docs" / "reliability.md").read_text()


@pytest.mark.ranks(1)
def test_the_page_counts_the_catalogue_its_faults_and_the_readers():
    table = PAGE[PAGE.index("## The catalogue") : PAGE.index("## Faults")]
    assert dict(re.findall(r"^\| (\w+) \| (\d+) \| .* \|$", table, re.MULTILINE)) == {k: str(len(v)) for k, v in BY_SORT.items()}
    assert f"| {len(CASES)} of {len(CASES)} |" in PAGE and f"\n{len(CASES)} bad inputs, " in PAGE
    assert f"\n{len(FAULTS)} faults within a run: " in PAGE
    assert f"of {len(TARGETS)} readers" in PAGE
