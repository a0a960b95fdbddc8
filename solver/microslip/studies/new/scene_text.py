"""The text of a first scene: data of the file are stated, unknown values are comments to be filled in."""

from collections.abc import Iterable
from pathlib import PurePosixPath

from ...messages.words import counted
from ...scene.toml_text import key_text, value_text
from ...tables.structure import TAKEN, Material, Support
from ...tables.units import UNITS
from .candidate import Candidate
from .first import First
from .joint_text import bolt_text, distant_text, glued_text, joint_text, key_line, quoted
from .places import Place

MOST = 20  # further candidates, as comments


def text_of(first: First) -> str:
    """Return the text of the scene.  Local."""
    parts = [
        _model(first),
        _materials(first),
        _bodies(first),
        _cyclic(first),
        _supports(first),
        *(joint_text(joint, first) for joint in first.joints),
        *(glued_text(candidate) for candidate in first.glued),
        *(distant_text(candidate, first) for candidate in first.distant),
        _further(first),
        _statics(first),
        _loads(first),
        _rest(),
    ]
    text = "\n".join(part for part in parts if part)
    missing = "Fill in what begins with #>, then" if lacks_entries(text) else "Nothing has to be filled in"
    head = f"# A first scene for {first.model}, by microslip new; docs/guide.md explains each key. Units are SI here."
    return "\n".join([head, f"# {missing}: microslip check, microslip run.", text])


def lacks_entries(text: str) -> bool:
    """Return whether lines of a scene are to be filled in.  Local."""
    return "\n#> " in text


def _model(first: First) -> str:
    lines = [
        f"title = {quoted(f'{PurePosixPath(first.model).name}, first mode')}",
        "",
        "[model]",
        key_line("mesh", quoted(first.model)),
    ]
    if first.units is not None:
        lines.append(key_line("units", quoted(first.units), "of the file: as its materials and its size suggest"))
    if first.scale is not None:
        size = first.mesh.diagonal
        lines.append(
            key_line("scale", f"{first.scale:g}", f"m per unit of the mesh, which is then {size:.4g} m across: please check")
        )
    lines += _step(first)
    if first.left_out:
        lines.append(key_line("take", f"[{', '.join(quoted(part) for part in TAKEN if part != 'supports')}]", "supports below"))
    open_findings = first.open_findings
    if open_findings:
        lines.append("# Data of the file that change the answer and are not taken over; state equivalents, or ignore them:")
        lines += [f"#   {finding.where}: {finding.word}: {finding.effect}" for finding in open_findings[:MOST]]
        words = list(dict.fromkeys(finding.word for finding in open_findings))
        lines.append(f"#> ignore = [{', '.join(map(quoted, words))}]")
    return "\n".join([*lines, ""])


def _step(first: First) -> list[str]:
    """Return the keys on the step whose conditions are used, and its omitted conditions."""
    if first.step is None:
        return []
    of_step = f"step {first.step.number} of the file, {first.step.procedure}"
    lines = [f"# Supports, loads and temperatures are those of {of_step}."]
    if first.loads_left_out:
        lines = [f"# Supports are those of {of_step}. Its loads, {first.loads_left_out}, are not taken over."]
        if first.step.procedure.startswith("*STATIC"):
            joints = ', and preload = "static" in the joints they press' if first.joints else ""
            lines.append(f"# If they act at rest: step = {first.step.number}{joints}.")
    others = [f"{step.number} {step.procedure}" for step in first.file.steps if step.number and step is not first.step]
    if others:
        lines.append(f"# step = ... selects another step: {'; '.join(others[:MOST])}")
    if first.names_step:
        return [*lines, key_line("step", str(first.step.number), "its loads act at rest and may close the gap of a joint")]
    return [*lines, key_line("step", str(first.step.number))] if others else lines


def _materials(first: First) -> str:
    file, lacking, lines = first.file, first.lacking, list[str]()
    units = UNITS[first.units or "m-kg-s"]
    for name in lacking or ([] if file.bodies else ["steel"]):
        lines.append(f"[materials.{key_text(name)}]")
        material = file.materials.get(name, Material.of_file())
        known = material.in_si(units)
        for key in ("young", "poisson", "shear", "elasticity", "density", "expansion"):
            if key in material.lacking:
                lines.append(key_line(key, _STEEL[key][0], f"{_STEEL[key][1]}: of steel; missing in the file"))
            elif key in known:
                lines.append(key_line(key, value_text(known[key]), "as in the file"))
        lines.append("")
    if file.bodies and not lacking:
        names = ", ".join(dict.fromkeys(body.material for body in file.bodies.values()))
        lines = [f"# materials ({names}) and {counted(len(file.bodies), 'body')} come from the file", ""]
    return "\n".join(lines)


def _bodies(first: First) -> str:
    if first.file.bodies:
        return ""
    lines = []
    for name, body in first.settings.bodies.items():
        lines += [f"[bodies.{key_text(name)}]", key_line("group", quoted(body.group)), key_line("material", '"steel"'), ""]
    return "\n".join(lines)


def _cyclic(first: First) -> str:
    """Return the table [cyclic], as comments if only the shapes of two faces suggest it."""
    if first.sector is None:
        return ""
    cyclic, sector = first.sector.cyclic, first.sector
    lines = [
        "[cyclic]",
        key_line("sectors", str(cyclic.sectors), "as in the file" if sector.of_file else "from the fit of the turned faces"),
        key_line("axis", value_text(cyclic.axis)),
        key_line("axis_point", value_text(cyclic.axis_point), "m"),
        key_line("faces", value_text(cyclic.faces), "[low, high] in the positive sense about the axis"),
        "#> engine_order = 1             # periods of the excitation per revolution",
    ]
    if sector.is_likely:
        return "\n".join(["# A sector of a disc, which vibrates in nodal diameters:", *lines, ""])
    heading = f"# Two faces fit by a turn of {360.0 / cyclic.sectors:.6g} degrees: if this is a sector of a disc, remove '#| '"
    return "\n".join([heading, *(f"#| {line}" for line in lines), ""])


def named(supports: Iterable[Support]) -> str:
    """Return supports with their fixed directions, on one line.  Local."""
    return ", ".join(f"{support.group or support.point} ({''.join(support.fix)})" for support in supports)


def _supports_left_out(first: First) -> list[str]:
    """Return comments on omitted supports of the file, and the remaining supports."""
    lines = [f"# Left out, because they fix both sides of a joint, whose pairs would never move: {named(first.left_out)}."]
    if first.file.equations is not None and first.file.equations.n_supports:
        lines.append(f"# With them, {first.file.equations.n_supports} supports in turned axes: state those that are needed.")
    for support in first.file.supports:
        place = ("group", support.group) if support.point is None else ("point", support.point)
        lines += [
            "[[supports]]",
            key_line(place[0], quoted(place[1] or ""), "as in the file"),
            key_line("fix", value_text(support.fix)),
            "",
        ]
    return lines if first.file.supports else [*lines, ""]


def _supports(first: First) -> str:
    file, lines = first.file, _supports_left_out(first) if first.left_out else []
    if file.supports:
        return "\n".join(lines) if lines else f"# supports of the file: {named(file.supports[:5])}\n"
    lines += [
        line
        for name in first.fixed
        for line in ("[[supports]]", key_line("group", quoted(name), "from its name; please check"), _FIX, "")
    ]
    if not first.fixed and not any(point.stiffness for point in file.connected):
        names = ", ".join(first.may_be_fixed[:MOST]) or "none; name one in the program that wrote the file"
        lines += [
            "# The file has no supports: without [[supports]] the structure is free, and mode 1 is its first elastic mode.",
            "# For supports remove '#| '; possible groups: " + names,
            "#| [[supports]]",
            f"#| group = {quoted(first.may_be_fixed[0] if first.may_be_fixed else 'NAME')}",
            f"#| {_FIX}",
            "",
        ]
    return "\n".join(lines)


_STEEL = {"young": ("2.1e11", "Pa"), "poisson": ("0.3", "-"), "density": ("7850.0", "kg/m3")}
_FIX = 'fix = ["x", "y", "z"]'


def _further(first: First) -> str:
    """Return the other candidates, as comments."""
    others = [candidate for candidate in first.others if candidate not in first.distant]
    if not first.candidates:
        return (
            "# No surfaces of different bodies lie on each other: this scene has no joint, and its curves are linear. Surfaces\n"
            "# farther apart than a tenth of their faces' size are found with [[surfaces]] tolerance; bodies that share\n"
            "# nodes are one.\n"
        )
    if not others:
        return ""
    lines = ["# Further surfaces that lie on each other, of bodies that are joined above or tied, or with a gap:"]
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
    """Return the description of a candidate with the names of its bodies."""
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
            stated = key_line("force", f"{abs(bolt.force) * force!r}", "N: as in the file")
        lines += ["[[statics.bolts]]", key_line("group", quoted(bolt.group)), stated, ""]
    for i, shank in enumerate(first.shanks if first.states_bolts else (), 1):
        lines += bolt_text(shank, i, first)
    return "\n".join(lines)


def _loads(first: First) -> str:
    place = first.place
    where = key_line("point", quoted(place.point)) if place.point is not None else key_line("node", str(place.node), _at(place))
    direction = key_line(
        "direction", f"[{', '.join(map(repr, place.direction))}]", "across the longest side, along both bending axes"
    )
    return "\n".join(
        [
            "# load and output, far from the supports",
            "[[loads]]",
            where,
            direction,
            "",
            "[[outputs]]",
            key_line("name", '"tip"'),
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
            key_line("ratio", "1e-3", "of critical damping, in all modes, in addition to the friction"),
            "",
            "[response]",
            key_line("levels", "[0.1, 1.0]", "N: run.log states the level at which slip begins; start there,"),
            " " * 32 + "# double it until half of the pairs slip",
            key_line("mode", "1", "the range lies around this mode ..."),
            key_line("span", "[0.95, 1.02]", "... from and to these multiples of its frequency"),
            "",
        ]
    )
