"""The steps of an input file: choice of a step, and a table of their conditions."""

from collections.abc import Iterable

from ...messages.errors import MeshError
from ...messages.words import counted
from ..model import FileStep
from .cards import Card, number
from .findings import PROCEDURES
from .input_model import InputModel, Step
from .scopes import Scope

_LOADS = ("CLOAD", "DLOAD", "DSLOAD", "INERTIA LOAD", "BASE MOTION", "CONTACT INTERFERENCE")
_MOST = 3  # sets named per condition of a step


def chosen_step(steps: list[Step], wanted: int | None) -> Step | None:
    """Return the step of a number; None: the first step with *FREQUENCY, or the first step.  Local.

    Raises
    ------
    MeshError : no step of that number; the message lists the steps
    """
    if wanted is None:
        return next((step for step in steps if step.is_frequency), steps[0] if steps else None)
    if not 1 <= wanted <= len(steps):
        listed_steps = "; ".join(f"{step.number}: {_procedure(step)}" for step in steps)
        known = f"{counted(len(steps), 'step')}, {listed_steps}" if steps else "no steps"
        raise MeshError(f"[model] step = {wanted}: the file has {known}")
    return steps[wanted - 1]


def table_of_steps(model: InputModel) -> list[FileStep]:
    """Return the conditions of the model and of each step, and the ones taken over.  Local."""
    if not model.steps:
        return []
    rows = [FileStep(number=0, procedure="before all steps", states=_states(model.cards), taken=("supports", "temperatures"))]
    at_rest, until = model.steps_at_rest, model.steps_until
    for step in model.steps:
        taken = ("supports",) * (step in until) + ("loads", "temperatures") * (step in at_rest)
        rows.append(FileStep(number=step.number, procedure=_procedure(step), states=_states(step.cards), taken=taken))
    return rows


def _procedure(step: Step) -> str:
    """Return the procedure of a step and its name."""
    words = [card.keyword for _, card in step.cards if card.keyword in PROCEDURES]
    name = step.cards[0][1].parameters.get("NAME", "")
    text = f"*{words[0]}" if words else "no procedure"
    return text + ", PERTURBATION" * step.is_perturbation + (f' "{name}"' if name else "")


def _states(cards: Iterable[tuple[Scope, Card]]) -> dict[str, str]:
    """Return the conditions on cards, by kind."""
    supports, loads, temperatures = dict[str, None](), dict[str, int](), dict[str, None]()
    is_new = False
    for _, card in cards:
        if card.keyword == "BOUNDARY":
            is_new |= card.parameter("OP") == "NEW"
            supports.update(dict.fromkeys(_sets(card)))
        elif card.keyword in _LOADS:
            loads[card.keyword] = loads.get(card.keyword, 0) + sum(1 for _ in card.lines())
        elif card.keyword == "TEMPERATURE" or _is_temperature(card):
            temperatures.update(dict.fromkeys(_sets(card)))
    stated = {
        "supports": _listed(supports) + ", replacing all earlier ones" * is_new,
        "loads": ", ".join(f"{n} *{keyword}" for keyword, n in loads.items()),
        "temperatures": _listed(temperatures),
    }
    return {kind: text for kind, text in stated.items() if text}


def _is_temperature(card: Card) -> bool:
    return card.keyword == "INITIAL CONDITIONS" and card.parameter("TYPE") == "TEMPERATURE"


def _sets(card: Card) -> list[str]:
    """Return the sets and single nodes that the data lines of a card name."""
    first = [words[0] for words, _ in card.lines()]
    return ["single nodes" if number(word) is not None else word for word in first]


def _listed(names: Iterable[str]) -> str:
    shown = list(names)
    return ", ".join(shown[:_MOST]) + (f" and {len(shown) - _MOST} more" if len(shown) > _MOST else "")
