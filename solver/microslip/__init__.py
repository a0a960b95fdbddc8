"""microslip: steady-state vibration of jointed structures with friction contact.

As a library (docs/library.md)::

    import microslip
    scene = microslip.read("jobs/fan_small.toml")
    structure = microslip.build(scene)                       # mesh, matrices, factor, modes: once
    response = microslip.respond(structure, levels=[5.0, 10.0], friction={"dovetail": 0.25})
    response["mid_blade"].amplitude

Nothing is imported, and neither MPI nor PETSc started, before it is used.
"""

from __future__ import annotations

import os
import resource
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any


def _may_cut_files() -> bool:
    """Return whether a file may end before its content does: files are limited, or the disk of the program is full.  Local."""
    disk = os.statvfs(os.path.dirname(__file__))
    return resource.getrlimit(resource.RLIMIT_FSIZE)[0] != resource.RLIM_INFINITY or disk.f_bavail * disk.f_frsize < 2**20


if _may_cut_files():
    sys.dont_write_bytecode = True  # a truncated compiled module would make every further start fail

from .system.blas import name_kernels
from .version import __version__ as __version__

name_kernels()  # before anything imports NumPy

if TYPE_CHECKING:
    from .library.backbone import Backbone, backbone
    from .library.build import Structure, build
    from .library.identify import Identified, identify
    from .library.peak_curves import peaks
    from .library.respond import respond
    from .library.response import Curves, Response
    from .library.search import Search, search
    from .library.sweep import SweepTable, sweep
    from .library.worn_joints import wear
    from .messages.errors import CaseError, ConvergenceError, MicroslipError, ResourceError
    from .results.read import read_results
    from .results.wear import WearHistory
    from .scene.read import read_scene as read
    from .scene.read import scene_of
    from .scene.schema import Scene

__all__ = [
    "Backbone",
    "CaseError",
    "ConvergenceError",
    "Curves",
    "Identified",
    "MicroslipError",
    "ResourceError",
    "Response",
    "Scene",
    "Search",
    "Structure",
    "SweepTable",
    "WearHistory",
    "backbone",
    "build",
    "identify",
    "peaks",
    "read",
    "read_results",
    "respond",
    "scene_of",
    "search",
    "sweep",
    "wear",
]

_FROM = {
    "CaseError": ".messages.errors",
    "ConvergenceError": ".messages.errors",
    "MicroslipError": ".messages.errors",
    "ResourceError": ".messages.errors",
    "Backbone": ".library.backbone",
    "Curves": ".library.response",
    "Response": ".library.response",
    "Scene": ".scene.schema",
    "Search": ".library.search",
    "Structure": ".library.build",
    "SweepTable": ".library.sweep",
    "backbone": ".library.backbone",
    "build": ".library.build",
    "Identified": ".library.identify",
    "identify": ".library.identify",
    "peaks": ".library.peak_curves",
    "read": ".scene.read:read_scene",
    "read_results": ".results.read",
    "respond": ".library.respond",
    "scene_of": ".scene.read",
    "search": ".library.search",
    "sweep": ".library.sweep",
    "WearHistory": ".results.wear",
    "wear": ".library.worn_joints",
}


def __getattr__(name: str) -> Any:
    """Import a name when it is first used; modules that need PETSc start it before."""
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, original = _FROM[name].partition(":")
    if module.startswith(".library"):
        import_module(".parallel.petsc", __name__).initialise()
        import_module(".system.blas", __name__).warn_of_slow_kernels()
    return getattr(import_module(module, __name__), original or name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
