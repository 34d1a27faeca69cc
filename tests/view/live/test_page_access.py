"""Access to a page: only browsers on this machine that have the complete address."""

import http.server
import socket
import threading
import time
import urllib.error
import urllib.parse
import urllib.request

import psutil
import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from dronecats.view.scene.page import LoopbackServer


@pytest.fixture(scope="module")
def server():
    made = LoopbackServer("test", 0)
    yield made
    made.stop()


def get_page(server, path, **headers):
    """Return (status, Set-Cookie) of a GET of the page's server."""
    request = urllib.request.Request(urllib.parse.urljoin(server.url, path), headers=headers)
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(request, timeout=10.0) as answer:
            return answer.status, answer.headers["Set-Cookie"]
    except urllib.error.HTTPError as refused:
        with refused:
            return refused.code, refused.headers["Set-Cookie"]


def listens(server, address, **headers):
    """Return the status of a refused WebSocket, 101 for an open one."""
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    try:
        with connect(address, subprotocols=[protocol], max_size=None, additional_headers=headers, proxy=None):
            return 101
    except InvalidStatus as refused:
        return refused.response.status_code


def test_the_page_opens_with_the_token_and_then_with_its_cookie(server):
    assert get_page(server, "/") == (403, None)
    assert get_page(server, "/?token=wrong") == (403, None)
    assert get_page(server, "/?token=") == (403, None)
    assert get_page(server, "/?token=%C3%A9") == (403, None)
    status, cookie = get_page(server, server.url)
    assert status == 200
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert get_page(server, "/", Cookie=f"other=1; {cookie.split(';')[0]}") == (200, None)
    assert get_page(server, "/", Cookie=cookie.split(";")[0][:-1]) == (403, None)


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1.evil.example:{port}", "[::1", ""])
def test_a_foreign_host_name_is_rejected(server, host):
    named = host.format(port=server.get_port())
    assert get_page(server, server.url, Host=named)[0] in (400, 403)
    assert get_page(server, server.url, Host=f"localhost:{server.get_port()}")[0] == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1"])
def test_a_foreign_origin_is_rejected_even_with_the_token(server, origin):
    address = server.url.replace("http://", "ws://")
    assert listens(server, address) == 101
    assert listens(server, address, Origin=f"http://127.0.0.1:{server.get_port()}") == 101
    assert listens(server, address, Origin=origin.format(port=server.get_port())) == 403
    assert listens(server, address.split("?")[0]) == 403


@pytest.fixture(scope="module")
def behind_a_proxy():
    made = LoopbackServer("test", 0, ["drone.example.org"])
    yield made
    made.stop()


@pytest.mark.parametrize("host", ["drone.example.org", "Drone.Example.org:8443"])
@pytest.mark.parametrize("scheme", ["http", "https"])
def test_a_configured_host_name_opens_the_page(behind_a_proxy, host, scheme):
    address = behind_a_proxy.url.replace("http://", "ws://")
    assert get_page(behind_a_proxy, "/", Host=host) == (403, None)  # the token is required under any name
    assert get_page(behind_a_proxy, behind_a_proxy.url, Host=host)[0] == 200
    assert get_page(behind_a_proxy, behind_a_proxy.url, Host=host, Origin=f"{scheme}://{host}")[0] == 200
    assert get_page(behind_a_proxy, behind_a_proxy.url, Host=host, Origin=f"{scheme}://{host}1")[0] == 403
    assert get_page(behind_a_proxy, behind_a_proxy.url, Host="evil.example")[0] == 403
    assert get_page(behind_a_proxy, behind_a_proxy.url)[0] == 200
    assert listens(behind_a_proxy, address, Origin=f"{scheme}://{host}") == 403  # its Host is the loopback address


def test_a_page_with_a_configured_name_listens_only_on_loopback(behind_a_proxy):
    connections = psutil.Process().net_connections("tcp")
    here = {c.laddr.ip for c in connections if c.laddr and c.laddr.port == behind_a_proxy.get_port()}
    assert here == {"127.0.0.1"}


def test_a_browser_that_delays_the_end_of_the_server_makes_it_print_nothing(capfd):
    server = LoopbackServer("test", 0)
    address = urllib.parse.urlsplit(server.url)
    with socket.socket() as browser:
        browser.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        browser.connect((address.hostname, address.port))
        request = f"GET {address.path}?{address.query} HTTP/1.1\r\nHost: {address.netloc}\r\n\r\n"
        browser.sendall(request.encode())
        browser.recv(1)  # the page is larger than the buffers, so the server has to wait for the rest to be read
        server.stop()
    thread = server._websock_server._server_thread
    assert thread is not None
    thread.join(30.0)
    assert not thread.is_alive()
    assert capfd.readouterr().out == ""


SITE = """<script>
const socket = new WebSocket("ws://127.0.0.1:{port}", "viser-v{version}");
socket.onopen = () => document.title = "opened";
socket.onerror = () => document.title = "refused";
</script>"""


def test_another_site_in_the_browser_is_rejected_and_the_page_works(browser, server):
    """The other site is a page on another port, whose requests carry the cookies of 127.0.0.1."""
    body = SITE.replace("{port}", str(server.get_port())).replace("{version}", viser.__version__).encode()

    class Site(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_):
            pass

    def until(true):
        due_s = time.monotonic() + 30.0
        while not true():
            assert time.monotonic() < due_s
            time.sleep(0.05)

    browser.get(server.url)
    until(server.get_clients)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Site) as site:
        thread = threading.Thread(target=site.serve_forever)
        thread.start()
        try:
            browser.get(f"http://127.0.0.1:{site.server_port}/")
            until(lambda: browser.title)
        finally:
            site.shutdown()
            thread.join()
    assert browser.title == "refused"
    before = set(server.get_clients())
    browser.get(f"http://127.0.0.1:{server.get_port()}/")  # the cookie is enough
    until(lambda: set(server.get_clients()) - before)
