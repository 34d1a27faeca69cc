"""Fast reading of numpy records: all their fields as Python numbers in one go."""

import math
import struct
from typing import Any


class Readings:
    """The fields of a record as attributes, scalars as numbers and arrays as tuples; `refresh` renews them."""

    def __init__(self, record: Any) -> None:
        kinds = [(name, record.dtype[name]) for name in record.dtype.names]
        counts = [math.prod(kind.shape) for _, kind in kinds]
        codes = ["q" if kind.base.kind == "i" else "d" for _, kind in kinds]
        self._struct = struct.Struct("=" + "".join(f"{n}{code}" for n, code in zip(counts, codes, strict=True)))
        self._places: list[tuple[str, int | slice]] = []
        start = 0
        for (name, kind), count in zip(kinds, counts, strict=True):
            self._places.append((name, slice(start, start + count) if kind.shape else start))
            start += count
        self._buffer = memoryview(record)
        self.refresh()

    def __getattr__(self, name: str) -> Any:  # attributes are made by refresh
        raise AttributeError(f"the record has no field {name!r}")

    def refresh(self) -> None:
        """Read the record again."""
        values = self._struct.unpack_from(self._buffer)
        fields = self.__dict__
        for name, place in self._places:
            fields[name] = values[place]
