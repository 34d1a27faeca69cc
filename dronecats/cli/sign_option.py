"""`--sign KEYFILE`, as every verb has it that talks to a vehicle by MAVLink."""

import argparse
from pathlib import Path


def add_sign(group: "argparse._ActionsContainer", when: str = "") -> None:
    """Declare the option; `when` begins its help where it goes with another option only."""
    group.add_argument(
        "--sign", type=Path, metavar="KEYFILE", help=f"{when}sign MAVLink messages, believe no others: docs/signing.md"
    )


def key_of(file: Path | None) -> bytes:
    """Return the key in the option's file, empty without one. Raises UsageError."""
    from foundation.signing import load_key

    return load_key(file) if file else b""
