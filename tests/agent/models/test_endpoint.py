"""Faulty endpoints (hang, trickle, reset, flood) give a reply or an error within the time limit. Over real TCP."""

import gzip
import re
import threading
import zlib
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime

import httpx
import pytest

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.latency import LatencyPolicy, Question
from dronecats.agent.loop import PaperAgent, PendingQuestion, Questions
from dronecats.agent.models import endpoint as endpoints
from dronecats.agent.models.endpoint import MAX_PAUSE_S, Endpoint, RetryPolicy, retry_after_s
from dronecats.agent.models.model import Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import ChatModel, open_model
from dronecats.agent.prompt import Prompt
from foundation.camera import CameraModel
from foundation.errors import ModelError, UsageError
from foundation.run_folder.writing import LineLog
from foundation.threads import DaemonExecutor, InlineExecutor
from tests.agent.flown_wire import Clock, Views
from tests.agent.models.faulty_wire import Wire, answer, completion, hang, reset, say, trickle

REQUEST = Request("text", (b"jpeg",), thinking=False)
FIRST = Question((0,), 0, 0)
QUICK = RetryPolicy(give_up_s=0.5, attempts=3, pause_s=0.0)


@pytest.fixture
def serve():
    opened = []

    def start(*script):
        opened.append(Wire(*script))
        return opened[-1]

    yield start
    for wire in opened:
        wire.close()


def model(wire, patience=QUICK):
    return open_model(ModelSpec(provider="local", name="m", base_url=wire.url), patience)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_a_proxy_from_the_environment_is_not_used_for_this_machine(serve, monkeypatch, host):
    proxy = serve(say(answer(500, b"the proxy")))
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, proxy.url)
    for name in ("no_proxy", "NO_PROXY"):
        monkeypatch.delenv(name, raising=False)
    wire = serve(say(completion("here")))
    address = wire.url.replace("127.0.0.1", host)
    client = open_model(ModelSpec(provider="local", name="m", base_url=address), QUICK)
    assert client.ask(REQUEST).text == "here"


def test_a_proxy_from_the_environment_is_used_for_other_machines(serve, monkeypatch):
    monkeypatch.setenv("http_proxy", serve(say(completion("through the proxy"))).url)
    client = open_model(ModelSpec(provider="local", name="m", base_url="http://models.example/v1"), QUICK)
    assert client.ask(REQUEST).text == "through the proxy"


@pytest.mark.parametrize(
    ("act", "left"),
    [
        (hang, False),
        (trickle(b"HTTP/1.1 200 OK\r\nX-Long: "), False),  # slow headers have no timeout: the connection stays
        (trickle(b"HTTP/1.1 200 OK\r\nContent-Length: 1000000\r\n\r\n"), True),
        (trickle(b"HTTP/1.1 503 Busy\r\nContent-Length: 1000000\r\n\r\n"), True),
    ],
    ids=["hang", "header", "body", "refusal"],
)
def test_hanging_and_trickling_servers_time_out(serve, act, left):
    wire = serve(act)
    with pytest.raises(ModelError, match=r"0\.5 s"):
        model(wire).ask(REQUEST)
    assert wire.served == 1
    assert wire.dropped.wait(30.0 if left else 0.0) == left


def test_a_retry_pause_beyond_the_time_limit_is_not_awaited(serve):
    wire = serve(say(b"HTTP/1.1 429 Busy\r\nRetry-After: 50\r\nContent-Length: 4\r\nConnection: close\r\n\r\nbusy"))
    with pytest.raises(ModelError, match="429"):
        model(wire).ask(REQUEST)
    assert wire.served == 1  # the server's 50 s exceed the limit


@pytest.mark.parametrize(
    "fault", [reset, say(b""), say(b"HTTP/1.1 200 OK\r\nContent-Length: 50\r\n\r\n{"), say(b"no HTTP at all\r\n\r\n")]
)
def test_broken_connections_are_retried_within_the_attempts(serve, fault):
    wire = serve(fault, fault, say(completion("there")))
    reply = model(wire).ask(REQUEST)
    assert (reply.text, wire.served) == ("there", 3)
    assert reply.waited_s > 0.0
    wire = serve(fault)
    with pytest.raises(ModelError, match=re.escape(wire.url)):
        model(wire).ask(REQUEST)
    assert wire.served == 3


def test_resets_and_http_errors_share_the_attempts(serve):
    wire = serve(reset, say(b"HTTP/1.1 500 X\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"), reset)
    with pytest.raises(ModelError):
        model(wire).ask(REQUEST)
    assert wire.served == 3


def test_a_redirect_is_reported_and_not_followed(serve):
    there = serve(say(completion("stolen")))
    wire = serve(say(f"HTTP/1.1 307 Gone\r\nLocation: {there.url}\r\nContent-Length: 0\r\n\r\n".encode()))
    with pytest.raises(ModelError, match="307"):
        model(wire).ask(REQUEST)
    assert (wire.served, there.served) == (1, 0)


@pytest.mark.parametrize("encoding", ["gzip", "deflate"])
def test_compressed_answers_are_read_and_decompression_bombs_are_rejected(serve, encoding, monkeypatch):
    pack = gzip.compress if encoding == "gzip" else zlib.compress
    body = pack(completion("small").partition(b"\r\n\r\n")[2])
    head = f"HTTP/1.1 200 OK\r\nContent-Encoding: {encoding}\r\nConnection: close\r\n\r\n".encode()
    assert model(serve(say(head + body))).ask(REQUEST).text == "small"
    largest = []
    inflater = zlib.decompressobj

    class Watched:
        def __init__(self, *arguments):
            self._inner = inflater(*arguments)

        def decompress(self, *arguments):
            largest.append(len(piece := self._inner.decompress(*arguments)))
            return piece

    monkeypatch.setattr(zlib, "decompressobj", Watched)
    bomb = pack(b" " * (64 * 2**20))
    with pytest.raises(ModelError, match="4,194,304"):
        model(serve(say(head + bomb)), RetryPolicy(give_up_s=30.0)).ask(REQUEST)
    assert sum(largest) <= endpoints.MAX_BODY_BYTES + 1
    with pytest.raises(ModelError, match="decompressed"):
        model(serve(say(head + b"no such thing"))).ask(REQUEST)
    with pytest.raises(ModelError, match="compressed"):
        model(serve(say(completion("x", "Content-Encoding: br")))).ask(REQUEST)


def test_an_endless_answer_is_cut_off(serve):
    def flood(wire, connection):
        connection.sendall(b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n")
        while not wire.over.is_set():
            connection.sendall(b" " * 65536)

    with pytest.raises(ModelError, match="4,194,304"):
        model(serve(flood), RetryPolicy(give_up_s=30.0)).ask(REQUEST)


def test_retry_after_as_seconds():
    for value, seconds in (
        ("7", 7.0), ("0.3", 0.3), ("-4", 0.0), ("1e9", MAX_PAUSE_S), ("nan", None), ("soon", None), ("", None),
    ):  # fmt: skip
        assert retry_after_s(httpx.Headers({"Retry-After": value})) == seconds, value


def test_retry_after_as_a_date():
    now = datetime(2026, 3, 1, 12, 0, 0, tzinfo=UTC)
    for ahead, seconds in ((20, 20.0), (-20, 0.0), (86400, MAX_PAUSE_S)):
        date = format_datetime(now + timedelta(seconds=ahead), usegmt=True)
        assert retry_after_s(httpx.Headers({"Retry-After": date}), now) == seconds
    assert retry_after_s(httpx.Headers({"Retry-After": "Sun, 01 Mar 2026 12:00:09"}), now) == 9.0
    assert retry_after_s(httpx.Headers({"Retry-After": "Sun, 99 Mar 2026 12:00:09 GMT"}), now) is None
    assert retry_after_s(httpx.Headers({})) is None


def test_a_retry_after_date_is_relative_to_the_answers_own_date():
    headers = {"Date": "Sun, 01 Mar 2020 12:00:00 GMT", "Retry-After": "Sun, 01 Mar 2020 12:00:20 GMT"}
    assert retry_after_s(httpx.Headers(headers)) == 20.0


@pytest.mark.parametrize("wish", ["0", "Sun, 01 Mar 2020 12:00:00 GMT"])
def test_a_retry_after_that_is_shorter_than_the_own_pause_does_not_shorten_it(serve, wish):
    busy = f"HTTP/1.1 503 Busy\r\nRetry-After: {wish}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n".encode()
    wire = serve(say(busy), say(completion("x")))
    assert model(wire, RetryPolicy(give_up_s=30.0, pause_s=0.3)).ask(REQUEST).waited_s >= 0.3


def test_time_of_failed_attempts_does_not_count_as_latency(serve):
    busy = say(b"HTTP/1.1 429 Busy\r\nRetry-After: 0.2\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
    asking = PendingQuestion(
        model(serve(busy, say(completion("x")))), REQUEST, InlineExecutor(), LatencyPolicy.parse("real"), FIRST, 100.0
    )
    reply = asking.reply()
    assert reply.waited_s >= 0.2
    took_s = 10.0 * (reply.latency_s + reply.waited_s)  # the vehicle's clock is ten times as fast as the wall clock
    assert asking.latency_s(100.0 + took_s) == pytest.approx(10.0 * reply.latency_s)


def flight(wire, folder, executor, patience_s=None, last_reply=True, patience=QUICK, on_tick=lambda: None):
    questions = Questions(
        model(wire, patience),
        Prompt.load(None),
        "go",
        LatencyPolicy.parse("fixed:0"),
        patience_s=patience_s,
        last_reply=last_reply,
    )
    cockpit = Cockpit(
        aircraft=[Clock()], camera=Views(), camera_model=CameraModel(), log=LineLog(folder / "decisions.jsonl"),
        frames_dir=folder, executor=executor, t0_us=0, on_tick=on_tick,
    )  # fmt: skip
    return PaperAgent(questions, cockpit)


class Answering(DaemonExecutor):
    """An executor in real time. Images and the first `count` replies arrive before the vehicle's clock advances."""

    def __init__(self, count):
        self.count = count

    def submit(self, fn, /, *args, **kwargs):
        coming = super().submit(fn, *args, **kwargs)
        is_question = isinstance(getattr(fn, "__self__", None), ChatModel)
        if not is_question or self.count > 0:
            coming.exception()
        self.count -= is_question
        return coming


@pytest.mark.parametrize("executor", [InlineExecutor(), Answering(2)], ids=["lockstep", "real time"])
def test_a_model_that_hangs_after_some_replies_is_a_model_error(serve, tmp_path, executor):
    answer = say(completion('{"action":"rotate","angle_deg":9}'))
    agent = flight(serve(answer, answer, hang), tmp_path, executor)
    with pytest.raises(ModelError, match=r"0\.5 s"):
        agent.fly(30.0)
    assert agent.steps == 2


def test_a_last_reply_after_the_time_limit_has_no_effect_and_is_no_error(serve, tmp_path):
    late = threading.Event()

    def slow(wire, connection):
        late.wait()
        connection.sendall(completion('{"action":"finished"}'))

    answer = say(completion('{"action":"rotate","angle_deg":9}'))
    agent: PaperAgent = flight(
        serve(answer, slow), tmp_path, Answering(1), patience=RetryPolicy(give_up_s=60.0),
        on_tick=lambda: late.set() if agent.now_s > 31.0 else None,
    )  # fmt: skip
    agent.fly(30.0)
    assert agent.steps == 1
    assert agent.now_s > 31.0


def test_a_flight_can_end_without_waiting_for_the_last_reply(serve, tmp_path):
    answer = say(completion('{"action":"rotate","angle_deg":9}'))
    agent = flight(serve(answer, hang), tmp_path, Answering(1), last_reply=False)
    agent.fly(30.0)
    assert (agent.steps, agent.now_s) == (1, pytest.approx(30.0))
    agent = flight(serve(answer, hang), tmp_path, Answering(1), patience_s=60.0, patience=RetryPolicy())
    with pytest.raises(ModelError, match="60 s"):
        agent.fly(30.0)


def test_the_url_path_is_extended_before_the_query():
    def url(base, path="chat/completions"):
        return str(Endpoint(base, None, (), QUICK).url(path))

    assert url("http://h/v1") == "http://h/v1/chat/completions"
    assert url("http://h/v1/") == "http://h/v1/chat/completions"
    assert url("http://h/v1?key=a%2Fb&x") == "http://h/v1/chat/completions?key=a%2Fb&x"
    assert url("http://h/a%2Fb/v1/#top") == "http://h/a%2Fb/v1/chat/completions"
    assert url("http://h") == "http://h/chat/completions"
    assert url("http://h?k=v") == "http://h/chat/completions?k=v"
    assert url("http://h/v1", "models?limit=9") == "http://h/v1/models?limit=9"
    assert url("http://h/v1?k=a%2Fb", "models?limit=9") == "http://h/v1/models?limit=9&k=a%2Fb"


@pytest.mark.parametrize(
    "url", ["http://key:SECRET9/v1", "http://h:99999999/SECRET9?", "http://[SECRET9", "http://SECRET9:x@[::"]
)
def test_the_error_about_an_invalid_url_does_not_contain_its_secrets(url):
    with pytest.raises(UsageError) as refused:
        open_model(ModelSpec(provider="local", name="m", base_url=url)).check()
    assert "SECRET9" not in str(refused.value)


def test_an_unusable_key_is_redacted(monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", "sk-Schlüssel")
    with pytest.raises(UsageError, match=r"api\.openai\.com") as refused:
        open_model(ModelSpec(provider="openai", name="m"))
    assert "Schl" not in str(refused.value)


@pytest.mark.parametrize("url", ["host/v1", "ftp://127.0.0.1/v1", "http:///v1", "http://", "http://192.168..1/v1"])
def test_urls_without_http_or_host_are_rejected_when_the_model_is_opened(url):
    with pytest.raises(UsageError, match="http://"):
        open_model(ModelSpec(provider="local", name="m", base_url=url))


@pytest.mark.parametrize("name", ["m\udcff", "m\n", "m\x1b[2J"])
def test_model_names_with_invalid_characters_are_rejected_when_the_model_is_opened(name):
    with pytest.raises(UsageError, match="name"):
        open_model(ModelSpec(provider="local", name=name, base_url="http://127.0.0.1:1/v1"))


def test_a_server_message_is_quoted_as_one_line_of_text(serve):
    wire = serve(say(b"HTTP/1.1 400 X\r\nContent-Length: 17\r\n\r\n\x1b[2J\xc2\x9b1\r\n\xe2\x80\xaeno\x00\x07."))
    with pytest.raises(ModelError) as refused:
        model(wire).ask(REQUEST)
    assert str(refused.value).endswith(r"answered 400: \u001b[2J\u009b1 \u202eno\u0000\u0007.")
