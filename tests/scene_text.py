"""Scenes as text, table by table: the tables common to many tests."""

import json


def table(header, **keys):
    """Return a table of these keys, one per line; ``header`` is the text between brackets, "[loads]" for an array of tables."""
    return f"[{header}]\n" + "".join(f"{key} = {_written(value)}\n" for key, value in keys.items())


def steel(*bodies, **constants):
    """Return a material, with other constants if given, and bodies of it with the names of their groups."""
    text = table("materials.steel", **{"young": 2.1e11, "poisson": 0.3, "density": 7800.0} | constants)
    return text + "".join(table(f"bodies.{name}", group=name, material="steel") for name in bodies)


def support(group, *axes):
    return table("[supports]", group=group, fix=axes or ("x", "y", "z"))


def joint(*surfaces, name="joint", friction=0.3, k_t=1.0e12, k_n=None, preload="static", gap=None):
    """Return a joint, by default with normal springs twice as stiff as the tangential springs; ``gap`` [m] for open ones."""
    springs = {"tangential_stiffness": k_t, "normal_stiffness": k_n or 2.0 * k_t}
    at_rest = {"preload": preload} if gap is None else {"gap": gap}
    return table("[joints]", name=name, surfaces=surfaces, friction=friction, **springs, **at_rest)


def with_harmonics(solver):
    """Return keys of [solver], with harmonics = 3 if they do not determine the harmonics.

    Most tests compare solutions of the same equation; otherwise the program would choose harmonics and samples at each point.
    """
    return solver if {"harmonics", "accuracy"} & solver.keys() else {**solver, "harmonics": 3}


def driven(place, load, output, name):
    """Return a load and an output of this name at a place, in their directions."""
    loads = table("[loads]", position=place[0], direction=load)
    return loads + table("[outputs]", name=name, position=place[-1], direction=output)


def response(*levels, span=(0.9, 1.1), **points):
    """Return damping of 1 % and a range about mode 1."""
    return table("damping", ratio=0.01) + table("response", levels=levels, mode=1, span=span, **points)


def _written(value):
    """Return a value in TOML format; large and small numbers with a power of ten."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_written, value))}]"
    if not isinstance(value, float) or 1e-4 <= abs(value) < 1e6 or value == 0.0:
        return json.dumps(value)
    mantissa, exponent = f"{value:.12e}".split("e")
    return f"{float(mantissa)}e{int(exponent)}"
