"""Another friction or preload of a structure with [statics] gives another rest; unchanged stages are not repeated."""

from dataclasses import replace

import numpy as np
import pytest
from rest_scene import eccentric, folder_with_bar, force, scene_of

import microslip
from microslip.library import build as library_build
from microslip.linear import factor as factors
from microslip.messages.errors import CaseError, ConvergenceError
from microslip.parallel.agree import on_root
from microslip.statics import reference_state

STATICS = "steps = 4\n" + force(150.0, 50.0, -1000.0)  # N; some pairs slide
COMMON = (("samples = 64", "samples = 64\ntolerance = 1e-11"), ("points = 10", "points = 3\nat = [4665.0]"))
RANGE = ("mode = 1\nspan = [0.9, 1.1]", "frequencies = [4655.0, 4675.0]")
SAME = 1e-8  # relative to the largest value


folder = pytest.fixture(scope="module")(folder_with_bar)


@pytest.fixture(scope="module")
def structure(comm, folder):
    with microslip.build(scene_of(comm, folder, STATICS, *COMMON, RANGE), comm) as structure:
        yield structure


def values_at(response):
    """Return harmonics 1 to 3 of the output and forces p at the requested frequency."""
    (level,) = response.results.levels
    (i,) = np.flatnonzero(level.requested)
    return level.response[i, 0, 1:], level.p[i]


def assert_same(computed, expected):
    """Compare two responses and their structures: rest, frequencies, motion, forces, fields.  Collective."""
    for name in ("mu", "N0", "T0", "k_t", "k_n", "w0"):
        a, b = getattr(computed.prepared.pairs, name), getattr(expected.prepared.pairs, name)
        assert np.abs(a - b).max(initial=0.0) <= SAME * np.abs(b).max(initial=0.0), name
    assert np.array_equal(computed.prepared.pairs.open_at_rest, expected.prepared.pairs.open_at_rest)
    assert computed.prepared.structure.omega_n == pytest.approx(expected.prepared.structure.omega_n, rel=SAME)
    for a, b in zip(values_at(computed), values_at(expected)):
        assert a == pytest.approx(b, abs=SAME * np.abs(b).max())
    a, b = (response.fields(5.0, 4665.0)[1] for response in (computed, expected))
    assert a == pytest.approx(b, abs=SAME * np.abs(b).max())


def of_pairs(structure):
    """Return another friction for each pair, and the text of its file for a scene."""
    mu = 0.25 + 0.1 * np.arange(structure.pairs.n_pairs) / structure.pairs.n_pairs
    rows = [",".join(map(repr, (*map(float, at), float(value)))) for at, value in zip(structure.pairs.position, mu)]
    return mu, "\n".join(["x,y,z,friction", *rows])


CHANGES = {
    "a number": ({"friction": 0.22}, ("friction = 0.3", "friction = 0.22")),
    "each pair": (None, ("friction = 0.3", 'friction = 0.3\nparameters = "mu.csv"')),
    "by joint": ({"friction": {"joint": 0.5}}, ("friction = 0.3", "friction = 0.5")),
    "a preload before the loads": ({"preload": {"joint": 2e5}}, ('preload = "static"', "preload = 2e5")),
    "both": (
        {"preload": 1e5, "friction": 0.24},
        (
            '0.3\ntangential_stiffness = 1.0e12\nnormal_stiffness = 2.0e12\npreload = "static"',
            "0.24\ntangential_stiffness = 1.0e12\nnormal_stiffness = 2.0e12\npreload = 1e5",
        ),
    ),
}
ON_RANKS = ("each pair", "both")  # changes also tested on several ranks


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name in ON_RANKS else pytest.mark.ranks(1)) for name in CHANGES])
def test_another_rest_equals_that_of_a_new_structure(comm, folder, structure, name):
    keys, change = CHANGES[name]
    if keys is None:
        mu, text = of_pairs(structure)
        on_root(comm, lambda: (folder / "mu.csv").write_text(text))
        keys = {"friction": {"joint": mu}}
    response = microslip.respond(structure, error_bars=False, **keys)
    with microslip.build(scene_of(comm, folder, STATICS, *COMMON, RANGE, change, name="new"), comm) as fresh:
        assert_same(response, microslip.respond(fresh, error_bars=False))
    assert any(line.startswith("rest found in") for line in response.notes)
    assert np.abs(response.prepared.pairs.T0 - structure.pairs.T0).max() > 1e-3 * np.abs(structure.pairs.T0).max()


@pytest.fixture
def factored(monkeypatch):
    """Return a function that starts a list of computed factors and forbids meshes and matrices from then on."""

    def begin():
        factored, factorise = [], factors.factorise
        monkeypatch.setattr(factors, "factorise", lambda *of, **how: factored.append(of) or factorise(*of, **how))
        for name in ("read_completed", "read_mesh", "pair_contacts", "distribute", "assemble"):
            monkeypatch.setattr(library_build, name, None)
        monkeypatch.setattr("microslip.statics.reference_state.constant_forces", None)
        return factored

    return begin


def test_unchanged_stages_are_not_repeated(comm, folder, factored):
    structure = microslip.build(scene_of(comm, folder, STATICS, *COMMON, RANGE, name="unchanged"), comm)
    factored = factored()
    first = microslip.respond(structure, error_bars=False, friction=0.24)
    assert len(factored) == 2  # factors of the reference structure and of that at rest
    microslip.respond(structure, error_bars=False, friction=0.24, levels=[2.0, 7.0])
    assert len(factored) == 2
    _, u = first.fields(5.0, 4665.0)
    microslip.respond(structure, error_bars=False, friction=0.22)
    assert len(factored) == 3  # the factor of the reference structure is used again
    u_again = first.fields(5.0, 4665.0)[1]
    assert u_again == pytest.approx(u, abs=1e-9 * np.abs(u).max()) and len(factored) == 4
    at_first_rest = first.prepared.structure
    assert at_first_rest.modes.omega_n == pytest.approx(first.prepared.structure.omega_n, rel=1e-10) and len(factored) == 4
    stated = microslip.respond(structure, error_bars=False, friction=0.3)
    assert stated.prepared.structure is structure and len(factored) == 4
    all_factors = [each.linearised.factor for each in (structure, at_first_rest)]
    structure.close()
    assert all(factor._solver is None for factor in all_factors) and "flexibility" not in vars(structure.reference)


@pytest.fixture
def stiffnesses(monkeypatch):
    """Return a list of all structures whose stiffness at rest is assembled from now on."""
    assembled = []
    assemble = reference_state.stiffness_at_rest
    monkeypatch.setattr(reference_state, "stiffness_at_rest", lambda *of: assembled.append(assemble(*of)) or assembled[-1])
    return assembled


def test_matrices_of_a_replaced_rest_are_freed(comm, folder, stiffnesses):
    structure = microslip.build(scene_of(comm, folder, STATICS, *COMMON, RANGE, name="freed"), comm)
    for friction in (0.24, 0.26, 0.22):
        microslip.respond(structure, error_bars=False, friction=friction)
    assert [bool(about.K) for about in stiffnesses] == [
        True,
        False,
        False,
        True,
    ]  # only those of the structure and of its last rest remain
    system, reference = structure.linearised.system, structure.reference.system
    structure.close()
    assert not any(about.K for about in stiffnesses) and not any([system.K, system.M, reference.K])
    with pytest.raises(CaseError, match="the structure is closed"):
        microslip.respond(structure, friction=0.24)


def test_a_run_frees_the_stiffness_of_the_unloaded_structure(comm, folder, monkeypatch):
    reference, find_rest = [], library_build.find_rest
    monkeypatch.setattr(library_build, "find_rest", lambda of, *more: reference.append(of) or find_rest(of, *more))
    scene = scene_of(comm, folder, STATICS, *COMMON, RANGE, name="run")
    with library_build.build(scene, comm, keeps_reference=False) as structure:
        assert not reference[0].system.K and structure.linearised.system.K and structure.linearised.system.M


SAME_STUCK_STRUCTURE = {
    "nothing slides": (eccentric(1000.0), 0.9),
    "no stress stiffening": ("stress_stiffening = false\n" + force(150.0, 50.0, -1000.0), 0.25),
}


@pytest.mark.parametrize("name", SAME_STUCK_STRUCTURE)
def test_an_unchanged_stuck_structure_has_the_same_factor_and_modes(comm, folder, factored, name):
    statics, friction = SAME_STUCK_STRUCTURE[name]
    stated = ("friction = 0.3", "friction = 0.8")
    with microslip.build(scene_of(comm, folder, statics, *COMMON, RANGE, stated, name="same"), comm) as structure:
        factored = factored()
        response = microslip.respond(structure, error_bars=False, friction=friction)
        assert len(factored) == 1 and response.prepared.structure.projected is structure.projected
        assert response.prepared.structure.linearised.factor is structure.linearised.factor
        assert np.array_equal(response.prepared.pairs.mu, np.full(structure.pairs.n_pairs, friction))
        assert np.array_equal(response.prepared.pairs.open_at_rest, structure.pairs.open_at_rest)


def test_impossible_changes_are_refused_and_do_not_change_the_structure(comm, folder, structure):
    with pytest.raises(ConvergenceError, match="no equilibrium beyond"):
        microslip.respond(structure, friction=0.02)
    with pytest.raises(
        CaseError, match=r"respond: friction of joint 'joint': a number of at least 0 is expected, or one for each"
    ):
        microslip.respond(structure, friction=[0.1, 0.2])
    with pytest.raises(CaseError, match="ask the structure that was built"):
        microslip.respond(replace(structure, reference=None), friction=0.5)
    gap = ('preload = "static"', 'preload = "static"\ngap = 1e-6')
    with microslip.build(scene_of(comm, folder, eccentric(1000.0), gap, name="gap"), comm) as with_gap:
        with pytest.raises(CaseError, match="an open pair carries no preload|an open joint carries no preload"):
            microslip.respond(with_gap, preload=1e5)
    assert microslip.respond(structure, error_bars=False).prepared.structure is structure
