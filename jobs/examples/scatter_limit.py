"""The scatter of the blades of a disc at which the worst blade exceeds a limit.

    python meshes/shrouded_disc.py --n-span 4 --n-width 1 --n-side 1 --out meshes/shrouded_disc_coarse.msh
    python jobs/examples/scatter_limit.py [--limit 1.6] [--discs 10] [--scatters 0.0025 0.005 0.01 0.02]

Blades of a disc are never exactly alike, and some of them vibrate more than all would on a disc of identical blades.  A number of
discs is drawn at random, each with its own seed; a larger scatter scales the deviations of the same discs.  For each scatter the
script computes the amplitude that a given share of the discs does not exceed; SciPy's root finder gives the scatter where it
reaches the limit.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

TOLERANCE = 0.02  # of ln scatter


@dataclass(frozen=True)
class Discs:
    """Discs drawn at random, of one scene with [cyclic] whole = true and scatter, at its first level."""

    scene: Path
    quantity: str = "stiffness"  # of [cyclic] scatter: the others remain those of the scene
    n_discs: int = 10
    share: float = 0.9  # of the discs that may reach the amplitude

    @cached_property
    def structure(self) -> microslip.Structure:
        """The structure of one of the discs: the others have the same factor, modes and static columns.  Collective."""
        return microslip.build(self.drawn(0.01, 1))

    def drawn(self, scatter: float, seed: int) -> microslip.Scene:
        """Return the scene of one disc."""
        return microslip.read(self.scene, [f"cyclic.scatter.{self.quantity}={scatter}", f"cyclic.scatter.seed={seed}"])

    def worst_blade(self, scatter: float, seed: int) -> float:
        """Return the largest amplitude of all blades of one disc, in the unit of the output.  Collective."""
        scene = self.drawn(scatter, seed)
        response = microslip.respond(self.structure.with_sectors(scene), levels=scene.response.levels[:1])
        if response.failures:
            raise SystemExit(f"scatter {scatter:g}, seed {seed}: {response.failures}")
        return max(float(response[name].peaks[1][0]) for name in response.outputs)

    def of_share(self, scatter: float) -> float:
        """Return the amplitude of the worst blade that the share of the discs does not exceed.  Collective."""
        return float(np.quantile([self.worst_blade(scatter, seed) for seed in range(1, self.n_discs + 1)], self.share))


def scatter_at(discs: Discs, limit: float, scatters: Sequence[float], say=print) -> float | None:
    """Return the smallest scatter at which the worst blade exceeds a limit, relative to alike blades; None if none does.

    Collective.  ``scatters`` increase; the root is sought between the first two that bracket it.
    """
    alike = discs.worst_blade(0.0, 0)
    say(f"alike blades: {alike:.4e}")

    @cache
    def over_limit(logarithm: float) -> float:
        amplification = discs.of_share(float(np.exp(logarithm))) / alike
        say(f"scatter {np.exp(logarithm):.5f}: {discs.share:.0%} of the discs stay below {amplification:.3f} times that")
        return amplification - limit

    before = None
    for scatter in scatters:
        if over_limit(np.log(scatter)) > 0.0:
            return scatter if before is None else float(np.exp(brentq(over_limit, *np.log([before, scatter]), xtol=TOLERANCE)))
        before = scatter
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", type=Path, default=Path(__file__).with_suffix(".toml"))
    parser.add_argument("--quantity", default="stiffness", help="of [cyclic] scatter (default: %(default)s)")
    parser.add_argument("--limit", type=float, default=1.6, help="amplitude over that of alike blades (default: %(default)s)")
    parser.add_argument("--discs", type=int, default=10, help="number of discs drawn (default: %(default)s)")
    parser.add_argument("--share", type=float, default=0.9, help="of the discs that stay below the limit (default: %(default)s)")
    parser.add_argument("--scatters", nargs="+", type=float, default=[0.0025, 0.005, 0.01, 0.02], help="standard deviations")
    arguments = parser.parse_args()
    say = print if MPI.COMM_WORLD.rank == 0 else (lambda line: None)
    discs = Discs(arguments.scene, arguments.quantity, arguments.discs, arguments.share)
    limit = scatter_at(discs, arguments.limit, sorted(arguments.scatters), say)
    if limit is None:
        say(f"no scatter up to {max(arguments.scatters):g} reaches {arguments.limit:g}")
    else:
        say(f"the worst blade passes {arguments.limit:g} times alike blades at a scatter of {arguments.quantity} of {limit:.5f}")


if __name__ == "__main__":
    main()
