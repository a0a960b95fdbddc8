"""Mesh and fields of a whole disc from those of sector 0: turned copies, each with the phase of its sector.

docs/theory.md, section 14.  Nodes at which sectors meet appear twice; those of sector 0 keep their numbers.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..fourier.amplitudes import to_complex, to_real
from ..mesh.cyclic import rotation, turned_about
from ..mesh.data import ElementBlock, Mesh
from ..tables.cyclic import Cyclic


def turns(cyclic: Cyclic) -> np.ndarray:
    """Return the turn of each sector, (n_sectors, 3, 3).  Local."""
    return np.array([rotation(cyclic.axis, s * cyclic.angle) for s in range(cyclic.sectors)])


def whole_mesh(mesh: Mesh, cyclic: Cyclic) -> Mesh:
    """Return the mesh of all sectors, sector after sector; without faces and groups.  Local."""
    n, copies = len(mesh.points), np.arange(cyclic.sectors)[:, None]
    of_element = 1 + max((int(block.numbers.max(initial=0)) for block in mesh.elements), default=0)
    blocks = tuple(
        ElementBlock(
            block.kind,
            block.group,
            (block.nodes + n * copies[:, :, None]).reshape(-1, block.nodes.shape[1]),
            (block.numbers + of_element * copies).ravel(),
        )
        for block in mesh.elements
    )
    points = np.concatenate([turned_about(mesh.points, turn, cyclic.axis_point) for turn in turns(cyclic)])
    numbers = whole_numbers(mesh.numbers, cyclic.sectors)
    return replace(mesh, points=points, numbers=numbers, elements=blocks, faces=(), node_groups={}, fields={})


def whole_numbers(numbers: np.ndarray, n_sectors: int) -> np.ndarray:
    """Return the numbers of the nodes of all sectors, (n_sectors n_nodes,), from those of a sector.  Local."""
    stride = int(numbers.max(initial=0)) + 1
    return (numbers + stride * np.arange(n_sectors)[:, None]).ravel()


def whole_shapes(shapes: np.ndarray, cyclic: Cyclic, diameter: int) -> np.ndarray:
    """Return complex shapes (n_nodes, 3, m) of sector 0 on all sectors at the instant 0, real (m, n_sectors n_nodes, 3).

    Local.  Sector s has the phase ``diameter`` s alpha.  Single precision, which files of fields have.
    """
    angles, turned = diameter * cyclic.angle * np.arange(cyclic.sectors)[:, None, None], turns(cyclic).transpose(0, 2, 1)
    of_parts = np.concatenate([np.cos(angles) * turned, -np.sin(angles) * turned], axis=1).astype("f4")  # (n_sectors, 6, 3)
    parts = np.concatenate([shapes.real, shapes.imag], axis=1).transpose(2, 0, 1).astype("f4", order="C")  # (m, n_nodes, 6)
    return (parts[:, None] @ of_parts).reshape(len(parts), -1, 3)


def whole_motion(u: np.ndarray, cyclic: Cyclic) -> np.ndarray:
    """Return the coefficients of a motion (n_nodes, 3, N_H) of sector 0 on all sectors, (n_sectors n_nodes, 3, N_H).  Local.

    The harmonics are 0, 1, ...: harmonic n of sector s leads by n h s alpha (14.1).
    """
    amplitudes = to_complex(u.reshape(-1, u.shape[-1]))
    lead = cyclic.wave_number * cyclic.angle * np.arange(amplitudes.shape[1])
    return np.concatenate(
        [
            np.einsum("ij,njh->nih", turn, to_real(amplitudes * np.exp(1j * s * lead), u.shape[-1]).reshape(u.shape))
            for s, turn in enumerate(turns(cyclic))
        ]
    )
