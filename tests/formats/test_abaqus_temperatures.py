"""Temperatures in input files of Abaqus and CalculiX: materials that depend on them, and thermal loads."""

import pytest
from plain_model import CUBE

from microslip.formats.read import read_model

SECOND = """*NODE, NSET=UPPER
11, 0, 0, 2
12, 1, 0, 2
13, 1, 1, 2
14, 0, 1, 2
15, 0, 0, 3
16, 1, 0, 3
17, 1, 1, 3
18, 0, 1, 3
*ELEMENT, TYPE=C3D8, ELSET=SECOND
2, 11, 12, 13, 14, 15, 16, 17, 18
"""
TABLES = """*MATERIAL, NAME=Hot
*ELASTIC
200., .3, 0.
100., .2, 500.
*DENSITY
2.
*EXPANSION, ZERO=10.
1.e-5, 0.
3.e-5, 400.
*SOLID SECTION, ELSET=CUBE, MATERIAL=HOT
"""
COLD = "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 20.\n"
VIBRATION = "*STEP, PERTURBATION\n*FREQUENCY\n2\n*END STEP\n"


def read(folder, text):
    (folder / "job.inp").write_text(text)
    return read_model(folder / "job.inp")


def words(model):
    return [finding.word for finding in model.findings if finding.changes]


def temperature_rises(model):
    return [(temperature.group, temperature.temperature) for temperature in model.statics.table.temperatures]


def heated(*cards: str) -> str:
    return "".join(f"*STEP\n*STATIC\n{card}\n*END STEP\n" for card in cards) + VIBRATION


def test_materials_are_evaluated_at_the_temperature_of_the_vibration(tmp_path):
    model = read(tmp_path, CUBE + TABLES + COLD + heated("*TEMPERATURE\nALL, 9.", "*TEMPERATURE\nALL, 220."))
    hot = model.materials["Hot"]
    assert (hot.young, hot.poisson, hot.density) == pytest.approx((156.0, 0.256, 2.0))
    alpha = (
        2.1e-5 * (220.0 - 10.0) - 1.1e-5 * (20.0 - 10.0)
    ) / 200.0  # reference temperature 10 of the expansion, 20 of the stress
    assert hot.expansion == pytest.approx(alpha)
    assert temperature_rises(model) == [("CUBE", 200.0)] and words(model) == ["*STEP, PERTURBATION"]


def test_without_loads_the_initial_temperature_holds_and_tables_extend_as_constants(tmp_path):
    model = read(tmp_path, CUBE + TABLES + COLD.replace("20.", "900.") + "*STEP\n*FREQUENCY\n2\n*END STEP\n")
    assert model.materials["Hot"].young == 100.0 and model.statics is None and words(model) == []


def test_bodies_of_one_material_at_two_temperatures_have_separate_materials(tmp_path):
    sections = "*SOLID SECTION, ELSET=SECOND, MATERIAL=HOT\n"
    text = CUBE + SECOND + TABLES + sections + COLD
    model = read(tmp_path, text + heated("*TEMPERATURE\nALL, 20.\nUPPER, 500."))
    assert {key: model.materials[body.material].young for key, body in model.bodies.items()} == {"CUBE": 196.0, "SECOND": 100.0}
    assert temperature_rises(model) == [("SECOND", 500.0)]  # no initial temperature of SECOND: 0


NOT_KNOWN = {
    "differs within the body": (COLD + heated("*TEMPERATURE\n1, 220."), {"*ELASTIC", "*EXPANSION", "*TEMPERATURE"}),
    "stated nowhere": ("*STEP\n*FREQUENCY\n2\n*END STEP\n", {"*ELASTIC", "*EXPANSION"}),
    "of a vibration about nothing": (
        COLD + heated("*TEMPERATURE\nALL, 220.").replace(", PERTURBATION", ""),
        {"*ELASTIC", "*EXPANSION"},
    ),
    "of the vibration's step": (
        COLD + "*STEP, PERTURBATION\n*FREQUENCY\n2\n*TEMPERATURE\nALL, 3.\n*END STEP\n",
        {"*ELASTIC", "*EXPANSION"},
    ),
    "from a results file": (COLD + heated("*TEMPERATURE, FILE=heat.frd"), {"*TEMPERATURE, FILE"}),
}


@pytest.mark.parametrize("steps, expected", NOT_KNOWN.values(), ids=NOT_KNOWN)
def test_material_tables_without_a_single_temperature_are_findings(tmp_path, steps, expected):
    assert set(words(read(tmp_path, CUBE + TABLES + steps))) - {"*STEP, PERTURBATION"} == expected


def test_tables_over_field_variables_are_findings(tmp_path):
    fields = TABLES.replace("*ELASTIC\n200., .3, 0.", "*ELASTIC, DEPENDENCIES=1\n200., .3, 0., 1.")
    assert words(read(tmp_path, CUBE + fields + COLD + "*STEP\n*FREQUENCY\n2\n*END STEP\n")) == ["*ELASTIC", "*EXPANSION"]
