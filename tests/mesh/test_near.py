"""Search for balls of any size near given points: complete, with few others."""

import numpy as np

from microslip.mesh.near import pairs_within, trees_by_size


def test_the_search_returns_all_near_balls_and_few_others():
    """Radii over four decades, against the distances of all pairs; large balls do not add distant small ones."""
    rng = np.random.default_rng(5)
    radius = 10.0 ** rng.uniform(-4.0, 0.0, 300)
    centre, queries, reach = rng.random((300, 3)), rng.random((200, 3)), 1e-2 * rng.random(200)
    at, on = pairs_within(trees_by_size(centre, radius), queries, reach)
    distance = np.linalg.norm(queries[:, None] - centre, axis=2)
    near = set(zip(*np.nonzero(distance <= reach[:, None] + radius)))
    computed = set(zip(at, on))
    assert len(computed) == len(at) and near <= computed
    assert all(distance[i, j] <= reach[i] + 2.0 * radius[j] for i, j in computed)


def test_an_empty_search_returns_no_pairs():
    empty = np.zeros((0, 3))
    for centre, queries in ((empty, np.zeros((2, 3))), (np.zeros((2, 3)), empty)):
        at, on = pairs_within(trees_by_size(centre, np.ones(len(centre))), queries, np.ones(len(queries)))
        assert len(at) == len(on) == 0
