"""The host names under which a page of this machine opens."""

import re
from collections.abc import Sequence

from foundation.errors import UsageError

LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
_NAME = re.compile(r"(?!-)[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*")


def check(names: Sequence[str], option: str) -> None:
    """Raise UsageError if one of `names`, the values of the command-line option `option`, is not a host name."""
    for name in names:
        if not _NAME.fullmatch(name):
            raise UsageError(
                f"{option} {name!r} is not a host name. Give the name alone, without scheme, port and path, for"
                " example drone.example.org"
            )


def reach(names: Sequence[str]) -> str:
    """Return a phrase that says where a page that admits these host names can be opened."""
    return f"this machine, and as {', '.join(names)}" if names else "this machine only"
