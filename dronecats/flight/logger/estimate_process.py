"""The estimate logger as a process: takes a copy of the link's bytes on a port that the system chose."""

from pathlib import Path
from typing import Any

from dronecats.flight.logger.config import EstimateLoggerConfig
from dronecats.flight.logger.estimate import EstimateRecorder
from hil.link.transport import UdpTransport


class EstimateLogger:
    """Part of a flight on a vehicle that we did not start."""

    def __init__(self, config: EstimateLoggerConfig) -> None:
        self._recorder = EstimateRecorder(Path(config.folder))
        self._socket = UdpTransport("udpin://127.0.0.1:0", "127.0.0.1", 0, listen=True)

    def ready(self) -> dict[str, Any]:
        return {"port": self._socket.port}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        if command == "begin":
            self._recorder.begin(arguments["t0_us"], arguments["cap_s"])
        elif command == "end":
            self.turn()
            self._recorder.end(arguments["reason"], arguments.get("error"))
        return None

    def turn(self) -> None:
        self._recorder.telemetry(self._socket.receive(0.02))

    def close(self) -> None:
        self._recorder.close()
        self._socket.close()


def create(config: EstimateLoggerConfig) -> EstimateLogger:
    """Return the logger for an episode folder."""
    return EstimateLogger(config)
