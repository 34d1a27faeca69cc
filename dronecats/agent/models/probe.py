"""Tests a model with a marked picture: if it points at the mark, in which axis order, and if a schema is enforced."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from dronecats.agent.action import POINT_FORMAT, AxisOrder, Go, action_from
from dronecats.agent.models.ledger import cost
from dronecats.agent.models.model import Model, Reply, Request
from dronecats.agent.models.reply_schema import flat_action_schema
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.reply.reading import ReplyParser, reading
from foundation.errors import ModelError

WIDTH, HEIGHT = 640, 360  # px, as in the agent's requests
MARK = (800.0, 250.0)  # x, y of the mark, 0 … 1000; far from (y, x), to detect swapped axes
NEAR = 100.0  # tolerance in x and in y, in units of MARK
FORBIDDEN_OBJECT = {"dance": 3}  # no schema of actions allows it
# the axis order of the model's points, compared with the order that a question declares
Pointing = Literal["as declared", "always [x, y]", "always [y, x]", "as not declared", "not at all"]


@dataclass(frozen=True, slots=True)
class ProbeAnswer:
    """One question of the probe and its answer."""

    question: str
    reply: Reply
    order: AxisOrder | None = None  # the axis order in which the reply's point hits the mark; None: no order does


@dataclass(frozen=True, slots=True)
class ProbeResult:
    """The answers to all questions, and their evaluation."""

    spec: ModelSpec
    answers: tuple[ProbeAnswer, ...]
    pointing: Pointing
    enforced: bool | None  # whether the server enforces the schema; None: no schema is sent

    @property
    def order_is_right(self) -> bool:
        """Return whether the model points in the declared axis order."""
        return self.pointing in ("as declared", f"always {POINT_FORMAT[self.spec.axis_order]}")

    @property
    def tokens(self) -> tuple[int | None, int | None]:
        """Return (tokens of all questions, of all replies). A sum is None if one of its counts is missing."""
        return _sum(a.reply.tokens_in for a in self.answers), _sum(a.reply.tokens_out for a in self.answers)

    @property
    def cost_usd(self) -> float | None:
        """Return the cost of all questions in $; None if tokens or prices are not known."""
        tokens_in, tokens_out = self.tokens
        if tokens_in is None or tokens_out is None or None in (self.spec.input_usd, self.spec.output_usd):
            return None
        return cost(self.spec, tokens_in, tokens_out)

    @property
    def too_long(self) -> bool:
        """Return whether the longest question and a reply of `max_tokens` exceed the declared context."""
        longest = max((a.reply.tokens_in or 0 for a in self.answers), default=0)
        return self.spec.context_tokens is not None and longest + self.spec.max_tokens > self.spec.context_tokens


def marked_picture() -> bytes:
    """Return a JPEG: a plain grey picture with one red disc at MARK."""
    picture = np.full((HEIGHT, WIDTH, 3), 200, np.uint8)
    centre = round(MARK[0] / 1000 * WIDTH), round(MARK[1] / 1000 * HEIGHT)
    cv2.circle(picture, centre, HEIGHT // 14, (30, 30, 220), -1, cv2.LINE_AA)
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85])[1])


def pointing_question(order: AxisOrder, lifted: bool = False) -> Request:
    """Return the question for the point of the mark. It declares an axis order and the JSON form of a go.

    `lifted`: ask with reasoning.
    """
    axes = "x counts from the left edge, 0, to the right, 1000; y from the top edge, 0, to the bottom, 1000"
    text = (
        "The picture shows one red disc on a grey ground. Point at its centre. Answer with one JSON object and nothing"
        f' else: {{"action": "go", "point": {POINT_FORMAT[order]}, "depth_m": 5}}. {axes}. The point is written'
        f" {POINT_FORMAT[order]}: {'x first, then y' if order == 'xy' else 'y first, then x'}."
    )
    return Request(text, (marked_picture(),), lifted)


def schema_question() -> Request:
    """Return the question for an object that the schema forbids."""
    value = json.dumps(FORBIDDEN_OBJECT)
    text = f"Leave the picture alone. Answer with exactly this JSON object and nothing else: {value}"
    return Request(text, (marked_picture(),), False)


def probe(model: Model, spec: ModelSpec, parser: ReplyParser = "strict") -> ProbeResult:
    """Ask a model three questions, and a fourth if a schema is sent. Raises ModelError."""
    crossed_order: AxisOrder = "yx" if spec.axis_order == "xy" else "xy"
    own, crossed = (_point(model, order, parser) for order in (spec.axis_order, crossed_order))
    lifted = _answer(model, "with reasoning", pointing_question(spec.axis_order, lifted=True))
    answers = [own, crossed, replace(lifted, order=order_of(lifted.reply.text, parser))]
    enforced = None
    if spec.schema:
        answers.append(_answer(model, "something else than the schema allows", schema_question()))
        enforced = conforms_to_schema(answers[-1].reply.text, spec.schema)
    orders = (own.order, crossed.order) if spec.axis_order == "xy" else (crossed.order, own.order)
    return ProbeResult(spec, tuple(answers), pointing_of(*orders), enforced)


def order_of(reply: str, parser: ReplyParser = "strict") -> AxisOrder | None:
    """Return the axis order in which a reply points at the mark; None if it misses the mark."""
    action = reading(reply, 1, parser=parser)[0].action
    if not isinstance(action, Go):
        return None
    if _near((action.x, action.y), MARK):
        return "xy"
    return "yx" if _near((action.y, action.x), MARK) else None


def pointing_of(declared_xy: AxisOrder | None, declared_yx: AxisOrder | None) -> Pointing:
    """Evaluate the axis orders of two answers: with [x, y] declared, and with [y, x] declared."""
    if declared_xy is None or declared_yx is None:
        return "not at all"
    if declared_xy == declared_yx:
        return "always [x, y]" if declared_xy == "xy" else "always [y, x]"
    return "as declared" if declared_xy == "xy" else "as not declared"


def conforms_to_schema(reply: str, root: Literal["object", "array"]) -> bool:
    """Return whether a reply conforms to the schema: JSON with this root that holds only actions."""
    try:
        value = json.loads(reply)
        actions = value if root == "array" else [value]
        if not isinstance(actions, list):
            return False
        for action in actions:
            if not _has_flat_form(action):
                action_from(action)
    except (ValueError, RecursionError):  # ActionError is a ValueError
        return False
    return True


def _has_flat_form(value: object) -> bool:
    """Return whether a value has the form of `flat_action_schema`, in which any field may be null."""
    if not isinstance(value, dict):
        return False
    own = flat_action_schema()["properties"]
    return value.keys() == own.keys() and value["action"] in own["action"]["enum"]


def _point(model: Model, order: AxisOrder, parser: ReplyParser) -> ProbeAnswer:
    answer = _answer(model, f"{POINT_FORMAT[order]} declared", pointing_question(order))
    return replace(answer, order=order_of(answer.reply.text, parser))


def _answer(model: Model, question: str, request: Request) -> ProbeAnswer:
    try:
        return ProbeAnswer(question, model.ask(request))
    except ModelError as error:
        raise ModelError(f"{question}: {error}") from None


def _near(point: tuple[float, float], mark: tuple[float, float]) -> bool:
    return all(abs(a - b) <= NEAR for a, b in zip(point, mark, strict=True))


def _sum(counts: Iterable[int | None]) -> int | None:
    values = list(counts)
    return None if None in values else sum(count for count in values if count is not None)
