"""The text of a first scene: what the file tells is stated, what nobody knows yet stands there as a comment to be filled in."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass

from ...formats.model import FileModel, FileStep, Finding, LoadsAtRest
from ...mesh.data import Mesh
from ...scene.toml_text import key_text, value_text
from ...tables.joint import Joint
from ...tables.structure import TAKEN, Material, Support, Surface
from ...tables.structure_tables import StructureTables
from ...tables.units import UNITS
from .candidates import Candidate
from .places import Place

MOST = 20  # further candidates, as comments


@dataclass(frozen=True, kw_only=True)
class First:
    """What is known of a first scene."""

    model: str  # path of the model file, from the folder of the scene
    units: str | None  # of the file; None: it has none that matter
    scale: float | None  # m per unit of a file without units; None: metres
    mesh: Mesh
    file: FileModel
    settings: StructureTables
    candidates: list[Candidate]
    left_out: list[Support]  # supports of the file that fix both sides of a joint; ``file`` is without them
    held: list[str]  # groups
    may_be_held: list[str]
    place: Place

    @property
    def joints(self) -> list[Candidate]:
        """The candidates that the scene takes for joints."""
        return [candidate for candidate in self.candidates if candidate.is_likely and not candidate.is_apart]

    @property
    def step(self) -> FileStep | None:
        """The step whose conditions are taken; None: the file has no steps."""
        return next((step for step in self.file.steps if step.number == self.file.step), None)

    @property
    def open_findings(self) -> list[Finding]:
        """What of the file changes the answer and is not answered by the scene."""
        joined = [frozenset(joint.surfaces) for joint in self.joints]
        answered = set() if self.loads_at_rest is None else {self.loads_at_rest.word, self.loads_at_rest.large}
        return [
            finding
            for finding in self.file.findings
            if finding.changes
            and not (finding.surfaces and frozenset(finding.surfaces) in joined)
            and not (finding.part == "statics" and (self.states_bolts or finding.word in answered))
        ]

    @property
    def loads_at_rest(self) -> LoadsAtRest | None:
        """What the scene takes over as [statics], without a word: more than bolts."""
        statics = self.file.statics
        more = statics is not None and set(statics.kinds) - {f"{len(statics.table.bolts)} bolts"}
        return statics if more else None

    @property
    def states_bolts(self) -> bool:
        """Whether the scene has [[statics.bolts]] of its own."""
        return bool(self.file.bolts) and self.loads_at_rest is None


def text_of(first: First) -> str:
    """Return the text of the scene.  Local."""
    parts = [
        _model(first),
        _materials(first),
        _bodies(first),
        _supports(first),
        *(_joint(joint, first) for joint in first.joints),
        _further(first),
        _statics(first),
        _loads(first),
        _rest(),
    ]
    return "\n".join(part for part in parts if part)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _line(key: str, value: str, comment: str = "") -> str:
    stated = f"{key} = {value}"
    return f"{stated:31} # {comment}" if comment else stated


def _model(first: First) -> str:
    lines = [
        f"# A first scene for {first.model}, by microslip new; docs/guide.md says what each key means. Units are SI here.",
        "# Fill in what begins with #>, then: microslip check, microslip run.",
        f"title = {_quoted(f'{first.model}, first mode')}",
        "",
        "[model]",
        _line("mesh", _quoted(first.model)),
    ]
    if first.units is not None:
        lines.append(_line("units", _quoted(first.units), "of the file: as its materials and its size suggest"))
    if first.scale is not None:
        size = first.mesh.diagonal
        lines.append(
            _line("scale", f"{first.scale:g}", f"m a unit of the mesh, which then measures {size:.4g} m across: is it so?")
        )
    lines += _step(first)
    if first.left_out:
        lines.append(_line("take", f"[{', '.join(_quoted(part) for part in TAKEN if part != 'supports')}]", "supports below"))
    open_findings = first.open_findings
    if open_findings:
        lines.append("# The file holds what would change the answer and is not taken over. State what it means, or waive it:")
        lines += [f"#   {finding.where}: {finding.word}: {finding.effect}" for finding in open_findings[:MOST]]
        words = list(dict.fromkeys(finding.word for finding in open_findings))
        lines.append(f"#> ignore = [{', '.join(map(_quoted, words))}]")
    return "\n".join([*lines, ""])


def _step(first: First) -> list[str]:
    """Return the keys that say which step is taken, and what is left out of it."""
    if first.step is None:
        return []
    lines = [f"# Supports, loads and temperatures are those of step {first.step.number} of the file, {first.step.procedure}."]
    others = [f"{step.number} {step.procedure}" for step in first.file.steps if step.number and step is not first.step]
    if others:
        lines.append(f"# step = ... takes those of another: {'; '.join(others[:MOST])}")
    return [*lines, _line("step", str(first.step.number))] if others else lines


def _materials(first: First) -> str:
    file, lacking = first.file, []
    for name in dict.fromkeys(body.material for body in file.bodies.values()):
        material = file.materials.get(name)
        if material is None or material.lacking:
            lacking.append(name)
    if not file.bodies:
        lacking = ["steel"]
    lines = []
    units = UNITS[first.units or "m-kg-s"]
    for name in lacking:
        lines.append(f"[materials.{key_text(name)}]")
        material = file.materials.get(name, Material.of_file())
        known = material.in_si(units)
        for key in ("young", "poisson", "shear", "elasticity", "density", "expansion"):
            if key in material.lacking:
                lines.append(_line(key, _STEEL[key][0], f"{_STEEL[key][1]}: steel's; the file does not state it"))
            elif key in known:
                lines.append(_line(key, value_text(known[key]), "as in the file"))
        lines.append("")
    if file.bodies and not lacking:
        names = ", ".join(dict.fromkeys(body.material for body in file.bodies.values()))
        lines = [f"# materials ({names}) and {len(file.bodies)} bodies come from the file", ""]
    return "\n".join(lines)


def _bodies(first: First) -> str:
    if first.file.bodies:
        return ""
    lines = []
    for name, body in first.settings.bodies.items():
        lines += [f"[bodies.{key_text(name)}]", _line("group", _quoted(body.group)), _line("material", '"steel"'), ""]
    return "\n".join(lines)


def named(supports: Iterable[Support]) -> str:
    """Return supports with what they fix, in a line.  Local."""
    return ", ".join(f"{support.group or support.point} ({''.join(support.fix)})" for support in supports)


def _supports_left_out(first: First) -> list[str]:
    """Return why the scene takes supports from the file one by one, and those that stay."""
    lines = [f"# Left out, because they fix both sides of a joint, whose pairs would never move: {named(first.left_out)}."]
    if first.file.equations is not None and first.file.equations.n_supports:
        lines.append(f"# With them, {first.file.equations.n_supports} supports in turned axes: state those that are needed.")
    for support in first.file.supports:
        place = ("group", support.group) if support.point is None else ("point", support.point)
        lines += [
            "[[supports]]",
            _line(place[0], _quoted(place[1] or ""), "as in the file"),
            _line("fix", value_text(support.fix)),
            "",
        ]
    return lines if first.file.supports else [*lines, ""]


def _supports(first: First) -> str:
    file, lines = first.file, _supports_left_out(first) if first.left_out else []
    if file.supports:
        return "\n".join(lines) if lines else f"# held by the file: {named(file.supports[:5])}\n"
    lines += [
        line
        for name in first.held
        for line in ("[[supports]]", _line("group", _quoted(name), "by its name; is it held?"), _FIX, "")
    ]
    if not first.held and not any(point.stiffness for point in file.connected):
        names = ", ".join(first.may_be_held[:MOST]) or "none; name one in the program that wrote the file"
        lines += [
            "# Nothing in the file says what is held. Groups that may be: " + names,
            "#> [[supports]]",
            f"#> group = {_quoted(first.may_be_held[0] if first.may_be_held else 'NAME')}",
            f"#> {_FIX}",
            "",
        ]
    return "\n".join(lines)


_STEEL = {"young": ("2.1e11", "Pa"), "poisson": ("0.3", "-"), "density": ("7850.0", "kg/m3")}
_FIX = 'fix = ["x", "y", "z"]'


def _joint(candidate: Candidate, first: First) -> str:
    """Return a joint with its numbers as comments, after the surfaces that it needs; a tie where the file glues them."""
    for finding in first.file.findings:
        if finding.is_glued and frozenset(finding.surfaces) == frozenset(candidate.surfaces):
            return _tie(candidate, finding)
    lines = [_surface(surface) for surface in candidate.made]
    preload = (
        _line("preload", '"static"', "what [statics] finds")
        if first.states_bolts or first.loads_at_rest
        else "#> preload = 1e6                # Pa at rest: 1e5 to 1e8; bolts: force / area"
    )
    note = f"# {candidate.text}"
    lines += [
        note,
        "[[joints]]",
        _line("name", _quoted(candidate.name)),
        _line("surfaces", f"[{', '.join(map(_quoted, candidate.surfaces))}]"),
        *_contact(candidate, first),
        preload,
        "",
    ]
    return "\n".join(lines)


_QUESTIONS = {
    "friction": "#> friction = 0.3               # dry steel on steel: 0.1 to 0.6",
    "tangential_stiffness": "#> tangential_stiffness = 1e13  # N/m3: 1e12 to 1e14 of metals; a layer of steel as thick as 80e9 / "
    "this, in m",
    "normal_stiffness": "#> normal_stiffness = 1.5e13    # N/m3: as it, or up to twice",
}


def _contact(candidate: Candidate, first: First) -> list[str]:
    """Return friction and stiffnesses of a joint: those of the file, as comments what it does not state."""
    known = first.file.joints if first.scale is None else ()
    of_file = next(
        (joint for joint in known if frozenset(joint.surfaces or ()) == frozenset(candidate.surfaces)), Joint.of_file()
    )
    stated = of_file.in_si(UNITS[first.units or "m-kg-s"])
    lines = []
    for key, question in _QUESTIONS.items():
        lines.append(_line(key, repr(stated[key]), "as in the file") if stated.get(key) else question)
    return lines


def _tie(candidate: Candidate, finding: Finding) -> str:
    """Return a tie, with the way to a joint in its place."""
    lines = [
        f"# {candidate.text}; bonded in the file",
        "# where they may slip: [[joints]] with friction, two stiffnesses and a preload in place of [[ties]]",
        "[[ties]]",
        _line("surfaces", f"[{', '.join(map(_quoted, finding.surfaces))}]"),
        "",
    ]
    return "\n".join(lines)


def _surface(surface: Surface) -> str:
    lines = [
        "[[surfaces]]",
        _line("name", _quoted(surface.name)),
        _line("bodies", f"[{', '.join(map(_quoted, surface.bodies))}]", "faces of the first that lie on the second"),
    ]
    if surface.normal is not None:
        lines.append(_line("normal", f"[{', '.join(map(repr, surface.normal))}]", "and look there"))
    return "\n".join([*lines, ""])


def _further(first: First) -> str:
    """Return the other candidates, as comments."""
    others = [candidate for candidate in first.candidates if candidate not in first.joints]
    if not first.candidates:
        return (
            "# No surfaces of different bodies lie on each other: this scene has no joint, and its curves are linear. Surfaces\n"
            "# farther apart than a tenth of their faces' size are found with [[surfaces]] tolerance; bodies that share\n"
            "# nodes are one.\n"
        )
    if not others:
        return ""
    lines = ["# Further surfaces that lie on each other, of bodies that are joined above or tied, or with room between them:"]
    for other in others[:MOST]:
        lines.append(f"#   {other.text if not other.made else _without_names(other)}")
    if len(others) > MOST:
        lines.append(f"#   and {len(others) - MOST} more")
    if any(other.made for other in others):
        lines.append(
            '# A joint of such faces takes two tables [[surfaces]] with name = "..." and bodies = ["A", "B"], and ["B", "A"].'
        )
    return "\n".join([*lines, ""])


def _without_names(candidate: Candidate) -> str:
    """Say what a candidate is by its bodies."""
    return f"{' on '.join(candidate.made[0].bodies)}: {candidate.text.partition(': ')[2]}"


def _statics(first: First) -> str:
    lines = []
    statics, force = first.loads_at_rest, UNITS[first.units or "m-kg-s"].force
    if statics is not None:
        acting = ", ".join(statics.kinds)
        lines += [f"# the loads of step {statics.step} come from the file and become [statics]: {acting}", ""]
    for bolt in first.file.bolts if first.states_bolts else ():
        stated = "#> force = 1e4                  # N, of the tightened bolt"
        if bolt.force is not None:
            stated = _line("force", f"{abs(bolt.force) * force!r}", "N: as in the file")
        lines += ["[[statics.bolts]]", _line("group", _quoted(bolt.group)), stated, ""]
    return "\n".join(lines)


def _loads(first: First) -> str:
    place = first.place
    where = _line("point", _quoted(place.point)) if place.point is not None else _line("node", str(place.node), _at(place))
    direction = _line(
        "direction", f"[{', '.join(map(repr, place.direction))}]", "across the longest side, in both axes: either may bend first"
    )
    return "\n".join(
        [
            "# where it shakes, and where it is watched: far from what is held",
            "[[loads]]",
            where,
            direction,
            "",
            "[[outputs]]",
            _line("name", '"tip"'),
            where,
            direction,
            "",
        ]
    )


def _at(place: Place) -> str:
    return f"at ({', '.join(f'{x + 0.0:.6g}' for x in place.position)}) m"


def _rest() -> str:
    return "\n".join(
        [
            "[damping]",
            _line("ratio", "1e-3", "of critical damping, in all modes, in addition to the friction"),
            "",
            "[response]",
            _line("levels", "[0.1, 1.0]", "N: run.log says from which level on pairs slip; begin there,"),
            " " * 32 + "# go up by twos to where half of them do",
            _line("mode", "1", "the range lies around this mode ..."),
            _line("span", "[0.95, 1.02]", "... from so many times its frequency to so many"),
            "",
        ]
    )
