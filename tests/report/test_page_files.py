"""The files of the report page: names, data, images and the sent prompts."""

import json
import re
from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.loop import PaperAgent, Questions
from dronecats.agent.prompt import Prompt
from dronecats.judge.metrics.judging import METRICS
from dronecats.judge.metrics.metric import Metric
from dronecats.report.kit.shell import program
from dronecats.report.page.index import keys, script_json, write_page
from dronecats.report.page.pictures import selected_frames
from dronecats.report.results.collection import collect
from foundation.errors import UsageError
from foundation.run_folder.prompts import prompts_of, read_prompts
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Decision
from foundation.run_folder.writing import LineLog, PromptLog
from foundation.threads import InlineExecutor
from tests.agent import test_hierarchy as hierarchy
from tests.agent.flown_wire import CAMERA, Clock, Views
from tests.support.run_folders import run_folder


def page_of(out, *runs, **how):
    return write_page(collect(runs), [], out, **how)


def flight_in(path):
    """Return the key and the flight that a file in data/ registers."""
    match = re.fullmatch(r"dronecatsFlight\((.*)\);\n", path.read_text(), re.DOTALL)
    assert match
    return json.loads(f"[{match[1]}]")


@given(st.lists(st.text(max_size=12), max_size=8))
def test_keys_are_unique_and_are_valid_file_names_on_every_system(names):
    file_keys = keys(names)
    assert len({key.lower() for key in file_keys}) == len(names)
    assert all(re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._-]*", key) and key not in ("of", "..") for key in file_keys)


@settings(max_examples=40)
@given(
    st.recursive(
        st.text() | st.none() | st.booleans(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)
    )
)
def test_script_json_preserves_values_and_cannot_end_a_script(value):
    written = script_json(value)
    assert json.loads(written) == value
    assert written.isascii()
    assert not set("<>&") & set(written)


def fly_paper_agent(folder, drones, groups, replies):
    """Fly the paper's agent; return (logged decisions, sent prompts)."""
    coming = iter(replies)
    model = hierarchy.FunctionModel(lambda request: next(coming))
    log, prompts = LineLog(folder / "decisions.jsonl"), PromptLog(folder / "prompts.jsonl")
    cockpit = Cockpit(
        aircraft=[Clock() for _ in range(drones)], camera=Views(), camera_model=CAMERA, log=log, prompts=prompts,
        frames_dir=folder, executor=InlineExecutor(), t0_us=0,
    )  # fmt: skip
    agent = PaperAgent(
        Questions(model, Prompt.load(None), "find it", LatencyPolicy.parse("fixed:0.5")), cockpit, groups
    )
    agent.fly(stop=lambda decision: len(model.asked) == len(replies))
    log.close()
    prompts.close()
    return list(rows(folder / "decisions.jsonl", Decision)), [request.text for request in model.asked]


def texts(folder, decisions):
    """Return the prompt text of each step, in the order of the steps."""
    prompts = prompts_of(decisions, read_prompts(folder))
    assert prompts.keys() == {
        (decision.drone, decision.step) for decision in decisions if not isinstance(decision.confirmed_by, int)
    }
    return [text for _, text in sorted({step: prompt.text for (_, step), prompt in prompts.items()}.items())]


def test_the_logged_prompts_equal_the_sent_prompts(tmp_path):
    go = hierarchy.GO
    replies = [go, "nonsense", hierarchy.TURN, '{"action":"think"}', go, hierarchy.DONE, go, go]
    decisions, sent = fly_paper_agent(tmp_path, 1, None, replies)
    assert len(decisions) == len(replies)
    assert texts(tmp_path, decisions) == sent


def test_prompts_after_the_first_take_little_space_in_the_log(tmp_path):
    fly_paper_agent(tmp_path, 1, None, [hierarchy.GO] * 8)
    first, *others = (tmp_path / "prompts.jsonl").read_text().splitlines()
    assert len(others) == 7
    assert all(len(line) < len(first) / 4 for line in others)


def test_the_logged_prompts_of_a_fleet_equal_the_sent_prompts(tmp_path):
    joint = [f"[{hierarchy.GO},{turn}]" for turn in (hierarchy.TURN, hierarchy.GO, "{}", hierarchy.DONE)]
    decisions, sent = fly_paper_agent(tmp_path, 2, None, joint)
    assert {decision.drone for decision in decisions} == {0, 1}
    assert texts(tmp_path, decisions) == sent


def test_the_logged_prompts_of_drones_that_decide_alone_were_sent(tmp_path):
    replies = [hierarchy.GO, hierarchy.TURN, hierarchy.DONE] * 3
    decisions, sent = fly_paper_agent(tmp_path, 2, [[0], [1]], replies)
    assert len(decisions) >= 8
    assert Counter(texts(tmp_path, decisions)) <= Counter(sent)


def test_the_logged_prompts_of_a_commander_and_its_drones_equal_the_sent_prompts(tmp_path):
    pilot = hierarchy.FunctionModel(
        lambda request: hierarchy.DONE if request.drone == 1 and request.step > 2 else hierarchy.GO
    )
    other = {"orders": [{"drone": 2, "goal": "something else"}]}
    commander = hierarchy.script({"orders": hierarchy.EVERYBODY}, other, {"confirm": [2]})
    folder = tmp_path / "flight"
    _, exchanges, _ = hierarchy.fly(folder, pilot, commander, seconds=40.0)
    decisions, prompts = list(rows(folder / "decisions.jsonl", Decision)), read_prompts(folder)
    answered = prompts_of(decisions, prompts)
    for drone in range(3):
        own = [answered[d.drone, d.step].text for d in decisions if d.drone == drone and (d.drone, d.step) in answered]
        assert own == [request.text for request in pilot.asked if request.drone == drone][: len(own)]
        assert len(own) > 4
    confirmed = [(d.drone, d.step) for d in decisions if isinstance(d.confirmed_by, int)]
    assert confirmed
    assert not answered.keys() & set(confirmed)
    assert [p.text for p in prompts if p.row.role == "commander"] == [request.text for request in commander.asked]
    assert [p.row.number for p in prompts if p.row.role == "commander"] == [exchange.number for exchange in exchanges]


def test_each_flight_has_its_own_file_and_the_page_contains_no_flight(tmp_path):
    run = run_folder(tmp_path / "runs/vision", {"yard-approaching-01": "go to the cyan car"})
    page = page_of(tmp_path / "report", run)
    key, flight = flight_in(tmp_path / "report/data/vision/yard-approaching-01.js")
    assert key == "vision/yard-approaching-01"
    assert flight["instruction"] == "go to the cyan car"
    decisions = [json.loads(line) for line in (run / "yard-approaching-01/decisions.jsonl").read_text().splitlines()]
    assert [step.get("action") for step in flight["steps"]] == [decision["action"] for decision in decisions]
    assert [flight["texts"][step["reply"]] for step in flight["steps"]] == [d["reply"] for d in decisions]
    assert "go to the cyan car" not in page.read_text()


def test_the_same_runs_give_the_same_page(tmp_path):
    run = run_folder(tmp_path / "runs/vision", {"yard-approaching-01": "go", "yard-searching-01": "look"})
    first, second = (page_of(tmp_path / name, run) for name in ("one", "two"))
    assert first.read_bytes() == second.read_bytes()
    written = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*.js"))
    assert written
    assert all((tmp_path / "one" / path).read_bytes() == (tmp_path / "two" / path).read_bytes() for path in written)
    assert page_of(tmp_path / "one", run).read_bytes() == second.read_bytes()  # over an older page


def test_a_page_over_an_older_one_removes_the_flights_that_it_does_not_show(tmp_path):
    runs = [run_folder(tmp_path / f"runs/{name}", {"yard-approaching-01": "go"}) for name in ("one", "two")]
    page_of(tmp_path / "report", *runs)
    own = tmp_path / "report/data/mine.js"
    own.write_text("a file of the user")
    page_of(tmp_path / "report", runs[1])
    assert sorted(tmp_path.glob("report/data/**/*.js")) == [own, tmp_path / "report/data/two/yard-approaching-01.js"]


def test_pictures_are_links_to_the_frames_of_the_run(tmp_path):
    run = run_folder(tmp_path / "runs/vision", {"yard-approaching-01": "go"})
    page_of(tmp_path / "report", run)
    there = tmp_path / "report/pictures/vision/yard-approaching-01"
    assert len(list(there.iterdir())) == 6
    assert all(path.samefile(run / "yard-approaching-01/frames" / path.name) for path in there.iterdir())


def test_too_many_embedded_pictures_are_thinned_to_every_nth_step(tmp_path, monkeypatch):
    monkeypatch.setattr("dronecats.report.page.pictures.EMBEDDED_MAX", 3)
    run = run_folder(tmp_path / "runs/vision", {"yard-approaching-01": "go"}, steps=10)
    page = page_of(tmp_path / "report", run, embed=True).read_text()
    match = re.search(r'id="flight:vision/yard-approaching-01">(.*)</script>', page)
    assert match
    flight = json.loads(match[1])
    assert ["picture" in step for step in flight["steps"]] == [step in (0, 4, 8, 9) for step in range(10)]


def test_every_declaration_keeps_its_picture():
    actions = ("go", "go", "finished", "go", "go", "go")
    decisions = [
        Decision(
            step=step, drone=drone, frame_id=2 * step + drone, t_frame=step, t_decided=step, action={"action": word}
        )
        for step, word in enumerate(actions)
        for drone in (0, 1)
    ]
    assert selected_frames(decisions, 4) == {(drone, 2 * step + drone) for step in (0, 2, 4, 5) for drone in (0, 1)}


def test_a_run_without_rendering_has_no_pictures_folder(tmp_path):
    run = run_folder(tmp_path / "runs/oracle", {"yard-approaching-01": "go"}, pictures=False)
    page_of(tmp_path / "report", run)
    assert not (tmp_path / "report/pictures").exists()


def test_two_runs_with_the_same_name_have_separate_keys(tmp_path):
    runs = [
        run_folder(tmp_path / f"{k}/vision", {"yard-approaching-01": "go"}, seed=k, reply_text=f"said {k}")
        for k in (0, 1)
    ]
    page_of(tmp_path / "report", *runs)
    flights = [flight_in(tmp_path / f"report/data/{key}/yard-approaching-01.js")[1] for key in ("vision", "vision-2")]
    assert [flight["texts"][flight["steps"][0]["reply"]] for flight in flights] == ["said 0", "said 1"]


def test_the_page_has_custom_metrics_and_marks_omitted_episodes(tmp_path):
    run = run_folder(tmp_path / "runs/vision", {"yard-approaching-01": "go", "yard-searching-01": "look"})
    own = Metric(name="replies", title="Replies", unit="count", level="episode", better=None, definition="how many",
                 paper="", of=lambda flight: float(len(flight.logs.decisions)))  # fmt: skip
    collection = collect([run], metrics=(*METRICS.values(), own))
    first, *others = collection.episodes
    page = write_page(
        replace(collection, episodes=(replace(first, left_out="chosen"), *others)), [], tmp_path / "report"
    )
    match = re.search(r'id="index">(.*?)</script>', page.read_text(), re.DOTALL)
    assert match
    index = json.loads(match[1])
    place = [metric["name"] for metric in index["metrics"]].index("replies")
    assert [episode["values"][place] for episode in index["episodes"]] == [6.0, 6.0]
    assert [episode["counted"] for episode in index["episodes"]] == [False, True]


def test_an_unwritable_folder_is_an_error(tmp_path):
    run = run_folder(tmp_path / "runs/vision", {"yard-approaching-01": "go"})
    (tmp_path / "report").write_text("in the way")
    with pytest.raises(UsageError, match="report"):
        page_of(tmp_path / "report", run)


def test_the_script_fetches_nothing_and_never_inserts_text_as_markup():
    text = program("main", "dronecats.report.page")
    assert "import" not in re.findall(r"^\w+", text, re.MULTILINE)
    assert "export" not in re.findall(r"^\w+", text, re.MULTILINE)
    for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "fetch(", "XMLHttpRequest",
                 "https:", "WebSocket", "</script"):  # fmt: skip
        assert word not in text
