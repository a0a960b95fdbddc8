"""A disc from one sector, [cyclic], compared with the full ring built from all sectors; on any number of ranks."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from blocks import block, join
from discs import at, of_ring, write_ring, write_sector
from exact_jenkins import ExactJenkins
from mpi4py import MPI
from msh import write_msh
from oracles.exact import jenkins_harmonic
from scene_text import joint, steel, table
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.balance import HarmonicBalance
from microslip.harmonic.operating_point import OperatingPoint
from microslip.library.backbone import backbone
from microslip.library.build import build
from microslip.library.follow_response import follow
from microslip.library.prepare import prepare
from microslip.library.respond import respond
from microslip.mesh.cyclic import cyclic_faces
from microslip.mesh.read import read_mesh
from microslip.messages.errors import MicroslipError
from microslip.parallel.agree import on_root
from microslip.results.fields import read_fields
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
N_DOF, N_SHROUDED = 54, 90  # of a sector of hex8, without and with shrouds


def end(modes, levels=(10.0,), frequencies=(1400.0, 1500.0), points=(), **solver):
    """Return the tables of damping, response and solver."""
    more = "".join(f"{key} = {str(value).lower()}\n" for key, value in ({"harmonics": 3, "error_bars": False} | solver).items())
    stated = f"at = {list(points)}\n" if points else ""
    return (
        f"[damping]\nratio = 0.01\n[response]\nlevels = {list(levels)}\nfrequencies = {list(frequencies)}\n{stated}points = 8\n"
        f"[solver]\nmodes = {modes}\n{more}"
    )


def built(write, folder, *args, **how):
    """Return the structure of a scene that rank 0 writes.  Collective."""
    return build(read_scene(on_root(COMM, lambda: write(folder, *args, **how))), COMM)


@pytest.mark.study
@pytest.mark.parametrize("order", [3, -2])
def test_a_wave_in_the_other_direction_has_the_modes_of_its_mirror_image(shared_path, order):
    """Its harmonic 1 has the conjugate matrices of nodal diameter 2, whose modes are computed."""
    by_accuracy = end(1, harmonics=3, error_bars=True).replace("modes = 1\n", "accuracy = 0.01\n")
    waves = [built(write_sector, shared_path, 5, by_accuracy, wave={"engine_order": h}) for h in (order, 2)]
    numbers = [[len(wave.per_group.of(n).omega_n) for n in (1, 2, 3)] for wave in waves]
    assert [wave.group for wave in waves] == [3, 2] and numbers[0] == numbers[1]
    peaks = [max(np.hypot(*point.response[0, 1:3]) for point in respond(wave).branches[0].points) for wave in waves]
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-2)


@pytest.mark.parametrize(
    ("N", "kind"),
    [
        pytest.param(3, "hex8", marks=pytest.mark.ranks(1)),
        (5, "hex8"),
        (6, "hex8"),
        pytest.param(5, "hex20", marks=pytest.mark.ranks(1)),
    ],
)
def test_modes_of_all_nodal_diameters_are_those_of_the_ring(shared_path, N, kind):
    sector, ring = built(write_sector, shared_path, N, end(12), kind), built(write_ring, shared_path, N, end(8 * N), kind)
    groups = sector.per_group
    assert groups.groups == tuple(range(N)) and sector.group == 1
    of_diameters = [groups.of_group(d) for d in range(N)]
    assert [each.is_complex for each in of_diameters] == [0 < 2 * d % N != 0 for d in range(N)]
    omega_n = np.sort(np.concatenate([each.omega_n for each in of_diameters]))
    n = 5 * N
    np.testing.assert_allclose(omega_n[:n], ring.omega_n[:n], rtol=1e-11)
    for d in range(1, (N + 1) // 2):
        forward, backward = of_diameters[d], of_diameters[N - d]
        np.testing.assert_array_equal(forward.projected.R_phi.conj(), backward.projected.R_phi)
        assert forward.linearised is backward.linearised  # one factor for both directions
    sector.close()
    ring.close()


def test_complex_modes_are_orthonormal_and_verified_complete(shared_path):
    how = {"divisions": (2, 2, 2), "span": 3}
    sector = built(write_sector, shared_path, 7, end(10), "hex20", how=how)
    assert sector.is_complex and sector.n_dof > 700 and sector.n_proved >= 10
    modes = sector.modes
    assert "SLEPc" in modes.info["method"] and "modes below" in modes.info["proof"]
    phi = modes.phi_owned
    overlap = COMM.allreduce(phi.conj().T @ sector.product(sector.M, phi))
    np.testing.assert_allclose(overlap, np.eye(10), atol=1e-9)
    energy = COMM.allreduce(phi.conj().T @ sector.product(sector.K_L, phi))
    np.testing.assert_allclose(energy, np.diag(sector.omega_n**2), atol=1e-7 * sector.omega_n[-1] ** 2)
    sector.close()


WAVES = [  # engine orders N/2, 1, 2 and N + 1; stuck, and where sliding pairs slide in each cycle
    (6, 3, 1416.0, 0.01, 0.3),
    pytest.param(5, 1, 1436.0, 20.0, 0.05, marks=pytest.mark.ranks(1)),
    pytest.param(5, 2, 1420.0, 20.0, 0.05, marks=pytest.mark.ranks(1)),
    pytest.param(6, 7, 1436.0, 20.0, 0.05, marks=pytest.mark.ranks(1)),
]


def response_at(shared_path, write, modes, frequency, level, **how):
    """Return the output's coefficients at a frequency, the number of pairs that slip, and the loss by damping.  Collective."""
    near = (0.995 * frequency, 1.005 * frequency)
    solved = end(modes, (level,), near, (frequency,), tolerance=1e-10, samples=120)
    structure = built(write, shared_path, how.pop("N"), solved, **how)
    branch = respond(structure).level(level)
    assert not branch.failure
    i = int(np.argmin(np.abs(branch.frequency - frequency)))
    assert branch.frequency[i] == pytest.approx(frequency, rel=1e-12)
    structure.close()
    return branch.response[i, 0], int((branch.state[i] == 1).sum()), float(branch.damping[i])


@pytest.mark.parametrize(("N", "h", "frequency", "level", "friction"), WAVES)
def test_the_response_is_that_of_the_ring(shared_path, N, h, frequency, level, friction):
    how = {"N": N, "friction": friction}
    sector, n_slip, _ = response_at(shared_path, write_sector, N_DOF, frequency, level, wave={"engine_order": h}, **how)
    ring, n_slip_of_ring, _ = response_at(shared_path, write_ring, N * N_DOF, frequency, level, h=h, **how)
    assert n_slip_of_ring == N * n_slip and (n_slip > 0) == (level > 1.0)
    np.testing.assert_allclose(sector, ring, atol=1e-6 * np.abs(ring).max())


REST = [  # the last case without mean and second harmonic
    pytest.param(6, 3, False, 1416.0, 20.0, 0.3, 3, marks=pytest.mark.ranks(1)),
    (5, 1, True, 1000.0, 30.0, 0.1, 3),
    pytest.param(5, 1, False, 1436.0, 20.0, 0.1, [1, 3], marks=pytest.mark.ranks(1)),
]


@pytest.mark.parametrize(("N", "h", "shroud", "frequency", "level", "friction", "harmonics"), REST)
def test_the_wave_solves_the_ring_with_sliders_at_rest_after_slip(
    shared_path, N, h, shroud, frequency, level, friction, harmonics
):
    """Sliders of each sector start at its phase, with any number of samples.  With start 0 in all sectors the ring is no wave."""
    n_dof, how = N_SHROUDED if shroud else N_DOF, {"friction": friction, "how": {"shroud": shroud}}
    solved = end(
        n_dof, (level,), (0.999 * frequency, 1.001 * frequency), (frequency,), tolerance=1e-11, samples=64, harmonics=harmonics
    )
    sector = built(write_sector, shared_path, N, solved, wave={"engine_order": h}, **how)
    branch = respond(sector).level(level)
    i = int(np.argmin(np.abs(branch.frequency - frequency)))
    ring = built(write_ring, shared_path, N, end(N * n_dof, samples=64, harmonics=harmonics), h=h, **how)
    U = COMM.bcast(of_ring(sector.pairs, ring.pairs, N, h, branch.arrays["du"][i]) if COMM.rank == 0 else None)
    at = OperatingPoint(2.0 * np.pi * branch.frequency[i], level)
    values = {}
    for name, law in (("started", ring.pairs.law), ("at 0", ring.pairs.law.law)):
        equation = HarmonicBalance.of_all(prepare(ring).model, law, 64)
        owned = Harmonics.full(7).carry(U[equation.model.owned], equation.harmonics)
        residual = equation.residual(owned, at, equation.contact_forces(owned, equation.every_pair, tangents=False))
        values[name] = COMM.allreduce(np.abs(residual).max(initial=0.0), MPI.MAX) / np.abs(U).max()
    sector.close()
    ring.close()
    assert values["started"] < 1e-9 and values["at 0"] > 1e-5, values


@pytest.mark.ranks(1)
def test_the_response_with_shrouds_is_that_of_the_ring(shared_path):
    """The shrouds slide on those of the neighbouring sectors."""
    h, how = 1, {"N": 5, "friction": 0.05, "how": {"shroud": True}}
    sector, n_slip, _ = response_at(shared_path, write_sector, N_SHROUDED, 1000.0, 50.0, wave={"engine_order": h}, **how)
    ring, n_slip_of_ring, _ = response_at(shared_path, write_ring, 5 * N_SHROUDED, 1000.0, 50.0, h=h, **how)
    assert n_slip_of_ring == 5 * n_slip > 0
    np.testing.assert_allclose(sector, ring, atol=1e-6 * np.abs(ring).max())


def test_the_response_with_dampers_between_blades_is_that_of_the_ring(shared_path):
    """A body of the sector slides on the blade of this sector and of the next; it has no other support."""
    how, n_dof = {"N": 4, "friction": 0.05, "how": {"damper": True}}, 90
    sector, n_slip, _ = response_at(shared_path, write_sector, n_dof, 1540.0, 20.0, wave={"engine_order": 1}, **how)
    ring, n_slip_of_ring, _ = response_at(shared_path, write_ring, 4 * n_dof, 1540.0, 20.0, h=1, **how)
    assert n_slip_of_ring == 4 * n_slip > 0
    np.testing.assert_allclose(sector, ring, atol=1e-6 * np.abs(ring).max())


@pytest.mark.ranks(1)
def test_a_wave_equals_its_alias_and_has_the_power_of_the_opposite_wave(shared_path):
    """h and h + N are one wave; the power of h and -h under the same force is equal by reciprocity, if stuck."""
    by_key = {h: response_at(shared_path, write_sector, N_DOF, 1420.0, 0.01, wave={"engine_order": h}, N=5) for h in (2, -2, 3)}
    for k in range(3):
        np.testing.assert_allclose(by_key[3][k], by_key[-2][k], rtol=1e-12, atol=1e-12 * np.abs(by_key[3][k]).max())
    assert by_key[2][2] == pytest.approx(by_key[-2][2], rel=1e-11) and by_key[2][2] > 0.0
    assert (
        np.abs(by_key[2][0] - by_key[-2][0]).max() > 1e-3 * np.abs(by_key[2][0]).max()
    )  # an output at another point than the force differs


def refused(shared_path, **how) -> str:
    """Return the message of a rejected sector.  Collective."""
    wave, keys = how.pop("wave", {"engine_order": 1}), how.pop("solver", {})
    extra = how.pop("extra", "")
    with pytest.raises(MicroslipError) as error:
        built(write_sector, shared_path, how.pop("N", 5), extra + end(8, **keys), wave=wave, **how)
    COMM.Barrier()  # each rank has read the file before it is written again
    return str(error.value)


def test_inputs_that_are_no_disc_are_rejected_with_one_message(shared_path):
    """Faces, numbers of sectors, waves, supports, and options that a disc does not support."""
    swapped = refused(shared_path, faces=["high0", "low0"])
    assert "lie farther than" in swapped and "swap the two faces" in swapped
    assert "72 degrees apart, which is that of 5 sectors" in refused(shared_path, sectors=6)
    assert "of 5 sectors, with the two faces swapped" in refused(shared_path, sectors=6, faces=["high0", "low0"])
    assert "the worst is node" in refused(shared_path, faces=["low0", "left0"])
    shared = refused(shared_path, faces=["low0", "bore"])
    assert "share" in shared and "a node off the axis lies on one of the two faces" in shared
    assert "no such group in the mesh; nearest is 'high0'" in refused(shared_path, faces=["low0", "high"])
    assert "break the symmetry" in refused(shared_path, held="low0")
    assert "exactly one of engine_order, nodal_diameter" in refused(shared_path, wave={})
    alias = refused(shared_path, wave={"nodal_diameter": 3})
    assert "above half of 5 sectors" in alias and "that of 2, the wave in the other direction" in alias
    assert "wave is missing" in refused(shared_path, wave={"nodal_diameter": 2})
    assert "wave belongs to nodal_diameter" in refused(shared_path, wave={"engine_order": 1, "wave": "forward"})
    assert 'take "receptance"' in refused(shared_path, solver={"method": '"rubin"'})
    assert "harmonics = 0 is a static equilibrium" in refused(shared_path, solver={"harmonics": 0})


def test_engine_order_and_nodal_diameter_give_the_wave_number():
    """Wave numbers h and N - h: the words of the guide for one wave."""
    from microslip.tables.cyclic import Cyclic

    def wave(**keys):
        return Cyclic(sectors=6, axis=(0.0, 0.0, 1.0), faces=("a", "b"), **keys)

    assert wave(engine_order=7).wave_number == 7 and wave(engine_order=7).diameter(1) == 1
    assert wave(nodal_diameter=2, wave="backward").wave_number == 2
    assert wave(nodal_diameter=2, wave="forward").diameter(1) == 4
    assert wave(nodal_diameter=3).diameters == (0, 3) and wave(engine_order=2).diameters == (0, 2, 4)
    assert [wave(engine_order=5).diameter(n) for n in range(4)] == [0, 5, 4, 3]


CHAIN = [  # N = 12 of VALIDATION: wave, force, largest amplitude, its frequency; m = k = k_t = mu N = 1, k_c = 0.25, c = 0.02
    pytest.param(1, 0.1, 2.096420252, 1.150980620, marks=pytest.mark.ranks(1)),
    (1, 1.0, 19.534426293, 1.039333555),
    pytest.param(11, 0.1, 2.096420252, 1.150980620, marks=pytest.mark.ranks(1)),
    pytest.param(6, 0.1, 0.515138855, 2.442395898, marks=pytest.mark.ranks(1)),
    pytest.param(6, 1.0, 0.805313533, 2.145642069, marks=pytest.mark.ranks(1)),
]
RADII = (1.0, 1.1, 1.2)


def write_chain(folder, h, force, omega):
    """Write a rigid block that moves along the axis, joined to the next block by a spring (k_c, no slip) and by friction."""
    alpha, bodies, areas = 2.0 * np.pi / 12, [], []
    for name, r0, r1 in zip(("spring", "friction"), RADII, RADII[1:]):

        def corners(u, v, w, r0=r0, r1=r1):
            r, a = r0 + (r1 - r0) * u, alpha * v
            return np.stack([r * np.cos(a), r * np.sin(a), 0.1 * w], axis=-1)

        bodies.append(block("hex8", corners, (1, 1, 1), {"y0": f"{name}_low", "y1": f"{name}_high"}))
        areas.append(0.1 * (r1 - r0))
    volume = 0.05 * (RADII[-1] ** 2 - RADII[0] ** 2) * np.sin(alpha)
    write_msh(str(folder / "chain.msh"), {"block": join(bodies)})
    hub = table("[points]", name="hub", position=[1.1, 0.0, 0.05], group="block", stiffness=[0.0, 0.0, 1.0])
    path = folder / f"chain_{h}_{force}.toml"
    path.write_text(
        table("model", mesh="chain.msh")
        + steel("block", young=1.0, density=1.0 / volume)  # soft, to avoid rounding errors of its stiffness relative to k
        + hub
        + '[[supports]]\npoint = "hub"\nfix = ["x", "y", "rx", "ry", "rz"]\n'
        + joint("spring_high", "spring_low", name="spring", friction=1e6, k_t=0.25 / areas[0], preload=1.0)
        + "next_sector = true\n"
        + joint("friction_high", "friction_low", name="friction", friction=0.5, k_t=1.0 / areas[1], preload=2.0 / areas[1])
        + "next_sector = true\n"
        + table("cyclic", sectors=12, axis=[0.0, 0.0, 1.0], engine_order=h)
        + '[[loads]]\npoint = "hub"\ndirection = [0.0, 0.0, 1.0]\n'
        + '[[outputs]]\nname = "hub"\npoint = "hub"\ndirection = [0.0, 0.0, 1.0]\n'
        + table("damping", rayleigh=[0.02, 0.0])
        + table("response", levels=[force], frequencies=[0.15, 0.4], at=[omega / (2.0 * np.pi)], points=12)
        + table("solver", harmonics=1, samples=4096, error_bars=False, tolerance=1e-10)
    )
    return path


@pytest.mark.parametrize(("h", "force", "amplitude", "omega"), CHAIN)
def test_a_chain_with_friction_between_neighbours_has_its_closed_form(shared_path, h, force, amplitude, omega):
    structure = built(write_chain, shared_path, h, force, omega)
    branch = respond(structure).level(force)
    assert structure.n_dof == 1 and structure.is_complex == (h != 6)
    i = np.argmin(np.abs(branch.frequency - omega / (2.0 * np.pi)))
    assert branch.frequency[i] == pytest.approx(omega / (2.0 * np.pi), rel=1e-12)
    assert np.hypot(*branch.response[i, 0, 1:3]) == pytest.approx(amplitude, rel=1e-6)
    structure.close()


def amplitude_of_chain(h, force, omega, near):
    """Return the amplitude X of a wave near another amplitude, with Y = s X of the joint and s = 2 sin(pi h / 12).

    (1 + s^2 / 4 + s^2 a1 / Y - omega^2)^2 + (0.02 omega + s^2 b1 / Y)^2 = (F / X)^2.
    """
    s = 2.0 * np.sin(np.pi * h / 12)

    def force_beyond(X):
        a1, b1, _ = jenkins_harmonic(s * X, 1.0, 1.0)
        return X * np.hypot(1.0 + 0.25 * s**2 + s * a1 / X - omega**2, 0.02 * omega + s * b1 / X) - force

    return brentq(force_beyond, 0.99 * near, 1.01 * near, xtol=1e-14 * near, rtol=1e-14)


@pytest.mark.parametrize(("h", "force", "amplitude", "omega"), CHAIN)
def test_a_chain_with_exact_coefficients_of_its_joints_has_its_closed_form(shared_path, h, force, amplitude, omega):
    """Without the error of samples; measured 1e-15 to 5e-12."""
    structure = built(write_chain, shared_path, h, force, omega)
    response = prepare(structure).response
    (branch,) = follow(replace(response, law=ExactJenkins.of(response.law)))
    point = min(branch.points, key=lambda point: abs(point.omega - omega))
    expected = amplitude_of_chain(h, force, omega, amplitude)
    error = np.hypot(*point.response[0, 1:3]) / expected - 1.0
    print(f"wave {h}, force {force:g}: amplitude off by {error:.1e}")
    assert not branch.failure and point.omega == pytest.approx(omega, rel=1e-12)
    assert expected == pytest.approx(amplitude, rel=2e-9)
    assert abs(error) < 1e-9
    structure.close()


@pytest.mark.parametrize("h", (1, pytest.param(6, marks=pytest.mark.ranks(1))))
def test_a_nonlinear_mode_of_the_chain_has_its_closed_form(shared_path, h):
    """A travelling wave, with s = 2 sin(pi h / 12), Y = s X of the joint: omega^2 = 1 + s^2 / 4 + s^2 a1 / Y."""
    structure = built(write_chain, shared_path, h, 0.1, 1.0)
    mode = backbone(structure, farthest=20.0, samples=512)
    s = 2.0 * np.sin(np.pi * h / 12)
    assert mode.failure is None and mode.quasi_static is None
    assert mode.first_slip * s == pytest.approx(1.0, rel=1e-9)
    for point in mode.points[1::3]:
        Y = s * point.amplitude
        a1, b1, loss = jenkins_harmonic(Y, 1.0, 1.0)
        assert point.omega**2 == pytest.approx(1.0 + 0.25 * s**2 + s**2 * a1 / Y, rel=2e-5)
        assert -point.sigma == pytest.approx(0.02 + s**2 * b1 / Y / point.omega, rel=1e-4)
        assert point.friction == pytest.approx(loss, rel=1e-4, abs=1e-4)
    structure.close()


@pytest.mark.parametrize("h", [1, 2])
def test_shrouds_in_contact_with_the_next_sector_are_those_of_the_ring(shared_path, h):
    """Modes, and the response where every pair slides in each cycle."""
    how, N = {"shroud": True}, 5
    sector = built(write_sector, shared_path, N, end(10), how=how, wave={"engine_order": h})
    ring = built(write_ring, shared_path, N, end(50), how=how, h=h)
    assert sector.pairs.n_pairs * N == ring.pairs.n_pairs and sector.pairs.next_sector.sum() == 4
    omega_n = np.sort(np.concatenate([sector.per_group.of_group(d).omega_n for d in range(N)]))
    np.testing.assert_allclose(omega_n[:30], ring.omega_n[:30], rtol=1e-11)
    sector.close()
    ring.close()


THICK_RING = (205.1270, 209.997517, 1104.245, 1116.079)  # VALIDATION: n = 2 out of plane, in plane; n = 4 by the alias of N = 6


def write_thick_ring(folder, N=6, kind="hex20", divisions=(3, 16, 3), shift=0.0):
    """Write a sector of Code_Aster's SDLS109, free; a ``shift`` moves the nodes of its high face."""
    alpha, r, t, w = 2.0 * np.pi / N, 0.369, 0.048, 0.05

    def mapping(u, v, z):
        u, z = u + shift * v * u * (1.0 - u), z - shift * v * z * (1.0 - z)
        radius = r + t * (u - 0.5)
        return np.stack([radius * np.cos(alpha * v), radius * np.sin(alpha * v), w * z], axis=-1)

    write_msh(str(folder / "thick.msh"), {"ring": block(kind, mapping, divisions, {"y0": "low", "y1": "high"})})
    path = folder / "thick.toml"
    path.write_text(
        table("model", mesh="thick.msh")
        + steel("ring", young=1.85e11, poisson=0.3, density=7800.0)
        + table("cyclic", sectors=N, axis=[0.0, 0.0, 1.0], faces=["low", "high"], nodal_diameter=2, wave="backward")
        + table("[loads]", position=[r, 0.0, 0.0], direction=[1.0, 0.0, 0.0])
        + table("[outputs]", name="ring", position=[r, 0.0, 0.0], direction=[1.0, 0.0, 0.0])
        + end(4)
    )
    return path


@pytest.mark.ranks(1)
def test_a_free_ring_has_the_frequencies_of_elasticity(shared_path):
    structure = built(write_thick_ring, shared_path)
    np.testing.assert_allclose(structure.omega_n / (2.0 * np.pi), THICK_RING, rtol=6e-4)
    structure.close()


@pytest.mark.ranks(1)
@pytest.mark.parametrize("N", (5, 6, 8))
def test_frequencies_of_a_free_ring_converge_whatever_the_number_of_sectors(shared_path, N):
    """Out of plane, in plane: errors at N = 5 3.2e-2, 2.8e-2, and with half the element size 2.7e-3, 1.9e-3."""
    errors = []
    for divisions in ((1, 4, 1), (2, 8, 2)):
        structure = built(write_thick_ring, shared_path, N, divisions=divisions)
        errors.append(structure.omega_n[:2] / (2.0 * np.pi * np.array(THICK_RING[:2])) - 1.0)
        structure.close()
    coarse, fine = errors
    print(f"N = {N}: {coarse}, {fine}, ratios {coarse / fine}")
    assert (coarse > 0.0).all() and (fine > 0.0).all()  # from above, as of a conforming mesh
    assert (coarse / fine > [10.0, 14.0]).all()


def frequencies_of_thick_ring(shared_path, n, shift):
    """Return the frequencies of a twelfth of the ring by n x n x n hex8, nodal diameter 2.  Collective."""
    structure = built(write_thick_ring, shared_path, 12, "hex8", (n, n, n), shift)
    structure.close()
    return structure.omega_n


@pytest.mark.ranks(1)
def test_faces_with_different_meshes_converge_to_matched_faces(shared_path):
    """Nodes of the high face on the facets of the low face: measured 4.2e-3 and 6.1e-4 at h and h / 3, nearly second order."""
    of_meshes = [[frequencies_of_thick_ring(shared_path, n, shift) for shift in (0.0, 0.4)] for n in (2, 6)]
    coarse, fine = (np.abs(unlike / alike - 1.0).max() for alike, unlike in of_meshes)
    assert coarse < 5e-3 and fine < coarse / 5.0


def test_faces_with_different_meshes_follow_linear_motions_exactly(shared_path):
    """A motion that rotates with the sectors and is linear in the position: the high face moves as its own nodes do."""

    def deviation():
        scene = read_scene(write_thick_ring(shared_path, 7, "hex20", (2, 2, 1), 0.4))
        mesh = read_mesh(scene, None)
        faces = cyclic_faces(mesh, scene.cyclic)
        x, y, z = mesh.points.T
        u = np.stack([0.3 * x - 2.0 * y, 2.0 * x + 0.3 * y, 0.7 * z + 0.1], axis=1)
        assert not faces.is_matched and "not meshed alike" in faces.note
        return np.abs(faces.weights @ u.ravel() - u[faces.high].ravel()).max()

    assert on_root(COMM, deviation) < 1e-14


@pytest.mark.pictures
@pytest.mark.ranks(1)
def test_the_program_writes_the_modes_of_every_nodal_diameter(shared_path, program):
    """The table, diagram and shapes on all sectors; frequencies are those of the structures of the diameters."""
    path = on_root(COMM, lambda: write_sector(shared_path, 5, end(4)))
    status, _, messages = program("modes", str(path), "--out", str(shared_path / "out"), "--speeds", "100,300")
    assert status == 0, messages
    COMM.barrier()
    with open(shared_path / "out" / "modes.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["nodal_diameter"]) for row in rows] == [0] * 4 + [1] * 4 + [2] * 4
    sector = build(read_scene(path), COMM)
    for d in range(3):
        frequencies = [float(row["frequency_Hz"]) for row in rows if row["nodal_diameter"] == str(d)]
        np.testing.assert_allclose(frequencies, sector.per_group.of_group(d).omega_n[:4] / (2.0 * np.pi), rtol=1e-8)
    assert {"interference.png", "modes_diameter_00.vtkhdf", "modes_diameter_02.vtkhdf"} <= {
        file.name for file in (shared_path / "out").iterdir()
    }
    sector.close()


def test_a_run_writes_fields_of_all_sectors(shared_path, program):
    """The motion of sector s is that of sector 0, rotated, with the phase of its harmonic."""
    N, h = 5, 2
    scene = end(8, levels=(0.01,), frequencies=(1410.0, 1430.0))
    path = on_root(COMM, lambda: write_sector(shared_path, N, scene, wave={"engine_order": h}))
    status, _, messages = program("run", str(path), "--out", str(shared_path / "out"))
    assert status == 0, messages
    COMM.barrier()
    fields = read_fields(str(shared_path / "out" / "results.h5"))
    (motion,) = fields.peaks.values()
    n = len(fields.mesh.points) // N
    u = motion.u[:, :, 1] - 1j * motion.u[:, :, 2]
    alpha = 2.0 * np.pi / N
    turn = np.array([[np.cos(alpha), -np.sin(alpha), 0.0], [np.sin(alpha), np.cos(alpha), 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(u[n : 2 * n], np.exp(1j * h * alpha) * u[:n] @ turn.T, atol=1e-6 * np.abs(u).max())
    disc = np.unique(np.concatenate([each.nodes.ravel() for each in fields.mesh.elements if each.group == "disc"]))
    close = cKDTree(fields.mesh.points[disc]).query_pairs(1e-9, output_type="ndarray")
    assert len(close) == 4 * N  # where sectors meet
    np.testing.assert_allclose(u[disc[close[:, 0]]], u[disc[close[:, 1]]], atol=1e-6 * np.abs(u).max())


def test_time_integration_of_the_whole_ring_confirms_the_wave(shared_path, program):
    """`verify` marches the pairs of all sectors; measured 3.8e-4 of the peak, its error in time 1.5e-4; harmonics above 1 7.5e-4."""
    solved = end(6, (85.0,), (1430.0, 1440.0), (1436.0,), harmonics=7, samples=120).replace("ratio = 0.01", "ratio = 0.03")
    path = on_root(COMM, lambda: write_sector(shared_path, 3, solved, friction=0.05))
    status, _, messages = program("verify", str(path), "--out", str(shared_path / "out"), "--at", "1436", "--steps", "64")
    assert status == 0, messages
    COMM.barrier()
    with open(shared_path / "out" / "verify.csv", encoding="utf-8", newline="") as file:
        (row,) = csv.DictReader(file)
    assert float(row["difference_with_phase"]) < 1e-3 and float(row["higher_harmonics"]) > 5e-4
    structure = build(read_scene(path), COMM)
    branch = respond(structure).level(85.0)
    i = int(np.argmin(np.abs(branch.frequency - 1436.0)))
    assert float(row["harmonic_balance_m"]) == pytest.approx(np.hypot(*branch.response[i, 0, 1:3]), rel=1e-6)
    structure.close()


@pytest.mark.ranks(1)
def test_an_output_in_another_sector_is_that_of_the_whole_disc(shared_path):
    """Harmonics 1 and 3 of the loads excite nodal diameters 2 and 1; all pairs stick."""
    third = table("[loads]", position=at(5), direction=[1.0, 0.0, 0.5], harmonic=3)
    solved = third + end(6, (0.01,), (1415.0, 1425.0))
    of = {
        is_whole: built(write_sector, shared_path, 5, solved, wave={"engine_order": 2, "whole": is_whole})
        for is_whole in (False, True)
    }
    of_sector, of_disc = respond(of[False]), respond(of[True])
    for sector in (0, 1, 3):
        expected, computed = of_disc[f"tip {sector}"].coefficients, of_sector.in_sector("tip", sector).coefficients
        np.testing.assert_allclose(computed[0, 0], expected[0, 0], atol=1e-9 * np.abs(expected[0, 0]).max())
    for response, wrong in ((of_sector, 5), (of_disc, 0)):
        with pytest.raises(MicroslipError, match="in_sector: "):
            response.in_sector(response.outputs[0], wrong)
    for structure in of.values():
        structure.close()
