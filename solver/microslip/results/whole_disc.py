"""Mesh and fields of a whole disc from those of sector 0: turned copies, each with the phase of its sector.

docs/theory.md, section 14.  Nodes at which sectors meet are there twice; those of sector 0 keep their numbers.
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
    stride = int(mesh.numbers.max(initial=0)) + 1
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
    numbers = (mesh.numbers + stride * copies).ravel()
    return replace(mesh, points=points, numbers=numbers, elements=blocks, faces=(), node_groups={}, fields={})


def whole_shapes(shapes: np.ndarray, cyclic: Cyclic, diameter: int) -> np.ndarray:
    """Return complex shapes (n_nodes, 3, m) of sector 0 on all sectors at the instant 0, real (n_sectors n_nodes, 3, m).

    Local.  Sector s has the phase ``diameter`` s alpha.  Single precision, which files of fields have.
    """
    n, N = len(shapes), cyclic.sectors
    parts = np.concatenate([np.moveaxis(part, -1, 0) for part in (shapes.real, shapes.imag)], axis=2).reshape(-1, 6)
    of_all: np.ndarray = np.empty((shapes.shape[2], N, n, 3), dtype="f4")
    for s, turn in enumerate(turns(cyclic)):
        angle = diameter * cyclic.angle * s
        of_all[:, s] = (parts @ np.vstack([np.cos(angle) * turn.T, -np.sin(angle) * turn.T])).reshape(-1, n, 3)
    return np.moveaxis(of_all.reshape(-1, N * n, 3), 0, -1)


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
