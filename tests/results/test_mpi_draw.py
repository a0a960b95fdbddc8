"""The pictures of a run are distributed over its ranks."""

from pathlib import Path

import matplotlib
import matplotlib.ft2font
import numpy as np
import pytest
from mpi4py import MPI
from synthetic_results import branch, two_flanks, write

from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.results import plots
from microslip.results.draw import draw, fonts_in_memory

COMM = MPI.COMM_WORLD
DRAWN = ("response", "states", "slip_map", "rom_size", "energy", "energy_map")  # without error bars and statics
pytestmark = pytest.mark.ranks(1, 2, 3)


def test_every_picture_is_drawn_once_and_rank_0_writes_first(shared_path, monkeypatch):
    pairs, done = two_flanks(5, 1), []
    results = Path(on_root(COMM, lambda: write(shared_path, [branch(1.0, pairs)], pairs)))
    monkeypatch.setattr(plots.Page, "save", lambda page, path: done.append(Path(path).stem) or path)
    draw(COMM, results.parent, lambda: done.append("written"))
    assert (done[:1] == ["written"]) == (COMM.rank == 0)
    assert sorted(sum(COMM.allgather(done), [])) == sorted([*DRAWN, "written"])


def test_an_error_of_one_rank_is_raised_on_every_rank(shared_path):
    with pytest.raises(CaseError, match=r"results\.h5"):
        draw(COMM, shared_path / "nowhere")


def letters(path):
    font = matplotlib.ft2font.FT2Font(path, 8)
    font.set_size(8.0, 200.0)
    font.set_text("365.8 Hz", 0.0)
    font.draw_glyphs_to_bitmap(antialiased=True)
    return np.array(font.get_image())  # a copy: the image ends with its font


def test_fonts_in_memory_have_the_letters_of_their_files():
    path, before = str(Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")), matplotlib.ft2font.FT2Font
    of_file = letters(path)
    with fonts_in_memory():
        assert matplotlib.ft2font.FT2Font is not before
        np.testing.assert_array_equal(letters(path), of_file)
    assert matplotlib.ft2font.FT2Font is before and of_file.any()
