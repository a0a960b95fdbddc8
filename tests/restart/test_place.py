"""Files of a run take their places; what a killed one had half written is gone."""

from microslip.restart.place import place_of, settle


def test_half_a_file_is_removed_and_the_rest_stays(tmp_path):
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
    place = place_of(folder)
    assert place == folder / "unfinished" and [path.name for path in place.iterdir()] == ["frf.csv"]
    assert sorted(path.name for path in folder.iterdir()) == ["frf.csv", "results.h5", "unfinished"]
    settle(folder, place)
    assert (folder / "frf.csv").read_text() == "unfinished/frf.csv" and not place.exists()


def test_a_folder_of_no_results_is_the_place_itself(tmp_path):
    (tmp_path / "results.h5.part").mkdir()  # taken: writing will tell
    assert place_of(tmp_path) == tmp_path and place_of(tmp_path / "none") == tmp_path / "none"
