"""The notebook of docs/library.md runs, and prints the output shown."""

import re

import pytest

from docs import library_page

NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]?\d+)?")


@pytest.mark.slow
def test_the_page_prints_the_output_shown(tmp_path):
    library_page.prepare(tmp_path)
    output = library_page.run(library_page.PAGE.read_text(encoding="utf-8"), tmp_path)
    assert len(output) > 8
    for stands, printed in output:
        assert NUMBER.sub("#", printed) == NUMBER.sub("#", stands)
        numbers = [[float(x) for x in NUMBER.findall(text)] for text in (printed, stands)]
        assert numbers[0] == pytest.approx(numbers[1], rel=2e-3)
    for file in (library_page.PICTURE, "response.png", "results/lap_joint/frf.csv", "results/lap_joint/results.h5"):
        assert (tmp_path / file).stat().st_size > 1000
