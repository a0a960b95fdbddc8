"""The cases of the battery of extremes (extremes.py), by family; each states its expected result.

Levels are multiples of the onset of slip, the least level at which some pair reaches its friction limit or opens at the
resonance of the stuck structure.  Frequencies are multiples of its first natural frequency.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product

import numpy as np
from oracles import point_check, scenes
from verification import extreme_structures as structures

SHARES = (1e-6, 1e-3, 1.0, 1e3, 1e6)  # of the structure's stiffness
SMALL = {"oscillator": structures.oscillator, "3-D pair": structures.spatial, "chain": structures.chain}
DELICATE = (  # unbounded, ill-conditioned, or at corners with a joint far too stiff
    "two masses, none",
    "frame, none",
    "frame, ratio 1e-6",
    "chain, mu = 0, huge preload",
    "3-D pair, k_t = 1e+06, k_n = 1e-06",
)
LONG = ("5,000", "frame, k_t = 1, k_n = 1e+06", "random 12", "chain, stiffness x 1e-09")  # a tenth of the time of all cases
HELD = {**SMALL, "two masses": structures.two_masses, "frame": structures.frame}
ALL = {**HELD, "free body": structures.free_body}


@dataclass(frozen=True)
class Case:
    """A scene and its expected result.

    ``expect`` is "point check", the check of each point, or in addition to it
    "stuck", "frictionless", "open" : the linear solution with all springs, without tangential ones, without any;
    "jenkins" : the exact harmonics of a mass on a Jenkins element, within ``tolerance``;
    "twin" : the same results, scaled, as the structure in the original units, to 1e-9 (``twin`` has length, mass and time);
    "refused" : an error before any point whose text has ``reason``; ``has_answer`` is true if only a rule prevents a result.
    """

    name: str
    family: str
    build: Callable[[], dict]
    levels: tuple[float, ...] = (0.3, 3.0, 30.0)  # of the onset
    band: tuple[float, float] = (0.8, 1.2)  # relative to the first stuck mode
    at: tuple[float, ...] = ()  # relative to the first stuck mode
    expect: str = "point check"
    reason: str = ""
    has_answer: bool = True  # False: the request has no solution, or infinitely many
    newtons: bool = False  # levels are newtons
    hertz: bool = False  # band and at are Hz
    wide: bool = False  # band from below the first mode without the joint to three times it
    twin: dict[str, float] = field(default_factory=dict)
    tolerance: float = 1e-7
    points: int = 12
    solver: dict = field(default_factory=dict)


def all_cases() -> list[Case]:
    """Return every case, in the order of the report."""
    families = (stiffness, friction_and_preload, levels, damping, frequency, harmonics, loads, joints, units, methods, random)
    all_cases = [case for family in families for case in family()]
    names = [case.name for case in all_cases]
    assert len(set(names)) == len(names), "a name twice"
    return all_cases


def quick_cases(of_family: slice = slice(None)) -> list[Case]:
    """Return a few small and quick cases of every family, with few points, and those that are sensitive to small changes.

    ``of_family`` selects some of the four small ones of each family.
    """
    values: list[Case] = []
    by_family: dict[str, list[Case]] = {}
    for case in all_cases():
        by_family.setdefault(case.family, []).append(case)
    for cases in by_family.values():
        spread = [case for case in cases[:: max(len(cases) // 4, 1)][:4] if not any(word in case.name for word in LONG)]
        values += [replace(case, points=min(case.points, 8)) for case in spread[of_family] if case.name not in DELICATE]
        values += [case for case in cases if case.name in DELICATE]
    return values


def stiffness():
    for (name, make), k_t, k_n in product((("3-D pair", structures.spatial), ("frame", structures.frame)), SHARES, SHARES):
        yield Case(
            f"{name}, k_t = {k_t:g}, k_n = {k_n:g}",
            "joint stiffness",
            partial(make, k_t=k_t, k_n=k_n),
            (0.3, 1.2, 4.0),
            points=20,
            wide=True,
        )
    for k_t in SHARES:
        yield Case(
            f"two masses, k_t = {k_t:g}, exact mode count",
            "joint stiffness",
            partial(structures.two_masses, k_t=k_t),
            (0.3, 2.0, 10.0),
            points=20,
            wide=True,
        )


def friction_and_preload():
    preloads = {"no preload": 0.0, "tiny preload": 1e-9, "preload 1": 1.0, "huge preload": 1e9, "gap": -1.0, "wide gap": -1e9}
    for (name, make), mu, (words, N0) in product(
        (("3-D pair", structures.spatial), ("chain", structures.chain)), (0.0, 1e-8, 1.0, 1e6), preloads.items()
    ):
        expect = (
            "stuck"
            if N0 == 1e9 and mu >= 1.0
            else "frictionless"
            if N0 == 1e9 and mu == 0.0
            else "open"
            if N0 == -1e9
            else "point check"
        )
        yield Case(
            f"{name}, mu = {mu:g}, {words}",
            "friction and preload",
            partial(make, mu=mu, N0=N0),
            (1e-3, 0.05, 0.2) if mu == 1e6 else (1e-3, 1.0, 5.0),
            newtons=True,
            expect=expect,
            points=10,
            wide=True,
        )
    for name, mu in product(("3-D pair", "chain"), (0.0, 0.3, 1.0)):
        yield Case(
            f"{name}, mu = {mu:g}, separate limits", "friction and preload", partial(ALL[name], mu=mu, separate=True), wide=True
        )
    yield Case(
        "chain, mu = 1e6, lifts off far",
        "friction and preload",
        partial(structures.chain, mu=1e6),
        (10.0,),
        newtons=True,
        wide=True,
    )
    mixed = {"some pairs open": [1.0, -0.5], "one pair free of preload": [0.0, 1.0], "one pair pressed hard": [1e6, 1e-3]}
    for words, N0 in mixed.items():
        for name in ("chain", "free body"):
            yield Case(
                f"{name}, {words}", "friction and preload", partial(ALL[name], N0=N0), (0.01, 1.0, 10.0), newtons=True, wide=True
            )
    yield Case(
        "frame, every other pair open",
        "friction and preload",
        partial(structures.frame, N0=[1.0, -0.1, 1.0, -0.1]),
        (0.01, 1.0, 10.0),
        newtons=True,
        wide=True,
    )
    yield Case(
        "frame, friction differs by 1e12",
        "friction and preload",
        partial(structures.frame, mu=[1e-6, 1e6, 1e-6, 1e6]),
        (0.01, 1.0, 10.0),
        newtons=True,
        wide=True,
    )
    yield Case(
        "oscillator, mu = 0",
        "friction and preload",
        partial(structures.oscillator, mu=0.0),
        (1.0,),
        newtons=True,
        expect="frictionless",
        at=(1.0,),
    )
    yield Case(
        "oscillator, mu = 1e6",
        "friction and preload",
        partial(structures.oscillator, mu=1e6),
        (1.0,),
        newtons=True,
        expect="stuck",
        at=(1.0,),
    )


def levels():
    for (name, make), level in product(HELD.items(), (1e-12, 1e-6, 1e-3)):
        yield Case(f"{name}, {level:g} N", "levels", make, (level,), newtons=True, expect="stuck", at=(1.0,), points=10)
    for (name, make), share in product(HELD.items(), (0.2, 1.01, 1.5, 5.0, 100.0, 1000.0)):
        yield Case(
            f"{name}, {share:g} of onset",
            "levels",
            make,
            (share,),
            expect="stuck" if share < 1.0 else "point check",
            points=12,
            wide=True,
        )
    for level, omega in product((1.1, 2.0, 8.0), (0.8, 0.95, 1.1)):
        yield Case(
            f"Jenkins mass, {level:g} mu N at {omega:g}, exact",
            "levels",
            structures.oscillator,
            (level,),
            newtons=True,
            band=(0.7, 1.3),
            at=(omega,),
            expect="jenkins",
            tolerance=2e-3,
            solver={"harmonics": 31, "samples": 2048},
        )


def damping():
    kinds = {
        "none": {"zeta": 0.0},
        "ratio 1e-6": {"zeta": 1e-6},
        "ratio 0.9": {"zeta": 0.9},
        "ratio 0.999": {"zeta": 0.999},
        "mass-proportional": {"rayleigh": (0.8, 0.0)},
        "stiffness-proportional": {"rayleigh": (0.0, 0.8)},
        "Rayleigh, heavy": {"rayleigh": (3.0, 3.0)},
    }
    for (name, make), (words, kind) in product(HELD.items(), kinds.items()):
        yield Case(
            f"{name}, {words}",
            "damping",
            partial(make, **kind),
            (0.3, 1.2) if kind.get("zeta", 1.0) < 1e-3 else (0.3, 3.0, 30.0),
            wide=True,
            # at a resonance without damping, energies have a thousand times the error of the motion
            solver={"tolerance": 1e-10} if kind.get("zeta") == 0.0 else {},
        )
    for n, make, c in (
        (3, structures.spatial, 0.02),
        (9, structures.chain, 0.02),
        (3, structures.spatial, 5.0),
        (9, structures.chain, 5.0),
    ):
        ring = c * (2.0 * np.eye(n) - np.roll(np.eye(n), 1, axis=0) - np.roll(np.eye(n), -1, axis=0))
        yield Case(f"dampers between {n} DOFs, c = {c:g}", "damping", partial(make, C=ring), (0.3, 3.0, 30.0), wide=True)
    one = np.diag([1.0] + [0.0] * 8)
    yield Case("chain, one damper on one DOF", "damping", partial(structures.chain, C=0.1 * one), (0.3, 3.0, 30.0), wide=True)
    yield Case("chain, a damping matrix of zeros", "damping", partial(structures.chain, C=0.0 * one), (0.3, 1.2), wide=True)
    for name, make in SMALL.items():
        yield Case(
            f"{name}, a damping matrix that feeds energy in",
            "damping",
            partial(_active_damping, make),
            expect="refused",
            reason="feeds energy in",
            has_answer=False,
        )


def _active_damping(make) -> dict:
    n = len(make()["M"])
    return make(C=-0.1 * np.eye(n))


def frequency():
    for name, make in HELD.items():
        yield Case(f"{name}, 1e-6 of the first mode", "frequency", make, (0.01, 0.5, 2.0), band=(1e-6, 2e-6), points=10)
        yield Case(f"{name}, from 1e-6 of the first mode through it", "frequency", make, (0.3, 3.0), band=(1e-6, 1.3))
        yield Case(f"{name}, at resonance, stuck", "frequency", make, (0.3,), at=(1.0,), expect="stuck")
        yield Case(f"{name}, at resonance, slipping", "frequency", make, (3.0,), at=(1.0,))
        yield Case(f"{name}, begins at resonance", "frequency", make, (0.5, 3.0, 30.0), band=(1.0, 1.2))
        if name in ("oscillator", "3-D pair"):
            yield Case(
                f"{name}, begins at resonance without damping",
                "frequency",
                partial(make, zeta=0.0),
                (0.3,),
                newtons=True,
                band=(1.0, 1.2),
                expect="refused",
                reason="resonance",
                has_answer=False,
            )
        yield Case(f"{name}, beyond the last mode", "frequency", make, (0.5, 100.0, 1e5), band=(8.0, 9.5), points=10)
        yield Case(
            f"{name}, far above the last mode",
            "frequency",
            make,
            (1.0,),
            band=(3e4, 4e4),
            expect="refused",
            reason="far above the highest",
            points=10,
        )


def harmonics():
    for (name, make), H in product(SMALL.items(), (1, 2, 5, 15, 31)):
        yield Case(
            f"{name}, H = {H}, {2 * H + 1} samples",
            "harmonics and samples",
            make,
            (0.5, 2.0),
            points=20,
            wide=True,
            solver={"harmonics": H, "samples": 2 * H + 1},
        )
        yield Case(
            f"{name}, H = {H}, {max(128, 16 * H)} samples",
            "harmonics and samples",
            make,
            (0.5, 2.0, 10.0),
            points=10,
            wide=True,
            solver={"harmonics": H, "samples": max(128, 16 * H)},
        )
    yield Case(
        "oscillator, H = 1, 16384 samples",
        "harmonics and samples",
        structures.oscillator,
        (2.0,),
        wide=True,
        solver={"harmonics": 1, "samples": 16384},
    )
    for name, make in SMALL.items():
        yield Case(
            f"{name}, H = 0",
            "harmonics and samples",
            partial(make, harmonic=0),
            (0.5, 2.0),
            points=4,
            solver={"harmonics": 0, "samples": 1},
        )


def loads():
    vector, across, up = [1.0, 0.5, 0.3], [0.0, 1.0, 0.0], [0.1, 0.0, 0.6]
    mixes = {
        "harmonic 2 alone": [(vector, 2, 0.0)],
        "harmonic 3 alone, phase 1": [(vector, 3, 1.0)],
        "constant and harmonic 1": [(up, 0, 0.0), (vector, 1, 0.3)],
        "opening constant force": [([0.0, 0.0, 3.0], 0, 0.0), (vector, 1, 0.0)],
        "closing constant force": [([0.0, 0.0, -3.0], 0, 0.0), (vector, 1, 0.0)],
        "harmonics 1 and 2": [(vector, 1, 0.0), (across, 2, 1.1)],
        "harmonics 0 to 3": [(up, 0, 0.0), (vector, 1, 0.2), (across, 2, 0.4), (up, 3, 2.0)],
        "a circle": [([1.0, 0.0, 0.0], 1, 0.0), ([0.0, 1.0, 0.0], 1, np.pi / 2)],
        "phase 1e6": [(vector, 1, 1e6)],
        "load across only": [(across, 1, 0.0)],
        "load along the normal only": [([0.0, 0.0, 1.0], 1, 0.0)],
        "two loads that cancel": [(vector, 1, 0.0), ([-1.0, -0.5, -0.3], 1, 0.0)],
    }
    for words, mix in mixes.items():
        for separate in (False, True) if words in ("harmonics 0 to 3", "a circle") else (False,):
            yield Case(
                f"3-D pair, {words}{', separate limits' if separate else ''}",
                "loads",
                partial(_loaded, structures.spatial, mix, separate=separate),
                (0.05, 0.3, 0.8),
                newtons=True,
                band=(0.5, 1.2),
                wide=True,
            )
    yield Case(
        "constant load alone", "loads", partial(_loaded, structures.spatial, [(vector, 0, 0.0)]), (0.1, 10.0), newtons=True
    )
    yield Case(
        "load in a harmonic that is left out",
        "loads",
        partial(_loaded, structures.spatial, [(vector, 5, 0.0)]),
        expect="refused",
        reason="harmonic = 5",
    )


def _loaded(make, mix, **numbers) -> dict:
    return structures.with_loads(make(**numbers), *mix)


def joints():
    for n in (1, 2, 10, 50, 200):
        yield Case(
            f"{n} identical pairs", "joints and modes", partial(structures.identical_pairs, n), (0.3, 3.0, 30.0), points=10
        )
    for n in (2, 5, 20):
        yield Case(f"{n} coincident modes", "joints and modes", partial(structures.coincident, n), (0.3, 3.0, 30.0), points=10)
    for k, N0 in product((1e-6, 1.0, 1e6), (1.0, 1e3)):
        yield Case(
            f"free body on springs of {k:g}, N0 = {N0:g}",
            "joints and modes",
            partial(structures.free_body, k_t=k, k_n=k, N0=N0),
            (0.3, 0.9),
        )
    for c in (0.1, 0.8):
        yield Case(
            f"free body, all of it slips, damped {c:g}",
            "joints and modes",
            partial(structures.free_body, rayleigh=(c, 0.0)),
            (0.3, 3.0, 30.0),
        )
    yield Case("free body on one pair", "joints and modes", partial(structures.free_body, n_pairs=1), (0.3, 0.9))
    yield Case("free body, all pairs slip", "joints and modes", structures.free_body, (300.0,))
    yield Case("free body pressed down, sliding", "joints and modes", partial(structures.free_body, mu=0.0), (1.0,), newtons=True)
    for words, build, reason in (
        ("free beside a held mass", _free, "is singular"),
        ("a body beside the joint is free", _loose_part, "no positive stiffness"),
        ("stiffness that releases energy", _unstable, "positive definite"),
        ("negative mass", _negative_mass, "mass"),
    ):
        refused = dict(newtons=True, expect="refused", reason=reason, has_answer=False, hertz=True, band=(0.1, 0.2))
        yield Case(words, "joints and modes", build, (1.0,), **refused)
    yield Case("DOFs without mass", "joints and modes", _massless, (0.3, 3.0, 30.0))
    for n_pairs in (2, 8, 20):
        yield Case(
            f"frame, {n_pairs} pairs",
            "joints and modes",
            partial(structures.frame, n_elements=max(6, n_pairs + 2), overlap=n_pairs),
        )
    yield Case(
        "5,000 pairs, all stuck",
        "joints and modes",
        structures.patch,
        (1e-6,),
        newtons=True,
        hertz=True,
        band=(0.01, 0.012),
        points=3,
        solver={"harmonics": 1, "samples": 16},
    )
    yield Case(
        "5,000 pairs, some slip",
        "joints and modes",
        structures.patch,
        (4.0,),
        newtons=True,
        hertz=True,
        band=(0.01, 0.0105),
        points=3,
        solver={"harmonics": 1, "samples": 32},
    )


def _free() -> dict:
    system = structures.two_masses()
    loads = [{**load, "vector": np.append(load["vector"], 0.0)} for load in system["loads"]]
    wider = {"M": np.diag([1.0, 0.7, 1.0]), "K": np.diag([0.0, 0.0, 1.0]), "R": scenes.incidence(system["pair_dofs"], 3)}
    return {**system, **wider, "loads": loads, "output": np.append(system["output"], 0.0)}


def _loose_part() -> dict:
    system = structures.chain()
    K = system["K"].copy()
    K[:3, 3:], K[3:, :3] = 0.0, 0.0
    K[3:6, 3:6] -= np.diag(np.diag(K[:3, :3])) * 0.0
    loose = system["pair_dofs"].copy()
    loose[0] = [3, 4, 5, -1, -1, -1]
    K[:3, :3] = 0.0
    return {**system, "K": K, "pair_dofs": loose, "R": scenes.incidence(loose, 9)}


def _unstable() -> dict:
    system = structures.spatial()
    return {**system, "K": system["K"] - 5.0 * np.diag([1.0, 0.0, 0.0])}


def _negative_mass() -> dict:
    system = structures.spatial()
    return {**system, "M": np.diag([1.0, -1.0, 1.0])}


def _massless() -> dict:
    system = structures.chain()
    M = system["M"].copy()
    M[6:, 6:] = 0.0
    return {**system, "M": M}


UNITS = {
    "mm, tonne": {"length": 1e3, "mass": 1e-3},
    "km": {"length": 1e-3},
    "um, ug": {"length": 1e6, "mass": 1e9},
    "ms": {"time": 1e3},
    "inch, slinch": {"length": 39.3700787, "mass": 1.0 / 175.126835},
    "Gg, Mm, ks": {"length": 1e-6, "mass": 1e-6, "time": 1e-3},
}


def units():
    for (name, make), (words, factors) in product(SMALL.items(), UNITS.items()):
        yield Case(
            f"{name}, {words}",
            "units and scaling",
            make,
            (0.5, 3.0, 10.0),
            wide=True,
            at=(0.85, 0.93, 1.0, 1.07, 1.15),
            expect="twin",
            twin=factors,
            points=12,
            solver={"tolerance": 1e-12},
        )
    # K x s, M x d: the same structure with time in units of sqrt(s / d) and forces in units of s
    for (name, make), (s, d) in product(HELD.items(), ((1e9, 1.0), (1e-9, 1.0), (1.0, 1e9), (1.0, 1e-9))):
        what = f"stiffness x {s:g}" if d == 1.0 else f"density x {d:g}"
        yield Case(
            f"{name}, {what}",
            "units and scaling",
            make,
            (0.5, 3.0, 10.0),
            wide=True,
            at=(0.85, 0.93, 1.0, 1.07, 1.15),
            expect="twin",
            twin={"mass": d, "time": np.sqrt(d / s)},
            points=12,
            solver={"tolerance": 1e-12},
        )


def methods():
    ways = {
        "full": {"method": "full"},
        "rubin": {"method": "rubin"},
        "rubin, condensed": {"method": "rubin", "condensed": True},
        "craig-bampton": {"method": "craig-bampton"},
        "adaptive, in-point check": {"method": "adaptive", "in_point_check": True},
        "adaptive-energy, in-point check": {"method": "adaptive-energy", "in_point_check": True},
    }
    for (name, make), (words, way) in product(
        (("3-D pair", structures.spatial), ("chain", structures.chain), ("frame", structures.frame)), ways.items()
    ):
        yield Case(f"{name}, {words}", "methods", make, (0.3, 3.0, 10.0), wide=True, points=12, solver=way)
    for words, way in ways.items():
        for k_t, k_n in ((1e-4, 1e4), (1e4, 1e-4)):
            yield Case(
                f"chain, {words}, k_t = {k_t:g}, k_n = {k_n:g}",
                "methods",
                partial(structures.chain, k_t=k_t, k_n=k_n),
                (0.3, 1.5, 5.0),
                wide=True,
                points=10,
                solver=way,
            )


def random(n: int = 50):
    for seed in range(n):
        yield _random_case(seed)


def _random_case(seed: int) -> Case:
    rng = np.random.default_rng(seed)

    def choose(options):
        return options[rng.integers(len(options))]

    name = choose(list(ALL))
    numbers = {
        "k_t": 10.0 ** rng.uniform(-6, 6),
        "k_n": 10.0 ** rng.uniform(-6, 6),
        "mu": float(choose([0.0, 1e-8, 0.1, 0.3, 1.0, 1e6])),
        "N0": float(
            choose([1e-9, 1.0, 1.0, 1.0, 1e3, -0.3]) if name not in ("oscillator", "two masses") else choose([1e-9, 1.0, 1e3])
        ),
    }
    kind = choose([{"zeta": 10.0 ** rng.uniform(-4, -0.1)}, {"zeta": 0.02}, {"rayleigh": (0.02, 0.05)}])
    if name in ("3-D pair", "chain", "free body"):
        numbers["separate"] = bool(rng.integers(2))
    H = int(choose([1, 2, 3, 5, 8, 13]))
    samples = int(choose([2 * H + 1, 4 * H + 3, 64, 128]))
    method = choose(
        [
            {},
            {},
            {},
            {"method": "rubin"},
            {"method": "full"},
            {"method": "craig-bampton"},
            {"method": "adaptive", "in_point_check": True},
        ]
    )
    low = choose([0.3, 0.8, 0.95])
    return Case(
        f"random {seed}: {name}, " + ", ".join(f"{key} = {value:.3g}" for key, value in numbers.items()),
        "random combinations",
        partial(ALL[name], **numbers, **kind),
        tuple(sorted({10.0 ** rng.uniform(-12, 3), 10.0 ** rng.uniform(0, 2)})),
        band=(low, low + choose([0.1, 0.4])),
        points=10,
        solver={"harmonics": H, "samples": max(samples, 2 * H + 1), **method},
    )


def onset(system: dict, omega: float) -> float:
    """Return the least level at which a stuck pair reaches its friction limit or opens at ``omega``; 1 if there is none.

    Preloads below 0 count as open; without friction or preload the level is 1.
    """
    H = max(load["harmonic"] for load in system["loads"])
    K_L = scenes.stuck_stiffness(system)
    C = point_check.damping(system, K_L)
    f = point_check.loads(system, 1.0, H)
    most = np.zeros((len(system["k_t"]), 3))
    for n in range(1, H + 1):
        Z = K_L - (n * omega) ** 2 * system["M"] + 1j * n * omega * C
        du = system["R"] @ np.linalg.solve(Z, f[:, 2 * n - 1] - 1j * f[:, 2 * n])
        most += np.abs(du).reshape(-1, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.stack(
            [
                system["k_t"] * np.hypot(most[:, 0], most[:, 1]) / (system["mu"] * system["N0"]),
                system["k_n"] * most[:, 2] / system["N0"],
            ]
        )
    shares = shares[np.isfinite(shares) & (shares > 1e-12)]
    return float(1.0 / shares.max()) if len(shares) else 1.0
