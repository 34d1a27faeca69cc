"""The model that was asked for: a built-in pilot that a process serves, or an endpoint."""

from collections.abc import Callable

from dronecats.agent.models.model import Model
from dronecats.agent.models.openai_chat import ChatModel
from dronecats.agent.models.providers import PROVIDERS, split
from dronecats.processes.supervisor import ChildProcess, Supervisor
from dronecats.stages import parts


def served(supervisor: Supervisor, pilot: str | None) -> ChildProcess | None:
    """Start the process of a built-in pilot that looks at frames; None for the oracle and for a model."""
    return supervisor.start(parts.PILOT, {"pilot": pilot}) if pilot not in (None, "oracle") else None


def asked(
    pilot: str | None,
    process: ChildProcess | None,
    model: str | None,
    base_url: str | None,
    waiting: Callable[[], None] = lambda: None,
) -> Model:
    """Return the client of a pilot's process, or of PROVIDER/NAME where there is none. Raises UsageError."""
    if process is not None:
        return ChatModel(PROVIDERS["local"], pilot or "", process.ready(waiting)["base_url"])
    return ChatModel(*split(model or ""), base_url)
