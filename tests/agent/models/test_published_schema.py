"""Requests to OpenAI satisfy its published schema. The tests need the schema's 3 MB file.

The environment variable DRONECATS_OPENAI_SCHEMA is the path of openapi.json from github.com/openai/openai-openapi.
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


def test_every_request_satisfies_openais_published_schema(published, monkeypatch):
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
