"""Draw a mesh file: the bodies, and the surfaces in contact with their pairs of nodes.

    python meshes/picture.py meshes/fan_small.msh --out docs/img/fan_small.png
    python meshes/picture.py meshes/bolted_lap.msh --surfaces lap_1 lap_2 --out docs/img/bolted_lap.png

Contact is drawn where nodes of two bodies coincide, or on the named surfaces.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import meshio
import numpy as np
from blocks import Body, skin
from matplotlib.collections import PolyCollection
from scipy.spatial import cKDTree

MESHIO_KINDS = {"hexahedron": "hex8", "hexahedron20": "hex20", "tetra": "tet4", "tetra10": "tet10", "wedge": "wedge6"}
BODY_COLOURS = ("#9db8d2", "#d9c7a3", "#b5ceb0", "#cbb4cf")
CONTACT_COLOUR = "#d1495b"
EDGE_COLOUR = "#33404d"


def read_bodies(path: str) -> dict[str, Body]:
    """Return the physical volumes of a Gmsh file, each of one kind; they share the file's points.  Local."""
    mesh = meshio.read(path)
    names = {int(tag): name for name, (tag, dimension) in mesh.field_data.items() if dimension == 3}
    bodies = {}
    for cells, tags in zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True):
        for tag in np.unique(tags) if cells.type in MESHIO_KINDS else ():
            kind, elements = MESHIO_KINDS[cells.type], cells.data[tags == tag]
            bodies[names.get(int(tag), str(tag))] = Body(kind, mesh.points, elements, {})
    return bodies


def contact_nodes(bodies: dict[str, Body]) -> np.ndarray:
    """Return the nodes that coincide with a node of another body, (n,).  Local."""
    body_of = np.full(len(next(iter(bodies.values())).points), -1)
    for i, body in enumerate(bodies.values()):
        body_of[body.elements] = i
    used = np.flatnonzero(body_of >= 0)
    points = next(iter(bodies.values())).points[used]
    pairs = used[cKDTree(points).query_pairs(1e-6 * np.linalg.norm(np.ptp(points, axis=0)), output_type="ndarray")]
    return np.unique(pairs[body_of[pairs[:, 0]] != body_of[pairs[:, 1]]])


def surface_nodes(path: str, names: Sequence[str]) -> np.ndarray:
    """Return the nodes of named surfaces of a Gmsh file, (n,).  Local.

    Raises
    ------
    ValueError: a name that no surface has.
    """
    mesh = meshio.read(path)
    tags = {name: int(tag) for name, (tag, dimension) in mesh.field_data.items() if dimension == 2}
    missing = [name for name in names if name not in tags]
    if missing:
        raise ValueError(f"{path} has no surface {missing[0]!r}; its surfaces: {', '.join(sorted(tags))}")
    wanted = [tags[name] for name in names]
    of_cells = zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True)
    return np.unique(np.concatenate([cells.data[np.isin(own, wanted)].ravel() for cells, own in of_cells if cells.dim == 2]))


def draw(path: str, out: str, dpi: int = 100, surfaces: Sequence[str] = ()) -> None:
    """Write the picture: the whole mesh, a side view, the joint from its front, the contact faces.  Local."""
    bodies = read_bodies(path)
    contact = surface_nodes(path, surfaces) if surfaces else contact_nodes(bodies)
    points = next(iter(bodies.values())).points
    x, _, z = np.ptp(points, axis=0)
    figure = plt.figure(figsize=(11.0, 6.6))
    if z > x:
        places = figure.add_gridspec(
            2, 3, width_ratios=(1.0, 0.8, 2.0), left=0.01, right=0.98, top=0.9, bottom=0.08, hspace=0.32, wspace=0.25
        )
        whole, side, joint, surface = places[:, 0], places[:, 1], places[0, 2], places[1, 2]
    else:
        places = figure.add_gridspec(
            3, 2, height_ratios=(1.4, 0.35, 1.2), left=0.07, right=0.98, top=0.93, bottom=0.08, hspace=0.45
        )
        whole, side, joint, surface = places[0, :], places[1, :], places[2, 0], places[2, 1]
    _whole(figure.add_subplot(whole), bodies)
    _side(figure.add_subplot(side), bodies, EAST if z > x else SOUTH)
    _joint(figure.add_subplot(joint), bodies, contact)
    _surface(figure.add_subplot(surface), bodies, contact)
    n_elements = sum(len(body.elements) for body in bodies.values())
    n_nodes = len(np.unique(np.concatenate([body.elements.ravel() for body in bodies.values()])))
    joint = f"contact of {' and '.join(surfaces)}" if surfaces else f"{len(contact) // 2} contact pairs"
    figure.suptitle(f"{os.path.basename(path)}: {n_nodes} nodes, {n_elements} elements, {joint}")
    figure.savefig(out, dpi=dpi)
    plt.close(figure)


def _whole(axes, bodies: dict[str, Body]) -> None:
    """Draw all bodies from above, before and beside, a colour for each."""
    view = _view(22.0, -52.0)
    _paint(axes, bodies, view, 0.25)
    _triad(axes, view, 1e3 * next(iter(bodies.values())).points)
    handles = [plt.Rectangle((0, 0), 1, 1, facecolor=colour, edgecolor=EDGE_COLOUR) for colour in BODY_COLOURS]
    axes.figure.legend(handles, list(bodies), loc="upper left", frameon=False)


def _side(axes, bodies: dict[str, Body], view: np.ndarray) -> None:
    _paint(axes, bodies, view, 0.25)
    axes.set(xlabel="y [mm]" if view is EAST else "x [mm]", ylabel="z [mm]")


def _joint(axes, bodies: dict[str, Body], contact: np.ndarray) -> None:
    """Draw the surroundings of the joint, seen along y, and the pairs on the front."""
    points = 1e3 * next(iter(bodies.values())).points
    _paint(axes, bodies, SOUTH, 0.4)
    y = points[contact, 1]
    front = contact[y < y.min() + 1e-3 * np.ptp(y)]
    axes.plot(*points[front][:, [0, 2]].T, "o", color=CONTACT_COLOUR, markersize=4.0)
    low, high = points[contact].min(axis=0), points[contact].max(axis=0)
    margin = 0.4 * (high - low)[[0, 2]].max()
    axes.set(
        xlim=(low[0] - margin, high[0] + margin),
        ylim=(low[2] - margin, high[2] + margin),
        xlabel="x [mm]",
        ylabel="z [mm]",
        title="the joint, along y",
    )


def _surface(axes, bodies: dict[str, Body], contact: np.ndarray) -> None:
    """Draw the contact faces of the first body with their nodes, and the normal of each face."""
    x, y, _ = np.ptp(next(iter(bodies.values())).points[contact], axis=0)
    view = _view(62.0, -25.0 if x < 2.0 * y else -80.0)  # the longer side to the right
    name, body = next(iter(bodies.items()))
    faces = [faces[np.isin(faces, contact).all(axis=1)] for faces in skin(body)]
    outlines = [outline for part in faces for outline in _outlines(body, part)]
    normals = np.concatenate([_normals(body, part) for part in faces])
    nodes = np.concatenate(outlines)
    flat = [outline @ view[1:].T for outline in outlines]
    axes.add_collection(PolyCollection(flat, facecolors=CONTACT_COLOUR, edgecolors=EDGE_COLOUR, linewidths=0.6, alpha=0.5))
    axes.plot(*(nodes @ view[1:].T).T, "o", color=EDGE_COLOUR, markersize=24.0 / np.sqrt(len(contact)))
    start = np.array([outline.mean(axis=0) for outline in flat])
    size = 0.06 * np.linalg.norm(np.ptp(nodes, axis=0))
    axes.quiver(*start.T, *(size * normals @ view[1:].T).T, angles="xy", scale_units="xy", scale=1.0, width=0.003)
    _triad(axes, view, nodes)
    axes.set_title(f"contact faces of {name}: nodes and normals")


# A view is three rows: the direction towards the viewer, to the right and up.
SOUTH = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
EAST = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def _view(elevation: float, azimuth: float) -> np.ndarray:
    """Return the view from an elevation and an azimuth [degrees], (3, 3)."""
    e, a = np.radians([elevation, azimuth])
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.array([towards, right, np.cross(towards, right)])


def _paint(axes, bodies: dict[str, Body], view: np.ndarray, line_width: float) -> None:
    """Draw the faces of all bodies that face the viewer, the far ones first."""
    outlines, colours, depth = [], [], []
    for colour, body in zip(BODY_COLOURS, bodies.values(), strict=False):
        for faces in skin(body):
            towards = _normals(body, faces) @ view[0]
            seen = towards > 0.02
            outlines += list(_outlines(body, faces[seen]) @ view[1:].T)
            colours.append(np.array(matplotlib.colors.to_rgb(colour)) * (0.65 + 0.35 * towards[seen, None]))
            depth.append(body.points[faces[seen]].mean(axis=1) @ view[0])
    order = np.argsort(np.concatenate(depth))
    axes.add_collection(
        PolyCollection(
            [outlines[i] for i in order], facecolors=np.concatenate(colours)[order], edgecolors=EDGE_COLOUR, linewidths=line_width
        )
    )
    axes.set_aspect("equal")
    axes.autoscale_view()


def _triad(axes, view: np.ndarray, points: np.ndarray) -> None:
    """Draw the three axes, with their length in mm, at the lower left of a view of ``points`` [mm]; no frame."""
    flat = points @ view[1:].T
    size = float(np.linalg.norm(np.ptp(points, axis=0))) / 7.0
    length = max(step for step in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if step <= max(size, 1.0))
    arrows = length * view[1:].T
    origin = flat.min(axis=0) - [0.0, length]
    for name, arrow in zip("xyz", arrows, strict=True):
        axes.annotate("", origin + arrow, origin, arrowprops={"arrowstyle": "->", "shrinkA": 0, "shrinkB": 0})
        axes.annotate(name, origin + 1.3 * arrow, ha="center", va="center")
    lowest = origin + 1.6 * np.minimum(arrows, 0.0).min(axis=0) - [0.0, 0.1 * length]
    axes.annotate(f"axes: {length} mm", (origin[0], lowest[1]), ha="left", va="top", fontsize=8)
    low, high = np.minimum(flat.min(axis=0), lowest - 0.4 * length), flat.max(axis=0)
    axes.set(xlim=(low[0], high[0] + 0.3 * length), ylim=(low[1], high[1] + 0.3 * length), aspect="equal")
    axes.set_axis_off()


def _outlines(body: Body, faces: np.ndarray) -> np.ndarray:
    """Return the faces as polygons through corners and mid-side nodes, (n_faces, n_nodes, 3) [mm]."""
    n_corners = {3: 3, 6: 3, 4: 4, 8: 4}[faces.shape[1]]
    order = np.arange(faces.shape[1]).reshape(-1, n_corners).T.ravel()
    return 1e3 * body.points[faces[:, order]]


def _normals(body: Body, faces: np.ndarray) -> np.ndarray:
    """Return the unit normals of faces, outward, (n_faces, 3)."""
    n_corners = {3: 3, 6: 3, 4: 4, 8: 4}[faces.shape[1]]
    corners = body.points[faces[:, :n_corners]]
    if n_corners == 3:
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    else:
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def main(arguments=None) -> None:
    """Draw the requested picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", help="Gmsh file with physical volumes")
    parser.add_argument("--out", required=True, help="picture to write, .png, .svg or .pdf")
    parser.add_argument("--surfaces", nargs="+", default=(), help="names of the surfaces in contact, where nodes do not coincide")
    given = parser.parse_args(arguments)
    try:
        draw(given.mesh, given.out, surfaces=given.surfaces)
    except ValueError as problem:
        parser.exit(2, f"{parser.prog}: {problem}\n")


if __name__ == "__main__":
    main()
