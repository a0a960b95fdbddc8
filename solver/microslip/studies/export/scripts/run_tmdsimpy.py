"""Frequency response of model.npz by TMDSimPy.

    python run_tmdsimpy.py FOLDER [MODEL_FOLDER]

FOLDER is where github.com/tmd-lab/tmdsimpy was cloned.  Pairs whose normal force is constant become a VectorJenkins element
for each tangential direction, all others an ElasticDryFriction3D, which needs jax.  Writes response_tmdsimpy.csv.
"""

import csv
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, sys.argv[1] if len(sys.argv) > 1 else ".")
from tmdsimpy.nlforces.vector_jenkins import VectorJenkins
from tmdsimpy.vibration_system import VibrationSystem

TOLERANCE = 1e-11  # of the residual over the load
MOST_ITERATIONS, LEAST_STEP = 60, 1 / 64


def main(folder: Path) -> None:
    model = dict(np.load(folder / "model.npz"))
    refuse(model)
    D = 1.0 / np.sqrt(np.diag(model["K"] + model["R"].T @ (model["K_J"][:, None] * model["R"])))  # q = D x: x of one size
    system = VibrationSystem(*(D[:, None] * model[name] * D for name in ("M", "K")), C=D[:, None] * model["C"] * D)
    rest = np.zeros(len(D))  # what the elements carry at rest
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
        before = 2 * np.pi * model["frequency"][0]

        def evaluate(x, omega, F=F):
            return system.hbm_res(np.append(x, omega), F, h, Nt=n_t)[:2]

        for frequency in model["frequency"]:
            omega, began = 2 * np.pi * frequency, time.perf_counter()
            U = reach(evaluate, U, before, omega, np.linalg.norm(F))
            seconds = time.perf_counter() - began
            if U is None:
                sys.exit(f"no solution at {level:g} N, {frequency:g} Hz")
            before = omega
            q = D[:, None] * U.reshape(-1, len(D)).T
            rows.append([level, frequency, seconds, *outputs(model, q, omega).ravel()])
    write(model, folder / "response_tmdsimpy.csv", rows)


def reach(evaluate, x, before, omega, size):
    """Return the solution at ``omega``, from ``x`` at ``before``, in one step or in as many as it takes; None: not found."""
    for n_steps in (1, 4, 16, 64):
        y = x
        for w in np.linspace(before, omega, n_steps + 1)[1:]:
            y = newton(lambda y, w=w: evaluate(y, w), y, size)
            if y is None:
                break
        else:
            return y
    return None


def newton(evaluate, x, size):
    """Return where the residual is ``TOLERANCE`` of ``size`` or less, by Newton's method with steps halved; None: nowhere."""
    residual, jacobian = evaluate(x)
    for _ in range(MOST_ITERATIONS):
        if np.linalg.norm(residual) <= TOLERANCE * size:
            return x
        step, share = np.linalg.solve(jacobian, residual), 1.0
        new, new_jacobian = evaluate(x - step)
        while not np.linalg.norm(new) < np.linalg.norm(residual) and share > LEAST_STEP:
            share /= 2.0
            new, new_jacobian = evaluate(x - share * step)
        x, residual, jacobian = x - share * step, new, new_jacobian
    return None


def refuse(model) -> None:
    """End where TMDSimPy has nothing like it."""
    if any(law != "elastic-coulomb" for law in model["law"]):
        sys.exit("pairs of a law that TMDSimPy does not have")
    if model["S"].size:
        sys.exit("structural damping: TMDSimPy has none")
    if np.any(model["k_t"] != model["k_ty"]) or np.any(model["mu"] != model["mu_y"]):
        sys.exit("stiffness or friction of x and y differ: ElasticDryFriction3D has one for both")


def elements(model, D):
    """Yield the elements of all pairs, each with its force at rest over the coordinates."""
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


def outputs(model, q, omega):
    """Return the coefficients of the outputs that are displacements, velocities or accelerations, (n_outputs, 2 H + 1)."""
    y = model["outputs"] @ q
    for row, order in zip(y, model["output_order"]):
        for n in range(1, (len(row) + 1) // 2):
            amplitude = (row[2 * n - 1] - 1j * row[2 * n]) * (1j * n * omega) ** order
            row[2 * n - 1], row[2 * n] = amplitude.real, -amplitude.imag
        row[0] *= order == 0
    return y[shown(model)]


def shown(model):
    return ~(model["output_p"].any(axis=1) | model["output_base"].any(axis=1))


def write(model, path, rows) -> None:
    H = int(model["harmonics"])
    names = ["mean"] + [f"{part} {n}" for n in range(1, H + 1) for part in ("cos", "sin")]
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        own = [f"{output} {name}" for output in model["output_name"][shown(model)] for name in names]
        writer.writerow(["level_N", "frequency_Hz", "seconds", *own])
        writer.writerows([[f"{value:.17g}" for value in row] for row in rows])
    print(f"{path}: {len(rows)} points in {sum(row[2] for row in rows):.3g} s")


if __name__ == "__main__":
    main(Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).resolve().parent)
