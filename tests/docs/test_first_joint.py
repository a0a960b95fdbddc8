"""The page "My first joint": its files and commands give the results shown."""

import re
import shutil
from pathlib import Path

import pytest
from processes import microslip, python

DOCS = Path(__file__).parents[2] / "docs"
SHOWN = [line.removeprefix("    ") for line in (DOCS / "first_joint.md").read_text(encoding="utf-8").splitlines()]
PEAK = r"level \d of \d: 0\.1 N: .*peak (\S+) m "


@pytest.mark.slow
def test_the_files_of_the_page_give_the_results_shown(tmp_path):
    for name in ("leaves.py", "leaves.toml"):
        shutil.copy(DOCS / "first_joint" / name, tmp_path)
    made = python("leaves.py", cwd=tmp_path).stdout.splitlines()
    checked = microslip("check", "leaves.toml", cwd=tmp_path).stdout.replace(f"{tmp_path}/", "").splitlines()
    memory = next(row for row, line in enumerate(checked) if line.startswith("memory"))
    assert len(made) == 1 and memory == 19
    assert set(made + checked[: memory + 1]) <= set(SHOWN)
    names = [line[:41] for line in checked[memory + 1 : -2]]  # memory depends on the machine and its libraries
    assert len(names) == 7 and set(names) <= {line[:41] for line in SHOWN}
    scene = tmp_path / "leaves.toml"
    text = re.sub("levels = .*", "levels = [0.1]", scene.read_text())
    scene.write_text(re.sub("span = .*", "span = [0.998, 1.001]\npoints = 10", text))  # only the flat top
    computed, shown = (
        float(re.search(PEAK, text)[1]) for text in (microslip("run", scene, cwd=tmp_path).stdout, "\n".join(SHOWN))
    )
    assert computed == pytest.approx(shown, rel=3e-3)
