"""Tests the recorded pilot: it repeats its replies in order, then thinks. Invalid recordings are rejected."""

import json
from pathlib import Path
from typing import Any

import httpx
import pytest

from dronecats.pilots import roster
from dronecats.pilots.scripted import player, replies
from dronecats.pilots.server import PilotConfig, PilotPart
from foundation.errors import UsageError

JPEG = b"\xff\xd8\xff\xd9"


def recording(folder: Path, *rows: dict[str, Any]) -> Path:
    path = folder / "decisions.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def test_replies_are_repeated_in_order_and_then_the_pilot_thinks(tmp_path: Path) -> None:
    recorded = ['{"action": "rotate", "angle_deg": 10}', "", "nonsense {"]
    path = recording(tmp_path, *({"step": n, "drone": 0, "reply": text} for n, text in enumerate(recorded)))
    pilot = player(path)
    assert [pilot("", [JPEG]) for _ in range(5)] == [*recorded, '{"action": "think"}', '{"action": "think"}']


def test_a_fleets_reply_comes_once_per_step_and_a_torn_line_is_omitted(tmp_path: Path) -> None:
    rows = [{"step": step, "drone": drone, "reply": f"reply {step}"} for step in (0, 1) for drone in (0, 1, 2)]
    path = recording(tmp_path, *rows)
    with path.open("a") as file:
        file.write('{"step": 2, "dr')
    assert replies(path) == ["reply 0", "reply 1"]
    pilot = player(path)
    assert [pilot("", [JPEG] * 3) for _ in range(3)][2] == ", ".join(
        ['[{"action": "think"}', *['{"action": "think"}'] * 2]
    ) + "]"


def test_a_recording_is_served_like_any_pilot_and_never_as_a_model(tmp_path: Path) -> None:
    path = recording(tmp_path, {"step": 0, "drone": 0, "reply": "first"})
    name = f"recorded:{path}"
    assert roster.check(name) == name
    served = PilotPart(PilotConfig(pilot=name))
    try:
        url = served.ready()["base_url"]
        assert "not a model" in httpx.get(f"{url}/models").json()["data"][0]["owned_by"]
        body = {"model": "x", "messages": [{"role": "user", "content": "Command: go"}]}
        answers = [httpx.post(f"{url}/chat/completions", json=body).json() for _ in range(2)]
        assert [a["choices"][0]["message"]["content"] for a in answers] == ["first", '{"action": "think"}']
    finally:
        served.close()


def test_invalid_recordings_are_rejected_before_the_flight(tmp_path: Path) -> None:
    for content, part in (
        (None, "decisions.jsonl"),
        ("", "decisions.jsonl"),
        ('{"step": "0", "reply": "x"}\n', r"\bstep\b"),
        ('{"step": 0, "reply": null}\n', r"\breply\b"),
        ("[]\n", "JSON object"),
    ):
        path = tmp_path / "decisions.jsonl"
        if content is not None:
            path.write_text(content)
        with pytest.raises(UsageError, match=part):
            roster.check(f"recorded:{path}")
