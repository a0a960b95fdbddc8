"""Computations in lockstep: one call answers the requests of all, and an error ends all."""

from functools import partial

import numpy as np
import pytest
from discs import write_sector
from greenlet import getcurrent
from mpi4py import MPI

from microslip.assembly.real_form import real_columns
from microslip.library.build import assembled, build
from microslip.linear.dense import multiply
from microslip.linear.lockstep import after_others, at_once, in_lockstep
from microslip.linear.mumps import MumpsFactor
from microslip.linear.sector_factor import SectorFactor
from microslip.messages.errors import ResourceError
from microslip.modes import eigen, shift_invert
from microslip.modes.eigen import lowest_modes
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.parallel.petsc import free
from microslip.reduction import choose_modes
from microslip.reduction.memory_of_modes import memory_of_diameter
from microslip.scene.read import read_scene
from microslip.studies.modes.disc import _structures, modes_by_diameter

COMM = MPI.COMM_WORLD
END = "[damping]\nratio = 0.01\n[response]\nlevels = [1.0]\nfrequencies = [1400.0, 1410.0]\npoints = 3\n[solver]\nmodes = 4\n"


class Squares:
    """Squares of numbers; ``sizes`` lists how many each call computes."""

    def __init__(self):
        self.sizes = []

    def __call__(self, numbers):
        self.sizes.append(len(numbers))
        return [number**2 for number in numbers]


def sum_of_squares(squares, n, order):
    """Return the sum of the first n squares; ``order`` records the end of each computation."""
    total = sum(at_once(squares, number) for number in range(n))
    after_others(lambda: order.append(-n))
    order.append(n)
    return total


@pytest.mark.ranks(1)
def test_one_call_answers_the_requests_of_all():
    squares, order = Squares(), []
    assert in_lockstep([partial(sum_of_squares, squares, n, order) for n in (2, 4, 0, 3)]) == [1, 14, 0, 5]
    assert squares.sizes == [3, 3, 2, 1]
    assert order == [0, -2, -3, -4, 2, 4, 0, 3]  # after the last computation has all of its squares
    assert sum_of_squares(squares, 3, order) == 5 and squares.sizes[4:] == [1, 1, 1]  # without others
    assert in_lockstep([]) == []


@pytest.mark.ranks(1)
def test_different_functions_are_called_separately():
    squares, others = Squares(), Squares()
    assert in_lockstep([partial(at_once, function, n) for function, n in ((squares, 2), (others, 3), (squares, 4))]) == [4, 9, 16]
    assert squares.sizes == [2] and others.sizes == [1]


@pytest.mark.ranks(1)
def test_cheap_requests_are_answered_first():
    """The expensive request of the second computation follows two cheap ones and is answered with that of the first."""
    cheap, expensive = Squares(), Squares()

    def computation(n_cheap):
        return sum(at_once(cheap, 1, is_cheap=True) for _ in range(n_cheap)) + at_once(expensive, 2)

    assert in_lockstep([partial(computation, n) for n in (0, 2, 1)]) == [4, 6, 5]
    assert cheap.sizes == [2, 1] and expensive.sizes == [3]


@pytest.mark.ranks(1)
@pytest.mark.parametrize("where", ["answer", "computation"])
def test_an_error_ends_all_waiting_computations(where):
    ended, hub = [], getcurrent()

    def answers(requests):
        if where == "answer":
            raise ValueError("no answer")
        return requests

    def computation(number):
        try:
            at_once(answers, number)
            if number == 1:
                raise ValueError("no answer")
            at_once(answers, number)
        finally:
            ended.append(number)

    with pytest.raises(ValueError, match="no answer"):
        in_lockstep([partial(computation, number) for number in range(3)])
    assert sorted(ended) == [0, 1, 2] and getcurrent() is hub


@pytest.fixture
def disc(shared_path, monkeypatch):
    """Return a disc of six sectors; SLEPc computes its modes."""
    monkeypatch.setattr(eigen, "_DENSE", 0)
    monkeypatch.setattr(eigen, "SHARE", 1)
    return assembled(read_scene(on_root(COMM, lambda: write_sector(shared_path, 6, END))), COMM, RunLog(COMM, screen=False))


@pytest.mark.ranks(1, 2, 3)
def test_modes_in_lockstep_equal_those_of_separate_searches(disc, monkeypatch):
    log, passes = RunLog(COMM, screen=False), []
    one_pass = MumpsFactor.reduced
    monkeypatch.setattr(MumpsFactor, "reduced", lambda self, B: passes.append(B.shape[1]) or one_pass(self, B))
    structures = _structures(disc, [1, 2, 3], log)  # diameter 3 is real
    searches = [partial(lowest_modes, structure, 4) for structure in structures.values()]
    separate, n_separate = [search() for search in searches], len(passes)
    together = in_lockstep(searches)
    assert len(passes) - n_separate < n_separate / 2
    for modes, other in zip(separate, together):
        assert modes.info["proof"].split(" below")[0] == other.info["proof"].split(" below")[0]
        np.testing.assert_allclose(other.omega_n, modes.omega_n, rtol=1e-10)
    for structure in structures.values():
        structure.destroy()


@pytest.mark.ranks(1, 2, 3)
def test_a_whole_disc_searches_all_diameters_in_lockstep_with_few_shifts(shared_path, monkeypatch):
    monkeypatch.setattr(eigen, "_DENSE", 0)
    monkeypatch.setattr(eigen, "SHARE", 1)
    monkeypatch.setattr(choose_modes, "FEW", 0)
    monkeypatch.setattr(choose_modes, "_AT_ONCE", 0)
    together, shifts, solved, count = [], set(), SectorFactor.solved, SectorFactor.count_below
    counted = lambda self, requests: together.append(len(requests)) or solved(self, requests)  # noqa: E731
    recorded = lambda self, sigma, system: shifts.add(sigma) or count(self, sigma, system)  # noqa: E731
    monkeypatch.setattr(SectorFactor, "solved", counted)
    monkeypatch.setattr(SectorFactor, "count_below", recorded)
    end = END.replace("modes = 4", "accuracy = 0.1")
    path = on_root(COMM, lambda: write_sector(shared_path, 6, end, wave={"engine_order": 1, "whole": True}))
    disc = build(read_scene(path), COMM)
    assert max(together) == 4 and len(shifts) < 3
    for group in disc.tuned:
        assert group.n_proved >= group.n_modes
        np.testing.assert_allclose(group.omega_n, lowest_modes(group.linearised, group.n_modes).omega_n, rtol=1e-10)
    disc.close()


@pytest.mark.ranks(1, 2, 3)
def test_a_step_has_two_products_with_M(disc, monkeypatch):
    """Of the four products of a step two need no multiplication, and both diameters share one product."""
    structures, steps, products = _structures(disc, [1, 2], RunLog(COMM, screen=False)), [], []
    one_pass, multiplied = MumpsFactor.reduced, shift_invert._ProductsAtOnce.__call__
    counted = lambda self, blocks: products.append(len(blocks)) or multiplied(self, blocks)  # noqa: E731
    monkeypatch.setattr(MumpsFactor, "reduced", lambda self, B: steps.append(B.shape[1]) or one_pass(self, B))
    monkeypatch.setattr(shift_invert._ProductsAtOnce, "__call__", counted)
    fewer = in_lockstep([partial(lowest_modes, structure, 12) for structure in structures.values()])
    assert sum(products) < 2.1 * sum(steps) / 2 and len(products) < 0.6 * sum(products)
    monkeypatch.setattr(shift_invert, "_with_fewer_products", lambda M: M)
    for modes, structure in zip(fewer, structures.values()):
        np.testing.assert_allclose(modes.omega_n, lowest_modes(structure, 12).omega_n, rtol=1e-10)
        structure.destroy()


@pytest.mark.ranks(1, 2)
def test_products_with_multiples_of_a_vector_are_reused(disc, monkeypatch):
    """A complex multiple of the last vector, to rounding, needs no product; another vector is multiplied."""
    structure, products = _structures(disc, [1], RunLog(COMM, screen=False))[1], []
    multiplied = shift_invert._ProductsAtOnce.__call__
    counted = lambda self, blocks: products.append(1) or multiplied(self, blocks)  # noqa: E731
    monkeypatch.setattr(shift_invert._ProductsAtOnce, "__call__", counted)
    M = structure.M
    M_reused, x, y = shift_invert._with_fewer_products(M), M.createVecRight(), M.createVecLeft()
    z = np.random.default_rng(COMM.rank).normal(size=(2, M.getLocalSize()[0] // 2, 1)).T.copy().view(complex)[0]
    for factor, change, n in ((1.0, 0.0, 1), (0.3 - 2.0j, 1e-15, 1), (1.0, 1e-9, 2), (0.0, 0.0, 2)):
        x.setArray(real_columns(factor * z + change * z[::-1])[:, 0])
        M_reused.mult(x, y)
        np.testing.assert_allclose(y.getArray(), multiply(M, x.getArray()[:, None])[:, 0], rtol=1e-9, atol=1e-20)
        assert len(products) == n
    free(M_reused, x, y)
    structure.destroy()


@pytest.mark.ranks(1, 2)
def test_a_solve_that_fails_ends_all_searches(disc, monkeypatch):
    one_pass, n = MumpsFactor.reduced, iter(range(1000))

    def failing(self, B):
        if next(n) == 8:
            raise ResourceError("no memory")
        return one_pass(self, B)

    log = RunLog(COMM, screen=False)
    with monkeypatch.context() as changed, pytest.raises(ResourceError, match="no memory"):
        changed.setattr(MumpsFactor, "reduced", failing)
        next(modes_by_diameter(disc, None, 4, range(4), log))
    structure, n = _structures(disc, [1], log)[1], iter(range(1000))
    with monkeypatch.context() as changed, pytest.raises(ResourceError, match="no memory"):  # a single search
        changed.setattr(MumpsFactor, "reduced", failing)
        lowest_modes(structure, 4)
    assert len(lowest_modes(structure, 4).omega_n) == 4
    structure.destroy()


@pytest.mark.ranks(1, 2)
def test_the_memory_of_a_search_is_that_of_its_space_and_its_factor(disc):
    linearised = _structures(disc, [1], RunLog(COMM, screen=False))[1]
    n_dof, n_basis = linearised.maps.n_dof, lowest_modes(linearised, 4).info["basis"]
    n_face = linearised.factor.info["face"]
    of_complex = 16.0 * (n_dof * (n_basis + 1) + n_face * (n_face + 1) // 2)
    assert memory_of_diameter(disc.rest.system.sectors, 4, n_dof) == of_complex
    linearised.destroy()
