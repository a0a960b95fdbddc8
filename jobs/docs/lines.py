"""Lines of the package by part, and of the features added after version 0.1.0: the table of docs/architecture.md.

    python jobs/docs/lines.py                      # the working tree, written to the page
    python jobs/docs/lines.py c593cb3              # a commit (this one is 0.1.0), printed

Lines of Python, all and those with code: without docstrings, comments and blank lines.  Each file counts once: for the first
feature whose pattern its path matches, otherwise for the part of its folder.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tarfile
import tokenize
from collections.abc import Mapping
from fnmatch import fnmatch
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "bench"))
from page_tables import put, table

ROOT = Path(__file__).parents[2]
PACKAGE = "solver/microslip"

# features added after 0.1.0, by paths within the package
FEATURES = {
    "discs: cyclic symmetry, whole discs, Coriolis forces": (
        "*cyclic*", "*sector*", "*/disc.py", "*_disc.py", "*disc_at_speed*", "*circulant*", "*wave_matrix*", "*real_form*",
        "*mistuning*", "*coriolis*", "*hermitian*", "*lockstep*",
    ),
    "peaks, and peaks over a number": (
        "*/peak*", "*maximum*", "results/over*", "continuation/output_rows.py",
    ),
    "nonlinear modes, other solutions, stability": (
        "*nonlinear_mode*", "*backbone*", "*leading_mode*", "*mode_at_rest*", "stability/*", "*stability*", "*bifurcation*",
        "*multipliers*", "*other_solutions*", "*deflation*", "*/search*",
    ),
    "sweeps, sensitivities, identification, wear": (
        "*sweep*", "library/design.py", "library/varied.py", "library/sample_peaks.py", "*sensitivit*", "*identify*",
        "*/fitted_numbers.py", "*/measured_model.py", "formats/measured.py", "*/wear*", "*worn*", "library/jumps.py",
        "*other_springs*",
    ),
    "modes as a command": ("studies/modes/*",),
    "parts of a level on groups of ranks": ("continuation/divided.py", "library/side_by_side.py"),
}  # fmt: skip
# parts of the other files, by folder
PARTS = {
    "numerics": (
        "fourier", "contact", "points", "receptance", "harmonic", "error_estimate", "continuation", "transient", "linear",
        "modes", "statics", "reduction",
    ),
    "mesh, elements, assembly": ("mesh", "elements", "assembly"),
    "model files and matrices of other programs": ("formats",),
    "scene and tables": ("scene", "tables"),
    "results, pictures, report, log": ("results", "observe"),
    "studies": ("studies",),
    "interface for programs, restart": ("library", "restart"),
    "machine, MPI, command line": ("messages", "system", "parallel", "guards", "program"),
}  # fmt: skip


Counts = tuple[int, int]  # lines, and those with code


def lines_with_code(text: str) -> int:
    """Return the number of lines with code, without docstrings, comments and blank lines."""
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    numbers = set[int]()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        is_docstring = token.type == tokenize.STRING and token.line.lstrip().startswith(('"""', 'r"""'))
        if token.type not in skipped and not is_docstring:
            numbers.update(range(token.start[0], token.end[0] + 1))
    return len(numbers)


def counted(texts: Mapping[str, str]) -> tuple[dict[str, Counts], dict[str, Counts]]:
    """Return the lines by part, and by feature, of Python sources by their path within the package."""
    parts, features = dict.fromkeys([*PARTS, "others"], (0, 0)), dict.fromkeys(FEATURES, (0, 0))
    for path, text in texts.items():
        room = path.partition("/")[0]
        feature = next((name for name, patterns in FEATURES.items() if any(fnmatch(path, p) for p in patterns)), None)
        of = parts if feature is None else features
        name = feature or next((name for name, rooms in PARTS.items() if room in rooms), "others")
        of[name] = (of[name][0] + text.count("\n"), of[name][1] + lines_with_code(text))
    return parts, features


def sources(commit: str | None) -> dict[str, str]:
    """Return the Python sources of the working tree, or of a commit."""
    if commit is None:
        package = ROOT / PACKAGE
        return {str(path.relative_to(package)): path.read_text() for path in package.rglob("*.py")}
    archive = subprocess.run(["git", "archive", commit, PACKAGE], cwd=ROOT, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        names = [name for name in files.getnames() if name.endswith(".py")]
        return {name.removeprefix(f"{PACKAGE}/"): (files.extractfile(name) or io.BytesIO()).read().decode() for name in names}


def lines_of(parts: Mapping[str, Counts], features: Mapping[str, Counts]) -> list[str]:
    """Return the table."""

    def total(*groups: Mapping[str, Counts]) -> Counts:
        return tuple(sum(counts[i] for group in groups for counts in group.values()) for i in (0, 1))  # type: ignore[return-value]

    everything = total(parts, features)

    def row(name: str, counts: Counts) -> list[str]:
        return [name, f"{counts[0]:,}", f"{counts[1]:,}", f"{100.0 * counts[0] / everything[0]:.0f}"]

    rows = [row(name, counts) for name, counts in parts.items() if counts[0]] + [row("**these together**", total(parts))]
    rows += [row(name, counts) for name, counts in features.items() if counts[0]] + [row("**all**", everything)]
    return table(["part", "lines", "with code", "% of the lines"], rows)


def main() -> None:
    commit = sys.argv[1] if len(sys.argv) > 1 else None
    lines = lines_of(*counted(sources(commit)))
    print("\n".join(lines))
    if commit is None:
        put(ROOT / "docs" / "architecture.md", {"lines": lines})


if __name__ == "__main__":
    main()
