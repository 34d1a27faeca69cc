"""Snapshot and motion JPEG cameras, over real sockets."""

import base64
import hashlib
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foundation.errors import CameraError
from hil.cameras.address import shown
from hil.cameras.http import HttpCamera, Multipart
from hil.cameras.open import open_camera
from hil.cameras.stream import StreamCamera
from tests.hil.cameras import picture_code
from tests.hil.cameras.host_clock import host_us
from tests.hil.cameras.http_cameras import HttpServer, MjpegServer, jpeg, reply
from tests.support.refusal import refusal


@pytest.fixture
def serve():
    servers = []

    def start(server):
        servers.append(server)
        return server

    yield start
    for server in servers:
        server.close()


def test_a_snapshot_of_the_simulated_camera_keeps_the_timestamp_of_its_header(serve):
    stamped = {"X_Frame_Id": "41", "X_Frame_Time_Us": "7000000", "Content_Type": "image/jpeg"}
    server = serve(HttpServer(lambda handler: reply(handler, 200, jpeg(5), **stamped)))
    camera = open_camera(server.url(), lambda: 7_400_000)
    frame = camera.newest()
    assert isinstance(camera, HttpCamera)
    assert (frame.frame_id, frame.time_us, picture_code.read(frame.image_rgb)) == (41, 7_000_000, 5)
    assert (camera.model.width, camera.model.height, camera.model.hfov_deg) == (256, 144, 90.0)
    camera.close()


def test_an_old_snapshot_raises_an_error(serve):
    stamped = {"X_Frame_Id": "41", "X_Frame_Time_Us": "7000000"}
    server = serve(HttpServer(lambda handler: reply(handler, 200, jpeg(5), **stamped)))
    camera = open_camera(server.url(), lambda: 8_600_000)
    with pytest.raises(CameraError, match=r"1\.6 s"):
        camera.newest()
    camera.close()


def test_a_snapshot_without_a_timestamp_gets_the_arrival_time_of_its_first_bytes(serve):
    """The image arrives in two halves within 0.3 s. The timestamp does not include this time."""
    began = []

    def slow(handler):
        picture = jpeg(9)
        handler.send_response(200)
        handler.send_header("Content-Length", str(len(picture)))
        handler.end_headers()
        began.append(host_us())
        handler.wfile.write(picture[:500])
        handler.wfile.flush()
        threading.Event().wait(0.3)
        handler.wfile.write(picture[500:])

    server = serve(HttpServer(slow))
    camera = HttpCamera(server.url(), host_us)
    frame = camera.newest()
    assert picture_code.read(frame.image_rgb) == 9
    assert 0 <= frame.time_us - began[-1] < 150_000
    assert host_us() - frame.time_us > 290_000
    camera.close()


@pytest.mark.parametrize("lengths", [True, False])
def test_motion_jpeg_returns_the_newest_image_after_a_pause_without_reads(serve, lengths):
    server = serve(MjpegServer(20.0, lengths=lengths))
    camera = open_camera(server.url(), host_us)
    assert isinstance(camera, StreamCamera)
    camera.newest()
    threading.Event().wait(1.0)  # 20 unread images: a buffered stream would now lag by 1 s
    now, asked_us = server.number_now(), host_us()
    frame = camera.newest()
    # without a length, an image is complete only when the next one begins
    assert picture_code.read(frame.image_rgb) >= now - (4 if lengths else 5)
    assert 0 <= asked_us - frame.time_us < 300_000
    after = camera.following(frame.frame_id)
    assert after.frame_id > frame.frame_id
    assert after.time_us > frame.time_us
    camera.close()


def test_an_image_is_stamped_with_the_vehicle_clock_at_its_arrival(serve):
    server = serve(MjpegServer(10.0))
    camera = open_camera(server.url(), lambda: host_us() + 5_000_000_000)
    frame = camera.newest()
    born_us = round((server.began_s + picture_code.read(frame.image_rgb) / server.rate_hz) * 1e6)
    assert 0 <= frame.time_us - 5_000_000_000 - born_us < 200_000
    camera.close()


def test_a_silent_stream_raises_an_error_instead_of_returning_an_old_image(serve):
    server = serve(MjpegServer(20.0, then_silent_after=3))
    camera = StreamCamera(*stream_of(server), patience_s=0.2)
    camera.following(1)
    threading.Event().wait(1.2)
    with pytest.raises(CameraError, match=r"1\.\d s"):
        camera.newest()
    camera.close()


def test_a_dropped_stream_is_reopened(serve):
    server = serve(MjpegServer(20.0))
    camera = open_camera(server.url(), host_us)
    before = camera.newest()
    server.cut.set()
    threading.Event().wait(0.2)
    server.cut.clear()
    after = camera.following(camera.newest().frame_id + 3)
    assert picture_code.read(after.image_rgb) > picture_code.read(before.image_rgb)
    assert camera.reopened >= 1
    camera.close()


def test_a_snapshot_camera_that_hangs_raises_an_error_after_the_patience_of_all_cameras(serve, monkeypatch):
    monkeypatch.setattr("hil.cameras.open.PATIENCE_S", 0.2)
    requests, over = [], threading.Event()

    def hanging(handler):
        """Answer the first request, with which the camera is opened, at once, and later requests after 3 s."""
        requests.append(handler)
        if len(requests) > 1:
            over.wait(3.0)
        reply(handler, 200, jpeg(5), Content_Type="image/jpeg")

    camera = open_camera(serve(HttpServer(hanging)).url(), host_us)
    with pytest.raises(CameraError, match="timed out"):
        camera.newest()
    over.set()
    camera.close()


def test_an_answer_that_is_not_a_stream_leaves_no_connection_open(serve):
    answered, ended = [], threading.Event()

    def page(handler):
        """Send the beginning of a page, and wait until the client closes the connection."""
        handler.send_response(200)
        handler.send_header("Content-Type", "text/html")
        handler.send_header("Content-Length", "1000")
        handler.end_headers()
        answered.append(handler)
        if handler.rfile.read(1) == b"":
            ended.set()

    source, *_ = stream_of(serve(HttpServer(page)))
    for attempt in range(1, 4):
        with pytest.raises(CameraError, match="no boundary"):
            source.open()
        assert ended.wait(5.0)
        assert len(answered) == attempt
        ended.clear()


def stream_of(server):
    from hil.cameras.http import Caller, MjpegSource
    from hil.cameras.lens import Lens

    return MjpegSource(Caller(server.url())), "a test", host_us, Lens()


def test_digest_authentication(serve):
    def guarded(handler):
        header = handler.headers.get("Authorization", "")
        fields = dict(part.strip().split("=", 1) for part in header.removeprefix("Digest ").split(",") if "=" in part)
        fields = {name: value.strip('"') for name, value in fields.items()}
        if header.startswith("Digest ") and fields["response"] == digest("pilot", "hush/@1", fields):
            return reply(handler, 200, jpeg(3))
        return reply(handler, 401, b"no", WWW_Authenticate='Digest realm="cam", nonce="abc", qop="auth"')

    def digest(user, password, fields):
        def md5(text):
            return hashlib.md5(text.encode()).hexdigest()

        a1, a2 = md5(f"{user}:cam:{password}"), md5(f"GET:{fields['uri']}")
        return md5(f"{a1}:abc:{fields['nc']}:{fields['cnonce']}:auth:{a2}")

    server = serve(HttpServer(guarded))
    camera = open_camera(server.url(user="pilot:hush%2F%401"), host_us)
    assert picture_code.read(camera.newest().image_rgb) == 3
    camera.close()


def test_basic_authentication(serve):
    wanted = "Basic " + base64.b64encode(b"pilot:hush").decode()

    def guarded(handler):
        right = handler.headers.get("Authorization") == wanted
        return reply(handler, 200, jpeg(3)) if right else reply(handler, 401, b"no", WWW_Authenticate="Basic")

    server = serve(HttpServer(guarded))
    camera = open_camera(server.url(user="pilot:hush"), host_us)
    assert picture_code.read(camera.newest().image_rgb) == 3
    camera.close()


@pytest.mark.parametrize(
    ("status", "body", "headers", "word"),
    [
        (503, b"still starting\n", {}, "503"),
        (200, b"<html>", {"Content_Type": "text/html"}, "picture"),
        (200, b"", {}, "picture"),
        (200, jpeg(1), {"X_Frame_Id": "seven"}, "X-Frame"),
        (200, b"", {"Content_Type": "multipart/x-mixed-replace"}, "boundary"),
    ],
)
def test_camera_errors_are_one_sentence_without_the_password(serve, status, body, headers, word):
    server = serve(HttpServer(lambda handler: reply(handler, status, body, **headers)))
    with pytest.raises(CameraError, match=word) as caught:
        open_camera(server.url("/x.jpg?channel=1&password=hush2", user="pilot:hush1"), host_us).newest()
    assert "hush" not in str(caught.value)
    assert "pilot" not in str(caught.value)
    assert "channel=1" in str(caught.value)


def test_an_absent_camera_is_reported_without_the_password():
    for url in ("http://pilot:hush@127.0.0.1:1/x", "rtsp://pilot:hush@127.0.0.1:1/x?token=hush"):
        with pytest.raises(CameraError, match=r"\*\*\*@127\.0\.0\.1:1/x") as caught:
            open_camera(url, host_us)
        assert "hush" not in str(caught.value)
    message = refusal(open_camera, "http://pilot:hu/sh@host/x", host_us)
    assert "http://***@host/x" in message
    assert "hu/sh" not in message


PARTS = st.lists(st.binary(min_size=1, max_size=200).filter(lambda b: b"--B" not in b), min_size=1, max_size=5)


@given(PARTS, st.booleans(), st.integers(1, 60), st.sampled_from(["B", "--B", '"B"']))
def test_multipart_parsing_does_not_depend_on_chunk_sizes(bodies, lengths, cut, named):
    stream = b"a preamble"
    for body in bodies:
        length = f"Content-Length: {len(body)}\r\n" if lengths else ""
        stream += f"\r\n--B\r\nContent-Type: image/jpeg\r\n{length}\r\n".encode() + body
    stream += b"\r\n--B\r\n"
    parts = Multipart(f"multipart/x-mixed-replace;boundary={named}")
    got = []
    for second, at in enumerate(range(0, len(stream), cut)):
        got += [(second, *part) for part in parts.feed(stream[at : at + cut], float(second))]
    assert [body for _, _, body in got] == bodies
    assert all(began <= second for second, began, _ in got)


@pytest.mark.parametrize("parameter", ["Boundary=B", "boundary = B", 'x=1; BOUNDARY="--B"'])
def test_the_boundary_is_found_in_any_legal_header(parameter):
    stream = b"--B\r\nContent-Length: 1\r\n\r\na\r\n--B\r\n"
    parts = Multipart(f"Multipart/X-Mixed-Replace; {parameter}")
    assert [body for _, body in parts.feed(stream, 0.0)] == [b"a"]


@pytest.mark.parametrize("secret", ["ab/cd", "YWJj/ZGVm+=="])
def test_no_part_of_a_password_in_a_query_is_shown(secret):
    text = shown(f"http://cam/snap.cgi?user=admin&pwd={secret}&size=2")
    assert text.endswith("pwd=***&size=2")
    assert "admin" not in text


@given(st.binary(max_size=2000), st.integers(1, 100))
def test_random_bytes_raise_no_exception_in_the_multipart_parser(data, cut):
    parts = Multipart("multipart/x-mixed-replace; boundary=B")
    for at in range(0, len(data), cut):
        for began_s, body in parts.feed(data[at : at + cut], 1.0):
            assert began_s == 1.0
            assert body in data
