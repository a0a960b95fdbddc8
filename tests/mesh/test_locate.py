"""Nodes by position, number and group; connected parts and their supports."""

import numpy as np
import pytest
from box_meshes import box, joint, mesh_of, settings

from microslip.mesh.connected import check_fixed, connected_parts
from microslip.mesh.locate import find_node, nearest_node, notes_on_positions
from microslip.mesh.pairing import pair_contacts
from microslip.messages.errors import CaseError, MeshError

GROUPS = {
    "base": lambda x: x[:, 2] == 0.0,
    "lower_top": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) < 27),
    "upper_bottom": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) >= 27),
}


def stack():
    return mesh_of(("low", "hex8", *box("hex8")), ("high", "hex8", *box("hex8", origin=(0, 0, 1))), groups=GROUPS)


def test_nodes_are_located_by_position_number_and_group():
    mesh = stack()
    (nearest,) = find_node(mesh, position=(0.51, 0.49, 2.01))
    np.testing.assert_allclose(mesh.points[nearest], (0.5, 0.5, 2.0))
    assert nearest_node(mesh, (0.5, 0.5, 2.1))[1] == pytest.approx(0.1)
    assert mesh.numbers[find_node(mesh, node=1005)].tolist() == [1005]
    assert len(find_node(mesh, group="base")) == 9


def test_a_position_on_both_sides_of_a_joint_names_the_node_used():
    mesh = stack()
    loads = ({"position": (0.0, 0.0, 1.0), "direction": (1, 0, 0)}, {"position": (0.0, 0.0, 2.0), "direction": (1, 0, 0)})
    tables = settings(
        {"low": "low", "high": "high"}, loads=loads, outputs=({"name": "tip", "node": 1030, "direction": (1, 0, 0)},)
    )
    (note,) = notes_on_positions(mesh, tables)
    assert note.startswith("[[loads]] 1: node 1003 of 'low' is used; at the same place: node 1028 of 'high'")


def test_nodes_that_do_not_exist_give_one_message():
    mesh = stack()
    with pytest.raises(MeshError, match=r"loads\]\] 2 position = \(0, 0, 2000\) m is 2e\+03 m from the nearest node"):
        find_node(mesh, position=(0, 0, 2000), where="[[loads]] 2")
    with pytest.raises(MeshError, match=r"node = 7: no element .* numbers run from 1001 to 1054"):
        find_node(mesh, node=7, where="[[outputs]] 'tip'")
    with pytest.raises(CaseError, match="needs a position, a node or a group"):
        find_node(mesh, where="[[loads]] 1")


def test_parts_are_named_by_their_bodies():
    mesh = stack()
    part, names = connected_parts(mesh, {"low": "disc", "high": "blade"})
    assert names == ("body 'disc'", "body 'blade'")
    assert np.bincount(part).tolist() == [27, 27]
    all_nodes = np.vstack([block.nodes for block in mesh.elements])
    _, names = connected_parts(mesh_of(("all", "hex8", mesh.points, all_nodes)), {"all": "all"})
    assert names[0] == "body 'all' (a separate piece around (0.5, 0.5, 0.5) m)"


@pytest.mark.parametrize(
    "supports, joints, message",
    [
        ([("base", "xyz")], [joint()], True),
        ([("base", "xyz")], [], "nothing holds body 'blade': no support, and no joint"),
        ([], [joint()], False),
        ([], [], "nothing holds body 'disc'; body 'blade'"),
    ],
)
def test_every_part_must_be_supported(supports, joints, message):
    """A part has supports or a joint to a supported part; a structure without supports may be free if it is connected."""
    mesh = stack()
    case = settings({"disc": "low", "blade": "high"}, supports, joints)
    part, names = connected_parts(mesh, case.body_of)
    pairs = pair_contacts(mesh, case.joints)
    if isinstance(message, bool):
        assert check_fixed(part, names, mesh, case.supports, pairs) is message
    else:
        with pytest.raises(MeshError, match=message):
            check_fixed(part, names, mesh, case.supports, pairs)
