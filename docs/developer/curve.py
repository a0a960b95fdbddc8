"""The demo's curve at 5 N by the inner functions of the program, one call a stage, with the shapes that they return.

python docs/developer/curve.py        after meshes/fan_small.msh is there (make demo)
mpirun -n 2 python docs/developer/curve.py
"""

from dataclasses import replace
from pathlib import Path

from microslip.parallel.petsc import everyone, initialise

initialise()
from microslip.assembly.assemble import assemble
from microslip.continuation.follow import follow_branch
from microslip.continuation.levels import arc_length_steps, frequency_sweep, linear_curve
from microslip.continuation.problems import ForcedResponse
from microslip.continuation.task import BranchTask
from microslip.fourier.coefficients import amplitude
from microslip.harmonic.balance import HarmonicBalance
from microslip.library.complete import read_completed
from microslip.library.settings import excitation, reduction_settings, response_settings
from microslip.linear.contact_outputs import with_contact_forces
from microslip.linear.joint_springs import linearise
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.read import read_mesh
from microslip.modes.eigen import lowest_modes
from microslip.parallel.agree import on_root
from microslip.receptance.reduced_model import ReducedModel
from microslip.reduction.methods import reduce_by_method
from microslip.reduction.stuck import StuckStructure, static_response
from microslip.scene.read import read_scene

SCENE = Path(__file__).parents[2] / "jobs" / "fan_small.toml"


def curve(level=5.0, n_modes=20, points=24, comm=None, show=print):
    """Return the branch of a level [N]: its points, each with omega, the motion U of the pairs and the outputs' response."""
    comm = comm or everyone()

    # the scene, completed by what its model file states; mesh and assembly take its tables, later stages settings made of it
    file, scene, _ = read_completed(on_root(comm, read_scene, SCENE), comm)

    # mesh and pairs exist on rank 0 and everywhere; elements are distributed
    mesh = on_root(comm, read_mesh, scene, file, share=False)
    pairs = on_root(comm, pair_contacts, mesh, scene.joints)
    shares = distribute(mesh, scene, comm)
    show(f"pairs: frames {pairs.frame.shape}, area {pairs.area.shape}, k_t {pairs.k_t.shape}")

    # K, M and the sparse maps: du = R u, responses = outputs u
    system = with_contact_forces(assemble(shares, mesh, pairs, scene), pairs, scene.outputs)
    show(f"K, M {system.K.getSize()}, R {system.R.shape}, loads {system.loads.shape}, outputs {system.outputs.shape}")

    # K_L = K + R^T K_J R, all pairs stuck, and its one factor
    linearised = linearise(system, pairs)
    statics = static_response(linearised)  # columns of G_static are solved for when a pair first slips
    modes = lowest_modes(linearised, n_modes)
    show(f"omega_n {modes.omega_n.shape}, rows of phi on this rank {modes.phi_owned.shape}")

    # by the scene's method, receptance: G_n of the pairs; under its loads and with its harmonics the reduced model
    stuck = StuckStructure.of(linearised, pairs, statics, modes)
    reduction = reduce_by_method(stuck, reduction_settings(scene))
    model = ReducedModel.of(reduction.structure, excitation(scene))
    show(f"reduced: {model.n_pairs} pairs, {model.n_modes} modes, U ({3 * model.n_pairs}, {model.N_H})")

    # the equation r = U - U_lin + G p, the problem (what its parameters stand for), and the task (range, steps, tolerance)
    settings = replace(response_settings(scene), points=points)
    problem = ForcedResponse(HarmonicBalance.of_all(model, pairs.law, settings.samples), level)
    sweep = frequency_sweep(settings, modes.omega_n)
    steps = arc_length_steps(settings, linear_curve(model, sweep))
    branch = follow_branch(BranchTask(problem, reduction.selection, sweep, steps, settings.tolerance), 10 * points)
    peak = max(branch.points, key=lambda point: amplitude(point.response[0]))
    show(f"{len(branch.points)} points; U on this rank {peak.U.shape}, response {peak.response.shape}")
    show(f"peak {amplitude(peak.response[0]):.4g} m at {peak.omega / 6.283185307:.5g} Hz, {(peak.state == 1).sum()} pairs slip")
    linearised.destroy()
    return branch


if __name__ == "__main__":
    world = everyone()
    curve(show=print if world.rank == 0 else lambda line: None)
