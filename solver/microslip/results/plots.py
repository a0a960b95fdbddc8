"""Every picture of a run, from its result file alone."""

from __future__ import annotations

from collections.abc import Callable

import matplotlib

from ..messages.errors import CaseError
from ..system.files import file_errors, make_folder
from .curve_plots import draw_energy, draw_error, draw_response, draw_rom_size, draw_states
from .joint_plots import draw_energy_map, draw_rest, draw_sensitivity_map, draw_slip_map
from .over_plots import draw_peaks_over
from .peak_plots import draw_peaks
from .read import read_results
from .record import ResultFile
from .sector_plots import draw_sectors
from .stability_plots import draw_multipliers
from .static_plots import draw_static_response, draw_static_states
from .style import RC, Page, Pages

Picture = Callable[[ResultFile], Pages]
PICTURES: tuple[Picture, ...] = (  # ordered so that shares of every second, third or fourth picture take about the same time
    draw_response,
    draw_error,
    draw_slip_map,
    draw_energy,
    draw_energy_map,
    draw_rom_size,
    draw_states,
    draw_rest,
    draw_peaks,
    draw_sensitivity_map,
    draw_multipliers,
    draw_sectors,
    draw_peaks_over,
)
STATIC_PICTURES: tuple[Picture, ...] = (draw_static_response, draw_static_states, draw_slip_map, draw_rest)


def draw_all(results_path: str, out_dir: str, share: slice = slice(None)) -> list[str]:
    """Draw all pictures of a result file, or a share of them, into a folder and return the files.  Local; no MPI, no PETSc.

    response.png, peaks.png, peaks_over.png, multipliers.png, states.png, slip_map.png, rom_size.png, energy.png,
    energy_map.png, sensitivity_map.png, error.png, sectors.png and rest.png.  Pictures without data (no peaks, multipliers,
    sectors, joint, converged point or statics) are omitted.  Statics alone have response.png and states.png over the load,
    slip_map.png and rest.png.

    Raises
    ------
    CaseError : the result file cannot be read (as :func:`read_results`), or the folder cannot be written to
    ResourceError : the disk is full
    """
    results = read_results(results_path, motion=False)
    make_folder(out_dir)
    if not results.solved:
        return []
    with matplotlib.rc_context(RC), file_errors(out_dir):
        drawn = (named for draw in pictures_of(results)[share] for named in draw(results).items())
        return [page.save(f"{out_dir}/{name}") for name, page in drawn]


def draw_one(results: ResultFile, name: str) -> list[Page]:
    """Return the pages of the picture of this name.  Local.

    Raises
    ------
    CaseError : the results have no such picture
    """
    by_name = {draw.__name__.removeprefix("draw_").removeprefix("static_"): draw for draw in pictures_of(results)}
    if name not in by_name:
        raise CaseError(f"there is no picture {name!r} of these results; there are {', '.join(by_name)}")
    with matplotlib.rc_context(RC):
        pages = by_name[name](results) if results.solved else {}
    if not pages:
        raise CaseError(f"there is nothing to draw in {name}")
    return list(pages.values())


def pictures_of(results: ResultFile) -> tuple[Picture, ...]:
    """Return the pictures that can be drawn of results.  Local."""
    return STATIC_PICTURES if results.shown.is_static else PICTURES
