"""The compiled kernels and the bridge to MUMPS; everything else about the package is in pyproject.toml."""

import os
import sys
from pathlib import Path

from Cython.Build import cythonize
from setuptools import Extension, setup

# no errno and no floating-point traps: the loops over samples become vector instructions
FLAGS = ["-O3", "-fno-math-errno", "-fno-trapping-math"]


def kernel(room, name, *headers):
    """Return the extension _NAME of a room: its bridge, and its C file for each kind of processor."""
    folder = f"solver/microslip/{room}"
    sources = [f"{folder}/_{name}.pyx", *(f"{folder}/{name}{kind}.c" for kind in ("", "_v3", "_v4"))]
    depends = [f"{folder}/{file}" for file in (f"{name}.h", f"{name}.c", *headers)]
    return Extension(f"microslip.{room}._{name}", sources, depends=depends, extra_compile_args=FLAGS)


def bridge(room, name, *called):
    """Return the extension _NAME of a room, of a file in Cython and the C files that it calls; one for all processors."""
    sources = [f"solver/microslip/{room}/{file}" for file in (f"_{name}.pyx", *called)]
    depends = [f"{source[:-2]}.h" for source in sources[1:]]
    return Extension(f"microslip.{room}._{name}", sources, depends=depends, extra_compile_args=FLAGS)


def mumps():
    """Return the extension that calls MUMPS.  It is built with MUMPS' headers and finds the library beside PETSc when it runs."""
    stated = os.environ.get("MUMPS_INCLUDE", "")
    petsc = [Path(os.environ.get("PETSC_DIR", "/"), arch, "include") for arch in ("", os.environ.get("PETSC_ARCH", ""))]
    folders = (
        [Path(stated)] if stated else [*petsc, Path(sys.prefix, "include"), Path("/usr/include"), Path("/usr/local/include")]
    )
    found = next((folder for folder in folders if (folder / "dmumps_c.h").is_file()), None)
    if found is None:
        sys.exit("dmumps_c.h is missing: apt-get install libmumps-headers-dev, or let MUMPS_INCLUDE name the folder it is in")
    folder = "solver/microslip/linear"
    return Extension("microslip.linear._mumps", [f"{folder}/_mumps.pyx"], include_dirs=[str(found)])


kernels = [
    kernel("contact", "elastic_coulomb"),
    bridge("contact", "return_map", "return_map.c"),
    kernel("receptance", "row_products", "row_products_of.h"),
    *(bridge(room, name) for room, name in (("assembly", "expand"), ("modes", "energies"))),
    mumps(),
]
setup(ext_modules=cythonize(kernels, language_level=3))
