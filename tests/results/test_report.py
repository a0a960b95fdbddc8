"""report.html: complete, with the data of the results, and without executable text of a user."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from full_results import MESH, TITLE, fields, write_full_results
from synthetic_results import branch, no_pairs, pairs_of, two_flanks, write

from microslip.messages.errors import CaseError
from microslip.points.error_parts import PARTS, total
from microslip.points.peak import Peak
from microslip.results.fields import RunRecord, read_fields, read_run
from microslip.results.read import read_results
from microslip.results.record import PeaksOver
from microslip.results.report import page, tables
from microslip.results.report.figures import figures_of
from microslip.results.report.page import page_of, write_report
from microslip.results.report.view import view_data

EMPTY = {"meta", "br", "input"}


class Page(HTMLParser):
    """Tags with their nesting, texts, scripts."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.texts, self.scripts = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, text):
        (self.scripts if self.open and self.open[-1] == "script" else self.texts).append(text)


def page_from(path):
    return page_of(read_results(path), read_fields(path), read_run(path), "/* the library */")


def data_of(parsed):
    return json.loads(parsed.scripts[0])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = write_full_results(tmp_path_factory.mktemp("kept"), title=TITLE)
    return path, page_from(path)


def test_the_page_is_complete_and_loads_nothing(whole):
    parsed = Page(whole[1])
    assert parsed.open == [] and len(parsed.scripts) == 3
    assert not any({"src", "href"} & attrs.keys() and not attrs.get("href", "").startswith("#") for _, attrs in parsed.tags)
    policy = next(attrs["content"] for tag, attrs in parsed.tags if tag == "meta" and "content" in attrs)
    assert policy.startswith("default-src 'none'")
    links = [attrs["href"][1:] for tag, attrs in parsed.tags if tag == "a"]
    assert links == [attrs["id"] for tag, attrs in parsed.tags if tag == "section"] and "motion" in links


def test_no_button_uploads_the_chart(whole):
    """Plotly 7 has one that uploads it."""
    library = pytest.importorskip("plotly.offline").get_plotlyjs()
    removed = re.search(r"const removed = \[(.*)\]", whole[1])[1]
    assert set(re.findall(r'name:"(send\w+)"', library)) <= set(re.findall(r'"(\w+)"', removed))
    assert "form-action 'none'" in whole[1]


def test_texts_of_the_user_are_texts(whole):
    """Title, names of outputs, groups and joints, the scene, notes: none opens a tag or ends a script."""
    parsed = Page(whole[1])
    assert TITLE in "".join(parsed.texts) and "a note </pre><script>" in "".join(parsed.texts)
    assert "<img src=x>" in "".join(parsed.texts) and "lower <b>" in "".join(parsed.texts)
    assert not any(tag in ("img", "b<", "iframe") for tag, _ in parsed.tags)
    assert all(text not in whole[1] for text in ("<script>alert", "<img", "</title> "))
    assert "<" not in parsed.scripts[0]
    assert data_of(parsed)["view"]["bodies"][0]["name"] == "lower &lt;b&gt;"  # plotly reads tags in names


def test_scripts_have_their_elements(whole):
    """Every element requested by the page's script exists, and every figure has data."""
    parsed = Page(whole[1])
    named = {attrs["id"] for _, attrs in parsed.tags if "id" in attrs}
    requested = set(re.findall(r'at\("([\w-]+)"\)', parsed.scripts[2])) | {"data"}
    assert len(requested) > 8 and requested <= named
    places = [attrs["data-figure"] for _, attrs in parsed.tags if "data-figure" in attrs]
    assert sorted(places) == sorted(data_of(parsed)["figures"])
    pairs = {int(attrs["data-pair"]) for _, attrs in parsed.tags if "data-pair" in attrs}
    maps = data_of(parsed)["maps"]
    assert pairs == set(range(6)) == set(range(len(maps["labels"])))
    assert all(len(values) == 6 for one in maps["quantities"] for values in one["values"])


def test_numbers_are_those_of_the_results(whole):
    results = read_results(whole[0])
    level = results.levels[1]
    size = np.hypot(*level.response[:, 0, 1:3].T)
    assert f"{1e3 * size.max():.4g} mm" in tables.peaks_table(results)
    curve = [trace for trace in figures_of(results)["response_0"]["data"] if trace["name"] == "8 N"][0]
    assert curve["y"] == pytest.approx(1e3 * size) and curve["x"] == pytest.approx(level.frequency)
    loss = next(one for one in data_of(Page(whole[1]))["maps"]["quantities"] if one["heading"].startswith("friction loss"))
    at = int(np.argmax(size))
    ratio = np.array(loss["values"][1]) / np.where(level.energy[at] > 0.0, level.energy[at], 1.0)
    assert ratio[level.energy[at] > 0.0] == pytest.approx(ratio.max(), rel=1e-3)


def test_times_of_parts_are_within_those_of_their_stage(whole):
    text = tables.times_table(read_results(whole[0]), read_run(whole[0]))
    assert "<td>&ensp;&ensp;a part</td><td>1 s</td><td>67 %</td>" in text
    assert "<td>until the results were written</td><td>1.5 s</td>" in text


WAVE = "24 sectors that vibrates as a wave (nodal diameter"


@pytest.mark.parametrize(
    ("cyclic", "words", "of_modes"),
    [
        ("sectors = 24\nengine_order = 23", f"{WAVE} 1, by engine order 23)", "stuck, at nodal diameter 1."),
        ('sectors = 24\nnodal_diameter = 3\nwave = "forward"', f"{WAVE} 3)", "stuck, at nodal diameter 3."),
        (
            "sectors = 2\nengine_order = 3\nwhole = true",
            "2 sectors that may differ (nodal diameter 1, by engine order 3)",
            "stuck.",
        ),
    ],
)
def test_the_numbers_of_a_disc_are_those_of_its_sectors(whole, cyclic, words, of_modes):
    results = replace(read_results(whole[0]), scene_text=f"[cyclic]\n{cyclic}\n")
    assert words in tables.disc_note(results) and of_modes in tables.modes_table(results)
    assert words in page_of(results, read_fields(whole[0]), read_run(whole[0]), "")
    assert ("largest of all sectors" in tables.cards(results)) == ("whole" in cyclic)
    assert tables.disc_note(read_results(whole[0])) == ""


def test_motion_on_the_page_is_that_of_the_fields(whole):
    import base64

    view = view_data(read_results(whole[0]), fields())
    shown = view["shown"][1]
    u = np.frombuffer(base64.b64decode(shown["u"]), "<i2").reshape(7, 3, view["n"]) * shown["scale"]
    points = np.frombuffer(base64.b64decode(view["points"]), "<f4").reshape(-1, 3)
    where = [int(np.argmin(np.linalg.norm(MESH.points - point, axis=1))) for point in points]
    same = [
        i for i, node in enumerate(where) if (MESH.points == MESH.points[node]).all(axis=1).sum() == 1
    ]  # nodes of one body only
    assert len(same) > 10
    np.testing.assert_allclose(
        u[:, :, same], np.moveaxis(fields().peaks[1].u, (2, 1), (0, 1))[:, :, np.array(where)[same]], atol=1e-3
    )
    assert shown["orders"] == [0, 1, 1, 2, 2, 3, 3] and shown["sine"] == [False, False, True, False, True, False, True]
    assert [one["kind"] for one in view["shown"]] == ["level", "level", "mode", "mode", "rest"]


def test_checks_report_failures_imbalance_and_large_error_bars(tmp_path):
    pairs = two_flanks(2, 1)
    good, bad, short = branch(1.0, pairs), branch(8.0, pairs), branch(5.0, pairs, n_points=9)
    short.failure = "hb: no convergence <here>"
    bad.points[7] = replace(bad.points[7], input=2.0 * bad.points[7].input)
    for one, size in ((good, 1e-9), (bad, 1e-3)):
        one.points[:] = [replace(point, error=np.full((1, len(PARTS)), size)) for point in one.points]
    checks = tables.checks(read_results(write(tmp_path, [good, bad, short], pairs)))
    assert checks[0] == (tables.BAD, "5 N, stopped at 102 Hz: hb: no convergence &lt;here&gt;")
    balance = [how for how, text in checks if "energy balance" in text]
    assert balance == [tables.GOOD, tables.LOOK, tables.GOOD]
    assert [how for how, text in checks if "error bar" in text] == [tables.GOOD, tables.LOOK]
    assert total(np.full(5, 1e-3)) > tables._LARGE * np.hypot(*bad.points[30].response[0, 1:3])


@pytest.mark.parametrize("kind", ["linear", "places", "nothing", "unloaded", "one point"])
def test_pages_of_partial_results(tmp_path, kind):
    pairs = {"linear": no_pairs()}.get(
        kind, pairs_of(np.full((7, 3), np.nan), np.tile(np.eye(3), (7, 1, 1)), np.ones(7), ("a",) * 7, ())
    )
    levels = {"nothing": [], "unloaded": [0.0, 8.0]}.get(kind, [8.0])
    branches = [branch(level, pairs, n_points=1 if kind == "one point" else 20) for level in levels]
    parsed = Page(page_from(write(tmp_path, branches, pairs, linear=kind != "places")))
    assert parsed.open == [] and data_of(parsed)["view"] is None
    sections = [attrs["id"] for tag, attrs in parsed.tags if tag == "section"]
    assert "motion" not in sections and ("joint" in sections) == (kind not in ("linear", "nothing"))


def test_statics_are_drawn_over_the_load(tmp_path):
    pairs = two_flanks(2, 1)
    branches = [branch(level, pairs, n_points=1) for level in (2.0, 1.0)]
    for one in branches:
        mean = np.zeros((1, 7))
        mean[0, 0] = 1e-3 * one.level
        one.points[:] = [replace(one.points[0], response=mean)]
    results = read_results(write(tmp_path, branches, pairs))
    figure = figures_of(results)["response_0"]
    assert figure["data"][0]["x"] == [1.0, 2.0] and figure["data"][0]["y"] == pytest.approx([1.0, 2.0])
    assert Page(page_of(results, None, RunRecord(), "")).open == []


def test_without_plotly_there_is_one_message(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(CaseError, match="report needs plotly.*pip install plotly"):
        write_report("none.h5", tmp_path)


def test_report_is_written_to_the_requested_folder(monkeypatch, tmp_path, whole):
    monkeypatch.setattr(page, "plotly_js", lambda: "/* the library */")
    assert write_report(whole[0], tmp_path / "out") == str(tmp_path / "out" / "report.html")
    assert (tmp_path / "out" / "report.html").read_text(encoding="utf-8") == whole[1]
    with pytest.raises(CaseError, match="no such file"):
        write_report(str(tmp_path / "none.h5"), tmp_path)


def test_report_needs_no_petsc():
    code = "import sys, microslip.results.report.page, microslip.results.convert; sys.exit('petsc4py' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_peaks_over_a_parameter_have_their_curves(whole):
    """One place for each quantity, with the data of the results; the reason of an early end as text."""
    results = read_results(whole[0])
    level = replace(results.levels[0], level=7.0, failure="Newton's method <failed>")
    n = len(level.frequency)
    linear = Peak(0, 600.0, 1e-6 + 0.0j, 6.0, 0.0, 0, 3)
    over = PeaksOver("joints.a.friction", "1", linear, np.linspace(0.1, 2.0, n), np.full(n, 0.01), level)
    parsed = Page(page_of(replace(results, over=(over,)), read_fields(whole[0]), read_run(whole[0]), ""))
    places = [dict(attributes).get("data-figure", "") for _, attributes in parsed.tags]
    assert [name for name in places if name.startswith("over")] == ["over_0", "over_frequency_0", "over_damping_0"]
    figure = data_of(parsed)["figures"]["over_frequency_0"]
    assert figure["data"][0]["y"] == pytest.approx(level.frequency) and figure["layout"]["xaxis"]["type"] == "log"
    assert figure["layout"]["xaxis"]["title"]["text"] == "joints.a.friction [-]"
    assert any("Newton's method <failed>" in text for text in parsed.texts)
