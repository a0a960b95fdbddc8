"""Keys of the surfaces of a joint: ground, planes, gaps and pairings reach the pairs; contradictions give one message."""

import numpy as np
import pytest
from lap_scene import SCENE, write_mesh

from microslip.mesh.pairing import pair_contacts
from microslip.mesh.read import read_mesh
from microslip.messages.errors import CaseError
from microslip.scene.read import read_scene

TWO = 'surfaces = ["lap_1", "lap_2"]'
PLANE = 'surfaces = ["lap_1"]\nagainst = "plane"\nplane_point = [0.0, 0.0, 0.001]\nplane_normal = [0.0, 0.0, -1.0]'
PRELOAD = next(line for line in SCENE.splitlines() if line.startswith("preload"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("surfaces")
    write_mesh(folder / "lap.msh")
    return folder


def read(folder, *changes):
    text = SCENE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "lap.toml").write_text(text)
    return read_scene(folder / "lap.toml")


def pairs_of(scene):
    return pair_contacts(read_mesh(scene), scene.joints)


def test_keys_of_surfaces_reach_the_pairs(folder):
    nodes = pairs_of(read(folder))
    points = pairs_of(read(folder, (TWO, TWO + '\npairing = "points"\ntangent = [0.0, 1.0, 0.0]')))
    assert points.area.sum() == pytest.approx(nodes.area.sum()) and "contact points" in points.notes[0]
    assert np.abs(points.frame[:, 0]) == pytest.approx(np.tile([0.0, 1.0, 0.0], (points.n_pairs, 1)))
    ground = pairs_of(read(folder, (TWO, 'surfaces = ["lap_1"]\nagainst = "ground"')))
    assert (ground.node2 == -1).all() and ground.N0.sum() == pytest.approx(nodes.N0.sum())
    plane = pairs_of(read(folder, (TWO, PLANE), (PRELOAD, "")))
    assert -plane.N0 / plane.k_n == pytest.approx(np.full(plane.n_pairs, 0.001 - plane.position[0, 2]), abs=1e-12)


@pytest.mark.parametrize(
    "changes, message",
    [
        ([(TWO, TWO + '\nagainst = "ground"')], 'against = "ground" takes the place of the second surface; name one'),
        ([(TWO, PLANE.replace("plane_normal", "#")), (PRELOAD, "")], "plane_normal is missing: expected the direction"),
        (
            [(TWO, 'surfaces = ["lap_1"]\nagainst = "ground"\npairing = "mortar"')],
            'pairing = "mortar" takes two surfaces; with against',
        ),
        ([(TWO, TWO + "\nplane_point = [0.0, 0.0, 0.0]")], 'plane_point belongs to against = "plane"'),
        ([(TWO, PLANE), (PRELOAD, "gap = 1e-5")], "gap = 1e-05: the distance from a plane is that of the mesh; leave it out"),
        ([(PRELOAD, 'gap = "geometri"')], r'gap = "geometri": expected the distance at rest in m, .* or "geometry"'),
        ([(TWO, TWO + '\npairing = "point"')], 'pairing = "point": expected .*; nearest is "points"'),
        ([(TWO, TWO + '\nfields = { frikshun = "mu" }')], "fields = a table: expected a table of names of fields of the mesh"),
        (
            [(TWO, 'surfaces = ["lap_1"]\nagainst = "ground"'), (PRELOAD, 'gap = "geometry"')],
            "ground has the shape of the surface",
        ),
    ],
)
def test_contradictions_are_refused_with_a_message(folder, changes, message):
    with pytest.raises(CaseError, match=message):
        read(folder, *changes)
