"""OpenBLAS' kernels: selected by the vectors of the processor, before NumPy loads the library."""

import os
import subprocess
import sys

import pytest

from microslip.system import blas

AVX2 = "avx2 fma"
AVX512 = AVX2 + " avx512f avx512dq avx512cd avx512bw avx512vl"
CORE = "from microslip.system.versions import loaded_libraries; from microslip.system.blas import fault; print(fault(loaded_libraries()))"


@pytest.mark.parametrize(
    "vendor, flags, kernels",
    [
        ("GenuineIntel", AVX512, "SkylakeX"),
        ("AuthenticAMD", AVX512, "SkylakeX"),
        ("AuthenticAMD", AVX2, "Zen"),
        ("GenuineIntel", AVX2, "Haswell"),
        ("GenuineIntel", AVX2 + " avx512f", "Haswell"),
        ("GenuineIntel", "avx fma", ""),
    ],
)
def test_kernels_are_those_of_the_longest_vectors(vendor, flags, kernels):
    assert blas.kernels_of(f"processor\t: 0\nvendor_id\t: {vendor}\nflags\t\t: fpu {flags} sse2\n") == kernels


def test_other_processors_and_systems_use_the_default_of_openblas(monkeypatch, tmp_path):
    assert blas.kernels_of("processor\t: 0\nFeatures\t: fp asimd\n") == blas.kernels_of("") == ""
    monkeypatch.setattr(blas, "_PROCESSOR", str(tmp_path / "missing"))
    monkeypatch.delenv("OPENBLAS_CORETYPE", raising=False)
    blas.name_kernels()
    assert "OPENBLAS_CORETYPE" not in os.environ
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Haswell")
    blas.name_kernels()
    assert os.environ["OPENBLAS_CORETYPE"] == "Haswell", "nothing is known of a processor that would contradict it"


def test_a_setting_of_the_user_has_priority(monkeypatch):
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Nehalem")
    blas.name_kernels()
    assert os.environ["OPENBLAS_CORETYPE"] == "Nehalem"


@pytest.mark.parametrize(
    ("flags", "given", "stays"), [(AVX2, "SkylakeX", False), ("avx", "Haswell", False), (AVX512, "Haswell", True)]
)
def test_a_setting_of_another_machine_is_replaced(monkeypatch, tmp_path, flags, given, stays):
    (tmp_path / "cpuinfo").write_text(f"vendor_id\t: GenuineIntel\nflags\t\t: {flags}\n\nprocessor\t: 1\n")
    monkeypatch.setattr(blas, "_PROCESSOR", str(tmp_path / "cpuinfo"))
    monkeypatch.setenv("OPENBLAS_CORETYPE", given)
    blas.name_kernels()
    assert os.environ.get("OPENBLAS_CORETYPE") == (given if stays else blas.kernels_of(f"flags : {flags}\n") or None)


def _printed(code, **variables):
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_CORETYPE"} | variables
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120)
    return done.stdout.strip() + done.stderr


@pytest.mark.skipif(not blas.kernels_of(blas._first_processor()), reason="OpenBLAS selects its kernels by itself here")
def test_slow_kernels_are_not_selected_and_cause_a_message():
    assert _printed(f"import microslip, numpy; {CORE}") == ""
    wrong = _printed(f"import microslip, numpy; {CORE}", OPENBLAS_CORETYPE="Nehalem")
    if not wrong:
        pytest.skip("NumPy's BLAS is not OpenBLAS, or has one set of kernels")
    assert wrong.startswith("OpenBLAS uses its kernels for Nehalem, several times slower") and "OPENBLAS_CORETYPE=" in wrong
    assert "kernels for Nehalem" in _printed("import microslip; microslip.build", OPENBLAS_CORETYPE="Nehalem")
