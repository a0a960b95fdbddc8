"""The command line: arguments are parsed, and an unknown word is an error with the nearest known word."""

from pathlib import Path

import pytest

from microslip.messages.errors import CaseError
from microslip.program.command_line import Command, parse


def of(name, file="", out=None, petsc=(), settings=(), **options):
    return Command(name, file, out, petsc, settings, options)


@pytest.mark.parametrize(
    "line, command",
    [
        ("run fan.toml", of("run", "fan.toml")),
        ("run --out here fan.toml", of("run", "fan.toml", Path("here"))),
        (
            "run fan.toml -- -hb_snes_monitor -static_mat_mumps_cntl_1 -1e-3",
            of("run", "fan.toml", None, ("-hb_snes_monitor", "-static_mat_mumps_cntl_1", "-1e-3")),
        ),
        ("run a.toml b.toml c.toml --groups 2", of("run", "a.toml", more=("b.toml", "c.toml"), groups=2)),
        (
            "run --groups=3 a.toml --out here b.toml -- -hb_snes_max_it 9",
            of("run", "a.toml", Path("here"), ("-hb_snes_max_it", "9"), more=("b.toml",), groups=3),
        ),
        ("compare fan.toml", of("compare", "fan.toml")),
        ("compare fan.toml --methods rubin,full --out here", of("compare", "fan.toml", Path("here"), methods=("rubin", "full"))),
        ("backbone fan.toml", of("backbone", "fan.toml")),
        ("wear fan.toml --fresh --out w", of("wear", "fan.toml", Path("w"), fresh=True)),
        ("identify fan.toml m.csv --fit a=1:2 --fit b=3:4", of("identify", "fan.toml", other="m.csv", fit=("a=1:2", "b=3:4"))),
        (
            "backbone fan.toml --mode 2 --farthest 30 --levels 5,10 --fresh --out b -- -hb_snes_max_it 9",
            of(
                "backbone", "fan.toml", Path("b"), ("-hb_snes_max_it", "9"), mode=2, farthest=30.0, levels=(5.0, 10.0), fresh=True
            ),
        ),
        ("search fan.toml --at 99.4", of("search", "fan.toml", frequency=99.4)),
        (
            "search fan.toml --at 99.4 --level 15 --starts 9 --continue",
            of("search", "fan.toml", frequency=99.4, level=15.0, starts=9, follow=True),
        ),
        ("verify fan.toml", of("verify", "fan.toml")),
        (
            "verify fan.toml --at 99.5,100 --levels 5 --harmonics 7 --samples 512 --steps 64 --from-rest --out v -- -hb_snes_max_it 9",
            of(
                "verify",
                "fan.toml",
                Path("v"),
                ("-hb_snes_max_it", "9"),
                at=(99.5, 100.0),
                levels=(5.0,),
                harmonics=7,
                samples=512,
                steps=64,
                from_rest=True,
            ),
        ),
        ("trade fan.toml", of("trade", "fan.toml")),
        ("export fan.toml --method rubin --recovery", of("export", "fan.toml", method="rubin", recovery=True)),
        (
            "trade fan.toml --vary modes,eps --levels 1,2.5 --meshes a.msh,b.msh --seconds 30",
            of("trade", "fan.toml", parameters=("modes", "eps"), levels=(1.0, 2.5), meshes=("a.msh", "b.msh"), seconds=30.0),
        ),
        ("check fan.toml", of("check", "fan.toml")),
        (
            "run a.toml --set solver.modes=8 b.toml --set=response.levels=[5.0]",
            of("run", "a.toml", more=("b.toml",), settings=("solver.modes=8", "response.levels=[5.0]")),
        ),
        ("check fan.toml --set title=Fan", of("check", "fan.toml", settings=("title=Fan",))),
        ("check fan.msh --out there", of("check", "fan.msh", Path("there"))),
        ("new fan.msh", of("new", "fan.msh")),
        ("new fan.msh --out fan.toml --force", of("new", "fan.msh", Path("fan.toml"), force=True)),
        ("plot results.h5 --out=there", of("plot", "results.h5", Path("there"))),
        ("report results.h5", of("report", "results.h5")),
        ("convert results.h5 --to unv,mat --steps 64", of("convert", "results.h5", to=("unv", "mat"), steps=64)),
        ("diff a.h5 b.h5", of("diff", "a.h5", other="b.h5")),
        (
            "diff a.h5 b.h5 --tolerance 1e-3 --bars --json --out there",
            of("diff", "a.h5", Path("there"), other="b.h5", tolerance=1e-3, bars=True, as_json=True),
        ),
        ("doctor", of("doctor")),
    ],
)
def test_arguments_are_parsed(line, command):
    assert parse(line.split()) == command


def test_the_folder_of_a_run_names_its_results(tmp_path):
    (tmp_path / "results.h5").touch()
    assert parse(["plot", str(tmp_path)]).file == str(tmp_path / "results.h5")
    assert parse(["diff", "a.h5", str(tmp_path)]).options["other"] == str(tmp_path / "results.h5")
    assert parse(["report", str(tmp_path.parent)]).file == str(tmp_path.parent)


@pytest.mark.parametrize(
    "line, message",
    [
        (
            "",
            "a command is missing: run, modes, backbone, search, sweep, wear, compare, verify, trade, export, identify, check, new, plot, report, convert, diff or doctor",
        ),
        (
            "rnu fan.toml",
            "unknown command 'rnu'; nearest is run; commands are run, modes, backbone, search, sweep, wear, compare, verify, trade, export, identify, check, new, plot, report, "
            "convert, diff and doctor",
        ),
        ("run", "the following arguments are required: SCENE.toml; try: microslip run --help"),
        ("run fan.toml --ou x", "unknown option --ou; nearest is --out"),
        (
            "check fan.toml other.toml",
            "'other.toml' is one argument too many; usage: microslip check [-h] [--set KEY=VALUE] [--out DIR] SCENE.toml",
        ),
        ("run fan.toml --group 2", "unknown option --group; nearest is --groups"),
        ("run fan.toml more.toml --oout x", "unknown option --oout; nearest is --out"),
        ("compare fan.toml --groups 2", "unknown option --groups"),
        ("run fan.toml --set", "argument --set: expected one argument"),
        ("plot results.h5 --set solver.modes=8", "unknown option --set"),
        ("trade fan.toml --seconds soon", "argument --seconds: 'soon' is not a number above 0"),
        ("diff a.h5 b.h5 --tolerance -1", "argument --tolerance: '-1' is not a number above 0"),
        ("diff a.h5 b.h5 -- -hb_snes_max_it 3", "diff solves nothing"),
        ("verify fan.toml --levels -1", "argument --levels: '-1' are not numbers above 0"),
        ("backbone fan.toml --farthest nan", "argument --farthest: 'nan' is not a number above 1"),
        ("trade fan.toml --vary ,", "argument --vary: ',' has no words; expected at least one"),
        ("modes fan.toml --diameters 1,,2", "argument --diameters: '1,,2' are not whole numbers"),
        ("verify fan.toml --levels 5,5", "argument --levels: '5,5' holds a number twice"),
        ("convert results.h5 --steps 5", "argument --steps: '5' is not an even number of at least 16"),
        ("convert results.h5 --too unv", "unknown option --too; nearest is --to"),
        ("run fan.toml -- -options_file x", "-options_file: not an option of this program's solvers"),
        (
            "run fan.toml -- --out x",
            "--out: not an option of this program's solvers; they begin with -static_, -modes_ or -hb_; put --out before --",
        ),
        ("run fan.toml -- -hb_", "-hb_: not an option"),
        ("run fan.toml -- x -hb_snes_monitor", "'x' after --: an option's name is missing before it"),
        ("run fan.toml -- -hb_snes_max_it 3 4", "'4' after --: an option's name is missing before it"),
    ],
)
def test_unknown_words_are_errors(line, message):
    with pytest.raises(CaseError) as error:
        parse(line.split())
    assert message in str(error.value)
