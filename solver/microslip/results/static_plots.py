"""Pictures of statics: displacement over the load."""

from __future__ import annotations

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ..messages.words import counted
from .measures import counts
from .record import ResultFile
from .style import INK, LINEAR, STATE_COLOURS, STATE_NAMES, STATE_STYLES, Page, Pages, outputs_by_page, plain, with_prefix

_WIDTH = 4.6  # in


def draw_static_response(results: ResultFile) -> Pages:
    """Draw the displacement of every output over the load.  Local."""
    levels = sorted(results.solved, key=lambda level: level.level)
    loads = np.array([level.level for level in levels])
    handles = [Line2D([], [], color=INK, lw=1.2, marker="o", ms=3.5, label="with slip and opening")]
    handles += [Line2D([], [], label="all stuck, linear", **LINEAR)] if results.linear else []
    pages: Pages = {}
    for number, outputs in outputs_by_page(results):
        page = Page(results, "static displacement over the load", _WIDTH, 0.35 + 2.1 * len(outputs), handles)
        axes = page.grid(len(outputs), 1).subplots(sharex=True, squeeze=False)[:, 0]
        for ax, (k, name) in zip(axes, outputs):
            values = np.array([level.response[0, k, 0] for level in levels])
            linear = results.linear.response[0, k, 0] * np.array([0.0, loads.max()]) if results.linear else np.zeros(2)
            factor, unit = with_prefix(np.concatenate([values, linear]), results.unit_of(k))
            if results.linear:
                ax.plot([0.0, loads.max()], factor * linear, **LINEAR)
            ax.plot(loads, factor * values, "o-", color=INK, lw=1.2, ms=3.5)
            ax.set_ylabel(f"{plain(name, 24)} [{unit}]")
        axes[-1].set_xlabel(f"load level [{results.level_unit}]")
        pages[f"response{number}.png"] = page
    return pages


def draw_static_states(results: ResultFile) -> Pages:
    """Draw how many pairs stick, slip and are open over the load.  Local."""
    levels = sorted(results.solved, key=lambda level: level.level)
    if not levels or results.joint.n_pairs == 0:
        return {}
    handles = [
        Line2D([], [], color=c, ls=s, lw=1.5, marker="o", ms=3.5, label=n)
        for c, s, n in zip(STATE_COLOURS, STATE_STYLES, STATE_NAMES)
    ]
    page = Page(results, f"states of the {counted(results.joint.n_pairs, 'contact pair')} over the load", _WIDTH, 2.4, handles)
    ax = page.figure.add_subplot(page.grid(1, 1)[0, 0])
    for number, colour, style in zip(counts(np.array([level.state[0] for level in levels])).T, STATE_COLOURS, STATE_STYLES):
        ax.plot([level.level for level in levels], number, ls=style, marker="o", ms=3.5, lw=1.5, color=colour)
    ax.yaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set_ylabel("pairs")
    ax.set_xlabel(f"load level [{results.level_unit}]")
    return {"states.png": page}
