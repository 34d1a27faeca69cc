"""A key in the base URL or the environment is in no file of a run and on no terminal, whatever the endpoint echoes."""

import base64
import contextlib
import json
import os
import subprocess
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import quote

import pytest

from tests.support.command_line import DRONECATS

IN_THE_PATH = "c0ffee0123456789abcdef0123456789abcdef42"
IN_THE_QUERY = "q/Top+Secret=1"
IN_THE_USER = "hush%2Fhush"
IN_THE_ENVIRONMENT = "sk-environment-9876543210"
SECRETS = (IN_THE_PATH, IN_THE_QUERY, IN_THE_USER, "hush/hush", IN_THE_ENVIRONMENT)


class Echo(BaseHTTPRequestHandler):
    """Says everything it was told, in every spelling: in replies, in refusals, in where it redirects to."""

    protocol_version = "HTTP/1.1"
    replies = 0

    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        assert isinstance(self.server, Told)
        self.server.asked.append(self.path)
        told = " ".join((self.path, quote(self.path, safe=""), *map(str, self.headers.values()), *SECRETS))
        told += f" http://{self.headers['Host']}{self.path}"
        step = len(self.server.asked)
        if step == 1:
            self._reply(told + ' {"action":"rotate","angle_deg":5}')
        elif step == 2:
            self._reply(json.dumps({"action": SECRETS[list(ENDS).index(self.server.end)]}))
        else:
            ENDS[self.server.end](self, told)

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
    "refusal": lambda handler, told: handler._answer(500, told.encode()),
    "redirect": lambda handler, told: handler._answer(302, told.encode(), Location=handler.path + "/elsewhere"),
}


class Told(ThreadingHTTPServer):
    """An endpoint that remembers which paths it was asked for."""

    def __init__(self, end: str) -> None:
        super().__init__(("127.0.0.1", 0), Echo)
        self.end = end  # one of ENDS: how it answers from the third call on
        self.asked: list[str] = []


@pytest.mark.parametrize("end", ENDS)
def test_a_key_in_the_address_is_told_nowhere(tmp_path, end):
    server = Told(end)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    path = f"/{IN_THE_PATH}/v1"
    query = f"api_key={quote(IN_THE_QUERY, safe='')}"
    url = f"http://me:{IN_THE_USER}@127.0.0.1:{server.server_port}{path}?{query}"
    command = [*DRONECATS, "fly", "--sitl", "--speed", "max", "--latency", "fixed:0",
               "--model", "openai/x", "--base-url", url, "--out", str(tmp_path / "run"), "--json"]  # fmt: skip
    environment = {**os.environ, "OPENAI_API_KEY": IN_THE_ENVIRONMENT}
    flown = subprocess.run(command, capture_output=True, env=environment, timeout=600)
    server.shutdown()
    server.server_close()
    assert flown.returncode == 3, flown.stderr
    assert set(server.asked) == {f"{path}/chat/completions?{query}"}
    files = {str(path): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    told = {**files, "stdout": flown.stdout, "stderr": flown.stderr}
    decisions = next(data for name, data in files.items() if name.endswith("decisions.jsonl")).splitlines()
    assert json.loads(decisions[0])["action"] == {"action": "rotate", "angle_deg": 5}
    assert "***" in json.loads(decisions[0])["reply"]
    assert b"***" in flown.stderr if end != "redirect" else b"a redirect: none is followed" in flown.stderr
    for secret in SECRETS:
        basic = base64.b64encode(f"me:{secret}".encode()).decode().rstrip("=")
        for spelt in {secret, quote(secret, safe=""), quote(quote(secret, safe=""), safe=""), basic}:
            found = [name for name, data in told.items() if spelt.encode() in data]
            assert not found, (secret, spelt, found)
