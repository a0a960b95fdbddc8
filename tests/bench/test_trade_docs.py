"""The page of trades, from studies made up here."""

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


def test_a_section_has_reference_table_sentences_and_choices():
    text = "\n".join(trade_docs.section("jobs/scene.toml", study(), 9.0))
    assert "| base |  | 8 | 5 | 256 | 77 | 0.2 | 1.5 | 1.4 | 1.9 | 0.4 |" in text
    assert "harmonics 7 -> 15: 0.4 %, 15 -> 31: 0.1 %; more would change 0.033 %" in text
    assert "of 5 points with an error above that, 100.0 % lie under their bar; the bar is 2.5 times" in text
    assert "for 1 %: error 0.4 % measured" in text and "for 0.1 %: not reached" in text


def test_parts_of_a_scene_are_those_of_the_page():
    page = (ROOT / "docs" / "trade.md").read_text(encoding="utf-8")
    parts = {name: text for scene in trade_docs.SCENES for name, text in trade_docs.of_scene(scene, study(), 9.0).items()}
    assert {*parts, "machine"} == {name for _, name, _ in MARKED.findall(page)}
    assert parts["spatial-short"][0].startswith("- **A scene**: For 1 %: error 0.4 % measured")
    assert parts["spatial"][0].startswith("`microslip trade jobs/spatial.toml`, 9 s")
