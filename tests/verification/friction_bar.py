"""The bar on a friction foundation, meshed with solids: the micro-slip test of all stages, from mesh to energy.

    PYTHONPATH=solver:tests:meshes python tests/verification/friction_bar.py

A bar of steel with nu = 0 lies between two rigid plates, pressed together, and is pulled and pushed at its end far below its
first resonance.  By symmetry one half is modelled: the joint is its underside, the plane of symmetry its top.  Scene
file and mesh are written, and the results of all stages (pairing, areas, assembly, factor, modes, static residuals,
harmonic balance) are compared with ``oracles.exact.FrictionBar``, a bar of one dimension.  That bar has no shear lag: the solid
bar differs from it by about 2/3 (lam h)^2, 2e-5 here.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from blocks import stacked
from mpi4py import MPI
from msh import write_msh
from oracles.exact import FrictionBar
from scene_text import joint, steel, support, table
from verification import chain

LENGTH, WIDTH, HEIGHT = 0.2, 0.005, 0.0005  # m
YOUNG, DENSITY = 210e9, 7850.0  # Pa, kg/m3; nu = 0
K_T, K_N, PRELOAD, FRICTION = 1.05e10, 2.0e10, 1.0e6, 0.3  # N/m3, N/m3, Pa, -
LEVELS = (175.0, 212.5, 250.0, 287.5)  # N, between first and full slip
FREQUENCY = 8.0  # Hz; the first resonance lies near 8 kHz
EXACT = FrictionBar(EA=YOUNG * WIDTH * HEIGHT, L=LENGTH, q=FRICTION * PRELOAD * WIDTH, k=K_T * WIDTH)

MESHES = {"hex20": (8, 16, 32, 64), "hex8": (8, 16, 32, 64), "tet10": (8, 16, 32, 64)}

# consistent nodal loads of a uniform pull on a flat face: share of corners and of mid-sides, by number of nodes
PULL = {3: [1 / 3] * 3, 4: [1 / 4] * 4, 6: [0.0] * 3 + [1 / 3] * 3, 8: [-1 / 12] * 4 + [1 / 3] * 4}


def end_shares(bar) -> dict[int, float]:
    """Return the share of the pull that each node of the bar's start carries, by node number of the file."""
    shares: dict[int, float] = {}
    faces = bar.faces["bar_start"]
    n_faces = sum(map(len, faces))  # all of the same area
    for nodes in faces:
        for node, share in zip(nodes.ravel(), np.tile(PULL[nodes.shape[1]], len(nodes))):
            shares[int(node) + 1] = shares.get(int(node) + 1, 0.0) + share / n_faces
    return {node: share for node, share in sorted(shares.items()) if abs(share) > 1e-12}


def write_case(folder: Path, kind: str, cells: tuple[int, int, int], levels, harmonics: int, samples: int) -> np.ndarray:
    """Write mesh and scene into a folder; return the weights of its outputs whose sum is the end's displacement."""
    bodies = stacked(kind, (LENGTH, WIDTH, HEIGHT), cells, ground_height=HEIGHT)
    write_msh(str(folder / "bar.msh"), bodies)
    shares = end_shares(bodies["bar"])
    text = 'title = "Bar on a friction foundation"\n' + table("model", mesh="bar.msh")
    text += steel("bar", "ground", young=YOUNG, poisson=0.0, density=DENSITY) + support("ground") + support("bar_top", "z")
    text += joint("bar_bottom", "ground_top", name="foundation", friction=FRICTION, k_t=K_T, k_n=K_N, preload=PRELOAD)
    text += "".join(table("[loads]", node=node, direction=[share, 0.0, 0.0]) for node, share in shares.items())
    text += "".join(table("[outputs]", name=f"end {node}", node=node, direction=[1.0, 0.0, 0.0]) for node in shares)
    text += table("damping", ratio=0.0)
    band = {"frequencies": [FREQUENCY, 1.01 * FREQUENCY], "at": [FREQUENCY]}
    text += table("response", levels=list(map(float, levels)), **band, points=2)
    solver = {"method": "receptance", "modes": 4, "harmonics": harmonics, "samples": samples, "tolerance": 1e-9}
    (folder / "bar.toml").write_text(text + table("solver", **solver))
    return np.array(list(shares.values()))


@dataclass(frozen=True)
class Errors:
    """Relative errors of the program compared with the exact bar."""

    pairs: int
    stiffness: float  # of the end, with all pairs stuck
    first_slip: float  # of the pull at which the first pair slips
    motion: np.ndarray  # (n_levels,) of the end's displacement in harmonic 1: amplitude and phase
    loop: np.ndarray  # (n_levels,) of its harmonics 1 to H combined
    loss: np.ndarray  # (n_levels,) of the loss per cycle
    closure: float  # energy balance, at the worst point

    def __str__(self) -> str:
        def columns(values):
            return " | ".join(f"{value:+.1e}" for value in values)

        return (
            f"{self.pairs} | {columns([self.stiffness, self.first_slip])} | {columns(self.motion)} | {columns(self.loss)} | "
            f"{np.max(self.loop):.1e} | {self.closure:.0e}"
        )


def errors(kind: str, cells, comm, levels=LEVELS, harmonics=15, samples=512) -> Errors:
    """Run the bar at the ``levels`` [N], and once far below the first slip; return the errors.  On one rank."""
    small = 1e-3 * EXACT.first_slip
    with tempfile.TemporaryDirectory() as folder:
        weights = write_case(Path(folder), kind, cells, [small, *levels], harmonics, samples)
        done = chain.solve(Path(folder) / "bar.toml", comm)
    stuck, *points = [chain.requested(branch)[0] for branch in done.branches]
    first_slip = small / utilisation(stuck.U, done.structure.pairs).max()
    exact = np.array([exact_harmonics(P, harmonics) for P in levels])
    difference = np.array([weights @ point.response for point in points]) - exact
    return Errors(
        pairs=done.structure.pairs.n_pairs,
        stiffness=small / (weights @ stuck.response)[1] / EXACT.stuck_stiffness - 1.0,
        first_slip=first_slip / EXACT.first_slip - 1.0,
        motion=np.hypot(*difference[:, 1:3].T) / np.hypot(*exact[:, 1:3].T),
        loop=np.linalg.norm(difference, axis=1) / np.linalg.norm(exact, axis=1),
        loss=np.array([point.friction / EXACT.loss(P) for P, point in zip(levels, points)]) - 1.0,
        closure=done.worst_closure,
    )


def utilisation(U: np.ndarray, pairs) -> np.ndarray:
    """Return the share of their friction limit that stuck pairs use in a motion in phase with the load, (n_pairs,)."""
    du = U[:, :, 1]
    return (pairs.k_t * np.hypot(du[:, 0], du[:, 1]) + pairs.mu * pairs.k_n * abs(du[:, 2])) / (pairs.mu * pairs.N0)


def exact_harmonics(P: float, H: int, n: int = 4096) -> np.ndarray:
    """Return mean, cos 1, sin 1, ... of the end's displacement under P cos(th): Masing's loop."""
    theta = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    down = np.array([EXACT.cyclic_displacement(0.0, P, P * np.cos(t)) for t in theta[: n // 2]])
    u = np.concatenate([down, -down])
    spectrum = 2.0 / n * np.exp(-1j * np.outer(np.arange(H + 1), theta)) @ u
    return np.concatenate([[0.0], np.stack([spectrum.real, -spectrum.imag], axis=1)[1:].ravel()])


def rate(coarse, fine) -> float:
    """Return the rate between two meshes, one with cells of half the length, from the rms of their errors."""
    return float(np.log2(np.linalg.norm(coarse) / np.linalg.norm(fine)))


def main():
    print(
        f"stuck end stiffness {EXACT.stuck_stiffness:.4e} N/m, first slip {EXACT.first_slip:.2f} N, full slip "
        f"{EXACT.full_slip:.2f} N\n"
    )
    print(
        "\n".join(
            f"{P:.1f} N: slip length {EXACT.slip_length(P):.4f} m, end {EXACT.end_displacement(P):.5e} m, loss {EXACT.loss(P):.5e} J"
            for P in LEVELS
        )
    )
    at = " | ".join(f"{P:g} N" for P in LEVELS)
    print(f"\n| elements | pairs | stiffness | first slip | motion {at} | loss {at} | loop | closure |\n" + "| --- " * 14 + "|")
    for kind, sizes in MESHES.items():
        before = None
        for n in sizes:
            computed = errors(kind, (n, 1, 1), MPI.COMM_SELF, harmonics=31, samples=1024)
            print(f"| {n} {kind} | {computed} |", flush=True)
            if before is not None:
                rates = [rate(getattr(before, of), getattr(computed, of)) for of in ("stiffness", "motion", "loss")]
                print("    rates: stiffness {:.2f}, motion {:.2f}, loss {:.2f}".format(*rates))
            before = computed
    print("\n| harmonics | motion | loop | loss | of 64 hex20, worst level")
    for H in (1, 3, 7, 15, 31):
        computed = errors("hex20", (64, 1, 1), MPI.COMM_SELF, harmonics=H, samples=1024)
        print(f"| {H} | {computed.motion.max():.1e} | {computed.loop.max():.1e} | {abs(computed.loss).max():.1e} |", flush=True)


if __name__ == "__main__":
    main()
