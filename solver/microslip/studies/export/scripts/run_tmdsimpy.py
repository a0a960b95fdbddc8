"""Frequency response of model.npz by TMDSimPy.

    python run_tmdsimpy.py FOLDER [MODEL_FOLDER]

FOLDER is a clone of github.com/tmd-lab/tmdsimpy.  Pairs with a constant normal force become a VectorJenkins element
for each tangential direction, all others an ElasticDryFriction3D, which needs jax.  Writes response_tmdsimpy.csv.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, sys.argv[1] if len(sys.argv) > 1 else ".")
from exported_model import follow, read_model, write
from tmdsimpy.nlforces.vector_jenkins import VectorJenkins
from tmdsimpy.vibration_system import VibrationSystem


def main(folder: Path) -> None:
    """Compute the curves of an exported model by TMDSimPy and write them into its folder."""
    model = read_model(folder, "TMDSimPy")
    refuse(model)
    D = 1.0 / np.sqrt(np.diag(model["K"] + model["R"].T @ (model["K_J"][:, None] * model["R"])))  # q = D x scales x
    system = VibrationSystem(*(D[:, None] * model[name] * D for name in ("M", "K")), C=D[:, None] * model["C"] * D)
    rest = np.zeros(len(D))  # forces of the elements at rest
    for element, force in elements(model, D):
        system.add_nl_force(element)
        rest += force
    h, n_t = np.arange(int(model["harmonics"]) + 1), int(model["samples"])
    rows = []
    start = np.linalg.solve(stuck(model, D, 2 * np.pi * model["frequency"][0]), D * at(model["load"], 1))
    for level in model["levels"]:
        load = level * D[:, None] * model["load"]
        load[:, 0] += rest
        F = load.T.ravel()
        U = np.zeros(len(F))
        U[len(D) : 3 * len(D)] = level * np.concatenate([start.real, -start.imag])

        def evaluate(x, omega, F=F):
            return system.hbm_res(np.append(x, omega), F, h, Nt=n_t)[:2]

        rows += follow(model, level, evaluate, U, np.linalg.norm(F), lambda U: D[:, None] * U.reshape(-1, len(D)).T)
    write(model, folder / "response_tmdsimpy.csv", rows)


def refuse(model) -> None:
    """Exit for properties that TMDSimPy lacks."""
    if np.any(model["k_t"] != model["k_ty"]) or np.any(model["mu"] != model["mu_y"]):
        sys.exit("stiffness or friction of x and y differ: ElasticDryFriction3D has one for both")


def elements(model, D):
    """Yield the elements of all pairs, each with its force at rest on the coordinates."""
    for i in range(len(model["mu"])):
        Q = model["R"][3 * i : 3 * i + 3] * D
        moves = np.abs(Q).max(axis=1) > 0.0
        mu, k_t, k_n, N0, T0 = (model[name][i] for name in ("mu", "k_t", "k_n", "N0", "T0"))
        if not moves[2] and not T0.any():
            for q in Q[:2][moves[:2]]:
                yield VectorJenkins(q[None], q[:, None], k_t, mu * max(N0, 0.0)), np.zeros(len(D))
            continue
        from tmdsimpy.jax.nlforces.elastic_dry_fric_3d import ElasticDryFriction3D

        Q = Q * np.array([1.0, 1.0, -1.0])[:, None]  # compression is positive there
        w0 = np.array([*(-T0 / k_t), 0.0])
        element = ElasticDryFriction3D(Q, Q.T.copy(), k_t, k_n, mu, u0=w0, meso_gap=-N0 / k_n)
        yield element, Q.T @ np.array([*T0, max(N0, 0.0)])


def stuck(model, D, omega):
    """Return the dynamic stiffness while every pair sticks."""
    K_L = model["K"] + model["R"].T @ (model["K_J"][:, None] * model["R"])
    return D[:, None] * (K_L - omega**2 * model["M"] + 1j * omega * model["C"]) * D


def at(coefficients, n):
    """Return the complex amplitude of harmonic n."""
    return coefficients[:, 2 * n - 1] - 1j * coefficients[:, 2 * n]


if __name__ == "__main__":
    main(Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).resolve().parent)
