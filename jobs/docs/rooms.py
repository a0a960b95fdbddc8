"""Draw the folders of the package and their imports: docs/img/rooms.svg.

    python jobs/docs/rooms.py

Imports are read from the sources.  An arrow leads from a folder to one that imports it, in the direction of the data; an arrow
that follows from others, by way of a folder in between, is left out, and so are those from the foundation.  Imports for type
checking only do not count.  This file sets only the positions of the folders.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "solver" / "microslip"
PICTURE = ROOT / "docs" / "img" / "rooms.svg"

# what a room passes on; column (from 0, in widths of a box and its gap) and row
ROOMS = {
    "messages": ("errors, words", 0.0, 0),
    "system": ("files, signals", 1.0, 0),
    "parallel": ("MPI, PETSc", 1.5, 0),
    "guards": ("lock, memory", 2.0, 0),
    "elements": ("K, M of elements", 0.0, 1),
    "fourier": ("Harmonics", 1.5, 1),
    "scene": ("Scene, checked", 2.0, 9),
    "contact": ("Law: p(U), dp/dU", 1.0, 2),
    "receptance": ("ReducedModel: G", 2.0, 2),
    "tables": ("Joint, Load, ...", 0.0, 3),
    "formats": ("model files: FileModel", 0.0, 4),
    "mesh": ("Mesh, ContactPairs", 0.0, 5),
    "points": ("Point, Branch", 1.0, 3),
    "transient": ("motion in time", 2.0, 10),
    "harmonic": ("HarmonicBalance: r", 2.0, 3),
    "error_estimate": ("error bars", 2.0, 4),
    "stability": ("multipliers", 1.0, 4),
    "continuation": ("BranchState", 2.0, 5),
    "assembly": ("System: K, M, C, R", 0.0, 6),
    "linear": ("Linearised: K_L, factor", 0.0, 7),
    "modes": ("Modes", 0.0, 8),
    "statics": ("pairs at rest", 0.0, 9),
    "reduction": ("Reduction, by method", 1.0, 9),
    "results": ("files, pictures", 1.0, 6),
    "observe": ("log, observers", 1.0, 7),
    "library": ("settings, stages", 1.0, 10),
    "restart": ("checkpoints, cache", 0.0, 11),
    "studies": ("compare, verify, trade", 2.0, 12),
    "program": ("command line", 1.0, 11),
}
BY_WAY_OF = {  # columns in which long arrows go down, between the boxes
    ("receptance", "reduction"): 1.48,
    ("points", "reduction"): 1.48,
    ("continuation", "library"): 1.53,
    ("receptance", "transient"): 2.51,
    ("observe", "library"): 0.5,
    ("contact", "transient"): 1.53,
    ("receptance", "statics"): 0.52,
    ("tables", "scene"): 0.49,
    ("linear", "program"): 0.46,
}
FOUNDATION = ("messages", "system", "parallel", "guards")  # for every room: the row at the top, as wide as the page
NUMPY_ONLY = ("elements", "fourier", "contact")
WIDTH, HEIGHT, GAP_X, GAP_Y, MARGIN = 128, 40, 12, 28, 14
ENDS = ("scene", "results", "observe", "library", "restart", "studies", "program")  # input of the user and output of results


@cache
def imports(path: Path, with_types: bool = False) -> set[str]:
    """Return the modules that a file imports: "numpy", "microslip.mesh.data"; for type checking alone only if requested."""
    here = ("microslip", *path.relative_to(PACKAGE).parts[:-1])
    modules = set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree) if with_types else _running(tree):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = here[: len(here) + 1 - node.level] if node.level else ()
            module = ".".join((*base, *([node.module] if node.module else [])))
            modules |= {f"{module}.{alias.name}" for alias in node.names} if module in ("microslip", ".".join(here)) else {module}
    return modules


def _running(node: ast.AST):
    """Yield the nodes below one, without what stands under ``if TYPE_CHECKING``."""
    for child in ast.iter_child_nodes(node):
        yield child
        if isinstance(child, ast.If) and isinstance(child.test, ast.Name) and child.test.id == "TYPE_CHECKING":
            continue
        yield from _running(child)


def rooms() -> list[str]:
    """Return the folders of the package that hold Python."""
    return sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))


def imported() -> dict[str, dict[str, set[str]]]:
    """Return {room: {room that it imports: {files that do}}}."""
    names = rooms()
    importers: dict[str, dict[str, set[str]]] = {room: {} for room in names}
    for room in names:
        for path in (PACKAGE / room).rglob("*.py"):
            for module in imports(path):
                other = module.split(".")[1] if module.startswith("microslip.") else ""
                if other in importers and other != room:
                    importers[room].setdefault(other, set()).add(str(path.relative_to(PACKAGE)))
    return importers


def arrows() -> list[tuple[str, str]]:
    """Return (room, room that imports it), without those that follow from others and those from the foundation."""
    direct = {room: set(others) - set(FOUNDATION) for room, others in imported().items()}
    below = {room: _below(room, direct) for room in direct}
    above = [room for room in direct if room not in FOUNDATION]
    return sorted(
        (other, room) for room in above for other in direct[room] if not any(other in below[one] for one in direct[room])
    )


def _below(room: str, direct: dict[str, set[str]]) -> set[str]:
    """Return all that a room imports, directly or indirectly."""
    below: set[str] = set()
    new = set(direct[room])
    while new:
        below |= new
        new = set().union(*(direct[one] for one in new)) - below
    return below


# -- the picture ---------------------------------------------------------------------------------------------------


def picture() -> str:
    """Return the picture as SVG."""
    width = int(2 * MARGIN + 3 * WIDTH + 2 * GAP_X)
    height = int(2 * MARGIN + (max(row for _, _, row in ROOMS.values()) + 1) * (HEIGHT + GAP_Y) - GAP_Y)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="DejaVu Sans, Arial, sans-serif">',
        "<title>Rooms of microslip and the way values flow between them</title>",
        '<defs><marker id="head" markerWidth="7" markerHeight="6" refX="6.5" refY="3" orient="auto">'
        '<path d="M0,0 L7,3 L0,6 z" fill="#555"/></marker></defs>',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        *(_arrow(a, b) for a, b in arrows()),
        *(_box(room) for room in ROOMS),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _place(room: str) -> tuple[float, float]:
    """Return the upper left corner of a room."""
    _, column, row = ROOMS[room]
    return MARGIN + column * (WIDTH + GAP_X), MARGIN + row * (HEIGHT + GAP_Y)


def _box(room: str) -> str:
    (x, y), width = _place(room), float(WIDTH)
    if room in FOUNDATION:
        width = (3 * WIDTH + (3 - len(FOUNDATION)) * GAP_X) / len(FOUNDATION)
        x = MARGIN + FOUNDATION.index(room) * (width + GAP_X)
    fill = "#e3f1e1" if room in NUMPY_ONLY else "#fdeed8" if room in ENDS else "#e4edf8"
    middle = x + width / 2
    return (
        f'<rect x="{x:.0f}" y="{y:.0f}" width="{width}" height="{HEIGHT}" rx="6" fill="{fill}" stroke="#555"/>'
        f'<text x="{middle:.0f}" y="{y + 17:.0f}" text-anchor="middle" font-size="14" font-weight="bold">{room}</text>'
        f'<text x="{middle:.0f}" y="{y + 32:.0f}" text-anchor="middle" font-size="10.5">{ROOMS[room][0]}</text>'
    )


def _arrow(a: str, b: str) -> str:
    """Return an arrow from the bottom of a room to the top of another, ends moved towards each other."""
    (x0, y0), (x1, y1) = _place(a), _place(b)
    shift = max(-0.3, min(0.3, (x1 - x0) / (3 * WIDTH))) * WIDTH
    x0, y0, x1 = x0 + WIDTH / 2 + shift, y0 + HEIGHT, x1 + WIDTH / 2 - shift
    if (a, b) in BY_WAY_OF:
        x = MARGIN + BY_WAY_OF[a, b] * (WIDTH + GAP_X) + WIDTH / 2
        bend = 0.9 * (HEIGHT + GAP_Y)
        path = f"C{x0:.0f},{y0 + 24:.0f} {x:.0f},{y0 + 8:.0f} {x:.0f},{y0 + bend:.0f} L{x:.0f},{y1 - bend:.0f} "
        path += f"C{x:.0f},{y1 - 12:.0f} {x1:.0f},{y1 - 24:.0f} {x1:.0f},{y1:.0f}"
    else:
        path = f"C{x0:.0f},{y0 + 16:.0f} {x1:.0f},{y1 - 18:.0f} {x1:.0f},{y1:.0f}"
    return f'<path d="M{x0:.0f},{y0:.0f} {path}" fill="none" stroke="#555" stroke-width="1.3" marker-end="url(#head)"/>'


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
    print(PICTURE)
