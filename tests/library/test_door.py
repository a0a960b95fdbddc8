"""The scene stops at the door: no room of the numerics imports it, takes it, or leaves a parameter of that kind untyped."""

import ast
from pathlib import Path

import pytest

import microslip

ROOT = Path(microslip.__file__).parent
BEYOND = (
    "assembly contact continuation elements error_estimate fourier harmonic linear mesh modes parallel receptance reduction transient"
).split()
TYPED = {"comm", "linearised", "modes", "pairs", "system", "stuck", "settings"}


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
