"""Values that are made once in a process and never changed, though several flights of it may ask at the same time."""

import threading
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def once(maxsize: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that keeps the `maxsize` values used last; who asks for one in the making waits for it."""

    def keeping(make: Callable[P, T]) -> Callable[P, T]:
        kept: Callable[P, T] = lru_cache(maxsize)(make)
        turn = threading.RLock()

        @wraps(make)
        def get(*arguments: P.args, **named: P.kwargs) -> T:
            with turn:
                return kept(*arguments, **named)

        return get

    return keeping
