"""OpenBLAS' kernels for this processor.

A release of OpenBLAS that is older than the processor does not recognise it, and falls back to kernels of 2004, with a fifth of
the speed.  The processor states which vectors it has, and OPENBLAS_CORETYPE selects the kernels when the library is loaded.
"""

import os
import re
import warnings
from functools import cache

_PROCESSOR = "/proc/cpuinfo"  # of Linux
_AVX2 = {"avx2", "fma"}
_AVX512 = _AVX2 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}
_WITHOUT_AVX = ("Prescott", "Core2", "Penryn", "Dunnington", "Nehalem", "Atom", "Nano", "Opteron", "Barcelona", "Bobcat")


def name_kernels() -> None:
    """Set OPENBLAS_CORETYPE, unless it is set, for libraries that are loaded from now on.  Local."""
    kernels = kernels_of(_first_processor())
    if kernels:
        os.environ.setdefault("OPENBLAS_CORETYPE", kernels)


def kernels_of(processor: str) -> str:
    """Return OpenBLAS' name of the kernels for an x86 processor, from its lines of /proc/cpuinfo; "" without AVX2.  Local.

    These are the kernels that OpenBLAS selects on processors that it recognises.
    """
    flags = set(re.findall(r"^flags\s*:(.*)$", processor, re.MULTILINE)[0].split()) if "flags" in processor else set()
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

    file, wanted = re.search(r"/\S*openblas\S*\.so\S*", libraries), kernels_of(_first_processor())
    if file is None or not wanted:
        return ""
    try:
        of_library = ctypes.CDLL(file[0]).openblas_get_corename
    except (OSError, AttributeError):  # another library of that name
        return ""
    of_library.restype = ctypes.c_char_p
    name = (of_library() or b"").decode(errors="replace")
    if not name.startswith(_WITHOUT_AVX):
        return ""
    return (
        f"OpenBLAS uses its kernels for {name}, several times slower than this processor allows: set OPENBLAS_CORETYPE={wanted} "
        "in the environment, or import microslip before NumPy"
    )


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
