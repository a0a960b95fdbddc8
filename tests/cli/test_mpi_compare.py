"""`microslip compare`, from the scene to the table, on any number of ranks."""

import csv

import pytest
from bar_scene import write_bar

from microslip.parallel.agree import on_root
from microslip.reduction.methods import METHODS, full
from microslip.studies.compare import story as compare

pytestmark = pytest.mark.ranks(1, 2)


@pytest.fixture
def program(comm, shared_path, program):
    """Return what to call with arguments after the scene's: status and what was said on all ranks.  Collective."""

    def run(*arguments):
        path = on_root(comm, lambda: write_bar(shared_path, modes=30))
        return program("compare", path, "--out", shared_path / "out", *arguments)

    return run


def rows(folder):
    with open(folder / "out" / "compare.csv", newline="") as file:
        return {entry["method"]: entry for entry in csv.DictReader(file)}


def test_all_methods_in_one_command(program, shared_path):
    status, out, err = program()
    assert (status, err) == (0, "")
    found = rows(shared_path)
    assert set(found) == set(METHODS) and next(iter(found)) == "full"
    assert len({entry["points"] for entry in found.values()}) == 1
    assert float(found["full"]["difference_percent"]) == 0.0
    for method in ("receptance", "rubin", "craig-bampton"):
        assert float(found[method]["difference_percent"]) < 0.1
    assert (shared_path / "out" / "compare.png").exists() and "differences from full" in out


@pytest.mark.ranks(1)
def test_receptance_is_the_reference_where_full_does_not_fit(program, shared_path, monkeypatch):
    monkeypatch.setattr(compare, "LARGEST_REFERENCE", 100)
    status, _, _ = program("--methods", "adaptive")
    assert status == 0
    assert list(rows(shared_path)) == ["receptance", "adaptive"]
    monkeypatch.setattr(full, "memory_left", lambda comm: 1e5)
    status, _, err = program("--methods", "full,adaptive")
    assert status == 2 and '[solver] method = "full" needs about' in err


def test_an_unknown_method_is_named_once(program):
    status, _, err = program("--methods", "rubin,adaptiv")
    assert status == 2
    assert err.count("--methods: unknown method 'adaptiv'; nearest is adaptive; known: receptance, ") == 1
