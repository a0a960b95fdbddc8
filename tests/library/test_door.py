"""Scenes end at the library: no room of the numerics imports them or takes them as arguments, and all parameters have types."""

import ast
import re
from pathlib import Path

import pytest

import microslip

ROOT = Path(microslip.__file__).parent
BEYOND = (
    "assembly contact continuation elements error_estimate fourier harmonic linear mesh modes parallel points receptance reduction statics transient"
).split()
TYPED = {"comm", "linearised", "modes", "pairs", "system", "stuck", "settings", "equation", "model", "law"}


ASKS = re.compile(
    r"\.is_constant|\.is_static|harmonics (==|>|!=) 0|highest (==|>) 0|(if|and|or|not) scene\.(solver\.)?harmonics\b"
)
MOST_FILES = 13  # files that query whether a problem is static, except those that define it
ANSWER = {"fourier/harmonics.py", "continuation/problems.py", "results/measures.py", "scene/schema.py"}


def test_few_files_query_whether_a_problem_is_static():
    files = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in ROOT.rglob("*.py")}
    asking = sorted(name for name, text in files.items() if ASKS.search(text) and name not in ANSWER)
    assert len(asking) <= MOST_FILES, asking
    queried = {each[0] for name in asking for each in ASKS.finditer(files[name])}
    assert queried == {".is_constant", ".is_static"}, "Harmonics and Problem say is_constant, Scene and Shown is_static"


@pytest.mark.parametrize("room", BEYOND)
def test_numerics_do_not_use_scenes(room):
    files = sorted((ROOT / room).rglob("*.py"))
    assert files
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert "scene" not in (node.module or "").split(".") and "library" not in (node.module or "").split("."), file
            if isinstance(node, ast.FunctionDef):
                arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
                assert "scene" not in [argument.arg for argument in arguments], f"{file}: {node.name}"
                untyped = [argument.arg for argument in arguments if argument.arg in TYPED and argument.annotation is None]
                assert not untyped, f"{file}: {node.name}: {untyped}"
