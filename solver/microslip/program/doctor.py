"""Requirements of the program on its machine: installed versions, and the commands that install missing parts.

Optional modules are imported only when they are examined.
"""

import importlib
import importlib.metadata
import importlib.util
import os
import platform
import re
import shutil
import site
import sys
from collections.abc import Callable
from dataclasses import dataclass

from ..parallel.petsc import initialise, locate
from ..system import blas
from ..system.signals import unbroken
from ..system.versions import dotted, loaded_libraries, mumps_version
from ..version import __version__


class Unusable(Exception):
    """A part is installed, but not usable; ``remedy`` if installing it again does not help."""

    def __init__(self, fault: str, remedy: str = ""):
        super().__init__(fault)
        self.remedy = remedy


@dataclass(frozen=True)
class Part:
    """A requirement of the program: ``version`` raises ImportError if it is missing, Unusable if it is unusable."""

    name: str
    version: Callable[[], str]
    remedy: str
    is_plain: bool = False  # pure Python, seldom needed completely: a run only checks that it exists


def examine() -> tuple[list[str], bool]:
    """Return the lines of ``microslip doctor``, and whether nothing is missing.  Local; starts MPI and PETSc."""
    lines = [f"microslip {__version__} on Python {platform.python_version()} ({sys.executable}), {platform.platform()}"]
    is_well = True
    for part in PARTS:
        fault = _fault(part)
        lines.append(f"  {part.name:<12} {part.version()}" if fault is None else f"  {part.name:<12} {fault}")
        is_well = is_well and fault is None
        if not is_well and part.name == "numpy":  # all other parts depend on it
            break
    lines += [f"note: {note}" for note in _notes(is_well)]
    lines.append("nothing is missing" if is_well else "a part is missing: the lines above name the command that installs it")
    return lines, is_well


def faults(*names: str) -> str | None:
    """Return the missing ones among the named parts (by default all parts) as text, or None.  Local.

    NumPy comes first: with a NumPy other than the one they were built for, the other parts fail with long messages.
    """
    first = PARTS[0]
    wanted = [part for part in PARTS if part.name in names or not names and not (part.is_plain and _is_there(part))]
    if first.name == "numpy":
        with unbroken():  # NumPy's C code would print a signal that stops as a traceback, and go on
            fault = _fault(first)
        if fault is not None:
            return f"numpy: {fault}"
    lines = [f"{part.name}: {fault}" for part in wanted if (fault := _fault(part))]
    return "; ".join(lines) + "; see: microslip doctor" if lines else None


def _is_there(part: Part) -> bool:
    """Return whether the module of a part is installed, without its import.  Local."""
    return importlib.util.find_spec(part.name) is not None


def _fault(part: Part) -> str | None:
    """Return the fault of a part and its remedy, or None."""
    try:
        part.version()
    except Unusable as problem:
        return f"{problem}: {problem.remedy or part.remedy}"
    except ImportError as problem:
        missing = isinstance(problem, ModuleNotFoundError) and problem.name == part.name
        return f"missing{'' if missing else f' ({problem})'}: {part.remedy}"
    except (ValueError, AttributeError, SystemError) as problem:  # built for another NumPy or another Python
        return f"it does not match the installed packages ({problem}): {part.remedy}"
    return None


def _module(name: str) -> Callable[[], str]:
    return lambda: str(getattr(importlib.import_module(name), "__version__", "present"))


def _numpy() -> str:
    """Return NumPy's version; a NumPy from the user's folders must be one that PETSc was built for."""
    module = importlib.import_module("numpy")
    if module.__file__ is not None and (remedy := _way_around(module.__file__)):
        try:
            locate()
            importlib.import_module("petsc4py.lib").ImportPETSc()
        except ModuleNotFoundError:  # reported as missing PETSc
            pass
        except (ImportError, ValueError, AttributeError, SystemError) as problem:
            folder = os.path.dirname(module.__file__)
            fault = f"version {module.__version__} in {folder} is not the one that PETSc was built for"
            raise Unusable(fault, remedy) from problem
    return str(module.__version__)


def _way_around(file: str) -> str:
    """Return the way to start without a file of the user's packages or of PYTHONPATH; "" for other files."""
    if site.ENABLE_USER_SITE and file.startswith(site.getusersitepackages() + os.sep):
        return "start with PYTHONNOUSERSITE=1 in the environment, or pip uninstall numpy"
    of_variable = [os.path.abspath(folder) + os.sep for folder in os.environ.get("PYTHONPATH", "").split(os.pathsep) if folder]
    return "take that folder out of PYTHONPATH" if file.startswith(tuple(of_variable)) else ""


def _distribution(name: str) -> str:
    """Return the version of a package that does not state it itself."""
    importlib.import_module(name)
    return importlib.metadata.version(name)


def _pydantic() -> str:
    version = _module("pydantic")()
    if int(version.split(".")[0]) < 2:
        raise Unusable(f"version {version}, 2 or later is needed")
    return version


def _mpi() -> str:
    module = importlib.import_module("mpi4py")
    from mpi4py import MPI

    library = re.split(r"[,\n]", MPI.Get_library_version())[0].strip("\x00 ")
    return f"{module.__version__}, {library}"


def _mpirun() -> str:
    path = shutil.which("mpirun") or shutil.which("mpiexec") or shutil.which("srun")
    if path is None:
        raise ImportError("no mpirun, mpiexec or srun on the PATH")
    return path


def _petsc() -> str:
    locate()
    PETSc, _ = initialise()
    if not _is_real(PETSc):
        raise Unusable("built with complex numbers, real ones are needed")
    return f"{dotted(PETSc.Sys.getVersion())}, real, {8 * PETSc.IntType(0).nbytes}-bit indices"


def _slepc() -> str:
    locate()
    return dotted(initialise()[1].Sys.getVersion())


def _mumps() -> str:
    locate()
    PETSc, _ = initialise()
    if not PETSc.Sys.hasExternalPackage("mumps"):
        raise Unusable("this PETSc was built without it")
    why = _without_bridge()
    way = f"through PETSc's interface ({why}): no factors on disk or in the cache" if why else "through the program's bridge"
    return f"{mumps_version() or 'present'}, {way}"


def _without_bridge() -> str:
    """Return the reason why MUMPS is called through PETSc's interface, or an empty text."""
    from ..linear.bridge import missing
    from ..messages.errors import CaseError

    try:
        return missing()
    except CaseError as problem:
        raise Unusable(str(problem)) from problem


def _h5py() -> str:
    module = importlib.import_module("h5py")
    if not hasattr(module, "File"):  # Debian 13's parallel module without the package that selects it
        raise Unusable("only a part of it is installed")
    return f"{module.__version__}, HDF5 {module.version.hdf5_version}"


def _is_real(PETSc) -> bool:
    import numpy as np

    return PETSc.ScalarType == np.float64


def _kernel() -> str:
    for name in ("contact._elastic_coulomb", "contact._return_map", "receptance._row_products"):
        importlib.import_module(f"microslip.{name}")
    return "compiled"


def _notes(is_well: bool) -> list[str]:
    """Return notes on slow libraries, and on installed packages that this Python does not find."""
    lines = []
    if not is_well and os.path.exists("/etc/debian_version") and sys.base_prefix != "/usr":
        lines.append(
            "Debian's packages belong to /usr/bin/python3, and this is another Python; start from its environment: "
            "/usr/bin/python3 -m venv --system-site-packages .venv"
        )
    loaded = loaded_libraries()
    if "libblas.so" in loaded and not re.search("openblas|mkl|blis|atlas", loaded):
        lines.append("MUMPS runs on the reference BLAS, several times slower: sudo apt-get install libopenblas0-pthread")
    if slow := blas.fault(loaded):
        lines.append(slow)
    if importlib.util.find_spec("plotly") is None:
        lines.append(f"without plotly there is no `microslip report`: {_pip('plotly')}")
    for package, module, files in (
        ("mapdl-archive", "mapdl_archive", "Ansys archives"),
        ("pyNastran", "pyNastran", "Nastran's files"),
        ("pyuff", "pyuff", "response functions of universal files"),
    ):
        if importlib.util.find_spec(module) is None:
            lines.append(f"without {package} {files} are not read: {_pip(package)}")
    threads = os.environ.get("OPENBLAS_NUM_THREADS", "1")
    if threads != "1":
        lines.append(f"OPENBLAS_NUM_THREADS = {threads}: number of threads of each rank")
    return lines


def _debian(package: str) -> str:
    return f"sudo apt-get install {package}, or load your cluster's module"


def _pip(package: str) -> str:
    return f"{sys.executable} -m pip install {package}"


PARTS = (
    Part("numpy", _numpy, _debian("python3-numpy")),
    Part("scipy", _module("scipy"), _debian("python3-scipy")),
    Part("matplotlib", _module("matplotlib"), _debian("python3-matplotlib")),
    Part("pydantic", _pydantic, _pip("'pydantic>=2'")),
    Part("rich", lambda: _distribution("rich"), _pip("rich"), is_plain=True),
    Part("meshio", _module("meshio"), _pip("meshio"), is_plain=True),
    Part("pymetis", lambda: _distribution("pymetis"), _pip("pymetis")),
    Part("shapely", lambda: _distribution("shapely"), _pip("shapely")),
    Part("greenlet", lambda: _distribution("greenlet"), _pip("greenlet")),
    Part("h5py", _h5py, _debian("python3-h5py-mpi python3-h5py")),
    Part("mpi4py", _mpi, _debian("python3-mpi4py")),
    Part("mpirun", _mpirun, _debian("openmpi-bin")),
    Part("petsc4py", _petsc, _debian("python3-petsc4py-real")),
    Part("slepc4py", _slepc, _debian("python3-slepc4py-real")),
    Part("mumps", _mumps, _debian("python3-petsc4py-real")),
    Part("kernel", _kernel, "pip install . in the folder of microslip's setup.py"),
)
