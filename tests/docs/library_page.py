"""The page docs/library.md: its code is run block by block, and the output of each block is written below it.

PYTHONPATH=solver:meshes python tests/docs/library_page.py        writes the page and its picture
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

os.environ["MPLBACKEND"] = "Agg"

from lap_joint import LapJoint, lap_joint
from msh import write_msh

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "library.md"
PICTURE = "library_sweep.png"
BLOCK = re.compile(r"```python\n(?P<code>.*?)```\n(?:\n```text\n(?P<said>.*?)```\n)?", re.DOTALL)


def prepare(folder: Path) -> None:
    """Put the scene and its mesh where the page reads them."""
    (folder / "jobs").mkdir()
    (folder / "meshes").mkdir()
    shutil.copy(ROOT / "jobs" / "lap_joint.toml", folder / "jobs")
    write_msh(str(folder / "meshes" / "lap_joint.msh"), lap_joint(LapJoint()))


def run(page: str, folder: Path) -> list[tuple[str, str]]:
    """Run the blocks of a page one after the other in a folder; return the text below each and its output."""
    names: dict = {}
    values = []
    with contextlib.chdir(folder):
        for block in BLOCK.finditer(page):
            outputs = io.StringIO()
            with contextlib.redirect_stdout(outputs):
                exec(compile(block["code"], f"docs/library.md: {block['code'].splitlines()[0]}", "exec"), names)
            values.append((block["said"] or "", outputs.getvalue()))
    return values


def written(page: str, outputs: list[str]) -> str:
    """Return the page with the output of its blocks."""
    texts = iter(outputs)

    def block(computed: re.Match) -> str:
        text = next(texts)
        return f"```python\n{computed['code']}```\n" + (f"\n```text\n{text}```\n" if computed["said"] is not None else "")

    return BLOCK.sub(block, page)


def main() -> None:
    page = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as name:
        prepare(Path(name))
        output = run(page, Path(name))
        shutil.copy(Path(name) / PICTURE, PAGE.parent / "img" / PICTURE)
    PAGE.write_text(written(page, [outputs for _, outputs in output]), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
