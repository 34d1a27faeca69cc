"""The model receives the paper's declared input: prompt, history, images, sampling, and reasoning on request."""

import struct

import cv2
import numpy as np
import pytest

from dronecats.agent.prompt import Prompt
from tests.agent.flown_wire import Endpoint, Views, fly

THINK, TURN, DONE = '{"action":"think"}', '{"action":"rotate","angle_deg":45}', '{"action":"finished"}'
GO = '{"action":"go","point":[612, 430],"depth_m":9}'


@pytest.fixture(autouse=True)
def no_keys(monkeypatch):
    for name in ("OPENAI_API_KEY", "OPENROUTER_API_KEY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    ("replies", "expected"),
    [
        ([TURN, GO, DONE, TURN], [False, False, False, False]),
        ([THINK, TURN, TURN, THINK, GO, GO], [False, True, False, False, True, False]),
        ([THINK, "no idea", "none", "none"], [False, True, False, False]),
        ([THINK, '{"action":"land"}', THINK, "what?", TURN], [False, True, False, True, False]),
        ([THINK, THINK, THINK, ""], [False, True, True, True]),
        (["hm", THINK, TURN], [False, False, True]),
    ],
)
def test_a_think_enables_reasoning_for_the_next_call_only(tmp_path, replies, expected):
    with Endpoint(replies) as endpoint:
        decisions, *_ = fly(endpoint, tmp_path, steps=len(replies))
    assert [body["reasoning"] for body in endpoint.bodies] == [{"enabled": on} for on in expected]
    assert [d["thinking"] for d in decisions] == expected


def test_a_think_of_any_drone_enables_reasoning_for_the_fleets_next_call(tmp_path):
    thoughts = [f"[{TURN},{THINK},{DONE}]", f"[{TURN},{TURN},{DONE}]", f"[{GO},{TURN},{THINK}]"]
    replies = [*thoughts, "nothing", f"[{TURN}]", ""]
    with Endpoint(replies) as endpoint:
        decisions, *_ = fly(endpoint, tmp_path, steps=6, drones=3)
    assert [body["reasoning"]["enabled"] for body in endpoint.bodies] == [False, True, False, True, False, False]
    assert [d["thinking"] for d in decisions if d["drone"] == 2] == [False, True, False, True, False, False]


@pytest.mark.parametrize(
    ("provider", "quick", "slow"),
    [
        ("openai", {}, {}),  # OpenAI's models differ: each row has its own reasoning options
        ("openrouter", {"reasoning": {"enabled": False}}, {"reasoning": {"enabled": True}}),
        ("vllm", *({"chat_template_kwargs": {"enable_thinking": on}} for on in (False, True))),
        ("local", {}, {}),
    ],
)
def test_a_request_is_one_user_message_and_the_declared_sampling(tmp_path, provider, quick, slow):
    with Endpoint([THINK, TURN]) as endpoint:
        fly(endpoint, tmp_path, steps=2, provider=provider)
    tokens = "max_completion_tokens" if provider == "openai" else "max_tokens"
    for body, extra in zip(endpoint.bodies, (quick, slow), strict=True):
        (message,) = body.pop("messages")
        assert body == {"model": "maker/model-1", "temperature": 0.4, tokens: 8192, **extra}
        assert set(message) == {"role", "content"}
        assert message["role"] == "user"
        assert [part["type"] for part in message["content"]] == ["text", "image_url"]
        assert message["content"][1]["image_url"]["url"].startswith("data:image/jpeg;base64,")


def test_the_text_is_the_prompt_with_the_last_five_actions_in_pixels(tmp_path):
    with Endpoint([GO, TURN, "no action", THINK, DONE, GO, TURN, TURN]) as endpoint:
        fly(endpoint, tmp_path, steps=8)
    went, turned = "GO x=783 y=310 depth=9m", "ROTATE angle=45deg"
    lines = [went, turned, "THINK", "FINISHED", went, turned]
    taken = [0, 1, 2, 2, 3, 4, 5, 6]  # an unreadable reply is no action
    for step, count in enumerate(taken):
        last = lines[:count][-5:]
        history = "\n".join(f"{i}. {line}" for i, line in enumerate(last, 1)) + ("  <- latest" if last else "")
        history = history or "(none yet — this is the first step)"
        assert endpoint.texts[step] == Prompt.load(None).render("go to the cyan SUV", history, 5)


def test_a_fleet_sends_every_picture_in_order_and_every_drones_own_history(tmp_path):
    with Endpoint([f"[{GO},{TURN},{DONE}]", ""]) as endpoint:
        _, views, _ = fly(endpoint, tmp_path, steps=2, drones=3)
    did = ("GO x=783 y=310 depth=9m", "ROTATE angle=45deg", "FINISHED")
    history = "\n".join(f"Drone {k}:\n1. {what}  <- latest" for k, what in enumerate(did, 1))
    assert endpoint.texts[1] == Prompt.load(None).render("go to the cyan SUV", history, 5, drones=3)
    (text, *parts) = endpoint.bodies[0]["messages"][0]["content"]
    assert [part["type"] for part in (text, *parts)] == ["text"] + ["text", "image_url"] * 3
    assert [part["text"] for part in parts[::2]] == ["Drone 1:", "Drone 2:", "Drone 3:"]
    for frame_id, jpeg in enumerate(endpoint.jpegs[0], 1):
        assert apart(decoded(jpeg), views.picture(frame_id)) < 8.0
        assert apart(decoded(jpeg), views.picture(frame_id % 3 + 1)) > 30.0


@pytest.mark.parametrize(
    ("order", "shown", "pixels"), [("xy", "[x, y]", "x=783 y=310"), ("yx", "[y, x]", "x=550 y=441")]
)
def test_prompt_and_parser_use_the_same_axis_order(tmp_path, order, shown, pixels):
    with Endpoint([GO, DONE]) as endpoint:
        decisions, *_ = fly(endpoint, tmp_path, steps=2, axis_order=order)
    assert f'"point":{shown}' in endpoint.texts[0]
    assert f"1. GO {pixels} depth=9m" in endpoint.texts[1]
    assert decisions[0]["action"]["point"] == ([612, 430] if order == "xy" else [430, 612])


@pytest.mark.parametrize(
    ("width", "height", "sent"),
    [(1280, 720, (640, 360)), (641, 480, (640, 479)), (640, 360, (640, 360)), (320, 200, (320, 200))],
)
def test_an_image_is_reduced_to_640_px_never_enlarged_and_encoded_at_quality_85(tmp_path, width, height, sent):
    with Endpoint([TURN]) as endpoint:
        _, views, _ = fly(endpoint, tmp_path, steps=1, views=Views(height, width))
    ((jpeg,),) = endpoint.jpegs
    picture = decoded(jpeg)
    assert (picture.shape[1], picture.shape[0]) == sent
    assert luminance_table(jpeg) == [max(1, (base * 30 + 50) // 100) for base in LUMINANCE]  # of quality 85
    assert apart(picture, views.picture(1)) < 8.0
    assert (tmp_path / "000001.jpg").read_bytes() == jpeg  # the stored image is the sent image


# The luminance table of quality 50, ITU-T T.81 annex K, in the order of the file (zigzag).
LUMINANCE = [16, 11, 12, 14, 12, 10, 16, 14, 13, 14, 18, 17, 16, 19, 24, 40,
             26, 24, 22, 22, 24, 49, 35, 37, 29, 40, 58, 51, 61, 60, 57, 51,
             56, 55, 64, 72, 92, 78, 64, 68, 87, 69, 55, 56, 80, 109, 81, 87,
             95, 98, 103, 104, 103, 62, 77, 113, 121, 112, 100, 120, 92, 101, 103, 99]  # fmt: skip


def luminance_table(jpeg):
    """Return the first quantisation table of a JPEG: marker FFDB, length, class and number, 64 bytes."""
    at = 2
    while jpeg[at : at + 2] != b"\xff\xdb":
        at += 2 + struct.unpack(">H", jpeg[at + 2 : at + 4])[0]
    assert jpeg[at + 4] == 0
    return list(jpeg[at + 5 : at + 69])


def decoded(jpeg):
    return cv2.cvtColor(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def apart(picture, taken):
    """Return the mean difference (of 255) between two images, at the size of the first."""
    resized = cv2.resize(taken, (picture.shape[1], picture.shape[0]), interpolation=cv2.INTER_AREA)
    return float(np.abs(picture.astype(int) - resized.astype(int)).mean())
