"""The methods that a scene may name are those of the registry."""

from typing import get_args

from microslip.reduction.methods import METHODS
from microslip.scene.solution import Method


def test_every_registered_method_can_be_named():
    assert set(get_args(Method)) == set(METHODS)
