"""Our requests against OpenAI's published schema, if its 3 MB file is available.

DRONECATS_OPENAI_SCHEMA names openapi.json of github.com/openai/openai-openapi.
"""

import json
import os
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from dronecats.agent.models.model import Request
from dronecats.agent.models.rows import model_of, rows
from dronecats.agent.models.wire_formats import open_model
from tests.needs import needs

FILE = os.environ.get("DRONECATS_OPENAI_SCHEMA")
MODELS = [name for name, row in rows().items() if row.spec.provider == "openai"] + ["openai/gpt-4o"]

pytestmark = needs("openai-schema")


@pytest.fixture(scope="module")
def published():
    components = json.loads(Path(str(FILE)).read_text(encoding="utf-8"))["components"]
    return Draft202012Validator({"$ref": "#/components/schemas/CreateChatCompletionRequest", "components": components})


def test_every_request_is_as_openai_publishes_it(published, monkeypatch):
    schemas: tuple[Any, ...] = (None, "object")
    monkeypatch.setenv("OPENAI_API_KEY", "sk-SECRET")
    for case in product([False, True], [1, 4], schemas, MODELS):
        thinking, drones, schema, name = case
        labels = tuple(f"Drone {n}:" for n in range(1, 5)) if drones > 1 else ()
        model = open_model(replace(model_of(name), schema=schema))
        body = model.body(Request("a prompt", (b"\xff\xd8",) * drones, thinking, labels))
        model.close()
        assert [error.message for error in published.iter_errors(body)] == [], case
        (message,) = body["messages"]
        image = {"type": "image_url", "image_url": "data:"}  # a form that no version of the schema allows
        broken = {**body, "messages": [{**message, "content": [image]}]}
        assert list(published.iter_errors(broken)), case
