"""The ledger: many processes write at once, a killed process leaves it intact, and other files are rejected."""

import os
import signal
import sqlite3
import subprocess
import sys

import pytest

from dronecats.agent.models.endpoint import RetryPolicy
from dronecats.agent.models.ledger import KIND, Ledger, Spent
from dronecats.agent.models.model import Request
from dronecats.agent.models.rate_limits import Allowance, allowances
from dronecats.agent.models.replay import ReplyCache
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from foundation.errors import ModelError, UsageError
from foundation.files import make
from tests.agent.models.faulty_wire import Wire, answer, completion, say

REQUEST = Request("text", (b"jpeg",), thinking=False)
BOOKING = """
import sys
from pathlib import Path
from dronecats.agent.models.ledger import Ledger, Spent
ledger = Ledger(Path(sys.argv[1]))
print("open", flush=True)
for _ in range(int(sys.argv[2])):
    ledger.spend("m", Spent(1, 10, 1, 0.25))
print("done", flush=True)
"""


def booking(path, times):
    command = [sys.executable, "-c", BOOKING, str(path), str(times)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def test_concurrent_writes_of_many_processes_are_complete(tmp_path):
    path = tmp_path / "new" / "ledger.sqlite"  # the processes also create the file concurrently
    children = [booking(path, 100) for _ in range(4)]
    assert [child.communicate()[0].split()[-1] for child in children] == ["done"] * 4
    ledger = Ledger(path)
    assert ledger.spent() == Spent(400, 4000, 400, 100.0)
    assert ledger.spent().tokens == 4400
    ledger.close()
    assert sorted(entry.name for entry in path.parent.iterdir()) == ["ledger.sqlite"]


def test_a_killed_process_leaves_only_complete_entries(tmp_path):
    path = tmp_path / "ledger.sqlite"
    Ledger(path).close()
    child = booking(path, 10**9)
    assert child.stdout is not None
    assert child.stdout.readline() == "open\n"
    ledger = Ledger(path)
    while ledger.spent().questions < 50:
        pass
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    ledger.close()
    ledger = Ledger(path)
    spent = ledger.spent()
    assert spent == Spent(spent.questions, 10 * spent.questions, spent.questions, 0.25 * spent.questions)
    ledger.spend("m", Spent(1, 0, 0, 0.0))
    assert ledger.spent().questions == spent.questions + 1
    ledger.close()


def foreign(path):
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE mine (x)")
    db.commit()
    db.close()


def newer(path):
    Ledger(path).close()
    db = sqlite3.connect(path)
    db.execute("PRAGMA user_version=99")
    db.close()


def damaged(path):
    ledger = Ledger(path)
    for number in range(500):
        ledger.spend(f"model {number}", Spent(1, 1, 1, 1.0))
    ledger.close()
    data = bytearray(path.read_bytes())
    data[4096:] = os.urandom(len(data) - 4096)
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("make", "pattern"),
    [
        (lambda path: path.write_text("dear diary, " * 999), "not a database"),
        (lambda path: path.write_bytes(b""), "another database"),
        (foreign, "another database"),
        (lambda path: ReplyCache(path).close(), "another database"),
        (newer, "99"),
        (damaged, "damaged|malformed"),
        (lambda path: path.mkdir(), "file"),
    ],
    ids=["text", "empty", "another program's", "a cache", "newer", "damaged", "folder"],
)
def test_other_files_are_rejected_and_unchanged(tmp_path, make, pattern):
    path = tmp_path / "file"
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(UsageError, match=pattern):
        Ledger(path)
    assert (path.read_bytes() if path.is_file() else None) == before
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file"]


def test_a_hold_applies_to_all_clients_of_that_address_only(tmp_path):
    now = [5000.0]
    path = tmp_path / "ledger.sqlite"
    first_ledger, second_ledger = (Ledger(path, lambda: now[0]) for _ in range(2))  # as in two processes
    first_ledger.limiter("http://h/v1", "m").hold(20.0)
    assert second_ledger.limiter("http://h/v1", "m").claim(0) == pytest.approx(20.0)
    assert second_ledger.limiter("http://elsewhere/v1", "m").claim(0) == 0.0
    now[0] += 20.0
    assert second_ledger.limiter("http://h/v1", "m").claim(0) == 0.0
    first_ledger.close()
    second_ledger.close()


@pytest.mark.parametrize(
    ("limit", "reset"), [("1e308", "1e-308"), ("100", "1e-307"), ("1e-320", "100")], ids=["large", "fast", "small"]
)
def test_extreme_rate_limit_headers_leave_a_readable_state(tmp_path, limit, reset):
    names = ("limit-requests", limit), ("remaining-requests", "0"), ("reset-requests", reset)
    ledger = Ledger(tmp_path / "ledger.sqlite")
    limiter = ledger.limiter("http://h/v1", "m")
    limiter.update(allowances({f"x-ratelimit-{name}": value for name, value in names}))
    assert 0.0 <= limiter.claim(0) < 101.0
    ledger.close()
    with sqlite3.connect(tmp_path / "ledger.sqlite") as db:
        assert "null" not in db.execute("SELECT state FROM turns").fetchone()[0]
    db.close()


def test_a_stored_rate_limit_state_that_cannot_be_decoded_counts_as_empty(tmp_path):
    ledger = Ledger(tmp_path / "ledger.sqlite")
    limiter = ledger.limiter("http://h/v1", "m")
    limiter.hold(20.0)
    with sqlite3.connect(tmp_path / "ledger.sqlite") as db:
        db.execute("""UPDATE turns SET state = '{"held_until":null}'""")
    db.close()
    assert limiter.claim(0) == 0.0
    ledger.close()


def test_a_429_answer_to_one_client_holds_back_another_client(tmp_path):
    now = [5000.0]
    path = tmp_path / "ledger.sqlite"
    wire = Wire(say(answer(429, b"slow down", "Retry-After: 20")), say(completion("x")))
    first_ledger, second_ledger = (Ledger(path, lambda: now[0]) for _ in range(2))  # as in two processes
    spec = ModelSpec(provider="local", name="m", base_url=wire.url)
    first, second = (
        open_model(spec, RetryPolicy(0.5, attempts=1), ledger.limiter) for ledger in (first_ledger, second_ledger)
    )
    with pytest.raises(ModelError, match="429"):
        first.ask(REQUEST)
    with pytest.raises(ModelError, match="rate limit"):
        second.ask(REQUEST)
    assert wire.served == 1
    now[0] += 20.0
    assert second.ask(REQUEST).text == "x"
    wire.close()
    first_ledger.close()
    second_ledger.close()


def test_a_question_waits_for_the_rate_limit_of_the_last_answer(tmp_path):
    headers = ["x-ratelimit-limit-requests: 60", "x-ratelimit-remaining-requests: 0", "x-ratelimit-reset-requests: 60s"]
    wire, ledger = Wire(say(completion("x", *headers))), Ledger(tmp_path / "ledger.sqlite", lambda: 5000.0)
    model = open_model(ModelSpec(provider="local", name="m", base_url=wire.url), RetryPolicy(), ledger.limiter)
    model.ask(REQUEST)
    assert ledger.limiter(wire.url, "m").claim(0) == pytest.approx(1.0, abs=0.01)  # one request per second
    wire.close()
    ledger.close()


CLAIMING = """
import sys
from pathlib import Path
from dronecats.agent.models.ledger import Ledger
limiter = Ledger(Path(sys.argv[1]), lambda: 5000.0).limiter("http://h/v1", "m")
granted = 0
while limiter.claim(0) == 0.0:
    granted += 1
print(granted)
"""


def test_concurrent_processes_are_granted_exactly_the_allowance(tmp_path):
    path = tmp_path / "ledger.sqlite"
    ledger = Ledger(path, lambda: 5000.0)
    ledger.limiter("http://h/v1", "m").update((Allowance("requests", 400.0, 400.0, 3600.0, steady=False),))
    command = [sys.executable, "-c", CLAIMING, str(path)]
    children = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    assert sum(int(child.communicate()[0]) for child in children) == 400
    ledger.close()


def test_a_second_creation_keeps_the_existing_ledger(tmp_path):
    path = tmp_path / "ledger.sqlite"
    ledger = Ledger(path)
    ledger.spend("m", Spent(1, 2, 3, 4.0))
    ledger.close()
    make(path, KIND)
    ledger = Ledger(path)
    assert ledger.spent() == Spent(1, 2, 3, 4.0)
    ledger.close()
