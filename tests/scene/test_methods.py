"""The methods that a scene may name are those of the registry."""

from microslip.reduction import METHODS
from microslip.scene.not_yet import SUPPORTED


def test_every_registered_method_can_be_named():
    assert set(SUPPORTED) == set(METHODS)
