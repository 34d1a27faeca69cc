"""The probe of a model with a marked image, tested with every way of pointing in every vendor's format."""

from itertools import product
from typing import Any

import pytest

from dronecats.agent.models.probe import (
    MARK,
    ProbeResult,
    conforms_to_schema,
    marked_picture,
    order_of,
    pointing_of,
    probe,
)
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from foundation.errors import ModelError
from tests.agent.models.pointing import MANNERS, Pointer, mark
from tests.agent.models.recording import Recording

WIRES = ("openai", "gemini", "anthropic")
POINTS = {manner: manner for manner in MANNERS} | dict.fromkeys(("no go", "in pixels", "no word"), "not at all")


def probed(answer, **declared) -> tuple[ProbeResult, Recording]:
    """Return the probe's result for a model behind a server, and the server."""
    with Recording(answer) as server:
        spec = ModelSpec(name="m", base_url=server.url + "/v1", **declared)
        model = open_model(spec)
        try:
            return probe(model, spec), server
        finally:
            model.close()


def test_the_mark_is_at_its_stated_place_and_far_from_the_mirrored_place():
    x, y = mark(marked_picture())
    assert (x, y) == pytest.approx(MARK, abs=5)
    assert abs(x - y) > 500


def test_each_way_of_pointing_is_detected():
    for case in product(WIRES, ["xy", "yx"], MANNERS):
        wire, axis, manner = case
        result, server = probed(Pointer(manner), provider=wire, axis_order=axis)
        assert result.pointing == POINTS[manner], case
        usable = {"as declared", "always [x, y]" if axis == "xy" else "always [y, x]"}
        assert result.order_is_right == (POINTS[manner] in usable), case
        assert result.enforced is None, case
        assert len(server.sent) == 3, case
        assert result.tokens == (300, 60), case


def test_one_question_uses_the_reasoning_options():
    for wire in WIRES:
        lifted = {"some_field": {"deep": 1}}
        _, server = probed(Pointer("as declared"), provider=wire, thinking=lifted, quick={})
        bodies = [sent.body["generationConfig"] if wire == "gemini" else sent.body for sent in server.sent]
        assert [body.get("some_field") for body in bodies] == [None, None, {"deep": 1}], wire


def test_schema_enforcement_is_detected():
    for enforces in [True, False]:
        for wire, root in [("openai", "object"), ("openai", "array"), ("gemini", "array"), ("anthropic", "object")]:
            result, server = probed(Pointer("as declared", enforces), provider=wire, schema=root)
            assert len(server.sent) == 4, (wire, root, enforces)
            assert result.enforced == enforces, (wire, root, enforces)
            assert result.pointing == "as declared", (wire, root, enforces)


def test_the_cost_requires_token_counts_and_prices():
    priced = {"provider": "local", "input_usd": 2.0, "output_usd": 10.0}
    result, _ = probed(Pointer("as declared"), **priced)
    assert result.cost_usd == pytest.approx((300 * 2.0 + 60 * 10.0) / 1e6)
    assert probed(Pointer("as declared"), provider="local", input_usd=2.0)[0].cost_usd is None
    untold = b'{"choices":[{"message":{"content":"{}"}}]}'
    assert probed(untold, **priced)[0].cost_usd is None
    assert probed(untold, **priced)[0].tokens == (None, None)


def test_a_context_that_is_too_small_is_detected():
    assert not probed(Pointer("as declared"), provider="local")[0].too_long
    assert not probed(Pointer("as declared"), provider="local", context_tokens=8292)[0].too_long
    assert probed(Pointer("as declared"), provider="local", context_tokens=8291)[0].too_long


def test_an_endpoint_error_names_the_question():
    def refuses_the_second(sent):
        return (400, b"no [y, x] here") if '"point": [y, x]' in str(sent.body) else Pointer("as declared")(sent)

    with pytest.raises(ModelError, match=r"\[y, x\].* 400"):
        probed(refuses_the_second, provider="local")


def test_the_axis_order_is_derived_from_a_reply():
    for reply, order in [
        ('{"action":"go","point":[800,250],"depth_m":5}', "xy"),
        ('{"action":"go","point":[250,800],"depth_m":5}', "yx"),
        ('{"action":"go","point":[730,320],"depth_m":5}', "xy"),  # inexact, but clear
        ('{"action":"go","point":[690,250],"depth_m":5}', None),
        ('{"action":"go","point":[512,90],"depth_m":5}', None),
        ('{"action":"go","point":[1800,250],"depth_m":5}', None),
        ('{"action":"go","point":[800,250]}', None),
        ('{"action":"think"}', None),
        ("at 800, 250", None),
    ]:
        assert order_of(reply) == order, reply


def test_every_pair_of_axis_orders_has_a_pointing():
    pairs = {(a, b): pointing_of(a, b) for a in ("xy", "yx", None) for b in ("xy", "yx", None)}
    assert pairs == {
        ("xy", "yx"): "as declared",
        ("xy", "xy"): "always [x, y]",
        ("yx", "yx"): "always [y, x]",
        ("yx", "xy"): "as not declared",
    } | {pair: "not at all" for pair in pairs if None in pair}


def test_conformance_of_replies_to_a_schema():
    cases: list[tuple[str, Any, bool]] = [
        ('{"action":"think"}', "object", True),
        ('[{"action":"think"}]', "array", True),
        ('[{"action":"think"}]', "object", False),
        ('{"action":"think"}', "array", False),
        ('{"action":"think","point":null,"depth_m":null,"angle_deg":null}', "object", True),
        (
            '{"action":"go","point":null,"depth_m":null,"angle_deg":null}',
            "object",
            True,
        ),  # an invalid action that the schema allows
        ('{"action":"dance","point":null,"depth_m":null,"angle_deg":null}', "object", False),
        ('{"action":"go"}', "object", False),
        ('{"dance": 3}', "object", False),
        ('[{"dance": 3}]', "array", False),
        ('Yes! {"action":"think"}', "object", False),
        ("[" * 100_000, "array", False),
        ("", "object", False),
    ]
    for reply, root, kept in cases:
        assert conforms_to_schema(reply, root) == kept, reply[:80]
