"""The data of a first scene."""

from dataclasses import dataclass

from ...formats.model import FileModel, FileStep, Finding, LoadsAtRest
from ...mesh.data import Mesh
from ...messages.words import counted
from ...tables.structure import Material, Support
from ...tables.structure_tables import StructureTables
from .bolts import Shank
from .candidate import Candidate
from .places import Place
from .sectors import Sector

MOST_DISTANT = 10  # joints of surfaces with a gap, as comments


@dataclass(frozen=True, kw_only=True)
class First:
    """The data of a first scene."""

    model: str  # path of the model file, from the folder of the scene
    units: str | None  # units of the file; None: irrelevant
    scale: float | None  # m per unit of length of a file without units; None: metres
    mesh: Mesh
    file: FileModel
    settings: StructureTables
    candidates: list[Candidate]
    shanks: list[Shank]  # bolts that the file does not cut
    left_out: list[Support]  # supports of the file that fix both sides of a joint, removed from ``file``
    fixed: list[str]  # groups
    may_be_fixed: list[str]
    disconnected: list[str]  # lines on parts that nothing connects to the others
    place: Place
    sector: Sector | None  # of a disc
    names_step: bool = False  # whether the scene names the step, a *STATIC whose loads act at rest

    @property
    def joints(self) -> list[Candidate]:
        """The candidates used as joints."""
        return [
            candidate
            for candidate in self.candidates
            if candidate.in_contact_in_file or (candidate.is_likely and not candidate.is_distant and not candidate.is_of_bolt)
        ]

    @property
    def glued(self) -> list[Candidate]:
        """The tied candidates: bolts, nuts and washers on the clamped parts."""
        return [
            candidate
            for candidate in self.candidates
            if candidate.is_likely and not candidate.is_distant and candidate.is_of_bolt
        ]

    @property
    def distant(self) -> list[Candidate]:
        """The candidates with a gap, which become joints in comments."""
        return [
            candidate
            for candidate in self.candidates
            if candidate.is_distant and candidate.is_likely and not (candidate.is_of_bolt or candidate.in_contact_in_file)
        ][:MOST_DISTANT]

    @property
    def others(self) -> list[Candidate]:
        """All other candidates."""
        return [candidate for candidate in self.candidates if candidate not in (*self.joints, *self.glued)]

    @property
    def step(self) -> FileStep | None:
        """The step whose conditions are used; None: the file has no steps."""
        return next((step for step in self.file.steps if step.number == self.file.step), None)

    @property
    def loads_left_out(self) -> str:
        """The loads of the step that are not taken over, as text; "" without loads."""
        if self.step is None or "loads" in self.step.taken:
            return ""
        return self.step.states.get("loads", "")

    @property
    def needs_loads(self) -> bool:
        """Whether only the loads of the *STATIC step may close the gap between surfaces that the file has in contact."""
        is_static = self.step is not None and self.step.procedure.startswith("*STATIC")
        return is_static and bool(self.loads_left_out) and any(joint.in_contact_in_file for joint in self.joints)

    @property
    def lacking(self) -> dict[str, list[str]]:
        """The names of the file's materials that lack constants, and these."""
        used = dict.fromkeys(body.material for body in self.file.bodies.values())
        lacking = {name: self.file.materials.get(name, Material.of_file()).lacking for name in used}
        return {name: keys for name, keys in lacking.items() if keys}

    @property
    def open_findings(self) -> list[Finding]:
        """The findings that change the answer and that the scene does not resolve."""
        joined = [frozenset(joint.surfaces) for joint in (*self.joints, *self.glued)]
        answered = set() if self.loads_at_rest is None else {self.loads_at_rest.word, self.loads_at_rest.large}
        return [
            finding
            for finding in self.file.findings
            if finding.changes
            and not (finding.surfaces and frozenset(finding.surfaces) in joined)
            and not (finding.part == "cyclic" and self.sector is not None)
            and not (finding.part == "statics" and (self.states_bolts or finding.word in answered))
        ]

    @property
    def loads_at_rest(self) -> LoadsAtRest | None:
        """The loads that the scene takes over as [statics], if there are more than bolts."""
        statics = self.file.statics
        more = statics is not None and set(statics.kinds) - {counted(len(statics.table.bolts), "bolt")}
        return statics if more else None

    @property
    def states_bolts(self) -> bool:
        """Whether the scene has [[statics.bolts]]."""
        return bool(self.file.bolts or self.shanks) and self.loads_at_rest is None
