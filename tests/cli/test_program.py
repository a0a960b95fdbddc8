"""The program as started by a user: one message on any number of ranks, the documented status, no traceback, no hang."""

import importlib.util

from lap_scene import SCENE, write_mesh
from processes import microslip
from scene_files import write_scene

import microslip as package
from microslip.program import doctor


def test_the_program_prints_its_version():
    done = microslip("--version")
    assert (done.returncode, done.stdout) == (0, f"microslip {package.__version__}\n")


def test_two_ranks_report_a_fault_once(tmp_path):
    write_scene(tmp_path, "friction =", "friktion =")
    done = microslip("run", "fan.toml", ranks=2, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    expected = 'microslip: error: fan.toml: [[joints]] 1 ("dovetail") friktion: unknown key; nearest is "friction"\n'
    assert done.stderr.count(expected) == 1 and done.stderr.count("error") == 1 and "Traceback" not in done.stderr
    assert not (tmp_path / "results").exists()


def test_a_run_writes_its_results_and_reports_an_unused_option(tmp_path, program, monkeypatch):
    write_mesh(tmp_path / "lap.msh")
    short = SCENE.replace("[10.0, 1000.0]", "[80.0, 110.0]").replace("[1.0]", "[0.3]").replace("points = 20", "points = 5")
    (tmp_path / "lap.toml").write_text(short)
    options = ("-static_mat_mumps_icntl_14", "30", "-hb_snes_max_it", "15", "-hb_snes_maxit", "15")
    done = microslip("run", "lap.toml", "--", *options, ranks=2, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(
        "microslip: error: -hb_snes_maxit: no solver of this run reads this PETSc option; the results in results/lap "
        "were made without it\n"
    )
    assert done.stderr.count("microslip: error: ") == 1
    file = "results/lap/results.h5"
    written = {path.name for path in (tmp_path / file).parent.iterdir()}
    assert {"frf.csv", "results.h5", "run.log", "response.png"} <= written
    monkeypatch.chdir(tmp_path)
    status, out, err = program("convert", file, "--out", "others")
    assert (status, err) == (0, "")
    others = {path.name for path in (tmp_path / "others").iterdir()}
    assert others == set(out.replace("others/", "").split()) >= {"results.unv", "results.mat", "motion_0000.vtkhdf"}
    status, _, messages = program("report", file, "--out", "page")
    if importlib.util.find_spec("plotly") is None:
        assert status == 2 and messages.count("microslip: error: report needs plotly") == 1
    else:
        assert status == 0 and (tmp_path / "page" / "report.html").stat().st_size < 10e6


def test_check_reports_that_modes_are_chosen_by_the_accuracy(tmp_path, program):
    write_mesh(tmp_path / "lap.msh")
    (tmp_path / "lap.toml").write_text(SCENE.replace("modes = 5", "accuracy = 1e-2"))
    status, out, _ = program("check", tmp_path / "lap.toml")
    assert status == 0 and "modes      number chosen at run time for [solver] accuracy = 0.01\n" in out


def test_the_doctor_reports_no_fault_on_this_machine():
    done = microslip("doctor")
    assert done.returncode == 0
    assert all(part.name in done.stdout for part in doctor.PARTS)
    assert done.stdout.endswith("nothing is missing\n")


def test_the_doctor_reports_the_interface_to_mumps(monkeypatch):
    """A missing bridge is no fault; a wrong value of the variable is one."""
    monkeypatch.delenv("MICROSLIP_MUMPS", raising=False)
    assert any(line.startswith("  mumps") and "through the program's bridge" in line for line in doctor.examine()[0])
    with monkeypatch.context() as patch:
        patch.setitem(__import__("sys").modules, "microslip.linear._mumps", None)
        lines, is_well = doctor.examine()
    assert is_well and any("through PETSc's interface (microslip was installed without MUMPS' headers" in line for line in lines)
    monkeypatch.setenv("MICROSLIP_MUMPS", "none")
    assert "MICROSLIP_MUMPS=none" in doctor.faults("mumps")


def test_the_doctor_names_a_missing_package_and_its_installation(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    lines, is_well = doctor.examine()
    assert not is_well
    assert any("h5py" in line and "missing" in line and "apt-get install python3-h5py-mpi" in line for line in lines)
    assert "h5py: missing" in doctor.faults()


def test_a_partially_installed_package_is_reported(monkeypatch):
    modules = __import__("sys").modules
    monkeypatch.setitem(modules, "h5py", type(modules[__name__])("h5py"))
    assert "h5py: only a part of it is installed: sudo apt-get install python3-h5py-mpi python3-h5py" in doctor.faults("h5py")


def test_the_doctor_names_a_package_built_for_another_numpy(monkeypatch):
    """Compiled packages raise a ValueError with another NumPy than theirs."""

    def refuse():
        raise ValueError("numpy.dtype size changed, may indicate binary incompatibility")

    monkeypatch.setattr(doctor, "PARTS", (doctor.Part("petsc4py", refuse, "sudo apt-get install python3-petsc4py"),))
    lines, is_well = doctor.examine()
    assert not is_well
    assert "petsc4py: it does not match the installed packages (numpy.dtype size changed" in doctor.faults("petsc4py")


def test_the_doctor_notes_formats_that_are_not_read(monkeypatch):
    find_spec = doctor.importlib.util.find_spec
    monkeypatch.setattr(
        doctor.importlib.util, "find_spec", lambda name, *more: None if name == "pyNastran" else find_spec(name, *more)
    )
    lines, is_well = doctor.examine()
    assert is_well and any("without pyNastran Nastran's files are not read: " in line for line in lines)


def test_petsc_with_complex_numbers_is_rejected(monkeypatch):
    monkeypatch.setattr(doctor, "_is_real", lambda PETSc: False)
    assert "petsc4py: built with complex numbers, real ones are needed: sudo apt-get" in doctor.faults("petsc4py")
