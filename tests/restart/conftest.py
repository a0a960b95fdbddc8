"""Fixtures of the restart tests: runs without pictures, and a count of the structures built."""

import pytest

from microslip.library.build import build
from microslip.restart import stored_structure


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch):
    monkeypatch.setattr("microslip.results.draw.draw_share", lambda *share: None)
    monkeypatch.setattr("microslip.studies.backbone.report.draw_backbone", lambda *drawn: None)


@pytest.fixture
def built(monkeypatch):
    """Return how often a structure was built: with its modes, and again without."""
    calls = {"first": 0, "again": 0}

    def count(name, function):
        def counting(*arguments, **keys):
            calls[name] += 1
            return function(*arguments, **keys)

        return counting

    monkeypatch.setattr("microslip.run.build", count("first", build))
    monkeypatch.setattr(stored_structure, "rebuilt", count("again", stored_structure.rebuilt))
    return calls
