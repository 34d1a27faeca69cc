"""The log that a connected autopilot wrote on board, fetched after the flight into the episode's folder."""

from collections.abc import Callable
from pathlib import Path

from foundation.errors import DronecatsError
from foundation.run_folder.layout import onboard_log_name
from hil.link.flight_logs import log_store
from hil.link.link import Link

LATER = "fetch it later with dronecats flightlog fetch"


def fetch_onboard_log(url: str, link: Link, folder: Path, say: Callable[[str], None]) -> None:
    """Fetch the newest log of a vehicle whose link is closed; say so where it cannot be fetched."""
    if link.state.armed:
        say(f"the autopilot's log is not kept: the vehicle is still armed and writes it; {LATER}")
        return
    try:
        with log_store(url) as store:
            logs = [log for log in store.entries() if log.size_bytes]
            if not logs:
                say("the autopilot's log is not kept: there is none on board")
                return
            say(f"fetching the autopilot's log ({logs[-1].size_bytes:,} bytes) …")
            store.fetch(logs[-1], folder).rename(folder / onboard_log_name())
    except DronecatsError as fault:
        say(f"the autopilot's log is not kept: {fault}; {LATER}")
