"""The picture of a mesh with its sets: shaded bodies, and the sets drawn among the edges of the bodies."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ...mesh.data import Mesh
from ...mesh.skin import Skin, groups_of_bodies, skin_of_mesh
from ...messages.words import counted
from ...results.style import FAINT, INK, RC, Page, plain, view_from
from ...system.files import file_errors, make_folder

BODY_COLOURS = ("#9db8d2", "#d9c7a3", "#b5ceb0", "#cbb4cf", "#e3b7a8", "#a8d1cf", "#d3d3a4", "#b9b9c9")
SET_COLOURS = ("#d1495b", "#e08e00", "#00798c", "#7b4fa3", "#4f8f2f", "#b5651d", "#0057b8", "#c2185b")
MOST_FACES = 30_000  # faces drawn; larger meshes are coarsened
MOST_NAMED = 12  # bodies and sets in the legend
_SHARP = np.cos(np.radians(30.0))  # cosine of the angle from which an edge is drawn
_MESH_LINES = 8_000  # faces up to which their edges are drawn
WIDTH = 9.0  # in
PICTURE = "mesh.png"


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A set to mark: faces, nodes, or a point with an arrow."""

    label: str
    faces: Sequence[np.ndarray] = ()  # (n_faces, n_nodes) each, corners first
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3) m
    marker: str = "o"
    direction: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class _Title:
    title: str
    name: str = ""


def draw(folder: Path, mesh: Mesh, marks: Sequence[Mark], title: str) -> list[str]:
    """Write the picture into a folder and return a line with its path.  Local, rank 0.

    Raises
    ------
    CaseError, ResourceError : the folder cannot be written to
    """
    path = str(folder / PICTURE)
    make_folder(str(folder))
    with file_errors(path):
        _page(mesh, marks, title).save(path)
    return [f"picture    {path}"]


def _page(mesh: Mesh, marks: Sequence[Mark], title: str) -> Page:
    skin = skin_of_mesh(mesh)
    view = view_from(24.0, -56.0)
    flat = mesh.points @ view[1:].T
    wide = np.ptp(flat[:, 0]) > 1.4 * np.ptp(flat[:, 1])
    each = (WIDTH, WIDTH * np.ptp(flat[:, 1]) / np.ptp(flat[:, 0])) if wide else (WIDTH / 2, 0.0)
    height = (
        2.0 * np.clip(each[1], 1.2, 4.5) + 0.5 if wide else np.clip(WIDTH / 2 * np.ptp(flat[:, 1]) / np.ptp(flat[:, 0]), 3.0, 7.0)
    )
    names = groups_of_bodies(mesh)
    heading = (
        f"{counted(len(mesh.points), 'node')}, {counted(sum(len(block.nodes) for block in mesh.elements), 'element')} "
        f"in {counted(len(names), 'body')}; "
        "first the bodies, then what lies between and on them"
    )
    with matplotlib.rc_context(RC):
        page = Page(_Title(title), heading, WIDTH, float(height), _handles(names, marks))
        cells = page.grid(2, 1) if wide else page.grid(1, 2)
        whole, inside = (page.figure.add_subplot(cell) for cell in cells)
        _bodies(whole, skin, view)
        _sets(inside, skin, marks, view)
        low, high = flat.min(axis=0), flat.max(axis=0)
        room = 0.08 * (high - low).max()
        for axes in (whole, inside):
            axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room), aspect="equal")
            axes.set_axis_off()
        _triad(whole, view, mesh.points, low - 0.6 * room)
        return page


def _handles(names: Sequence[str], marks: Sequence[Mark]) -> list:
    """Return the entries of the legend."""
    bodies = [
        Patch(facecolor=BODY_COLOURS[i % len(BODY_COLOURS)], edgecolor=FAINT, label=plain(name, 30))
        for i, name in enumerate(names)
    ]
    handles = bodies[:MOST_NAMED]
    if len(bodies) > MOST_NAMED:
        handles.append(Patch(facecolor="none", edgecolor="none", label=f"and {len(bodies) - MOST_NAMED} more bodies"))
    for i, mark in enumerate(marks[:MOST_NAMED]):
        colour, label = SET_COLOURS[i % len(SET_COLOURS)], plain(mark.label, 40)
        if len(mark.faces):
            handles.append(Patch(facecolor=colour, alpha=0.75, label=label))
        else:
            handles.append(Line2D([], [], color=colour, marker=mark.marker, linestyle="none", markersize=5.0, label=label))
    if len(marks) > MOST_NAMED:
        handles.append(Patch(facecolor="none", edgecolor="none", label=f"and {len(marks) - MOST_NAMED} more sets"))
    return handles


def _bodies(axes, skin: Skin, view: np.ndarray) -> None:
    """Draw the faces towards the viewer, from far to near."""
    corners, body = _coarse(skin)
    points = skin.points[corners]
    normal = np.cross(points[:, 2] - points[:, 0], points[:, 3] - points[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    towards = normal @ view[0]
    visible = np.flatnonzero(towards > 0.01)
    visible = visible[np.argsort(points[visible].mean(axis=1) @ view[0], kind="stable")]
    shade = (0.62 + 0.38 * np.maximum(towards[visible], normal[visible] @ _lit(view)))[:, None]
    colours = np.array([matplotlib.colors.to_rgb(BODY_COLOURS[i % len(BODY_COLOURS)]) for i in range(body.max(initial=0) + 1)])
    faces = np.clip(colours[body[visible]] * shade, 0.0, 1.0)
    lines = (
        {"edgecolors": "#33404d", "linewidths": 0.25} if len(visible) <= _MESH_LINES else {"edgecolors": faces, "linewidths": 0.3}
    )
    axes.add_collection(PolyCollection(points[visible] @ view[1:].T, facecolors=faces, **lines))


def _lit(view: np.ndarray) -> np.ndarray:
    """Return the direction of the light: over the viewer's left shoulder."""
    light = view[0] - 0.5 * view[1] + 0.7 * view[2]
    return light / np.linalg.norm(light)


def _coarse(skin: Skin) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (n, 4) and bodies (n,) of the faces to draw; for many faces, nearby nodes are merged."""
    corners = skin.corners
    if len(corners) <= MOST_FACES:
        return corners, skin.body
    grain = np.sqrt(skin.area.sum() / MOST_FACES)
    cell = np.round(skin.points / grain).astype(np.int64)
    _, first, same = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    moved = first[same.ravel()][corners]
    n_distinct = 4 - (np.diff(np.sort(moved, axis=1), axis=1) == 0).sum(axis=1)
    is_triangle = np.flatnonzero(n_distinct >= 3)
    _, once = np.unique(np.sort(moved[is_triangle], axis=1), axis=0, return_index=True)
    return moved[is_triangle[once]], skin.body[is_triangle[once]]


def _sets(axes, skin: Skin, marks: Sequence[Mark], view: np.ndarray) -> None:
    """Draw the edges of the bodies, and the sets among them."""
    axes.add_collection(LineCollection(skin.points[_edges(skin)] @ view[1:].T, colors=FAINT, linewidths=0.5, alpha=0.8))
    size = 0.09 * np.linalg.norm(np.ptp(skin.points, axis=0))
    for i, mark in enumerate(marks):
        colour = SET_COLOURS[i % len(SET_COLOURS)]
        for faces in mark.faces:
            outlines = skin.points[faces[:, : 3 if faces.shape[1] in (3, 6) else 4]] @ view[1:].T
            axes.add_collection(PolyCollection(outlines, facecolors=colour, edgecolors=colour, linewidths=0.2, alpha=0.55))
        flat = mark.points @ view[1:].T
        if len(flat):
            axes.plot(*flat.T, mark.marker, color=colour, markersize=5.0 if len(flat) < 4 else 2.5, zorder=4)
        if mark.direction is not None and len(flat):
            arrow = size * np.array(mark.direction) / np.linalg.norm(mark.direction) @ view[1:].T
            start = flat.mean(axis=0)
            style = {"arrowstyle": "-|>", "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", start, start - arrow, arrowprops=style, zorder=5)


def _edges(skin: Skin) -> np.ndarray:
    """Return the sharp edges and boundary edges of a skin, (n, 2)."""
    corners = skin.corners
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    owner = np.repeat(np.arange(len(corners)), corners.shape[1])
    real = ends[:, 0] != ends[:, 1]
    ends, owner = ends[real], owner[real]
    order = np.lexsort(ends.T)
    ends, owner = ends[order], owner[order]
    follows = (np.diff(ends, axis=0) == 0).all(axis=1)
    pairs = np.flatnonzero(follows)
    turned = np.einsum("ei,ei->e", skin.normal[owner[pairs]], skin.normal[owner[pairs + 1]]) < _SHARP
    alone = ~np.concatenate([follows, [False]]) & ~np.concatenate([[False], follows])
    return np.concatenate([ends[pairs[turned]], ends[alone]])


def _triad(axes, view: np.ndarray, points: np.ndarray, origin: np.ndarray) -> None:
    """Draw the three axes with their length."""
    size = float(np.linalg.norm(np.ptp(points, axis=0))) / 8.0
    power = 10.0 ** np.floor(np.log10(size))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= size)
    arrows = length * view[1:].T
    origin = origin - np.minimum(arrows, 0.0).min(axis=0)
    for name, arrow in zip("xyz", arrows, strict=True):
        axes.annotate(
            "", origin + arrow, origin, arrowprops={"arrowstyle": "->", "shrinkA": 0, "shrinkB": 0, "lw": 0.8, "color": INK}
        )
        axes.annotate(name, origin + 1.25 * arrow, ha="center", va="center", annotation_clip=False)
    axes.annotate(
        f"axes: {length:g} m", origin + [1.3 * length, -0.1 * length], ha="left", va="top", fontsize=7, annotation_clip=False
    )
