"""The compiled kernels; everything else about the package is in pyproject.toml."""

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


kernels = [kernel("contact", "elastic_coulomb"), kernel("receptance", "row_products", "row_products_of.h")]
setup(ext_modules=cythonize(kernels, language_level=3))
