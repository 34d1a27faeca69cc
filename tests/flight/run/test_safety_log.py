"""The safety log writes each change of the envelope's actions. Each action is reported once."""

import json
from types import SimpleNamespace
from typing import Any

import pytest

from dronecats.flight.run.progress import SafetyLog


def linked() -> Any:
    """Return two stand-ins with only the link attributes that the log uses."""
    return [SimpleNamespace(time_us=k, on_limit=None) for k in range(2)]


@pytest.fixture
def two_drones(tmp_path):
    """Return the links of two drones, their log, its notices, and the file."""
    links = linked()
    notices: list[str] = []
    file = tmp_path / "safety.jsonl"
    return links, SafetyLog(file, links, notices.append), notices, file


def test_a_limit_that_acts_repeatedly_is_reported_at_first_and_in_the_summary(two_drones):
    links, log, notices, file = two_drones
    for _ in range(70):
        links[1].on_limit(("climb",))
        links[1].on_limit(())
    assert len(notices) == 1
    assert "drone 2" in notices[0]
    assert "climb" in notices[0]
    log.sum_up()
    assert len(notices) == 2
    assert "climb 70 times" in notices[1]
    assert [json.loads(line)["limits"] for line in file.read_text().splitlines()] == [["climb"], []] * 70


def test_each_limit_of_each_drone_is_reported_when_it_first_acts(two_drones):
    links, log, notices, _ = two_drones
    links[0].on_limit(("climb",))
    links[0].on_limit(("climb", "ceiling"))
    links[0].on_limit(("ceiling",))
    links[0].on_limit(("ceiling", "climb"))
    links[1].on_limit(("climb",))
    assert [line.split("drone ")[1] for line in notices] == ["1 limited by climb", "1 limited by ceiling",
                                                         "2 limited by climb"]  # fmt: skip
    log.sum_up()
    (summary,) = notices[3:]
    assert "drone 1" in summary
    assert "climb 2 times" in summary
    assert "ceiling once" in summary


def test_a_drone_that_flies_alone_has_no_number(tmp_path):
    (link, _), notices = linked(), list[str]()
    SafetyLog(tmp_path / "safety.jsonl", [link], notices.append)
    link.on_limit(("climb",))
    assert "drone" not in notices[0]


def test_a_limit_that_acted_once_is_reported_once(two_drones):
    links, log, notices, _ = two_drones
    log.sum_up()
    links[0].on_limit(("climb",))
    links[0].on_limit(())
    log.sum_up()
    assert len(notices) == 1


def test_a_closed_terminal_does_not_stop_the_safety_log(two_drones, tmp_path):
    links, _, _, file = two_drones

    def say(line):
        raise BrokenPipeError(32, "Broken pipe")

    log = SafetyLog(file, links, say)
    for _ in range(2):
        links[0].on_limit(("climb",))
        links[0].on_limit(())
    log.sum_up()
    assert len(file.read_text().splitlines()) == 4
