"""Methods of the scene equal those of the registry."""

from typing import get_args

from microslip.reduction.methods import METHODS
from microslip.scene.solution import Method


def test_a_scene_may_name_every_registered_method():
    assert set(get_args(Method)) == set(METHODS)
