"""Axes drawn with one tick that moves look as matplotlib's own."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from microslip.results import style
from microslip.results.layout import log_scale

LIMITS = {
    "linear": ((355.0, 370.0), (-0.03, 1.7), ()),
    "logarithmic": ((1.0, 2.0), (1e-17, 3e-5), ("y",)),
    "few powers of ten": ((0.9, 40.0), (0.02, 0.9), ("x", "y")),
    "with a common factor": ((0.0, 5e7), (0.0, 3e-9), ()),
}


def picture(limits, logarithmic):
    page = style.Page(type("Scene", (), {"title": "title"})(), "ticks", 4.0, 2.5)
    ax = page.figure.add_subplot(page.grid(1, 1)[0, 0])
    log_scale(ax, *logarithmic)
    ax.set(xlim=limits[0], ylim=limits[1], xlabel="frequency [Hz]", ylabel="amplitude [m]")
    canvas = FigureCanvasAgg(page.figure)
    canvas.draw()
    return np.array(canvas.buffer_rgba())


@pytest.mark.parametrize("case", LIMITS)
def test_one_tick_draws_what_matplotlib_draws(case, monkeypatch):
    *limits, logarithmic = LIMITS[case]
    with style.matplotlib.rc_context(style.RC):
        by_one = picture(limits, logarithmic)
        monkeypatch.setattr(style, "draw_with_one_tick", lambda figure: None)
        expected = picture(limits, logarithmic)
    assert expected[..., :3].min() < 60, "something is drawn"
    np.testing.assert_array_equal(by_one, expected)
