"""A sphere and a roller under normal and cyclic tangential load, compared with Cattaneo, Mindlin and Deresiewicz.

    python jobs/bench/tangential_loading.py [--by march response] [--case roller ...] [--rings 12 24] [--shares 0.5 0.8]

Each case is a scene: statics press the body on the base, then an alternating force on the grip loads it to shares of the friction
limit; by its response far below the first mode, or by the static equations in small steps, a slow cycle without harmonics. All
results come from the contact points: the radius of contact from the second moment of the normal forces, the tractions from
friction over area at the largest load, the loss per cycle point by point; the radius of the stick zone from the area of the
sticking points, and from their tractions, which approach the limit at its edge as the square root of the distance.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import itertools
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from microslip.parallel.petsc import initialise

initialise()

from cattaneo import MU, Case, Rings, scene_of
from slow_cycle import SlowCycle


@dataclass(frozen=True, eq=False)
class Pushed:
    """Contact points under a share of the friction limit, by response or march."""

    sticks: np.ndarray  # (n,) bool, through the whole cycle
    friction: np.ndarray  # (n, 2) N, when the load is largest
    loss: np.ndarray  # (n,) J, a cycle


@dataclass(frozen=True, eq=False)
class Contact:
    """The closed points at rest."""

    r: np.ndarray  # (n,) m
    area: np.ndarray  # (n,) m2
    N: np.ndarray  # (n,) N
    part: float  # share of the full contact

    @classmethod
    def of(cls, case: Case, pairs, N: np.ndarray, part: float) -> Contact:
        x, y = pairs.position[N > 0.0, :2].T
        return cls(np.abs(x) if case.is_roller else np.hypot(x, y), pairs.area[N > 0.0], N[N > 0.0], part)


@dataclass(frozen=True)
class OverTheory:
    """Results of a run at a share of the friction limit, over theory."""

    share: float
    n_slips: int
    stick: float  # radius of the stick zone, by the area of the points that stick
    fitted: float  # the same, by the tractions of those points
    traction: float  # mean difference of the tractions over the mean traction
    rings: float  # the same for their means over rings (or rows) of the cap
    balance: float  # friction of all points over the force
    loss: float


def at_rest(case: Case, contact: Contact) -> tuple[float, float]:
    """Return radius of contact and largest pressure over Hertz'."""
    radius = np.sqrt((4.0 if case.is_roller else 2.5) * (contact.N @ contact.r**2) / contact.N.sum())
    inner = contact.r < 0.3 * case.mesh.contact
    return radius / case.mesh.contact, contact.N[inner].sum() / (contact.area[inner] @ case.pressure(contact.r[inner]))


def over_theory(case: Case, share: float, contact: Contact, pushed: Pushed) -> OverTheory:
    """Return stick radius, tractions and loss over theory."""
    size, sticks, part = np.hypot(*pushed.friction.T), pushed.sticks, contact.part
    q, exact = size / contact.area, case.traction(contact.r, share)
    stuck = contact.area[sticks].sum() / part
    ratio = size[sticks] / (MU * contact.N[sticks])
    return OverTheory(
        share,
        np.count_nonzero(~sticks),
        (0.5 * stuck if case.is_roller else np.sqrt(stuck / np.pi)) / case.stick_radius(share),
        fitted_radius(case.mesh.contact, contact.r[sticks], ratio) / case.stick_radius(share),
        (contact.area @ np.abs(q - exact)) / (contact.area @ exact),
        np.abs(of_rings(case, contact, q - exact)).sum() / (contact.area @ exact),
        np.abs(pushed.friction.sum(axis=0)).max() / (part * share * MU * case.force),
        pushed.loss.sum() / part / case.loss(share),
    )


def of_rings(case: Case, contact: Contact, q: np.ndarray) -> np.ndarray:
    """Return the integrals [N] of q (n,) over rings as wide as those of the cap, centred on its rings of nodes."""
    return np.bincount(np.rint(contact.r / case.mesh.contact * case.mesh.rings).astype(int), contact.area * q)


def fitted_radius(a: float, r: np.ndarray, ratio: np.ndarray) -> float:
    """Return the radius of the stick zone [m] from friction over its limit at the outer sticking points.

    Cattaneo's tractions have (1 - ratio)^2 (a^2 - r^2) = c^2 - r^2, of a sphere as of a roller, whatever the force.
    """
    outer = r > 0.5 * r.max()
    return float(np.sqrt(np.mean(r[outer] ** 2 + (1.0 - ratio[outer]) ** 2 * (a**2 - r[outer] ** 2))))


def by_response(case: Case, shares, folder: Path) -> tuple[Contact, list[Pushed]]:
    """Return the points at rest and at each share, by harmonic balance."""
    scene, part = scene_of(case, shares, folder)
    with microslip.build(scene) as structure:
        pairs = structure.pairs
        levels = microslip.respond(structure, error_bars=False).results.levels
    closed = pairs.N0 > 0.0
    contacts = [
        Pushed(
            level.state[0][closed] == 0, largest_friction(pairs.law, level.du[0], case.samples)[closed], level.energy[0][closed]
        )
        for level in levels
    ]
    return Contact.of(case, pairs, np.maximum(pairs.N0, 0.0), part), contacts


def largest_friction(law, U: np.ndarray, n_samples: int) -> np.ndarray:
    """Return the friction of the points at the largest load, (n, 2) [N]: the law, step by step along their motion U."""
    harmonics, p = np.arange(1, U.shape[2] // 2 + 1), np.zeros(U.shape[:2])
    for t in np.linspace(0.0, 4.0 * np.pi, 2 * n_samples + 1):
        wave = np.concatenate([[1.0], np.stack([np.cos(harmonics * t), np.sin(harmonics * t)], axis=1).ravel()])
        du = U @ wave
        p = law.step(du, p)[0]
    return (p + law.stiffness * du)[:, :2]


def by_march(case: Case, shares, folder: Path) -> tuple[Contact, list[Pushed]]:
    """Return the points at rest and at each share, by a slow cycle."""
    scene, part = scene_of(case, shares, folder)
    cycle = SlowCycle.of(scene)
    closed = cycle.N > 0.0
    contacts = [Pushed(*(of[closed] for of in cycle.run(part * share * MU * case.force))) for share in shares]
    cycle.close()
    return Contact.of(case, cycle.pairs, cycle.N, part), contacts


def in_words(case: Case) -> str:
    """Return a text with the mesh densities of the bodies and the relation of their meshes."""
    mesh = case.mesh
    numbers = [f"{mesh.rings}", f"{mesh.base_rings}"]
    if not case.is_roller:
        numbers = [f"{n} x {angles}" for n, angles in zip(numbers, (8 * mesh.angles, 8 * mesh.base_angles))]
    how = {"points": "cells", "mortar": "mortar", "projected": "nodes projected"}[case.pairing]
    return f"{mesh.shape} | {numbers[0]} | {'the same' if numbers[0] == numbers[1] else numbers[1]} | {how}"


SIZE = {"sphere": 0.01, "roller": 0.04}  # m: the effect of the far sides falls with the cube, and with the square
BY = {"march": by_march, "response": by_response}


def draw(path: Path, case: Case, shares, contact: Contact, pushed: list[Pushed]) -> None:
    """Draw pressure and tractions of the points over those of theory."""
    figure, axes = plt.subplots(figsize=(7.0, 4.2), layout="constrained")
    a, p0 = case.mesh.contact, case.p0
    r = np.linspace(0.0, a, 1000)
    axes.plot(r / a, MU * case.pressure(r) / p0, color="0.6", label="friction limit, Hertz")
    axes.plot(contact.r / a, MU * contact.N / contact.area / p0, ".", color="0.6", ms=3)
    for k, (share, one) in enumerate(zip(shares, pushed)):
        axes.plot(r / a, case.traction(r, share) / p0, color=f"C{k}", label=f"load {share:g} of the limit, Cattaneo")
        size = np.hypot(*one.friction.T) / contact.area
        axes.plot(contact.r / a, size / p0, "o", color=f"C{k}", ms=4, mfc="none", label=None if k else "contact points")
    axes.set(
        xlabel="distance from the middle / radius of contact", ylabel="traction / largest pressure", xlim=(0.0, 1.05), ylim=0.0
    )
    axes.legend(frameon=False, loc="upper right")
    figure.savefig(path, dpi=150)
    plt.close(figure)


def rows(by: str, case: Case, shares, folder: Path, picture: Path | None) -> str:
    """Return the rows of a case, one for each share of the limit; draw it where a file is given."""
    start = time.perf_counter()
    contact, pushed = BY[by](case, shares, folder)
    seconds, (radius, p0) = time.perf_counter() - start, at_rest(case, contact)
    if picture is not None:
        draw(picture, case, shares, contact, pushed)
    ratios = [over_theory(case, share, contact, one) for share, one in zip(shares, pushed)]
    return "\n".join(
        f"| {in_words(case)} | {by} | {len(contact.N)} | {radius:.3f}, {p0:.3f} | {of.share:g} | {of.n_slips} | {of.stick:.3f} "
        f"| {of.fitted:.3f} | {100.0 * of.traction:.1f} % | {100.0 * of.rings:.1f} % | {of.loss:.3f} | {seconds:.0f} s |"
        for of in ratios
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--by", nargs="+", default=["march"], choices=list(BY))
    parser.add_argument("--case", nargs="+", default=["roller", "sphere"], choices=["roller", "sphere"])
    parser.add_argument("--rings", type=int, nargs="+", default=[12, 24], help="of the cap, over the radius of contact")
    parser.add_argument("--apart", type=int, nargs="+", default=[0, 5], help="additional rings of the base, a case for each")
    parser.add_argument("--pairing", nargs="+", default=["projected", "points"], choices=["projected", "points", "mortar"])
    parser.add_argument("--shares", type=float, nargs="+", default=[0.5, 0.8], help="of the friction limit")
    parser.add_argument(
        "--stiff", type=float, default=Case.stiff, help="of the contact's springs, over Young's modulus and radius"
    )
    parser.add_argument("--size", type=float, help="of the bodies [m] (default: 0.01 for spheres, 0.04 for rollers)")
    parser.add_argument("--poisson", type=float, default=Case.poisson)
    parser.add_argument("--harmonics", type=int, default=Case.harmonics)
    parser.add_argument("--samples", type=int, default=Case.samples)
    parser.add_argument("--picture", type=Path, help="file to draw the tractions of the last case in")
    given = parser.parse_args()
    print(
        "| body | rings | base | contact points | by | closed | radius, pressure over Hertz' | share of the limit | slip "
        "| stick radius | by tractions | tractions | of rings | loss | time |\n" + "| --- " * 15 + "|"
    )
    settings = {name: getattr(given, name) for name in ("stiff", "poisson", "harmonics", "samples")}
    with tempfile.TemporaryDirectory() as folder:
        for by, shape, n, more, pairing in itertools.product(given.by, given.case, given.rings, given.apart, given.pairing):
            mesh = Rings(shape, given.size or SIZE[shape], rings=n, base_rings=n + more, base_angles=Rings.angles + (more > 0))
            print(rows(by, Case(mesh, pairing, **settings), given.shares, Path(folder), given.picture), flush=True)


if __name__ == "__main__":
    main()
