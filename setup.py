"""The compiled contact kernel; everything else about the package is in pyproject.toml."""

from Cython.Build import cythonize
from setuptools import Extension, setup

SOURCES = ("_elastic_coulomb.pyx", "elastic_coulomb.c", "elastic_coulomb_v3.c", "elastic_coulomb_v4.c")

kernel = Extension(
    "microslip.contact._elastic_coulomb",
    [f"solver/microslip/contact/{name}" for name in SOURCES],
    depends=["solver/microslip/contact/elastic_coulomb.h", "solver/microslip/contact/elastic_coulomb.c"],
    # no errno and no floating-point traps: the loops over samples become vector instructions
    extra_compile_args=["-O3", "-fno-math-errno", "-fno-trapping-math"],
)

setup(ext_modules=cythonize([kernel], language_level=3))
