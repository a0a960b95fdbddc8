"""The page of trades, from studies made up here."""

import numpy as np
import trade_docs

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


def test_the_page_names_its_command_and_has_all_scenes_that_were_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("lap_joint", "spatial"):
        folder = tmp_path / "results" / f"{name}_trade"
        folder.mkdir(parents=True)
        (folder / "trade.png").write_bytes(name.encode())
        (folder / "section.md").write_text("\n".join(trade_docs.section(f"jobs/{name}.toml", study(), 9.0)))
    trade_docs.write(1, tmp_path / "docs")
    page = (tmp_path / "docs" / "trade.md").read_text()
    assert page.startswith("# Speed against accuracy\n\nMore accuracy costs time")
    assert "- **A scene**: For 1 %: error 0.4 % measured" in page[: page.index("## How to read the tables")]
    assert "- `python jobs/bench/trade_docs.py`\n" in page[page.index("## How it was measured") :]
    assert (
        page.index("`microslip trade jobs/lap_joint.toml`, 9 s")
        < page.index("`microslip trade jobs/spatial.toml`")
        < page.index("## Limits")
    )
    assert (tmp_path / "docs" / "img" / "trade_spatial.png").read_bytes() == b"spatial"
