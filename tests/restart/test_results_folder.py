"""Files of a run are moved to its folder; partial files of a killed run are removed."""

import pytest

from microslip.messages.errors import CaseError
from microslip.restart.results_folder import is_results_file, move_results, note_on_replaced, output_folder
from microslip.results.plots import PICTURES, STATIC_PICTURES


def test_partial_files_are_removed_and_complete_files_remain(tmp_path):
    folder = tmp_path / "out"
    (folder / "unfinished").mkdir(parents=True)
    for name in (
        "results.h5",
        "results.h5.part",
        "frf.csv",
        "unfinished/results.h5.part",
        "unfinished/frf.csv",
        "unfinished/rest.png",
    ):
        (folder / name).write_text(name)
    output = output_folder(folder)
    assert output == folder / "unfinished" and [path.name for path in output.iterdir()] == ["frf.csv"]
    assert sorted(path.name for path in folder.iterdir()) == ["frf.csv", "results.h5", "unfinished"]
    move_results(folder, output)
    assert (folder / "frf.csv").read_text() == "unfinished/frf.csv" and not output.exists()


def test_a_folder_without_results_is_written_directly(tmp_path):
    (tmp_path / "results.h5.part").mkdir()  # occupied: writing will fail
    assert output_folder(tmp_path) == tmp_path and output_folder(tmp_path / "none") == tmp_path / "none"


def test_other_files_are_not_moved(tmp_path):
    own_files, others = ("results.h5", "response2.png", "motion_0003.vtkhdf"), ("beam.toml", "beam.msh", "drawing.part", "my.png")
    (tmp_path / "unfinished").mkdir()
    for name in (*own_files, *others, "results.h5.part", "unfinished/results.h5"):
        (tmp_path / name).write_text(name)
    move_results(tmp_path, output_folder(tmp_path), keeps_earlier=True)
    assert sorted(path.name for path in (tmp_path / "earlier-1").iterdir()) == sorted(own_files)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(("earlier-1", "results.h5", *others))


@pytest.mark.parametrize("draw", dict.fromkeys((*PICTURES, *STATIC_PICTURES)))
def test_every_picture_is_a_file_of_a_run(draw):
    name = draw.__name__.removeprefix("draw_").removeprefix("static_")
    assert all(is_results_file(f"{name}{page}.png") for page in ("", "2", "_02"))


def test_outdated_tables_and_pictures_are_removed(tmp_path):
    output = tmp_path / "unfinished"
    output.mkdir()
    earlier = ("results.h5", "sectors.csv", "sensitivities.csv", "multipliers.png", "response_01.png", "response_02.png")
    for name in (*earlier, "report.html", "mine.png", "unfinished/results.h5", "unfinished/response.png"):
        (tmp_path / name).write_text(name)
    assert "report.html" in note_on_replaced(tmp_path, output, False) and not note_on_replaced(tmp_path, output, True)
    move_results(tmp_path, output)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.png", "response.png", "results.h5"]
    assert not note_on_replaced(tmp_path, output, False)


def test_user_files_in_unfinished_remain_and_stop_no_run(tmp_path):
    output = tmp_path / "unfinished"
    (output / "notes").mkdir(parents=True)
    (output / "energy.png").mkdir()
    for path in (tmp_path / "results.h5", output / "my_curve.csv", output / "notes" / "mine.txt", output / "states.png"):
        path.write_text(path.name)
    assert output_folder(tmp_path) == output
    (output / "results.h5").write_text("new")
    move_results(tmp_path, output)
    assert (tmp_path / "results.h5").read_text() == "new"
    assert sorted(path.name for path in output.iterdir()) == ["energy.png", "my_curve.csv", "notes"]
    assert (output / "notes" / "mine.txt").is_file() and sorted(path.name for path in tmp_path.iterdir()) == [
        "results.h5",
        "unfinished",
    ]
    move_results(tmp_path, output_folder(tmp_path))  # as does every later run
    (output / "frf.csv").mkdir()
    with pytest.raises(CaseError, match=r"unfinished/frf\.csv: cannot be written: Is a directory"):
        output_folder(tmp_path)


def test_a_table_without_results_belongs_to_an_earlier_run(tmp_path):
    (tmp_path / "frf.csv").write_text("kept, where results.h5 was taken away")
    assert output_folder(tmp_path) == tmp_path / "unfinished"


def test_a_folder_with_the_name_of_a_file_is_rejected_before_any_computation(tmp_path):
    (tmp_path / "results.h5").mkdir()
    with pytest.raises(CaseError, match=r"results\.h5: cannot be written: Is a directory"):
        output_folder(tmp_path)
