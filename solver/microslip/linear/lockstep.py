"""Computations in lockstep: their next requests are answered together, as the solves of a block with one factor.

Each computation runs in a greenlet, a coroutine that may also wait within a callback of a library, here of SLEPc's eigensolver.
There is one thread, and computations continue in a fixed order, so that collective calls have the same order on every rank.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from operator import itemgetter
from typing import Any, TypeVar

from greenlet import getcurrent, greenlet

from ..system.watchdog import patient

Request = TypeVar("Request")
Answer = TypeVar("Answer")
Result = TypeVar("Result")


_CHEAP, _EXPENSIVE, _AFTER_OTHERS = range(3)  # the order in which requests are answered


class _Coroutine(greenlet):
    """A computation in lockstep with others."""


def at_once(answers: Callable[[Sequence[Request]], Sequence[Answer]], request: Request, *, is_cheap: bool = False) -> Answer:
    """Return ``answers([request])[0]``; in lockstep one call answers the requests of all computations.

    Collective where ``answers`` is.  Cheap requests are answered before all others, so that as many computations as possible
    have the same expensive request.
    """
    here = getcurrent()
    turn = _CHEAP if is_cheap else _EXPENSIVE
    return here.parent.switch((answers, request, turn)) if isinstance(here, _Coroutine) else answers([request])[0]


def after_others(release: Callable[[], None]) -> None:
    """In lockstep, ``release`` memory and wait until every computation waits here or has ended.  Local."""
    here = getcurrent()
    if isinstance(here, _Coroutine):
        release()
        here.parent.switch((None, None, _AFTER_OTHERS))


def in_lockstep(computations: Sequence[Callable[[], Result]]) -> list[Result]:
    """Return the results of computations, each of which waits in :func:`at_once` until all others wait or have ended.

    Collective where they are.

    Raises
    ------
    Any exception of a computation or an answer, after a GreenletExit has ended the others where they wait.
    """
    coroutines = [_Coroutine(each) for each in computations]
    results: dict[_Coroutine, Any] = {}
    requests: dict[_Coroutine, Any] = {}
    try:
        with patient():  # computations enter and leave it in turn, and would restore the value of another one
            arguments: dict[_Coroutine, tuple[Any, ...]] = dict.fromkeys(coroutines, ())
            while arguments:
                for each in filter(arguments.__contains__, coroutines):
                    outcome = each.switch(*arguments[each])
                    (results if each.dead else requests)[each] = outcome
                arguments = _answered(requests)
    finally:
        for each in coroutines:
            with suppress(Exception):  # the first one matters
                each.throw()
    return [results[each] for each in coroutines]


def _answered(requests: dict[_Coroutine, tuple[Any, Any, int]]) -> dict[_Coroutine, tuple[Any]]:
    """Take the requests that one call of a function answers, or all that wait for the others; return the answers."""
    function = min(requests.values(), key=itemgetter(2), default=(None,))[0]
    some = {each: requests.pop(each)[1] for each in list(requests) if requests[each][0] == function}
    answers = list(some) if function is None else function(list(some.values()))
    return dict(zip(some, zip(answers)))
