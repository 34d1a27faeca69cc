"""The page in a real browser: its tables and text, its layout, and strange or damaged runs."""

import json
import re
import shutil

from dronecats.report.page.index import write_page
from dronecats.report.results.collection import collect
from tests.report.paged_runs import EPISODES, TABLE, picture_is, point_of, ring_is_at
from tests.support.run_folders import episode_folder, run_folder

HOSTILE = (
    "</script><script>window.hacked=1</script><img src=x onerror='window.hacked=2'><!-- <script> {{blocks}}</script x"
)


def test_the_tables_show_their_values_and_link_to_lists(reader, page):
    reader.open(page)
    text = reader.text()
    for part in ("SR", "NE", "34–100", "3.9", "dronecats report runs"):
        assert part in text
    reader.click("100")
    reader.until(lambda: re.fullmatch("#of/.*/approaching", reader.hash))


def test_a_list_can_be_sorted_and_filtered(reader, runs, tmp_path):
    """One of the three flights declares nothing and fails, so each outcome hides at least one row."""
    from selenium.webdriver.support.ui import Select

    shutil.copytree(runs / "oracle", tmp_path / "oracle")
    silent = "yard-approaching-02"
    log = tmp_path / "oracle" / silent / "decisions.jsonl"
    log.write_text("".join(line for line in log.read_text().splitlines(True) if '"finished"' not in line))
    reader.open(write_page(collect([tmp_path / "oracle"]), [], tmp_path / "report"), "#of/oracle")
    names = lambda: [element.text for element in reader.all("main [data-row]")]  # noqa: E731
    assert names() == sorted(EPISODES)
    assert [element.text for element in reader.all("tbody td:nth-child(3)")] == ["success", "arrived", "success"]
    reader.click("Episode")
    reader.click("Episode")
    assert names() == sorted(EPISODES, reverse=True)
    assert reader.one("th[aria-sort]").get_attribute("aria-sort") == "descending"
    for outcome, shown in (("failure", [silent]), ("success", sorted({*EPISODES} - {silent}, reverse=True))):
        Select(reader.one("#outcome")).select_by_value(outcome)
        assert names() == shown
    Select(reader.one("#outcome")).select_by_value("")
    assert len(names()) == 3


# roles of a page's accessibility tree whose nodes must have a name
NAMED = {"button", "link", "combobox", "slider", "textbox", "image", "checkbox", "option", "dialog", "columnheader"}
SHOWN = NAMED - {"textbox", "checkbox", "dialog"}  # roles on the pages of the test


def test_every_control_and_image_has_an_accessible_name(reader, page):
    roles: set[str] = set()
    for place in ("", "#of/oracle", "#fleet/yard-commanding-01/2"):
        reader.open(page, place)
        tree = reader.driver.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
        nodes = [node for node in tree if not node.get("ignored")]
        used = [(node["role"]["value"], node.get("name", {}).get("value", "")) for node in nodes
                if node["role"]["value"] in NAMED]  # fmt: skip
        roles |= {role for role, _ in used}
        assert [role for role, name in used if not name.strip()] == [], place
    assert roles == SHOWN  # a browser that renames a role would hide its nodes


def test_model_output_is_never_markup(reader, tmp_path):
    """The hostile text is a reply, an instruction and a model name, in separate files and in an embedded page."""
    model = {"provider": "vllm", "name": HOSTILE}
    folder = tmp_path / "runs/<b>run"
    run_folder(folder, {}, model=model)
    episode_folder(folder / "yard-approaching-01", HOSTILE, reply_text=HOSTILE)
    for embed in (False, True):
        page = write_page(collect([folder]), [], tmp_path / f"report-{embed}", embed=embed)
        reader.open(page)
        assert HOSTILE in reader.text()
        reader.open(page, "#b-run/yard-approaching-01/1")
        assert reader.text(".reply") == HOSTILE
        assert HOSTILE in reader.text(".told")
        assert reader.script("return window.hacked") is None
        assert reader.errors() == []


def test_an_embedded_page_is_one_file_that_can_be_moved(reader, runs, tmp_path):
    written = write_page(collect([runs]), [TABLE], tmp_path / "report", embed=True)
    assert [path.name for path in written.parent.iterdir()] == ["index.html"]
    alone = tmp_path / "elsewhere.html"
    shutil.move(written, alone)
    reader.open(alone)
    reader.open(alone, "#qwen/yard-approaching-01/2")
    reader.until(
        lambda: reader.script(
            "const i = document.querySelector('.view img'); return i?.complete && i.naturalWidth === 320"
        )
    )
    ring_is_at(reader, point_of(runs, "qwen/yard-approaching-01", 2))
    reader.press("j")
    reader.until(lambda: reader.hash.endswith("/3"))
    assert reader.errors() == []


def test_damage_is_reported_and_other_episodes_still_open(reader, runs, tmp_path):
    shutil.copytree(runs / "qwen", tmp_path / "qwen")
    log = tmp_path / "qwen/yard-approaching-01/truth.jsonl"
    log.write_text("{}\n" + log.read_text())
    (tmp_path / "qwen/yard-searching-01/commander.jsonl").write_text("{}\n")
    page = write_page(collect([tmp_path / "qwen"]), [], tmp_path / "report")
    for episode, file in (("yard-approaching-01", "truth.jsonl"), ("yard-searching-01", "commander.jsonl")):
        reader.open(page, f"#qwen/{episode}")
        assert f"{file} line 1 " in reader.text()
    reader.open(page, "#qwen/yard-approaching-02/1")
    picture_is(reader, "yard-approaching-02/000001.jpg")
    (tmp_path / "report/data/qwen/yard-approaching-02.js").unlink()
    reader.open(page, "#qwen/yard-approaching-02/1")
    assert "data/qwen/yard-approaching-02.js" in reader.text()


def test_commander_exchanges_are_listed(reader, runs, tmp_path):
    shutil.copytree(runs / "fleet", tmp_path / "fleet")
    exchange = {"number": 0, "t_asked": 2.7, "t_answered": 3.2, "causes": [{"why": "report", "drone": 1}],
             "roster": "Drone 1", "frames": [0, 1, 2, 3], "reply": HOSTILE,
             "orders": [{"drone": 2, "goal": "look behind"}], "confirms": [1], "error": None, "latency_s": 0.5,
             "tokens_in": 10, "tokens_out": 2, "model": "chief"}  # fmt: skip
    (tmp_path / "fleet/yard-commanding-01/commander.jsonl").write_text(json.dumps(exchange) + "\n")
    page = write_page(collect([tmp_path / "fleet"]), [], tmp_path / "report")
    reader.open(page, "#fleet/yard-commanding-01")
    reader.one(".exchanges summary").click()
    text = reader.text(".exchanges")
    for words in ("2.7 s", "drone 2", "look behind", "chief", HOSTILE):
        assert words in text
    reader.click("Go to this time")
    reader.until(lambda: reader.hash == "#fleet/yard-commanding-01/1")
    assert reader.script("return window.hacked") is None
