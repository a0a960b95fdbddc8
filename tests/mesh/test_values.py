"""Values for each contact point from a CSV file, by node or by position, and refused input."""

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import box, joint, mesh_of

from microslip.mesh.pairing import pair_contacts
from microslip.messages.errors import CaseError, MeshError

TOUCH = {
    "lower_top": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) < len(x) / 2),
    "upper_bottom": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) >= len(x) / 2),
}


def two_boxes():
    lower, upper = box("hex8", (2, 3, 1)), box("hex8", (2, 3, 1), origin=(0.0, 0.0, 1.0))
    return mesh_of(("lower", "hex8", *lower), ("upper", "hex8", *upper), groups=TOUCH)


def paired(tmp_path, text, **changes):
    path = tmp_path / "values.csv"
    path.write_text(text)
    return pair_contacts(two_boxes(), [joint(parameters=path, **changes)])


def test_values_of_the_file_apply_to_its_nodes_only(tmp_path):
    mesh = two_boxes()
    first, second = mesh.numbers[mesh.node_groups["lower_top"][[2, 7]]]
    pairs = paired(tmp_path, f"node,friction,preload\n{second},0.7,1e6\n# the corner\n{first},0.1,2e6\n")
    others = np.full(12, True)
    for number, mu, pressure in ((first, 0.1, 2e6), (second, 0.7, 1e6)):
        (i,) = np.flatnonzero(mesh.numbers[pairs.node1] == number)
        assert pairs.mu[i] == mu and pairs.N0[i] == pytest.approx(pressure * pairs.area[i])
        others[i] = False
    assert (pairs.mu[others] == 0.3).all() and pairs.N0[others] == pytest.approx(5e7 * pairs.area[others])


def test_points_have_the_values_of_the_nearest_row(tmp_path):
    text = "x,y,z,tangential_stiffness,normal_stiffness,gap\n0,0.3,1,1e12,2e12,0\n1,0.3,1,3e12,4e12,1e-5\n"
    pairs = paired(tmp_path, text, preload=0.0)
    left = pairs.position[:, 0] < 0.4
    assert pairs.k_t[left] == pytest.approx(1e12 * pairs.area[left]) and not pairs.N0[left].any()
    right = pairs.position[:, 0] > 0.6
    assert pairs.k_n[right] == pytest.approx(4e12 * pairs.area[right])
    assert -pairs.N0[right] / pairs.k_n[right] == pytest.approx(1e-5)


@pytest.mark.parametrize(
    "text, message",
    [
        ("node\n1009\n", "the header names no value: friction, tangential_stiffness"),
        ("friction\n0.1\n", "the header must name node, or x, y and z in m; x, y, z is missing"),
        ("node,x,y,z,friction\n1009,0,0,1,0.1\n", "names node and x, y, z"),
        ("node,normal_stiffness\n1009,0\n", "line 2: normal_stiffness = 0; it must be above 0"),
        ("node,friction\n1012,0.1\n1012,0.2\n", "node 1012 has 2 rows"),
        ("x,y,z,gap\n0,0,1,1e-6\n", r"has a gap of 1e-06 m and a preload of 5e\+07 Pa \(12 in all\)"),
    ],
)
def test_bad_values_are_refused_with_a_message(tmp_path, text, message):
    with pytest.raises(CaseError, match=message):
        paired(tmp_path, text)


def test_rows_of_nodes_or_positions_off_the_joint_are_refused(tmp_path):
    with pytest.raises(
        MeshError, match=r"line 3: node 5 is not a node of 'lower_top', the first surface of joint 'joint' \(1 such"
    ):
        paired(tmp_path, f"node,friction\n{two_boxes().numbers[two_boxes().node_groups['lower_top'][0]]},0.1\n5,0.2\n")
    with pytest.raises(MeshError, match=r"line 2: \(0, 0, 3\) m is 2 m from the nearest contact point .* places are in metres"):
        paired(tmp_path, "x,y,z,friction\n0,0,3,0.1\n")
    with pytest.raises(CaseError, match="takes its gap from the mesh"):
        paired(tmp_path, "x,y,z,gap\n0,0,1,0\n", gap="geometry", preload=0.0)


def with_field(name="mu", values=None):
    mesh = two_boxes()
    return replace(mesh, fields={name: 0.1 + 0.2 * mesh.points[:, 0] if values is None else values})


def test_a_field_of_the_mesh_is_interpolated():
    mesh = with_field()
    for pairing in ("nodes", "points", "mortar"):
        pairs = pair_contacts(mesh, [joint(fields={"friction": "mu"}, pairing=pairing)])
        assert pairs.mu == pytest.approx(0.1 + 0.2 * pairs.position[:, 0])


@pytest.mark.parametrize("pairing", ["nodes", "points", "mortar"])
def test_values_at_nodes_of_a_file_are_interpolated_like_a_field(tmp_path, pairing):
    mesh = with_field()
    nodes = mesh.node_groups["lower_top"]
    rows = "".join(f"{number},{value!r}\n" for number, value in zip(mesh.numbers[nodes], mesh.fields["mu"][nodes].tolist()))
    path = tmp_path / "values.csv"
    path.write_text("node,friction\n" + rows)
    of_field, of_file = (
        pair_contacts(mesh, [joint(pairing=pairing, **given)]) for given in ({"fields": {"friction": "mu"}}, {"parameters": path})
    )
    np.testing.assert_array_equal(of_file.mu, of_field.mu)
    assert of_file.mu == pytest.approx(0.1 + 0.2 * of_file.position[:, 0])


def test_gaps_and_preloads_of_nodes_are_interpolated_as_normal_forces(tmp_path):
    """Half of the nodes have 1e6 Pa, half a gap of 1e-6 m, which is -1e6 Pa at k = 1e12 N/m3."""
    mesh = two_boxes()
    path, nodes = tmp_path / "values.csv", mesh.node_groups["lower_top"]
    is_open = mesh.points[nodes, 0] > 0.9
    rows = [f"{n},{0.0 if gap else 1e6},{1e-6 if gap else 0.0},1e12\n" for n, gap in zip(mesh.numbers[nodes], is_open)]
    path.write_text("node,preload,gap,normal_stiffness\n" + "".join(rows))
    pairs = pair_contacts(mesh, [joint(parameters=path, pairing="points", preload=0.0)])
    share = np.clip((pairs.position[:, 0] - 0.5) / 0.5, 0.0, 1.0)  # weight of the open nodes
    assert pairs.N0 / pairs.area == pytest.approx(1e6 * (1.0 - 2.0 * share), abs=1.0)
    assert pairs.N0.min() < 0.0 < pairs.N0.max()


@pytest.mark.parametrize("pairing", ["points", "mortar"])
def test_a_discontinuous_field_is_interpolated_within_its_range(pairing):
    """Shape functions of quadratic faces have negative values, but friction must not."""
    lower, upper = box("hex20", (2, 3, 1)), box("hex20", (2, 3, 1), origin=(0.0, 0.0, 1.0))
    mesh = mesh_of(("lower", "hex20", *lower), ("upper", "hex20", *upper), groups=TOUCH)
    mesh = replace(mesh, fields={"mu": np.where(mesh.points[:, 0] > 0.9, 0.4, 0.0)})
    pairs = pair_contacts(mesh, [joint(fields={"friction": "mu"}, pairing=pairing)])
    assert pairs.mu.min() == 0.0 and 0.2 < pairs.mu.max() <= 0.4


@pytest.mark.parametrize(
    "mesh, message",
    [
        (with_field("mu_1"), "friction = 'mu': there is no such field in the mesh; .*it has: mu_1"),
        (two_boxes(), "it has no field of one number a node at all"),
        (with_field(values=np.full(48, np.nan)), r"has no value at 12 nodes of the joint, the first is \d+"),
        (with_field(values=np.full(48, -0.1)), r"'mu' is -0.1 at \(.*\) m; it must be at least 0"),
    ],
    ids=["misspelled", "none", "without values", "negative"],
)
def test_fields_that_do_not_fit_are_refused(mesh, message):
    with pytest.raises(MeshError, match=message):
        pair_contacts(mesh, [joint(fields={"friction": "mu"})])
