"""Write bodies as a Gmsh mesh file, format 2.2, with named groups; summarise them as text."""

from __future__ import annotations

import numpy as np
from blocks import Body, aspect_ratios, jacobian_minimum, volumes

# Gmsh's element types, and its order of the nodes where that is not VTK's.
_TYPES = {
    "tri3": 2,
    "quad4": 3,
    "tet4": 4,
    "hex8": 5,
    "wedge6": 6,
    "tri6": 9,
    "tet10": 11,
    "quad8": 16,
    "hex20": 17,
    "wedge15": 18,
}
_FROM_VTK = {
    "tet10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    "hex20": [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14],
    "wedge15": [0, 1, 2, 3, 4, 5, 6, 8, 12, 7, 13, 14, 9, 11, 10],
}
_FACE_KINDS = {3: "tri3", 4: "quad4", 6: "tri6", 8: "quad8"}


def write_msh(path: str, bodies: dict[str, Body], binary: bool = True) -> None:
    """Write bodies, each a physical volume, and their named surfaces as physical surfaces.  Local.

    Nodes are numbered from 1, body after body; bodies never share a node.  A surface name that two bodies use is one
    group.
    """
    tags: dict[str, tuple[int, int]] = {}
    blocks, start = [], 1
    for name, body in bodies.items():
        for surface, faces in body.faces.items():
            tag = tags.setdefault(surface, (2, len(tags) + 1))[1]
            blocks += [(_FACE_KINDS[nodes.shape[1]], tag, nodes + start) for nodes in faces]
        tag = tags.setdefault(name, (3, len(tags) + 1))[1]
        blocks.append((body.kind, tag, body.elements + start))
        start += len(body.points)
    points = np.concatenate([body.points for body in bodies.values()])
    names = "".join(f'{dimension} {tag} "{name}"\n' for name, (dimension, tag) in tags.items())
    with open(path, "wb") as file:
        file.write(f"$MeshFormat\n2.2 {int(binary)} 8\n".encode())
        if binary:
            file.write(np.array(1, dtype="<i4").tobytes() + b"\n")
        file.write(f"$EndMeshFormat\n$PhysicalNames\n{len(tags)}\n{names}$EndPhysicalNames\n".encode())
        _write_nodes(file, points, binary)
        _write_elements(file, blocks, binary)


def summary(bodies: dict[str, Body], contacts: list[tuple[str, str]]) -> str:
    """Return counts, volume and quality of the bodies as text; ``contacts`` are pairs of surface names.  Local."""
    lines = []
    for name, body in bodies.items():
        volume, lowest, aspect = volumes(body).sum(), jacobian_minimum(body).min(), aspect_ratios(body).max()
        lines.append(
            f"{name}: {len(body.points)} nodes, {len(body.elements)} {body.kind}, volume {volume * 1e6:.3f} cm3, "
            f"smallest det J {lowest:.3g} m3, largest aspect ratio {aspect:.1f}"
        )
    n_nodes = sum(len(body.points) for body in bodies.values())
    lines.append(f"in all: {n_nodes} nodes, {3 * n_nodes} DOF before supports")
    surfaces = {name: len(body.face_nodes(name)) for body in bodies.values() for name in body.faces}
    lines += [f"contact {first} on {second}: {surfaces[first]} pairs" for first, second in contacts]
    return "\n".join(lines)


def _write_nodes(file, points: np.ndarray, binary: bool) -> None:
    file.write(f"$Nodes\n{len(points)}\n".encode())
    if binary:
        records = np.empty(len(points), dtype=[("number", "<i4"), ("point", "<f8", 3)])
        records["number"], records["point"] = np.arange(1, len(points) + 1), points
        file.write(records.tobytes() + b"\n")
    else:
        np.savetxt(file, np.column_stack([np.arange(1, len(points) + 1), points]), "%d %.16e %.16e %.16e")
    file.write(b"$EndNodes\n")


def _write_elements(file, blocks: list[tuple[str, int, np.ndarray]], binary: bool) -> None:
    """Write blocks of (kind, tag, node numbers); the tag stands for the physical group and the entity."""
    file.write(f"$Elements\n{sum(len(nodes) for _, _, nodes in blocks)}\n".encode())
    number = 1
    for kind, tag, nodes in blocks:
        n = len(nodes)
        numbers, tags = np.arange(number, number + n), np.full((n, 2), tag)
        nodes = nodes[:, _FROM_VTK.get(kind, slice(None))]
        number += n
        if binary:
            file.write(np.array([_TYPES[kind], n, 2], dtype="<i4").tobytes())
            file.write(np.column_stack([numbers, tags, nodes]).astype("<i4").tobytes())
        else:
            np.savetxt(file, np.column_stack([numbers, np.full(n, _TYPES[kind]), np.full(n, 2), tags, nodes]), "%d")
    file.write((b"\n" if binary else b"") + b"$EndElements\n")
