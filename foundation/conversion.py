"""Conversion of JSON values into typed objects, by msgspec, for programs with several threads.

At the first use of a class, msgspec stores a description of its fields. If a second thread uses the class before this
description is complete, the process crashes (msgspec 0.22). So one thread at a time converts or makes a decoder.
"""

import threading
from collections.abc import Callable
from typing import Any, TypeVar, overload

import msgspec

T = TypeVar("T")
_CONVERTING = threading.RLock()  # reentrant, because the `__post_init__` of a class may convert too


@overload
def convert(value: Any, kind: type[T]) -> T: ...
@overload
def convert(value: Any, kind: Any) -> Any: ...
def convert(value: Any, kind: Any) -> Any:
    """Return JSON values as a `kind`: a dataclass, or any annotation. Raises msgspec.ValidationError, UnicodeError."""
    with _CONVERTING:
        return msgspec.convert(value, kind)


def decode(data: bytes | str, kind: type[T]) -> T:
    """Return JSON text as a `kind`. Raises msgspec.DecodeError, UnicodeError, RecursionError."""
    return decoder(kind)(data)


def decoder(kind: type[T]) -> Callable[[bytes | str], T]:
    """Return a function that does the same as `decode` for one kind."""
    with _CONVERTING:
        return msgspec.json.Decoder(kind).decode
