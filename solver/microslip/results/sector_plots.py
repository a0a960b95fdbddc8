"""Results by sector of a disc whose sectors may differ, as a picture."""

from __future__ import annotations

import numpy as np
from matplotlib.lines import Line2D

from ..fourier.coefficients import amplitude
from ..points.peak import top_of_curve
from .record import ResultFile
from .style import FAINT, WIDTH, Page, Pages, level_colours, level_name, plain, with_prefix


def draw_sectors(results: ResultFile) -> Pages:
    """Draw largest amplitude and friction loss of each sector of a whole disc, a line for each level.  Local."""
    N, levels = results.n_sectors, results.solved
    if N == 1 or not levels:
        return {}
    n_outputs = len(results.outputs) // N
    sizes = [amplitude(level.response[:, ::n_outputs]) / (abs(level.level) or 1.0) for level in levels]  # (n_points, N)
    tops = [np.array([top_of_curve(level.frequency, of_sector)[1] for of_sector in size.T]) for level, size in zip(levels, sizes)]
    losses = [level.energy[int(np.argmax(size.max(axis=1)))].reshape(N, -1).sum(axis=1) for level, size in zip(levels, sizes)]
    colours = level_colours(len(levels))
    lines = {"marker": "o", "ms": 3.0, "lw": 0.9, "clip_on": False}
    handles = [Line2D([], [], color=colour, label=level_name(level), **lines) for level, colour in zip(levels, colours)]
    name = plain(results.outputs[0].removesuffix(" 0"), 30)
    heading = (
        f"by sector: largest amplitude of harmonic 1 of {name} (dashed: root mean square); friction loss at the largest of all"
    )
    page = Page(results, heading, WIDTH, 4.4, handles)
    top, bottom = page.grid(2, 1).subplots(sharex=True)
    factor, unit = with_prefix([top.max() for top in tops], f"{results.unit_of(0)}/{results.level_unit}")
    of_losses, joule = with_prefix([0.0, *(float(loss.max()) for loss in losses)], "J")
    for of_sectors, loss, colour in zip(tops, losses, colours):
        peaks = factor * of_sectors
        top.plot(range(N), peaks, color=colour, **lines)
        top.axhline(float(np.sqrt(np.mean(peaks**2))), color=colour, lw=0.7, ls="--", zorder=1.0)
        bottom.plot(range(N), of_losses * loss, color=colour, **lines)
    top.set(ylabel=f"amplitude [{unit}]", ylim=(0.0, None))
    bottom.set(ylabel=f"friction loss [{joule}]", xlabel="sector", ylim=(0.0, None))
    bottom.xaxis.get_major_locator().set_params(integer=True)
    for axes in (top, bottom):
        axes.grid(axis="x", color=FAINT, lw=0.2)
    return {"sectors.png": page}
