"""Complete results of a run: two boxes in contact with mesh, modes, rest, motions, stages and notes."""

from __future__ import annotations

import numpy as np
from box_meshes import box, mesh_of
from synthetic_results import branch, pairs_of, write

from microslip.results.fields import Fields, Motion, RunRecord, StageRecord, store_fields

TITLE = "<script>alert(1)</script> & </title>"
MESH = mesh_of(
    ("lower <b>", "hex20", *box("hex20", (2, 1, 1))), ("upper", "tet10", *box("tet10", (2, 1, 1), origin=(0.0, 0.0, 1.0)))
)
LEVELS = (1.0, 8.0)


def boxes_in_contact():
    """Return six pairs on the top of the lower box: corners of its two faces."""
    top = np.flatnonzero(
        (MESH.points[:, 2] == 1.0) & (np.arange(len(MESH.points)) < 32) & np.isin(MESH.points[:, 0], [0, 0.5, 1])
    )
    top = top[np.isin(MESH.points[top, 1], [0.0, 1.0])]
    upper = 32 + np.array([np.argmin(np.linalg.norm(MESH.points[32:] - point, axis=1)) for point in MESH.points[top]])
    order = {tuple(point[:2]): i for i, point in enumerate(MESH.points[top])}
    faces = np.array([[order[x, 0.0], order[x + 0.5, 0.0], order[x + 0.5, 1.0], order[x, 1.0]] for x in (0.0, 0.5)])
    pairs = pairs_of(MESH.points[top], np.tile(np.eye(3), (6, 1, 1)), np.full(6, 1.0 / 6.0), ("foot",) * 6, (faces,))
    pairs.node1[:], pairs.node2[:] = top, upper
    return pairs


def fields(rest: bool = True) -> Fields:
    rng = np.random.default_rng(5)
    n = len(MESH.points)
    peaks = {i: Motion(30, rng.normal(size=(n, 3, 7))) for i in range(len(LEVELS))}
    at_rest = rng.normal(size=(n, 3)) if rest else None
    return Fields(
        MESH, rng.normal(size=(2, n, 3)), at_rest, peaks, (int(MESH.numbers[5]), -1), np.array([[0.0, 0.0, -1.0], [0, 0, 0]])
    )


def write_full_results(folder, **options) -> str:
    """Write complete results of two levels and two outputs, and return their path."""
    pairs = boxes_in_contact()
    path = write(
        folder, [branch(level, pairs, n_outputs=2) for level in LEVELS], pairs, outputs=("tip", "<img src=x>"), **options
    )
    store_fields(
        path,
        fields(),
        RunRecord(
            (StageRecord("modes & more", 1.5, 200.0), StageRecord("a part", 1.0, 190.0, 1)),
            ("date 2026-11-22", "a note </pre><script>"),
        ),
    )
    return path
