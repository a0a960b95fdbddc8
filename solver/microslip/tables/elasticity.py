"""The elasticity of a material that differs by direction, from the constants of its table."""

from typing import Any

import numpy as np

from ..elements import checked, orthotropic


def elasticity_of(rows: Any, young: Any, poisson: Any, shear: Any) -> np.ndarray:
    """Return stress of strain (6, 6) [Pa]: as stated in rows, or of three constants each along the axes.  Local.

    Raises
    ------
    ValueError : there is no material of these constants
    """
    if rows is not None:
        return checked(np.array(rows))
    if not isinstance(young, tuple) or not isinstance(poisson, tuple) or shear is None:
        raise ValueError("three constants along the axes are needed")
    return orthotropic(young, poisson, shear)
