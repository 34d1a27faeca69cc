"""Every kind of action is supported by parser, prompt, schemas, controller and history."""

from dataclasses import fields
from typing import get_args

import jsonschema
import pytest

from dronecats.agent.action import Action, action_from
from dronecats.agent.controller import plan
from dronecats.agent.models.reply_schema import action_schema, flat_action_schema
from dronecats.agent.prompt import History, Prompt, compact
from dronecats.pilots import actions
from foundation.camera import CameraModel
from foundation.redaction import MIN_CHARS, REPLY_WORDS

CAMERA = CameraModel()
EACH = [kind(*(3.0 for _ in fields(kind))) for kind in get_args(Action)]


@pytest.mark.parametrize("action", EACH, ids=lambda action: type(action).__name__)
def test_every_module_handles_the_action(action):
    declared = action.as_json()
    assert action_from(declared) == action
    assert f'{{"action":"{declared["action"]}"' in Prompt.load().template
    jsonschema.validate(declared, action_schema())
    flat = flat_action_schema()
    jsonschema.validate({**dict.fromkeys(flat["properties"]), **declared}, flat)
    words = {word for word in (*declared, declared["action"]) if len(word) >= MIN_CHARS}
    assert words <= REPLY_WORDS, "a key that is spelt so would garble the pilot's own words"
    assert plan(action, CAMERA)
    history = History(CAMERA)
    history.append(action)
    assert compact(action, CAMERA) in history.render()
    assert [past.kind for past in actions.read_prompt(history.render()).past(0)] == [declared["action"]]
