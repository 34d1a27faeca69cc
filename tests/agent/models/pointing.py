"""Fake models with different ways of pointing, in each vendor's format. They detect the mark in the image."""

import base64
import json
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from tests.agent.models.recording import Sent

Point = Callable[
    [float, float, bool], str
]  # x, y of the mark, 0 … 1000, and whether the request is for [x, y] → a reply


def go(first: float, second: float) -> str:
    return json.dumps({"action": "go", "point": [round(first), round(second)], "depth_m": 5})


MANNERS: dict[str, Point] = {
    "as declared": lambda x, y, xy: go(x, y) if xy else go(y, x),
    "always [x, y]": lambda x, y, xy: go(x, y),
    "always [y, x]": lambda x, y, xy: f"Here it is:\n```json\n{go(y, x)}\n```",
    "as not declared": lambda x, y, xy: go(y, x) if xy else go(x, y),
    "not at all": lambda x, y, xy: go(500, 500),
    "no go": lambda x, y, xy: '{"action": "finished"}',
    "in pixels": lambda x, y, xy: go(x * 0.64, y * 0.36),
    "no word": lambda x, y, xy: "",
}


class Pointer:
    """A fake model that answers in one of `MANNERS`, in the vendor's format of the request."""

    def __init__(self, manner: str, enforces: bool = False) -> None:
        """With `enforces`, every reply follows the schema of the request."""
        self._point, self._enforces = MANNERS[manner], enforces
        self.tokens = (100, 20)  # per question and reply

    def __call__(self, sent: Sent) -> tuple[int, bytes]:
        """Return status and body of the answer to a request."""
        text, jpeg, root = FORMATS[format_of(sent)](sent.body)
        if "red disc" in text:
            reply = self._point(*mark(jpeg), '"point": [x, y]' in text)
            reply = f"[{reply}]" if self._enforces and root == "array" else reply
        elif self._enforces and root:
            reply = '[{"action": "think"}]' if root == "array" else '{"action": "think"}'
        else:
            reply = text[text.index("{") :]  # the reply that the prompt dictates
        return 200, json.dumps(wrapped(format_of(sent), reply, *self.tokens)).encode()


def mark(jpeg: bytes) -> tuple[float, float]:
    """Return the centre of the red area of an image, as x, y from 0 to 1000."""
    picture = np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR), int)
    rows, columns = np.nonzero(picture[:, :, 2] > picture[:, :, 1] + 80)
    height, width = picture.shape[:2]
    return 1000.0 * columns.mean() / width, 1000.0 * rows.mean() / height


def format_of(sent: Sent) -> str:
    if sent.path.endswith(":generateContent"):
        return "gemini"
    return "anthropic" if sent.path.endswith("/messages") else "openai"


def wrapped(wire: str, reply: str, tokens_in: int, tokens_out: int) -> dict[str, Any]:
    """Return a reply in a vendor's format."""
    if wire == "gemini":
        usage = {"promptTokenCount": tokens_in, "candidatesTokenCount": tokens_out}
        return {"candidates": [{"content": {"parts": [{"text": reply}]}}], "usageMetadata": usage}
    if wire == "anthropic":
        usage = {"input_tokens": tokens_in, "output_tokens": tokens_out}
        return {"type": "message", "content": [{"type": "text", "text": reply}], "usage": usage}
    usage = {"prompt_tokens": tokens_in, "completion_tokens": tokens_out, "total_tokens": tokens_in + tokens_out}
    choice = {"index": 0, "message": {"role": "assistant", "content": reply}, "finish_reason": "stop"}
    about = {"id": "chatcmpl-1", "object": "chat.completion", "created": 1, "model": "m"}
    return {**about, "choices": [choice], "usage": usage}


Read = tuple[str, bytes, str | None]  # text, image bytes, root of the schema


def _openai(body: Any) -> Read:
    text, image = body["messages"][0]["content"]
    schema = body.get("response_format", {}).get("json_schema", {}).get("schema")
    return text["text"], base64.b64decode(image["image_url"]["url"].split(",")[1]), _root(schema)


def _gemini(body: Any) -> Read:
    text, image = body["contents"][0]["parts"]
    data = base64.urlsafe_b64decode(image["inlineData"]["data"])
    return text["text"], data, _root(body["generationConfig"].get("responseJsonSchema"))


def _anthropic(body: Any) -> Read:
    text, image = body["messages"][0]["content"]
    schema = body.get("output_config", {}).get("format", {}).get("schema")
    return text["text"], base64.b64decode(image["source"]["data"]), _root(schema)


def _root(schema: Any) -> str | None:
    if schema is None:
        return None
    return "array" if schema.get("type") == "array" else "object"


FORMATS: dict[str, Callable[[Any], Read]] = {"openai": _openai, "gemini": _gemini, "anthropic": _anthropic}
