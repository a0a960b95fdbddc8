"""Shared functions of the Python scripts of this folder: Newton's method along the frequencies, outputs, the table."""

import csv
import sys
import time
from pathlib import Path

import numpy as np

TOLERANCE = 1e-11  # bound of the residual over the load
MOST_ITERATIONS, LEAST_STEP = 60, 1 / 64


def read_model(folder: Path, program: str):
    """Return the arrays of model.npz; exit for properties that no program supports."""
    model = dict(np.load(folder / "model.npz"))
    if any(law != "elastic-coulomb" for law in model["law"]):
        sys.exit(f"pairs of a law that {program} does not have")
    if model["S"].size:
        sys.exit("structural damping: this script has none")
    return model


def follow(model, level, evaluate, x, size, coordinates):
    """Return a row of the table for each frequency of the model, each solved from the preceding one, starting at ``x``.

    ``evaluate(x, omega)`` returns residual and Jacobian, ``size`` is the norm of the load, ``coordinates(x)`` returns q.
    """
    rows, before = [], 2 * np.pi * model["frequency"][0]
    for frequency in model["frequency"]:
        began, omega = time.perf_counter(), 2 * np.pi * frequency
        x = reach(evaluate, x, before, omega, size)
        seconds = time.perf_counter() - began
        if x is None:
            sys.exit(f"no solution at {level:g} N, {frequency:g} Hz")
        before = omega
        rows.append([level, frequency, seconds, *outputs(model, coordinates(x), omega).ravel()])
    return rows


def reach(evaluate, x, before, omega, size):
    """Return the solution at ``omega``, from ``x`` at ``before``, with steps halved as needed; None: not found."""
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
    """Return the root, to a residual of ``TOLERANCE`` times ``size``, by Newton's method with halved steps; None: not found."""
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


def outputs(model, q, omega):
    """Return the coefficients of displacements, velocities and accelerations among the outputs, (n_outputs, 2 H + 1)."""
    y = model["outputs"] @ q
    for row, order in zip(y, model["output_order"]):
        for n in range(1, (len(row) + 1) // 2):
            amplitude = (row[2 * n - 1] - 1j * row[2 * n]) * (1j * n * omega) ** order
            row[2 * n - 1], row[2 * n] = amplitude.real, -amplitude.imag
        row[0] *= order == 0
    return y[shown(model)]


def shown(model):
    """Return which outputs follow from displacements alone, (n_outputs,) bool."""
    return ~(model["output_p"].any(axis=1) | model["output_base"].any(axis=1))


def write(model, path, rows) -> None:
    """Write a CSV file of rows (level [N], frequency [Hz], seconds, coefficients of the outputs)."""
    H = int(model["harmonics"])
    names = ["mean"] + [f"{part} {n}" for n in range(1, H + 1) for part in ("cos", "sin")]
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        heads = [f"{output} {name}" for output in model["output_name"][shown(model)] for name in names]
        writer.writerow(["level_N", "frequency_Hz", "seconds", *heads])
        writer.writerows([[f"{value:.17g}" for value in row] for row in rows])
    print(f"{path}: {len(rows)} points in {sum(row[2] for row in rows):.3g} s")
