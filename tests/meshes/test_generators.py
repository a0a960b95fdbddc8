"""Generated meshes: geometry against formulas, quality by an independent evaluation, files by other readers."""

import os
import subprocess
import sys

import meshio
import numpy as np
import pytest
from box_meshes import joint, settings
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from microslip.formats.msh import read_msh
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.read import read_mesh

MESHES = os.path.join(os.path.dirname(__file__), "..", "..", "meshes")
sys.path.insert(0, os.path.abspath(MESHES))

import blocks
import picture
from block_on_ground import BlockOnGround, block_on_ground
from bolted_lap import BoltedLap, bolted_lap
from damper import Damper, damper
from fan_sector import SIZES, Shape, fan_sector
from hertz_rings import Rings, hertz_rings
from lap_joint import LapJoint, lap_joint
from msh import write_msh

MESHIO_KIND = {
    "hex8": "hexahedron",
    "hex20": "hexahedron20",
    "tet4": "tetra",
    "tet10": "tetra10",
    "wedge6": "wedge",
    "quad8": "quad8",
    "tri6": "triangle6",
}


@pytest.fixture(scope="module", params=SIZES)
def fan(request):
    return request.param, fan_sector(Shape(), SIZES[request.param])


@pytest.fixture(scope="module")
def small():
    return fan_sector(Shape(), SIZES["small"])


def hex20_shapes(xi):
    """Return the 20 serendipity functions at points (n, 3) in [-1, 1]^3; complex arguments allowed."""
    bottom = [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1)]
    corners = np.array(bottom + [(x, y, 1) for x, y, _ in bottom])
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    nodes = np.concatenate([corners, [(corners[a] + corners[b]) // 2 for a, b in edges]])
    factors = np.where(nodes == 0, 1 - xi[:, None] ** 2, 1 + nodes * xi[:, None])
    shapes = factors.prod(axis=2) / np.where((nodes == 0).any(axis=1), 4, 8)
    shapes[:, :8] *= (nodes[:8] * xi[:, None]).sum(axis=2) - 2
    return shapes


def hex20_determinants(body, xi):
    """Return det J of every element at points xi, with complex-step derivatives of the shape functions."""
    step = 1e-30
    slopes = np.stack([hex20_shapes(xi + 1j * step * np.eye(3)[axis]).imag / step for axis in range(3)], axis=1)
    return np.linalg.det(np.einsum("pan,enx->epax", slopes, body.points[body.elements], optimize=True))


def cube_rule(n):
    points, weights = np.polynomial.legendre.leggauss(n)
    grid = np.stack(np.meshgrid(points, points, points, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid, np.einsum("i,j,k->ijk", weights, weights, weights).ravel()


def n_parts(body):
    first = np.repeat(body.elements[:, 0], body.elements.shape[1])
    n = len(body.points)
    return connected_components(coo_matrix((np.ones(len(first)), (first, body.elements.ravel())), (n, n)))[0]


# Fan-blade sector


def test_fan_jacobians_are_positive_at_corners_and_quadrature_points(fan):
    _, bodies = fan
    corners = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]), axis=-1).reshape(-1, 3)
    for body in bodies.values():
        for places in (corners, cube_rule(2)[0], cube_rule(3)[0]):
            determinants = hex20_determinants(body, places)
            assert determinants.min() > 0.0
        # no corner is nearly flat: least over mean det J of an element
        assert (determinants.min(axis=1) / determinants.mean(axis=1)).min() > 0.25
        assert blocks.aspect_ratios(body).max() < 25.0


def test_fan_jacobians_of_the_generator_equal_an_independent_evaluation(small):
    places, weights = cube_rule(3)
    corners = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), axis=-1).reshape(-1, 3)
    corners = corners[np.count_nonzero(corners == 0.0, axis=1) < 2]
    body = small["blade"]
    lowest = 8.0 * hex20_determinants(body, np.concatenate([places, corners])).min(axis=1)
    assert np.allclose(blocks.jacobian_minimum(body), lowest, rtol=1e-9)
    assert np.allclose(blocks.volumes(body), hex20_determinants(body, places) @ weights, rtol=1e-12)


def test_fan_has_the_stated_numbers_of_nodes_and_pairs(fan):
    size, bodies = fan
    n_blade, n_disc = (len(bodies[name].points) for name in ("blade", "disc"))
    n_pairs = len(bodies["blade"].face_nodes("blade_root"))
    if size == "small":
        assert 3000 <= n_blade + n_disc <= 5000 and 36 <= n_pairs <= 48
    if size == "paper":
        assert abs(n_blade - 27700) < 300 and abs(n_disc - 13800) < 300 and 200 <= n_pairs <= 230


def test_fan_nodes_coincide_only_on_the_flanks(fan):
    _, bodies = fan
    blade, disc = bodies["blade"], bodies["disc"]
    root, slot = blade.face_nodes("blade_root"), disc.face_nodes("disc_slot")
    distance, partner = cKDTree(disc.points[slot]).query(blade.points[root])
    assert distance.max() < 1e-9
    assert len(np.unique(partner)) == len(slot) == len(root)
    elsewhere = np.setdiff1d(np.arange(len(blade.points)), root)
    assert cKDTree(disc.points).query(blade.points[elsewhere])[0].min() > 1e-4
    for body in bodies.values():
        assert n_parts(body) == 1
        assert len(cKDTree(body.points).query_pairs(1e-6)) == 0
        assert np.array_equal(np.unique(body.elements), np.arange(len(body.points)))


def test_fan_blade_does_not_penetrate_the_disc(small):
    """Beyond the flanks the root of the blade is on the outer side of the skin of the disc."""
    blade, disc = small["blade"], small["disc"]
    root = blade.face_nodes("blade_root")
    nodes = np.setdiff1d(np.flatnonzero(blade.points[:, 2] < -0.010 - 1e-9), root)
    (faces,) = blocks.skin(disc)
    centres = disc.points[faces[:, 4:]].mean(axis=1)
    corners = disc.points[faces]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    ends = np.abs(normals[:, 1]) > 0.9 * np.linalg.norm(normals, axis=1)  # front and rear faces do not face the blade
    nearest = cKDTree(centres[~ends]).query(blade.points[nodes])[1]
    height = np.einsum("ij,ij->i", blade.points[nodes] - centres[~ends][nearest], normals[~ends][nearest])
    assert (height > 0.0).all()


def test_fan_volumes_are_those_of_formulas(fan):
    _, bodies = fan
    s = Shape()
    places, weights = cube_rule(3)
    volume = {name: (hex20_determinants(body, places) @ weights).sum() for name, body in bodies.items()}

    def aerofoil_area(z):
        chord = s.chord_root + (s.chord_tip - s.chord_root) * z
        return chord * (s.thickness_root + (s.thickness_tip - s.thickness_root) * z) * (s.edge + (1 - s.edge) * 2 / 3)

    aerofoil = s.length * (aerofoil_area(0.0) + 4 * aerofoil_area(0.5) + aerofoil_area(1.0)) / 6
    flank = s.flank_width * np.sqrt(0.5)
    throat = s.throat_width
    widest = throat + 2 * flank
    lobe = (widest * 2 - 0.4 * s.lobe_height) / 2 * s.lobe_height
    root = (s.neck_width + throat) / 2 * s.neck_height + (throat + widest) / 2 * flank + lobe
    least = aerofoil + s.root_length * root + s.flare * aerofoil_area(0.0)
    most = aerofoil + s.root_length * root + s.flare * s.neck_width * s.root_length
    assert least < volume["blade"] < most

    c = s.clearance
    slot = (
        (s.neck_width + 2 * c + throat) / 2 * s.neck_height + (throat + widest) / 2 * flank + (widest + c) * (s.lobe_height + c)
    )
    sector = np.pi / s.n_blades * (s.rim_radius**2 - s.bore_radius**2)
    assert volume["disc"] == pytest.approx(s.root_length * (sector - slot), rel=5e-3)


def test_fan_cyclic_faces_match(small):
    """The low cyclic face, rotated by one sector about the axis of the engine, is the high one."""
    s, disc = Shape(), small["disc"]
    low, high = (disc.points[disc.face_nodes(f"disc_cyclic_{side}")] for side in ("low", "high"))
    axis = np.array([0.0, 0.0, -s.flare - s.rim_radius])
    angle = 2 * np.pi / s.n_blades
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    assert cKDTree(high).query((low - axis) @ turn.T + axis)[0].max() < 1e-12
    for name, radius in (("disc_base", s.bore_radius), ("disc_rim", s.rim_radius)):
        distance = np.linalg.norm((disc.points[disc.face_nodes(name)] - axis)[:, [0, 2]], axis=1)
        assert np.allclose(distance, radius, rtol=1e-12)


def test_fan_file_gives_pairs_with_the_area_of_the_flanks(small, tmp_path):
    path = str(tmp_path / "fan.msh")
    write_msh(path, small)
    case = settings({"blade": "blade", "disc": "disc"}, joints=[joint(surfaces=("blade_root", "disc_slot"))], file=path)
    mesh = read_mesh(case)
    assert {"blade", "disc", "blade_root", "disc_slot", "disc_base", "blade_tip"} <= set(mesh.node_groups)
    pairs = pair_contacts(mesh, case.joints)
    s = Shape()
    assert pairs.n_pairs == len(small["blade"].face_nodes("blade_root"))
    assert pairs.area.min() > 0.0
    assert pairs.area.sum() == pytest.approx(2 * s.flank_width * s.root_length, rel=0.02)
    normals = pairs.frame[:, 2]
    assert normals[:, 2].max() < -0.5  # from the disc into the blade, which the disc retains
    closest = cKDTree(normals).query(normals, k=2)[0][:, 1]
    assert closest.min() > 1e-3  # all frames differ
    assert np.degrees(np.arccos(-normals[:, 2])).mean() == pytest.approx(90 - s.flank_angle, abs=3.0)


def test_fan_parameters_that_cannot_be_meshed_are_refused():
    with pytest.raises(ValueError, match="inside out"):
        fan_sector(Shape(n_blades=60), SIZES["small"])
    with pytest.raises(ValueError, match="clearance must be positive"):
        Shape(clearance=0.0)


# Lap joint


@pytest.mark.parametrize("kind", ["tet10", "tet4"])
def test_lap_joint_has_matching_triangles_and_exact_volumes(kind):
    joint = LapJoint(kind=kind)
    bodies = lap_joint(joint)
    first, second = (body.points[body.face_nodes(f"lap_{i}")] for i, body in enumerate(bodies.values(), 1))
    distance, partner = cKDTree(second).query(first)
    assert distance.max() < 1e-9 and len(np.unique(partner)) == len(first) == len(second)
    assert np.allclose(np.ptp(first, axis=0), [joint.overlap, joint.width, 0.0])
    if kind == "tet10":
        assert 30 <= len(first) <= 60 and 2000 <= sum(len(body.points) for body in bodies.values()) <= 4000
    triangles = [
        {tuple(np.round(body.points[row].ravel(), 9)) for row in np.sort(body.faces[name][0][:, :3], axis=1)}
        for body, name in zip(bodies.values(), ("lap_1", "lap_2"), strict=True)
    ]
    corners = [{frozenset(zip(*[iter(t)] * 3, strict=True)) for t in side} for side in triangles]
    assert corners[0] == corners[1]  # the same triangles on both sides
    for body in bodies.values():
        assert n_parts(body) == 1 and blocks.jacobian_minimum(body).min() > 0.0
        assert blocks.volumes(body).sum() == pytest.approx(joint.length * joint.width * joint.thickness, rel=1e-12)
    assert np.all(bodies["beam_1"].points[bodies["beam_1"].face_nodes("clamp"), 0] == 0.0)


# Bolted lap


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
def test_bolted_lap_volumes_are_those_of_formulas(kind):
    s = BoltedLap(kind=kind)
    bodies = bolted_lap(s)

    def disc(diameter, around):
        """Return the area of a disc of straight elements, or nearly that of one of curved elements."""
        sides = 4 * around
        return diameter**2 / 4.0 * (sides / 2.0 * np.sin(2.0 * np.pi / sides) if kind == "hex8" else np.pi)

    shank, head = disc(s.shank, s.bolt_around), disc(s.head, s.bolt_around)
    expected = {
        "plate_1": s.thickness * (s.length * s.width - s.bolts * disc(s.hole, s.around_1)),
        "plate_2": s.thickness * (s.length * s.width - s.bolts * disc(s.hole, s.around_2)),
        "bolts": s.bolts * (2.0 * s.thickness * shank + 2.0 * s.head_height * head),
    }
    for name, body in bodies.items():
        assert blocks.volumes(body).sum() == pytest.approx(expected[name], rel=1e-9 if kind == "hex8" else 1e-4)
        assert blocks.jacobian_minimum(body).min() > 0.0 and blocks.aspect_ratios(body).max() < 10.0
        assert n_parts(body) == (s.bolts if name == "bolts" else 1)
        assert len(cKDTree(body.points).query_pairs(1e-6)) == 0


def test_bolted_lap_surfaces_are_in_place():
    s = BoltedLap()
    bodies = bolted_lap(s)
    bolts, holes = bodies["bolts"], s.length - (np.arange(s.bolts)[::-1] + 0.5) * s.pitch

    def from_axis(points):
        return np.hypot(points[:, :1] - holes, points[:, 1:2] - 0.5 * s.width).min(axis=1)

    for name, z in (("heads", s.thickness), ("nuts", -s.thickness)):
        ring = bolts.points[bolts.face_nodes(name)]
        assert np.allclose(ring[:, 2], z)  # on the plates, and beyond the holes
        assert np.allclose([from_axis(ring).min(), from_axis(ring).max()], [0.5 * s.hole, 0.5 * s.head])
    skin = {tuple(sorted(face)) for face in blocks.skin(bolts)[0]}
    for i, x in enumerate(holes, 1):
        (cut,) = bolts.faces[f"cut_{i}"]
        assert not skin & {tuple(sorted(face)) for face in cut}  # inside the bolt
        points = bolts.points[np.unique(cut)]
        assert np.allclose(points[:, 2], 0.0) and np.allclose(points[:, :2].mean(axis=0), [x, 0.5 * s.width])
        assert np.hypot(*(points[:, :2] - [x, 0.5 * s.width]).T).max() == pytest.approx(0.5 * s.shank)
    inside = bolts.points[(from_axis(bolts.points) < 0.5 * s.hole - 1e-9) & (np.abs(bolts.points[:, 2]) < s.thickness - 1e-9)]
    assert from_axis(inside).max() == pytest.approx(0.5 * s.shank)  # without contact with the holes
    for plate, name, x in (("plate_1", "clamp", 0.0), ("plate_2", "tip", 2.0 * s.length - s.bolts * s.pitch)):
        assert np.allclose(bodies[plate].points[bodies[plate].face_nodes(name), 0], x)


@pytest.mark.parametrize("matching", [0, 1, 2])
def test_bolted_lap_nodes_coincide_on_request(matching):
    bodies = bolted_lap(BoltedLap(matching=matching))
    first, second = (bodies[f"plate_{i}"].points[bodies[f"plate_{i}"].face_nodes(f"lap_{i}")] for i in (1, 2))
    distance = cKDTree(second).query(first)[0]
    assert (distance.max() < 1e-9 and len(first) == len(second)) if matching else np.median(distance) > 1e-4


def test_bolted_lap_parameters_that_cannot_be_meshed_are_refused():
    with pytest.raises(ValueError, match="shorter than a plate"):
        bolted_lap(BoltedLap(bolts=6))
    with pytest.raises(ValueError, match="diameters"):
        bolted_lap(BoltedLap(head=0.025))


# Block on the ground


@pytest.mark.parametrize("kind", ["hex20", "hex8"])
def test_block_on_ground_has_its_dimensions(kind):
    given = BlockOnGround(kind=kind)
    body = block_on_ground(given)["block"]
    volume = given.width * (given.length * given.height + given.mast * given.mast_height)
    assert n_parts(body) == 1 and blocks.jacobian_minimum(body).min() > 0.0
    assert blocks.volumes(body).sum() == pytest.approx(volume, rel=1e-12)
    foot, shoulders = (body.points[body.face_nodes(name)] for name in ("foot", "shoulders"))
    assert np.allclose(np.ptp(foot, axis=0), [given.length, given.width, 0.0]) and np.allclose(foot[:, 2], 0.0)
    assert np.allclose(shoulders[:, 2], given.height) and np.abs(shoulders[:, 0]).min() == pytest.approx(0.5 * given.mast)
    assert np.allclose(body.points[body.face_nodes("mast_top"), 2], given.height + given.mast_height)
    with pytest.raises(ValueError, match="thinner than the block is long"):
        block_on_ground(BlockOnGround(kind=kind, mast=0.2))


# Two blades and a damper


def test_damper_fits_under_the_platforms():
    given = Damper()
    bodies = damper(given)
    for body in bodies.values():
        assert n_parts(body) == 1 and blocks.jacobian_minimum(body).min() > 0.0
    top, bottom = 0.5 * given.damper_top, 0.5 * given.damper_bottom
    section = (top + bottom) * (bottom - top) * given.slope
    assert blocks.volumes(bodies["damper"]).sum() == pytest.approx(section * given.damper_length, rel=1e-12)
    left, right = bodies["left"], bodies["right"]
    mirror = left.points * [-1.0, 1.0, 1.0]
    assert cKDTree(right.points).query(mirror)[0].max() < 1e-12
    assert blocks.volumes(left).sum() == pytest.approx(blocks.volumes(right).sum(), rel=1e-12)
    for side, sign in (("left", -1.0), ("right", 1.0)):
        under = bodies[side].points[bodies[side].face_nodes(f"{side}_platform")]
        flank = bodies["damper"].points[bodies["damper"].face_nodes(f"damper_{side}")]
        for points in (under, flank):  # both are on z = ridge - slope |x|
            assert np.allclose(points[:, 2], given.ridge_radius - given.slope * sign * points[:, 0], atol=1e-12)
        assert (np.ptp(flank, axis=0) < np.ptp(under, axis=0)).all()  # all of the flank has a partner
        assert np.abs(under[:, 0]).min() == pytest.approx(0.5 * given.gap)
        radial = [sign * np.sin(np.pi / given.n_blades), np.cos(np.pi / given.n_blades)]
        root = bodies[side].points[bodies[side].face_nodes(f"{side}_root")][:, [0, 2]]
        assert root @ radial == pytest.approx(given.root_radius)
    with pytest.raises(ValueError, match="must increase"):
        damper(Damper(damper_bottom=0.03))


# Blocks of any kind


@pytest.mark.parametrize("kind", blocks.KINDS)
def test_box_has_its_volume_and_named_sides(kind):
    lengths = np.array([2.0, 3.0, 5.0])
    body = blocks.box(kind, lengths, (2, 3, 2), origin=(1.0, 0.0, -1.0))
    assert blocks.jacobian_minimum(body).min() > 0.0
    assert blocks.volumes(body).sum() == pytest.approx(lengths.prod(), rel=1e-12)
    assert body.points.min(axis=0) == pytest.approx([1.0, 0.0, -1.0])
    flux = 0.0  # divergence theorem over corner triangles of the skin
    for faces in blocks.skin(body):
        n_corners = {3: 3, 6: 3, 4: 4, 8: 4}[faces.shape[1]]
        for i in range(1, n_corners - 1):
            a, b, c = (body.points[faces[:, j]] for j in (0, i, i + 1))
            flux += np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert flux == pytest.approx(lengths.prod(), rel=1e-12)  # neighbours match, and faces point outwards
    for axis, side in enumerate(blocks.SIDES):
        on_side = body.points[body.face_nodes(side), axis // 2]
        assert np.allclose(on_side, body.points[:, axis // 2].max() if axis % 2 else body.points[:, axis // 2].min())


def test_midside_nodes_are_on_the_mapped_geometry():
    def ring(u, v, w):
        radius, angle = 1.0 + u, 0.5 * np.pi * v
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), w], axis=-1)

    body = blocks.block("hex20", ring, (1, 2, 1), {"x1": "outside"})
    assert np.allclose(np.linalg.norm(body.points[body.face_nodes("outside"), :2], axis=1), 2.0, rtol=1e-14)
    assert blocks.volumes(body).sum() == pytest.approx(0.75 * np.pi, rel=2e-3)


def test_join_merges_only_coincident_nodes():
    parts = [blocks.box("hex20", (1, 1, 1), (1, 2, 2)), blocks.box("hex20", (1, 1, 1), (1, 2, 2), origin=(1, 0, 0))]
    body = blocks.join(parts)
    assert len(body.points) == len(blocks.box("hex20", (2, 1, 1), (2, 2, 2)).points)
    assert n_parts(body) == 1
    separate = blocks.join([parts[0], blocks.box("hex20", (1, 1, 1), (1, 2, 2), origin=(1 + 1e-6, 0, 0))])
    assert len(separate.points) == 2 * len(parts[0].points)


def test_bar_touches_ground_without_common_nodes():
    bodies = blocks.stacked("hex20", (0.1, 0.01, 0.01), (10, 1, 1), ground_height=0.002)
    bottom, top = bodies["bar"].face_nodes("bar_bottom"), bodies["ground"].face_nodes("ground_top")
    assert len(bottom) == len(top)
    assert cKDTree(bodies["ground"].points[top]).query(bodies["bar"].points[bottom])[0].max() < 1e-12


# Files


@pytest.mark.parametrize("binary", [True, False], ids=["binary", "text"])
@pytest.mark.parametrize("kind", blocks.KINDS)
def test_written_file_is_read_unchanged(kind, binary, tmp_path):
    bodies = blocks.stacked(kind, (np.pi, 1.0, 1.0), (3, 1, 2), ground_height=0.5)
    path = str(tmp_path / "bar.msh")
    write_msh(path, bodies, binary=binary)
    file = read_msh(path)
    points = np.concatenate([body.points for body in bodies.values()])
    assert np.array_equal(file.points, points)
    assert set(file.groups) == {"bar", "ground"}.union(*(body.faces for body in bodies.values()))
    start = 0
    for name, body in bodies.items():
        ((cells, rows),) = file.groups[name].cells.items()
        assert file.cells[cells].kind == kind
        assert np.array_equal(file.cells[cells].nodes[rows], body.elements + start)
        for surface in body.faces:
            read = np.concatenate([file.cells[i].nodes[rows].ravel() for i, rows in file.groups[surface].cells.items()])
            assert np.array_equal(np.unique(read), body.face_nodes(surface) + start)
        start += len(body.points)
    if kind in MESHIO_KIND:  # meshio has no 15-node wedge in this format
        mesh = meshio.read(path)
        assert np.array_equal(mesh.points, points)
        assert np.array_equal(mesh.cells_dict[MESHIO_KIND[kind]][: len(bodies["bar"].elements)], bodies["bar"].elements)


@pytest.mark.slow
def test_command_lines_run_from_any_folder(tmp_path):
    def run(script, *arguments):
        command = [sys.executable, os.path.abspath(os.path.join(MESHES, script)), *arguments]
        plain = {**os.environ, "PYTHONPATH": ""}
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=plain, check=False)

    process = run("fan_sector.py", "--size", "small", "--out", "fan.msh", "--twist", "20")
    assert process.returncode == 0 and "46 pairs" in process.stdout, process.stderr
    assert "in all: 3551 nodes" in run("bolted_lap.py", "--out", "bolted.msh").stdout
    for script in ("lap_joint.py", "damper.py", "block_on_ground.py"):
        assert run(script, "--out", script.split("_")[0] + ".msh").returncode == 0
    refused = run("fan_sector.py", "--out", "bad.msh", "--n-blades", "60")
    assert refused.returncode == 2 and "inside out" in refused.stderr and "Traceback" not in refused.stderr
    picture.draw(str(tmp_path / "lap.msh"), str(tmp_path / "lap.png"), dpi=40)
    picture.draw(str(tmp_path / "bolted.msh"), str(tmp_path / "bolted.png"), dpi=40, surfaces=["lap_1", "lap_2"])
    assert all((tmp_path / f"{name}.png").stat().st_size > 5000 for name in ("lap", "bolted"))


def test_picture_of_missing_surfaces_is_refused(tmp_path):
    write_msh(str(tmp_path / "lap.msh"), lap_joint(LapJoint(kind="tet4")))
    with pytest.raises(ValueError, match="no surface 'lap_3'; its surfaces: clamp, lap_1, lap_2, tip"):
        picture.surface_nodes(str(tmp_path / "lap.msh"), ["lap_1", "lap_3"])


@pytest.mark.parametrize("shape", ["sphere", "roller"])
def test_rings_of_a_round_body_have_its_volume_and_touch_a_larger_flat(shape):
    given = Rings(shape=shape, rings=6, base_rings=8, base_angles=2)
    bodies = hertz_rings(given)
    n_sides = 8 * given.base_angles  # of the polygon, half of which is meshed
    polygon = n_sides / 4.0 * given.size**2 * np.sin(2.0 * np.pi / n_sides)
    wide = polygon if shape == "sphere" else 2.0 * given.size * np.ptp(bodies["cap"].points[:, 1])
    assert blocks.volumes(bodies["base"]).sum() == pytest.approx(wide * given.size, rel=1e-9)
    across = (0,) if shape == "roller" else (0, 1)
    reach = {}
    for name, surface in (("cap", "cap"), ("base", "flat")):
        points = bodies[name].points[bodies[name].face_nodes(surface)]
        r2 = np.sum(points[:, across] ** 2, axis=1)
        reach[name] = np.sqrt(r2.max())
        assert points[:, 2] == pytest.approx(r2 / (2.0 * given.radius) if name == "cap" else np.zeros(len(r2)), abs=1e-12)
    assert given.contact < reach["cap"] < reach["base"]
    for body, middle in (("cap", "middle_y"), ("base", "base_y")):
        assert np.abs(bodies[body].points[bodies[body].face_nodes(middle), 1]).max() < 1e-12
