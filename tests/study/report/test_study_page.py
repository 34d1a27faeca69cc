"""The page in a real browser, from a disk and without a network, on a screen and on paper."""

import json
import shutil

from dronecats.cli.main import main
from tests.study.report.test_report_files import FIGURES
from tests.study.studies import falling, write_study

HOSTILE = "</style><script>window.hacked=1</script><img src=x onerror='window.hacked=2'>{{body}}"


def opened(reader, page):
    """Open a page that has no program to say that it is ready."""
    reader.driver.get("about:blank")
    reader.driver.get(page.as_uri())


def test_it_is_one_file_that_asks_for_nothing(reader, report, tmp_path):
    alone = tmp_path / "alone.html"
    shutil.copy(report / "index.html", alone)
    opened(reader, alone)
    assert "made-up" in reader.text("h1")
    assert [url for url in reader.requested() if not url.startswith(("file:", "data:", "about:"))] == []
    assert reader.errors() == []
    assert len(reader.all("figure svg")) == len(FIGURES)


def test_on_paper_folded_tables_are_open(reader, report):
    opened(reader, report / "index.html")
    inside = """return [...document.querySelectorAll("details .box")].map((e) => e.checkVisibility(
                    {contentVisibilityAuto: true, visibilityProperty: true}))"""
    assert not any(reader.script(inside))
    reader.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    assert all(reader.script(inside))
    assert len(reader.script(inside)) > 1


def test_every_picture_says_what_it_shows_and_every_link_leads_somewhere(reader, report):
    opened(reader, report / "index.html")
    labels = reader.script(
        "return [...document.querySelectorAll('figure svg')].map((e) => e.getAttribute('aria-label'))"
    )
    assert all(labels)
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
    assert HOSTILE in reader.text("h1")
    assert reader.script("return window.hacked") is None
    assert reader.errors() == []
