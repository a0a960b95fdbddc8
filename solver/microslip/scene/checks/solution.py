"""Checks of damping, harmonics and response of a scene."""

import math
from typing import get_args

from ...contact.keys import ELASTIC_COULOMB, ROUGH
from ...messages.words import hint, listed
from ...tables.joint import Joint, OfPoints
from ..schema import Scene
from ..wear import ARCHARD, ENERGY, Wear


def damping(scene: Scene) -> list[str]:
    """Return mistakes: damping that is missing or stated twice."""
    if scene.damping is None and scene.model.damping is None:
        return [f"[damping] is missing: expected {Scene.model_fields['damping'].description}"]
    if scene.damping is not None and scene.model.damping is not None:
        return ["[damping]: the model also has a damping matrix, [model] damping; state only one of them"]
    return []


def harmonics(scene: Scene) -> list[str]:
    """Return mistakes: loads in a harmonic outside the solution, and error bars with a list of harmonics."""
    stated = scene.solver.harmonics
    text, remedy = (f"{list(stated)}", "add it") if isinstance(stated, tuple) else (f"{stated}", "raise that")
    change = "change" if isinstance(stated, tuple) else "lower"
    mistakes = [
        f"[[loads]] {number} harmonic = {load.harmonic}: [solver] harmonics = 0 is a static balance, in which nothing vibrates; "
        f"state at least {load.harmonic}, or harmonic = 0 of a constant load"
        if scene.is_static
        else f"[[loads]] {number} harmonic = {load.harmonic}: [solver] harmonics = {text} leaves it out; {remedy}, or {change} "
        "the load's harmonic"
        for number, load in enumerate(scene.loads, 1)
        if load.harmonic not in scene.chosen_harmonics
    ]
    if scene.leaves_harmonics_out and scene.solver.error_bars:
        mistakes.append(
            f"[solver] harmonics = {text} leaves harmonics out, which error bars do not cover: state error_bars = false, or "
            f"harmonics = {scene.harmonics}"
        )
    return mistakes


def constant_loads(scene: Scene) -> list[str]:
    """Return mistakes: statics with a method that selects pairs by dissipation, or that carries loads by modes only."""
    solver = scene.solver
    if not scene.is_static:
        return []
    if solver.method == "adaptive-energy" and not solver.in_point_check:
        return [
            '[solver] method = "adaptive-energy": with harmonics = 0 no pair dissipates, and pairs that slide would be dropped; '
            'take "receptance", or in_point_check = true'
        ]
    if solver.method in ("craig-bampton", "rubin") and solver.modes is None:
        return [
            f'[solver] modes is missing: with harmonics = 0 the modes of method = "{solver.method}" carry the load, and '
            'accuracy does not choose their number; state it, or take "receptance", which is exact with any number'
        ]
    return []


def bars(scene: Scene) -> list[str]:
    """Return mistakes: error bars that are needed but off; accuracy_of without an accuracy."""
    if scene.solver.accuracy_of != "amplitude" and scene.accuracy is None:
        return ["[solver] accuracy_of has no effect without accuracy; state accuracy, or leave accuracy_of out"]
    if scene.solver.error_bars or not (scene.chooses("harmonics") or scene.chooses("samples")):
        return []
    return ["[solver] error_bars = false: accuracy chooses harmonics and samples by them; leave error_bars out, or state both"]


def stability(scene: Scene) -> list[str]:
    """Return mistakes: stability without vibration, of one sector of a disc, or with structural damping."""
    if not scene.response.stability:
        return []
    begin = "[response] stability = true: "
    if scene.is_static:
        return [f"{begin}with harmonics = 0 nothing vibrates, so that there is no cycle; leave stability out"]
    if scene.cyclic is not None and not scene.cyclic.whole:
        return [
            f"{begin}a disturbance need not be a wave, and the model has one sector; state [cyclic] whole = true, or leave "
            "stability out"
        ]
    if scene.damping is not None and scene.damping.structural:
        return [
            f"{begin}a loss factor, [damping] structural, is only defined for steady vibration and has no equivalent in time; "
            "state ratio in its place, of about half the loss factor, or leave stability out"
        ]
    return []


def sensitivities(scene: Scene) -> list[str]:
    """Return mistakes: derivatives of a static solution."""
    if not (scene.response.sensitivities and scene.is_static):
        return []
    return ["[response] sensitivities = true: with harmonics = 0 nothing vibrates; leave sensitivities out"]


def peaks(scene: Scene) -> list[str]:
    """Return mistakes: peaks without vibration, or of a method with pairs selected from the previous point."""
    stated = {"[response] peaks = true": scene.response.peaks, "[[response.over]]": scene.response.over}
    where = next((where for where, is_stated in stated.items() if is_stated), None)
    if where is None:
        return []
    if scene.is_static:
        return [f"{where}: with harmonics = 0 nothing vibrates, and there is no peak; leave {where.split(' = ')[0]} out"]
    if scene.solver.method in ("adaptive", "adaptive-energy"):
        return [f'{where}: method = "{scene.solver.method}" selects its pairs at the previous point; take "receptance"']
    return []


def over(scene: Scene) -> list[str]:
    """Return mistakes: a key that the scene does not have, or that the state of rest depends on."""
    mistakes, names = [], {joint.name for joint in scene.joints}
    outputs = [output.name for output in scene.outputs]
    n_sectors = scene.cyclic.sectors if scene.cyclic is not None and scene.cyclic.whole else 0
    of_sectors = [f"{name} {sector}" for name in outputs for sector in range(n_sectors)]
    for i, over in enumerate(scene.response.over, 1):
        where = f"[[response.over]] {i}"
        if over.output is not None and over.output not in (*outputs, *of_sectors):
            mistakes.append(
                f"{where} output: there is no output {over.output!r}{hint(over.output, outputs)}; there are {listed(outputs)}"
                + (f", each followed by a sector, 0 to {n_sectors - 1}" if n_sectors else "")
            )
        if over.key == "level":
            continue
        known = ["level", "damping", "damping.ratio"]
        known += [f"joints.{name}.{key}" for name in sorted(names) for key in get_args(OfPoints)]
        if over.key not in known:
            mistakes.append(f"{where} key: there is no number {over.key!r}{hint(over.key, known)}; there are {listed(known)}")
        elif over.key in ("damping", "damping.ratio"):
            mistakes += [f"{where} key: {problem}" for problem in _of_damping(scene, over.key)]
        elif scene.statics is not None:
            mistakes.append(f"{where} key: with [statics] the state of rest depends on {over.key}; take level or damping")
    return mistakes


def _of_damping(scene: Scene, key: str) -> list[str]:
    """Return mistakes: peaks over a damping that is not there, or is not the ratio alone."""
    stated = {} if scene.damping is None else {name: value for name, value in scene.damping if value}
    if key == "damping.ratio" and set(stated) != {"ratio"}:
        return ["[damping] ratio is not the only damping here; take damping, a factor of all damping"]
    return []


def mode(scene: Scene) -> list[str]:
    """Return mistakes: a range around a mode beyond the computed ones."""
    mode, modes = scene.response.mode, scene.solver.modes
    return [f"[response] mode = {mode}: only [solver] modes = {modes} are computed"] if mode and modes and mode > modes else []


def of_wear(scene: Scene) -> list[str]:
    """Return mistakes of [wear]: joints and outputs that are not there, scenes that it does not support."""
    wear, mistakes = scene.wear, list[str]()
    if wear is None:
        return []
    names, outputs = [joint.name for joint in scene.joints], [output.name for output in scene.outputs]
    for key in ("coefficient", "area"):
        stated = getattr(wear, key)
        for name in stated if isinstance(stated, dict) and not scene.awaits_file else ():
            if name not in names:
                mistakes.append(f"[wear] {key}: there is no joint {name!r}{hint(name, names)}")
    mistakes += [mistake for joint in scene.joints for mistake in _worn_joint(scene, wear, joint)]
    if wear.output is not None and wear.output not in outputs:
        mistakes.append(
            f"[wear] output: there is no output {wear.output!r}{hint(wear.output, outputs)}; there are {listed(outputs)}"
        )
    low, high = scene.response.frequencies or (0.0, math.inf)
    if wear.frequency is not None and not low <= wear.frequency <= high:
        mistakes.append(f"[wear] frequency = {wear.frequency:g} Hz: outside [response] frequencies = [{low:g}, {high:g}]")
    if scene.is_static:
        mistakes.append("[wear]: with harmonics = 0 nothing vibrates, and nothing slides; leave [wear] out")
    if scene.cyclic is not None:
        mistakes.append("[wear]: a disc is not supported: each sector would wear by its own response; leave [cyclic] out")
    if scene.solver.method in ("adaptive", "adaptive-energy"):
        mistakes.append(
            f'[wear]: method = "{scene.solver.method}" takes its pairs from the point before, and a jump of cycles has none; '
            'take "receptance"'
        )
    return mistakes


def _worn_joint(scene: Scene, wear: Wear, joint: Joint) -> list[str]:
    """Return mistakes: a joint without a coefficient, or that wear is not computed of."""
    where, coefficient = f"[wear] coefficient: joint {joint.name!r}", wear.coefficient_of(joint.name)
    if coefficient is None:
        return [f"{where} has none; state 0 if it does not wear"]
    if joint.law == ROUGH and scene.statics is None:
        return [
            f'[wear]: the springs of joint {joint.name!r}, law = "{ROUGH}", follow from a preload that wear changes; they are '
            "computed again with [statics] alone"
        ]
    if coefficient == 0.0:
        return []
    if joint.law != ELASTIC_COULOMB:
        return [
            f'{where} has law = "{joint.law}", whose limits do not follow from a worn shape; wear is computed with law = '
            f'"{ELASTIC_COULOMB}"; state 0 if it does not wear'
        ]
    if wear.law == ARCHARD and isinstance(joint.friction, tuple):
        return [
            f'[wear] law = "{ARCHARD}": joint {joint.name!r} has two friction coefficients, and its friction energy is no '
            f'multiple of normal force times slip distance; take law = "{ENERGY}"'
        ]
    if scene.statics is not None and isinstance(joint.preload, float) and joint.preload > 0.0:
        return [
            f"{where} states preload = {joint.preload:g} with [statics]: the cause of the pressure, and its change with "
            'wear, are unknown; state preload = "static" and the loads, or no [statics]'
        ]
    return []
