"""Parameters of the keywords that are taken over: which are known, and what they are in full."""

from __future__ import annotations

from .cards import Card

# Each parameter is followed here, or has no bearing on a linear vibration, or is a finding of its own.
_KNOWN = {
    "NODE": "NSET, SYSTEM, INPUT",
    "ELEMENT": "TYPE, ELSET, INPUT",
    "NGEN": "LINE, NSET, SYSTEM",
    "NFILL": "NSET, BIAS, SINGULAR, TWO STEP",
    "NCOPY": "CHANGE NUMBER, OLD SET, SHIFT, REFLECT, POLE, MULTIPLE, NEW SET",
    "ELGEN": "ELSET, ALL NODES",
    "ELCOPY": "ELEMENT SHIFT, OLD SET, SHIFT NODES, NEW SET, REFLECT",
    "NSET": "NSET, GENERATE, ELSET, INSTANCE, INTERNAL, UNSORTED, INPUT",
    "ELSET": "ELSET, GENERATE, INSTANCE, INTERNAL, UNSORTED, INPUT",
    "SURFACE": "NAME, TYPE, INTERNAL, NO OFFSET, NO THICK, MAX RATIO, TRIM, PROPERTY, COMBINE, CROP, INPUT",
    "SYSTEM": "",
    "MATERIAL": "NAME, RTOL, STRAIN RATE REGULARIZATION",
    "ELASTIC": "TYPE, DEPENDENCIES, MODULI, USER",
    "DENSITY": "DEPENDENCIES, PORE FLUID, USER",
    "EXPANSION": "TYPE, DEPENDENCIES, ZERO, USER",
    "SOLID SECTION": "ELSET, MATERIAL, ORIENTATION, CONTROLS, COMPOSITE, STACK DIRECTION, SYMMETRIC, LAYUP, ORDER",
    "BOUNDARY": """OP, AMPLITUDE, TYPE, FIXED, LOAD CASE, REGION TYPE, USER, SUBMODEL, STEP, BASE NAME, TIME DELAY, PHANTOM,
    INPUT, MASS FLOW, STATIC TEMPERATURE, DATA SET""",
    "TRANSFORM": "NSET, TYPE",
    "EQUATION": "INPUT",
    "MPC": "INPUT",
    "TIE": """NAME, ADJUST, POSITION TOLERANCE, TYPE, NO ROTATION, NO THICKNESS, CYCLIC SYMMETRY, MULTISTAGE, FLUID PERIODIC""",
    "COUPLING": "CONSTRAINT NAME, REF NODE, SURFACE, INFLUENCE RADIUS, ORIENTATION, ADJUST, ALPHA",
    "KINEMATIC": "",
    "DISTRIBUTING": "WEIGHTING METHOD, COUPLING, ROTATIONAL COUPLING",
    "KINEMATIC COUPLING": "REF NODE, ORIENTATION",
    "DISTRIBUTING COUPLING": "ELSET",
    "RIGID BODY": "NSET, ELSET, REF NODE, ROT NODE, PIN NSET, TIE NSET, ISOTHERMAL, ANALYTICAL SURFACE",
    "MASS": "ELSET, TYPE, ALPHA, COMPOSITE",
    "ROTARY INERTIA": "ELSET, ORIENTATION, ALPHA, COMPOSITE",
    "SPRING": "ELSET, NONLINEAR, COMPLEX STIFFNESS, ORIENTATION, RTOL, DEPENDENCIES",
    "PRE-TENSION SECTION": "SURFACE, NODE, ELEMENT",
}
_NAMES = {keyword: ["".join(name.split()) for name in text.split(",")] for keyword, text in _KNOWN.items()}
_SHORTEST = 3  # letters of an abbreviation


def in_full(card: Card) -> tuple[dict[str, str], list[str]]:
    """Return a card's parameters with abbreviations written out, and those that are not known.  Local."""
    if card.keyword not in _NAMES:
        return card.parameters, []
    names, found, unknown = _NAMES[card.keyword], {}, []
    for name, value in card.parameters.items():
        longer = [known for known in names if len(name) >= _SHORTEST and known.startswith(name)]
        if name in names or len(longer) == 1:
            found[name if name in names else longer[0]] = value
        else:
            found[name] = value
            unknown.append(name)
    return found, unknown
