"""The page of trades, from synthetic studies."""

from pathlib import Path

import numpy as np
import trade_docs
from page_tables import MARKED
from sources import ROOT

from microslip.studies.trade.study import BASE, Check, Curve, Reference, Run, Setting, Study


def study():
    omega = np.linspace(1.0, 2.0, 5)
    exact = Curve(2.0, omega, 1.0 / (1.0 + 1j * (omega - 1.5)), np.full(5, 1e-6))
    off = Curve(2.0, omega, exact.u + 4e-3, np.full(5, 1e-2))
    base = Setting(8, 5, 256)
    reference = Reference(
        Setting(40, 31, 1024), {2.0: exact}, (Check("harmonics", (7, 15, 31), (4e-3, 1e-3)),), 1.0, "harmonics: enough"
    )
    return Study(
        "A scene", "scene", reference, base, [Run(BASE, "", base, 0.2, 1.5, 1.4, 2.0, 1.9, 77, (off,))], shared={"assembly": 0.5}
    )


def measured(scene):
    return trade_docs.Measured(scene, study(), 9.0, "2026-01-01", ["Processor: one.", "1 rank, 2026-01-01."])


def test_a_section_has_reference_table_and_settings():
    text = "\n".join(trade_docs.section(measured("jobs/scene.toml")))
    assert "| base |  | 8 | 5 | 256 | 77 | 0.2 | 1.5 | 1.4 | 1.9 | 0.4 |" in text
    assert "harmonics 7 -> 15: 0.4 %, 15 -> 31: 0.1 %; more would change 0.033 %" in text
    assert "of 5 points with an error above that, 100.0 % lie under their bar; the bar is 2.5 times" in text
    assert "for 1 %: error 0.4 % measured" in text and "for 0.1 %: not reached" in text


def test_the_first_table_has_a_row_for_each_target():
    rows = trade_docs.chosen(measured("jobs/scene.toml"))
    assert rows[0] == ["[A scene](#a-scene)", "1", "0.4", "0.4", "1.4", "0.2", "`microslip trade jobs/scene.toml`"]
    assert rows[1][:4] == ["", "0.1", "not reached: 0.4", "4"] and rows[2][2] == "not reached: 0.4"


def test_a_stored_measurement_gives_the_same_page():
    first = measured("jobs/scene.toml")
    restored = trade_docs.from_json(trade_docs.to_json(first))
    assert trade_docs.section(restored) == trade_docs.section(first) and trade_docs.chosen(restored) == trade_docs.chosen(first)
    np.testing.assert_array_equal(restored.study.runs[0].curves[0].u, first.study.runs[0].curves[0].u)


def test_sections_of_the_page_are_those_of_the_scenes():
    page = (ROOT / "docs" / "trade.md").read_text(encoding="utf-8")
    stems = [Path(scene).stem for scene in trade_docs.SCENES]
    assert {*stems, "chosen", "machine"} == {name for _, name, _ in MARKED.findall(page)}
