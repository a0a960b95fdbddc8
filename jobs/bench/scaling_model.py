"""What a stage takes on more ranks than there are: from its work and its messages on a few.

A stage's time on P ranks is

    serial + replicated + parallel * share(P)  +  wire(P)  +  idle(P)

Serial is rank 0's alone, replicated is what every rank does, and of the parallel work the rank with the most has the share: all
three from the processor time of every rank outside MPI.  One rank by itself is as measured: more have things to do that it has
not, METIS first of all.  Wire is the messages' and collectives' latency and volume, from counts.
Idle is what is left of the wall time on two ranks: ranks that wait for each other.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, log2

import numpy as np
from scipy.optimize import nnls

KINDS = ("sums", "gathers", "exchanges", "messages")
RANKS = tuple(2**k for k in range(11))
NEARLY = 1.1  # times the least time: more ranks are no gain
_TRUSTED = 3.0  # weight of work on ranks with a core each over that on ranks that share them


@dataclass(frozen=True)
class Network:
    """A message of n bytes takes latency + n / bandwidth."""

    latency: float  # s
    bandwidth: float  # bytes/s

    def seconds(self, kind: str, ranks: int, calls: float, size: float) -> float:
        """Return the time of so many calls of a kind with ``size`` bytes in all [s].

        Sums and broadcasts pass all their bytes log2 P times; gathers as often, but their bytes once; in an exchange everyone
        has a message for everyone.
        """
        if ranks == 1:
            return 0.0
        steps = {"sums": ceil(log2(ranks)), "gathers": ceil(log2(ranks)), "exchanges": ranks - 1, "messages": 1}[kind]
        times = steps if kind == "sums" else 1
        return steps * calls * self.latency + times * size / self.bandwidth


def fitted_network(sizes, seconds) -> Network:
    """Return the network of times by bytes: the latency of the smallest, the bandwidth that fits the others' relative best."""
    sizes, seconds = np.asarray(sizes, dtype=float), np.asarray(seconds, dtype=float)
    latency = float(np.min(seconds[sizes <= 64]))
    A = (sizes / seconds)[:, None]
    (a_byte,), _ = nnls(A, np.maximum(1.0 - latency / seconds, 0.0))
    return Network(latency, 1.0 / max(a_byte, 1e-15))


@dataclass(frozen=True)
class Growth:
    """A number measured on some ranks; elsewhere a power of the ranks: through what was measured, and beyond it as its last part."""

    measured: dict[int, float]
    least: float = -1.0  # exponents that are believed
    most: float = 1.0

    def at(self, ranks: int, bound: str = "likely") -> float:
        """Return the number on so many ranks; as at the last ones measured, at best, unless it fell."""
        known = sorted(self.measured)
        if ranks in self.measured or len(known) == 1 or min(self.measured.values()) <= 0.0:
            return self.measured.get(ranks, self.measured[known[-1]])
        i = int(np.clip(np.searchsorted(known, ranks), 1, len(known) - 1))
        low, high = known[i - 1], known[i]
        power = np.log(self.measured[high] / self.measured[low]) / np.log(high / low)
        if ranks > high:
            limits = {"best": (self.least, 0.0), "likely": (self.least, self.most), "worst": (0.0, self.most)}[bound]
            power = float(np.clip(power, *limits))
        return self.measured[high] * (ranks / high) ** power


@dataclass(frozen=True)
class Share:
    """The part of the parallel work that the rank with the most of it does; nothing measured: even."""

    measured: dict[int, float] = field(default_factory=dict)

    def at(self, ranks: int, bound: str = "likely") -> float:
        """Return the share on so many ranks.

        Beyond those measured it falls at best with their number, likely as in the last doubling, and at worst towards a part
        that cannot be shared, which the last doubling tells as well (Amdahl).
        """
        known = sorted(self.measured)
        if ranks in self.measured or not known:
            return self.measured.get(ranks, 1.0 / ranks)
        last = known[-1]
        b = self.measured[last]
        if len(known) == 1 or ranks < last:
            return Growth(self.measured).at(ranks) if len(known) > 1 else b * last / ranks
        before = known[-2]
        a = max(self.measured[before], b)
        if bound == "best":
            return b * last / ranks
        if bound == "likely":
            return b * (last / ranks) ** min(1.0, np.log(a / b) / np.log(last / before))
        shared = min((a - b) / (1.0 / before - 1.0 / last), b * last)
        return b - shared / last + shared / ranks


@dataclass(frozen=True)
class StageModel:
    """A stage: its work in seconds, and what the ranks say to each other."""

    name: str
    alone: float  # work of one rank without others
    serial: float
    replicated: float
    parallel: float
    share: Share
    calls: dict[str, Growth]
    bytes: dict[str, Growth]
    idle: float = 0.0  # over the parallel work of the largest rank, on two ranks

    def terms(self, ranks: int, network: Network, bound: str = "likely") -> dict[str, float]:
        """Return the parts of the time on so many ranks [s]."""
        if ranks == 1:
            return {"largest share": self.alone}
        largest = self.parallel * self.share.at(ranks, bound)
        steps = 1.0 if bound == "best" else log2(ranks)
        wire = sum(
            network.seconds(kind, ranks, self.calls[kind].at(ranks, bound), self.bytes[kind].at(ranks, bound))
            for kind in self.calls
        )
        return {
            "rank 0": self.serial,
            "every rank": self.replicated,
            "largest share": largest,
            "messages": wire,
            "waiting": self.idle * steps * largest,
        }

    def seconds(self, ranks: int, network: Network, bound: str = "likely") -> float:
        """Return the time on so many ranks [s]."""
        return sum(self.terms(ranks, network, bound).values())

    def gains_until(self, network: Network, bound: str = "likely") -> tuple[int, str]:
        """Return the ranks as in :func:`gains_until`, and what takes most of the time there."""
        ranks = gains_until([self.seconds(n, network, bound) for n in RANKS])
        return ranks, self.most(ranks, network, bound)

    def most(self, ranks: int, network: Network, bound: str = "likely") -> str:
        """Return what takes most of the time on so many ranks, on two where one is meant."""
        terms = self.terms(max(ranks, 2), network, bound)
        return max(terms, key=lambda term: terms[term])


def gains_until(seconds: list[float]) -> int:
    """Return the fewest of ``RANKS`` that are nearly as fast as the fastest of them, from the times of all."""
    return next(ranks for ranks, one in zip(RANKS, seconds) if one <= NEARLY * min(seconds))


def parts_of_work(work: dict[int, list[float]], shares: dict[int, list[float]]) -> tuple[float, float, float]:
    """Return serial, replicated and parallel work [s] that fit the work of every rank best.

    Parameters
    ----------
    work : by number of ranks, of each rank [s]
    shares : by number of ranks, the part of the parallel work of each rank; even where a number is not among them

    Notes
    -----
    None of the three is negative.  Two ranks weigh most: more may have shared cores, and caches.  One rank by itself counts
    where only two were run besides.
    """
    rows, values = [], []
    several = {ranks: taken for ranks, taken in work.items() if ranks > 1}
    for ranks, taken in (several if len(several) > 1 else work).items():
        share = shares.get(ranks, [1.0 / ranks] * ranks)
        weight = (_TRUSTED if ranks <= 2 else 1.0) / max(float(np.mean(taken)), 1e-9) / np.sqrt(ranks)
        rows += [[weight * (rank == 0), weight, weight * share[rank]] for rank in range(ranks)]
        values += [weight * one for one in taken]
    (serial, replicated, parallel), _ = nnls(np.array(rows), np.array(values))
    return float(serial), float(replicated), float(parallel)


@dataclass(frozen=True)
class Measured:
    """What was measured of a stage, by number of ranks."""

    work: dict[int, list[float]]  # s, as in :func:`parts_of_work`
    shares: dict[int, list[float]]  # as there; of more numbers than were run, perhaps
    calls: dict[str, dict[int, float]]  # by kind before, of the rank with the most
    bytes: dict[str, dict[int, float]]  # the same
    wall: dict[int, float]  # s, on one rank and on two


def stage_model(name: str, measured: Measured, network: Network) -> StageModel:
    """Return the model of a stage measured on a network."""
    calls, wall = measured.calls, measured.wall
    said = {kind: (Growth(calls[kind]), Growth(measured.bytes[kind])) for kind in calls if calls[kind]}
    parts = parts_of_work(measured.work, measured.shares)
    alone, largest = measured.work[1][0], {ranks: max(of_ranks) for ranks, of_ranks in measured.shares.items()}
    model = StageModel(
        name,
        alone,
        *parts,
        Share(largest),
        {kind: one[0] for kind, one in said.items()},
        {kind: one[1] for kind, one in said.items()},
    )
    if 2 not in wall or model.parallel == 0.0:
        return model
    left = wall[2] - model.seconds(2, network)
    idle = max(0.0, left) / (model.parallel * model.share.at(2))
    return StageModel(name, alone, *parts, model.share, model.calls, model.bytes, idle)


def exponent(small: float, large: float, n_small: float, n_large: float, least: float, most: float) -> float:
    """Return g of time ~ n^g, from two sizes, as far as theory bounds it: times of milliseconds say little of larger ones."""
    if min(small, large) <= 0.0:
        return least
    return float(np.clip(np.log(large / small) / np.log(n_large / n_small), least, most))


def weak_seconds(model: StageModel, growth: float, ranks: int, network: Network) -> float:
    """Return the time [s] of a structure ``ranks`` times as large on as many ranks; work grows with the power ``growth``.

    What is shared is shared as evenly as on two ranks, since a larger structure parts better; bytes grow with the structure's
    surface between ranks, which per rank stays.
    """
    if ranks == 1:
        return model.alone
    terms = model.terms(ranks, network)
    uneven = 2.0 * model.share.at(2)
    larger = ranks**growth
    parallel = model.parallel * larger * uneven / ranks
    return (model.serial + model.replicated) * larger + parallel * (1.0 + model.idle * log2(ranks)) + terms["messages"]
