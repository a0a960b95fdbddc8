"""Realistic results without a solver: two curved flanks, micro-slip that grows with the level, levels that end early."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from microslip import __version__
from microslip.contact.law import OPEN, SLIP, STICK
from microslip.mesh.data import ContactPairs
from microslip.observe.observer import Observers
from microslip.points.branch import Branch, Point
from microslip.results.record import LinearCurve, ResultFile, joint_of
from microslip.results.writer import ResultWriter

TITLE = "Fan-blade sector, first flap mode"


def flank(n_along: int, n_across: int, side: int, radius: float = 0.16, length: float = 0.066, width: float = 0.009):
    """Return points, frames and quad8 faces of a flank at 45 degrees, swept along an arc."""
    u, v = np.arange(2 * n_along + 1), np.arange(2 * n_across + 1)
    number = np.full((len(u), len(v)), -1)
    keep = ~((u[:, None] % 2 == 1) & (v[None, :] % 2 == 1))
    number[keep] = np.arange(keep.sum())
    U, V = (grid[keep] for grid in np.meshgrid(u / u[-1], v / v[-1], indexing="ij"))
    s, y = side * (0.007 + V * width * np.sin(np.pi / 4)), (U - 0.5) * length
    x = np.sqrt((radius + s) ** 2 - y**2) - radius
    points = np.column_stack([x, y, -0.016 - V * width * np.cos(np.pi / 4)])
    around = np.arctan2(y, x + radius)
    z = np.column_stack([-side * np.cos(around), -side * np.sin(around), -np.ones_like(y)]) / np.sqrt(2.0)
    x_axis = np.array([0.0, 1.0, 0.0]) - z[:, 1:2] * z
    x_axis /= np.linalg.norm(x_axis, axis=1, keepdims=True)
    a, b = np.meshgrid(u[:-1:2], v[:-1:2], indexing="ij")
    corners = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
    faces = np.stack([number[a + i, b + j].ravel() for i, j in corners], axis=1)
    return points, np.stack([x_axis, np.cross(z, x_axis), z], axis=1), faces


def two_flanks(n_along: int = 13, n_across: int = 3, names=("dovetail",)) -> ContactPairs:
    parts, start, faces = [], 0, []
    for side in (-1, 1):
        points, frame, own = flank(n_along, n_across, side)
        parts.append((points, frame))
        faces.append(own + start)
        start += len(points)
    position, frame = (np.concatenate(column) for column in zip(*parts))
    area = np.zeros(len(position))
    for own in faces:
        np.add.at(area, own, np.where(np.arange(8) < 4, 1.0, 4.0) / 20.0 * 0.066 * 0.009 / (n_along * n_across))
    joint = tuple(names[min(i // len(parts[0][0]), len(names) - 1)] for i in range(len(position)))
    return pairs_of(position, frame, area, joint, (np.concatenate(faces),) if len(names) == 1 else tuple(faces))


def pairs_of(position, frame, area, joint, faces) -> ContactPairs:
    n = len(position)
    return ContactPairs(
        joint,
        np.arange(n),
        np.arange(n) + n,
        position,
        frame,
        area,
        np.full(n, 0.3),
        5e7 * area,
        2e13 * area,
        3e13 * area,
        np.zeros(n, dtype=bool),
        faces,
    )


def no_pairs() -> ContactPairs:
    return pairs_of(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0), (), ())


def head(pairs, outputs=("tip",), title=TITLE, H: int = 3, linear=True, method="adaptive") -> ResultFile:
    """Return the head of a result file, before its levels."""
    return ResultFile(
        path="",
        title=title,
        name="fan_small",
        method=method,
        scene_text=f"title = {title!r}\n",
        options=("-hb_snes_max_it", "30"),
        versions={"microslip": __version__, "numpy": np.__version__},
        outputs=tuple(outputs),
        mode_frequency=np.array([100.0, 312.5]),
        joint=joint_of(pairs, np.arange(1 + max([0, *pairs.node1, *pairs.node2])) + 1001),
        linear=linear_curve(len(outputs), H) if linear else None,
    )


def curve(level: float, n_outputs: int, frequencies: np.ndarray, reach: float, H: int = 3) -> np.ndarray:
    """Return the response (n, n_outputs, 2 H + 1) of one mode that softens and loses energy as ``reach`` grows."""
    f_n, zeta = 100.0 * (1.0 - 0.004 * reach), 1e-3 * (1.0 + 2.5 * reach)
    x = frequencies / f_n
    complex_u = level * 2.2e-6 / (1.0 - x**2 + 2j * zeta * x)
    response = np.zeros((len(frequencies), n_outputs, 2 * H + 1))
    for k in range(n_outputs):
        response[:, k, 1], response[:, k, 2] = complex_u.real / (k + 1), -complex_u.imag / (k + 1)
        response[:, k, 5] = 1e-3 * np.abs(complex_u) / (k + 1)
        response[:, k, 0] = -2e-4 * np.abs(complex_u) / (k + 1)
    return response


def branch(
    level: float, pairs: ContactPairs, n_outputs: int = 1, n_points: int = 60, H: int = 3, low=97.0, high=102.0, most: float = 8.0
) -> Branch:
    """Return a branch of a level [N]; at ``most`` newtons about two thirds of the pairs slip at the peak."""
    reach = max(level / most - 0.125, 0.0)
    centre = 100.0 * (1.0 - 0.004 * reach)
    bend = np.sinh(3.0 * np.linspace(-1.0, 1.0, n_points))
    frequencies = np.where(bend < 0.0, centre + (low - centre) * bend / bend[0], centre + (high - centre) * bend / bend[-1])
    frequencies = frequencies if n_points > 1 else np.array([centre])
    response = curve(level, n_outputs, frequencies, reach, H)
    size = np.hypot(response[:, 0, 1], response[:, 0, 2])
    drive = size / 1.1e-3 / most * 8.0
    edge = _distance_to_edge(pairs)
    points = []
    for i, omega in enumerate(2.0 * np.pi * frequencies):
        depth = np.maximum(0.28 * drive[i] * (reach > 0.0) - edge, 0.0)
        state = np.where(depth > 0.0, SLIP, STICK).astype(np.uint8)
        state[(depth > 0.45) & (edge < 0.12)] = OPEN
        energy = 4e-7 * depth**2 * (pairs.area / max(pairs.area.max(initial=0.0), 1e-300))
        U = np.zeros((pairs.n_pairs, 3, 2 * H + 1))
        U[:, 0, 1], U[:, 2, 2] = 1e-7 * drive[i] * (1.0 - edge), 2e-8 * drive[i]
        p = np.zeros_like(U)
        p[depth > 0.0, 0, 1] = -1.0
        friction, damping = float(energy.sum()), 2e-6 * (size[i] / 1e-3) ** 2
        points.append(
            Point(
                omega=omega,
                response=response[i],
                U=U,
                p=p,
                energy=energy,
                state=state,
                unknowns=(20 + 3 * int((state > 0).sum())) * (2 * H + 1),
                newton=3,
                krylov=5,
                friction=friction,
                damping=damping,
                input=(friction + damping) * (1.0 + 1e-9 * np.sin(7.0 * i)),
                seconds=0.004,
            )
        )
    return Branch(level, points)


def _distance_to_edge(pairs: ContactPairs) -> np.ndarray:
    """Return 0 at the ends of the flanks to 1 in their middle, (n_pairs,)."""
    if pairs.n_pairs == 0:
        return np.zeros(0)
    y = pairs.position[:, 1] if np.isfinite(pairs.position).all() else np.linspace(-1.0, 1.0, pairs.n_pairs)
    z = pairs.position[:, 2] if np.isfinite(pairs.position).all() else np.zeros(pairs.n_pairs)
    along = 1.0 - np.abs(2.0 * (y - y.min()) / max(np.ptp(y), 1e-300) - 1.0)
    return np.clip(along + 0.3 * (z - z.min()) / max(np.ptp(z), 1e-300) - 0.1, 0.0, 1.0)


def linear_curve(n_outputs: int = 1, H: int = 3, low=97.0, high=102.0) -> LinearCurve:
    frequency = np.unique(np.concatenate([np.linspace(low, high, 80), 100.0 + np.sinh(np.linspace(-4, 4, 120)) * 0.04]))
    return LinearCurve(frequency, curve(1.0, n_outputs, frequency, 0.0, H))


def writer_of(folder, pairs, *, H: int = 3, comm=MPI.COMM_SELF, **options) -> ResultWriter:
    return ResultWriter(comm, str(folder), head(pairs, H=H, **options), 2 * H + 1)


def write(folder, branches, pairs, **options) -> str:
    """Write branches as a run would and return the path of results.h5."""
    writer = writer_of(folder, pairs, **options)
    observe(writer, branches)
    writer.close()
    return writer.path


def observe(writer: ResultWriter, branches: list[Branch]) -> None:
    """Pass whole branches to the writer, one after the other.  Collective on its communicator."""
    notify = Observers(writer.comm, [each.level for each in branches], [writer]).notify
    for number, each in enumerate(branches):
        notify("level_started", number)
        for point in each.points:
            notify("point", number, point)
        notify("level_finished", number, each)
