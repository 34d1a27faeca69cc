"""Values that a process makes once and never changes, though several of its flights may ask at the same time."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
_expects_more = threading.Event()


def expect_more() -> None:
    """Say that this process flies many episodes: what recurs is kept from the first on."""
    _expects_more.set()


def once(maxsize: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that keeps the `maxsize` values used last; who asks for one in the making waits for it."""

    def keeping(make: Callable[P, T]) -> Callable[P, T]:
        kept: OrderedDict[object, T] = OrderedDict()
        turn = threading.RLock()

        @wraps(make)
        def get(*arguments: P.args, **named: P.kwargs) -> T:
            key = (arguments, tuple(named.items()))
            with turn:
                if key not in kept:
                    kept[key] = make(*arguments, **named)
                    if len(kept) > maxsize:
                        kept.popitem(last=False)
                kept.move_to_end(key)
                return kept[key]

        return get

    return keeping


def recurring(maxsize: int) -> Callable[[Callable[P, T]], Callable[P, T | None]]:
    """Return a decorator as `once`, whose function returns None to who asks first, and makes what is asked for again.

    For what helps a process that flies many episodes, and would only cost memory in one that flies a single one. After
    `expect_more` nobody is the first.
    """

    def keeping(make: Callable[P, T]) -> Callable[P, T | None]:
        kept = once(maxsize)(make)
        asked: OrderedDict[object, None] = OrderedDict()
        turn = threading.Lock()

        @wraps(make)
        def get(*arguments: P.args, **named: P.kwargs) -> T | None:
            key = (arguments, tuple(named.items()))
            with turn:
                first = key not in asked and not _expects_more.is_set()
                asked[key] = None
                asked.move_to_end(key)
                if len(asked) > maxsize:
                    asked.popitem(last=False)
            return None if first else kept(*arguments, **named)

        return get

    return keeping
