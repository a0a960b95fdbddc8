"""Data of the three-dimensional views: the outer surface, its motions and shapes, and the joint, packed for the page."""

import base64
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from ..fields import Fields
from ..joint_mesh import joint_mesh
from ..paraview import motion_of_pairs
from ..record import ResultFile
from ..skin_triangles import outer_triangles
from ..style import level_name, some, with_prefix

MOST_NODES, MOST_LEVELS, MOST_MODES, MOST_HARMONICS = 12_000, 8, 12, 5
_MOST_BYTES = 3_000_000  # of all motions, packed to two bytes a number
_MOST_TRIANGLES = 30_000  # of the joint
BODY_COLOURS = ("#8fa8c0", "#c9b38c", "#9dbb98", "#b99cc0", "#c69a94", "#8cbcb9", "#b5b5a0", "#a6a6c4")


def view_data(results: ResultFile, fields: Fields) -> dict[str, Any]:
    """Return the views' data, for JSON: arrays as base64 of little-endian numbers, lengths in metres.  Local.

    Motions are coefficients (n_coefficients, 3, n) of int16 times ``scale``; ``orders`` has the harmonic of each, ``sine``
    whether it is one.  At most 12,000 nodes, 8 levels, 12 modes and harmonics 0 to 5, and fewer nodes where these exceed 3 MB.
    """
    peaks = some(sorted(fields.peaks), MOST_LEVELS)
    n_modes = min(len(fields.shapes), MOST_MODES)
    n_vectors = n_modes + 1 + sum(min(fields.peaks[i].u.shape[2], 2 * MOST_HARMONICS + 1) for i in peaks)
    surface = outer_triangles(fields.mesh, max(500, min(MOST_NODES, _MOST_BYTES // (6 * n_vectors))))
    bodies = [
        _body(surface, k, escape(name)[:40].replace("%", ""), BODY_COLOURS[k % len(BODY_COLOURS)])
        for k, name in enumerate(surface.names)
    ]
    shown = [_of_level(results, fields, number, surface.nodes) for number in peaks]
    shown += [_of_mode(results, fields, k, surface.nodes) for k in range(n_modes)]
    if fields.rest is not None:
        shown.append(_of_rest(fields, surface.nodes))
    return {
        "points": _packed(fields.mesh.points[surface.nodes], "f4"),
        "bodies": [body for body in bodies if body["n"]],
        "edges": _packed(surface.edges, "i4"),
        "shown": shown,
        "joint": _joint(results, fields, peaks),
        "diagonal": fields.mesh.diagonal,
        "coarser": surface.n_outer if surface.n_outer > len(surface.nodes) else 0,
        "n": len(surface.nodes),
    }


def _body(surface, k: int, name: str, colour: str) -> dict[str, Any]:
    nodes, corners = np.unique(surface.triangles[surface.body == k], return_inverse=True)
    return {
        "name": name,
        "colour": colour,
        "n": len(corners) // 3,
        "nodes": _packed(nodes, "i4"),
        "triangles": _packed(corners, "i4"),
    }


def _of_level(results: ResultFile, fields: Fields, number: int, nodes: np.ndarray) -> dict[str, Any]:
    level, motion = results.levels[number], fields.peaks[number]
    size = np.linalg.norm(motion.u[nodes][:, :, 1] - 1j * motion.u[nodes][:, :, 2], axis=1)
    where = results.shown.where(level.frequency[motion.point], 6)
    text = f"peak at {where}" if where else "static displacement"
    return _motion(f"{level_name(level, short=True)}: {text}", "level", number, motion.u[nodes], size)


def _of_mode(results: ResultFile, fields: Fields, k: int, nodes: np.ndarray) -> dict[str, Any]:
    shape = fields.shapes[k][nodes]
    u = np.stack([np.zeros_like(shape), shape], axis=2)
    return _motion(
        f"mode {k + 1}: {results.mode_frequency[k]:.6g} Hz, all pairs stuck", "mode", k, u, np.linalg.norm(shape, axis=1)
    )


def _of_rest(fields: Fields, nodes: np.ndarray) -> dict[str, Any]:
    assert fields.rest is not None
    u = fields.rest[nodes]
    return _motion("displacement at rest, under the constant loads", "rest", 0, u[:, :, None], np.linalg.norm(u, axis=1))


def _motion(name: str, kind: str, number: int, u: np.ndarray, size: np.ndarray) -> dict[str, Any]:
    """Return a motion u (n, 3, n_coefficients) with the numbers that colour it, (n,) m, those of a shape over their largest."""
    u = u[:, :, : 2 * MOST_HARMONICS + 1]
    if not np.any(u[:, :, 1:]):
        size = np.linalg.norm(u[:, :, 0], axis=1)
    factor, unit = (1.0 / (size.max(initial=0.0) or 1.0), "") if kind == "mode" else with_prefix(size, "m")
    shown = {"size": _packed(factor * size, "f4"), "most": float(factor * size.max(initial=0.0)), "unit": unit}
    return {"name": name, "kind": kind, "number": number, **_quantised(u), **shown}


def _quantised(u: np.ndarray) -> dict[str, Any]:
    """Return coefficients (n, 3, n_coefficients) as int16 with their scale and order."""
    scale = float(np.abs(u).max(initial=0.0)) / 32767.0
    orders = [(k + 1) // 2 for k in range(u.shape[2])]
    numbers = np.round(np.moveaxis(u, (2, 1), (0, 1)) / (scale or 1.0))
    return {
        "u": _packed(numbers, "i2"),
        "scale": scale,
        "orders": orders,
        "sine": [k > 0 and k % 2 == 0 for k in range(u.shape[2])],
    }


def _joint(results: ResultFile, fields: Fields, peaks: Sequence[int]) -> dict[str, Any] | None:
    """Return the polygons of the joint as triangles, with the pair of each, and their motions; None where there are none."""
    mesh = joint_mesh(results.joint)
    first, last, pair = [], [], []
    for start, size, of_pair in zip(mesh.offsets[:-1], mesh.sizes, mesh.pair):
        for k in range(1, size - 1):
            first.append(start)
            last.append(start + k)
            pair.append(of_pair)
    if not pair or len(pair) > _MOST_TRIANGLES:
        return None
    triangles = np.column_stack([first, last, np.array(last) + 1])
    motions = {
        str(number): _quantised(
            _spread(mesh.weights, motion_of_pairs(fields, results.joint.node1, number))[:, :, : 2 * MOST_HARMONICS + 1]
        )
        for number in peaks
    }
    return {
        "points": _packed(mesh.points, "f4"),
        "triangles": _packed(triangles, "i4"),
        "pair": _packed(pair, "i4"),
        "motions": motions,
    }


def _spread(weights, u: np.ndarray) -> np.ndarray:
    """Return the motion of points (n_points, 3, N_H) from that of the pairs."""
    return (weights @ u.reshape(len(u), -1)).reshape(weights.shape[0], *u.shape[1:])


def _packed(values, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()).decode("ascii")
