"""Lists of values as the arrays that a database takes in one piece."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEAST, GREATEST = -(2**63), 2**63 - 1
DTYPES: dict[str, Any] = {"BOOLEAN": np.bool_, "BIGINT": np.int64, "DOUBLE": np.float64}


def array(values: Sequence[Any], sql_type: str) -> NDArray[Any]:
    """Return values of one SQL type as an array; where a value is None it is masked, of text None itself.

    What no column of that type can hold, a whole number beyond 64 bits, is None.
    """
    if sql_type not in DTYPES:
        texts = np.empty(len(values), dtype=object)
        texts[:] = [None if value is None else _text(value) for value in values]
        return texts
    if sql_type == "BIGINT":
        values = [None if value is None or not LEAST <= value <= GREATEST else value for value in values]
    mask = [value is None for value in values]
    filled = [0 if missing else value for missing, value in zip(mask, values, strict=True)]
    return np.ma.masked_array(np.array(filled, dtype=DTYPES[sql_type]), mask)


def _text(value: str) -> str:
    """Return a text with what UTF-8 has no bytes for, half a surrogate pair, escaped."""
    return value if value.isascii() else value.encode("utf-8", "backslashreplace").decode()
