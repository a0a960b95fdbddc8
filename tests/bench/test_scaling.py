"""The tables of parallel scaling are those of the page, from runs of the program."""

import pytest
from page_tables import MARKED
from scaling import POINT, SET_UP, shared, stages_of, tables
from sources import ROOT


def test_tables_are_those_of_the_page():
    runs = {ranks: {**dict.fromkeys(SET_UP, (2.0 / ranks, 1000.0 * ranks)), POINT: (0.03, 10.0)} for ranks in (1, 2)}
    made = tables({"small": runs, "paper": runs})
    page = (ROOT / "docs" / "scaling.md").read_text(encoding="utf-8")
    assert {*made, "machine"} == {name for _, name, _ in MARKED.findall(page)}
    assert "| assembly | 2 s | 1 s | 2.00 | 1,000 | 2,000 |" in made["small-measured"]
    assert made["summary"][0] == "| what | target, speed-up | time, 1 rank | time, 2 ranks | speed-up | ratio |"
    n = 2.0 * len(SET_UP)
    assert f"| set-up of paper | 2 | {n:.3g} s | {n / 2:.3g} s | 2.00 | 1.00 |" in made["summary"]
    assert "| a point of small | 2 | 30 ms | 30 ms | 1.00 | 2.00 |" in made["summary"]
    assert made["least"][2:4] == [
        "| set-up of small | 0 ms | 12 s | 3 s | 750 ms | 188 ms |",
        "| a point of small | 30 ms | 0 ms | 30 ms | 30 ms | 30 ms |",
    ]


def test_the_parts_of_a_time_are_those_of_amdahls_law():
    assert shared([1, 2], [5.0 + 8.0, 5.0 + 8.0 / 2]) == pytest.approx((5.0, 8.0))
    assert shared([2, 8], [5.0 + 8.0 / 2, 5.0 + 8.0 / 8]) == pytest.approx((5.0, 8.0))
    assert shared([1, 2], [3.0, 4.0]) == (3.0, 0.0)  # slower on two ranks


@pytest.mark.slow
def test_stages_are_those_of_a_run(tmp_path):
    stages = stages_of(ROOT / "jobs" / "fan_small.toml", 1, 1.0, 5, tmp_path)
    assert list(stages) == [*SET_UP, POINT] and all(seconds > 0.0 and memory > 0.0 for seconds, memory in stages.values())
