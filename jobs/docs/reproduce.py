"""Run the commands named on pages of docs, and compare the tables they make with those of the page, number by number.

    python jobs/docs/reproduce.py [docs/PAGE.md ...] [--seconds 300] [--only TEXT] [--without TEXT] [--list]

The commands of a page run in order in a copy of the project without pages: every table that exists after a command, printed or
written to docs/, was made by it; meshes made by one command are available to the next.  A table of the page is compared with the
made table that matches most of its rows by their first cell.  Numbers are of three classes: of the model (compared); of the
machine (times, memory; only counted); ratios of times (speed-ups; the largest change is reported). Prints a line per table, each
number of the model that differs, and tables that no command made; exit status 1 if a number differs.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
COMMAND = re.compile(r"(?:[A-Z_]+=\S+ )*(?:python|microslip|mpirun) .+")
WANTS = re.compile(r"\b(?:FOLDER|SCENE|PYTHON|READER|FILE|MODEL|RESULTS|DIR)\b|…")  # placeholders for the reader
MENTION = re.compile(
    r"microslip (?!doctor)\w+|python (?:-P )?-m(?: microslip)?|mpirun (?:-n \d+|--oversubscribe)"
)  # names a command only
LEFT_OUT = {".": {".git", ".venv", "results"}, "docs": {"_build"}}  # of a folder; pages and compiled Python everywhere
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
LENGTH = re.compile(rf"({NUMBER.pattern}) (mm|\u00b5m|\u03bcm)(?![a-z])")
POWERS = {"mm": -3, "\N{MICRO SIGN}m": -6, "\N{GREEK SMALL LETTER MU}m": -6}
PEAK = re.compile(
    r"^level \d+ of \d+: (\S+ N): .*peak (\S+ m) \((\S+ m/N)\) at (\S+ Hz), (\d+) of \d+ pairs slip, (\d+) open", flags=re.M
)
PEAKS = [
    "level",
    "peak",
    "per newton",
    "peak per newton",
    "frequency of the peak",
    "pairs that slip, open",
    "points that slip, open",
]
OF_THE_MACHINE = re.compile(r"(?<![\w/])(?:s|ms|us|min|seconds?|times?|wall|clock|processor|MiB|GiB|GFlop)\b")
A_RATIO = re.compile(r"\bspeed-?up\b|\bfaster\b|\btimes as fast\b")  # ratios of times, in the name of a row or column
FACTOR = re.compile(rf"{NUMBER.pattern}x(?![\w ])")  # 7600x in a cell
MODEL, MACHINE, RATIO = "of the model", "of the machine", "ratios of times"
ROUNDING, ITS_SPREAD = 1e-7, 100.0  # numbers below the first are rounding errors: they agree within the second factor


@dataclass(frozen=True)
class Table:
    """A Markdown table: the line it begins in, the names of its columns (none: not named) and its rows of cells."""

    line: int
    header: list[str]
    rows: list[list[str]]

    def named(self) -> list[tuple[str, list[str]]]:
        """Return the rows, each with its name: its first cell, or the one above if that is empty."""
        name, rows = "", []
        for row in self.rows:
            name = row[0] or name
            rows.append((plain(name), row))
        return rows


@dataclass
class Comparison:
    """The comparison of a table: numbers by class, and the cells that differ (row, column, page, now)."""

    rows: int = 0
    equal: int = 0
    machine: int = 0
    ratios: int = 0
    change: float = 1.0  # the largest factor between two ratios of times
    differ: list[tuple[str, str, str, str]] = field(default_factory=list)

    @property
    def judged(self) -> int:
        return self.equal + len(self.differ)

    def add(self, other: Comparison) -> None:
        for name in ("rows", "equal", "machine", "ratios", "differ"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.change = max(self.change, other.change)


def plain(text: str) -> str:
    """Return a cell in normal form: one kind of minus, no markup, no commas in numbers, lengths in m, no brackets after words."""
    text = re.sub(r"(?<=\d),(?=\d{3})", "", text.replace("\N{MINUS SIGN}", "-").replace("×", "x"))
    text = LENGTH.sub(lambda matched: f"{in_powers(matched[1], POWERS[matched[2]])} m", text)
    return re.sub(r"[`*$\\]|(?<=[a-z]) \(.*\)$", "", text).strip()


def in_powers(number: str, power: int) -> str:
    """Return a number times a power of ten, to the same digits."""
    digits, _, own = number.partition("e")
    return f"{digits}e{int(own or 0) + power:+03d}"


def peaks(text: str) -> list[Table]:
    """Return the peaks that a run prints as a table like those of the guide; none if it prints none."""
    rows = [[level, a, b, b, f, f"{slip}, {n}", f"{slip}, {n}"] for level, a, b, f, slip, n in PEAK.findall(text)]
    return [Table(0, PEAKS, rows)] if rows else []


def tables(text: str) -> list[Table]:
    """Return the Markdown tables of a text that have rows, of a page or of what a command prints."""
    result: list[Table] = []
    rows: list[list[str]] = []
    for number, line in enumerate([*text.splitlines(), ""], 1):
        if line.lstrip().startswith("|"):
            rows.append([cell.strip() for cell in line.strip().strip("|").split("|")])
        elif rows:
            named = len(rows) > 1 and all(re.fullmatch(":?-+:?", cell) for cell in rows[1])
            result.append(Table(number - len(rows), rows[0] if named else [], rows[2:] if named else rows))
            rows = []
    return [one for one in result if one.rows]


def commands(page: str) -> list[str]:
    """Return the commands a page names, in inline code and in code blocks, each once."""
    joined = page.replace("\\\n", " ")
    spans = re.findall(r"`([^`\n]+)`|^ {4}(\S.*)$", joined, flags=re.M)
    texts = (re.sub(r" {2,}#.*", "", inline or block).strip() for inline, block in spans)
    return list(dict.fromkeys(re.sub(r"\s+", " ", one) for one in texts if COMMAND.fullmatch(one)))


def copy_project(copy: Path) -> None:
    """Copy the project without its pages, its history and the files of runs."""

    def left_out(folder: str, names: list[str]) -> set[str]:
        within = LEFT_OUT.get(os.path.relpath(folder, ROOT), set())
        return {name for name in names if name in within or name.endswith(".md") or name == "__pycache__"}

    shutil.copytree(ROOT, copy, ignore=left_out)


def output(command: str, seconds: float, copy: Path) -> tuple[str, list[Table]]:
    """Run a command in a copy of the project without pages; return its outcome and the tables it made."""
    for page in (copy / "docs").glob("*.md"):  # of an earlier command
        page.unlink()
    paths = ":".join(str(copy / name) for name in ("solver", "tests", "tests/continuation", "meshes"))
    environment = {**os.environ, "PYTHONPATH": paths, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    try:
        ran = subprocess.run(
            command,
            shell=True,
            cwd=copy,
            env=environment,
            timeout=seconds,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
        )
    except subprocess.TimeoutExpired:
        return f"stopped after {seconds:.0f} s", []
    pages = [path.read_text(encoding="utf-8") for path in sorted((copy / "docs").glob("*.md"))]
    outcome = "ran" if ran.returncode == 0 else f"status {ran.returncode}: {(ran.stderr.strip().splitlines() or [''])[-1][:100]}"
    return outcome, [one for text in (ran.stdout, *pages) for one in tables(text)] + peaks(ran.stdout)


def agree(page: str, now: str) -> bool:
    """Return whether two numbers agree to the digits of the coarser one, within one unit of its last digit."""
    a, b = float(page), float(now)
    if max(abs(a), abs(b)) < ROUNDING:
        return 0.0 in (a, b) or ITS_SPREAD * min(abs(a), abs(b)) > max(abs(a), abs(b))
    return abs(a - b) <= 1.001 * max(last_digit(page), last_digit(now))


def last_digit(number: str) -> float:
    """Return the value of one unit in the last printed digit."""
    digits, _, power = number.partition("e")
    return 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


def columns(page: Table, made: Table) -> list[tuple[int, int]]:
    """Return the corresponding columns of two tables: by position, or by name if their numbers differ."""
    width = len(made.rows[0])
    if len(page.header) == width:
        return [(i, i) for i in range(width)]
    names = [plain(name) for name in made.header]
    return [(i, names.index(plain(name))) for i, name in enumerate(page.header) if plain(name) in names]


def compare(page: Table, made: Table) -> Comparison:
    """Compare the numbers of the rows that two tables have in common; of one name, the most alike or the first."""
    result, pairs = Comparison(), columns(page, made)
    left: dict[str, list[list[str]]] = {}
    for name, row in made.named():
        left.setdefault(name, []).append(row)
    for name, row in page.named():
        tried = [
            (compared_rows(page, name, row, other, pairs), other) for other in left.get(name, []) if meshes(row) == meshes(other)
        ]
        if tried:
            closest, other = max(tried, key=lambda one: (alike(row, one[1]), one[0].equal))
            left[name].remove(other)
            result.add(closest)
    return result


def meshes(row: list[str]) -> list[str]:
    """Return the cells of a row with a mesh density: 8 x 8 x 16."""
    return [plain(cell) for cell in row if re.fullmatch(r"\d+(?: x \d+)+", plain(cell))]


def alike(row: list[str], other: list[str]) -> int:
    """Return the number of text cells that two rows have in common."""
    return len({plain(cell) for cell in row if not NUMBER.search(cell)} & {plain(cell) for cell in other})


def compared_rows(page: Table, name: str, row: list[str], other: list[str], pairs: list[tuple[int, int]]) -> Comparison:
    """Compare a row of a page with a made one of the same name."""
    result = Comparison(rows=1)
    for i, j in pairs:
        if max(i, j) > 0 and i < len(row) and j < len(other):
            compare_cells(result, kind_of(name, page, i, row[i]), (name, plain(page.header[i])), row[i], other[j])
    return result


def kind_of(name: str, page: Table, i: int, cell: str) -> str:
    """Return the class of the numbers of a cell in column i of a row of this name.

    A column "ratio" has ratios of times if the column before it is of the machine or has such ratios.
    """
    column, before = plain(page.header[i]), plain(page.header[i - 1])
    if A_RATIO.search(column) or A_RATIO.search(name) or FACTOR.search(plain(cell)):
        return RATIO
    if column == "ratio" and (OF_THE_MACHINE.search(before) or A_RATIO.search(before)):
        return RATIO
    return MACHINE if OF_THE_MACHINE.search(column) or OF_THE_MACHINE.search(name) else MODEL


def compare_cells(result: Comparison, kind: str, place: tuple[str, str], page: str, now: str) -> None:
    """Count the numbers of a cell by their class; if one cell has more numbers than the other, the whole cell differs."""
    ours, theirs = NUMBER.findall(plain(page)), NUMBER.findall(plain(now))
    if kind == MACHINE:
        result.machine += len(ours)
    elif kind == RATIO:
        result.ratios += len(ours)
        both = [(abs(float(a)), abs(float(b))) for a, b in zip(ours, theirs)]
        result.change = max([result.change, *(max(a / b, b / a) for a, b in both if a and b)])
    elif len(ours) != len(theirs) or not all(agree(a, b) for a, b in zip(ours, theirs)):
        result.differ.append((*place, page, now))
    else:
        result.equal += len(ours)


def nearest(page: Table, made: list[tuple[str, Table]]) -> tuple[str, Comparison] | None:
    """Return the command and the comparison of the table with most rows in common, then most numbers that agree."""
    tried = [(command, compare(page, table)) for command, table in made if columns(page, table)]
    tried = [(command, one) for command, one in tried if one.rows and one.judged + one.machine + one.ratios]
    return max(tried, key=lambda one: (one[1].rows, one[1].equal, -len(one[1].differ)), default=None)


def examined(path: Path, arguments: argparse.Namespace) -> Counter:
    """Run the commands of a page, print the outcome of each and of every table; return the counts."""
    text, made = path.read_text(encoding="utf-8"), []
    print(f"\n{path.name}", flush=True)
    chosen = [one for one in commands(text) if is_requested(one, arguments)]
    if arguments.list:
        print(*(f"  {command}" for command in chosen), sep="\n")
        return Counter()
    with tempfile.TemporaryDirectory() as place:
        copy = Path(place) / "project"
        copy_project(copy)
        for command in chosen:
            outcome, printed = output(command, arguments.seconds, copy)
            print(f"  {command}\n    {outcome}, tables: {len(printed)}", flush=True)
            made += [(command, one) for one in printed]
    return compared(tables(text), made)


def is_requested(command: str, arguments: argparse.Namespace) -> bool:
    """Return whether a command is complete and requested."""
    is_whole = not WANTS.search(command) and not MENTION.fullmatch(command)
    is_left_out = arguments.without and re.search(arguments.without, command)
    return is_whole and bool(re.search(arguments.only, command)) and not is_left_out


def compared(page: list[Table], made: list[tuple[str, Table]]) -> Counter:
    """Print a line for every table of a page, and the differences; return the counts by class."""
    counts: Counter = Counter(tables=len(page))
    for table in page:
        head = f"  line {table.line}, {' | '.join(table.header)[:60]}: "
        closest = nearest(table, made)
        if closest is None:
            print(head + "made by no command that ran")
            continue
        one = closest[1]
        ratios = f", {one.ratios} {RATIO}, which differ by up to {one.change:.2g}" if one.ratios else ""
        numbers = f"{one.equal} of {one.judged} numbers agree, {one.machine} {MACHINE}"
        print(f"{head}{one.rows} of {len(table.rows)} rows, {numbers}{ratios}")
        for row, column, here, now in one.differ:
            print(f'    differs: "{row}", "{column}": {here} on the page, {now} now')
        counts.update(made=1, equal=one.equal, differ=len(one.differ), machine=one.machine, ratios=one.ratios)
    return counts


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", type=Path, help="default: all of docs")
    parser.add_argument("--seconds", type=float, default=300.0, help="time limit of a command")
    parser.add_argument("--only", default="", help="run only commands that match this regular expression")
    parser.add_argument("--without", help="commands to leave out")
    parser.add_argument("--list", action="store_true", help="the commands, none run")
    arguments = parser.parse_args()
    counts = sum((examined(path, arguments) for path in arguments.pages or sorted((ROOT / "docs").glob("*.md"))), Counter())
    if not arguments.list:
        print(
            f"\n{counts['made']} of {counts['tables']} tables made: {counts['equal']} numbers agree, cells that differ: "
            f"{counts['differ']}, {counts['machine']} {MACHINE}, {counts['ratios']} {RATIO}"
        )
    return int(counts["differ"] > 0)


if __name__ == "__main__":
    sys.exit(main())
