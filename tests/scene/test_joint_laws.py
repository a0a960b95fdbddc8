"""Keys of the law of a joint: each is read, and a missing key or one of another law gives one message."""

import numpy as np
import pytest
from lap_scene import SCENE, write_mesh
from matrix_scenes import write_matrix_scene
from oracles import scenes

from microslip.assembly.matrices import read_structure
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.read import read_mesh
from microslip.messages.errors import CaseError
from microslip.scene.read import read_scene

ELASTIC = SCENE[SCENE.index("friction = ") : SCENE.index("[[loads]]")]
ROUGH = 'law = "rough"\nfriction = 0.3\npreload = 1e6\nroughness_height = 2e-6\n'
IWAN = 'law = "iwan"\nslip_force = 90.0\ntangential_stiffness = 1e12\nnormal_stiffness = 2e12\nchi = -0.5\nbeta = 0.3\n'
SECOND = '[[joints]]\nname = "second"\nsurfaces = ["lap_2", "lap_1"]\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("laws")
    write_mesh(folder / "lap.msh")
    return folder


def read(folder, law_keys):
    (folder / "lap.toml").write_text(SCENE.replace(ELASTIC, law_keys))
    return read_scene(folder / "lap.toml")


def pairs_of(scene):
    return pair_contacts(read_mesh(scene), scene.joints)


def test_every_key_of_a_joint_of_surfaces_reaches_its_law(folder):
    pairs = pairs_of(read(folder, ROUGH + "exponent = 3.0\nroughness_pressure = 8e6\ntangential_ratio = 0.7\nsliders = 9\n"))
    law = pairs.law
    assert type(law).__name__ == "Rough" and law.n_sliders == 9 and np.all(law.exponent == 3.0)
    assert np.allclose(law.k_n, 3.0 * 1e6 / (2e-6 * 0.5) * pairs.area) and np.allclose(law.k_t, 0.7 * law.k_n)
    law = pairs_of(read(folder, IWAN + "sliders = 20\n")).law
    assert type(law).__name__ == "Iwan" and law.n_sliders == 20 and law.F_S.sum() == pytest.approx(90.0)


def test_values_of_a_file_reach_the_law(folder):
    (folder / "values.csv").write_text("x,y,z,preload\n0.09,0.0,0.0,1e6\n0.12,0.0,0.0,4e6\n")
    pairs = pairs_of(read(folder, ROUGH + 'parameters = "values.csv"\n'))
    pressure = pairs.N0 / pairs.area
    assert set(pressure.round().tolist()) == {1e6, 4e6} and np.allclose(pairs.k_n, pressure / 2e-6 * pairs.area)
    (folder / "values.csv").write_text("x,y,z,tangential_stiffness\n0.105,0.0,0.0,3e12\n")
    pairs = pairs_of(read(folder, IWAN + 'parameters = "values.csv"\n'))
    assert np.allclose(pairs.law.K_T, 3e12 * pairs.area)


@pytest.mark.parametrize(
    "law_keys, rows, message",
    [
        (ROUGH, "x,y,z,preload\n0.105,0.0,0.0,0.0\n", 'line 2: preload = 0; with law = "rough" it must be above 0'),
        (ROUGH, "x,y,z,gap\n0.105,0.0,0.0,1e-6\n", 'gap is not a value of law = "rough", which takes friction, preload'),
        (
            IWAN,
            "x,y,z,friction\n0.105,0.0,0.0,0.3\n",
            'friction is not a value of law = "iwan", which takes tangential_stiffness',
        ),
    ],
)
def test_values_that_a_law_does_not_have_are_refused(folder, law_keys, rows, message):
    (folder / "values.csv").write_text(rows)
    with pytest.raises(CaseError) as error:
        pairs_of(read(folder, law_keys + 'parameters = "values.csv"\n'))
    assert message in str(error.value)


def test_joints_of_three_laws_may_be_combined(folder):
    pairs = pairs_of(read(folder, f"{ROUGH}{SECOND}{IWAN}{SECOND.replace('second', 'third')}{ELASTIC}"))
    n = pairs.n_pairs // 3
    assert pairs.joint == ("lap",) * n + ("second",) * n + ("third",) * n
    assert pairs.laws.tolist() == ["rough"] * n + ["iwan"] * n + ["elastic-coulomb"] * n
    stiffness = pairs.law.stiffness
    assert np.array_equal(stiffness[:, 0], pairs.k_t) and np.array_equal(stiffness[:, 2], pairs.k_n)
    assert np.isnan(pairs.law_columns["slip_force"][:n]).all() and np.isnan(pairs.law_columns["exponent"][2 * n :]).all()


@pytest.mark.parametrize(
    "law_keys, message",
    [
        (ROUGH.replace("roughness_height = 2e-6", ""), "roughness_height is missing: expected the length in m"),
        (ROUGH + "normal_stiffness = 1e12\n", 'normal_stiffness belongs to law = "elastic-coulomb" or "iwan"; this joint has'),
        (ROUGH.replace("preload = 1e6", "preload = 0.0"), "preload = 0: rough surfaces that carry nothing have no stiffness"),
        (
            ROUGH.replace("preload = 1e6", 'preload = "static"'),
            'preload = "static": the exponential of law = "rough" has a pressure at every approach; state in Pa',
        ),
        (ROUGH + "exponent = 2.0\n", "exponent without roughness_pressure: a power takes both"),
        (ROUGH + "roughness_pressure = 1e6\n", "roughness_pressure without exponent: a power takes both"),
        (ROUGH + "exponent = 1.0\nroughness_pressure = 1e6\n", "exponent = 1.0: expected the power of the approach"),
        (ROUGH.replace("preload = 1e6", "gap = 1e-6"), 'gap belongs to law = "elastic-coulomb"; this joint has law = "rough"'),
        (ROUGH.replace("0.3", "[0.3, 0.2]"), 'friction: law = "rough" takes one number for both directions'),
        (IWAN.replace("chi = -0.5", "chi = -1.0"), "chi = -1.0: expected the exponent of the sliders' distribution"),
        (IWAN.replace("beta = 0.3\n", ""), "beta is missing: expected the stiffness of the last slider over that of the others"),
        (IWAN + "friction = 0.3\n", 'friction belongs to law = "elastic-coulomb" or "rough"; this joint has law = "iwan"'),
        (IWAN + "sliders = 1\n", "sliders = 1: expected the number of elements a pair, a whole number from 2 to 1000"),
        (ELASTIC + "sliders = 9\n", 'sliders belongs to law = "rough" or "iwan"; this joint has law = "elastic-coulomb"'),
        (ELASTIC.replace("0.3", "[0.3, 0.2]"), 'friction = [x, y] needs friction_limit = "separate": a friction circle'),
        (ELASTIC.replace("0.3", "[0.3, -0.2]"), "friction = [0.3, -0.2]: expected the friction coefficient"),
        (
            ELASTIC.replace("tangential_stiffness = 1e12", "tangential_stiffness = [1e12, 2e12]"),
            'tangential_stiffness = [x, y] needs friction_limit = "separate"',
        ),
    ],
)
def test_keys_that_do_not_fit_the_law_are_refused(folder, law_keys, message):
    with pytest.raises(CaseError) as error:
        read(folder, law_keys)
    assert '[[joints]] 1 ("lap")' in str(error.value) and message in str(error.value)


@pytest.mark.parametrize("law_keys", [ELASTIC, ROUGH, IWAN])
def test_statics_accept_all_laws(folder, law_keys):
    scene = read(folder, law_keys + '[statics]\n[[statics.pressures]]\ngroup = "lap_1"\npressure = 1e5\n')
    assert scene.statics is not None


def with_pairs(folder, law_keys, **changed):
    """Return the structure of a mass with other values of its pair and with the keys of a law."""
    path = write_matrix_scene(folder, scenes.spatial_mass() | changed, [0.4], (0.8, 2.4))
    path.write_text(path.read_text().replace('friction_limit = "circle"', law_keys))
    return read_structure(read_scene(path))


def test_pairs_of_matrices_have_the_law_of_the_scene_with_values_of_the_file(tmp_path):
    law = with_pairs(tmp_path, 'law = "iwan"\nchi = -0.3\nbeta = 1.0').pairs.law
    assert law.F_S.tolist() == [0.4] and law.K_T.tolist() == [1.5] and law.chi.tolist() == [-0.3]
    law = with_pairs(tmp_path, 'law = "rough"').pairs.law
    assert law.N0.tolist() == [1.0] and law.k_n.tolist() == [2.5] and np.isinf(law.exponent).all()


@pytest.mark.parametrize(
    "law_keys, changed, message",
    [
        ('law = "rough"', {"N0": np.array([-1.0])}, 'n0 = 0; with law = "rough" it must be above 0'),
        ('law = "iwan"\nchi = -0.3\nbeta = 1.0', {"mu": np.array([0.0])}, 'mu = 0; with law = "iwan" it must be above 0'),
        ('law = "iwan"\nchi = -0.3', {}, "beta is missing"),
        ('law = "rough"\nroughness_height = 1e-6', {}, "roughness_height belongs to a joint of surfaces; a CSV file states it"),
    ],
)
def test_values_of_pairs_of_matrices_that_a_law_does_not_have_are_refused(tmp_path, law_keys, changed, message):
    with pytest.raises(CaseError) as error:
        with_pairs(tmp_path, law_keys, **changed)
    assert message in str(error.value)
