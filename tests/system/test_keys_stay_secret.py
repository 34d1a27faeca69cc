"""API keys of the base URL and the environment appear in no file of a run and in no terminal output.

This also holds if the endpoint echoes them.
"""

import base64
import contextlib
import json
import os
import subprocess
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import quote

import psutil
import pytest

from dronecats.cli.main import main
from tests.support.command_line import DRONECATS
from tests.support.first_question import is_first_question

IN_THE_PATH = "c0ffee0123456789abcdef0123456789abcdef42"
IN_THE_QUERY = "q/Top+Secret=1"
IN_THE_USER = "hush%2Fhush"
IN_THE_ENVIRONMENT = "sk-environment-9876543210"
SECRETS = (IN_THE_PATH, IN_THE_QUERY, IN_THE_USER, "hush/hush", IN_THE_ENVIRONMENT)


class Echo(BaseHTTPRequestHandler):
    """Echoes all it receives, and all keys, in several encodings: in replies, errors and redirect targets."""

    protocol_version = "HTTP/1.1"
    replies = 0

    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        assert isinstance(self.server, RecordingEndpoint)
        self.server.paths.append(self.path)
        outputs = " ".join((self.path, quote(self.path, safe=""), *map(str, self.headers.values()), *SECRETS))
        outputs += f" http://{self.headers['Host']}{self.path}"
        step = len(self.server.paths)
        if step <= 2:  # the first question before take-off, and a step
            self._reply(outputs + ' {"action":"rotate","angle_deg":5}')
        elif step == 3:
            self._reply(json.dumps({"action": SECRETS[list(ENDS).index(self.server.end)]}))
        else:
            ENDS[self.server.end](self, outputs)

    def _reply(self, text):
        self._answer(200, {"choices": [{"message": {"content": text}}]})

    def _answer(self, status, data, **headers):
        body = data if isinstance(data, bytes) else json.dumps(data).encode()
        self.send_response(status)
        for name, value in {"Content-Length": str(len(body)), "Retry-After": "0", **headers}.items():
            self.send_header(name, value)
        self.end_headers()
        with contextlib.suppress(ConnectionError):
            self.wfile.write(body)

    def do_GET(self):
        self._answer(404, self.path.encode())

    def log_message(self, *_):
        pass


ENDS = {
    "refusal": lambda handler, outputs: handler._answer(500, outputs.encode()),
    "redirect": lambda handler, outputs: handler._answer(302, outputs.encode(), Location=handler.path + "/elsewhere"),
}


class RecordingEndpoint(ThreadingHTTPServer):
    """An endpoint that stores the paths of its requests."""

    def __init__(self, end: str) -> None:
        super().__init__(("127.0.0.1", 0), Echo)
        self.end = end  # key of ENDS: how it answers from the fourth call on
        self.paths: list[str] = []


@pytest.mark.parametrize("end", ENDS)
def test_keys_of_url_and_environment_are_in_no_file_and_no_output(tmp_path, monkeypatch, capfdbinary, end):
    server = RecordingEndpoint(end)
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    path = f"/{IN_THE_PATH}/v1"
    query = f"api_key={quote(IN_THE_QUERY, safe='')}"
    url = f"http://me:{IN_THE_USER}@127.0.0.1:{server.server_port}{path}?{query}"
    monkeypatch.setenv("OPENAI_API_KEY", IN_THE_ENVIRONMENT)
    status = main(["fly", "--sitl", "--speed", "max", "--latency", "fixed:0",
                   "--model", "openai/x", "--base-url", url, "--cache", str(tmp_path / "replies.sqlite"),
                   "--out", str(tmp_path / "run"), "--json"])  # fmt: skip
    captured = capfdbinary.readouterr()
    server.shutdown()
    server.server_close()
    assert status == 3, captured.err
    assert set(server.paths) == {f"{path}/chat/completions?{query}"}
    files = {str(path): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    outputs = {**files, "stdout": captured.out, "stderr": captured.err}
    assert {"ledger.sqlite", "replies.sqlite"} <= {name.rpartition("/")[2] for name in files}
    decisions = next(data for name, data in files.items() if name.endswith("decisions.jsonl")).splitlines()
    assert json.loads(decisions[0])["action"] == {"action": "rotate", "angle_deg": 5}
    assert "***" in json.loads(decisions[0])["reply"]
    assert (b"***" if end != "redirect" else b"redirect") in captured.err
    for secret in SECRETS:
        basic = base64.b64encode(f"me:{secret}".encode()).decode().rstrip("=")
        for spelt in {secret, quote(secret, safe=""), quote(quote(secret, safe=""), safe=""), basic}:
            leaks = [name for name, data in outputs.items() if spelt.encode() in data]
            assert not leaks, (secret, spelt, leaks)


class Looking(BaseHTTPRequestHandler):
    """On a question, records the command line and environment of each child process of the flight."""

    def do_POST(self):
        prompt = self.rfile.read(int(self.headers["Content-Length"])).decode()
        assert isinstance(self.server, Seen)
        if is_first_question(prompt):
            body = json.dumps({"choices": [{"message": {"content": "{}"}}]}).encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)
            return
        for child in psutil.Process(self.server.flying).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):  # the process has ended meanwhile
                command, environment = " ".join(child.cmdline()), " ".join(child.environ().values())
                self.server.seen[command] = environment
        self.send_response(401)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def do_GET(self):
        self.send_response(404)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *_):
        pass


class Seen(ThreadingHTTPServer):
    """Stores the environment of each child process by its command line."""

    flying = 0  # pid
    seen: dict[str, str]


@pytest.mark.slow("flies in real time")
def test_child_processes_do_not_get_the_api_key(tmp_path):
    server = Seen(("127.0.0.1", 0), Looking)
    server.seen = {}
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    command = [*DRONECATS, "fly", "--sitl", "--model", "openai/x", "--base-url", f"http://127.0.0.1:{server.server_port}/v1",
               "--out", str(tmp_path / "run")]  # fmt: skip
    environment = {**os.environ, "OPENAI_API_KEY": IN_THE_ENVIRONMENT, "MINE": "not-a-secret"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment) as flight:
        server.flying = flight.pid
        _, err = flight.communicate(timeout=600)
    server.shutdown()
    server.server_close()
    assert flight.returncode == 3, err
    modules = {line.rpartition(" ")[2].partition(":")[0] for line in server.seen}
    assert {"dronecats.flight.sitl.simulator_process", "dronecats.flight.sitl.camera"} <= modules, err
    for line, environ in server.seen.items():
        assert IN_THE_ENVIRONMENT not in line + environ, line
        assert "not-a-secret" in environ
