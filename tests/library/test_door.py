"""The scene stops at the door: no room of the numerics imports it, takes it, or leaves a parameter of that kind untyped."""

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
MOST_ASK = 13  # files that ask whether this is static, beside those where it is answered
ANSWER = {"fourier/harmonics.py", "continuation/problems.py", "results/measures.py", "scene/schema.py"}


def test_few_places_ask_whether_all_is_static():
    files = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in ROOT.rglob("*.py")}
    asking = sorted(name for name, text in files.items() if ASKS.search(text) and name not in ANSWER)
    assert len(asking) <= MOST_ASK, asking
    asked = {each[0] for name in asking for each in ASKS.finditer(files[name])}
    assert asked == {".is_constant", ".is_static"}, "Harmonics and Problem say is_constant, Scene and Shown is_static"


@pytest.mark.parametrize("room", BEYOND)
def test_no_scene_beyond_the_door(room):
    files = sorted((ROOT / room).rglob("*.py"))
    assert files
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert "scene" not in (node.module or "").split(".") and "library" not in (node.module or "").split("."), file
            if isinstance(node, ast.FunctionDef):
                arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
                assert "scene" not in [one.arg for one in arguments], f"{file}: {node.name}"
                untyped = [one.arg for one in arguments if one.arg in TYPED and one.annotation is None]
                assert not untyped, f"{file}: {node.name}: {untyped}"
