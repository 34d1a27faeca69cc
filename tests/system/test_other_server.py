"""Flights through a third-party server, LiteLLM's proxy. See docs/models-reference.md.

The tests run if DRONECATS_LITELLM names the command of the proxy.
The proxy forwards the requests of our client to a built-in pilot, and the replies back.
"""

import json
import os
import secrets
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

from dronecats.pilots import roster
from dronecats.pilots.server import PilotServer
from tests.agent.models.pointing import Pointer
from tests.agent.models.recording import Recording
from tests.needs import needs
from tests.support.command_line import DRONECATS, last_object
from tests.support.ports import free_port

COMMAND = os.environ.get("DRONECATS_LITELLM")
START_S = 300.0  # wall s; the proxy's imports take 15 s
pytestmark = [pytest.mark.slow("starts LiteLLM's proxy and flies through it"), needs("litellm")]


@dataclass(frozen=True)
class Proxy:
    """LiteLLM's proxy for an endpoint. Its name for the endpoint's model is `behind`."""

    url: str  # without a path
    key: str
    folder: Path

    def dronecats(self, *words: str, key: str | None = None) -> subprocess.CompletedProcess[str]:
        """Run our program with the proxy's key in the environment."""
        keys = {f"{vendor}_API_KEY": key or self.key for vendor in ("LITELLM", "ANTHROPIC", "GEMINI")}
        environment = {**os.environ, **keys, "DRONECATS_MODELS": str(self.folder / "models.toml")}
        (self.folder / "models.toml").touch()
        return subprocess.run([*DRONECATS, *words], env=environment, capture_output=True, text=True, timeout=600)


@contextmanager
def proxy(folder: Path, behind: str) -> Iterator[Proxy]:
    """Yield LiteLLM's proxy in front of the endpoint at `behind`."""
    assert COMMAND
    entry = {"model": "hosted_vllm/behind", "api_base": behind, "api_key": "none"}
    config = folder / "config.yaml"  # JSON is YAML
    config.write_text(json.dumps({"model_list": [{"model_name": "behind", "litellm_params": entry}]}))
    port, key = free_port(socket.SOCK_STREAM), f"sk-{secrets.token_hex(24)}"
    # without our Python variables, and with its bundled price list, so it sends no request to the network
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    environment |= {"LITELLM_MASTER_KEY": key, "LITELLM_LOCAL_MODEL_COST_MAP": "True"}
    words = [COMMAND, "--config", str(config), "--host", "127.0.0.1", "--port", str(port)]
    with (folder / "proxy.log").open("w") as log:
        running = subprocess.Popen(words, env=environment, cwd=folder, stdout=log, stderr=subprocess.STDOUT)
    try:
        until = time.monotonic() + START_S
        while not alive(url := f"http://127.0.0.1:{port}"):
            assert running.poll() is None, (folder / "proxy.log").read_text()[-3000:]
            assert time.monotonic() < until, (folder / "proxy.log").read_text()[-3000:]
            time.sleep(0.2)
        yield Proxy(url, key, folder)
    finally:
        running.terminate()
        running.wait(30)


def alive(url: str) -> bool:
    try:
        return httpx.get(f"{url}/health/liveliness", timeout=2).status_code == 200
    except httpx.TransportError:
        return False


def test_a_flight_through_the_proxy_equals_a_direct_flight(tmp_path):
    with PilotServer(roster.answer("vision"), "behind") as pilot, proxy(tmp_path, pilot.base_url) as through:
        flights = {}
        for model, url in (("litellm/behind", through.url + "/v1"), ("local/behind", pilot.base_url)):
            out = tmp_path / model.split("/")[0]
            words = ("--speed", "max", "--model", model, "--base-url", url, "--out", str(out), "--json")
            process = through.dronecats("fly", "--sitl", *words)
            assert process.returncode == 0, process.stderr + process.stdout
            flights[model] = last_object(process.stdout), out
        refused = through.dronecats(
            "models", "check", "litellm/behind", "--base-url", through.url + "/v1", key="sk-quite-another-key"
        )
    logs = [out / result["episode"] for result, out in flights.values()]
    assert all(result["success"] for result, _ in flights.values())
    assert len({(log / "truth.jsonl").read_bytes() for log in logs}) == 1  # identical flights
    replies = [[json.loads(line)["reply"] for line in (log / "decisions.jsonl").open()] for log in logs]
    assert replies[0] == replies[1]
    assert refused.returncode == 3
    assert through.key not in refused.stderr
    assert not any(
        through.key.encode() in path.read_bytes() for out in logs for path in out.rglob("*") if path.is_file()
    )


@pytest.mark.parametrize(("provider", "schema"), [("litellm", "array"), ("anthropic", "object")])
def test_the_proxy_understands_our_request_formats(tmp_path, provider, schema):
    """Gemini's format is omitted: the proxy's adapter reads `inline_data`, not `inlineData`, and drops the picture."""
    with Recording(Pointer("as declared", enforces=True)) as server, proxy(tmp_path, server.url + "/v1") as through:
        words = ("check", f"{provider}/behind", "--base-url", through.url + "/v1", "--schema", schema, "--json")
        checked = through.dronecats("models", *words)
    assert checked.returncode == 0, checked.stderr + checked.stdout
    report = last_object(checked.stdout)
    assert (report["pointing"], report["schema_enforced"]) == ("as declared", True), report
    assert (report["tokens_in"], report["tokens_out"]) == (400, 80)
