"""The study page in a real browser: opened from disk without a network, on a screen and in print."""

import json
import shutil

from dronecats.cli.main import main
from dronecats.report.kit import palette
from dronecats.study.report import report_folder
from tests.study.report.test_report_files import FIGURES
from tests.study.studies import APPROACHING, TRACKING, falling, write_study
from tests.support.narrow_pages import DESK, PHONE, assert_rows_can_be_read_while_scrolling, sized, wider_than_shown

HOSTILE = "</style><script>window.hacked=1</script><img src=x onerror='window.hacked=2'>{{body}}"


def opened(reader, page):
    """Open a page that has no program to signal that it is ready."""
    reader.driver.get("about:blank")
    reader.driver.get(page.as_uri())


def test_the_page_is_one_file_that_requests_nothing(reader, report, tmp_path):
    alone = tmp_path / "alone.html"
    shutil.copy(report / "index.html", alone)
    opened(reader, alone)
    assert "made-up" in reader.text("h1")
    assert [url for url in reader.requested() if not url.startswith(("file:", "data:", "about:"))] == []
    assert reader.errors() == []
    assert len(reader.all("figure svg")) == len(FIGURES)


def test_on_a_phone_row_heads_stay_visible_and_a_shadow_marks_hidden_columns(reader, report):
    sized(reader.driver, PHONE)
    opened(reader, report / "index.html")
    assert_rows_can_be_read_while_scrolling(reader.driver)


def test_on_a_desktop_no_table_needs_scrolling(reader, tmp_path, monkeypatch):
    monkeypatch.setattr(report_folder, "draw", lambda findings, out: [])  # figures take most of the time of a report
    levels = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
    write_study(tmp_path / "s", {"latency": levels}, falling(), episodes=(*TRACKING[:8], *APPROACHING[:3]), flights=2)
    assert main(["study", "report", str(tmp_path / "s"), "--out", str(tmp_path / "r")]) == 0
    sized(reader.driver, DESK)
    opened(reader, tmp_path / "r/index.html")
    assert wider_than_shown(reader.driver) == []


def test_folded_tables_are_open_in_print(reader, report):
    opened(reader, report / "index.html")
    inside = """return [...document.querySelectorAll("details .box")].map((e) => e.checkVisibility(
                    {contentVisibilityAuto: true, visibilityProperty: true}))"""
    assert not any(reader.script(inside))
    reader.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    reader.until(lambda: all(reader.script(inside)))  # the style is applied one frame later
    assert len(reader.script(inside)) > 1


def test_every_figure_has_a_label_and_every_link_has_a_target(reader, report):
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


def test_a_hostile_study_name_stays_text(reader, tmp_path):
    write_study(tmp_path / "s", {"latency": (0.0, 1.0)}, falling())
    document = json.loads((tmp_path / "s/study.json").read_text())
    (tmp_path / "s/study.json").write_text(json.dumps({**document, "name": HOSTILE, "design": HOSTILE}))
    assert main(["study", "report", str(tmp_path / "s"), "--out", str(tmp_path / "r")]) == 0
    opened(reader, tmp_path / "r/index.html")
    assert HOSTILE in reader.text("h1")
    assert reader.script("return window.hacked") is None
    assert reader.errors() == []


def test_the_chosen_theme_is_kept_after_a_reload(reader, report):
    opened(reader, report / "index.html")
    paper = "return getComputedStyle(document.body).backgroundColor"
    before = reader.script(paper)
    while reader.script("return document.documentElement.dataset.theme") != "dark":
        reader.one("#theme").click()
    assert reader.script(paper) == "rgb" + str(palette.rgb(palette.DARK["paper"])) != before
    opened(reader, report / "index.html")
    assert reader.script("return document.documentElement.dataset.theme") == "dark"
    reader.script("localStorage.clear()")
