"""A branch that is stored between two steps and restored continues bit for bit; on any number of ranks."""

import numpy as np
import pytest
from dense_model import forced, reduced
from mpi4py import MPI
from oracles import scenes
from verification import extreme_structures as structures

from microslip.continuation.accuracy import Accuracy, Resolution, steps_for
from microslip.continuation.checkpoint import from_arrays, over, parts_of, state_arrays
from microslip.continuation.follow import advance
from microslip.continuation.point_record import HELD
from microslip.continuation.point_solver import Workspace
from microslip.continuation.steps import ArcLength
from microslip.continuation.task import BranchTask
from microslip.error_estimate.estimate import ErrorEstimator
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic import adjoint_solver, newton_solver
from microslip.points.selection import AllPairs, NonStickingPairs
from microslip.points.sweep import Sweep
from microslip.receptance.truncated_modes import EnrichedModel

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM = MPI.COMM_WORLD
STEPS = ArcLength(ds=0.05, ds_min=1e-5, ds_max=0.1)


def chain_task(selection=None, with_accuracy=False, level=100.0):
    system = scenes.chain()
    model, law = reduced(system, COMM, 3)
    estimator = ErrorEstimator(EnrichedModel.of_all_modes(model))
    accuracy = Accuracy(1e-2, Resolution(Harmonics.up_to(1), 16, 1e-4)) if with_accuracy else None
    steps = steps_for(1e-2) if with_accuracy else STEPS
    sweep, selection = Sweep(520.0, 640.0, (540.0,)), selection or AllPairs()
    return BranchTask(forced(model, law, 128, level), selection, sweep, steps, 1e-9, estimator, accuracy)


def free_task():
    """A body on its joint alone, all pairs of which slip at the first point: its mean slip is held."""
    system = structures.free_body(rayleigh=(0.8, 0.0))
    model, law = reduced({**system, "C": 0.8 * system["M"]}, COMM, 3)
    return BranchTask(forced(model, law, 128, 17.0), AllPairs(), Sweep(0.8, 1.2), STEPS, 1e-9)


def to_arrays(task, state):
    """Return a state between two steps, as a run stores it.  Collective."""
    return state_arrays(state) | {
        name: a for key, part in parts_of(task, state).items() for name, a in over(key, part.arrays()).items()
    }


def on_disk(arrays, path):
    """Return arrays as another process would read them."""
    if COMM.rank == 0:
        np.savez(path, **arrays)
    COMM.barrier()
    with np.load(path, allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


def followed(make, n_steps, path=None):
    """Return the points of the first steps; with a ``path`` each step starts from the stored state of the previous one."""
    task, points = make(), []
    workspace = Workspace(task.problem.equation)
    state = task.start(workspace)
    for _ in range(n_steps):
        if state.is_done:
            break
        if path is not None and state.now is not None:
            arrays = on_disk(to_arrays(task, state), path)
            workspace.destroy()
            task = make()
            workspace = Workspace(task.problem.equation)
            state = from_arrays(task, arrays, workspace)
        step = advance(task, state)
        assert step.failure is None, step.failure
        state = step.state
        points += step.points
    workspace.destroy()
    if task.estimator is not None:
        task.estimator.destroy()
    return points


@pytest.mark.slow
@pytest.mark.parametrize(
    "with_preconditioners", [pytest.param(False, marks=pytest.mark.ranks(1)), pytest.param(True, marks=pytest.mark.ranks(2))]
)
@pytest.mark.parametrize(
    "make",
    [
        pytest.param(chain_task, marks=pytest.mark.ranks(1)),
        lambda: chain_task(with_accuracy=True),
        pytest.param(lambda: chain_task(NonStickingPairs(checks_in_point=True)), marks=pytest.mark.ranks(1)),
        lambda: chain_task(level=1e-3),
        pytest.param(free_task, marks=pytest.mark.ranks(1)),
    ],
    ids=["plain", "accuracy", "adaptive", "stuck", "held"],
)
def test_a_restored_branch_continues_bit_for_bit(make, with_preconditioners, monkeypatch, shared_path):
    if with_preconditioners:  # built early, and used for several points
        monkeypatch.setattr(newton_solver, "MANY_KRYLOV", 2)
        monkeypatch.setattr(newton_solver, "LARGEST", 30)
        monkeypatch.setattr(adjoint_solver, "MANY_KRYLOV", 2)
        monkeypatch.setattr(adjoint_solver, "DIRECT", 0)
    n_steps = 6 if make is free_task else 14
    at_once, in_pieces = followed(make, n_steps), followed(make, n_steps, str(shared_path / "state.npz"))
    assert len(at_once) == len(in_pieces) >= n_steps - 4
    assert (HELD in at_once[0].notes) == (make is free_task)
    for a, b in zip(at_once, in_pieces):
        for name in ("omega", "response", "U", "p", "energy", "state", "newton", "krylov", "harmonics", "samples", "notes"):
            assert np.array_equal(getattr(a, name), getattr(b, name)), name
        assert (a.error is None) == (b.error is None)
        assert a.error is None or np.array_equal(a.error, b.error)


def test_a_stored_state_has_the_same_arrays_on_any_number_of_ranks(shared_path):
    """All ranks gather the same complete arrays."""
    task = chain_task()
    workspace = Workspace(task.problem.equation)
    state = task.start(workspace)
    for _ in range(5):
        state = advance(task, state).state
    arrays = to_arrays(task, state)
    workspace.destroy()
    task.estimator.destroy()
    for name in ("earlier", "before", "now"):
        assert arrays[f"{name}/U"].shape == (2, 3, 7)
    assert arrays["now/parameters"].shape == (1,)
