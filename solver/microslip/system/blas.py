"""OpenBLAS' kernels for this processor.

A release of OpenBLAS that is older than the processor does not recognise it, and falls back to kernels of 2004, with a fifth of
the speed.  The processor states which vectors it has, and OPENBLAS_CORETYPE selects the kernels when the library is loaded.
"""

import os
import re
import warnings
from contextlib import suppress
from functools import cache

_PROCESSOR = "/proc/cpuinfo"  # of Linux
_AVX2 = {"avx2", "fma"}
_AVX512 = _AVX2 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}
_OF_AVX512, _OF_AVX2 = ("SkylakeX", "Cooperlake", "SapphireRapids"), ("Haswell", "Zen", "Excavator")
_WITHOUT_AVX = ("Prescott", "Core2", "Penryn", "Dunnington", "Nehalem", "Atom", "Nano", "Opteron", "Barcelona", "Bobcat")

# of a system's library, and of the libraries in packages of NumPy and SciPy
_NAMES = [prefix + "openblas_get_corename" + suffix for prefix in ("", "scipy_") for suffix in ("", "64_")]


def name_kernels() -> None:
    """Set OPENBLAS_CORETYPE, unless it is set, for libraries that are loaded from now on.  Local.

    A setting with vectors that this processor lacks is replaced: batch systems pass the environment of other machines on.
    """
    processor, given = _first_processor(), os.environ.get("OPENBLAS_CORETYPE", "")
    if not processor:
        return
    kernels = kernels_of(processor)
    if given in _OF_AVX512 and kernels != "SkylakeX" or given in _OF_AVX2 and not kernels:
        del os.environ["OPENBLAS_CORETYPE"]
    if kernels:
        os.environ.setdefault("OPENBLAS_CORETYPE", kernels)


def kernels_of(processor: str) -> str:
    """Return OpenBLAS' name of the kernels for an x86 processor, from its lines of /proc/cpuinfo; "" without AVX2.  Local.

    In double precision they are as fast as those that OpenBLAS selects on processors that it recognises.
    """
    line = re.search(r"^flags\s*:(.*)$", processor, re.MULTILINE)
    flags = set(line[1].split()) if line else set()
    if flags >= _AVX512:
        return "SkylakeX"
    if flags >= _AVX2:
        return "Zen" if "AuthenticAMD" in processor else "Haswell"
    return ""


def fault(libraries: str) -> str:
    """Return what is slow and the remedy, where OpenBLAS' kernels are older than the processor's vectors, otherwise "".  Local.

    ``libraries`` are the files that this process has loaded, as text.
    """
    import ctypes

    wanted = kernels_of(_first_processor())
    for file in sorted(set(re.findall(r"/.*openblas.*\.so\S*", libraries))) if wanted else ():
        with suppress(OSError):  # another file of that name
            library = ctypes.CDLL(file)
            of_library = next((getattr(library, name) for name in _NAMES if hasattr(library, name)), None)
            if of_library is None:
                continue
            of_library.restype = ctypes.c_char_p
            name = (of_library() or b"").decode(errors="replace")
            if name.startswith(_WITHOUT_AVX):
                return (
                    f"OpenBLAS uses its kernels for {name}, several times slower than this processor allows: "
                    f"set OPENBLAS_CORETYPE={wanted} in the environment, or import microslip before NumPy"
                )
    return ""


@cache
def warn_of_slow_kernels() -> None:
    """Warn the caller of the library, once, on the first rank: NumPy was loaded before, or the setting is wrong."""
    from .start import launcher_rank
    from .versions import loaded_libraries

    if launcher_rank() == 0 and (slow := fault(loaded_libraries())):
        warnings.warn(slow, stacklevel=3)


def _first_processor() -> str:
    """Return the lines of the first processor in /proc/cpuinfo; "" on other systems.  Local."""
    lines = []
    try:
        with open(_PROCESSOR, encoding="utf-8", errors="replace") as file:
            for line in file:
                if not line.strip():
                    break
                lines.append(line)
    except OSError:
        return ""
    return "".join(lines)
