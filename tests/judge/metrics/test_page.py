"""docs/metrics.md agrees with the registry, and its example is a valid metric."""

import re
from pathlib import Path

import pytest

from dronecats.judge.metrics.judging import METRICS, own_metrics
from dronecats.study.docs_tables import filled, tables

PAGE = Path(__file__).parents[3] / "docs" / "metrics.md"


def test_the_tables_of_the_page_match_the_registry():
    page = PAGE.read_text(encoding="utf-8")
    assert filled(page, tables("metrics.md")) == page, "run `make metrics`"
    assert all(f"| `{name}` |" in page for name in METRICS)


def test_a_page_without_placeholders_is_rejected():
    with pytest.raises(ValueError, match="metrics"):
        filled("# Metrics\n", tables("metrics.md"))
    assert set(tables("metrics.md")) == {"metrics", "modes", "rules"}


def test_the_example_on_the_page_is_a_valid_metric(tmp_path):
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert code
    (tmp_path / "own.py").write_text(code[1], encoding="utf-8")
    assert [metric.name for metric in own_metrics(tmp_path / "own.py")] == ["height_m"]


def test_every_metric_has_a_name_a_title_a_unit_and_a_definition():
    for metric in METRICS.values():
        assert metric.name.isidentifier(), metric.name
        assert metric.title, metric.name
        assert metric.unit, metric.name
        assert metric.definition, metric.name
