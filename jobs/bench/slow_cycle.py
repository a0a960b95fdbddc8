"""A joint under a slow cyclic load: the condensed static equations, integrated in small steps over a cycle."""

from __future__ import annotations

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from microslip.assembly.assemble import assemble
from microslip.assembly.prestress import constant_forces
from microslip.linear.joint_springs import Linearised, linearise
from microslip.mesh.data import ContactPairs
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.read import read_mesh
from microslip.statics.equilibrium import Contact, Flexibility, Loading, State

STEPS = 10  # from zero to the largest load; twice as many from one extreme to the other


@dataclass(frozen=True, eq=False)
class SlowCycle:
    """A joint at rest under the constant loads of a scene, and its motion per newton of the scene's load."""

    linearised: Linearised
    pairs: ContactPairs
    contact: Contact
    pressed: np.ndarray  # (n_pairs, 3) m, by the constant loads with all pairs stuck
    pushed: np.ndarray  # (n_pairs, 3) m/N
    rest: State

    @classmethod
    def of(cls, scene, rest_steps: int = 4) -> SlowCycle:
        """Return the joint of a scene at rest; on one rank."""
        settings, comm = scene, MPI.COMM_SELF
        mesh = read_mesh(settings)
        pairs = pair_contacts(mesh, settings.joints)
        shares = distribute(mesh, settings, comm)
        system = assemble(shares, mesh, pairs, settings)
        linearised = linearise(system, pairs, str(scene.path))
        forces = np.column_stack([constant_forces(shares, mesh, settings, system), system.loads[:, [0]].toarray()])
        pressed, pushed = np.moveaxis((system.R @ linearised.factor.solve(forces)).reshape(-1, 3, 2), 2, 0)
        contact, none = Contact(comm, pairs, Flexibility(linearised)), np.zeros(pressed.shape)
        rest, _ = contact.follow(Loading(none, pressed, "the load"), State(none, none), rest_steps)
        return cls(linearised, pairs, contact, pressed, pushed, rest)

    def close(self) -> None:
        """Free the factor."""
        self.linearised.destroy()

    def force(self, state: State) -> np.ndarray:
        """Return friction x and y and minus the normal force of the points, (n_pairs, 3) [N]."""
        force = state.p + self.pairs.law.stiffness * state.du
        force[:, 2] -= np.maximum(self.pairs.N0, 0.0)
        return force

    @property
    def N(self) -> np.ndarray:
        """Normal forces at rest, (n_pairs,) [N]."""
        return -self.force(self.rest)[:, 2]

    def run(self, load: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the points that stick throughout a cycle between -load and load [N], friction at load [N], and losses [J].

        The cycle begins when the load is first reached.
        """
        now = self._march(self.rest, 0.0, load, STEPS, None)
        largest, losses, moves = self.force(now)[:, :2], np.zeros(self.pairs.n_pairs), np.zeros(self.pairs.n_pairs, dtype=bool)
        for start in (load, -load):
            now = self._march(now, start, -start, 2 * STEPS, (losses, moves))
        return ~moves, largest, losses

    def _march(self, now: State, start: float, end: float, n_steps: int, record) -> State:
        """Return the state after the load has changed from one value to another; losses and moves are added to ``record``."""
        values = np.linspace(start, end, n_steps + 1)
        for before, after in zip(values[:-1], values[1:]):
            held = self.pressed + before * self.pushed
            then, _ = self.contact.follow(Loading(held, (after - before) * self.pushed, "the load"), now, 1)
            if record is not None:
                T = 0.5 * (self.force(now) + self.force(then))[:, :2]
                slip = self._slider(then) - self._slider(now)
                record[0][:] += np.sum(T * slip, axis=1)
                record[1][:] |= np.any(then.p[:, :2] != now.p[:, :2], axis=1)
            now = then
        return now

    def _slider(self, state: State) -> np.ndarray:
        """Return the positions of the sliders, (n_pairs, 2) [m]."""
        return -state.p[:, :2] / self.pairs.law.stiffness[:, :2]
