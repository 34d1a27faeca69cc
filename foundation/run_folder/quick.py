"""A line of a log straight into its row, several times as fast as the strict reader, and never with another result.

Whatever it cannot vouch for it leaves to the strict reader, which knows what to say of it.
"""

from collections.abc import Callable, Hashable, Mapping
from functools import cache
from typing import Any, TypeVar, cast

import msgspec

from foundation.run_folder.damage import impossible
from foundation.run_folder.rows import Decision

LONG = 4000  # bytes; within a longer line may stand a number of more digits than Python's own reader takes
KIND = 15  # bytes of a line as our writer begins it that tell its kind: {"kind": "pose"

Row = TypeVar("Row")
Quick = Callable[[bytes], Row | None]  # from a line to its row; None: the strict reader has to tell


def quick(row: type[Row]) -> Quick[Row]:
    """Return what reads the lines of one kind of row."""
    decode: Callable[[bytes], Row] = _decoder(cast(Hashable, row))
    checked = row is Decision

    def read(line: bytes) -> Row | None:
        made = _decoded(line, decode)
        return None if checked and made is not None and impossible(made) else made  # type: ignore[arg-type]

    return read


def quick_of_kinds(kinds: Mapping[str, type[Row]]) -> Quick[Row]:
    """Return what reads the lines of several kinds of rows, told apart by how our writer begins them."""
    decoders = {f'{{"kind": "{kind}", '.encode()[:KIND]: _decoder(cast(Hashable, row)) for kind, row in kinds.items()}

    def read(line: bytes) -> Row | None:
        decode = decoders.get(line[:KIND])
        return _decoded(line, decode) if decode else None

    return read


def _decoded(line: bytes, decode: Callable[[bytes], Row]) -> Row | None:
    if len(line) > LONG or not line.isascii():  # of bytes beyond it, msgspec looks only at those that it keeps
        return None
    try:
        return decode(line)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


@cache
def _decoder(row: Hashable) -> Callable[[bytes], Any]:
    return msgspec.json.Decoder(cast(Any, row)).decode
