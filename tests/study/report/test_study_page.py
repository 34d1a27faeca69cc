"""The page in a real browser, from a disk and without a network: dark and light, on a phone and on paper."""

import json
import shutil

import pytest

from dronecats.cli.main import main
from tests.study.studies import falling, write_study

HOSTILE = "</style><script>window.hacked=1</script><img src=x onerror='window.hacked=2'>{{body}}"


def opened(reader, page):
    """Open a page that has no program to say that it is ready."""
    reader.driver.get("about:blank")
    reader.driver.get(page.as_uri())


def media(reader, theme="light", kind=""):
    features = [{"name": "prefers-color-scheme", "value": theme}]
    reader.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features, "media": kind})


def test_it_is_one_file_that_asks_for_nothing(reader, report, tmp_path):
    alone = tmp_path / "alone.html"
    shutil.copy(report / "index.html", alone)
    opened(reader, alone)
    assert reader.text("h1") == "Study: made-up"
    assert [url for url in reader.requested() if not url.startswith(("file:", "data:", "about:"))] == []
    assert reader.errors() == []
    assert len(reader.all("figure svg")) == 17
    for box in reader.script(
        "return [...document.querySelectorAll('figure svg')].map((e) => e.getBoundingClientRect())"
    ):
        assert box["width"] > 500
        assert box["height"] > 100


def test_it_is_dark_on_dark_and_so_are_its_figures(reader, report):
    seen = """const ink = document.querySelector("figure svg text, figure svg use, figure svg path");
              return [getComputedStyle(document.body).backgroundColor, getComputedStyle(document.body).color,
                      getComputedStyle(document.querySelector("figure svg")).fill,
                      getComputedStyle(document.querySelector("figure")).backgroundColor]"""
    opened(reader, report / "index.html")
    media(reader, "light")
    light = reader.script(seen)
    media(reader, "dark")
    dark = reader.script(seen)
    assert all(a != b for a, b in zip(light, dark, strict=True))
    assert dark[2] == dark[1]  # letters in figures have the page's ink


def test_no_figure_brings_a_background_of_its_own(report):
    text = (report / "index.html").read_text(encoding="utf-8")
    assert "fill: #ffffff" not in text
    assert 'id="patch_1"' not in text


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_fits_a_phone(reader, report, theme):
    phone = {"width": 360, "height": 780, "deviceScaleFactor": 2, "mobile": True}
    reader.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", phone)
    media(reader, theme)
    opened(reader, report / "index.html")
    assert reader.script("return [document.documentElement.scrollWidth, innerWidth]") == [360, 360]


def test_on_paper_folded_tables_are_open_and_nothing_scrolls(reader, report):
    opened(reader, report / "index.html")
    inside = """return [...document.querySelectorAll("details .box")].map((e) => e.checkVisibility(
                    {contentVisibilityAuto: true, visibilityProperty: true}))"""
    assert not any(reader.script(inside))
    media(reader, "light", "print")
    assert all(reader.script(inside))
    assert len(reader.script(inside)) > 1
    assert reader.script("return getComputedStyle(document.querySelector('.wide')).overflowX") == "visible"


def test_every_picture_says_what_it_shows_and_every_link_leads_somewhere(reader, report):
    opened(reader, report / "index.html")
    labels = reader.script(
        "return [...document.querySelectorAll('figure svg')].map((e) => e.getAttribute('aria-label'))"
    )
    assert all(label and len(label) > 30 for label in labels)
    lost = """return [...document.querySelectorAll("nav a")].filter(
                  (a) => !document.getElementById(a.getAttribute("href").slice(1))).length"""
    assert reader.script(lost) == 0
    used = """return [...document.querySelectorAll("figure use")].filter(
                  (u) => !document.getElementById(u.getAttribute("xlink:href").slice(1))).length"""
    assert reader.script(used) == 0


def test_whatever_a_study_is_called_stays_words(reader, tmp_path):
    write_study(tmp_path / "s", {"latency": (0.0, 1.0)}, falling())
    told = json.loads((tmp_path / "s/study.json").read_text())
    (tmp_path / "s/study.json").write_text(json.dumps({**told, "name": HOSTILE, "design": HOSTILE}))
    assert main(["study", "report", str(tmp_path / "s"), "--out", str(tmp_path / "r")]) == 0
    opened(reader, tmp_path / "r/index.html")
    assert reader.text("h1") == f"Study: {HOSTILE}"
    assert reader.script("return window.hacked") is None
    assert reader.errors() == []
