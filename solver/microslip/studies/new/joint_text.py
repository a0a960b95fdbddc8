"""Joints, ties and bolts of a first scene as text, with unknown values as comments to be filled in."""

import json

import numpy as np

from ...formats.model import Finding
from ...mesh.data import Mesh
from ...scene.toml_text import value_text
from ...tables.joint import Joint
from ...tables.structure import Surface
from ...tables.units import UNITS
from .bolts import Shank
from .candidate import Candidate
from .first import First

_STRESS = 5e8  # Pa, stress of a tightened shank, roughly of a bolt of class 8.8
_QUESTIONS = {
    "friction": "#> friction = 0.3               # dry steel on steel: 0.1 to 0.6",
    "tangential_stiffness": "#> tangential_stiffness = 1e13  # N/m3: 1e12 to 1e14 of metals; a layer of steel as thick as 80e9 / "
    "this, in m",
    "normal_stiffness": "#> normal_stiffness = 1.5e13    # N/m3: equal, or up to twice",
}


def quoted(text: str) -> str:
    """Return a text in TOML syntax.  Local."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def key_line(key: str, value: str, comment: str = "") -> str:
    """Return a line with a key and a trailing comment.  Local."""
    stated = f"{key} = {value}"
    return f"{stated:31} # {comment}" if comment else stated


def joint_text(candidate: Candidate, first: First) -> str:
    """Return a joint with its values as comments, after its surfaces; a tie if the file ties them."""
    for finding in first.file.findings:
        if finding.is_glued and frozenset(finding.surfaces) == frozenset(candidate.surfaces):
            return _tie(candidate, finding)
    lines = [_surface(surface) for surface in candidate.made]
    preload = (
        key_line("preload", '"static"', "computed by [statics]")
        if first.states_bolts or first.loads_at_rest
        else "#> preload = 1e6                # Pa at rest: 1e5 to 1e8; bolts: force / area"
    )
    if candidate.is_distant:
        preload = key_line("gap", '"geometry"', "from the mesh")
    note = f"# {candidate.text}"
    lines += [
        note,
        "[[joints]]",
        key_line("name", quoted(candidate.name)),
        key_line("surfaces", f"[{', '.join(map(quoted, candidate.surfaces))}]"),
        *_contact(candidate, first),
        preload,
        "",
    ]
    return "\n".join(lines)


def _contact(candidate: Candidate, first: First) -> list[str]:
    """Return friction and stiffnesses of a joint from the file; missing ones as comments."""
    known = first.file.joints if first.scale is None else ()
    of_file = next((joint for joint in known if _is_part(candidate, joint, first.mesh)), Joint.of_file())
    stated = of_file.in_si(UNITS[first.units or "m-kg-s"])
    lines = []
    for key, question in _QUESTIONS.items():
        lines.append(key_line(key, repr(stated[key]), "as in the file") if stated.get(key) else question)
    return lines


def _is_part(candidate: Candidate, joint: Joint, mesh: Mesh) -> bool:
    """Return whether a candidate has the surfaces of a joint of the file, or lies on them."""
    surfaces = joint.surfaces or ()
    if frozenset(surfaces) == frozenset(candidate.surfaces):
        return True
    groups = [mesh.node_groups.get(name) for name in surfaces]
    return any(
        all(nodes is not None and np.isin(side, nodes).all() for side, nodes in zip(candidate.nodes, order, strict=True))
        for order in (groups, groups[::-1])
        if len(groups) == len(candidate.nodes)
    )


def _tie(candidate: Candidate, finding: Finding) -> str:
    """Return a tie, with a comment on the joint that would replace it."""
    lines = [
        f"# {candidate.text}; bonded in the file",
        "# if they may slip: [[joints]] with friction, two stiffnesses and a preload instead of [[ties]]",
        "[[ties]]",
        key_line("surfaces", f"[{', '.join(map(quoted, finding.surfaces))}]"),
        "",
    ]
    return "\n".join(lines)


def glued_text(candidate: Candidate) -> str:
    """Return a tie of a bolt, nut or washer with the clamped part."""
    lines = [_surface(surface) for surface in candidate.made]
    lines += [
        f"# {candidate.text}",
        "# a bolt, nut or washer: tied; if it may slip, [[joints]] instead of [[ties]]",
        "[[ties]]",
        key_line("surfaces", f"[{', '.join(map(quoted, candidate.surfaces))}]"),
        "",
    ]
    return "\n".join(lines)


def distant_text(candidate: Candidate, first: First) -> str:
    """Return a joint of surfaces with a gap, as comments."""
    lines = [_surface(surface) for surface in candidate.made]
    lines += [
        "[[joints]]",
        key_line("name", quoted(candidate.name)),
        key_line("surfaces", f"[{', '.join(map(quoted, candidate.surfaces))}]"),
        key_line("gap", '"geometry"', f"{candidate.gap:.3g} m"),
        *(line.removeprefix("#> ") for line in _contact(candidate, first)),
    ]
    heading = f"# With a gap: {candidate.text}; if they may close, remove '#| '"
    return "\n".join([heading, *(f"#| {line}" for line in "\n".join(lines).splitlines() if line), ""])


def _surface(surface: Surface) -> str:
    lines = [
        "[[surfaces]]",
        key_line("name", quoted(surface.name)),
        key_line("bodies", f"[{', '.join(map(quoted, surface.bodies))}]", "faces of the first that lie on the second"),
    ]
    if surface.normal is not None:
        lines.append(key_line("normal", f"[{', '.join(map(repr, surface.normal))}]", "normals of the first"))
    if surface.tolerance is not None:
        lines.append(key_line("tolerance", f"{surface.tolerance:g}", "m, between them"))
    return "\n".join([*lines, ""])


def bolt_text(shank: Shank, number: int, first: First) -> list[str]:
    """Return the cut of a bolt, if the file has none, and its tightening force."""
    group, lines = shank.group, [f"# a bolt: {shank.body}, shank of {2e3 * shank.radius:.3g} mm"]
    if group is None:
        group = f"cut {number}"
        while group in first.mesh.node_groups:
            group += " of new"
        lines += [
            "[[surfaces]]",
            key_line("name", quoted(group), "the faces inside the shank along a plane"),
            key_line("bodies", f"[{quoted(shank.body)}, {quoted(shank.body)}]"),
            key_line("through", value_text(tuple(map(float, shank.position))), "m"),
            key_line("normal", value_text(shank.direction)),
        ]
    area = np.pi * shank.radius**2
    force = f"{_STRESS * area:.1g}".replace("e+0", "e")
    comment = f"N, of the tightened bolt: here {float(force) / area / 1e6:.3g} MPa"
    return [*lines, "[[statics.bolts]]", key_line("group", quoted(group)), f"{f'#> force = {force}':31} # {comment}", ""]
