"""PETSc's record of the options that were read."""

from petsc4py import PETSc

from microslip.parallel.petsc import unused_options


def test_options_that_no_solver_reads_are_listed(comm):
    options = PETSc.Options()
    options["static_ksp_rtol"] = 1e-3
    options["static_ksp_rtoll"] = 1e-3
    given = ("-static_ksp_rtol", "1e-3", "-static_ksp_rtoll", "-1e-3")
    assert unused_options(given) == ["-static_ksp_rtol", "-static_ksp_rtoll"]
    ksp = PETSc.KSP().create(comm)
    ksp.setOptionsPrefix("static_")
    ksp.setFromOptions()
    assert unused_options(given) == ["-static_ksp_rtoll"]
    ksp.destroy()
    del options["static_ksp_rtol"], options["static_ksp_rtoll"]
