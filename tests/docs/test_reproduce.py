"""The command that compares the tables of docs with the output of their commands, and with no other text."""

import sys
from argparse import Namespace
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "jobs" / "docs"))

import reproduce
from reproduce import agree, commands, compare, nearest, tables

PAGE = """# A page

`python jobs/bench/a.py --size 3`, and again `python jobs/bench/a.py --size 3`, `microslip`, `python` and `K`:

| samples | error | wall, s |
| ---: | ---: | ---: |
| 32 | 2.1 %, 1,250 | 3.0 |
| | 0.61 % | 2.0 |

    python jobs/bench/b.py --long \\
        argument          # what it does
"""


def made(text: str, page: str = PAGE):
    return nearest(tables(page)[0], [("command", one) for one in tables(text)])


def test_commands_of_a_page():
    assert commands(PAGE) == ["python jobs/bench/a.py --size 3", "python jobs/bench/b.py --long argument"]


def test_equal_numbers_agree_and_times_are_not_compared():
    _, compared = made("| samples | error | wall, s |\n| --- | --- | --- |\n| 32 | 2.10 %, 1250 | 9 |\n| | 0.611 % | 7 |\n")
    assert (compared.rows, compared.equal, compared.differ, compared.machine) == (2, 3, [], 2)


def test_ratios_of_times_are_counted_separately():
    page = "| level | evaluations | time, s | ratio | speed-up a step | of samples |\n| --- | --- | --- | --- | --- | --- |\n"
    now = f"{page}| 1 | 7 | 2.0 | 1.5 | 1.2 | 2x |\n| speed-up, lowest | 3 |  |  |  |  |\n"
    _, compared = made(now, f"{page}| 1 | 7 | 4.0 | 3.0 | 1.1 | 7,600x |\n| speed-up, lowest | 2 |  |  |  |  |\n")
    assert (compared.equal, compared.differ, compared.machine, compared.ratios) == (1, [], 1, 4)
    assert compared.change == pytest.approx(3800.0)
    page = "| stage | error | ratio | mesh |\n| --- | --- | --- | --- |\n| x | 2.0 | 1.5 | 8 x 8 |\n"
    _, compared = made(page.replace("1.5", "1.9"), page)
    assert compared.differ == [("x", "ratio", "1.5", "1.9")]  # a ratio of what is no time is of the model


def test_different_numbers_are_named():
    _, compared = made("| 32 | 2.4 %, 1,250 | 9 |\n| | 0.61 % | 7 |\n")
    assert compared.differ == [("32", "error", "2.1 %, 1,250", "2.4 %, 1,250")]
    assert compared.equal == 1


def test_an_additional_number_is_a_difference():
    _, compared = made("| 32 | 2.1 %, 1,250, 8 | 9 |\n")
    assert len(compared.differ) == 1 and compared.rows == 1


def test_columns_are_matched_by_name():
    page = "| case | a | b |\n| --- | --- | --- |\n| x | 1 | 2 |\n"
    _, compared = made("| case | b | c | a |\n| --- | --- | --- | --- |\n| x | 2 | 5 | 1 |\n", page)
    assert (compared.equal, compared.differ) == (2, [])


def test_rows_of_the_same_name_are_matched_by_words_and_mesh():
    page = "| bar | of | cells | value |\n| --- | --- | --- | --- |\n| x | here | 8 x 8 | 1 |\n| | there | 8 x 8 | 2 |\n| | here | 16 x 16 | 3 |\n"
    _, compared = made("| x | here | 4 x 4 | 1 |\n| x | there | 8 x 8 | 2 |\n| x | here | 8 x 8 | 5 |\n", page)
    assert compared.rows == 2 and compared.differ == [("x", "value", "1", "5")]


def test_the_table_with_most_common_rows_is_compared():
    _, compared = made("| 64 | 1 | 1 |\n\n| 32 | 2.1 %, 1,250 | 9 |\n| | 0.61 % | 7 |\n\n| 32 | 7 | 7 |\n")
    assert compared.rows == 2 and not compared.differ
    assert made("no table") is None and made("| 64 | 2.1 % | 9 |\n") is None


@pytest.mark.parametrize(
    "page, now, same",
    [("2.1", "2.14", True), ("2.1", "2.25", False), ("3e-1", "0.25", True), ("-3", "-5", False), ("1250", "1251", True)]
    + [("2e-13", "4e-12", True), ("2e-13", "4e-7", False), ("0", "1e-12", True), ("0", "1", True), ("0", "2", False)],
)
def test_numbers_agree_to_the_digits_printed(page, now, same):
    assert agree(page, now) == same


def project(folder: Path, script: str) -> Path:
    """Write a project whose page shows 1.5 and names a script; return the page."""
    (folder / "docs").mkdir()
    (folder / "make.py").write_text(script)
    page = folder / "docs" / "page.md"
    page.write_text("`python make.py`\n\n| case | value |\n| --- | --- |\n| x | 1.5 |\n")
    return page


WRITES = "from pathlib import Path\nPath('docs/page.md').write_text('| case | value |\\n| --- | --- |\\n| x | {} |\\n')\n"
READS = "from pathlib import Path\nprint(Path('docs/page.md').read_text())\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    "script, counts",
    [
        ("print('| x | 1.5 |')", {"tables": 1, "made": 1, "equal": 1}),
        ("print('| x | 1.7 |')", {"tables": 1, "made": 1, "differ": 1}),
        (WRITES.format("1.5"), {"tables": 1, "made": 1, "equal": 1}),
        (WRITES.format("1.7"), {"tables": 1, "made": 1, "differ": 1}),
        ("print('nothing')", {"tables": 1}),  # the page itself is never what a command made
        (READS, {"tables": 1}),
        ("import time\nprint('| x | 1.5 |', flush=True)\ntime.sleep(60)", {"tables": 1}),
    ],
)
def test_a_page_is_compared_with_the_output_of_its_command(tmp_path, monkeypatch, script, counts):
    page = project(tmp_path, script)
    monkeypatch.setattr(reproduce, "ROOT", tmp_path)
    computed = reproduce.examined(page, Namespace(seconds=2.0, only="", without=None, list=False))
    assert {name: n for name, n in computed.items() if n} == counts
    assert "1.5" in page.read_text()


def test_tables_have_a_line_and_rows_a_name():
    (table,) = tables(PAGE)
    assert table.line == 5 and table.header[1] == "error"
    assert [name for name, _ in table.named()] == ["32", "32"]
    assert compare(table, table).equal == 3


def test_a_table_without_rows_is_ignored():
    assert tables("| a | b |\n| --- | --- |\n\n| c | d |\n| --- | --- |\n| 1 | 2 |\n")[0].header == ["c", "d"]


def test_printed_peaks_are_compared_in_any_unit():
    log = (
        "level 1 of 2: 0.5 N: 67 points in 0.31 s; peak 8.1534e-05 m (1.6307e-04 m/N) at 724.58 Hz, 16 of 64 pairs slip, 32 open"
    )
    page = "| level | peak | per newton | pairs that slip, open (of 64) | friction |\n| --- | --- | --- | --- | --- |\n"
    page += "| 0.5 N | 0.082 mm | 163 µm/N | 16, 30 | 3 % |\n"
    computed = nearest(tables(page)[0], [("command", one) for one in reproduce.peaks(log)])[1]
    assert (computed.equal, computed.differ) == (2, [("0.5 N", "pairs that slip, open", "16, 30", "16, 32")])
    assert reproduce.peaks("nothing") == []
