"""Contact pairs of an input file: complete ones become joints; missing or wrong data are named by file, line and key."""

import re

import pytest

from microslip.formats.read import read_model
from microslip.messages.errors import MeshError
from microslip.tables.joint import Joint

BLOCKS = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
11, 0, 0, 1
12, 1, 0, 1
13, 1, 1, 1
14, 0, 1, 1
15, 0, 0, 2
16, 1, 0, 2
17, 1, 1, 2
18, 0, 1, 2
*ELEMENT, TYPE=C3D8, ELSET=BLOCKS
1, 1, 2, 3, 4, 5, 6, 7, 8
2, 11, 12, 13, 14, 15, 16, 17, 18
*SURFACE, NAME=Lower
1, S2
*SURFACE, NAME=Upper
2, S1
*MATERIAL, NAME=STEEL
*ELASTIC
210000., .3
*DENSITY
7.8e-9
*SOLID SECTION, ELSET=BLOCKS, MATERIAL=STEEL
"""
PAIR = "*CONTACT PAIR, INTERACTION=Dry, TYPE=SURFACE TO SURFACE\nUpper, Lower\n"
PRESSED = "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n1e5\n"
RUBBING = "*FRICTION\n0.3, 4e4\n"
JOINT = Joint.of_file(
    name="Upper_Lower",
    surfaces=("Upper", "Lower"),
    pairing="mortar",
    friction=0.3,
    tangential_stiffness=4e4,
    normal_stiffness=1e5,
    preload="static",
    gap="geometry",
)


def read(folder, *, pair=PAIR, behaviour=PRESSED, friction=RUBBING, more=""):
    """Return the model of two blocks in contact."""
    path = folder / "job.inp"
    path.write_text(f"{BLOCKS}{pair}*SURFACE INTERACTION, NAME=DRY\n{behaviour}{friction}{more}")
    return read_model(path)


def effect(model):
    (finding,) = (finding for finding in model.findings if finding.word == "*CONTACT PAIR")
    assert finding.changes and finding.surfaces == ("Upper", "Lower")
    return finding.effect


def test_a_contact_pair_with_stiffness_and_friction_becomes_a_joint(tmp_path):
    model = read(tmp_path)
    assert model.joints == (JOINT,)
    assert effect(model) == (
        "Upper and Lower in contact, friction 0.3: a joint that [statics] presses, of the file or the scene; without it state a "
        "joint between them, with its preload"
    )


@pytest.mark.parametrize("order", [("friction", "behaviour"), ("behaviour", "friction")])
def test_the_order_of_the_interaction_cards_does_not_matter(tmp_path, order):
    text = {"friction": RUBBING, "behaviour": PRESSED}
    assert read(tmp_path, behaviour=text[order[0]], friction=text[order[1]]).joints == (JOINT,)


def test_the_stick_slope_and_the_type_of_a_contact_pair(tmp_path):
    named = "*FRICTION, SHEAR TRACTION SLOPE=4e4, SLIP TOLERANCE=0.005\n0.3,\n"
    pair = "*CONTACT PAIR, INTERACTION=DRY, TYPE=NODE TO SURFACE, ADJUST=0.01\nUpper, Lower\n"
    (joint,) = read(tmp_path, pair=pair, friction=named).joints
    assert (joint.pairing, joint.tolerance, joint.gap, joint.lacking) == ("projected", 0.01, 0.0, [])
    assert joint.tangential_stiffness == 4e4
    (joint,) = read(tmp_path, pair="*CONTACT PAIR, INTERACTION=DRY, ADJUST=0.0\nUpper, Lower\n").joints
    assert (joint.pairing, joint.tolerance, joint.gap, joint.lacking) == ("auto", None, "geometry", [])


def test_the_smaller_surface_comes_first(tmp_path):
    """The upper block is wider than the lower one: the slave surface is only partly in contact with the master."""
    wide = BLOCKS.replace("12, 1, 0, 1", "12, 3, 0, 1").replace("13, 1, 1, 1", "13, 3, 1, 1")
    assert wide != BLOCKS
    path = tmp_path / "job.inp"
    path.write_text(f"{wide}{PAIR}*SURFACE INTERACTION, NAME=DRY\n{PRESSED}{RUBBING}")
    (joint,) = read_model(path).joints
    assert (joint.surfaces, joint.name) == (("Lower", "Upper"), "Lower_Upper")


STEP = "*STEP\n*STATIC\n*END STEP\n*STEP, PERTURBATION\n{}*FREQUENCY\n1\n*END STEP\n"


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"behaviour": ""}, r"normal_stiffness \(line 33: hard contact\)"),
        ({"behaviour": "*SURFACE BEHAVIOR\n"}, r"normal_stiffness \(line 34: hard contact\)"),
        ({"behaviour": "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=HARD\n"}, r"normal_stiffness \(line 34: hard contact\)"),
        ({"behaviour": PRESSED.replace("1e5", "0.")}, r"normal_stiffness \(line 35: a slope of 0\.\)"),
        ({"behaviour": PRESSED.replace("1e5\n", "")}, r"normal_stiffness \(line 34: a slope that is not stated\)"),
        ({"behaviour": PRESSED.replace("LINEAR", "EXPONENTIAL")}, r"\(line 34: a pressure that grows exponentially"),
        ({"behaviour": PRESSED.replace("LINEAR", "TABULAR")}, r"normal_stiffness \(line 34: a table of pressures\)"),
        ({"behaviour": PRESSED.replace("LINEAR", "TIED")}, r"normal_stiffness \(line 34: springs that also act in tension\)"),
        ({"behaviour": PRESSED.replace("LINEAR", "SOFT")}, r"PRESSURE-OVERCLOSURE=SOFT, which this program does not have"),
        ({"behaviour": PRESSED.replace("LINEAR", "LINEAR, NO SEPARATION")}, r"\(line 34: contact that never opens\)"),
        ({"friction": ""}, r"friction 0: .*has to state tangential_stiffness \(line 33: no \*FRICTION\)$"),
        ({"friction": "*FRICTION\n0.3\n"}, r"friction 0.3: .*has to state tangential_stiffness \(line 37: no stick slope\)$"),
        ({"friction": "*FRICTION, ROUGH\n"}, r"friction \(line 36: \*FRICTION, ROUGH\)"),
        ({"friction": "*FRICTION\n0.3, 0.\n0.2, 1.\n"}, r"friction \(line 36: 2 lines of coefficients\)"),
        (
            {"more": STEP.format("*CHANGE FRICTION, INTERACTION=DRY\n*FRICTION\n0.1\n")},
            r"friction \(line 42: \*CHANGE FRICTION\)",
        ),
        ({"pair": PAIR.replace("TYPE", "ADJUST=close, TYPE")}, r"gap \(line 31: ADJUST=close\)"),
        ({"more": "*CLEARANCE, MASTER=LOWER, SLAVE=UPPER, VALUE=0.1\n"}, r"gap \(line 38: \*CLEARANCE\)"),
        ({"pair": "*CONTACT PAIR\nUpper, Lower\n"}, r"friction \(line 31: no INTERACTION\), tang.* \(line 31: no INTERACTION\)"),
    ],
)
def test_missing_data_are_named_with_line_and_key(tmp_path, changes, message):
    model = read(tmp_path, **changes)
    assert model.joints[0].lacking
    assert re.search(message, effect(model)), effect(model)


@pytest.mark.parametrize(
    "changes, message",
    [
        (
            {"pair": PAIR.replace("=Dry", "=Dryy")},
            r"line 31: \*CONTACT PAIR: there is no \*SURFACE INTERACTION, NAME=Dryy; nearest is 'DRY'",
        ),
        ({"pair": PAIR.replace("Lower", "Lowre")}, r"line 32: there is no \*SURFACE 'Lowre'; nearest is 'Lower'"),
        ({"friction": "*FRICTION\nhigh\n"}, r"line 37: \*FRICTION holds 'high' where a number is expected"),
        ({"friction": "*FRICTION\n-0.3\n"}, r"line 37: \*FRICTION: the coefficient is -0.3, below 0"),
        ({"behaviour": PRESSED.replace("1e5", "stiff")}, r"line 35: \*SURFACE BEHAVIOR holds 'stiff' where a number is expected"),
    ],
)
def test_wrong_data_are_refused_with_their_line(tmp_path, changes, message):
    with pytest.raises(MeshError, match=message):
        read(tmp_path, **changes)
