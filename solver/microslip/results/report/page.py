"""report.html: everything of a run on one page, from results.h5 alone, that needs no network."""

import json
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from ...messages.errors import CaseError
from ...system.files import atomic_write, make_folder
from ..fields import Fields, RunRecord, read_fields, read_run
from ..read import read_results
from ..record import ResultFile
from . import tables
from .figures import MOST_OUTPUTS, figures_of
from .joint_maps import map_data, map_drawings
from .view import view_data

NAME = "report.html"
# The page sends no request to another machine, and no text in it can.  plotly compiles its shaders' bindings: unsafe-eval.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:; "
    "worker-src blob:; form-action 'none'; base-uri 'none'"
)


def write_report(path: str, folder: str | Path) -> str:
    """Write report.html of a result file into a folder and return its path.  Local; no MPI, no PETSc.

    Raises
    ------
    CaseError : plotly is missing; the result file cannot be read; the folder cannot be written to
    ResourceError : the disk is full
    """
    library = plotly_js()
    results, fields, run = read_results(path), read_fields(path), read_run(path)
    make_folder(str(folder))
    out = str(Path(folder, NAME))
    page = page_of(results, fields, run, library)
    with atomic_write(out) as temporary, open(temporary, "w", encoding="utf-8", errors="replace") as file:
        file.write(page)
    return out


def plotly_js() -> str:
    """Return plotly's library for browsers, which the page includes.  Raises CaseError: plotly is not installed."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise CaseError("report needs plotly, which draws its curves; install it: pip install plotly") from None
    return str(get_plotlyjs())


def page_of(results: ResultFile, fields: Fields | None, run: RunRecord, library: str) -> str:
    """Return the page.  Local.

    Parameters
    ----------
    results : read with motion
    library : plotly.js
    """
    figures, drawings = figures_of(results), map_drawings(results)
    data: dict[str, Any] = {
        "figures": figures,
        "maps": map_data(results) if results.joint.n_pairs else None,
        "view": None if fields is None else view_data(results, fields),
    }
    folder = files(__package__)
    title, version = escape(results.title), escape(results.versions.get("microslip", ""))
    sections = _sections(results, fields, run, figures, drawings)
    links = "".join(f'<a href="#{key}">{head}</a>' for key, head, _ in sections)
    body = "".join(f'<section id="{key}"><h2>{head}</h2>{text}</section>' for key, head, text in sections)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{title}</title>\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{folder.joinpath('report.css').read_text(encoding='utf-8')}</style>\n</head>\n<body>\n"
        f"<header><h1>{title}</h1><p>{_subtitle(results, run)}</p><nav>{links}</nav></header>\n<main>{body}</main>\n"
        f"<footer>Made by microslip {version} from results.h5. This page needs no network.</footer>\n"
        f'<div id="tip" hidden></div>\n<noscript>Curves, maps and views need JavaScript; tables do not.</noscript>\n'
        f'<script type="application/json" id="data">{_json(data)}</script>\n'
        f"<script>{library}</script>\n<script>{folder.joinpath('report.js').read_text(encoding='utf-8')}</script>\n</body>\n</html>\n"
    )


def _json(data) -> str:
    """Return data in a form whose texts cannot end the script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return (
        text.replace("<", "\\u003c")
        .replace(">", "\\u003e")
        .replace("&", "\\u0026")
        .replace("\u2028", "\\u2028")
        .replace("\u2029", "\\u2029")
    )


def _subtitle(results: ResultFile, run: RunRecord) -> str:
    """Return a line on the method, command and date of the run."""
    date = next((line.split(None, 1)[1] for note in run.notes[:1] for line in note.splitlines() if line.startswith("date ")), "")
    ranks = next(
        (line.split(None, 1)[1] for note in run.notes[:1] for line in note.splitlines() if line.startswith("ranks ")), ""
    )
    parts = [f"scene {results.name}", f"method {results.method}", ranks, date]
    return escape(" · ".join(part for part in parts if part))


def _sections(
    results: ResultFile, fields: Fields | None, run: RunRecord, figures: dict, drawings: str
) -> list[tuple[str, str, str]]:
    """Return key, heading and HTML of the existing sections."""
    sections = [
        (
            "summary",
            "Summary",
            tables.warnings_list(run.notes) + tables.cards(results) + tables.disc_note(results) + tables.peaks_table(results),
        )
    ]
    sections.append(
        (
            "response",
            "Response",
            _response(results, figures) + tables.solved_peaks_table(results) + tables.bifurcations_table(results),
        )
    )
    if results.over:
        sections.append(("over", "Peaks over a number", _over(results, figures)))
    if of_numbers := tables.sensitivities_table(results):
        sections.append(("sensitivities", "Sensitivities", of_numbers))
    if of_wear := tables.wear_table(results):
        sections.append(("wear", "Wear", of_wear))
    if fields is not None:
        sections.append(("motion", "Motion", _MOTION))
    if results.joint.n_pairs and results.solved:
        sections.append(("joint", "Joint", _joint(figures, drawings)))
    sections.append(("checks", "Energy and checks", tables.checks_list(results) + _places(figures, "energy", "error", "closure")))
    sections.append(("modes", "Natural frequencies", tables.modes_table(results)))
    mesh = _MESH if fields is not None else ""
    sections.append(
        ("model", "What was understood", f'<div class="halves"><div>{tables.understood(results, fields)}</div>{mesh}</div>')
    )
    times = f'<div class="halves"><div>{tables.times_table(results, run)}</div><div>{tables.versions_table(results)}</div></div>'
    sections.append(("times", "Times and versions", times + _places(figures, "unknowns")))
    times += tables.origin_table(results)
    texts = f"<details><summary>the scene as it was run</summary><pre>{escape(results.scene_text)}</pre></details>"
    if run.notes:
        texts += f"<details><summary>notes of the run</summary><pre>{escape(chr(10).join(run.notes))}</pre></details>"
    sections.append(("scene", "Scene and log", texts))
    return sections


_MOTION = """
<div class="controls"><label>show <select id="shown"></select></label>
<button id="play" type="button">pause</button>
<label><input id="spin" type="checkbox" checked> turn</label>
<label><input id="clear" type="checkbox" checked> see through</label>
<label><input id="alone" type="checkbox"> joint alone</label>
<label>scale <input id="scale" type="range" min="-2" max="2" step="0.05" value="0"> <output id="times"></output></label></div>
<div id="view" class="view" role="img" aria-label="the structure in motion, with the states of the joint"></div>
<p class="note" id="view-note"></p>"""

_MESH = """
<div><div id="mesh" class="view" role="img" aria-label="the mesh"></div>
<p class="note">The mesh at rest, bodies by colour; contact surfaces in red. Drag to turn it.</p></div>"""


def _response(results: ResultFile, figures: dict) -> str:
    """Return the curves of the outputs."""
    parts = []
    for k, name in enumerate(results.outputs[:MOST_OUTPUTS]):
        parts.append(f"<h3>{escape(name)}</h3>{_places(figures, f'response_{k}', f'per_level_{k}')}")
        parts.append(_places(figures, f"peaks_{k}", f"peak_frequency_{k}", f"peak_damping_{k}"))
    if len(results.outputs) > MOST_OUTPUTS:
        parts.append(f"<p>{len(results.outputs) - MOST_OUTPUTS} more outputs are in frf.csv and results.h5.</p>")
    if "per_level_0" in figures:
        parts.append(
            '<p class="note">Harmonic 1; left the amplitude, right per unit of the level: equal curves mean that all is linear.'
            " The band is the error bar. Drag to zoom, double-click to zoom out, click a level to hide it.</p>"
        )
    return "".join(parts)


def _over(results: ResultFile, figures: dict) -> str:
    """Return the peaks over numbers of the scene."""
    parts = []
    for i, curve in enumerate(results.over):
        what = f"{escape(results.outputs[curve.linear.output])} over {escape(curve.key)}"
        where = "" if curve.key == "level" else f" at {curve.points.level:g} {escape(results.level_unit)}"
        parts.append(f"<h3>{what}{where}</h3>{_places(figures, f'over_{i}', f'over_frequency_{i}', f'over_damping_{i}')}")
        if curve.points.failure:
            parts.append(f'<p class="note">It ended early: {escape(curve.points.failure)}</p>')
    return "".join(parts) + '<p class="note">All points are in peaks_over.csv, with error bars and the states of the pairs.</p>'


def _joint(figures: dict, drawings: str) -> str:
    """Return the maps with their controls, and the states along the curves."""
    if not drawings:
        return (
            _places(figures, "states")
            + '<p class="note">The joint has too many cells to be drawn here; slip_map.png shows it.</p>'
        )
    return (
        '<div class="controls"><label>level <select id="map-level"></select></label>'
        '<label>show <select id="map-quantity"></select></label></div>'
        f'<div class="surfaces">{drawings}</div><div id="legend"></div>'
        '<p class="note">Contact surfaces laid flat, at the peak of the level; a cell is the area of a pair.</p>'
        + _places(figures, "states")
    )


def _places(figures: dict, *names: str) -> str:
    """Return the places of the existing figures."""
    places = "".join(f'<div class="figure" data-figure="{name}"></div>' for name in names if name in figures)
    return f'<div class="figures">{places}</div>' if places else ""
