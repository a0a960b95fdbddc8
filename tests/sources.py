"""The sources of the package, their definitions and imports, read without being imported."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOLVER = ROOT / "solver" / "microslip"


@cache
def sources():
    """Return {path: text} of the package's Python and C files, without the output of Cython."""
    files = [*SOLVER.rglob("*.py"), *SOLVER.rglob("*.c")]
    return {path: path.read_text(encoding="utf-8") for path in sorted(files) if not path.with_suffix(".pyx").exists()}


@cache
def definitions(path, source):
    """Return (name, docstring) of functions, classes and their methods, "Class.method"; of C functions the comment above."""
    return list(_functions_of_c(source) if path.suffix == ".c" else _defined(ast.parse(source).body))


def _functions_of_c(source):
    for block in source.split("\n\n"):
        comment, _, code = block.strip().partition("*/\n") if block.strip().startswith("/*") else ("", "", block.strip())
        if name := re.match(r"[A-Za-z_][\w \n*]*?\b(\w+)\([^;]*?\)\n\{", code):
            yield name[1], comment


def _defined(body, within=""):
    for node in body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield within + node.name, ast.get_docstring(node) or ""
            if isinstance(node, ast.ClassDef):
                yield from _defined(node.body, f"{node.name}.")
