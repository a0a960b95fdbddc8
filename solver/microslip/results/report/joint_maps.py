"""Maps of the joint for a report: surfaces laid flat as drawings whose cells the page colours, and the numbers of every pair."""

from html import escape
from typing import Any

import matplotlib
import numpy as np

from ..joint_cycle import joint_values, rest_values
from ..record import Joint, ResultFile
from ..style import STATE_COLOURS, STATE_NAMES, level_name, with_prefix
from ..unroll import Patch, patches

MOST_CELLS = 30_000
_SHAPE = 0.16  # height over width of a drawing below which it is stretched
_QUANTITIES = {  # name in joint_values: heading, unit, palette
    "state": ("state", "", ""),
    "friction_loss_J_m2": ("friction loss per area and cycle", "J/m²", "inferno_r"),
    "friction_loss_J": ("friction loss per cycle", "J", "inferno_r"),
    "slip_amplitude_m": ("amplitude of the slip", "m", "inferno_r"),
    "pressure_Pa": ("mean contact pressure", "Pa", "viridis_r"),
    "pressure_min_Pa": ("least contact pressure", "Pa", "viridis_r"),
    "pressure_max_Pa": ("largest contact pressure", "Pa", "viridis_r"),
    "normal_force_N": ("mean normal force", "N", "viridis_r"),
    "pressure_at_rest_Pa": ("contact pressure at rest", "Pa", "viridis_r"),
    "friction_force_at_rest_N": ("friction force at rest", "N", "viridis_r"),
}


def map_data(results: ResultFile) -> dict[str, Any]:
    """Return, for JSON, the quantities of the maps at the peak of each level: unit and values of the pairs.  Local."""
    levels = [(number, level) for number, level in enumerate(results.levels) if len(level.frequency)]
    at_levels = [joint_values(results.joint, level, level.top) for _, level in levels]
    at_rest = rest_values(results.joint)
    quantities = []
    for name, (heading, unit, palette) in _QUANTITIES.items():
        if name == "friction_loss_J" and any("friction_loss_J_m2" in values for values in at_levels):
            continue
        if name == "normal_force_N" and any("pressure_Pa" in values for values in at_levels):
            continue
        values = [at_rest[name]] * len(levels) if name in at_rest else [values[name] for values in at_levels if name in values]
        if not values or not np.any(values) and name != "state":
            continue
        factor, prefixed = with_prefix(np.concatenate(values), unit) if unit else (1.0, "")
        quantities.append(
            {
                "heading": heading,
                "unit": prefixed,
                "colours": _palette(palette) if palette else STATE_COLOURS,
                "is_state": not palette,
                "values": [[float(f"{factor * value:.4g}") for value in of_level] for of_level in values],
            }
        )
    return {
        "quantities": quantities,
        "levels": [
            {"name": f"{level_name(level, short=True)}, {level.frequency[level.top]:.6g} Hz", "number": n} for n, level in levels
        ],
        "states": STATE_NAMES,
        "labels": [
            f"pair {i}" + (f", nodes {a} and {b}" if b >= 0 else f", node {a}" if a >= 0 else "")
            for i, (a, b) in enumerate(_nodes(results.joint))
        ],
    }


def _nodes(joint: Joint) -> list[tuple[int, int]]:
    return list(zip(joint.node1.tolist(), joint.node2.tolist()))


def _palette(name: str) -> list[str]:
    return [matplotlib.colors.to_hex(colour) for colour in matplotlib.colormaps[name](np.linspace(0.04, 0.96, 24))]


def map_drawings(results: ResultFile) -> str:
    """Return the surfaces as HTML: a drawing each, whose cells name their pairs; "" where there are none or too many.  Local."""
    surfaces = patches(results.joint, results.n_sectors) if results.joint.n_pairs else []
    if sum(len(patch.cells) or len(patch.pairs) for patch in surfaces) > MOST_CELLS:
        return ""
    return "\n".join(map(_drawing, surfaces))


def _drawing(patch: Patch) -> str:
    """Return a surface as SVG in millimetres, or in numbers of pairs where they have no position."""
    unit = 1e3 if patch.to_scale else 1.0
    low, high = patch.corners.min(axis=0), patch.corners.max(axis=0)
    width, height = np.maximum(unit * (high - low), 1e-9)
    stretch = max(1.0, _SHAPE * width / height)

    def ring(points: np.ndarray) -> str:
        flat = unit * (points - low)
        return " ".join(f"{x:.4g},{stretch * (height - y):.4g}" for x, y in flat)

    if patch.cells:
        cells = [f'<polygon data-pair="{pair}" points="{ring(cell)}"/>' for cell, pair in zip(patch.cells, patch.cell_pair)]
        lines = [f'<polygon class="face" points="{ring(face)}"/>' for face in patch.outlines]
    else:
        radius = 0.4 * unit * patch.spacing
        dots = (f'<circle data-pair="{pair}" r="{radius:.4g}"' for pair in patch.pairs)
        places = (ring(point[None]).split(",") for point in patch.points)
        cells, lines = [f'{dot} cx="{x}" cy="{y}"/>' for dot, (x, y) in zip(dots, places)], []
    size = f"{width:.3g} × {height:.3g} mm" + (f", across stretched {stretch:.2g} times" if stretch > 1.01 else "")
    along = f", {patch.x_label} to the right" if patch.x_label else ""
    caption = escape(patch.label) + (
        f" <small>{size}{along}</small>" if patch.to_scale else " <small>pairs in the order of their numbers</small>"
    )
    return (
        f'<figure class="surface"><figcaption>{caption}</figcaption>'
        f'<svg viewBox="0 0 {width:.5g} {stretch * height:.5g}" style="--thin:{width / 600:.3g}px" role="img" '
        f'aria-label="{escape(patch.label)}">{"".join(cells)}{"".join(lines)}</svg></figure>'
    )
