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
    depends = [f"{folder}/{file}" for file in (f"{name}.h", f"{name}.c", *headers)] + ["solver/microslip/system/processors.h"]
    return Extension(f"microslip.{room}._{name}", sources, depends=depends, extra_compile_args=FLAGS)


def bridge(room, name, *called):
    """Return the extension _NAME of a room, of a file in Cython and the C files that it calls; one for all processors."""
    sources = [f"solver/microslip/{room}/{file}" for file in (f"_{name}.pyx", *called)]
    depends = [f"{source[:-2]}.h" for source in sources[1:]]
    return Extension(f"microslip.{room}._{name}", sources, depends=depends, extra_compile_args=FLAGS)


def headers_of_mumps(environment, prefixes):
    """Return the folder of MUMPS' headers that the environment states, or that is found; None where there is none."""
    stated, petsc = environment.get("MUMPS_INCLUDE", ""), environment.get("PETSC_DIR", "/")
    of_petsc = [Path(petsc, arch, "include") for arch in ("", environment.get("PETSC_ARCH", ""))]
    folders = [Path(stated)] if stated else [*of_petsc, *(Path(prefix, "include") for prefix in prefixes)]
    return next((folder for folder in folders if (folder / "dmumps_c.h").is_file()), None)


def mumps(environment=os.environ, prefixes=(sys.prefix, "/usr", "/usr/local")):
    """Return the extension that calls MUMPS, in a list; an empty one, with a line on stderr, where its headers are missing.

    It finds the library beside PETSc when it runs.  Without it PETSc's interface to MUMPS takes its place.
    """
    folder = headers_of_mumps(environment, prefixes)
    if folder is None:
        print(
            "microslip is built without its bridge to MUMPS, since dmumps_c.h is missing: MUMPS is called through PETSc, without "
            "entries of the inverse, factors on disk and factors in the cache.  With it: apt-get install libmumps-headers-dev, "
            "or let MUMPS_INCLUDE name the folder of the header, and install again",
            file=sys.stderr,
        )
        return []
    return [Extension("microslip.linear._mumps", ["solver/microslip/linear/_mumps.pyx"], include_dirs=[str(folder)])]


def kernels():
    """Return all extensions."""
    return [
        kernel("contact", "elastic_coulomb"),
        bridge("contact", "return_map", "return_map.c"),
        kernel("receptance", "row_products", "row_products_of.h"),
        *(bridge(room, name) for room, name in (("assembly", "expand"), ("assembly", "rows"))),
        *mumps(),
    ]


if __name__ == "__main__":
    at_once = {"build_ext": {"parallel": os.cpu_count()}}  # the extensions, which do not depend on each other
    setup(ext_modules=cythonize(kernels(), language_level=3), options=at_once)
