"""The child's side of a supervised process: it reads commands as JSON lines and writes answers as JSON lines.

    python -m dronecats.flight.processes.child MODULE:NAME

The first line is the configuration; its answer is `{"ready": …}`. Then the child calls `Part.turn` in a loop. Between
two calls it reads commands. It returns the line `{"alive": true}` unchanged, so the parent notices a child that hangs.
When the parent ends, even by a kill -9, standard input closes, and then the child ends too.
"""

import faulthandler
import json
import os
import pkgutil
import queue
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any, Protocol, get_type_hints

from foundation.conversion import convert
from foundation.errors import DronecatsError


class Part(Protocol):
    """The work of a child process. The parent names a class or function that makes the part from a `config`.

    A part with long commands may also have `orphaned()`. Another thread calls it when the parent is gone.
    """

    def ready(self) -> dict[str, Any]:
        """Return facts for the parent, such as the ports that the part has bound."""
        return {}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        """Carry out a command and return its answer."""
        return None

    def turn(self) -> None:
        """Do a little work, or wait briefly for work. The main loop calls it repeatedly."""
        ...

    def close(self) -> None: ...


def main() -> int:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C: it lands the vehicle first
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # a stray print goes to the log: it must not look like an answer
    faulthandler.enable()  # a crash in compiled code writes the stacks of all threads to the log

    def reply(value: dict[str, Any]) -> None:
        replies.write(json.dumps(value) + "\n")
        replies.flush()

    config = json.loads(sys.stdin.readline() or "{}")
    try:
        part: Part = _created(pkgutil.resolve_name(sys.argv[1]), config)
    except DronecatsError as error:
        reply({"error": str(error), "status": error.exit_status})
        return error.exit_status
    reply({"ready": part.ready()})
    commands: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(commands, getattr(part, "orphaned", None)), daemon=True).start()
    try:
        while True:
            while not commands.empty():
                line = commands.get()
                if line is None:
                    return 0
                request = json.loads(line)
                if "alive" in request:
                    reply(request)
                    continue
                reply({"done": part.do(request.pop("do"), request)})
            part.turn()
    except BrokenPipeError:
        return 0
    except DronecatsError as error:
        reply({"error": str(error), "status": error.exit_status})
        return error.exit_status
    finally:
        part.close()


def _created(make: Any, config: Any) -> Part:
    """Create a part with the class or function `make`. The annotation of its parameter `config` gives the type."""
    of_type = get_type_hints(vars(make).get("__init__", make))["config"]
    part: Part = make(convert(config, of_type))
    return part


def _read(commands: "queue.SimpleQueue[str | None]", orphaned: Callable[[], None] | None) -> None:
    for line in sys.stdin:
        commands.put(line)
    if orphaned:
        orphaned()
    commands.put(None)


if __name__ == "__main__":
    sys.exit(main())
