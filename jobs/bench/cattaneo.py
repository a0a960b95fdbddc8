"""Round bodies pressed on flat ones and pushed sideways: scenes, and the theory of Cattaneo, Mindlin and Deresiewicz."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import quad

import microslip

sys.path.insert(0, str(Path(__file__).parents[2] / "meshes"))

from hertz_rings import Rings, hertz_rings  # noqa: E402
from msh import write_msh  # noqa: E402

YOUNG, MU = 2.1e11, 0.4
SCENE = """
[model]
mesh = "pushed.msh"
[materials.steel]
young = {young}
poisson = {poisson}
density = 7850.0
[bodies.cap]
group = "cap_body"
material = "steel"
[bodies.base]
group = "base_body"
material = "steel"
{supports}
# the top moves as one and does not turn: the force acts in the plane of the contact
[[points]]
name = "grip"
position = [0.0, 0.0, {size}]
group = "top"
connection = "rigid"
[[supports]]
point = "grip"
fix = ["y", "rx", "ry", "rz"]
[[joints]]
name = "contact"
surfaces = ["cap", "flat"]
pairing = "{pairing}"
gap = "geometry"
tolerance = 0.01
friction = {friction}
tangential_stiffness = {k}
normal_stiffness = {k}
preload = "static"
[statics]
stress_stiffening = false
steps = 4
[[statics.forces]]
point = "grip"
force = [0.0, 0.0, {force}]
[[loads]]
point = "grip"
direction = [1.0, 0.0, 0.0]
[[outputs]]
name = "grip"
point = "grip"
direction = [1.0, 0.0, 0.0]
[damping]
ratio = 0.001
[response]
levels = {levels}
frequencies = [20.0, 20.2]
points = 2
[solver]
modes = 12
harmonics = {harmonics}
samples = {samples}
"""


# four cells per face share few nodes: with much stiffer springs their forces alternate in sign
STIFF = {"projected": 1000.0, "points": 200.0, "mortar": 50.0}


@dataclass(frozen=True)
class Case:
    """Body, contact sampling and mesh density of one case."""

    mesh: Rings = Rings()
    pairing: str = "points"
    poisson: float = 0.3
    stiff: float | None = None  # stiffness of the contact springs over Young's modulus and the radius of contact; None: STIFF
    harmonics: int = 9
    samples: int = 256

    @property
    def is_roller(self) -> bool:
        return self.mesh.shape == "roller"

    @property
    def modulus(self) -> float:
        """E* of two equal bodies [Pa]."""
        return 0.5 * YOUNG / (1.0 - self.poisson**2)

    @property
    def force(self) -> float:
        """The force [N] (of a roller per metre) that produces the mesh's radius of contact according to Hertz."""
        a, R = self.mesh.contact, self.mesh.radius
        return np.pi * self.modulus * a**2 / (4.0 * R) if self.is_roller else 4.0 * self.modulus * a**3 / (3.0 * R)

    @property
    def p0(self) -> float:
        """Hertz's largest pressure [Pa]."""
        a = self.mesh.contact
        return 2.0 * self.force / (np.pi * a) if self.is_roller else 1.5 * self.force / (np.pi * a**2)

    def stick_radius(self, share: float) -> float:
        """Radius of the stick zone [m] under a share of the friction limit."""
        return self.mesh.contact * (1.0 - share) ** (1 / 2 if self.is_roller else 1 / 3)

    def pressure(self, r) -> np.ndarray:
        return self.p0 * np.sqrt(np.maximum(1.0 - (r / self.mesh.contact) ** 2, 0.0))

    def traction(self, r, share: float) -> np.ndarray:
        """Return Cattaneo's tangential traction [Pa] at distances r at the largest load."""
        a, c = self.mesh.contact, self.stick_radius(share)
        return MU * (self.pressure(r) - self.p0 * c / a * np.sqrt(np.maximum(1.0 - (r / c) ** 2, 0.0)))

    def slip(self, r: float, share: float) -> float:
        """Return the relative displacement [m] at r beyond the stick zone when the load first reaches its maximum."""
        a, c = self.mesh.contact, self.stick_radius(share)
        if self.is_roller:
            return 2.0 * MU * self.p0 / (self.modulus * a) * quad(lambda t: np.sqrt(t**2 - c**2), c, r)[0]
        shear = 0.5 * YOUNG / (1.0 + self.poisson)
        k = c / r
        curve = (1.0 - 2.0 / np.pi * np.arcsin(k)) * (1.0 - 2.0 * k**2) + 2.0 / np.pi * k * np.sqrt(1.0 - k**2)
        return 3.0 * MU * self.force * (2.0 - self.poisson) / (16.0 * shear * a) * curve * (r / a) ** 2

    def loss(self, share: float) -> float:
        """Return the loss per cycle [J] (of a roller per metre): in each direction, mu p acts over twice the slip."""
        a, c = self.mesh.contact, self.stick_radius(share)
        around = (lambda r: 2.0) if self.is_roller else (lambda r: 2.0 * np.pi * r)
        return 4.0 * MU * quad(lambda r: self.pressure(r) * self.slip(r, share) * around(r), c, a)[0]


def scene_of(case: Case, shares, folder: Path):
    """Return the scene of a case, and the share of the full contact that its mesh covers."""
    bodies = hertz_rings(case.mesh)
    write_msh(str(folder / "pushed.msh"), {f"{name}_body": body for name, body in bodies.items()})
    part = float(np.ptp(bodies["cap"].points[:, 1])) if case.is_roller else 0.5
    held = {"middle_y": "y", "base_y": "y", "bottom": "xyz"}
    held |= {"end_y": "y", "base_end_y": "y"} if case.is_roller else {}
    text = SCENE.format(
        young=YOUNG,
        poisson=case.poisson,
        supports="\n".join(
            f'[[supports]]\ngroup = "{group}"\nfix = {list(axes)}'.replace("'", '"') for group, axes in held.items()
        ),
        size=case.mesh.size,
        pairing=case.pairing,
        friction=MU,
        k=(STIFF[case.pairing] if case.stiff is None else case.stiff) * YOUNG / case.mesh.contact,
        force=-part * case.force,
        levels=[part * share * MU * case.force for share in shares],
        harmonics=case.harmonics,
        samples=case.samples,
    )
    path = folder / "pushed.toml"
    path.write_text(text)
    return microslip.read(path), part
