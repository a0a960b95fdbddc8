"""Keywords of Abaqus and CalculiX: the effect of each, and whether it changes a linear vibration of the solids."""

from __future__ import annotations

from ...messages.words import nearest
from ..draft import Findings
from .cards import Card

PART = "cyclic"  # part of findings that the table [cyclic] of the scene resolves
# taken over by the other modules of this folder
TAKEN = """NODE, ELEMENT, NGEN, NFILL, NCOPY, ELGEN, ELCOPY, NSET, ELSET, SURFACE, SYSTEM, MATERIAL, ELASTIC, DENSITY,
EXPANSION, ORIENTATION, SOLID SECTION, BOUNDARY, TRANSFORM, EQUATION, MPC, TIE, COUPLING, KINEMATIC, DISTRIBUTING,
DISTRIBUTING COUPLING, KINEMATIC COUPLING, RIGID BODY, MASS, ROTARY INERTIA, SPRING, DASHPOT, PRE-TENSION SECTION, CONTACT PAIR,
SURFACE INTERACTION, SURFACE BEHAVIOR, FRICTION, INITIAL CONDITIONS, STEP, END STEP, FREQUENCY"""
# without effect on the answer and not reported
SILENT = """HEADING, PREPRINT, ASSEMBLY, END ASSEMBLY, PART, END PART, INSTANCE, END INSTANCE, INCLUDE, OUTPUT, NODE OUTPUT,
ELEMENT OUTPUT, CONTACT OUTPUT, ENERGY OUTPUT, MODAL OUTPUT, INCREMENTATION OUTPUT, INTEGRATED OUTPUT, NODE PRINT, EL PRINT,
NODE FILE, EL FILE, FACE PRINT, SECTION PRINT, CONTACT PRINT, CONTACT FILE, ENERGY PRINT, ENERGY FILE, MODAL PRINT, MODAL FILE,
PRINT, RESTART, FILE FORMAT, FILE OUTPUT, MONITOR, TIME POINTS, FILTER, INTEGRATED OUTPUT SECTION, SECTION FILE, DIAGNOSTICS,
ELEMENT MATRIX OUTPUT, POST OUTPUT, FILE DEFINITION, END ADJUST, NODE RESPONSE, ELEMENT RESPONSE"""

_HARMLESS = {
    "loads and steps of the file are not taken over": """STATIC, MODAL DYNAMIC, STEADY STATE DYNAMICS, DYNAMIC, BUCKLE,
    COMPLEX FREQUENCY, HEAT TRANSFER, COUPLED TEMPERATURE-DISPLACEMENT, UNCOUPLED TEMPERATURE-DISPLACEMENT, RANDOM RESPONSE,
    RESPONSE SPECTRUM, VISCO, SENSITIVITY, GREEN, CRACK PROPAGATION, FEASIBLE DIRECTION, ELECTROMAGNETICS, ROBUST DESIGN,
    CLOAD, DLOAD, DSLOAD, TEMPERATURE, BASE MOTION, CFLUX, DFLUX, FILM, RADIATE, SFILM, SRADIATE, DFLOW, INERTIA LOAD, FIELD,
    CONTROLS, CONTACT CONTROLS, SOLUTION TECHNIQUE, SOLVER CONTROLS, AMPLITUDE, CHANGE FRICTION, CONTACT INTERFERENCE,
    LOAD CASE, END LOAD CASE, STEP CONTROLS, VIEWFACTOR, DESIGN VARIABLES, DESIGNVARIABLES, OBJECTIVE, CONSTRAINT, GEOMETRIC
    CONSTRAINT, DESIGN RESPONSE, SPECTRUM, CORRELATION, PSD-DEFINITION, STEADY STATE TRANSPORT, SELECT EIGENMODES, CORIOLIS,
    BASELINE CORRECTION, NO ANALYSIS, SUBSTRUCTURE MATRIX OUTPUT, REFINE MESH""",
    "matrices are written for other programs": """SUBSTRUCTURE GENERATE, RETAINED NODAL DOFS, SUBSTRUCTURE LOAD CASE,
    MATRIX GENERATE, MATRIX OUTPUT""",
    "damping is stated in the scene": "MODAL DAMPING, GLOBAL DAMPING, DAMPING, DAMPING CONTROLS",
    "it belongs to the contact; a joint of the scene has values of its own": """CONTACT DAMPING, GAP CONDUCTANCE,
    GAP HEAT GENERATION, CLEARANCE, CONTACT INITIALIZATION DATA, CONTACT FORMULATION, SURFACE PROPERTY ASSIGNMENT,
    CONTACT PROPERTY ASSIGNMENT, CONTACT INITIALIZATION ASSIGNMENT, CONTACT EXCLUSIONS, CONTACT INCLUSIONS,
    CONTACT CONTROLS ASSIGNMENT, CONTACT STABILIZATION""",
    "of no effect on a linear, isotropic vibration": """DISTRIBUTION, DISTRIBUTION TABLE, CONDUCTIVITY,
    SPECIFIC HEAT, PHYSICAL CONSTANTS, SECTION CONTROLS, HOURGLASS STIFFNESS, NODAL THICKNESS,
    USER OUTPUT VARIABLES, VALUES AT INFINITY, NORMAL,
    ELECTRICAL CONDUCTIVITY, MAGNETIC PERMEABILITY, NODE PATTERN, LATENT HEAT, SURFACE SECTION""",
    "the material is taken as linear: it vibrates below yield": """PLASTIC, CYCLIC HARDENING, CREEP, CONCRETE, RATE DEPENDENT,
    POTENTIAL, SHEAR FAILURE, ANNEAL TEMPERATURE, DAMAGE INITIATION, DAMAGE EVOLUTION, FAIL STRESS, FAIL STRAIN,
    TENSILE FAILURE""",
}
CYCLIC = "a cyclic symmetric sector without the adjacent sectors"
_CHANGES = {
    CYCLIC: "CYCLIC SYMMETRY MODEL, SELECT CYCLIC SYMMETRY MODES",
    "matrices of another program are part of the structure": """MATRIX INPUT, MATRIX ASSEMBLE, SUBSTRUCTURE PROPERTY,
    SUBSTRUCTURE PATH,
    SUPER ELEMENT, USER ELEMENT, UEL PROPERTY, MATRIX""",
    "structural elements that are not solids": """SHELL SECTION, SHELL GENERAL SECTION, MEMBRANE SECTION, MEMBRANE, BEAM SECTION,
    BEAM GENERAL SECTION, FRAME SECTION, COHESIVE SECTION, GASKET SECTION, JOINT, FLUID SECTION, ACOUSTIC MEDIUM""",
    "a connection that is not modelled": """CONNECTOR SECTION, CONNECTOR BEHAVIOR, CONNECTOR ELASTICITY, FASTENER,
    FASTENER PROPERTY, EMBEDDED ELEMENT, SHELL TO SOLID COUPLING, GAP, RIGID SURFACE, NETWORK MPC, DISPLAY BODY,
    RELEASE, BOND""",
    "mass that is not modelled": "NONSTRUCTURAL MASS, HEAT CAPACITANCE, ADDED MASS",
    "all surfaces that touch are in contact": "CONTACT",
    "the structure changes between steps": """MODEL CHANGE, CHANGE MATERIAL, CHANGE PLASTIC, CHANGE SOLID SECTION,
    CHANGE SURFACE BEHAVIOR, IMPORT, IMPORT NODESET, IMPORT ELSET""",
    "nodes are moved": "IMPERFECTION, ADAPTIVE MESH, MAP SOLUTION, ADJUST",
    "the file is written with parameters": "PARAMETER, PARAMETER DEPENDENCE",
    "the material is not linear and isotropic": """HYPERELASTIC, HYPERFOAM, VISCOELASTIC, USER MATERIAL, DEPVAR, NO COMPRESSION,
    LOW DENSITY FOAM, ENGINEERING CONSTANTS, DEFORMATION PLASTICITY, SUPERELASTIC, HYSTERESIS, MULLINS EFFECT, PERMEABILITY,
    POROUS ELASTIC, FLUID CONSTANTS, HYPOELASTIC, FABRIC, UNIAXIAL, BRITTLE CRACKING, PIEZOELECTRIC""",
    "a fluid that is not modelled": """CFD, BOUNDARYF, TRANSFORMF, EQUATIONF, MASS FLOW, SPECIFIC GAS CONSTANT, FLUID BEHAVIOR,
    FLUID CAVITY, FLUID DENSITY, ACOUSTIC""",
    "a submodel: its boundary is moved by another model": "SUBMODEL",
}
# These generate nodes or elements, without which the model is incomplete.
REFUSED = {"NMAP": "write the nodes out", "SYMMETRIC MODEL GENERATION": "write the whole model out"}


def _keywords(text: str) -> list[str]:
    return [" ".join(word.split()) for word in text.split(",")]


# what a step solves; one of these is its procedure
PROCEDURES = frozenset(
    _keywords(
        """STATIC, FREQUENCY, MODAL DYNAMIC, STEADY STATE DYNAMICS, DYNAMIC, BUCKLE, COMPLEX FREQUENCY, HEAT TRANSFER, VISCO,
        GREEN,
        COUPLED TEMPERATURE-DISPLACEMENT, UNCOUPLED TEMPERATURE-DISPLACEMENT, RANDOM RESPONSE, RESPONSE SPECTRUM, SENSITIVITY,
        CRACK PROPAGATION, FEASIBLE DIRECTION, ELECTROMAGNETICS, ROBUST DESIGN, STEADY STATE TRANSPORT, NO ANALYSIS,
        SUBSTRUCTURE GENERATE"""
    )
)


def _bare(word: str) -> str:
    return "".join(word.split())


# by the keyword without blanks, as CalculiX reads it: effect, whether it changes the answer
_EFFECTS = {
    _bare(word): (effect, changes)
    for table, changes in ((_HARMLESS, False), (_CHANGES, True))
    for effect, words in table.items()
    for word in _keywords(words)
}
_QUIET = {_bare(word) for word in _keywords(SILENT)}
_KNOWN = {
    _bare(word): word
    for text in (TAKEN, SILENT, *_HARMLESS.values(), *_CHANGES.values(), ",".join(REFUSED))
    for word in _keywords(text)
}


def known(keyword: str) -> str:
    """Return the full form of a keyword, or the keyword itself if it is unknown."""
    return _KNOWN.get(_bare(keyword), keyword)


def add_card(findings: Findings, card: Card) -> None:
    """Add a finding with the effect of a card that is not taken over.  Local."""
    word = _bare(card.keyword)
    if word in _QUIET:
        return
    if word in _EFFECTS:
        effect, changes = _EFFECTS[word]
    else:
        near = nearest(card.keyword, _KNOWN.values())
        effect, changes = "not known to this program" + (f"; the nearest known keyword is *{near}" if near else ""), True
    findings.add(f"*{card.keyword}", card.where, effect, changes, PART if effect == CYCLIC else "")
