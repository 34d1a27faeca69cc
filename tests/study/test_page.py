"""docs/studies.md agrees with the registry, and its example is a valid study."""

import re
from pathlib import Path

import pytest

from dronecats.cli import study_spec
from dronecats.cli.main import parse
from dronecats.study.docs_tables import filled, tables
from dronecats.study.factors import FACTORS

PAGE = Path(__file__).parents[2] / "docs" / "studies.md"


@pytest.mark.parametrize("name", ["studies.md", "disturbances.md"])
def test_the_tables_of_the_docs_are_up_to_date(name):
    page = (PAGE.parent / name).read_text(encoding="utf-8")
    assert filled(page, tables(name)) == page, "run `make studies`"
    assert name != "studies.md" or all(f"| `{factor}` |" in page for factor in FACTORS)


def test_the_example_of_the_docs_is_a_valid_study(tmp_path):
    code = re.search(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert code
    (tmp_path / "my-study.toml").write_text(code[1], encoding="utf-8")
    spec = study_spec.of_file(parse(["study", "run", str(tmp_path / "my-study.toml")]))
    assert len(spec.plan.study.factors) >= 3
    assert spec.plan.entries


@pytest.mark.parametrize("file", sorted((PAGE.parent / "studies").glob("*.toml")), ids=lambda path: path.stem)
def test_the_published_studies_can_be_loaded(file):
    spec = study_spec.of_file(parse(["study", "run", str(file)]))
    assert spec.plan.study.name == file.stem
    assert (file.parent / file.stem / "report.md").exists()


def test_no_factor_has_both_a_range_and_words():
    assert not [name for name, factor in FACTORS.items() if factor.quantity and factor.words]
