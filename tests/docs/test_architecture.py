"""docs/architecture.md: its rooms are those of the package, imports have one direction, its picture is that of the code."""

import ast
import graphlib
import re
import sys

import pytest
from sources import ROOT, SOLVER

sys.path.append(str(ROOT / "jobs" / "docs"))

import rooms

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
ORDER = re.findall(r"^\| `(\w+)/` \|", PAGE, flags=re.M)


def test_the_rooms_of_the_page_are_those_of_the_package():
    assert sorted(ORDER) == rooms.rooms() == sorted(rooms.ROOMS)


def test_rooms_import_only_earlier_rooms_of_the_page():
    imported = rooms.imported()
    assert sum(map(len, imported.values())) > 50
    wrong = {
        (room, other): files
        for room in ORDER
        for other, files in imported[room].items()
        if ORDER.index(other) > ORDER.index(room)
    }
    assert wrong == {}


def test_imports_have_no_cycles_even_for_types():
    files = {".".join(path.relative_to(SOLVER.parent).with_suffix("").parts): path for path in SOLVER.rglob("*.py")}
    order = graphlib.TopologicalSorter({name: rooms.imports(path, with_types=True) for name, path in files.items()})
    assert len([name for name in order.static_order() if name in files]) == len(files)


def test_every_imported_module_exists():
    used = {module: path for path in SOLVER.rglob("*.py") for module in rooms.imports(path, with_types=True)}
    for path in (path for folder in ("tests", "jobs") for path in (ROOT / folder).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        used |= dict.fromkeys(re.findall(r"^ *from (microslip\.[\w.]+) import", text, flags=re.M), path)
    own_modules = {module: path for module, path in used.items() if module.startswith("microslip.")}
    names = {".".join(path.relative_to(SOLVER.parent).with_suffix("").parts) for path in SOLVER.rglob("*.py*")}
    existing = names | {name.removesuffix(".__init__") for name in names}
    assert len(own_modules) > 100
    assert not {module: path for module, path in own_modules.items() if module not in existing}


@pytest.mark.slow
def test_rooms_of_numpy_only_import_neither_mpi_nor_petsc():
    assert all(f"`{room}/`" in re.search(r"So (.*) need neither MPI nor PETSc", PAGE)[1] for room in rooms.NUMPY_ONLY)
    allowed = {"numpy", "scipy", "microslip", *sys.stdlib_module_names}
    for room in rooms.NUMPY_ONLY:
        assert set(rooms.imported()[room]) <= set(rooms.NUMPY_ONLY), room
        for path in (SOLVER / room).rglob("*.py"):
            assert {module.split(".")[0] for module in rooms.imports(path)} <= allowed, path


def test_the_scene_is_imported_only_by_the_rooms_of_the_page():
    stated = set(re.findall(r"`(\w+)/`", re.search(r"The scene is imported by (.*) alone of all rooms", PAGE)[1]))
    importing = {room for room, others in rooms.imported().items() if "scene" in others}
    assert importing and importing <= stated


def test_every_file_named_on_the_page_exists():
    files = re.findall(r"`([\w/]+\.py)`", PAGE)
    assert len(files) > 15
    assert not {file for file in files if not (SOLVER / file).is_file()}


PATHS = {  # the names of a value on its path
    "levels": "levels?|at_level",
    "mu": "mu|friction",
    "harmonics": "harmonics",
    "static column": r"static|columns|G_static|entries|active",
    "displacement": r"outputs?|out_\w+|output_\w+|displacement|response|point",
}


def defined(path, name):
    """Return the source of a function, class or "Class.method"; for C and Cython the text after its name."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return text[re.search(rf"\b{name}\b", text).end() :]
    node = ast.parse(text)
    for part in name.split("."):
        (node,) = [child for child in node.body if getattr(child, "name", "") == part]
    return ast.get_source_segment(text, node)


@pytest.mark.parametrize("value", PATHS)
def test_the_path_of_a_value_is_that_of_the_code(value):
    (row,) = re.findall(rf"^\| `{value}`.*$", PAGE.partition("## Paths of values")[2], flags=re.M)
    _, way, files = (cell.strip() for cell in row.strip("|").split(" | "))
    steps = re.findall(r"`([\w/]+\.\w+)` `([\w.]+)`", way)
    assert len({file for file, _ in steps}) == int(files) == way.count(",") + 1
    for file, name in steps:
        assert re.search(rf"\b({PATHS[value]})\b", defined(SOLVER / file, name)), file


def test_only_the_contact_law_computes_with_mu():
    numerics = ("continuation", "error_estimate", "harmonic", "receptance", "reduction", "transient")
    assert not [
        path for room in numerics for path in (SOLVER / room).rglob("*.py") if re.search(r"\.mu\b", path.read_text("utf-8"))
    ]


def test_the_picture_is_that_of_the_code():
    assert rooms.PICTURE.read_text(encoding="utf-8") == rooms.picture(), "run python jobs/docs/rooms.py, and look at it"


def test_imports_for_type_checking_are_not_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(rooms, "PACKAGE", tmp_path)
    for room, text in (
        ("one", "from ..two.sub import a\nfrom .. import three\nif TYPE_CHECKING:\n    from ..four import b\n"),
        ("two", "import numpy\n\n\ndef late():\n    from ..three import c\n"),
        ("three", ""),
        ("four", ""),
    ):
        (tmp_path / room).mkdir()
        (tmp_path / room / "__init__.py").write_text("")
        (tmp_path / room / "file.py").write_text(text)
    imported = {room: set(others) for room, others in rooms.imported().items()}
    assert imported == {"one": {"two", "three"}, "two": {"three"}, "three": set(), "four": set()}
    assert rooms.arrows() == [("three", "two"), ("two", "one")]


@pytest.mark.parametrize("room", rooms.ROOMS)
def test_texts_fit_the_boxes_of_the_picture(room):
    assert len(room) <= 14 and (room in rooms.FOUNDATION or len(rooms.ROOMS[room][0]) <= 23)
