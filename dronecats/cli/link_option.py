"""A bad wire in a word: `--link delay=0.1,loss=0.05,to.delay=0.2`, both ways alike where no way is named."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dronecats.flight.spec.disturbances import LinkFaults

FIELDS = {  # as it is said: the field of an impairment
    "delay": "delay_s",
    "jitter": "jitter_s",
    "loss": "loss",
    "duplicate": "duplicate",
    "reorder": "reorder",
    "corrupt": "corrupt",
    "baud": "baud",
    "queue": "queue_bytes",
}
WHOLE = ("baud", "queue")
WAYS = {"to": ("to_vehicle",), "from": ("from_vehicle",), "": ("to_vehicle", "from_vehicle")}


def link_faults(text: str) -> "LinkFaults":
    """Return what is done to the wire. Raises UsageError naming the word that cannot be."""
    from dronecats.flight.spec.disturbances import LinkFaults
    from foundation.errors import UsageError
    from hil.impairment.channel import Impairment

    said: dict[str, dict[str, Any]] = {"to_vehicle": {}, "from_vehicle": {}}
    for word in sorted(text.split(","), key=lambda word: "." in word.partition("=")[0]):  # one way overrides both
        name, equals, value = word.strip().partition("=")
        way, dot, field = name.rpartition(".")
        if not equals or field not in FIELDS or way not in WAYS or (dot and not way):
            raise UsageError(
                f"--link takes NAME=VALUE,… with the names {', '.join(FIELDS)}, for one way to.NAME or from.NAME; got"
                f" '{word}'"
            )
        for each in WAYS[way]:
            said[each][FIELDS[field]] = _number(word, value, whole=field in WHOLE)
    return LinkFaults(**{way: Impairment(**fields) for way, fields in said.items()})


def _number(word: str, text: str, *, whole: bool) -> float:
    from foundation.errors import UsageError

    try:
        return int(text) if whole else float(text)
    except ValueError:
        raise UsageError(f"--link takes a {'whole ' if whole else ''}number where it says '{word}'") from None
